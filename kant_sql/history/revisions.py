"""Revisions: who wrote, when and why, and what changed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from typing import Any

from sqlalchemy import Text, bindparam, cast, func, select

from ..backends import Query, Row, Session
from ..errors import UnknownRevisionError
from ..knowledge.changes import Change, stream_changes
from ..knowledge.loading import KB
from ..store import Store
from ..tables import HeadRow, RevisionRow

# So many revisions at a time are read together with their changes.
LOG_PAGE = 500
LARGEST = 2**63 - 1
# What is earlier in another zone cannot be said in UTC.
FIRST_MOMENT = datetime.min.replace(tzinfo=UTC)
LARGEST_EXACT = 2**53 - 1

_REVISIONS = (
    select(
        RevisionRow.number,
        RevisionRow.committed_at,
        RevisionRow.actor,
        RevisionRow.reason,
        # As text: what a driver makes of a JSON string looks like JSON, and is none.
        cast(RevisionRow.source, Text),
        RevisionRow.hash,
    )
    .where(RevisionRow.kb_id == KB)
    .where(RevisionRow.number.between(bindparam("low"), bindparam("high")))
)
_OLDEST_FIRST = Query(_REVISIONS.order_by(RevisionRow.number))
_NEWEST_FIRST = Query(_REVISIONS.order_by(RevisionRow.number.desc()))
_HEAD = Query(select(HeadRow.revision).where(HeadRow.kb_id == KB))
_LAST_TIME = Query(select(HeadRow.committed_at).where(HeadRow.kb_id == KB))
_AT_TIME = Query(
    select(func.max(RevisionRow.number)).where(
        RevisionRow.kb_id == KB, RevisionRow.committed_at <= bindparam("moment")
    )
)


@dataclass(frozen=True)
class Revision:
    """One committed transaction of a knowledge base.

    Attributes:
        number: 1, 2, 3 ... without gaps.
        committed_at: when, by the store's clock, in UTC; it never goes back.
        actor: the component that wrote.
        reason: why.
        source: what the caller knew, as JSON values.
        hash: the SHA-256 that chains it to the revision before.
    """

    number: int
    committed_at: datetime
    actor: str | None
    reason: str | None
    source: object | None
    hash: str


@dataclass(frozen=True)
class LogEntry:
    """A revision and what it changed.

    Attributes:
        revision: the revision.
        changes: a line for each element that was asserted or retracted.
    """

    revision: Revision
    changes: tuple[Change, ...]


def head_revision(store: Store) -> int:
    """Read the number of the last revision.

    Args:
        store: the store.

    Returns:
        The number; 0 before the first revision.
    """
    transaction = store.current()
    if transaction is not None:
        return transaction.head.revision

    def work(session: Session, kb_id: int | None) -> int:
        row = None if kb_id is None else session.first(_HEAD, kb=kb_id)
        return 0 if row is None else int(row[0])

    return store.look(work)


def revision_at(store: Store, when: int | datetime) -> int:
    """Find the revision that held at a time, or check a revision's number.

    Args:
        store: the store.
        when: a revision's number, or an aware time.

    Returns:
        The number; 0 before the first revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to it yet, or the time has no zone.
    """
    if isinstance(when, datetime):
        return _revision_at_time(store, when)
    if isinstance(when, bool) or not isinstance(when, int):
        raise UnknownRevisionError(f"{when!r} is neither a revision's number nor a time")
    head = head_revision(store)
    if not 0 <= when <= head:
        raise UnknownRevisionError(
            f"knowledge base {store.name!r} has no revision {when}: it is at {head}"
        )
    return when


def _revision_at_time(store: Store, when: datetime) -> int:
    if when.utcoffset() is None:
        raise UnknownRevisionError(f"the time {when.isoformat()} has no zone; give one, as UTC")

    def work(session: Session, kb_id: int | None) -> int:
        now = store.clock(session)
        # The clock may have gone back since the last revision.
        if when > now and when > _last_time(session, kb_id):
            raise UnknownRevisionError(
                f"the time {when.isoformat()} is in the future: the store's clock says "
                f"{now.isoformat()}"
            )
        if kb_id is None:
            return 0
        moment = session.from_time(max(when, FIRST_MOMENT))
        row = session.first(_AT_TIME, kb=kb_id, moment=moment)
        return 0 if row is None or row[0] is None else int(row[0])

    return store.look(work)


def _last_time(session: Session, kb_id: int | None) -> datetime:
    row = None if kb_id is None else session.first(_LAST_TIME, kb=kb_id)
    return FIRST_MOMENT if row is None or row[0] is None else session.to_time(row[0])


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
    high = LARGEST if upto is None else upto
    after = max(after, 0)
    if limit is not None:
        high = min(high, after + limit)

    def work(session: Session, kb_id: int | None) -> list[Revision]:
        if kb_id is None:
            return []
        rows = session.rows(_OLDEST_FIRST, kb=kb_id, low=after + 1, high=high)
        return [_revision(session, row) for row in rows]

    return store.look(work)


def read_log(store: Store, limit: int | None = None, upto: int | None = None) -> Iterator[LogEntry]:
    """Read revisions with their changes, newest first, in pages.

    Args:
        store: the store.
        limit: at most so many; None for all.
        upto: the newest; None for the head.

    Yields:
        The entries.
    """
    high = head_revision(store) if upto is None else upto
    lowest = 1 if limit is None else max(1, high - limit + 1)
    while high >= lowest:
        low = max(lowest, high - LOG_PAGE + 1)
        yield from store.look(partial(_page, low=low, high=high))
        high = low - 1


def _page(session: Session, kb_id: int | None, low: int, high: int) -> list[LogEntry]:
    if kb_id is None:
        return []
    changes = {
        number: tuple(change for _, change in group)
        for number, group in groupby(
            stream_changes(session, kb_id, low, high), key=lambda pair: pair[0]
        )
    }
    rows = session.rows(_NEWEST_FIRST, kb=kb_id, low=low, high=high)
    return [LogEntry(_revision(session, row), changes.get(row[0], ())) for row in rows]


def _number(text: str) -> int | float:
    """Read a number that is written without a point: beyond these, RFC 8785 writes floats so."""
    number = int(text)
    return number if abs(number) <= LARGEST_EXACT else float(text)


def _revision(session: Session, row: Row) -> Revision:
    number, committed_at, actor, reason, source, digest = row
    value: Any = None if source is None else json.loads(source, parse_int=_number)
    return Revision(number, session.to_time(committed_at), actor, reason, value, digest)
