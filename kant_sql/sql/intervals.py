"""Finding what held at a revision, and the statements that open and close intervals.

The versions of propositions and of values are intervals of revisions, and may be millions. They are
found as in a relational interval tree (Kriegel, Poetke, Seidl: Managing Intervals Efficiently in
Object-Relational Databases, VLDB 2000). Each interval is kept at one revision within it, its fork:
the one that the highest power of two divides. A revision lies within intervals that are kept at few
others, one for each power of two; and what is kept at one revision held there all at once, so it is
never more than a state.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    Table,
    and_,
    bindparam,
    literal_column,
    select,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

from .dialects.base import Session
from .query import Query, in_list, in_rows
from .rows import KB, THEN, VersionTable, held_at, table_of
from .tables import (
    TABLES,
    Base,
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)

# Fork value of open versions.
HOLDS_NOW = 0
_BITS = 63


class Fork(FunctionElement[int]):
    """The fork of a version, of its `since` and its `until`."""

    type = BigInteger()
    inherit_cache = True
    name = "fork"


@compiles(Fork)
def _fork(element: Fork, compiler: Any, **options: Any) -> str:
    since, until = (compiler.process(clause, **options) for clause in element.clauses)
    before, last = f"({since} - 1)", f"({until} - 1)"
    # What differs between them, and all bits below the highest of it: neither dialect has a
    # logarithm that is exact.
    bits = f"SELECT ({before} | {last}) - ({before} & {last}) AS bits"
    for shift in (1, 2, 4, 8, 16, 32):
        bits = f"SELECT bits | (bits >> {shift}) AS bits FROM ({bits}) AS bits_{shift}"
    return f"(SELECT {last} - ({last} & (bits >> 1)) FROM ({bits}) AS bits)"


def _intervals(mapped: type[Base], owner: str) -> VersionTable:
    table = table_of(mapped)
    ended = {"fork": Fork(table.c.since, THEN)}
    return VersionTable(owner, table, closed=ended, opened={"fork": literal_column(str(HOLDS_NOW))})


def fork(since: int, until: int | None) -> int:
    """Return the fork under which a version is kept."""
    if until is None:
        return HOLDS_NOW
    highest = ((since - 1) ^ (until - 1)).bit_length() - 1
    return (until - 1) >> highest << highest


def held_then(version: Any) -> ColumnElement[bool]:
    """Return whether a version held at the revision `at`, found by its fork among the `forks`."""
    return and_(in_list(version.fork, "forks"), held_at(version))


# For queries of all predicates or functions: the index starts with that column.
def _all_ids(identity: Table) -> Select[Any]:
    return select(identity.c.id).where(identity.c.kb_id == KB)


ANY_PREDICATE = in_rows(PropositionVersionRow.predicate_id, _all_ids(TABLES["predicate"]))
ANY_FUNCTION = in_rows(FunctionValueVersionRow.function_id, _all_ids(TABLES["function"]))


def forks_at(at: int) -> list[int]:
    """Return where what held at a revision may be kept."""
    # For bits beyond those of `at` these are powers of two, up to the largest that a column holds.
    return [HOLDS_NOW, *sorted({(at >> bit | 1) << bit for bit in range(_BITS)})]


def then(session: Session, at: int) -> dict[str, Any]:
    """Return the parameters of a query about a past revision."""
    return {"at": at, "forks": session.list_value(forks_at(at))}


_SINCE = (
    select(PropositionVersionRow.since)
    .where(PropositionVersionRow.kb_id == PropositionRow.kb_id)
    .where(PropositionVersionRow.proposition_id == PropositionRow.id)
    .where(PropositionVersionRow.until.is_(None))
)
FIND = Query(
    select(
        PropositionRow.id, PropositionRow.arguments, PropositionRow.text, _SINCE.scalar_subquery()
    ).where(
        PropositionRow.kb_id == KB,
        PropositionRow.is_goal == bindparam("is_goal"),
        PropositionRow.predicate_id == bindparam("predicate"),
        in_list(PropositionRow.arguments, "arguments"),
    )
)
VERSIONS = _intervals(PropositionVersionRow, "proposition_id")
# One statement per id: given a list, SQLite scans all versions instead of sorting it.
OPEN = Query(
    select(PropositionRow.id, _SINCE.scalar_subquery()).where(
        PropositionRow.kb_id == KB, in_list(PropositionRow.id, "ids")
    )
)
CLOSED_HERE = Query(
    select(
        PropositionRow.id,
        select(PropositionVersionRow.since)
        .where(PropositionVersionRow.kb_id == PropositionRow.kb_id)
        .where(PropositionVersionRow.proposition_id == PropositionRow.id)
        .where(PropositionVersionRow.since < bindparam("at"))
        .where(PropositionVersionRow.until == bindparam("at"))
        .scalar_subquery(),
    ).where(PropositionRow.kb_id == KB, in_list(PropositionRow.id, "ids"))
)


VALUE_VERSIONS = _intervals(FunctionValueVersionRow, "function_value_id")


def _open_version(column: Any) -> Any:
    return (
        select(column)
        .where(FunctionValueVersionRow.kb_id == FunctionValueRow.kb_id)
        .where(FunctionValueVersionRow.function_value_id == FunctionValueRow.id)
        .where(FunctionValueVersionRow.until.is_(None))
        .scalar_subquery()
    )


# The text, which holds the value, and the object that is the value.
VALUE_COLUMNS = (
    _open_version(FunctionValueVersionRow.text),
    _open_version(FunctionValueVersionRow.object_id),
)
FIND_VALUE = Query(
    select(
        FunctionValueRow.id, FunctionValueRow.arguments, FunctionValueRow.text, *VALUE_COLUMNS
    ).where(
        FunctionValueRow.kb_id == KB,
        FunctionValueRow.function_id == bindparam("function"),
        in_list(FunctionValueRow.arguments, "arguments"),
    )
)
# One statement per id: given a list, SQLite scans all versions instead of sorting it.
OPEN_VALUE = Query(
    select(FunctionValueRow.id, *VALUE_COLUMNS).where(
        FunctionValueRow.kb_id == KB, in_list(FunctionValueRow.id, "ids")
    )
)
