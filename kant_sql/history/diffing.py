"""What is different between two states."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
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

from ..backends import Query, Row, Session
from ..knowledge.changes import ASSERTED, RETRACTED, Change
from ..knowledge.loading import KB
from ..knowledge.sources import SOURCES, Source
from ..store import Store

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
    columns: tuple[Any, ...] = source.kind.label("kind"), source.text.label("text")
    return [
        select(*columns, literal_column(change).label("change")).where(
            version.kb_id == KB, *conditions
        )
        for change, conditions in (("1", came), ("-1", went))
    ]


_DIFFERENCES = Query(
    union_all(*(part for source in SOURCES.values() for part in _came_and_went(source))).order_by(
        "kind", "text"
    )
)


def diff(store: Store, a: int, b: int) -> list[Change]:
    """Tell what knowledge is different between two states.

    Args:
        store: the store.
        a: a revision.
        b: another.

    Returns:
        The changes that lead from one to the other, sorted.
    """
    before, after = sorted((a, b))
    forwards = before == a

    def work(session: Session, kb_id: int | None) -> list[Change]:
        if kb_id is None or before == after:
            return []
        bounds = {"before": before, "first": before + 1, "after": after}
        return sorted(_differing(session.stream(_DIFFERENCES, kb=kb_id, **bounds), forwards))

    return store.look(work)


def _differing(rows: Iterable[Row], forwards: bool) -> Iterator[Change]:
    """Leave out what came and went: it is the same on both sides, in another version."""
    for (kind, text), same in groupby(rows, key=lambda row: (row[0], row[1])):
        change = sum(row[2] for row in same)
        if change:
            yield Change(ASSERTED if (change > 0) == forwards else RETRACTED, kind, text)
