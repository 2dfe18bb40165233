"""The log: revisions with what they changed, newest first."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from datetime import datetime
from functools import partial
from itertools import groupby, islice
from typing import Any, NamedTuple

from sqlalchemy import BigInteger, ColumnElement, bindparam, select

from ..arguments import optional_text
from ..backends import Query, Row, Session, first_rows, in_list
from ..dto.dto import Dto
from ..dto.formula import Node
from ..knowledge.changes import Change, few_changes, in_range, stream_changes_of, stream_latest
from ..knowledge.loading import KB
from ..knowledge.revision import REVISIONS
from ..store import Store
from ..tables import HeadRow, RevisionRow
from .bounds import Bounds, find_bounds
from .element_changes import changed_revisions
from .elements import sought
from .pages import PAGE as LOG_PAGE
from .pages import PAGE_CHANGES as LOG_CHANGES
from .pages import missing_revision
from .revisions import (
    LARGEST,
    OLDEST_FIRST,
    LogEntry,
    Revision,
    at_most,
    check_after,
    make_revision,
    refuse_archived,
)

_Changes = dict[int, tuple[Change, ...]]

_ARCHIVED = select(HeadRow.archived_revision).where(HeadRow.kb_id == KB).scalar_subquery()
_LATEST = (
    REVISIONS.add_columns(_ARCHIVED)
    .where(in_range(RevisionRow.number))
    .order_by(RevisionRow.number.desc())
)
_NEWEST_FIRST = Query(_LATEST)
_SIZE: ColumnElement[int] = bindparam("size", type_=BigInteger)
_OF_ALL = Query(first_rows(_LATEST, _SIZE))
_OF_ACTOR = Query(first_rows(_LATEST.where(RevisionRow.actor == bindparam("actor")), _SIZE))
_NUMBERED = Query(
    REVISIONS.add_columns(_ARCHIVED)
    .where(in_list(RevisionRow.number, "numbers"))
    .order_by(RevisionRow.number.desc())
)


class _Page(NamedTuple):
    """What was read together.

    Attributes:
        entries: the entries.
        archived: what ended up to this revision was moved to an archive.
        next: the revision from which on the next page is to be read; 0 when there is none.
        size: of how many revisions it is to be, where that follows from this page; else None.
    """

    entries: list[LogEntry]
    archived: int = 0
    next: int = 0
    size: int | None = None


def read_revisions(
    store: Store, after: int = 0, limit: int | None = None, upto: int | None = None
) -> list[Revision]:
    """Read revisions, oldest first.

    Args:
        store: the store.
        after: only those with a larger number.
        limit: at most so many; None for all.
        upto: only those with no larger number; None for all.

    Returns:
        The revisions.
    """
    after = min(check_after(after), LARGEST - 1)
    high = min(LARGEST if upto is None else upto, after + at_most(limit))

    def work(session: Session, kb_id: int | None) -> list[Revision]:
        if kb_id is None:
            return []
        rows = session.rows(OLDEST_FIRST, kb=kb_id, low=after + 1, high=high)
        return [make_revision(session, row) for row in rows]

    return store.glance(work)


def read_log(
    store: Store,
    since: int | datetime | None = None,
    until: int | datetime | None = None,
    actor: str | None = None,
    element: Dto | Node | str | None = None,
    limit: int | None = None,
    upto: int | None = None,
) -> Iterator[LogEntry]:
    """Read revisions with their changes, newest first, in pages; `History.log` says all of it.

    Args:
        store: the store.
        since: the earliest.
        until: the latest.
        actor: only those of this actor.
        element: only what changed this element.
        limit: at most so many; None for all.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The entries.
    """
    optional_text(actor, "actor")
    wanted = None if element is None else sought(element)
    bounds = find_bounds(store, since, until, upto)
    most = at_most(limit)
    if wanted is None:
        entries = _complete(store, _pages(store, bounds, actor, most))
    else:
        changed = changed_revisions(store, wanted, bounds.low, bounds.high)
        entries = _complete(store, _pages_of(store, changed, actor, most), bounds.low)
    return islice(entries, min(most, sys.maxsize))


def _complete(store: Store, pages: Iterator[_Page], low: int | None = None) -> Iterator[LogEntry]:
    """Give entries, down to the first of which a part was moved to an archive.

    Where entries are found by versions, they may have been moved without a trace: down to `low`.
    """
    archived = None
    for page in pages:
        archived = page.archived
        if page.entries and page.entries[-1].revision.number > archived:
            yield from page.entries
            continue
        for entry in page.entries:
            if entry.revision.number <= archived:
                refuse_archived(store, max(1, entry.revision.number - 1))
            yield entry
    if low is not None and (archived is None or low <= archived):
        refuse_archived(store, max(1, low - 1))


def _pages(store: Store, bounds: Bounds, actor: str | None, limit: int) -> Iterator[_Page]:
    low, high, redefined = bounds
    size = most = min(LOG_PAGE, limit)
    while high >= low and size:
        first, page = max(low, high - size + 1), None
        if actor is None:
            page = store.glance(partial(_small_page, low=first, high=high, redefined=redefined))
        if page is None:
            page = store.look(partial(_page, low=low, high=high, size=size, actor=actor))
        yield page
        high, size = page.next, most if page.size is None else min(most, page.size)


def _small_page(
    session: Session, kb_id: int | None, low: int, high: int, redefined: int
) -> _Page | None:
    """Read a page with two statements, if it has few changes."""
    if kb_id is None:
        return _Page([])
    changes = few_changes(session, kb_id, low, high, low <= redefined)
    if changes is None:
        return None
    # After the changes: what was moved to an archive before they were read, is said here.
    rows = session.rows(_NEWEST_FIRST, kb=kb_id, low=low, high=high)
    _refuse_holes(session, rows, high, high - low + 1)
    entries = [LogEntry(make_revision(session, row), changes.get(row[0], ())) for row in rows]
    return _Page(entries, rows[0][-1] if rows else 0, low - 1)


def _page(
    session: Session, kb_id: int | None, low: int, high: int, size: int, actor: str | None
) -> _Page:
    """Read a page with three statements, of one state."""
    if kb_id is None:
        return _Page([])
    asked: dict[str, Any] = {"kb": kb_id, "low": low, "high": high, "size": size}
    if actor is None:
        rows = session.rows(_OF_ALL, **asked)
        _refuse_holes(session, rows, high, min(size, high - low + 1))
    else:
        rows = session.rows(_OF_ACTOR, actor=actor, **asked)
    numbers = [row[0] for row in rows]
    if not numbers:
        return _Page([])
    if actor is None:
        lines = stream_latest(session, kb_id, numbers[-1], numbers[0])
    else:
        lines = stream_changes_of(session, kb_id, numbers)
    changes, last = _collect(lines, numbers[-1])
    entries = [
        LogEntry(make_revision(session, row), changes.get(row[0], ()))
        for row in rows
        if row[0] >= last
    ]
    is_end = len(numbers) < size and last == numbers[-1]
    return _Page(entries, rows[0][-1], 0 if is_end else last - 1, 2 * len(entries))


def _refuse_holes(session: Session, rows: list[Row], high: int, count: int) -> None:
    """Refuse a page that lacks revisions: a head far beyond the last one has no end of them."""
    numbers = {row[0] for row in rows}
    for number in range(high, high - count, -1):
        if number not in numbers:
            raise missing_revision(session, number)


def _collect(lines: Iterator[tuple[int, Change]], last: int) -> tuple[_Changes, int]:
    """Keep changes down to a revision, or to one with which there are many; give that one, too."""
    changes: _Changes = {}
    total = 0
    for number, of_number in groupby(lines, key=lambda line: line[0]):
        if total >= LOG_CHANGES:
            return changes, number + 1
        changes[number] = tuple(change for _, change in of_number)
        total += len(changes[number])
    return changes, last


def _pages_of(
    store: Store,
    changed: Iterator[tuple[int, tuple[Change, ...]]],
    actor: str | None,
    limit: int,
) -> Iterator[_Page]:
    size = min(LOG_PAGE, limit) if actor is None else LOG_PAGE
    while changes := dict(islice(changed, size)):
        yield store.look(partial(_page_of, changes=changes, actor=actor))


def _page_of(session: Session, kb_id: int | None, changes: _Changes, actor: str | None) -> _Page:
    if kb_id is None:
        return _Page([])
    numbers = session.list_value([*changes])
    rows = session.rows(_NUMBERED, kb=kb_id, numbers=numbers)
    revisions: list[Revision] = [make_revision(session, row) for row in rows]
    entries = [
        LogEntry(revision, changes[revision.number])
        for revision in revisions
        if actor is None or revision.actor == actor
    ]
    return _Page(entries, max((row[-1] for row in rows), default=0))
