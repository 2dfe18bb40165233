"""The page of statistics: how often actions were done and succeeded, and how long they took."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import Query

from ...acts.statistics import Grouping, Statistics
from ...knowledge_base import KnowledgeBase
from ..registry import Pages, SinceMoment, UntilMoment, bound, moment

PAGES = Pages("statistics")

# How many groups a page has.
GROUPS = 500
Grouped = Annotated[
    Grouping,
    Query(
        description="What is a group: the executions of an action, of an action with one of its "
        "arguments, with all of them, or by an actor."
    ),
]
Actor = Annotated[str, Query(description="Only executions that this actor began.")]


class StatisticsPage(NamedTuple):
    """Groups of executions, those with the most executions first; `has_more`: not all are here."""

    groups: list[Statistics]
    has_more: bool


@PAGES.page("/statistics", "statistics.html", is_form=True, rows=["groups"])
def statistics(
    kb: KnowledgeBase,
    by: Grouped = "action",
    actor: Actor = "",
    since: SinceMoment = None,
    until: UntilMoment = None,
) -> StatisticsPage:
    """Show how often actions were done, how often they succeeded, and how long that took."""
    found = kb.statistics(
        by=("action", "argument") if by == "argument" else (by,),
        actor=actor or None,
        since=bound(since),
        until=moment(until),
        limit=GROUPS + 1,
    )
    return StatisticsPage(found[:GROUPS], len(found) > GROUPS)
