"""The pages of executions: what was done, by whom, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from fastapi import Query

from ...acts import Execution
from ...acts.executions import ExecutionFilter, read_page
from ...acts.recording import Word, words_of
from ...errors import UnknownNameError
from ...history.log import LogLine, read_log_lines
from ...history.moments import find_bounds
from ...history.revisions import LARGEST, Version
from ...knowledge_base import KnowledgeBase, state_of
from ...sql.executions import OUTCOMES, RUNNING, read_outcome
from ...sql.places import Place, place_text, read_place
from ..registry import After, Pages, SinceMoment, UntilMoment, moment

PAGES = Pages("acts")

# How many executions a page has, and how many revisions of one.
EXECUTIONS, REVISIONS = 50, 20

if TYPE_CHECKING:
    OutcomeName = str
else:
    OutcomeName = Literal[("", *OUTCOMES)]
ActionName = Annotated[
    str, Query(description="Only executions of this action, or of what a component calls so.")
]
ArgumentName = Annotated[str, Query(description="Only executions that have this object.")]
OneOutcome = Annotated[OutcomeName, Query(description="Only this outcome; empty for all.")]
Beginner = Annotated[str, Query(description="Only what this actor began.")]
ExecutionId = Annotated[
    str, Query(description="The execution's id: `17`, or `12.3` for step 3 of plan 12.")
]


@dataclass(frozen=True)
class ExecutionLine:
    """An execution in a list.

    Attributes:
        execution: the execution.
        words: its action and its arguments, each an `action`, an `object` or another `text`.
        due_at: when it should end by its planned duration; None unless it runs and has one.
        seconds_left: how long that is from now; below 0 when it is late.
    """

    _json_ = "*execution", "words", "due_at", "seconds_left"

    execution: Execution
    words: list[Word]
    due_at: datetime | None
    seconds_left: float | None


class ActsPage(NamedTuple):
    """A page of executions, those with the latest outcome first."""

    executions: list[ExecutionLine]
    next: str | None


@dataclass(frozen=True)
class ActPage:
    """An execution, each outcome that it had, and what was changed in its name.

    `changed` has the last revisions that set an outcome or name it, newest first, of `total`.
    """

    _json_ = "*line", "outcomes", "changed", "total"

    line: ExecutionLine
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
    """List what was done, those with the latest outcome first: who began it, why, what came of it.

    Steps of plans that were not started are left out.
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
) -> tuple[list[ExecutionLine], str | None]:
    """Read a page of executions, and where the next one begins."""
    low, high, _ = find_bounds(state_of(kb).store, moment(since), moment(until), None)
    before: Any = read_place(after, (int, int, int)).key or (high, LARGEST, LARGEST)
    found, end = read_page(state_of(kb), asked, low, before, limit)
    return [line_of(one) for one in found], place_text(end and Place(0, end))


@PAGES.page("/act", "act.html", rows=["changed"])
def act(kb: KnowledgeBase, id: ExecutionId) -> ActPage:
    """Show an execution: who began it, why, each outcome, and the revisions that belong to it."""
    found = kb.executions.get(id)
    if found is None:
        raise UnknownNameError(f"this knowledge base has no execution {id}; its acts are listed")
    total, last = len(found.revisions), found.revisions[-REVISIONS:]
    line = line_of(replace(found, revisions=last))
    return ActPage(line, found.outcomes, read_log_lines(state_of(kb), last), total)


def line_of(execution: Execution) -> ExecutionLine:
    """Say which words of an execution are names, and when it should end."""
    told = [read_outcome(one.text).act for one in execution.outcomes[-1:]]
    # What has no such text is a step of a plan, whose words are names.
    words = words_of((told and told[0]) or str(execution))
    due = _due_at(execution)
    left = None if due is None else (due - datetime.now(UTC)).total_seconds()
    return ExecutionLine(execution, words, due, left)


def _due_at(execution: Execution) -> datetime | None:
    begun, seconds = execution.started_at, execution.duration
    if execution.outcome != RUNNING or begun is None or seconds is None:
        return None
    try:
        return begun + timedelta(seconds=float(seconds))
    except OverflowError:
        return None
