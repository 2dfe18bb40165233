"""Typed parameters, as predicates and actions have them."""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger, ForeignKeyConstraint, Index, Integer
from sqlalchemy.orm import Mapped, mapped_column

from .base import kb_column, since_column
from .types import ShortText


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
    """Give the constraints of an element's parameter table.

    Args:
        owner: the element's name.

    Returns:
        What `__table_args__` takes.
    """
    key = ["kb_id", f"{owner}_id", "since"]
    return (ForeignKeyConstraint(key, [f"{owner}_version.{column}" for column in key]),)


def parameter_type_args(owner: str) -> tuple[Any, ...]:
    """Give the constraints and indexes of an element's parameter type table.

    Args:
        owner: the element's name.

    Returns:
        What `__table_args__` takes.
    """
    key = ["kb_id", f"{owner}_id", "since", "position"]
    return (
        ForeignKeyConstraint(key, [f"{owner}_parameter.{column}" for column in key]),
        ForeignKeyConstraint(["kb_id", "type_id"], ["type.kb_id", "type.id"]),
        Index(f"ix_{owner}_parameter_type_type", "kb_id", "type_id"),
    )
