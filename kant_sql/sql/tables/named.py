"""The tables of named elements: identities, versions, and the lists of each version.

An expression tree is a list in preorder. A node has its operator (`and`, `over all`, `increase`,
`predicate` ...), and a leaf also its predicate, function, number or variable; the terms of a node,
and the variables of a quantifier, are lists of the node.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    ForeignKeyConstraint,
    Index,
    Integer,
    String,
    Table,
    UniqueConstraint,
    false,
)

from .base import (
    ASSERTED,
    RETRACTED,
    Base,
    LongText,
    ShortText,
    lookup_index,
    reference,
    version_args,
)


def _key(name: str, kind: Any = BigInteger, comment: str | None = None) -> Column[Any]:
    return Column(name, kind, primary_key=True, autoincrement=False, comment=comment)


def _place(name: str, comment: str | None = None) -> Column[Any]:
    return _key(name, Integer, comment)


def _column(
    name: str, kind: Any = BigInteger, comment: str | None = None, default: Any = None
) -> Column[Any]:
    return Column(name, kind, nullable=False, server_default=default, comment=comment)


def _optional(name: str, kind: Any = BigInteger, comment: str | None = None) -> Column[Any]:
    return Column(name, kind, comment=comment)


def _text(comment: str = "canonical PDDL") -> Column[Any]:
    return _column("text", LongText, comment)


def _alternative() -> Column[Any]:
    return _place("alternative", "from 0: several for either")


def _table(name: str, *items: Any) -> None:
    Table(name, Base.metadata, _key("kb_id"), *items)


def _identity(element: str, *items: Any) -> None:
    """Make the table of permanent identities, separate from their versions."""
    _table(
        element,
        _key("id"),
        _column("name", ShortText, "in its first spelling"),
        _column("key", LongText, "the name as compared: case folded"),
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        UniqueConstraint("kb_id", "key"),
        *items,
    )


def _version(element: str, *items: Any) -> None:
    """Make the table of an element's versions."""
    owner, table = f"{element}_id", f"{element}_version"
    _table(
        table,
        _key(owner),
        _key("since", comment=ASSERTED),
        _optional("until", comment=RETRACTED),
        *items,
        reference(owner, element),
        *version_args(table, owner, has_lists=True),
    )


def _list(element: str, name: str, *items: Any) -> None:
    """Make the table of a list in each version of an element."""
    _table(f"{element}_{name}", _key(f"{element}_id"), _key("since", comment=ASSERTED), *items)


def _within(
    element: str, name: str, *columns: str, to: tuple[str, ...] = (), key: str | None = None
) -> ForeignKeyConstraint:
    """Make a reference to a row of the same version, in another table of the element."""
    version = ("kb_id", f"{element}_id", "since")
    targets = [f"{element}_{name}.{column}" for column in (*version, *(to or columns))]
    return ForeignKeyConstraint([*version, *columns], targets, name=key)


def _types(element: str, name: str, column: str = "type_id") -> tuple[Any, ...]:
    """Return a column that refers to a type, with its constraint and index."""
    index = Index(f"ix_{element}_{name}_{column.removesuffix('_id')}", "kb_id", column)
    return _column(column), reference(column, "type"), index


def _type_list(element: str, name: str, column: str = "type_id", first: int = 1) -> None:
    """Make the table of an element's types, or of those after the first."""
    comment = "from 1: the first is in the version" if first else "from 0"
    types = _types(element, name, column)
    _list(element, name, _place("position", comment), *types, _within(element, "version"))


def _parameters(element: str) -> None:
    """Make the tables of an element's parameters, and of the types that each allows."""
    _list(
        element,
        "parameter",
        _place("position", "from 0"),
        _column("name", ShortText, "without its question mark"),
        _within(element, "version"),
    )
    _list(
        element,
        "parameter_type",
        _place("position"),
        _alternative(),
        *_types(element, "parameter_type"),
        _within(element, "parameter", "position"),
    )


_NODE = ("section", "position")


def _node_key() -> tuple[Any, ...]:
    section = _key("section", String(24), "the part of its owner")
    return section, _place("position", "from 0, in preorder")


def _trees(element: str, has_parameters: bool, *checks: Any) -> None:
    """Make the tables of an element's expression trees."""
    _nodes(element, *checks)
    _terms(element, has_parameters)
    variable, type_ = f"fk_{element}_variable", f"fk_{element}_variable_type"
    _list(
        element,
        "variable",
        *_node_key(),
        _place("variable", "from 0"),
        _column("name", ShortText, "without its question mark"),
        _within(element, "node", *_NODE, key=f"{variable}_node"),
    )
    _list(
        element,
        "variable_type",
        *_node_key(),
        _place("variable"),
        _alternative(),
        *_types(element, "variable_type"),
        _within(element, "variable", *_NODE, "variable", key=f"{type_}_variable"),
    )


def _nodes(element: str, *checks: Any) -> None:
    table = f"{element}_node"
    _list(
        element,
        "node",
        *_node_key(),
        _optional("parent", Integer, "the position of the node above; NULL: the root"),
        _column(
            "operator",
            String(32),
            "and, not, over all, increase, predicate, function, number ...",
        ),
        _optional("predicate_id"),
        _optional("function_id"),
        _optional(
            "value",
            LongText,
            "a number as exact decimal text, a variable's or a preference's name",
        ),
        _within(element, "version", key=f"fk_{table}_version"),
        _within(element, "node", "section", "parent", to=_NODE, key=f"fk_{table}_parent"),
        reference("predicate_id", "predicate"),
        reference("function_id", "function"),
        CheckConstraint("parent < position", name="preorder"),
        CheckConstraint("(parent IS NULL) = (position = 0)", name="one_root"),
        CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)", name="predicate_given"
        ),
        CheckConstraint(
            "(operator = 'function') = (function_id IS NOT NULL)", name="function_given"
        ),
        *checks,
        Index(f"ix_{table}_predicate", "kb_id", "predicate_id"),
        Index(f"ix_{table}_function", "kb_id", "function_id"),
    )


_ONE_OF_FOUR = " + ".join(
    f"CASE WHEN {column} IS NULL THEN 0 ELSE 1 END"
    for column in ("parameter", "object_id", "variable", "child")
)


def _terms(element: str, has_parameters: bool) -> None:
    """Make the table of the terms of nodes: parameters, variables, objects, fluents."""
    table = f"{element}_term"
    bound = ("section", "quantifier", "variable")
    of_parameters: Any = CheckConstraint("parameter IS NULL", name="no_parameter")
    if has_parameters:
        of_parameters = _within(
            element, "parameter", "parameter", to=("position",), key=f"fk_{table}_parameter"
        )
    _list(
        element,
        "term",
        *_node_key(),
        _place("term", "from 0"),
        _optional("parameter", Integer, "the position of the owner's parameter"),
        _optional("object_id", comment="the constant"),
        _optional("quantifier", Integer, "the position of the node that binds the variable"),
        _optional("variable", Integer, "which of the quantifier's variables it is"),
        _optional("child", Integer, "the position of the function node whose value it is"),
        _within(element, "node", *_NODE, key=f"fk_{table}_node"),
        of_parameters,
        reference("object_id", "object"),
        _within(element, "variable", *bound, to=(*_NODE, "variable"), key=f"fk_{table}_variable"),
        _within(element, "node", "section", "child", to=_NODE, key=f"fk_{table}_child"),
        CheckConstraint(f"{_ONE_OF_FOUR} = 1", name="one_of_four"),
        CheckConstraint("(quantifier IS NULL) = (variable IS NULL)", name="bound"),
        Index(f"ix_{table}_object", "kb_id", "object_id"),
    )


_identity("type")
_version(
    "type",
    _optional("parent_id", comment="the type above it; NULL: right under the root"),
    _text(),
    reference("parent_id", "type"),
)
_type_list("type", "parent", "parent_id")

_identity("object", lookup_index("object", "name"))
_version(
    "object",
    _column("type_id"),
    _text(),
    _column("is_constant", Boolean, "declared in the domain, not in the problem", false()),
    reference("type_id", "type"),
)
_type_list("object", "type")

_identity("predicate", lookup_index("predicate", "name"))
_version("predicate", _text())
_parameters("predicate")

_identity("function", lookup_index("function", "name"))
_version("function", _text())
_parameters("function")
# The types of its values: none for numbers.
_type_list("function", "type", first=0)

_identity("action")
_version(
    "action",
    _text(),
    _column("kind", String(16), "action, durative-action, process or event", "action"),
)
_parameters("action")
_trees(
    "action",
    True,
    CheckConstraint("section IN ('duration', 'condition', 'effect')", name="section"),
)

# The name of a formula is the SHA-256 of its section and its text, in hexadecimal.
_identity("formula")
_version(
    "formula",
    _column("section", String(24), "the part of the domain or the problem that it stands in"),
    _text(),
    CheckConstraint(
        "section IN ('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', "
        "'metric')",
        name="section",
    ),
)
_trees("formula", False)

_identity("rule")
_version(
    "rule",
    _column("on_violation", String(16), "report; refuse: the transaction fails"),
    _text(),
    CheckConstraint("on_violation IN ('report', 'refuse')", name="on_violation"),
)
_trees("rule", False, CheckConstraint("section = 'constraint'", name="section"))

# The domain and the problem, one of each.
_identity("document", CheckConstraint("key IN ('domain', 'problem')", name="domain_or_problem"))
_version(
    "document",
    _column("title", ShortText, "the name in its define form"),
    _optional("domain", ShortText, "a problem's domain"),
    _text("all of it on one line"),
)
# The element at a position of a document: it is live elsewhere, or the position is empty.
_list(
    "document",
    "item",
    _key("section", String(24), "requirement, type, goal ..."),
    _place("position", "from 0"),
    _column("name", LongText, "the element's name; for a goal that is a ground atom, its text"),
    _within("document", "version"),
)
