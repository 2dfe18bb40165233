"""The arguments of a timeline, its window, and the bars of lanes and plans."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import Any, Literal, NamedTuple, get_args

from sqlalchemy import bindparam, func, select

from ..arguments import (
    flag,
    iterate,
    one_of,
    optional_text,
    refusal,
    shown,
    storable_text,
    whole_number,
)
from ..dto.lexical import fold
from ..errors import InvalidArgumentError, reading_rows
from ..moment_text import Moment, When, read_when
from ..sql.changes import last_until
from ..sql.dialects.base import Session
from ..sql.lanes import LaneFilter, LanePlace
from ..sql.query import Query, StoreClock, constant, integer
from ..sql.rows import KB, looked_up, table_of
from ..sql.tables import HeadRow, RevisionRow
from ..store.store import Store
from .moments import check_number, check_zone, clamped
from .revisions import LARGEST

LaneKind = Literal["fact", "goal", "value"]


@dataclass(frozen=True, slots=True)
class Bar:
    """A version on a timeline.

    Attributes:
        since: the revision that asserted it.
        until: the revision that retracted it; None while it holds.
        since_at: when it was asserted, in UTC.
        until_at: when it was retracted, in UTC; None while it holds.
        actor: who asserted it.
        reason: why.
        ended_by: who retracted it.
        ended_reason: why.
        source: the source given with the assertion, such as a sensor.
        ended_source: the source given with the retraction.
        value: of a fluent, its value: a number as exact text, or the name of an object.
        number: the value as a number, if it is one.
    """

    _json_ = (
        *("since", "until", "since_at", "until_at", "actor", "reason", "ended_by", "ended_reason"),
        *("source", "ended_source", "value"),
    )

    since: int
    until: int | None
    since_at: datetime
    until_at: datetime | None
    actor: str | None
    reason: str | None
    ended_by: str | None = None
    ended_reason: str | None = None
    source: object = None
    ended_source: object = None
    value: str | None = None
    number: float | None = None


@dataclass(frozen=True, slots=True)
class Density:
    """Versions on a timeline that are too short to draw, in one or more of its slices.

    Attributes:
        begin: the beginning of the first slice, in UTC.
        end: the end of the last one.
        count: the number of versions that began there, or more if `is_capped`.
        is_capped: whether counting ended at the limit.
        least: of a numeric fluent, the least of the counted numbers.
        largest: the largest one.
        last: the number at the end.
    """

    begin: datetime
    end: datetime
    count: int
    is_capped: bool
    least: float | None = None
    largest: float | None = None
    last: float | None = None


@dataclass(frozen=True, slots=True)
class Lane:
    """A fact, a goal or a fluent on a timeline.

    Attributes:
        kind: `fact`, `goal` or `value`.
        text: its canonical PDDL text; that of a fluent has no value.
        bars: when it held, oldest first.
        densities: its versions that are too short to draw, oldest first.
    """

    kind: LaneKind
    text: str
    bars: tuple[Bar, ...]
    densities: tuple[Density, ...] = ()


@dataclass(frozen=True, slots=True)
class StepBar:
    """A step of a plan on a timeline, or an execution without a plan.

    Attributes:
        position: its index in the plan, from 0; without a plan, the id of the execution.
        text: the action with its arguments.
        status: its outcome; None before it is started.
        since: the revision that started it; None if it was not started.
        until: the revision that ended it; None if it did not end.
        since_at: when it was started, in UTC.
        until_at: when it ended, in UTC.
        actor: who started it, or aborted it before.
        reason: why.
        ended_by: who ended it.
        ended_reason: why.
        source: the source given with the start.
        ended_source: the source given with the end.
    """

    position: int
    text: str
    status: str | None
    since: int | None = None
    until: int | None = None
    since_at: datetime | None = None
    until_at: datetime | None = None
    actor: str | None = None
    reason: str | None = None
    ended_by: str | None = None
    ended_reason: str | None = None
    source: object = None
    ended_source: object = None


@dataclass(frozen=True, slots=True)
class PlanBar:
    """A recorded plan on a timeline; the last one has only steps: the executions without a plan.

    Attributes:
        id: its number in the knowledge base; None: no plan.
        recorded_in: the revision that recorded it.
        recorded_at: when, in UTC.
        actor: who recorded it.
        reason: why.
        planner: the planner's name.
        steps: its steps, in order.
        source: the source given with the recording.
    """

    _json_ = "id", "recorded_in", "recorded_at", "actor", "reason", "source", "planner", "steps"

    id: int | None
    recorded_in: int | None
    recorded_at: datetime | None
    actor: str | None
    reason: str | None
    planner: str | None
    steps: tuple[StepBar, ...]
    source: object = None


PLAN = "plan"
TIMELINE_KINDS = (*get_args(LaneKind), PLAN)
MOST_LANES, MOST_SLICES = 1_000, 10_000


class TimelineQuestion(NamedTuple):
    """The checked arguments of a timeline."""

    kinds: tuple[str, ...]  # the kinds of lanes, and `plan`
    wanted: LaneFilter  # the names and the text as the store compares them
    lanes: int  # the maximum number of lanes
    slices: int  # the maximum number of slices
    after: tuple[str, LanePlace] | None  # the source and the position of the lane before the first
    unchanged: bool  # whether to show also lanes that never changed


_AFTER = re.compile(r"(fact|goal|formula|value):([0-9]{1,18}):([0-9 ]*)")


def check_question(
    kinds: Iterable[str],
    predicate: str | None,
    object: str | None,
    text: str | None,
    lanes: int,
    slices: int,
    after: str | None,
    unchanged: bool,
) -> TimelineQuestion:
    """Check the arguments of a timeline."""
    flag(unchanged, "unchanged", InvalidArgumentError)
    if isinstance(kinds, str) or not isinstance(kinds, Iterable):
        raise refusal("kinds", "a list of kinds", kinds, InvalidArgumentError)
    given = islice(iterate(kinds, "kinds"), len(TIMELINE_KINDS))
    wanted = {one_of(kind, TIMELINE_KINDS, "a kind") for kind in given}
    for value, role in ((predicate, "predicate"), (object, "object"), (text, "text")):
        storable_text(value, role)
    for number, most, role in ((lanes, MOST_LANES, "lanes"), (slices, MOST_SLICES, "slices")):
        expected = f"a whole number from 1 to {most}"
        if whole_number(number, role, least=1, expected=expected) > most:
            raise InvalidArgumentError(f"{role} is {shown(number)}, expected {expected}")
    place = None
    if optional_text(after, "after") is not None:
        match = _AFTER.fullmatch(str(after))
        if match is None:
            raise InvalidArgumentError(
                f"after is {shown(after)}, expected the value of `next` of a timeline"
            )
        place = match[1], LanePlace(int(match[2]), match[3])
    chosen = tuple(kind for kind in TIMELINE_KINDS if kind in wanted)
    head, argument = (None if name is None else fold(name) for name in (predicate, object))
    shown_lanes = LaneFilter(head, argument, text)
    return TimelineQuestion(chosen, shown_lanes, lanes, slices, place, unchanged)


class Window(NamedTuple):
    """The window of a timeline."""

    since: datetime  # its beginning
    until: datetime  # its end
    low: int  # the revision of the initial state
    high: int  # its last revision
    head: int  # the last known revision
    archived_until: datetime | None = None  # versions that ended up to this time are missing


_REVISION = table_of(RevisionRow).c


def _time_of(number: Any) -> Any:
    return looked_up(_REVISION.committed_at, _REVISION.number, number)


_WINDOW = Query(
    select(
        HeadRow.revision,
        HeadRow.archived_revision,
        StoreClock(),
        _time_of(constant(1)),
        _time_of(func.coalesce(integer("upto"), HeadRow.revision)),
        _time_of(HeadRow.archived_revision),
        _time_of(integer("since")),
        _time_of(integer("until")),
        last_until(bindparam("one")),
        last_until(bindparam("other")),
    ).where(HeadRow.kb_id == KB)
)


def read_window(
    session: Session,
    kb_id: int | None,
    store: Store,
    whens: Sequence[When | None],
    upto: int | None,
) -> Window:
    """Read the window between two ends, in one statement; before the first revision it is empty."""
    ends = [read_when(when) for when in whens]
    given: dict[str, Any] = {"one": None, "other": None, "since": None, "until": None}
    for when, number, moment in zip(ends, ("since", "until"), ("one", "other"), strict=True):
        if isinstance(when, datetime):
            check_zone(when)
            given[moment] = session.from_time(clamped(when))
        elif isinstance(when, int) and abs(when) < LARGEST:
            given[number] = when
    row = None
    if kb_id is not None:
        row = session.first(_WINDOW, kb=kb_id, upto=upto, **given)
    head = 0 if row is None else row[0]
    last = head if upto is None else upto
    for when in ends:
        if when is not None and not isinstance(when, datetime):
            check_number(store.name, when, last)
    if row is None or not last:
        now = store.clock(session)
        since, until = (_moment(when, now, now) for when in ends)
        return _checked(Window(since, until, 0, 0, 0), ends)
    with reading_rows("revision", f"knowledge base {kb_id!r}"):
        first, known, archived, *numbered = (
            None if time is None else session.to_time(time) for time in row[3:8]
        )
        if first is None or known is None:
            raise LookupError("revisions are missing")
    now = max(session.now(row[2]), known)
    states = [
        min(found or 0, last) if isinstance(when, datetime) else when
        for when, found in zip(ends, row[8:], strict=True)
    ]
    since = _moment(ends[0], now, numbered[0] or first)
    until = _moment(ends[1], now, numbered[1] or (max(known, since) if ends[1] is None else first))
    low, high = states[0] or 0, last if states[1] is None else states[1]
    missing = archived if row[1] > low else None
    return _checked(Window(since, until, low, high, last, missing), ends)


def _moment(when: Moment | None, now: datetime, otherwise: datetime) -> datetime:
    """Return the time of an end; a future time counts as now."""
    return min(clamped(when), now) if isinstance(when, datetime) else otherwise


def _checked(window: Window, ends: Sequence[Moment | None]) -> Window:
    if window.until < window.since or window.high < window.low:
        raise InvalidArgumentError(
            f"the window ends before it begins: it is from {shown(ends[0])} until {shown(ends[1])}"
        )
    return window
