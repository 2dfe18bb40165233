"""What involves an object: itself, and all that names it or is it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, func, literal_column, select

from ..sql.changes import STEPS, Change, ends_of, in_range, newest_of, paged
from ..sql.dialects.base import Session
from ..sql.query import Query, first_rows, in_rows, integer
from ..sql.rows import KB, PROPOSITION, VALUE, VERSION_COLUMNS, VersionColumns, table_of
from ..sql.tables import (
    TABLES,
    FunctionValueArgumentRow,
    PlanStepArgumentRow,
    PropositionArgumentRow,
)
from .revisions import LARGEST

# Versions of what an object is in that are looked at, to find the newest.
INVOLVED = 20_000
# Revisions that are searched for what an object is in, if that is more.
WINDOW = 20_000

_OBJECT = integer("object")
_ONE: Any = literal_column("1")
# Whose objects are in a table of their own, and the key that both tables share.
_NAMING: tuple[tuple[VersionColumns, Any, tuple[str, ...]], ...] = (
    (VERSION_COLUMNS[PROPOSITION], table_of(PropositionArgumentRow).c, ("proposition_id",)),
    (VERSION_COLUMNS[VALUE], table_of(FunctionValueArgumentRow).c, ("function_value_id",)),
    (VERSION_COLUMNS["action"], TABLES["action_term"].c, ("action_id", "since")),
    (VERSION_COLUMNS["formula"], TABLES["formula_term"].c, ("formula_id", "since")),
    (STEPS, table_of(PlanStepArgumentRow).c, ("plan_id", "position")),
)


def involving(
    object_: ColumnElement[int], most: int | None = None, by_revision: bool = False
) -> Iterator[tuple[VersionColumns, ColumnElement[bool]]]:
    """Yield which versions involve an object, table by table; no version is in two of them.

    Args:
        object_: the id of the object.
        most: look at the versions of so many elements of each kind; None for all.
        by_revision: the revisions are few: compare their versions with the object.
    """
    own = VERSION_COLUMNS["object"]
    yield own, own.owner == object_
    for columns, arguments, key in _NAMING:
        named = _is_named(columns, arguments, key, object_)
        if by_revision:
            yield columns, named
            continue
        ids = select(arguments[key[0]]).where(arguments.kb_id == KB, arguments.object_id == object_)
        if most is not None:
            # In the order of an index.
            ids = first_rows(ids.order_by(arguments[key[0]]), literal_column(str(most)))
        found = in_rows(columns.owner, ids, bounded=columns.version.since)
        yield columns, found if len(key) == 1 else found & named
    value, arguments, key = _NAMING[1]
    is_value = value.version.object_id == object_
    yield value, is_value & ~_is_named(value, arguments, key, object_)


def _is_named(
    columns: VersionColumns, arguments: Any, key: tuple[str, ...], object_: ColumnElement[int]
) -> ColumnElement[bool]:
    """Return whether a version names an object."""
    version = columns.version
    own = [arguments[part] == version[part] for part in key]
    # An expression has no index: an object may be in many versions, which have few arguments.
    is_object = arguments.object_id + literal_column("0") == object_
    found: Select[Any] = select(_ONE).where(arguments.kb_id == KB, *own, is_object)
    return found.correlate(version.kb_id.table).exists()


@cache
def _versions_of_object() -> Query:
    """Count the versions of what involves the object, up to a bound."""
    counts = []
    for columns, which in involving(_OBJECT, INVOLVED):
        some: Select[Any] = select(_ONE).where(columns.version.kb_id == KB, which)
        bounded = first_rows(some, literal_column(str(INVOLVED))).subquery()
        counts.append(select(func.count()).select_from(bounded).scalar_subquery())
    total: ColumnElement[Any] = counts[0]
    for count in counts[1:]:
        total = total + count
    return Query(select(total))


@cache
def _involving(is_recent: bool) -> Query:
    """Select the changes of what involves the object, newest first."""
    parts = []
    for columns, which in involving(_OBJECT, INVOLVED, by_revision=is_recent):
        for end in ends_of(columns):
            # An expression has no index: what is found by ids is not looked for by revision.
            # Nor is it read in the order of that index.
            number = end.revision if is_recent else end.revision + literal_column("0")
            parts.append(end.short_line(number, which, in_range(number)))
    return paged(parts)


class Involvement(NamedTuple):
    """A page of the changes of what involves an object, the newest first.

    Attributes:
        changes: each with its revision.
        before: the revision before which the next page goes on; None after the last.
        searched: the first revision that was searched, if it is not the first of all.
    """

    changes: list[tuple[int, Change]]
    before: int | None
    searched: int | None


def read_involvement(
    session: Session,
    kb_id: int,
    object_id: int,
    high: int,
    limit: int,
    low: int = 1,
    *,
    whole: bool = False,
) -> Involvement:
    """Read a page of what involves an object in a range of revisions, in two statements.

    A page ends with a revision. One that alone has more changes is cut, or read with one more
    statement if it is wanted whole.
    """
    own = {"kb": kb_id, "object": object_id}
    row = session.first(_versions_of_object(), **own)
    is_recent = row is not None and row[0] >= INVOLVED
    first = max(low, high - WINDOW + 1) if is_recent else low
    query = _involving(is_recent)
    changes = newest_of(session, query, limit + 1, **own, low=first, high=high)
    if len(changes) <= limit:
        rest = first if first > low else None
        return Involvement(changes, rest, rest)
    last = changes[limit][0]
    found = [one for one in changes if one[0] > last]
    if found:
        return Involvement(found, last + 1, None)
    if whole:
        changes = newest_of(session, query, LARGEST, **own, low=last, high=last)
    return Involvement(changes if whole else changes[:limit], last, None)
