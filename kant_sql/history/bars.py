"""What a timeline has: bars of lanes and of plans, and what is too short to be one."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

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
        source: what else was given by who asserted it, such as a confidence.
        ended_source: what else was given by who retracted it.
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
    """Versions on a timeline that are too short to be drawn, in one or more of its slices.

    Attributes:
        begin: the beginning of the first slice, in UTC.
        end: the end of the last one.
        count: how many versions began there, or more if `is_capped`.
        is_capped: whether they were not counted to the end.
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
        densities: where it held too shortly to be drawn, oldest first.
    """

    kind: LaneKind
    text: str
    bars: tuple[Bar, ...]
    densities: tuple[Density, ...] = ()


@dataclass(frozen=True, slots=True)
class StepBar:
    """A step of a plan on a timeline.

    Attributes:
        position: its index in the plan, from 0.
        text: the action with its arguments.
        status: `started`, `succeeded`, `failed` or `aborted`; None before it is started.
        since: the revision that started it; None if it was not started.
        until: the revision that ended it; None if it did not end.
        since_at: when it was started, in UTC.
        until_at: when it ended, in UTC.
        actor: who started it, or aborted it before.
        reason: why.
        ended_by: who ended it.
        ended_reason: why.
        source: what else was given by who started it.
        ended_source: what else was given by who ended it.
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
    """A recorded plan on a timeline.

    Attributes:
        id: its number in the knowledge base.
        recorded_in: the revision that recorded it.
        recorded_at: when, in UTC.
        actor: who recorded it.
        reason: why.
        planner: the planner's name.
        steps: its steps, in order.
        source: what else was given by who recorded it.
    """

    _json_ = "id", "recorded_in", "recorded_at", "actor", "reason", "source", "planner", "steps"

    id: int
    recorded_in: int
    recorded_at: datetime
    actor: str | None
    reason: str | None
    planner: str | None
    steps: tuple[StepBar, ...]
    source: object = None
