"""The pages of executions: acts with their actors and outcomes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, NamedTuple

from fastapi import Query

from ...acts import Execution, Outcome
from ...acts.executions import ExecutionFilter, read_page
from ...errors import UnknownNameError
from ...history.log import LogLine, read_log_lines
from ...history.moments import find_bounds
from ...history.revisions import LARGEST, Version
from ...knowledge_base import KnowledgeBase, state_of
from ...sql.places import Place, place_text, read_place
from ..registry import After, Pages, SinceMoment, UntilMoment, bound, moment

PAGES = Pages("acts")

# Executions on a page, and revisions of one execution.
EXECUTIONS, REVISIONS = 50, 20

ActionName = Annotated[
    str, Query(description="Only executions of this action, or of acts with this name.")
]
ArgumentName = Annotated[str, Query(description="Only executions that have this object.")]
OneOutcome = Annotated[Literal["", Outcome], Query(description="Only this outcome; empty for all.")]
Beginner = Annotated[str, Query(description="Only what this actor began.")]
ExecutionId = Annotated[
    str, Query(description="The execution's id: `17`, or `12.3` for step 3 of plan 12.")
]


class ActsPage(NamedTuple):
    """A page of executions, latest outcome first."""

    executions: list[Execution]
    next: str | None


@dataclass(frozen=True)
class ActPage:
    """An execution, its outcomes, and its changes.

    `changed` has the last revisions that set an outcome or name it, newest first, of `total`.
    """

    _json_ = "*execution", "outcomes", "changed", "total"

    execution: Execution
    outcomes: tuple[Version, ...]
    changed: list[LogLine]
    total: int


@PAGES.page("/acts", "acts.html", is_form=True, rows=["executions"])
def acts(
    kb: KnowledgeBase,
    action: ActionName = "",
    object: ArgumentName = "",
    outcome: OneOutcome = "",
    actor: Beginner = "",
    since: SinceMoment = None,
    until: UntilMoment = None,
    after: After = None,
) -> ActsPage:
    """List executions, latest outcome first: who began each, why, and the outcome.

    It omits steps of plans that were not started.
    """
    asked = ExecutionFilter(action or None, object or None, outcome or None, actor or None)
    found, end = read_acts(kb, asked, EXECUTIONS, since, until, after)
    return ActsPage(found, end)


def read_acts(
    kb: KnowledgeBase,
    asked: ExecutionFilter,
    limit: int,
    since: str | None = None,
    until: str | None = None,
    after: str | None = None,
) -> tuple[list[Execution], str | None]:
    """Read a page of executions, and where the next one begins."""
    low, high, *_ = find_bounds(state_of(kb), bound(since), moment(until))
    before: Any = read_place(after, (int, int, int)).key or (high, LARGEST, LARGEST)
    found, end = read_page(state_of(kb), asked, low, before, limit)
    return found, place_text(end and Place(0, end))


@PAGES.page("/act", "act.html", rows=["changed"])
def act(kb: KnowledgeBase, id: ExecutionId) -> ActPage:
    """Show an execution: who began it, why, each outcome, and the revisions that belong to it."""
    found = kb.executions.get(id)
    if found is None:
        raise UnknownNameError(f"this knowledge base has no execution {id}; its acts are listed")
    total, last = len(found.revisions), found.revisions[-REVISIONS:]
    shown = replace(found, revisions=last)
    return ActPage(shown, found.outcomes, read_log_lines(state_of(kb), last), total)
