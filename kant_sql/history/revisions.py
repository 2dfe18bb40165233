"""Revisions: who wrote, when and why; a page of them with their changes in two statements."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, select

from .. import html
from ..arguments import shown, whole_number
from ..errors import UNREADABLE, StoreIntegrityError, UnknownRevisionError, unreadable
from ..knowledge.canonical import read_source
from ..sql.changes import OWN_COLUMNS, REVISIONS, STEP_COLUMNS, Change, in_range, stream_changes
from ..sql.dialects.base import Row, Session
from ..sql.query import Query, found_rows, in_list
from ..sql.rows import KB, looked_up, table_of
from ..sql.tables import HeadRow, RevisionExecutionRow, RevisionRow
from ..store.snapshot import read_position, refuse_archived
from ..store.store import Store

LARGEST = 2**63 - 1
# The bounds of Python's datetime in UTC; another zone can express times beyond.
FIRST_MOMENT = datetime.min.replace(tzinfo=UTC)
LAST_MOMENT = datetime.max.replace(tzinfo=UTC)

OLDEST_FIRST = Query(REVISIONS.where(in_range(RevisionRow.number)).order_by(RevisionRow.number))
_ARCHIVED = select(HeadRow.archived_revision).where(HeadRow.kb_id == KB).scalar_subquery()
# With the archived revision, where a page of the log ends.
WITH_ARCHIVED = REVISIONS.add_columns(_ARCHIVED.label("archived"))
_NUMBERED = Query(WITH_ARCHIVED.where(in_list(RevisionRow.number, "numbers")))
_MANY_NUMBERED = Query(select(*found_rows(WITH_ARCHIVED, RevisionRow.number, "numbers").c))
# PostgreSQL plans a list parameter generically for ten values. For a shorter list a custom plan
# looks cheaper, so it plans each call, which takes longer than the query. For each item of a long
# list it may read all revisions.
SHORTEST_LIST, LONGEST_LIST = 11, 200


class ExecutionId(NamedTuple):
    """The running execution: a step of a recorded plan, or an act without a plan.

    Attributes:
        plan: the plan's id; None without a plan.
        position: the step's index in the plan, from 0; without a plan, the execution's id.
    """

    plan: int | None
    position: int

    def __str__(self) -> str:
        if self.plan is None:
            return f"execution {self.position}"
        return f"plan {self.plan}, step {self.position}"


@dataclass(frozen=True)
class Revision:
    """One committed transaction of a knowledge base.

    Attributes:
        number: 1, 2, 3 ... without gaps.
        committed_at: the time of the commit by the store's clock, in UTC; it never goes back.
        observed_at: when its knowledge was sensed, in UTC; None if not given.
        actor: the component that wrote.
        reason: why.
        source: where the knowledge came from, as JSON values.
        execution: the running execution, if the writer named it.
        hash: the SHA-256 that chains it to the revision before.
    """

    number: int
    committed_at: datetime
    observed_at: datetime | None
    actor: str | None
    reason: str | None
    source: object
    execution: ExecutionId | None
    hash: str

    @property
    def source_text(self) -> str | None:
        """The source as JSON text; None without one."""
        return (
            None
            if self.source is None
            else json.dumps(self.source, ensure_ascii=False, separators=(",", ":"))
        )

    def said(self) -> list[str]:
        """Return the given metadata: who, why and the source."""
        said = self.actor, self.reason, self.source_text
        return [one for one in said if one is not None]

    def _html_row_(self) -> html.Row:
        step = None if self.execution is None else str(self.execution)
        return {
            "revision": self.number,
            "committed at": self.committed_at,
            "observed at": self.observed_at,
            "actor": self.actor,
            "reason": self.reason,
            "source": self.source_text,
            "execution": step,
        }

    def _repr_html_(self) -> str:
        return html.fields({**self._html_row_(), "hash": self.hash})


def why_of(revision: Revision | None) -> tuple[str | None, str | None, object]:
    """Return who wrote, why, and the source."""
    if revision is None:
        return None, None, None
    return revision.actor, revision.reason, revision.source


@dataclass(frozen=True)
class Version(html.OneRow):
    """An element, from the revision that asserted it until the one that retracted it.

    Attributes:
        kind: a kind, as in `Change`.
        text: the element's canonical PDDL text.
        since: the revision that asserted it: by whom, when and why.
        until: the revision that retracted it; None while it holds.
        confirmed: for a fact, the last revision that confirmed it while it held, up to the state.
        acts: for a fact or a value, the ids of the executions that asserted it.
    """

    kind: str
    text: str
    since: Revision
    until: Revision | None
    confirmed: Revision | None = None
    acts: tuple[str, ...] = ()

    def _html_row_(self) -> html.Row:
        until = self.until
        return {
            "kind": self.kind,
            "text": self.text,
            "since": self.since.number,
            "asserted at": self.since.committed_at,
            "asserted by": self.since.actor,
            "reason": self.since.reason,
            "source": self.since.source_text,
            "effect of": ", ".join(self.acts) or None,
            "confirmed at": self.confirmed and self.confirmed.committed_at,
            "confirmed by": self.confirmed and self.confirmed.actor,
            "until": None if until is None else until.number,
            "retracted at": None if until is None else until.committed_at,
            "retracted by": None if until is None else until.actor,
            "reason to retract": None if until is None else until.reason,
            "source to retract": None if until is None else until.source_text,
        }


@dataclass(frozen=True)
class LogEntry:
    """A revision and its changes, one for each asserted or retracted element.

    Attributes:
        revision: the revision.
        changes: its changes.
    """

    _json_ = "*revision", "changes"

    revision: Revision
    changes: tuple[Change, ...]

    def _html_row_(self) -> html.Row:
        changes = tuple(" ".join(change) for change in self.changes[: html.LINES])
        left = len(self.changes) - len(changes)
        return {**self.revision._html_row_(), "changes": (*changes, *html.more(left))}

    def _repr_html_(self) -> str:
        return self.revision._repr_html_() + html.listing(self.changes, "change")


def at_most(limit: int | None) -> int:
    """Check a limit."""
    if limit is None:
        return LARGEST
    expected = "a whole number from 0 on, or None for all"
    return min(whole_number(limit, "limit", expected=expected), LARGEST)


def feed(
    store: Store, read: Callable[[int | None], Iterator[LogEntry]], limit: int | None
) -> Iterator[LogEntry]:
    """Return an iterator of a limited read; notebooks show the first items, read separately."""
    return html.Feed(lambda most: _while_open(store, read(most)), limit, noun="revision")


def _while_open(store: Store, entries: Iterator[LogEntry]) -> Iterator[LogEntry]:
    for entry in entries:
        store.refuse_closed()
        yield entry


def refuse_unknown(name: str, number: int, head: int) -> None:
    """Refuse a revision beyond the head."""
    if not 0 <= number <= head:
        raise UnknownRevisionError(
            f"knowledge base {name!r} has no revision {shown(number)}: it is at {head}"
        )


def refuse_archived_revision(store: Store, revision: int) -> None:
    """Refuse to read an archived state."""

    def work(session: Session, kb_id: int) -> None:
        refuse_archived(session, kb_id, revision, read_position(session, kb_id).archived)

    store.query_known(work, None)


def revision_of(number: ColumnElement[int]) -> tuple[ColumnElement[Any], ...]:
    """Select the columns for `make_revision`, of a revision named by the outer query."""
    both = (RevisionRow, OWN_COLUMNS), (RevisionExecutionRow, STEP_COLUMNS)
    return tuple(
        looked_up(column, table_of(of).c.number, number)
        for of, columns in both
        for column in columns
    )


def read_numbered(session: Session, kb_id: int, numbers: Collection[int]) -> dict[int, Revision]:
    """Read revisions by number, in one statement."""
    rows = numbered_rows(session, kb_id, numbers)
    return {row[0]: make_revision(session, row) for row in rows}


def read_revisions(store: Store, numbers: Collection[int]) -> dict[int, Revision]:
    """Read revisions of a store by number, in one statement."""
    read = partial(read_numbered, numbers=numbers)
    return store.query_known(read, {}, in_snapshot=False) if numbers else {}


def numbered_rows(session: Session, kb_id: int, numbers: Collection[int]) -> list[Row]:
    """Read the rows of `WITH_ARCHIVED` of revisions, in one statement."""
    if not numbers:
        return []
    listed = [*numbers]
    listed += listed[-1:] * (SHORTEST_LIST - len(listed))
    query = _NUMBERED if len(listed) <= LONGEST_LIST else _MANY_NUMBERED
    return session.rows(query, kb=kb_id, numbers=session.list_value(listed))


def make_revision(session: Session, row: Row) -> Revision:
    """Build a revision from a row that begins with the columns of `REVISIONS`."""
    try:
        return _make_revision(session, row)
    except UNREADABLE as error:
        raise unreadable("revision", f"revision {row[0]!r}", error) from error


def _make_revision(session: Session, row: Row) -> Revision:
    number, committed_at, actor, reason, source, digest, seen, plan_id, position, *_ = row
    observed_at = None if seen is None else session.to_time(seen)
    revision = object.__new__(Revision)
    # The `__init__` of a frozen dataclass takes twice as long.
    revision.__dict__.update(
        number=number,
        committed_at=session.to_time(committed_at),
        observed_at=observed_at,
        actor=actor,
        reason=reason,
        source=read_source(source),
        execution=None if plan_id is None else ExecutionId(plan_id or None, position),
        hash=digest,
    )
    return revision


# A page ends after this many revisions, or with the revision that reaches this many changes.
PAGE = 500
PAGE_CHANGES = 50_000


def read_page(session: Session, kb_id: int, low: int, high: int) -> list[LogEntry]:
    """Read a range of revisions with their changes, or its beginning."""
    rows = session.rows(OLDEST_FIRST, kb=kb_id, low=low, high=high)
    for number, row in enumerate(rows, low):
        if row[0] != number:
            raise missing_revision(session, number)
    if not rows:
        raise missing_revision(session, low)
    changes, end = collect(stream_changes(session, kb_id, low, rows[-1][0]), PAGE_CHANGES)
    return [
        LogEntry(make_revision(session, row), changes.get(row[0], ()))
        for row in rows
        if end is None or row[0] < end
    ]


def collect(
    lines: Iterator[tuple[int, Change]], most: int
) -> tuple[dict[int, tuple[Change, ...]], int | None]:
    """Group changes by revision; also return the revision that the limit cuts off, if any."""
    changes: dict[int, tuple[Change, ...]] = {}
    count = 0
    for number, of_number in groupby(lines, key=itemgetter(0)):
        if count >= most:
            return changes, number
        changes[number] = tuple(change for _, change in of_number)
        count += len(changes[number])
    return changes, None


def missing_revision(session: Session, number: int) -> StoreIntegrityError:
    """Build the error for a missing revision."""
    return StoreIntegrityError(
        f"{session.backend.label}: revision {number} is missing; run verify for more"
    )
