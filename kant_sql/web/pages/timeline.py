"""The page of the timeline: what held when, and the plans that were carried out meanwhile."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query

from ...history.timeline import Timeline
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
) -> Timeline:
    """Show what held when: a lane for each fact, goal and fluent, and plans with their outcomes.

    Versions shorter than a slice of the window are counted, so that the answer is bounded.
    """
    return kb.timeline(
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
    shown = timeline(kb, since, until, predicate, object, text, kind, after, slices)
    return timeline_spec(shown, dark=dark)
