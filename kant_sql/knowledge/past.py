"""Finding what held at a past revision, in a time that no length of history adds to.

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
    FromClause,
    and_,
    bindparam,
    delete,
    literal_column,
    null,
    select,
    update,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

from ..backends import IdsQuery, Session, in_list, in_rows
from ..tables import (
    Base,
    FunctionRow,
    FunctionValueVersionRow,
    PredicateRow,
    PropositionVersionRow,
)
from .loading import KB, held_at
from .rows import table_of

# What still holds is kept here: its last revision is yet to come.
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


class IntervalTable:
    """A version table of intervals, and the changes that those of some ids can see.

    All of them take the parameter `kb`; `at` is the number of the revision that is being made.
    """

    def __init__(self, mapped: type[Base], id_column: str) -> None:
        self.table = table = table_of(mapped)
        columns, at = table.c, bindparam("at", type_=BigInteger)

        def is_open(version: FromClause) -> tuple[ColumnElement[bool], ...]:
            # By the index of what is open, which has one row of each id.
            return version.c.kb_id == KB, version.c.until.is_(None)

        def ends_here(version: FromClause) -> tuple[ColumnElement[bool], ...]:
            return version.c.kb_id == KB, version.c.until == at

        self.close = IdsQuery(
            update(table).values(until=at, fork=Fork(columns.since, at)),
            columns[id_column],
            is_open,
        )
        self.unmake = IdsQuery(delete(table), columns[id_column], is_open)
        self.reopen = IdsQuery(
            update(table).values(until=null(), fork=literal_column(str(HOLDS_NOW))),
            columns[id_column],
            ends_here,
        )


def fork(since: int, until: int | None) -> int:
    """Tell where a version is kept.

    Args:
        since: the revision that asserted it.
        until: the revision that retracted it; None while it holds.

    Returns:
        The revision; 0 while it holds.
    """
    if until is None:
        return HOLDS_NOW
    highest = ((since - 1) ^ (until - 1)).bit_length() - 1
    return (until - 1) >> highest << highest


def held_then(version: Any) -> ColumnElement[bool]:
    """Tell whether a version held at the revision `at`, found by its fork among the `forks`.

    Args:
        version: the version table of propositions or of values, or a class that is mapped to it.

    Returns:
        The condition; `then` gives its parameters. It goes with one on what the index begins with.
    """
    return and_(in_list(version.fork, "forks"), held_at(version))


# Where all predicates, or functions, are asked for: the index begins with them.
ANY_PREDICATE = in_rows(
    PropositionVersionRow.predicate_id, select(PredicateRow.id).where(PredicateRow.kb_id == KB)
)
ANY_FUNCTION = in_rows(
    FunctionValueVersionRow.function_id, select(FunctionRow.id).where(FunctionRow.kb_id == KB)
)


def forks_at(at: int) -> list[int]:
    """Tell where what held at a revision may be kept.

    Args:
        at: the revision.

    Returns:
        The forks, in order; they are 64 at most.
    """
    # For bits beyond those of `at` these are powers of two, up to the largest that a column holds.
    return [HOLDS_NOW, *sorted({(at >> bit | 1) << bit for bit in range(_BITS)})]


def then(session: Session, at: int) -> dict[str, Any]:
    """Give the parameters of a query about a past revision.

    Args:
        session: the session that the query is for.
        at: the revision.

    Returns:
        The parameters `at`, and `forks`: where what held then may be kept.
    """
    return {"at": at, "forks": session.list_value(forks_at(at))}
