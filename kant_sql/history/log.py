"""The log: revisions with their changes, newest first; that of an element, by its versions."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from heapq import merge
from itertools import groupby, islice
from typing import Any, NamedTuple

from sqlalchemy import bindparam, select

from .. import html
from ..arguments import optional_text
from ..dao.known import refuse_unknown_actor
from ..moment_text import When
from ..sql.changes import (
    ASSERTED,
    RETRACTED,
    REVISIONS,
    Change,
    few_changes,
    in_range,
    stream_changes_of,
)
from ..sql.dialects.base import Row, Session
from ..sql.query import Query, first_rows, in_list, integer
from ..sql.rows import KB, VERSION_COLUMNS, VersionColumns
from ..sql.tables import HeadRow, RevisionRow
from ..store.state import State
from ..store.store import Store
from .elements import Element, Named, Owner, Sought, find_owners, refuse_unknown_element, sought
from .involvement import Involvement, read_involvement
from .moments import Bounds, find_bounds
from .revisions import (
    LARGEST,
    OLDEST_FIRST,
    LogEntry,
    Revision,
    at_most,
    check_after,
    collect,
    feed,
    make_revision,
    missing_revision,
    refuse_archived_revision,
)
from .revisions import PAGE as LOG_PAGE
from .revisions import PAGE_CHANGES as LOG_CHANGES

# Versions of an element that are read at a time.
VERSION_PAGE = 500

Changed = tuple[int, Change]


def _page(source: VersionColumns) -> Query:
    version = source.version
    columns: tuple[Any, ...] = (source.kind, source.text, version.since, version.until)
    rows = select(*columns).where(
        version.kb_id == KB, source.owner == integer("id"), version.since <= integer("high")
    )
    return Query(first_rows(rows.order_by(version.since.desc()), integer("size")))


NEWEST_VERSIONS = {name: _page(source) for name, source in VERSION_COLUMNS.items()}


def changed_revisions(
    store: Store, wanted: list[Sought], low: int, high: int
) -> Iterator[tuple[int, tuple[Change, ...]]]:
    """Read the changes of an element by revision, newest first, in constant memory."""

    def find(session: Session, kb_id: int | None) -> list[Owner]:
        return [] if kb_id is None else find_owners(session, kb_id, wanted)

    is_involved = any(isinstance(one, Named) and one.is_involved for one in wanted)
    each = [
        _involving(store, owner.id, low, high)
        if is_involved and owner.source == "object"
        else _changes(store, owner, low, high)
        for owner in store.query_in_snapshot(find)
    ]
    together = merge(*each, key=lambda changed: -changed[0])
    for number, changes in groupby(together, key=lambda changed: changed[0]):
        yield number, tuple(sorted({change for _, change in changes}))


def _involving(store: Store, object_id: int, low: int, high: int) -> Iterator[Changed]:
    """Yield the changes of what involves an object, newest first."""
    size = VERSION_PAGE
    while high >= low:
        page = store.query_in_snapshot(
            partial(_read_involving, object_id=object_id, low=low, high=high, size=size)
        )
        if page.is_cut:
            size *= 2
            continue
        yield from page.changes
        high, size = (page.before or 0) - 1, VERSION_PAGE


def _read_involving(
    session: Session, kb_id: int | None, object_id: int, low: int, high: int, size: int
) -> Involvement:
    if kb_id is None:
        return Involvement([], None, None)
    return read_involvement(session, kb_id, object_id, high, size, low)


def _changes(store: Store, owner: Owner, low: int, high: int) -> Iterator[Changed]:
    """Yield the changes of one identity, newest first; its versions do not overlap."""
    for kind, text, since, until in _versions(store, owner, high):
        if until is not None and low <= until <= high:
            yield until, Change(RETRACTED, kind, text)
        if (until or since) < low:
            return
        if since >= low:
            yield since, Change(ASSERTED, kind, text)


def _versions(store: Store, owner: Owner, high: int) -> Iterator[Row]:
    """Read the versions of one identity that began up to a revision, newest first."""
    while True:
        page = store.query_in_snapshot(partial(_read, owner=owner, high=high))
        yield from page
        if len(page) < VERSION_PAGE:
            return
        high = page[-1][2] - 1


def _read(session: Session, kb_id: int | None, owner: Owner, high: int) -> list[Row]:
    if kb_id is None:
        return []
    query = NEWEST_VERSIONS[owner.source]
    return session.rows(query, kb=kb_id, id=owner.id, high=high, size=VERSION_PAGE)


_Changes = dict[int, tuple[Change, ...]]

_ARCHIVED = select(HeadRow.archived_revision).where(HeadRow.kb_id == KB).scalar_subquery()
_LATEST = (
    REVISIONS.add_columns(_ARCHIVED)
    .where(in_range(RevisionRow.number))
    .order_by(RevisionRow.number.desc())
)
_NEWEST_FIRST = Query(_LATEST)
_SIZE = integer("size")
_OF_ALL = Query(first_rows(_LATEST, _SIZE))
_OF_ACTOR = Query(first_rows(_LATEST.where(RevisionRow.actor == bindparam("actor")), _SIZE))
_NUMBERED = Query(
    REVISIONS.add_columns(_ARCHIVED)
    .where(in_list(RevisionRow.number, "numbers"))
    .order_by(RevisionRow.number.desc())
)


class _Page(NamedTuple):
    """Entries that were read together."""

    entries: list[LogEntry]
    archived: int = 0  # versions that ended up to this revision are in an archive
    next: int = 0  # the revision that the next page begins with; 0 after the last page
    size: int | None = None  # of the next page, where this page determines it


def revisions(state: State, after: int = 0, *, limit: int | None = None) -> list[Revision]:
    """Read revisions, oldest first.

    Args:
        after: return revisions with a larger number.
        limit: the maximum number of revisions; None for all.

    Returns:
        The revisions, without what they changed.

    Examples:
        >>> [(revision.number, revision.actor) for revision in kb.revisions()]
        [(1, 'perception')]
    """
    store, upto = state
    after = min(check_after(after), LARGEST - 1)
    high = min(LARGEST if upto is None else upto, after + at_most(limit))

    def work(session: Session, kb_id: int | None) -> list[Revision]:
        if kb_id is None:
            return []
        rows = session.rows(OLDEST_FIRST, kb=kb_id, low=after + 1, high=high)
        return [make_revision(session, row) for row in rows]

    return html.Listing(store.query(work), "revision")


def log(
    state: State,
    since: When | None = None,
    *,
    until: When | None = None,
    actor: str | None = None,
    element: Element | None = None,
    limit: int | None = None,
) -> Iterator[LogEntry]:
    """Read revisions and their changes, newest first, in constant memory.

    Args:
        since: the first revision, or the earliest time of commit; both inclusive.
        until: the last revision, or the latest time of commit; both inclusive.
        actor: return revisions of this actor.
        element: return revisions that changed this element, and their changes of it: a DTO, a
            formula, PDDL text such as `(robot_at rb1 wp1)`, or a name. Of an object, the
            changes of all that involves it, as for `history`.
        limit: the maximum number of revisions; None for all.

    Returns:
        The entries up to the present head, read in pages on demand.

    Raises:
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        ArchivedError: on reaching a revision that is partly in an archive.
        UnknownNameError: instead of no entry, if there never was such an actor, or `element` is
            a text with a name that never was.
        InvalidKnowledgeError: `element` is not one of the above.

    Examples:
        >>> for entry in kb.log(element="(robot_at rb1 wp1)"):
        ...     print(entry.revision.number, entry.revision.actor, entry.changes[0].sign)
        1 perception +
    """
    return feed(state.store, partial(_read_log, state, since, until, actor, element), limit)


def _read_log(
    state: State,
    since: When | None,
    until: When | None,
    actor: str | None,
    element: Element | None,
    limit: int | None,
) -> Iterator[LogEntry]:
    """Read revisions with their changes, newest first, in pages."""
    store, upto = state
    optional_text(actor, "actor")
    wanted = None if element is None else sought(element)
    bounds = find_bounds(store, since, until, upto)
    most = at_most(limit)
    if wanted is None:
        entries = _complete(store, _pages(store, bounds, actor, most))
    else:
        changed = changed_revisions(store, wanted, bounds.low, bounds.high)
        entries = _complete(store, _pages_of(store, changed, actor, most), bounds.low)
    return islice(_known(store, entries, actor, element), min(most, sys.maxsize))


def _known(
    store: Store, entries: Iterator[LogEntry], actor: str | None, element: object
) -> Iterator[LogEntry]:
    """Yield entries; without any, refuse an actor or an element that never was."""
    is_empty = True
    for entry in entries:
        is_empty = False
        yield entry
    if is_empty:
        refuse_unknown_element(store, element)
        if actor is not None:
            refuse_unknown_actor(store, actor)


def _complete(store: Store, pages: Iterator[_Page], low: int | None = None) -> Iterator[LogEntry]:
    """Yield entries, and refuse the first that is incomplete because of an archive.

    Entries found by versions may have been archived without a trace, down to `low`.
    """
    archived = None
    for page in pages:
        archived = page.archived
        if page.entries and page.entries[-1].revision.number > archived:
            yield from page.entries
            continue
        for entry in page.entries:
            if entry.revision.number <= archived:
                refuse_archived_revision(store, max(1, entry.revision.number - 1))
            yield entry
    if low is not None and (archived is None or low <= archived):
        refuse_archived_revision(store, max(1, low - 1))


def _pages(store: Store, bounds: Bounds, actor: str | None, limit: int) -> Iterator[_Page]:
    low, high, redefined = bounds
    size = most = min(LOG_PAGE, limit)
    while high >= low and size:
        first, page = max(low, high - size + 1), None
        if actor is None:
            page = store.query(partial(_small_page, low=first, high=high, redefined=redefined))
        if page is None:
            page = store.query_in_snapshot(
                partial(_log_page, low=low, high=high, size=size, actor=actor)
            )
        yield page
        high, size = page.next, most if page.size is None else min(most, page.size)


def _small_page(
    session: Session, kb_id: int | None, low: int, high: int, redefined: int
) -> _Page | None:
    """Read a page in two statements; None when it has many changes."""
    if kb_id is None:
        return _Page([])
    changes = few_changes(session, kb_id, low, high, low <= redefined)
    if changes is None:
        return None
    # Read after the changes: it includes each archive made before they were read.
    rows = session.rows(_NEWEST_FIRST, kb=kb_id, low=low, high=high)
    _refuse_holes(session, rows, high, high - low + 1)
    entries = [LogEntry(make_revision(session, row), changes.get(row[0], ())) for row in rows]
    return _Page(entries, rows[0][-1] if rows else 0, low - 1)


def _log_page(
    session: Session, kb_id: int | None, low: int, high: int, size: int, actor: str | None
) -> _Page:
    """Read a page of one snapshot in three statements."""
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
    changes, cut = collect(stream_changes_of(session, kb_id, numbers), LOG_CHANGES)
    last = numbers[-1] if cut is None else cut + 1
    entries = [
        LogEntry(make_revision(session, row), changes.get(row[0], ()))
        for row in rows
        if row[0] >= last
    ]
    is_end = len(numbers) < size and last == numbers[-1]
    return _Page(entries, rows[0][-1], 0 if is_end else last - 1, 2 * len(entries))


def _refuse_holes(session: Session, rows: list[Row], high: int, count: int) -> None:
    """Refuse a page that lacks revisions: with a damaged head, pages would never end."""
    numbers = {row[0] for row in rows}
    for number in range(high, high - count, -1):
        if number not in numbers:
            raise missing_revision(session, number)


def _pages_of(
    store: Store, changed: Iterator[tuple[int, tuple[Change, ...]]], actor: str | None, limit: int
) -> Iterator[_Page]:
    size = min(LOG_PAGE, limit) if actor is None else LOG_PAGE
    while changes := dict(islice(changed, size)):
        yield store.query_in_snapshot(partial(_page_of, changes=changes, actor=actor))


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
