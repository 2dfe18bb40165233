"""Finds the versions at a revision, and opens and closes intervals.

The versions of propositions and of values are intervals of revisions, and may be millions. They are
found as in a relational interval tree (Kriegel, Poetke, Seidl: Managing Intervals Efficiently in
Object-Relational Databases, VLDB 2000). Each interval is stored under one of its revisions, its
fork: the one divisible by the highest power of two. The intervals that contain a revision have few
forks, one for each power of two; and all intervals under one fork held at that revision, so they
are never more than a state.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    ScalarSelect,
    Select,
    Table,
    and_,
    bindparam,
    delete,
    or_,
    select,
)

from . import tables as t
from .dialects.base import Session
from .query import (
    Fork,
    IdsQuery,
    Insert,
    Query,
    Unsought,
    constant,
    each_of,
    first_rows,
    found_rows,
    in_list,
    in_rows,
)
from .rows import (
    KB,
    PROPOSITION,
    THEN,
    VALUE,
    VersionTable,
    held_at,
    looked_up,
    made_here,
    table_of,
)

# Fork value of open versions.
HOLDS_NOW = 0
_BITS = 63
# The maximum number of results of `forks_at`.
MOST_FORKS = _BITS + 1


def _intervals(mapped: type[t.Base], owner: str) -> VersionTable:
    table = table_of(mapped)
    ended = {"fork": Fork(table.c.since, THEN)}
    return VersionTable(owner, table, closed=ended, opened={"fork": constant(HOLDS_NOW)})


def fork(since: int, until: int | None) -> int:
    """Return the fork of a version."""
    if until is None:
        return HOLDS_NOW
    highest = ((since - 1) ^ (until - 1)).bit_length() - 1
    return (until - 1) >> highest << highest


def held_then(version: Any, at: ColumnElement[int] = THEN) -> ColumnElement[bool]:
    """Return whether a version held at a revision, found by its fork among the `forks`."""
    # Not two searches, for open versions and for those that ended later: both may be large.
    ends = or_(version.until.is_(None), Unsought(version.until) > at)
    return and_(in_list(version.fork, "forks"), Unsought(version.since) <= at, ends)


def now_and_then(
    version: Any, any_owner: ColumnElement[bool]
) -> tuple[tuple[bool, ColumnElement[bool]], ...]:
    """Return the conditions that a version holds now, and held then, keyed by "is past"."""
    return (False, version.until.is_(None)), (True, and_(any_owner, held_then(version)))


# For queries of all predicates or functions: the index starts with that column.
def _all_ids(identity: Table) -> Select[Any]:
    return select(identity.c.id).where(identity.c.kb_id == KB)


ANY_PREDICATE = in_rows(t.PropositionVersionRow.predicate_id, _all_ids(t.TABLES["predicate"]))
ANY_FUNCTION = in_rows(t.FunctionValueVersionRow.function_id, _all_ids(t.TABLES["function"]))
_ANY_OWNER = {PROPOSITION: ANY_PREDICATE, VALUE: ANY_FUNCTION}


def held_by(source: str, version: Any, at: ColumnElement[int] | None) -> ColumnElement[bool]:
    """Return whether a version of `VERSION_COLUMNS` held at a revision; None for now."""
    if at is None:
        holds: ColumnElement[bool] = version.until.is_(None)
        return holds
    if source not in _ANY_OWNER:
        return held_at(version, at)
    return and_(_ANY_OWNER[source], held_then(version, at))


def forks_at(at: int) -> list[int]:
    """Return the possible forks of versions at a revision."""
    # For bits beyond those of `at`, powers of two, up to the largest value of a column.
    return [HOLDS_NOW, *sorted({(at >> bit | 1) << bit for bit in range(_BITS)})]


def _second(moment: datetime) -> int:
    """Count the seconds since the year 1, from 1 on: no fork is below."""
    return (moment - datetime.min.replace(tzinfo=UTC)) // timedelta(seconds=1) + 1


def fork_of_period(valid_from: datetime, valid_until: datetime) -> int:
    """Return the fork of a saying about a period: that of its seconds."""
    last = valid_until - timedelta(microseconds=1)
    return fork(_second(valid_from), _second(last) + 1)


def forks_at_time(moment: datetime) -> list[int]:
    """Return the possible forks of sayings about a time."""
    last = _second(datetime.max.replace(tzinfo=UTC))
    return [fork for fork in forks_at(_second(moment)) if fork <= last]


def then(session: Session, at: int) -> dict[str, Any]:
    """Return the parameters of a query about a past revision."""
    return {"at": at, "forks": session.list_value(forks_at(at))}


_VERSION = table_of(t.PropositionVersionRow).c
_ID = each_of("ids", BigInteger)


def _open_since(proposition: ColumnElement[int]) -> ScalarSelect[int]:
    is_open = _VERSION.until.is_(None)
    return looked_up(_VERSION.since, _VERSION.proposition_id, proposition, is_open)


_ATOMS = found_rows(
    select(t.PropositionRow.id, t.PropositionRow.arguments, t.PropositionRow.text).where(
        t.PropositionRow.kb_id == KB,
        t.PropositionRow.is_goal == bindparam("is_goal"),
        t.PropositionRow.predicate_id == bindparam("predicate"),
    ),
    table_of(t.PropositionRow).c.arguments,
    "arguments",
).c
FIND = Query(select(*_ATOMS, _open_since(_ATOMS.id)))
VERSIONS = _intervals(t.PropositionVersionRow, "proposition_id")
OPEN = Query(select(_ID, _open_since(_ID)))
CLOSED_HERE = Query(
    select(
        _ID,
        select(_VERSION.since)
        .where(_VERSION.kb_id == KB, _VERSION.proposition_id == _ID)
        .where(_VERSION.since < THEN, _VERSION.until == THEN)
        .correlate_except(_VERSION.since.table)
        .scalar_subquery(),
    )
)


VALUE_VERSIONS = _intervals(t.FunctionValueVersionRow, "function_value_id")
_VALUE = table_of(t.FunctionValueVersionRow).c


def open_value(fluent: ColumnElement[int]) -> tuple[ScalarSelect[Any], ScalarSelect[Any]]:
    """Look up the value of a fluent: the text that contains it, and its object."""
    own, is_open = _VALUE.function_value_id, _VALUE.until.is_(None)
    return (
        looked_up(_VALUE.text, own, fluent, is_open),
        looked_up(_VALUE.object_id, own, fluent, is_open),
    )


_FLUENTS = found_rows(
    select(t.FunctionValueRow.id, t.FunctionValueRow.arguments, t.FunctionValueRow.text).where(
        t.FunctionValueRow.kb_id == KB, t.FunctionValueRow.function_id == bindparam("function")
    ),
    table_of(t.FunctionValueRow).c.arguments,
    "arguments",
).c
FIND_VALUE = Query(select(*_FLUENTS, *open_value(_FLUENTS.id)))
OPEN_VALUE = Query(select(_ID, *open_value(_ID)))


class SayingTable(VersionTable):
    """A table of sayings, whose rows never change.

    Attributes:
        names: the columns; the last ones have the content.
        new: inserts rows.
        last: reads the last earlier saying about each element of a list: its text, and its number
            as text.
    """

    def __init__(self, mapped: type[t.Base], owner: str, *columns: str) -> None:
        """Build the statements."""
        # Sayings never end, so no statement ends them.
        self.table = table = table_of(mapped)
        self.owner, self.children = table.c[owner], ()
        self.unmake = (IdsQuery(delete(table), self.owner, made_here),)
        own = ("kb_id", owner, "since", "valid_from", "valid_until", "fork", "text")
        self.names = (*own, *columns)
        self.new = Insert(table, *self.names)
        said = select(table.c.since).where(table.c.kb_id == KB, self.owner == _ID)
        before = said.where(table.c.since < THEN).order_by(table.c.since.desc())
        since = first_rows(before, 1).correlate_except(table).scalar_subquery()
        last = select(_ID.label("id"), since.label("since")).subquery("last").c
        read = ("text", "value") if "value" in table.c else ("text",)
        found = (
            looked_up(table.c[name], self.owner, last.id, table.c.since == last.since)
            for name in read
        )
        self.last = Query(select(last.id, *found))


FACT_SAYINGS = SayingTable(
    t.PropositionSayingRow,
    *("proposition_id", "predicate_id", "first_object_id", "second_object_id", "holds"),
)
VALUE_SAYINGS = SayingTable(
    t.FunctionValueSayingRow, *("function_value_id", "function_id", "value", "number", "object_id")
)
