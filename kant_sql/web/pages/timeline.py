"""The page of the timeline: what held when, and the plans that were carried out meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from typing import Annotated, Any

from fastapi import Query

from ...history.drawing import Timeline, draw
from ...history.window import TIMELINE_KINDS
from ...json_values import JsonValue
from ...knowledge.canonical import time_text
from ...knowledge_base import KnowledgeBase
from ..registry import Clock, ElementText, ObjectName, Pages, SinceMoment, UntilMoment, bound
from ..rendering import link
from .revisions import PredicateName

PAGES = Pages("timeline")

# How many lanes a page has.
LANES = 200
SHORTEST = timedelta(milliseconds=2)
# Other windows: their name, their key, and where they begin and end, as shares of this one.
_MOVES = (
    ("← Earlier", "ArrowLeft", -0.5, 0.5),
    ("Later →", "ArrowRight", 0.5, 1.5),
    ("Zoom in", "+", 0.25, 0.75),
    ("Zoom out", "-", -0.5, 1.5),
)

OneTimelineKind = Annotated[
    str,
    Query(
        description="Only this kind; empty for all.",
        json_schema_extra={"enum": ["", *TIMELINE_KINDS]},
    ),
]
AfterLane = Annotated[
    str | None, Query(description="The place after which lanes begin: `next` of the page before.")
]
Unchanged = Annotated[bool, Query(description="Also what never changed, in lanes of its own.")]
Slices = Annotated[
    int, Query(ge=1, le=4000, description="How many slices the window is divided into.")
]


def _drawn(shown: Timeline, query: Mapping[str, Any]) -> JsonValue:
    """Draw a timeline, and name the windows around it."""

    def to(path: str, /, **given: object) -> str:
        of_page = {**query, "after": None} if path == "/timeline" else {"kb": query["kb"]}
        times = {
            name: time_text(value) if isinstance(value, datetime) else value
            for name, value in given.items()
        }
        return link(path, **{**of_page, **times})

    def windows() -> Iterator[JsonValue]:
        for name, key, first, last in _MOVES:
            length = max(shown.until - shown.since, SHORTEST)
            try:
                since, until = shown.since + length * first, shown.since + length * last
            except OverflowError:
                continue
            yield {"name": name, "key": key, "address": to("/timeline", since=since, until=until)}
        yield {"name": "Everything", "key": "0", "address": to("/timeline", since=None, until=None)}

    made = draw(shown, to)
    return {"axis": made.axis, "body": made.body, "windows": list(windows())}


@PAGES.page("/timeline", "timeline.html", is_form=True, rows=["lanes.bars"], draw=_drawn)
def timeline(
    kb: KnowledgeBase,
    since: SinceMoment = None,
    until: UntilMoment = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    text: ElementText = None,
    kind: OneTimelineKind = "",
    after: AfterLane = None,
    unchanged: Unchanged = False,
    slices: Slices = 600,
    clock: Clock = "committed",
) -> Timeline:
    """Show a lane for each fact, goal and fluent over time, and plans with their outcomes.

    Versions shorter than a slice of the window are counted, so that the answer is bounded.
    """
    return kb.timeline(
        bound(since),
        until=bound(until),
        predicate=predicate or None,
        object=object or None,
        text=text or None,
        kinds=(kind,) if kind else TIMELINE_KINDS,
        lanes=LANES,
        after=after or None,
        unchanged=unchanged,
        slices=slices,
        clock=clock,
    )
