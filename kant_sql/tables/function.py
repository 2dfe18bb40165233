"""PDDL functions, and what they map their arguments to."""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    Double,
    ForeignKeyConstraint,
    Index,
    Integer,
    UniqueConstraint,
)
from sqlalchemy.orm import Mapped, mapped_column

from .base import (
    LIVE,
    Base,
    Identity,
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
from .parameter import Parameter, ParameterType, parameter_args, parameter_type_args
from .types import LongText


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
