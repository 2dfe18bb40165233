"""The identities and versions of types, objects, predicates, functions, actions and formulas."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    CheckConstraint,
    Double,
    ForeignKeyConstraint,
    Index,
    Integer,
    String,
    UniqueConstraint,
    false,
)
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    LIVE,
    Base,
    Identity,
    LongText,
    ShortText,
    Version,
    fork_column,
    identity_args,
    kb_column,
    lookup_index,
    owner_column,
    partial_index,
    since_column,
    version_args,
)
from .expressions import (
    ExpressionNode,
    ExpressionTerm,
    ExpressionVariable,
    ExpressionVariableType,
    Parameter,
    ParameterType,
    node_args,
    parameter_args,
    parameter_type_args,
    term_args,
    variable_args,
    variable_type_args,
)


class TypeRow(Identity, Base):
    """A type, for ever."""

    __tablename__ = "type"
    __table_args__ = identity_args()


class TypeVersionRow(Version, Base):
    """A type's place in the hierarchy, for a time."""

    __tablename__ = "type_version"
    __table_args__ = (
        *version_args("type"),
        ForeignKeyConstraint(["kb_id", "parent_id"], ["type.kb_id", "type.id"]),
    )

    type_id: Mapped[int] = owner_column()
    parent_id: Mapped[int | None] = mapped_column(
        BigInteger, comment="the type above it; NULL: right under the root"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class TypeParentRow(Base):
    """A further parent of a type whose parent is declared with `either`."""

    __tablename__ = "type_parent"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "type_id", "since"],
            ["type_version.kb_id", "type_version.type_id", "type_version.since"],
        ),
        ForeignKeyConstraint(["kb_id", "parent_id"], ["type.kb_id", "type.id"]),
        Index("ix_type_parent_parent", "kb_id", "parent_id"),
    )

    kb_id: Mapped[int] = kb_column()
    type_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 1: the first is in the version",
    )
    parent_id: Mapped[int] = mapped_column(BigInteger)


class ObjectRow(Identity, Base):
    """An object, for ever."""

    __tablename__ = "object"
    __table_args__ = (*identity_args(), lookup_index("object", "name"))


class ObjectVersionRow(Version, Base):
    """An object's type, for a time."""

    __tablename__ = "object_version"
    __table_args__ = (
        *version_args("object"),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
    )

    object_id: Mapped[int] = owner_column()
    type_id: Mapped[int] = mapped_column(BigInteger)
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")
    is_constant: Mapped[bool] = mapped_column(
        Boolean, server_default=false(), comment="declared in the domain, not in the problem"
    )


class ObjectTypeRow(Base):
    """A further type of an object that is declared with `either`."""

    __tablename__ = "object_type"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "object_id", "since"],
            ["object_version.kb_id", "object_version.object_id", "object_version.since"],
        ),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index("ix_object_type_type", "kb_id", "type_id"),
    )

    kb_id: Mapped[int] = kb_column()
    object_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 1: the first is in the version",
    )
    type_id: Mapped[int] = mapped_column(BigInteger)


class PredicateRow(Identity, Base):
    """A predicate, for ever."""

    __tablename__ = "predicate"
    __table_args__ = (*identity_args(), lookup_index("predicate", "name"))


class PredicateVersionRow(Version, Base):
    """A predicate's definition, for a time; its parameters are rows of their own."""

    __tablename__ = "predicate_version"
    __table_args__ = (*version_args("predicate"),)

    predicate_id: Mapped[int] = owner_column()
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class PredicateParameterRow(Parameter, Base):
    """A parameter of one version of a predicate."""

    __tablename__ = "predicate_parameter"
    __table_args__ = parameter_args("predicate")

    predicate_id: Mapped[int] = owner_column()


class PredicateParameterTypeRow(ParameterType, Base):
    """A type that a predicate's parameter allows: one row, or several for `either`."""

    __tablename__ = "predicate_parameter_type"
    __table_args__ = parameter_type_args("predicate")

    predicate_id: Mapped[int] = owner_column()


class FunctionRow(Identity, Base):
    """A function, for ever."""

    __tablename__ = "function"
    __table_args__ = (*identity_args(), lookup_index("function", "name"))


class FunctionVersionRow(Version, Base):
    """A function's definition, for a time; its parameters are rows of their own."""

    __tablename__ = "function_version"
    __table_args__ = (*version_args("function"),)

    function_id: Mapped[int] = owner_column()
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class FunctionParameterRow(Parameter, Base):
    """A parameter of one version of a function."""

    __tablename__ = "function_parameter"
    __table_args__ = parameter_args("function")

    function_id: Mapped[int] = owner_column()


class FunctionParameterTypeRow(ParameterType, Base):
    """A type that a function's parameter allows: one row, or several for `either`."""

    __tablename__ = "function_parameter_type"
    __table_args__ = parameter_type_args("function")

    function_id: Mapped[int] = owner_column()


class FunctionTypeRow(Base):
    """A type of a function's values: none for numbers, several for `either`."""

    __tablename__ = "function_type"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "function_id", "since"],
            ["function_version.kb_id", "function_version.function_id", "function_version.since"],
        ),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index("ix_function_type_type", "kb_id", "type_id"),
    )

    kb_id: Mapped[int] = kb_column()
    function_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60, comment="from 0"
    )
    type_id: Mapped[int] = mapped_column(BigInteger)


class FunctionValueRow(Base):
    """A function applied to objects, interned once for ever: a fluent."""

    __tablename__ = "function_value"
    __table_args__ = (
        ForeignKeyConstraint(["kb_id", "function_id"], ["function.kb_id", "function.id"]),
        UniqueConstraint("kb_id", "function_id", "arguments", name="uq_function_value_fluent"),
        lookup_index("function_value", "text"),
    )

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    function_id: Mapped[int] = mapped_column(BigInteger)
    arguments: Mapped[str] = mapped_column(
        LongText, comment="the ids of its objects in order, by spaces: the key that interns it"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL, without the value")


class FunctionValueArgumentRow(Base):
    """An argument of a fluent."""

    __tablename__ = "function_value_argument"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "function_value_id"], ["function_value.kb_id", "function_value.id"]
        ),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        Index("ix_function_value_argument_object", "kb_id", "object_id", "function_value_id"),
    )

    kb_id: Mapped[int] = kb_column()
    function_value_id: Mapped[int] = owner_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, comment="from 0"
    )
    object_id: Mapped[int] = mapped_column(BigInteger)


class FunctionValueVersionRow(Version, Base):
    """What a fluent was, for a time."""

    __tablename__ = "function_value_version"
    __table_args__ = (
        *version_args("function_value", has_parts=False),
        ForeignKeyConstraint(["kb_id", "function_id"], ["function.kb_id", "function.id"]),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        CheckConstraint("(value IS NULL) <> (object_id IS NULL)", name="value_or_object"),
        CheckConstraint("(value IS NULL) = (number IS NULL)", name="number_of_value"),
        partial_index(
            "ix_function_value_version_now",
            "kb_id",
            "function_id",
            "function_value_id",
            "until",
            where=LIVE,
        ),
        Index(
            "ix_function_value_version_history",
            "kb_id",
            "function_id",
            "fork",
            "since",
            "until",
            "function_value_id",
        ),
        # Numbers change often, and have no place in it.
        partial_index(
            "ix_function_value_version_object",
            "kb_id",
            "object_id",
            where="object_id IS NOT NULL",
        ),
    )

    function_value_id: Mapped[int] = owner_column()
    function_id: Mapped[int] = mapped_column(BigInteger)
    value: Mapped[str | None] = mapped_column(LongText, comment="the number, as exact decimal text")
    number: Mapped[float | None] = mapped_column(
        Double, comment="the number, as near as a double comes"
    )
    object_id: Mapped[int | None] = mapped_column(BigInteger, comment="the object that it is")
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL, with the value")
    fork: Mapped[int] = fork_column()


class ActionRow(Identity, Base):
    """An action, for ever."""

    __tablename__ = "action"
    __table_args__ = identity_args()


class ActionVersionRow(Version, Base):
    """An action's definition, for a time; its parts are rows of their own."""

    __tablename__ = "action_version"
    __table_args__ = (*version_args("action"),)

    action_id: Mapped[int] = owner_column()
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")
    kind: Mapped[str] = mapped_column(
        String(16),
        server_default="action",
        comment="action, durative-action, process or event",
    )


class ActionParameterRow(Parameter, Base):
    """A parameter of one version of an action."""

    __tablename__ = "action_parameter"
    __table_args__ = parameter_args("action")

    action_id: Mapped[int] = owner_column()


class ActionParameterTypeRow(ParameterType, Base):
    """A type that an action's parameter allows: one row, or several for `either`."""

    __tablename__ = "action_parameter_type"
    __table_args__ = parameter_type_args("action")

    action_id: Mapped[int] = owner_column()


class ActionNodeRow(ExpressionNode, Base):
    """A node of an action's duration, condition or effect."""

    __tablename__ = "action_node"
    __table_args__ = (
        *node_args("action"),
        CheckConstraint("section IN ('duration', 'condition', 'effect')", name="section"),
    )

    action_id: Mapped[int] = owner_column()


class ActionVariableRow(ExpressionVariable, Base):
    """A variable that a quantifier of an action binds."""

    __tablename__ = "action_variable"
    __table_args__ = variable_args("action")

    action_id: Mapped[int] = owner_column()


class ActionVariableTypeRow(ExpressionVariableType, Base):
    """A type that such a variable allows: one row, or several for `either`."""

    __tablename__ = "action_variable_type"
    __table_args__ = variable_type_args("action")

    action_id: Mapped[int] = owner_column()


class ActionTermRow(ExpressionTerm, Base):
    """A term of a node of an action."""

    __tablename__ = "action_term"
    __table_args__ = term_args("action", has_parameters=True)

    action_id: Mapped[int] = owner_column()


_KINDS = "('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', 'metric')"


class FormulaRow(Identity, Base):
    """A formula, for ever; its name is the SHA-256 of its section and its text, in hexadecimal."""

    __tablename__ = "formula"
    __table_args__ = identity_args()


class FormulaVersionRow(Version, Base):
    """When a formula stood."""

    __tablename__ = "formula_version"
    __table_args__ = (
        *version_args("formula"),
        CheckConstraint(f"section IN {_KINDS}", name="section"),
    )

    formula_id: Mapped[int] = owner_column()
    section: Mapped[str] = mapped_column(
        String(24), comment="the part of the domain or the problem that it stands in"
    )
    text: Mapped[str] = mapped_column(LongText, comment="canonical PDDL")


class FormulaNodeRow(ExpressionNode, Base):
    """A node of a formula."""

    __tablename__ = "formula_node"
    __table_args__ = node_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaVariableRow(ExpressionVariable, Base):
    """A variable that a rule or a quantifier of a formula binds."""

    __tablename__ = "formula_variable"
    __table_args__ = variable_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaVariableTypeRow(ExpressionVariableType, Base):
    """A type that such a variable allows: one row, or several for `either`."""

    __tablename__ = "formula_variable_type"
    __table_args__ = variable_type_args("formula")

    formula_id: Mapped[int] = owner_column()


class FormulaTermRow(ExpressionTerm, Base):
    """A term of a node of a formula."""

    __tablename__ = "formula_term"
    __table_args__ = term_args("formula", has_parameters=False)

    formula_id: Mapped[int] = owner_column()


class DocumentRow(Identity, Base):
    """The domain, or the problem, for ever: there is one of each."""

    __tablename__ = "document"
    __table_args__ = (
        *identity_args(),
        CheckConstraint("key IN ('domain', 'problem')", name="domain_or_problem"),
    )


class DocumentVersionRow(Version, Base):
    """What a document was called, for a time."""

    __tablename__ = "document_version"
    __table_args__ = (*version_args("document"),)

    document_id: Mapped[int] = owner_column()
    title: Mapped[str] = mapped_column(ShortText, comment="the name in its define form")
    domain: Mapped[str | None] = mapped_column(ShortText, comment="a problem's domain")
    text: Mapped[str] = mapped_column(LongText, comment="all of it on one line")


class DocumentItemRow(Base):
    """A place in a document: what stands there is live elsewhere, or the place is empty."""

    __tablename__ = "document_item"
    __table_args__ = (
        ForeignKeyConstraint(
            ["kb_id", "document_id", "since"],
            ["document_version.kb_id", "document_version.document_id", "document_version.since"],
        ),
    )

    kb_id: Mapped[int] = kb_column()
    document_id: Mapped[int] = owner_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = mapped_column(
        String(24), primary_key=True, sort_order=-70, comment="requirement, type, goal ..."
    )
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60, comment="from 0"
    )
    name: Mapped[str] = mapped_column(
        LongText, comment="the element's name; for a goal that is a ground atom, its text"
    )
