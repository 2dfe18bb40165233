"""Typed parameters and expression trees as rows.

A tree is stored in preorder. A node says what it does (`and`, `over all`, `increase`, `predicate`
...), and for a leaf which predicate, function, number or variable it is; the terms of a node, and
the variables that a quantifier binds, are rows of their own.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger, CheckConstraint, ForeignKeyConstraint, Index, Integer, String
from sqlalchemy.orm import Mapped, MappedColumn, mapped_column

from .base import LongText, ShortText, kb_column, since_column


class Parameter:
    """A parameter of one version of its owner."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60, comment="from 0"
    )
    name: Mapped[str] = mapped_column(ShortText, comment="without its question mark")


class ParameterType:
    """A type that a parameter allows."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    position: Mapped[int] = mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-60
    )
    alternative: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-50,
        comment="from 0: several for either",
    )
    type_id: Mapped[int] = mapped_column(BigInteger)


def parameter_args(owner: str) -> tuple[Any, ...]:
    """Return the constraints of an element's parameter table."""
    key = ["kb_id", f"{owner}_id", "since"]
    return (ForeignKeyConstraint(key, [f"{owner}_version.{column}" for column in key]),)


def parameter_type_args(owner: str) -> tuple[Any, ...]:
    """Return the constraints and indexes of an element's parameter type table."""
    key = ["kb_id", f"{owner}_id", "since", "position"]
    return (
        ForeignKeyConstraint(key, [f"{owner}_parameter.{column}" for column in key]),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index(f"ix_{owner}_parameter_type_type", "kb_id", "type_id"),
    )


def _section_column() -> MappedColumn[str]:
    return mapped_column(
        String(24), primary_key=True, sort_order=-70, comment="the part of its owner"
    )


def _node_column() -> MappedColumn[int]:
    return mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-60,
        comment="from 0, in preorder",
    )


def _place_column(comment: str | None = None) -> MappedColumn[int]:
    return mapped_column(
        Integer, primary_key=True, autoincrement=False, sort_order=-50, comment=comment
    )


class ExpressionNode:
    """A node of an expression tree of one version of its owner, in preorder."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = _section_column()
    position: Mapped[int] = _node_column()
    parent: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the node above; NULL: the root"
    )
    operator: Mapped[str] = mapped_column(
        String(32), comment="and, not, over all, increase, predicate, function, number ..."
    )
    predicate_id: Mapped[int | None] = mapped_column(BigInteger)
    function_id: Mapped[int | None] = mapped_column(BigInteger)
    value: Mapped[str | None] = mapped_column(
        LongText, comment="a number as exact decimal text, a variable's or a preference's name"
    )


class ExpressionTerm:
    """A term of a node: a parameter of the owner, a bound variable, an object, or a fluent."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = _section_column()
    position: Mapped[int] = _node_column()
    term: Mapped[int] = _place_column("from 0")
    parameter: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the owner's parameter"
    )
    object_id: Mapped[int | None] = mapped_column(BigInteger, comment="the constant")
    quantifier: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the node that binds the variable"
    )
    variable: Mapped[int | None] = mapped_column(
        Integer, comment="which of the quantifier's variables it is"
    )
    child: Mapped[int | None] = mapped_column(
        Integer, comment="the position of the function node whose value it is"
    )


class ExpressionVariable:
    """A variable that a node binds."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = _section_column()
    position: Mapped[int] = _node_column()
    variable: Mapped[int] = _place_column("from 0")
    name: Mapped[str] = mapped_column(ShortText, comment="without its question mark")


class ExpressionVariableType:
    """A type that a bound variable allows."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    section: Mapped[str] = _section_column()
    position: Mapped[int] = _node_column()
    variable: Mapped[int] = _place_column()
    alternative: Mapped[int] = mapped_column(
        Integer,
        primary_key=True,
        autoincrement=False,
        sort_order=-40,
        comment="from 0: several for either",
    )
    type_id: Mapped[int] = mapped_column(BigInteger)


def _reference(columns: list[str], table: str, targets: list[str], name: str) -> Any:
    return ForeignKeyConstraint(columns, [f"{table}.{target}" for target in targets], name=name)


def _node_key(owner: str) -> list[str]:
    return ["kb_id", f"{owner}_id", "since", "section", "position"]


def node_args(owner: str) -> tuple[Any, ...]:
    """Return the constraints and indexes of an element's node table."""
    key, table = _node_key(owner), f"{owner}_node"
    return (
        _reference(key[:3], f"{owner}_version", key[:3], f"fk_{table}_version"),
        _reference([*key[:4], "parent"], table, key, f"fk_{table}_parent"),
        ForeignKeyConstraint(["kb_id", "predicate_id"], ["predicate.kb_id", "predicate.id"]),
        ForeignKeyConstraint(["kb_id", "function_id"], ["function.kb_id", "function.id"]),
        CheckConstraint("parent < position", name="preorder"),
        CheckConstraint("(parent IS NULL) = (position = 0)", name="one_root"),
        CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)", name="predicate_given"
        ),
        CheckConstraint(
            "(operator = 'function') = (function_id IS NOT NULL)", name="function_given"
        ),
        Index(f"ix_{table}_predicate", "kb_id", "predicate_id"),
        Index(f"ix_{table}_function", "kb_id", "function_id"),
    )


def term_args(owner: str, has_parameters: bool) -> tuple[Any, ...]:
    """Return the constraints and indexes of an element's term table."""
    key, table = _node_key(owner), f"{owner}_term"
    parameter = _reference(
        [*key[:3], "parameter"],
        f"{owner}_parameter",
        [*key[:3], "position"],
        f"fk_{table}_parameter",
    )
    return (
        _reference(key, f"{owner}_node", key, f"fk_{table}_node"),
        *([parameter] if has_parameters else []),
        ForeignKeyConstraint(["kb_id", "object_id"], ["object.kb_id", "object.id"]),
        _reference(
            [*key[:4], "quantifier", "variable"],
            f"{owner}_variable",
            [*key, "variable"],
            f"fk_{table}_variable",
        ),
        _reference([*key[:4], "child"], f"{owner}_node", key, f"fk_{table}_child"),
        CheckConstraint(
            "CASE WHEN parameter IS NULL THEN 0 ELSE 1 END"
            " + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END"
            " + CASE WHEN variable IS NULL THEN 0 ELSE 1 END"
            " + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1",
            name="one_of_four",
        ),
        CheckConstraint("(quantifier IS NULL) = (variable IS NULL)", name="bound"),
        *([] if has_parameters else [CheckConstraint("parameter IS NULL", name="no_parameter")]),
        Index(f"ix_{table}_object", "kb_id", "object_id"),
    )


def variable_args(owner: str) -> tuple[Any, ...]:
    """Return the constraints of an element's variable table."""
    key, table = _node_key(owner), f"{owner}_variable"
    return (_reference(key, f"{owner}_node", key, f"fk_{table}_node"),)


def variable_type_args(owner: str) -> tuple[Any, ...]:
    """Return the constraints and indexes of an element's variable type table."""
    key, table = [*_node_key(owner), "variable"], f"{owner}_variable_type"
    return (
        _reference(key, f"{owner}_variable", key, f"fk_{table}_variable"),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index(f"ix_{table}_type", "kb_id", "type_id"),
    )
