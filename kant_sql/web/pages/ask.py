"""The page that asks a condition: for whom it holds in a state, or when it held."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Literal, NamedTuple

from fastapi import Query

from ...knowledge_base import KnowledgeBase
from ...moment_text import Moment
from ...reasoning.complete import Completion
from ...reasoning.failures import FailedCondition
from ...reasoning.when import Held
from ..registry import Clock, Pages, Valid, bound, moment, past

PAGES = Pages("conditions")

MOST_ANSWERS, MOST_PERIODS = 1000, 500
_MOMENT = "A revision's number, or a time as 2026-03-02T14:03:00Z or '2 hours ago'."

Condition = Annotated[
    str, Query(description="A condition in PDDL, such as `(robot_at ?r kitchen)`.")
]
Parameters = Annotated[
    str, Query(description="The free variables with their types: `(?r - robot)`.")
]
Mode = Annotated[
    Literal["state", "when"],
    Query(
        description="`state`: for whom it holds in the state of `at` and `valid`; `when`: in which "
        "periods it held by `clock` between `since` and `until`. The parameters of the other are "
        "not read."
    ),
]
At = Annotated[str, Query(description=f"The state; the present if empty. {_MOMENT}")]
Since = Annotated[str, Query(description=f"The beginning of the periods. {_MOMENT}")]
Until = Annotated[str, Query(description=f"The end of the periods. {_MOMENT}")]
Limit = Annotated[int, Query(ge=1, le=MOST_ANSWERS, description="The greatest number of answers.")]


class FoundAnswers(NamedTuple):
    """The objects for which a condition holds in a state.

    A condition without free variables has one answer without objects, or none; then `unsatisfied`
    says why.
    """

    revision: int
    columns: tuple[str, ...]
    answers: list[tuple[str, ...]]
    is_cut: bool
    unsatisfied: list[FailedCondition]
    sql: str


class FoundPeriods(NamedTuple):
    """The periods in which a condition held, between two times, and their number."""

    columns: tuple[str, ...]
    begin: datetime
    end: datetime
    periods: list[Held]
    total: int


class AskPage(NamedTuple):
    """A condition and its answers, if there is a condition."""

    condition: str
    state: FoundAnswers | None = None
    when: FoundPeriods | None = None


class Completions(NamedTuple):
    """Names with a given beginning."""

    names: list[Completion]


@PAGES.page("/ask", "ask.html", is_form=True, rows=["state.answers", "when.periods"])
def ask(
    kb: KnowledgeBase,
    condition: Condition = "",
    mode: Mode = "state",
    at: At = "",
    since: Since = "",
    until: Until = "",
    parameters: Parameters = "",
    clock: Clock = "committed",
    limit: Limit = 200,
    valid: Valid = "",
) -> AskPage:
    """Evaluate a condition: for which objects it holds in a state, or in which periods it held."""
    if not condition.strip():
        return AskPage(condition)
    typed = parameters.strip() or None
    if mode == "state":
        found = _answers(past(kb, at, valid), condition, typed, limit, has_sql=not moment(valid))
        return AskPage(condition, state=found)
    bounds = bound(since), moment(until)
    return AskPage(condition, when=_periods(kb, condition, bounds, typed, clock))


@PAGES.json("/names")
def names(
    kb: KnowledgeBase,
    beginning: Annotated[str, Query(description="The first characters of a name.")] = "",
    at: At = "",
    limit: Annotated[int, Query(ge=1, le=100, description="The greatest number of names.")] = 12,
) -> Completions:
    """Complete a name: predicates, functions, objects, actions and types of a state."""
    return Completions(list(past(kb, at, None).pddl.complete(beginning, limit=limit)))


def _answers(
    state: KnowledgeBase, condition: str, parameters: str | None, limit: int, *, has_sql: bool
) -> FoundAnswers:
    # The revision first: if somebody writes meanwhile, the answers are at least as new.
    revision = state.revision
    answers = state.query(condition, parameters=parameters, limit=limit + 1)
    rows = list(answers[:limit])
    failed = [] if rows or answers.columns else list(state.unsatisfied(condition))
    is_cut = len(answers) > limit
    sql = answers.sql if has_sql else ""
    return FoundAnswers(revision, answers.columns, rows, is_cut, failed, sql)


def _periods(
    kb: KnowledgeBase,
    condition: str,
    bounds: tuple[Moment | None, Moment | None],
    parameters: str | None,
    clock: str,
) -> FoundPeriods:
    since, until = bounds
    found = kb.when(condition, since=since, until=until, parameters=parameters, clock=clock)
    shown = [found[index] for index in range(min(len(found), MOST_PERIODS))]
    begun = [held.since_time for held in shown if held.since_time is not None]
    begin = _time_of(kb, since) or min(begun, default=datetime.now(UTC))
    # Up to the last revision: of an old recording, bars up to now would be too thin to see.
    end = _time_of(kb, kb.revision if until is None else until) or begin
    return FoundPeriods(found.columns, begin, max(begin, end), shown, len(found))


def _time_of(kb: KnowledgeBase, moment: Moment | None) -> datetime | None:
    """Return the time of a revision, or the time itself."""
    if moment is None or isinstance(moment, datetime):
        return moment
    revisions = kb.store.revisions(after=max(0, moment - 1), limit=1)
    return revisions[0].committed_at if revisions else None
