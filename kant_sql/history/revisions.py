"""Revisions: who wrote, when and why, and what changed."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, select

from ..arguments import shown, whole_number
from ..backends import Query, Row, Session, in_list
from ..errors import UNREADABLE, UnknownRevisionError, unreadable
from ..knowledge.changes import Change, in_range
from ..knowledge.loading import KB
from ..knowledge.revision import OWN_COLUMNS, REVISIONS, STEP_COLUMNS
from ..store import Store
from ..tables import HeadRow, RevisionPlanStepRow, RevisionRow
from ..view import refuse_archived as refuse_archived_state

LARGEST = 2**63 - 1
# What is earlier or later in another zone cannot be said in UTC.
FIRST_MOMENT = datetime.min.replace(tzinfo=UTC)
LAST_MOMENT = datetime.max.replace(tzinfo=UTC)
LARGEST_EXACT = 2**53 - 1
# A database may plan a list parameter as if it had ten values. For a shorter one it finds a plan of
# its own cheaper, so it makes one at each call, which takes longer than all the rest of it.
PLANNED_LIST = 11

OLDEST_FIRST = Query(REVISIONS.where(in_range(RevisionRow.number)).order_by(RevisionRow.number))
_NUMBERED = Query(REVISIONS.where(in_list(RevisionRow.number, "numbers")))
_ARCHIVED = Query(select(HeadRow.archived_revision).where(HeadRow.kb_id == KB))


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


def at_most(limit: int | None) -> int:
    """Tell how many entries a caller wants.

    Args:
        limit: at most so many; None for all.

    Returns:
        The number, which a column can hold.

    Raises:
        InvalidArgumentError: it is no number, or negative.
    """
    if limit is None:
        return LARGEST
    expected = "a whole number from 0 on, or None for all"
    return min(whole_number(limit, "limit", expected=expected), LARGEST)


def check_after(after: int) -> int:
    """Refuse what cannot be a revision's number.

    Args:
        after: the number; 0 is before the first revision.

    Returns:
        The number.

    Raises:
        UnknownRevisionError: it is none.
    """
    expected = "a revision's number, or 0 to begin with the first"
    return whole_number(after, "after", expected=expected, error=UnknownRevisionError)


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
            f"knowledge base {name!r} has no revision {shown(number)}: it is at {head}"
        )


def refuse_archived(store: Store, revision: int) -> None:
    """Refuse to read a state of which a part was moved elsewhere.

    Args:
        store: the store.
        revision: the state's revision.

    Raises:
        ArchivedError: a part of it was moved to an archive.
    """

    def work(session: Session, kb_id: int | None) -> None:
        head = None if kb_id is None else session.first(_ARCHIVED, kb=kb_id)
        if kb_id is not None and head is not None:
            refuse_archived_state(session, kb_id, revision, head[0])

    store.look(work)


def revision_of(number: ColumnElement[int]) -> tuple[ColumnElement[Any], ...]:
    """Give what `make_revision` reads, of the revision that a column of another query names.

    Args:
        number: the column; the query has few rows.

    Returns:
        The columns, each a subquery: before statistics, a join could be of all with all.
    """
    return tuple(
        select(column)
        .where(of.kb_id == KB, of.number == number)
        .correlate_except(of)
        .scalar_subquery()
        for of, columns in (
            (RevisionRow, OWN_COLUMNS),
            (RevisionPlanStepRow, STEP_COLUMNS),
        )
        for column in columns
    )


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
    listed = [*numbers]
    listed += listed[-1:] * (PLANNED_LIST - len(listed))
    rows = session.rows(_NUMBERED, kb=kb_id, numbers=session.list_value(listed))
    return {row[0]: make_revision(session, row) for row in rows}


def _number(text: str) -> int | float:
    """Read a number that is written without a point: beyond these, RFC 8785 writes floats so."""
    number = int(text)
    return number if abs(number) <= LARGEST_EXACT else float(text)


def make_revision(session: Session, row: Row) -> Revision:
    """Make a revision of a row that begins with the columns of `REVISIONS`.

    Args:
        session: the session that the row is from.
        row: the row.

    Returns:
        The revision.
    """
    try:
        return _make_revision(session, row)
    except UNREADABLE as error:
        raise unreadable("revision", f"revision {row[0]!r}", error) from error


def _make_revision(session: Session, row: Row) -> Revision:
    number, committed_at, actor, reason, source, digest, seen, plan_id, position, *_ = row
    value: Any = None if source is None else json.loads(source, parse_int=_number)
    observed_at = None if seen is None else session.to_time(seen)
    revision = object.__new__(Revision)
    # As its `__init__` would, which goes about each attribute of a frozen class by itself and takes
    # twice as long: a log has many.
    revision.__dict__.update(
        number=number,
        committed_at=session.to_time(committed_at),
        actor=actor,
        reason=reason,
        source=value,
        hash=digest,
        observed_at=observed_at,
        plan_step=None if plan_id is None else (plan_id, position),
    )
    return revision
