"""The log: revisions with their changes, newest first, complete and by pages."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Text, bindparam, cast, or_, select, union

from .. import html
from ..arguments import storable_text
from ..dao.text import refuse_unknown_actor
from ..errors import ArchivedError
from ..moment_text import When
from ..sql.changes import (
    ASSERTED,
    BY_OWNER,
    BY_TEXT,
    COUNTED_CHANGES,
    RETRACTED,
    SEARCHED_ENDS,
    Change,
    count_each,
    few_changes,
    in_range,
    read_changes_page,
    stream_changes_of,
)
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Row, Session
from ..sql.dialects.containing import contains, is_in, pattern_of
from ..sql.places import place_text, read_place
from ..sql.query import Query, constant, first_rows, in_rows, integer
from ..sql.rows import KB
from ..sql.tables import RevisionRow
from ..store.snapshot import archive_of, read_position
from ..store.state import State
from ..store.store import Store
from .elements import Element, Sought, refuse_unknown_element, sought, take_objects
from .moments import Bounds, find_bounds, head_revision, last_before
from .revisions import (
    LARGEST,
    OLDEST_FIRST,
    WITH_ARCHIVED,
    LogEntry,
    Revision,
    at_most,
    collect,
    feed,
    make_revision,
    missing_revision,
    numbered_rows,
    refuse_archived_revision,
    refuse_unknown,
)
from .revisions import PAGE as LOG_PAGE
from .revisions import PAGE_CHANGES as LOG_CHANGES
from .versions import read_involvement, read_newest

# Versions of each identity of an element that are read at a time; each has two changes at most.
VERSION_PAGE = 250
# Revisions that a page searches for an actor, and for a text, at most.
SEARCHED_FOR_ACTOR, SEARCHED_FOR_TEXT = 100_000, 10_000
# Revisions of an element that a page filters by an actor or a text, at most.
SEARCHED_OF_ELEMENT = 500
# A revision with more changes has them on its own page.
LISTED = 60
# Changes that a page searches for a text, if they belong to several revisions.
SEARCHED_CHANGES = 20_000


_Changes = dict[int, tuple[Change, ...]]


class LogFilter(NamedTuple):
    """A filter of revisions; all conditions apply."""

    actor: str | None = None  # who wrote
    element: str | None = None  # the changed element, as for `log`
    # A text within the reason, the actor, the source as JSON, or a change, ignoring case.
    text: str | None = None


@dataclass(frozen=True)
class LogLine:
    """A revision in a page of the log.

    Attributes:
        revision: the revision.
        changes: its changes; empty if they are too many, or in an archive.
        total: the number of its changes, as far as they are counted.
        is_counted: whether `total` counts all.
        is_archived: whether a part of its changes is in an archive.
    """

    _json_ = "*revision", "changes", "total", "is_counted", "is_archived"

    revision: Revision
    changes: tuple[Change, ...]
    total: int
    is_counted: bool
    is_archived: bool


class LogPage(NamedTuple):
    """A page of the log.

    Attributes:
        head: the last revision.
        revisions: the revisions, newest first.
        before: the revision before which the next page continues; None after the last.
        searched: the first searched revision, if the page ended before it was full.
        archive: why the page ended at an archive, and where that is.
    """

    head: int
    revisions: list[LogLine]
    before: int | None = None
    searched: int | None = None
    archive: str | None = None


def _changed() -> Select[Any]:
    """Select the revisions of a range with a change that has the text."""
    ends = [
        select(end.revision.label("n")).where(
            end.source.version.kb_id == KB, in_range(end.revision), contains(end.source.text)
        )
        for end in SEARCHED_ENDS
    ]
    return select(union(*ends).subquery("changed").c.n)


def _end_of_search() -> Query:
    """Select the revisions at which the search reaches its bound, by table."""
    ends = []
    for end in SEARCHED_ENDS:
        number, within = end.revision, in_range(end.revision)
        newest = select(number.label("n")).where(end.source.version.kb_id == KB, within)
        last = newest.order_by(number.desc()).limit(constant(1)).offset(constant(SEARCHED_CHANGES))
        ends.append(select(last.subquery().c.n))
    return Query(union(*ends))


_END_OF_SEARCH = _end_of_search()


_NEWEST_FIRST = WITH_ARCHIVED.order_by(RevisionRow.number.desc())


@cache
def _newest(has_actor: bool, has_text: bool) -> Query:
    """Select the newest revisions of a range, and the archived revision."""
    number = RevisionRow.number
    rows = _NEWEST_FIRST.where(in_range(number))
    if has_actor:
        rows = rows.where(RevisionRow.actor == bindparam("actor"))
    if has_text:
        said: list[ColumnElement[bool]] = [
            contains(RevisionRow.actor),
            contains(RevisionRow.reason),
            contains(cast(RevisionRow.source, Text)),
            in_rows(number, _changed()),
        ]
        rows = rows.where(or_(*said))
    return Query(first_rows(rows, integer("size")))


def _find(
    session: Session, kb_id: int, asked: LogFilter, low: int, high: int, limit: int
) -> tuple[list[Row], int]:
    """Find the newest revisions of a range, and the first searched revision."""
    own: dict[str, Any] = {"kb": kb_id, "high": high, "size": limit, "actor": asked.actor}
    first = low
    if asked.text is not None:
        first = max(low, high - SEARCHED_FOR_TEXT + 1)
        ends = session.rows(_END_OF_SEARCH, kb=kb_id, low=first, high=high)
        first = min(high, max([first, *(row[0] + 1 for row in ends)]))
        own["pattern"] = pattern_of(session, asked.text)
    elif asked.actor is not None:
        first = max(low, high - SEARCHED_FOR_ACTOR + 1)
    query = _newest(asked.actor is not None, asked.text is not None)
    rows = session.rows(query, low=first, **own)
    if asked.actor is None and asked.text is None:
        _refuse_holes(session, rows, high, min(limit, high - low + 1))
    return rows, rows[-1][0] if len(rows) == limit else first


def revisions(state: State, after: When = 0, *, limit: int | None = None) -> list[Revision]:
    """Read revisions, oldest first.

    Args:
        after: begin after this revision, given as for `kb.at`.
        limit: the maximum number of revisions; None for all.

    Returns:
        The revisions, without their changes.

    Examples:
        >>> [(revision.number, revision.actor) for revision in kb.store.revisions()]
        [(1, 'perception')]
    """
    begin = min(last_before(state, after), LARGEST - 1)
    high = min(LARGEST if state.at is None else state.at, begin + at_most(limit))

    def work(session: Session, kb_id: int) -> list[Revision]:
        rows = session.rows(OLDEST_FIRST, kb=kb_id, low=begin + 1, high=high)
        return [make_revision(session, row) for row in rows]

    return html.Listing(state.store.query_known(work, [], in_snapshot=False), "revision")


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
        actor: only revisions of this actor.
        element: only revisions that changed this element, with only these changes: a DTO, a
            formula, PDDL text such as `(robot_at rb1 wp1)`, or a name. An object selects all that
            involves it, as for `history`.
        limit: the maximum number of revisions; None for all.

    Returns:
        The entries up to the present head, read in pages on demand.

    Raises:
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        ArchivedError: on reaching a revision that is partly in an archive.
        UnknownNameError: there never was such an actor, or a name in the text `element` never
            existed.
        InvalidKnowledgeError: `element` is not one of the above.

    Examples:
        >>> for entry in kb.log(element="(robot_at rb1 wp1)"):
        ...     print(entry.revision.number, entry.revision.actor, entry.changes[0].sign)
        1 perception +
    """
    return feed(state.store, partial(_read_log, state, since, until, actor, element), limit)


class _Page(NamedTuple):
    """Entries read together."""

    entries: list[LogEntry]
    end: int  # no revision from this one on is missing
    archived: int | None = None  # versions that ended up to this revision are in an archive
    size: int | None = None  # the size of the next page, if this one determines it


def _read_log(
    state: State,
    since: When | None,
    until: When | None,
    actor: str | None,
    element: Element | None,
    limit: int | None,
) -> Iterator[LogEntry]:
    """Read revisions with their changes, newest first, in pages."""
    storable_text(actor, "actor")
    wanted = None if element is None else sought(element)
    bounds = find_bounds(state, since, until)
    most = at_most(limit)
    entries = _entries(state.store, wanted, actor, bounds, most)
    return islice(_known(state.store, entries, actor, element), min(most, sys.maxsize))


def _known(
    store: Store, entries: Iterator[LogEntry], actor: str | None, element: object
) -> Iterator[LogEntry]:
    """Yield entries; if there are none, refuse an actor or an element that never existed."""
    entry = None
    for entry in entries:
        yield entry
    if entry is None:
        refuse_unknown_element(store, element)
        if actor is not None:
            refuse_unknown_actor(store, actor)


def _entries(
    store: Store, wanted: list[Sought] | None, actor: str | None, bounds: Bounds, limit: int
) -> Iterator[LogEntry]:
    """Yield entries page by page; refuse the first one that is partly in an archive."""
    low, high, redefined, _ = bounds
    size = most = min(LOG_PAGE, limit) if wanted is None or actor is None else LOG_PAGE
    archived = None
    while high >= low and size:
        own: dict[str, Any] = {"low": low, "high": high, "size": size}
        page: _Page | None = None
        empty = _Page([], low)
        if wanted is not None:
            of_element = partial(_page_of_element, wanted=wanted, actor=actor, **own)
            page = store.query_known(of_element, empty)
        elif actor is None:
            page = store.query(partial(_small_page, redefined=redefined, **own))
        if page is None:
            page = store.query_known(partial(_page, actor=actor, **own), empty)
        for entry in page.entries:
            if page.archived is not None and entry.revision.number <= page.archived:
                refuse_archived_revision(store, max(1, entry.revision.number - 1))
            yield entry
        high, size = page.end - 1, most if page.size is None else min(most, page.size)
        archived = page.archived
    if wanted is not None and high < low and (archived is None or low <= archived):
        # Archived changes have left no trace in the versions.
        refuse_archived_revision(store, max(1, low - 1))


def _small_page(
    session: Session, kb_id: int | None, low: int, high: int, size: int, redefined: int
) -> _Page | None:
    """Read a page in two statements; None if it has many changes."""
    if kb_id is None:
        return _Page([], low)
    low = max(low, high - size + 1)
    changes = few_changes(session, kb_id, low, high, low <= redefined)
    if changes is None:
        return None
    # Read after the changes: it includes each archive made before they were read.
    rows, _ = _find(session, kb_id, LogFilter(), low, high, size)
    return _made(session, rows, changes, low)


def _page(session: Session, kb_id: int, low: int, high: int, size: int, actor: str | None) -> _Page:
    """Read a page of one snapshot in two statements."""
    rows, end = _find(session, kb_id, LogFilter(actor), low, high, size)
    numbers = [row[0] for row in rows]
    if not numbers:
        return _Page([], end)
    changes, cut = collect(stream_changes_of(session, kb_id, numbers), LOG_CHANGES)
    end = end if cut is None else cut + 1
    page = _made(session, [row for row in rows if row[0] >= end], changes, end)
    return page._replace(size=2 * len(page.entries))


def _made(session: Session, rows: Sequence[Row], changes: _Changes, end: int) -> _Page:
    entries = [LogEntry(make_revision(session, row), changes.get(row[0], ())) for row in rows]
    return _Page(entries, end, rows[0][-1] if rows else None)


def _page_of_element(
    session: Session,
    kb_id: int,
    wanted: list[Sought],
    actor: str | None,
    low: int,
    high: int,
    size: int,
) -> _Page:
    """Read a page of the revisions that changed an element, by its versions."""
    found, end = _changes_of(session, kb_id, wanted, low, high)
    numbers = sorted(found, reverse=True)
    if not numbers:
        return _Page([], end)
    if len(numbers) > size:
        del numbers[size:]
        end = numbers[-1]
    rows = sorted(numbered_rows(session, kb_id, numbers), reverse=True, key=itemgetter(0))
    page = _made(session, rows, found, end)
    of_actor = [one for one in page.entries if actor in (None, one.revision.actor)]
    return page._replace(entries=of_actor)


def _changes_of(
    session: Session, kb_id: int, wanted: list[Sought], low: int, high: int
) -> tuple[_Changes, int]:
    """Read the changes of an element, and the revision from which they are complete."""
    names, others = take_objects(wanted)
    # With the definitions of objects: these include the ids of present ones.
    rows = read_newest(session, kb_id, wanted if names else others, high, VERSION_PAGE)
    changes, end = _of_versions(rows)
    end = max(low, end)
    for id_ in _ids_of(session, kb_id, names, rows):
        involved = read_involvement(session, kb_id, id_, high, 2 * VERSION_PAGE, low, whole=True)
        changes += involved.changes
        end = max(end, involved.before or low)
    by_revision: dict[int, set[Change]] = {}
    for number, change in changes:
        if end <= number <= high:
            by_revision.setdefault(number, set()).add(change)
    return {number: tuple(sorted(of_one)) for number, of_one in by_revision.items()}, end


def _ids_of(session: Session, kb_id: int, names: set[str], rows: Iterable[Row]) -> list[int]:
    """Return the ids of objects, from rows with their versions if these have all of them."""
    if not names:
        return []
    known = {owner for kind, *_, owner in rows if kind == "object"}
    if len(known) >= len(names):
        return [*known]
    found = find_identities(session, kb_id, "object", names)
    return [identity[0] for identity in found.values() if identity is not None]


def _of_versions(rows: Iterable[Row]) -> tuple[list[tuple[int, Change]], int]:
    """Return the changes of versions, and the revision from which they are complete."""
    changes, end = list[tuple[int, Change]](), 0
    read: Counter[tuple[str, int]] = Counter()
    for kind, text, since, until, owner in rows:
        changes.append((since, Change(ASSERTED, kind, text)))
        if until is not None:
            changes.append((until, Change(RETRACTED, kind, text)))
        read[kind, owner] += 1
        if read[kind, owner] == VERSION_PAGE:
            # Versions do not overlap: the one before may have ended where this one began.
            end = max(end, since + 1)
    return changes, end


def _refuse_holes(session: Session, rows: list[Row], high: int, count: int) -> None:
    """Refuse a page with missing revisions: with a damaged head, pages would never end."""
    numbers = {row[0] for row in rows}
    for number in range(high, high - count, -1):
        if number not in numbers:
            raise missing_revision(session, number)


def read_log_page(
    state: State,
    asked: LogFilter,
    since: When | None = None,
    until: When | None = None,
    before: int | None = None,
    limit: int = 50,
) -> LogPage:
    """Read a page of the log, newest first."""
    storable_text(asked.actor, "actor")
    bounds = find_bounds(state, since, until)
    low, high = bounds.low, bounds.high if before is None else min(bounds.high, before - 1)
    empty = LogPage(head_revision(state), [])
    if high < low:
        return empty
    if asked.element is not None:
        return _of_element(state, asked, low, high, limit, empty)

    def work(session: Session, kb_id: int) -> LogPage:
        rows, end = _find(session, kb_id, asked, low, high, limit)
        is_full = len(rows) == limit
        page = empty._replace(revisions=_lines(session, kb_id, rows))
        return page if end <= low else page._replace(before=end, searched=None if is_full else end)

    page = state.store.query_known(work, empty)
    if not page.revisions and page.searched is None and asked.actor is not None:
        refuse_unknown_actor(state.store, asked.actor)
    return page


def _lines(session: Session, kb_id: int, rows: Sequence[Row]) -> list[LogLine]:
    """Read the changes of some revisions and their number, in two statements."""
    if not rows:
        return []
    totals = count_each(session, kb_id, [row[0] for row in rows])
    few = [number for number, total in totals.items() if 0 < total <= LISTED]
    changes, _ = collect(stream_changes_of(session, kb_id, few), LARGEST)
    return [
        LogLine(
            make_revision(session, row),
            changes.get(row[0], ()),
            totals.get(row[0], 0),
            totals.get(row[0], 0) < COUNTED_CHANGES,
            row[0] <= row[-1],
        )
        for row in rows
    ]


def read_log_lines(state: State, numbers: Sequence[int]) -> list[LogLine]:
    """Read some revisions as lines of the log, newest first."""

    def work(session: Session, kb_id: int) -> list[LogLine]:
        rows = sorted(numbered_rows(session, kb_id, numbers), reverse=True, key=itemgetter(0))
        return _lines(session, kb_id, rows)

    return state.store.query_known(work, [])


def _of_element(
    state: State, asked: LogFilter, low: int, high: int, limit: int, page: LogPage
) -> LogPage:
    """Read the revisions that changed an element, by its versions."""
    is_open = asked.actor is None and asked.text is None
    most = limit + 1 if is_open else SEARCHED_OF_ELEMENT
    looked, last = 0, high
    try:
        for entry in log(state, low, until=high, element=asked.element, limit=most):
            if len(page.revisions) == limit:
                return page._replace(before=last)
            revision = entry.revision
            looked, last = looked + 1, revision.number
            said = [*revision.said(), *(change.text for change in entry.changes)]
            if asked.actor in (None, revision.actor) and any(
                is_in(asked.text, one) for one in said
            ):
                line = LogLine(revision, entry.changes, len(entry.changes), True, False)
                page.revisions.append(line)
    except ArchivedError as error:
        return page._replace(archive=str(error))
    return page if is_open or looked < most else page._replace(before=last, searched=last)


class RevisionPage(NamedTuple):
    """A revision with a page of its changes.

    Attributes:
        revision: the revision with the changes of the page.
        total: the number of its changes, as far as they are counted.
        is_counted: whether `total` counts all; pages have up to 50,000 of a kind.
        offset: the number of changes before the page.
        next: the value of `after` for the next page; None after the last.
        head: the last revision.
        archive: where a part of its changes is; None if all are here.
    """

    revision: LogEntry
    total: int
    is_counted: bool
    offset: int
    next: str | None
    head: int
    archive: str | None


def read_revision_page(
    state: State, number: int, after: str | None = None, limit: int = 200
) -> RevisionPage:
    """Read a revision with a page of its changes."""
    place = read_place(after, BY_OWNER, BY_TEXT)

    def work(session: Session, kb_id: int | None) -> RevisionPage:
        _, head, archived, *_ = read_position(session, kb_id)
        refuse_unknown(state.store.name, number, head)
        assert kb_id is not None
        (row,), _ = _find(session, kb_id, LogFilter(), number, number, 1)
        total = count_each(session, kb_id, [number])[number]
        changes, end = read_changes_page(session, kb_id, number, total, place, limit)
        entry = LogEntry(make_revision(session, row), tuple(change for _, change in changes))
        archive = archive_of(session, kb_id, number - 1) if number <= archived else None
        is_counted = total < COUNTED_CHANGES
        following = place_text(end)
        return RevisionPage(entry, total, is_counted, place.passed, following, head, archive)

    return state.store.query_in_snapshot(work)
