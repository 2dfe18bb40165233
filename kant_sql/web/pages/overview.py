"""The overview page of a knowledge base."""

from __future__ import annotations

from typing import NamedTuple

from ...acts import Execution
from ...acts.executions import ExecutionFilter
from ...history.confirmations import unconfirmed
from ...history.log import LogFilter, LogLine, read_log_page
from ...history.revisions import Version
from ...knowledge_base import KnowledgeBase, state_of
from ...reasoning.explain import GoalStanding, read_goal_standings
from ...reasoning.rule_watch import standing
from ...reasoning.rules import Verdict
from ...sql.executions import RUNNING
from ..registry import Pages
from .acts import read_acts
from .home import briefly

PAGES = Pages("overview")

# The number of each.
MOST_RUNNING, MOST_GOALS, MOST_RULES, MOST_EXPECTED = 50, 100, 100, 20
LAST_DONE, LAST_CHANGES = 10, 8


class OverviewPage(NamedTuple):
    """An overview: the newest of each kind, up to a number.

    `unconfirmed` has unconfirmed effects of acts. It, `goals` and `rules` are null if they take too
    long; `done` has ended acts.
    """

    running: list[Execution]
    goals: list[GoalStanding] | None
    rules: list[Verdict] | None
    unconfirmed: list[Version] | None
    done: list[Execution]
    changes: list[LogLine]


@PAGES.page("/overview", "overview.html", rows=["running", "done"])
def overview(kb: KnowledgeBase) -> OverviewPage:
    """Show running and last acts, goals, rules, unconfirmed effects and the last changes."""
    running, _ = read_acts(kb, ExecutionFilter(outcome=RUNNING), MOST_RUNNING)
    last, _ = read_acts(kb, ExecutionFilter(), LAST_DONE + len(running))
    done = [one for one in last if one.outcome != RUNNING][:LAST_DONE]
    changes = read_log_page(state_of(kb), LogFilter(), limit=LAST_CHANGES).revisions
    return OverviewPage(
        running,
        briefly(lambda: read_goal_standings(state_of(kb), MOST_GOALS)),
        briefly(lambda: standing(state_of(kb)).worst_first[:MOST_RULES]),
        briefly(lambda: unconfirmed(state_of(kb), limit=MOST_EXPECTED)),
        done,
        changes,
    )
