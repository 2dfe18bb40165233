"""The page of the timeline: what held when, and the plans that were carried out meanwhile."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from fastapi import Query
from typing_extensions import TypedDict

from ...history.gantt import PlanBar, StepBar
from ...history.timeline import Bar, Density, Lane, Timeline
from ...knowledge.canonical import time_text
from ...knowledge_base import KnowledgeBase
from ...plots import FigureSpec, timeline_spec
from ..parameters import ElementText, ObjectName, SinceMoment, UntilMoment, moment
from ..registry import Pages
from .state import PredicateName

PAGES = Pages("timeline")

# How many lanes a page has.
LANES = 40
_KINDS = ("fact", "goal", "value", "plan")

OneTimelineKind = Annotated[
    Literal["", "fact", "goal", "value", "plan"],
    Query(description="Only this kind; empty for all."),
]
AfterLane = Annotated[
    str | None, Query(description="The place after which lanes begin: `next` of the page before.")
]
Slices = Annotated[
    int, Query(ge=1, le=4000, description="How many slices the window is divided into.")
]
Dark = Annotated[bool, Query(description="Whether the figure is for a dark page.")]


class BarDocument(TypedDict):
    """A version in a timeline: from the revision that asserted it to the one that retracted it."""

    since: int
    until: int | None
    since_at: str
    until_at: str | None
    actor: str | None
    reason: str | None
    ended_by: str | None
    ended_reason: str | None
    source: object
    ended_source: object
    value: str | None


class DensityDocument(TypedDict):
    """Versions that are too short to be drawn, counted between two times.

    With `is_capped` there are more. For a number, it was from `least` to `largest`.
    """

    begin: str
    end: str
    count: int
    is_capped: bool
    least: float | None
    largest: float | None
    last: float | None


class LaneDocument(TypedDict):
    """A fact, a goal or a fluent, and when it held."""

    kind: str
    text: str
    bars: list[BarDocument]
    densities: list[DensityDocument]


class StepBarDocument(TypedDict):
    """A step of a plan, when it was carried out, and what became of it."""

    position: int
    text: str
    status: str | None
    since: int | None
    until: int | None
    since_at: str | None
    until_at: str | None
    actor: str | None
    reason: str | None
    ended_by: str | None
    ended_reason: str | None
    source: object
    ended_source: object


class PlanBarDocument(TypedDict):
    """A recorded plan, and its steps."""

    id: int
    recorded_in: int
    recorded_at: str
    actor: str | None
    reason: str | None
    source: object
    planner: str | None
    steps: list[StepBarDocument]


class TimelineDocument(TypedDict):
    """What held between two times.

    `next` is the parameter `after` of the lanes that follow. What ended up to `archived_until` is
    in an archive, and missing here.
    """

    since: str
    until: str
    first: int
    last: int
    slices: int
    lanes: list[LaneDocument]
    next: str | None
    plans: list[PlanBarDocument]
    has_more_plans: bool
    archived_until: str | None


@PAGES.page("/timeline", "timeline.html", is_form=True, rows=["lanes.bars"])
def timeline(
    kb: KnowledgeBase,
    since: SinceMoment = None,
    until: UntilMoment = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    text: ElementText = None,
    kind: OneTimelineKind = "",
    after: AfterLane = None,
    slices: Slices = 600,
) -> TimelineDocument:
    """Show what held when: a lane for each fact, goal and fluent, and plans with their outcomes.

    Versions shorter than a slice of the window are counted, so that the answer is bounded.
    """
    return _document(
        kb.timeline(
            moment(since),
            until=moment(until),
            predicate=predicate or None,
            object=object or None,
            text=text or None,
            kinds=(kind,) if kind else _KINDS,
            lanes=LANES,
            after=after or None,
            slices=slices,
        )
    )


@PAGES.json("/timeline/figure")
def timeline_figure(
    kb: KnowledgeBase,
    since: SinceMoment = None,
    until: UntilMoment = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    text: ElementText = None,
    kind: OneTimelineKind = "",
    after: AfterLane = None,
    slices: Slices = 600,
    dark: Dark = False,
) -> FigureSpec:
    """Draw a timeline: a figure for Plotly; `customdata` is the address of a fact or a plan."""
    shown = kb.timeline(
        moment(since),
        until=moment(until),
        predicate=predicate or None,
        object=object or None,
        text=text or None,
        kinds=(kind,) if kind else _KINDS,
        lanes=LANES,
        after=after or None,
        slices=slices,
    )
    return timeline_spec(shown, dark=dark)


def _document(shown: Timeline) -> TimelineDocument:
    return {
        "since": time_text(shown.since),
        "until": time_text(shown.until),
        "first": shown.first,
        "last": shown.last,
        "slices": shown.slices,
        "lanes": [_lane(lane) for lane in shown.lanes],
        "next": shown.next,
        "plans": [_plan(plan) for plan in shown.plans],
        "has_more_plans": shown.has_more_plans,
        "archived_until": _time(shown.archived_until),
    }


def _lane(lane: Lane) -> LaneDocument:
    return {
        "kind": lane.kind,
        "text": lane.text,
        "bars": [_bar(bar) for bar in lane.bars],
        "densities": [_density(density) for density in lane.densities],
    }


def _bar(bar: Bar) -> BarDocument:
    return {
        "since": bar.since,
        "until": bar.until,
        "since_at": time_text(bar.since_at),
        "until_at": _time(bar.until_at),
        "actor": bar.actor,
        "reason": bar.reason,
        "ended_by": bar.ended_by,
        "ended_reason": bar.ended_reason,
        "source": bar.source,
        "ended_source": bar.ended_source,
        "value": bar.value,
    }


def _density(density: Density) -> DensityDocument:
    return {
        "begin": time_text(density.begin),
        "end": time_text(density.end),
        "count": density.count,
        "is_capped": density.is_capped,
        "least": density.least,
        "largest": density.largest,
        "last": density.last,
    }


def _plan(plan: PlanBar) -> PlanBarDocument:
    return {
        "id": plan.id,
        "recorded_in": plan.recorded_in,
        "recorded_at": time_text(plan.recorded_at),
        "actor": plan.actor,
        "reason": plan.reason,
        "source": plan.source,
        "planner": plan.planner,
        "steps": [_step(step) for step in plan.steps],
    }


def _step(step: StepBar) -> StepBarDocument:
    return {
        "position": step.position,
        "text": step.text,
        "status": step.status,
        "since": step.since,
        "until": step.until,
        "since_at": _time(step.since_at),
        "until_at": _time(step.until_at),
        "actor": step.actor,
        "reason": step.reason,
        "ended_by": step.ended_by,
        "ended_reason": step.ended_reason,
        "source": step.source,
        "ended_source": step.ended_source,
    }


def _time(at: datetime | None) -> str | None:
    return None if at is None else time_text(at)
