"""Revisions: who wrote, when and why, and what changed."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Text, and_, bindparam, cast, literal_column, select

from ..backends import Query, Row, Session, first_rows, in_list
from ..errors import UnknownRevisionError
from ..knowledge.changes import Change
from ..knowledge.loading import KB
from ..store import Store
from ..tables import HeadRow, RevisionPlanStepRow, RevisionRow
from ..view import refuse_archived as refuse_archived_state

LARGEST = 2**63 - 1
# What is earlier in another zone cannot be said in UTC.
FIRST_MOMENT = datetime.min.replace(tzinfo=UTC)
LARGEST_EXACT = 2**53 - 1

REVISIONS = (
    select(
        RevisionRow.number,
        RevisionRow.committed_at,
        RevisionRow.actor,
        RevisionRow.reason,
        # As text: what a driver makes of a JSON string looks like JSON, and is none.
        cast(RevisionRow.source, Text),
        RevisionRow.hash,
        RevisionRow.observed_at,
        RevisionPlanStepRow.plan_id,
        RevisionPlanStepRow.position,
    )
    .outerjoin(
        RevisionPlanStepRow,
        and_(
            RevisionPlanStepRow.kb_id == RevisionRow.kb_id,
            RevisionPlanStepRow.number == RevisionRow.number,
        ),
    )
    .where(RevisionRow.kb_id == KB)
)
_RANGE = REVISIONS.where(RevisionRow.number.between(bindparam("low"), bindparam("high")))
OLDEST_FIRST = Query(_RANGE.order_by(RevisionRow.number))
NEWEST_FIRST = Query(_RANGE.order_by(RevisionRow.number.desc()))
_NUMBERED = Query(REVISIONS.where(in_list(RevisionRow.number, "numbers")))
_HEAD = Query(
    select(HeadRow.revision, HeadRow.committed_at, HeadRow.archived_revision).where(
        HeadRow.kb_id == KB
    )
)
# By the index of times: the largest number would be looked for from the head on.
_AT_TIME = Query(
    first_rows(
        select(RevisionRow.number)
        .where(RevisionRow.kb_id == KB, RevisionRow.committed_at <= bindparam("moment"))
        .order_by(RevisionRow.committed_at.desc(), RevisionRow.number.desc()),
        literal_column("1"),
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
        observed_at: when what it says was sensed, in UTC; None when that was not said.
        plan_step: the step of a plan that was running: the plan's id and the step's position.
    """

    number: int
    committed_at: datetime
    actor: str | None
    reason: str | None
    source: object | None
    hash: str
    observed_at: datetime | None = None
    plan_step: tuple[int, int] | None = None


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


def revision_at(store: Store, when: int | datetime, upto: int | None = None) -> int:
    """Find the revision that held at a time, or check a revision's number.

    Args:
        store: the store.
        when: a revision's number, or an aware time.
        upto: the revision that a view of the past looks at, which knows no later one; None for
            the head.

    Returns:
        The number; 0 before the first revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to it yet, or the time has no zone.
    """
    if isinstance(when, datetime):
        found = _revision_at_time(store, when)
        return found if upto is None else min(found, upto)
    if upto is None:
        return _revision_of_number(store, when, False)
    _check_number(store, when, upto)
    return when


def _revision_of_number(store: Store, when: int, as_state: bool) -> int:
    """Check a revision's number, with one statement, and whether its state is in this store."""

    def work(session: Session, kb_id: int | None) -> int:
        row = None if kb_id is None else session.first(_HEAD, kb=kb_id)
        _check_number(store, when, 0 if row is None else row[0])
        if row is not None and kb_id is not None and as_state:
            refuse_archived_state(session, kb_id, when, row[2])
        return when

    transaction = store.current()
    if transaction is not None:
        # What it has made itself is no revision yet, in memory neither.
        _check_number(store, when, transaction.head.revision)
    return store.look(work)


def _check_number(store: Store, when: int, head: int) -> None:
    if isinstance(when, bool) or not isinstance(when, int):
        raise UnknownRevisionError(f"{when!r} is neither a revision's number nor a time")
    refuse_unknown(store.name, when, head)


def refuse_unknown(name: str, number: int, head: int) -> None:
    """Refuse a revision that a knowledge base has not come to.

    Args:
        name: the knowledge base's name.
        number: the revision; 0 is before the first.
        head: the last revision.

    Raises:
        UnknownRevisionError: there is none of that number.
    """
    if not 0 <= number <= head:
        raise UnknownRevisionError(
            f"knowledge base {name!r} has no revision {number}: it is at {head}"
        )


def state_at(store: Store, when: int | datetime, upto: int | None = None) -> int:
    """Find the revision that held at a time, and make sure that its state is in this store.

    Args:
        store: the store.
        when: a revision's number, or an aware time.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The number; 0 before the first revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to it yet, or the time has no zone.
        ArchivedError: a part of that state was moved to an archive.
    """
    if not isinstance(when, datetime) and upto is None:
        return _revision_of_number(store, when, True)
    revision = revision_at(store, when, upto)
    refuse_archived(store, revision)
    return revision


def refuse_archived(store: Store, revision: int) -> None:
    """Refuse to read a state of which a part was moved elsewhere.

    Args:
        store: the store.
        revision: the state's revision.

    Raises:
        ArchivedError: a part of it was moved to an archive.
    """

    def work(session: Session, kb_id: int | None) -> None:
        head = None if kb_id is None else session.first(_HEAD, kb=kb_id)
        if kb_id is not None and head is not None:
            refuse_archived_state(session, kb_id, revision, head[2])

    store.look(work)


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
        return 0 if row is None else int(row[0])

    return store.look(work)


def _last_time(session: Session, kb_id: int | None) -> datetime:
    row = None if kb_id is None else session.first(_HEAD, kb=kb_id)
    return FIRST_MOMENT if row is None or row[1] is None else session.to_time(row[1])


def read_numbered(session: Session, kb_id: int, numbers: Collection[int]) -> dict[int, Revision]:
    """Read revisions by their numbers, in one statement.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        numbers: their numbers.

    Returns:
        The revisions that there are, by number.
    """
    if not numbers:
        return {}
    rows = session.rows(_NUMBERED, kb=kb_id, numbers=session.list_value([*numbers]))
    return {row[0]: make_revision(session, row) for row in rows}


def _number(text: str) -> int | float:
    """Read a number that is written without a point: beyond these, RFC 8785 writes floats so."""
    number = int(text)
    return number if abs(number) <= LARGEST_EXACT else float(text)


def make_revision(session: Session, row: Row) -> Revision:
    """Make a revision of a row of `OLDEST_FIRST` or `NEWEST_FIRST`.

    Args:
        session: the session that the row is from.
        row: the row.

    Returns:
        The revision.
    """
    number, committed_at, actor, reason, source, digest, seen, plan_id, position = row
    value: Any = None if source is None else json.loads(source, parse_int=_number)
    observed_at = None if seen is None else session.to_time(seen)
    step = None if plan_id is None else (plan_id, position)
    moment = session.to_time(committed_at)
    return Revision(number, moment, actor, reason, value, digest, observed_at, step)
