"""Propositions (facts and goals), and fluents with their values."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import CheckConstraint, Double, ForeignKeyConstraint, Index, UniqueConstraint, false

from .base import (
    AT_COMMIT,
    LIVE,
    REVISION,
    Base,
    Interval,
    column,
    kb_column,
    key_column,
    lookup_index,
    optional,
    owner_column,
    partial_index,
    position_column,
    reference,
    version_args,
    where_both,
)


class _Atom:
    """A ground atom or a fluent, permanently interned."""

    kb_id = kb_column()
    id = owner_column()
    arguments = column(
        str,
        order=10,
        comment="the ids of its objects in order, by spaces: the key that interns it",
    )


class _Argument:
    """An argument of a ground atom or a fluent."""

    kb_id = kb_column()
    position = position_column()
    object_id = column(int)


def _argument_args(atom: str) -> tuple[Any, ...]:
    index = Index(f"ix_{atom}_argument_object", "kb_id", "object_id", f"{atom}_id")
    return reference(f"{atom}_id", atom), reference("object_id", "object"), index


def _interval_args(
    atom: str, owner: str, *argument: str, live: tuple[str, ...] = ()
) -> tuple[Any, ...]:
    """Return the constraints and indexes of a table of intervals."""
    table, id_ = f"{atom}_version", f"{atom}_id"
    ends = "since", "until", id_
    history = f"ix_{table}_history", "kb_id", f"{owner}_id", "fork", *argument, *ends
    return (
        *version_args(table, id_, live=live),
        reference(id_, atom),
        reference(f"{owner}_id", owner),
        Index(*history),
    )


# `until` makes an index cover reads of the present state.
def _now(table: str, *columns: str) -> Index:
    return partial_index(f"ix_{table}_now", "kb_id", *columns, "until", where=LIVE)


class PropositionRow(_Atom, Base):
    """A ground atom as a fact or as a goal."""

    __tablename__ = "proposition"
    __table_args__ = (
        reference("predicate_id", "predicate"),
        UniqueConstraint(
            "kb_id", "is_goal", "predicate_id", "arguments", name="uq_proposition_atom"
        ),
        lookup_index("proposition", "text"),
    )

    predicate_id = column(int)
    is_goal = column(bool)
    text = column(str, order=20, comment="canonical PDDL")


class PropositionArgumentRow(_Argument, Base):
    """An argument of a ground atom."""

    __tablename__ = "proposition_argument"
    __table_args__ = _argument_args("proposition")

    proposition_id = owner_column()


def _goal_index(name: str, *columns: str) -> Index:
    # SQLite uses a partial index only for queries with its exact condition: this is SQLAlchemy's
    # text of a boolean column.
    return Index(
        f"ix_proposition_version_{name}",
        "kb_id",
        *columns,
        info=where_both("is_goal = 1", "is_goal"),
    )


_FIRST, _SECOND = "first_object_id", "second_object_id"


class PropositionVersionRow(Interval, Base):
    """An interval in which a fact held, or a goal was active: one narrow row for each."""

    __tablename__ = "proposition_version"
    __table_args__ = (
        # Without statistics PostgreSQL rates all indexes that begin with `kb_id` as equally good,
        # and the smallest as the best: it would read all of 20,000 facts by this one, to find those
        # of a predicate or with an argument.
        *_interval_args("proposition", "predicate", _FIRST, live=("proposition_id", "kb_id")),
        # Past facts by the second argument; the fork comes first, so a writer finds the page in
        # memory: it closes versions under few recent forks.
        partial_index(
            "ix_proposition_version_history_second",
            *("kb_id", "predicate_id", "fork", _SECOND, "since", "until", "proposition_id"),
            where=f"{_SECOND} IS NOT NULL",
        ),
        # `is_goal` comes before the arguments: PostgreSQL 18 treats a column that a condition skips
        # as many searches.
        _now("proposition_version", "predicate_id", "is_goal", _FIRST, _SECOND, "proposition_id"),
        partial_index(
            "ix_proposition_version_second",
            *("kb_id", "predicate_id", "is_goal", _SECOND, _FIRST, "proposition_id", "until"),
            where=f"{LIVE} AND {_SECOND} IS NOT NULL",
        ),
        # Goals are few among many facts, and current goals are few among past ones.
        # `is_goal` makes the index covering: otherwise SQLite would read all present facts, by an
        # index that is covering.
        _goal_index("goal", "until", "since", "proposition_id", "is_goal"),
        _goal_index("goal_history", "fork", "since", "until", "proposition_id"),
        # Finds the latest goals without reading facts.
        _goal_index("goal_since", "since"),
    )

    proposition_id = owner_column()
    predicate_id = column(int)
    is_goal = column(bool, server_default=false())
    # Copies of the argument rows, which have the foreign keys: two more on each version would cost
    # two lookups a row, and two indexes for the referenced side.
    first_object_id = optional(int, order=20, comment="its first argument; NULL: it has none")
    second_object_id = optional(int, order=20, comment="its second argument; NULL: it has fewer")


class ConfirmationRow(Base):
    """A confirmation of a fact that held: it never changes the state."""

    __tablename__ = "confirmation"
    __has_rowid__ = False
    __table_args__ = (
        reference("proposition_id", "proposition"),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        Index("ix_confirmation_since", "kb_id", "since"),
    )

    kb_id = kb_column()
    proposition_id = owner_column()
    since = key_column(-80, "recorded in this revision")


class SayingColumns:
    """A saying about a past period, which overrides the versions there.

    Its `fork` is that of its seconds, see `sql/intervals.py`.
    """

    kb_id = kb_column()
    since = key_column(-80, "said in this revision")
    valid_from = column(datetime, order=-70, comment="UTC, where the period begins")
    valid_until = column(datetime, order=-69, comment="UTC, where it is over")
    fork = column(int, order=30, comment="of its seconds since the year 1, as of a version")
    text = column(str, order=40, comment="canonical PDDL, with the period")


def _saying_args(element: str, owner: str) -> tuple[Any, ...]:
    table = f"{element}_saying"
    return (
        reference(f"{element}_id", element),
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        CheckConstraint("valid_from < valid_until", name="period"),
        Index(f"ix_{table}_valid", "kb_id", f"{owner}_id", "fork", "valid_from"),
        Index(f"ix_{table}_since", "kb_id", "since"),
    )


class PropositionSayingRow(SayingColumns, Base):
    """A saying that a fact held, or did not hold, in a period."""

    __tablename__ = "proposition_saying"
    __has_rowid__ = False
    __table_args__ = (
        *_saying_args("proposition", "predicate"),
        *(
            partial_index(
                f"ix_proposition_saying_{name}",
                *("kb_id", "predicate_id", column, "fork", "valid_from"),
                where=f"{column} IS NOT NULL",
            )
            for name, column in (("first", _FIRST), ("second", _SECOND))
        ),
    )

    proposition_id = owner_column()
    predicate_id = column(int)
    holds = column(bool, order=10, comment="whether it held")
    first_object_id = optional(int, order=20, comment="its first argument; NULL: it has none")
    second_object_id = optional(int, order=20, comment="its second argument; NULL: it has fewer")


class FunctionValueRow(_Atom, Base):
    """A function applied to objects: a fluent."""

    __tablename__ = "function_value"
    __table_args__ = (
        reference("function_id", "function"),
        UniqueConstraint("kb_id", "function_id", "arguments", name="uq_function_value_fluent"),
        lookup_index("function_value", "text"),
    )

    function_id = column(int)
    text = column(str, order=20, comment="canonical PDDL, without the value")


class FunctionValueArgumentRow(_Argument, Base):
    """An argument of a fluent."""

    __tablename__ = "function_value_argument"
    __table_args__ = _argument_args("function_value")

    function_value_id = owner_column()


def _value_args(table: str) -> tuple[Any, ...]:
    return (
        reference("object_id", "object"),
        CheckConstraint("(value IS NULL) = (number IS NULL)", name="number_of_value"),
        # Numbers change often and are not in the index.
        partial_index(f"ix_{table}_object", "kb_id", "object_id", where="object_id IS NOT NULL"),
    )


class FunctionValueVersionRow(Interval, Base):
    """An interval in which a fluent had one value."""

    __tablename__ = "function_value_version"
    __table_args__ = (
        *_interval_args("function_value", "function"),
        _now("function_value_version", "function_id", "function_value_id"),
        CheckConstraint("(value IS NULL) <> (object_id IS NULL)", name="value_or_object"),
        *_value_args("function_value_version"),
    )

    function_value_id = owner_column()
    function_id = column(int)
    value = optional(str, comment="the number, as exact decimal text")
    number = optional(float, Double, comment="the number, as near as a double comes")
    object_id = optional(int, comment="the object that it is")
    text = column(str, comment="canonical PDDL, with the value")


class FunctionValueSayingRow(SayingColumns, Base):
    """A saying about the value of a fluent in a period; without number and object, it had none."""

    __tablename__ = "function_value_saying"
    __has_rowid__ = False
    __table_args__ = (
        *_saying_args("function_value", "function"),
        CheckConstraint("value IS NULL OR object_id IS NULL", name="value_or_object"),
        *_value_args("function_value_saying"),
    )

    function_value_id = owner_column()
    function_id = column(int)
    value = optional(str, comment="the number, as exact decimal text")
    number = optional(float, Double, comment="the number, as near as a double comes")
    object_id = optional(int, comment="the object that it was")
