"""Which revisions changed an element, found by its versions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from heapq import merge
from itertools import groupby
from typing import Any

from sqlalchemy import BigInteger, ColumnElement, bindparam, select

from ..backends import Query, Row, Session, first_rows
from ..knowledge.changes import ASSERTED, RETRACTED, Change
from ..knowledge.loading import KB
from ..knowledge.sources import SOURCES, Source
from ..store import Store
from .elements import Sought
from .owners import Owner, find_owners

# So many versions of an element are read at a time.
VERSION_PAGE = 500

Changed = tuple[int, Change]


def _number(name: str) -> ColumnElement[int]:
    return bindparam(name, type_=BigInteger)


def _page(source: Source) -> Query:
    version = source.version
    columns: tuple[Any, ...] = (source.kind, source.text, version.since, version.until)
    rows = select(*columns).where(
        version.kb_id == KB, source.owner == _number("id"), version.since <= _number("high")
    )
    return Query(first_rows(rows.order_by(version.since.desc()), _number("size")))


_PAGES = {name: _page(source) for name, source in SOURCES.items()}


def changed_revisions(
    store: Store, wanted: list[Sought], low: int, high: int
) -> Iterator[tuple[int, tuple[Change, ...]]]:
    """Read which revisions changed an element, newest first, in constant memory.

    Args:
        store: the store.
        wanted: what the element is.
        low: the first revision.
        high: the last revision.

    Yields:
        The revision's number, and what it changed of the element.
    """

    def find(session: Session, kb_id: int | None) -> list[Owner]:
        return [] if kb_id is None else find_owners(session, kb_id, wanted)

    each = [_changes(store, owner, low, high) for owner in store.look(find)]
    together = merge(*each, key=lambda changed: -changed[0])
    for number, changes in groupby(together, key=lambda changed: changed[0]):
        yield number, tuple(sorted(change for _, change in changes))


def _changes(store: Store, owner: Owner, low: int, high: int) -> Iterator[Changed]:
    """Give the changes of one identity, newest first: its versions follow each other."""
    for kind, text, since, until in _versions(store, owner, high):
        if until is not None and low <= until <= high:
            yield until, Change(RETRACTED, kind, text)
        if (until or since) < low:
            return
        if since >= low:
            yield since, Change(ASSERTED, kind, text)


def _versions(store: Store, owner: Owner, high: int) -> Iterator[Row]:
    """Read the versions of one identity that began up to a revision, the last one first."""
    while True:
        page = store.look(partial(_read, owner=owner, high=high))
        yield from page
        if len(page) < VERSION_PAGE:
            return
        high = page[-1][2] - 1


def _read(session: Session, kb_id: int | None, owner: Owner, high: int) -> list[Row]:
    if kb_id is None:
        return []
    query = _PAGES[owner.source]
    return session.rows(query, kb=kb_id, id=owner.id, high=high, size=VERSION_PAGE)
