"""What is different between two states."""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    bindparam,
    literal_column,
    or_,
    select,
    union_all,
)

from ..backends import Query, Session
from ..knowledge.changes import ASSERTED, RETRACTED, Change, unsortable
from ..knowledge.loading import KB
from ..knowledge.rows import KIND_TABLES
from ..knowledge.sources import SOURCES, Source
from ..store import Store
from ..tables import HeadRow
from ..view import refuse_archived
from .moments import When, states_at

_BEFORE: ColumnElement[int] = bindparam("before", type_=BigInteger)
_AFTER: ColumnElement[int] = bindparam("after", type_=BigInteger)
_FIRST: ColumnElement[int] = bindparam("first", type_=BigInteger)


def _came_and_went(source: Source) -> list[Select[Any]]:
    """Give the versions of one kind that hold at just one of two revisions."""
    version = source.version
    came = (
        version.since.between(_FIRST, _AFTER),
        or_(version.until.is_(None), version.until > _AFTER),
    )
    went = version.until.between(_FIRST, _AFTER), version.since <= _BEFORE
    columns: tuple[Any, ...] = source.kind, source.text
    return [
        select(literal_column(change), *columns).where(version.kb_id == KB, *conditions)
        for change, conditions in (("1", came), ("-1", went))
    ]


def _differences(*names: str) -> Query:
    # In the same statement: what was moved to an archive is not among the rest.
    none: ColumnElement[str] = literal_column("''")
    columns: tuple[Any, ...] = HeadRow.archived_revision, none, none
    archived = select(*columns).where(HeadRow.kb_id == KB)
    parts = [part for name in names for part in _came_and_went(SOURCES[name])]
    return Query(union_all(archived, *parts))


# Whether definitions may be different, too.
_DIFFERENCES = {
    True: _differences(*SOURCES),
    False: _differences(*(name for name in SOURCES if name not in KIND_TABLES)),
}


def diff(store: Store, a: When, b: When, upto: int | None = None) -> list[Change]:
    """Tell what knowledge is different between two states; `History.diff` says all of it.

    Args:
        store: the store.
        a: a revision's number, or an aware time.
        b: another.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The changes that lead from one to the other, sorted.
    """
    states, stand = states_at(store, (a, b), upto)
    before, after = sorted(states)
    came, went = (ASSERTED, RETRACTED) if before == states[0] else (RETRACTED, ASSERTED)

    def work(session: Session, kb_id: int | None) -> list[Change]:
        if kb_id is None or before == after:
            return []
        query = _DIFFERENCES[before < stand.redefined]
        bounds = {"before": before, "first": before + 1, "after": after}
        rows = session.rows(query, kb=kb_id, **bounds)
        net: dict[tuple[str, str], int] = {}
        for change, kind, text in rows:
            # What came and went is the same on both sides, in another version.
            net[kind, text] = net.get((kind, text), 0) + change
        refuse_archived(session, kb_id, before, net.pop(("", ""), 0))
        try:
            return sorted(Change(came if net[key] > 0 else went, *key) for key in net if net[key])
        except TypeError as error:
            raise unsortable(net, f"revisions {before} to {after}", error) from error

    return store.glance(work)
