"""The log by pages of a bounded cost: a page of a rare actor or text says how far it searched."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import (
    ColumnElement,
    Select,
    Text,
    bindparam,
    cast,
    literal_column,
    or_,
    select,
    union,
)

from ..arguments import optional_text
from ..dao.known import refuse_unknown_actor
from ..errors import ArchivedError
from ..moment_text import When
from ..sql.changes import (
    COUNTED_CHANGES,
    REVISIONS,
    Change,
    ChangesPage,
    count_each,
    in_range,
    read_changes_page,
    stream_changes_of,
)
from ..sql.dialects.base import Session
from ..sql.dialects.containing import contains, is_in, pattern_of
from ..sql.query import Query, first_rows, in_list, in_rows, integer
from ..sql.rows import KB, PROPOSITION, VALUE, VERSION_COLUMNS
from ..sql.tables import HeadRow, RevisionRow
from ..store.snapshot import archive_of
from ..store.state import State
from .log import log
from .moments import find_bounds
from .revisions import Revision, collect, make_revision, missing_revision, refuse_unknown

# Revisions that a page searches for an actor, and for a text.
SEARCHED_FOR_ACTOR, SEARCHED_FOR_TEXT = 100_000, 10_000
# Revisions of an element that a page looks at, if it is to have those of an actor or a text.
SEARCHED_OF_ELEMENT = 500
# A revision with more changes has them on its own page.
LISTED = 60
# Changes in which a page looks for a text, if they are of several revisions.
SEARCHED_CHANGES = 20_000


class LogFilter(NamedTuple):
    """Which revisions are asked for; all conditions apply.

    Attributes:
        actor: who wrote.
        element: what was changed, as for `log`.
        text: what is in the reason, the actor, the source as JSON, or a change, in any case.
    """

    actor: str | None = None
    element: str | None = None
    text: str | None = None


@dataclass(frozen=True)
class LogLine:
    """A revision in a page of the log.

    Attributes:
        revision: the revision.
        changes: what it changed; nothing if that is too much, or in an archive.
        total: how much it changed, as far as it is counted.
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
        lines: the revisions, newest first.
        before: the revision before which the next page goes on; None after the last.
        searched: the first revision that was searched, where a page ended before it was full.
        archive: why a page ended at an archive, and where that is.
    """

    lines: list[LogLine]
    before: int | None
    searched: int | None = None
    archive: str | None = None


_REVISIONS = Query(
    REVISIONS.add_columns(
        select(HeadRow.archived_revision).where(HeadRow.kb_id == KB).scalar_subquery()
    )
    .where(in_list(RevisionRow.number, "numbers"))
    .order_by(RevisionRow.number.desc())
)


def _changed() -> Select[Any]:
    """Select the revisions of a range that changed what has the text."""
    ends = []
    for columns in VERSION_COLUMNS.values():
        version = columns.version
        for end in (version.since, version.until):
            within = in_range(end)
            ends.append(
                select(end.label("n")).where(version.kb_id == KB, within, contains(columns.text))
            )
    return select(union(*ends).subquery("changed").c.n)


def _end_of_search() -> Query:
    """Select the revisions in which the bound of what is searched is reached, by table."""
    ends = []
    for name in (PROPOSITION, VALUE):
        version = VERSION_COLUMNS[name].version
        for end in (version.since, version.until):
            newest = select(end.label("n")).where(version.kb_id == KB, in_range(end))
            bound: ColumnElement[int] = literal_column(str(SEARCHED_CHANGES))
            last = newest.order_by(end.desc()).limit(literal_column("1")).offset(bound)
            ends.append(select(last.subquery().c.n))
    return Query(union(*ends))


_END_OF_SEARCH = _end_of_search()


@cache
def _numbers(has_actor: bool, has_text: bool) -> Query:
    number = RevisionRow.number
    rows = select(number).where(RevisionRow.kb_id == KB, in_range(number))
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
    return Query(first_rows(rows.order_by(number.desc()), integer("size")))


def read_log_page(
    reader: State,
    asked: LogFilter,
    since: When | None = None,
    until: When | None = None,
    before: int | None = None,
    limit: int = 50,
) -> LogPage:
    """Read a page of the log, newest first.

    Args:
        reader: where.
        asked: which revisions.
        since: the first revision or the earliest time, inclusive.
        until: the last revision or the latest time, inclusive.
        before: only revisions before this one.
        limit: how many revisions a page has.

    Raises:
        UnknownRevisionError: a bound is in the future.
        UnknownNameError: instead of nothing, if there never was such an actor, or `element` has a
            name that never was.
    """
    optional_text(asked.actor, "actor")
    bounds = find_bounds(reader.store, since, until, reader.at)
    high = bounds.high if before is None else min(bounds.high, before - 1)
    if asked.element is not None:
        return _of_element(reader, asked, bounds.low, high, limit)
    if high < bounds.low:
        return LogPage([], None)

    def work(session: Session, kb_id: int | None) -> LogPage:
        if kb_id is None:
            return LogPage([], None)
        numbers, end = _find(session, kb_id, asked, bounds.low, high, limit)
        lines = read_lines(session, kb_id, numbers)
        is_end = end <= bounds.low
        is_short = len(numbers) < limit and not is_end
        return LogPage(lines, None if is_end else end, end if is_short else None)

    page = reader.store.query_in_snapshot(work)
    if not page.lines and page.searched is None and asked.actor is not None:
        refuse_unknown_actor(reader.store, asked.actor)
    return page


def _find(
    session: Session, kb_id: int, asked: LogFilter, low: int, high: int, limit: int
) -> tuple[list[int], int]:
    """Find the newest revisions of a range, and the first revision that was looked at."""
    actor, text, parameters = asked.actor, asked.text, dict[str, Any]()
    if actor is None and text is None:
        first = max(low, high - limit + 1)
        return list(range(high, first - 1, -1)), first
    window = SEARCHED_FOR_ACTOR if text is None else SEARCHED_FOR_TEXT
    first = max(low, high - window + 1)
    if text is not None:
        parameters["pattern"] = pattern_of(session, text)
        ends = session.rows(_END_OF_SEARCH, kb=kb_id, low=first, high=high)
        first = min(high, max([first, *(row[0] + 1 for row in ends)]))
    parameters |= {"kb": kb_id, "low": first, "high": high, "size": limit, "actor": actor}
    rows = session.rows(_numbers(actor is not None, text is not None), **parameters)
    numbers = [row[0] for row in rows]
    return numbers, numbers[-1] if len(numbers) == limit else first


def read_lines(session: Session, kb_id: int, numbers: list[int]) -> list[LogLine]:
    """Read some revisions, newest first, in three statements."""
    if not numbers:
        return []
    rows = session.rows(_REVISIONS, kb=kb_id, numbers=session.list_value(numbers))
    totals = count_each(session, kb_id, numbers)
    few = [number for number in numbers if 0 < totals.get(number, 0) <= LISTED]
    changes, _ = collect(stream_changes_of(session, kb_id, few), LISTED * len(numbers) + 1)
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


def _of_element(reader: State, asked: LogFilter, low: int, high: int, limit: int) -> LogPage:
    """Read the revisions that changed an element, by its versions."""
    if high < low:
        return LogPage([], None)
    is_open = asked.actor is None and asked.text is None
    most = limit + 1 if is_open else SEARCHED_OF_ELEMENT
    lines: list[LogLine] = []
    looked, last = 0, high
    try:
        for entry in log(reader, low, until=high, element=asked.element, limit=most):
            revision = entry.revision
            if len(lines) == limit:
                return LogPage(lines, last)
            looked, last = looked + 1, revision.number
            said = [revision.actor or "", revision.reason or "", revision.source_text or ""]
            said += [change.text for change in entry.changes]
            if asked.actor in (None, revision.actor) and any(
                is_in(asked.text, one) for one in said
            ):
                lines.append(LogLine(revision, entry.changes, len(entry.changes), True, False))
    except ArchivedError as error:
        return LogPage(lines, None, archive=str(error))
    return LogPage(lines, last, last) if looked == most and not is_open else LogPage(lines, None)


class RevisionExcerpt(NamedTuple):
    """A revision with a page of its changes.

    Attributes:
        line: the revision.
        page: the page of its changes.
        head: the last revision.
        archive: where a part of its changes is; None if they are all here.
    """

    line: LogLine
    page: ChangesPage
    head: int
    archive: str | None


_HEAD = Query(select(HeadRow.revision, HeadRow.archived_revision).where(HeadRow.kb_id == KB))


def read_revision_page(
    reader: State, number: int, offset: int = 0, limit: int = 200
) -> RevisionExcerpt:
    """Read a revision with a page of its changes.

    Raises:
        UnknownRevisionError: there is no such revision yet.
    """

    def work(session: Session, kb_id: int | None) -> RevisionExcerpt:
        row = None if kb_id is None else session.first(_HEAD, kb=kb_id)
        head, archived = row or (0, 0)
        refuse_unknown(reader.store.name, number, head)
        assert kb_id is not None
        lines = read_lines(session, kb_id, [number])
        if not lines:
            raise missing_revision(session, number)
        (line,) = lines
        page = read_changes_page(session, kb_id, number, line.total, offset, limit)
        archive = archive_of(session, kb_id, number - 1) if number <= archived else None
        return RevisionExcerpt(line, page, head, archive)

    return reader.store.query_in_snapshot(work)
