"""Questions without pages: each a function of a knowledge base, with bounded answers."""

from __future__ import annotations

from decimal import Decimal
from itertools import islice
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from kant_sql.errors import InvalidArgumentError, UnsupportedConstructError
from kant_sql.history.state_parts import StateFilter, StatePage, read_state
from kant_sql.knowledge_base import KnowledgeBase, state_of
from kant_sql.planning.commands import named
from kant_sql.planning.plan import PlanStep
from kant_sql.reasoning import CauseLinks
from kant_sql.reasoning.failures import FailedCondition
from kant_sql.reasoning.validate import Validation
from kant_sql.web import report_sections as sections
from kant_sql.web.pages.ask import Condition, FoundPeriods, Parameters, ask
from kant_sql.web.pages.revisions import OneKind, PredicateName
from kant_sql.web.registry import (
    After,
    At,
    Clock,
    ElementText,
    ObjectName,
    Offset,
    SinceMoment,
    UntilMoment,
    Valid,
    moment,
    past,
)
from kant_sql.web.report import Sections

# The maximum elements of each kind, links of causes, steps of a page, and seconds of a planner.
MOST_ELEMENTS, MOST_LINKS, MOST_STEPS, MOST_SECONDS = 200, 100, 200, 120

Elements = Annotated[
    int, Field(ge=1, le=MOST_ELEMENTS, description="The greatest number of elements of each kind.")
]
Fact = Annotated[str, Field(description="A fact or a fluent, such as `(robot_at rb1 wp1)`.")]
Depth = Annotated[int, Field(ge=1, le=10, description="How many links to follow.")]
Links = Annotated[int, Field(ge=1, le=MOST_LINKS, description="The greatest number of links.")]
Step = Annotated[str, Field(description="A step, such as `(move rb1 wp1 wp2)`.")]
Steps = Annotated[int, Field(ge=1, le=MOST_STEPS, description="The greatest number of steps.")]
ActionName = Annotated[str, Field(description="Only steps of this action; empty for all.")]
Fixed = Annotated[
    dict[str, str], Field(description="Objects of parameters, by their names: `{'r': 'rb1'}`.")
]
PlanText = Annotated[
    str, Field(description="A plan: one step on each line, as `(move rb1 wp1 wp2)`.")
]
Engine = Annotated[
    str | None, Field(description="A planner, such as `pyperplan`; by default one that fits.")
]
Seconds = Annotated[float, Field(gt=0, le=MOST_SECONDS, description="How long to search.")]


class StepStanding(NamedTuple):
    """Whether a step can begin in a state, and what prevents it."""

    revision: int
    is_applicable: bool
    unsatisfied: list[FailedCondition]


class PossibleSteps(NamedTuple):
    """A page of the steps that can begin in a state; `next` is the `offset` of the next page."""

    revision: int
    steps: list[PlanStep]
    next: int | None


class FoundPlan(NamedTuple):
    """A plan; `ignored` has the parts of metric and preferences that the planner did not get."""

    revision: int | None
    engine: str
    status: str
    ignored: tuple[str, ...]
    steps: tuple[PlanStep, ...]
    value: Decimal | None


class IncidentReport(NamedTuple):
    """A report of a range of revisions; `errors` names the parts that cannot be read, and why."""

    summary: sections.ReportSummary
    acts: sections.ReportActs | None
    rules: sections.ReportRules | None
    goals: sections.ReportGoals | None
    effects: sections.ReportEffects | None
    errors: dict[str, str]


def known(
    kb: KnowledgeBase,
    at: At = None,
    text: ElementText = None,
    predicate: PredicateName = None,
    object: ObjectName = None,
    kind: OneKind = "",
    after: After = None,
    valid: Valid = None,
    limit: Elements = 30,
) -> StatePage:
    """Show a state by kind; to continue a `kind`, give its `next` as `after`.

    Each element has the revision that asserted it. `gone` has what the state's revision retracted.
    """
    state, revision = (past(kb, at, valid), None) if moment(valid) else (kb, moment(at))
    asked = StateFilter(text or None, predicate or None, object or None)
    return read_state(state_of(state), revision, asked, kind or None, after, limit)


def when(
    kb: KnowledgeBase,
    condition: Condition,
    since: SinceMoment = None,
    until: UntilMoment = None,
    parameters: Parameters = "",
    clock: Clock = "committed",
) -> FoundPeriods:
    """Find the periods in which a condition held, with who began and ended each."""
    bounds: Any = {"since": since or "", "until": until or "", "clock": clock}
    found = ask(kb, condition, "when", parameters=parameters, **bounds).when
    if found is None:
        raise InvalidArgumentError("the condition is empty; give PDDL such as (robot_at rb1 wp1)")
    return found


def why(kb: KnowledgeBase, fact: Fact, depth: Depth = 5, limit: Links = 50) -> CauseLinks:
    """Explain a fact or a value: the acts, observations and documents that it comes from."""
    return kb.origins(fact, depth=depth, limit=limit)


def led_to(kb: KnowledgeBase, fact: Fact, depth: Depth = 2, limit: Links = 50) -> CauseLinks:
    """Find the consequences of a fact or a value: acts, plans and derived facts that used it."""
    return kb.consequences(fact, depth=depth, limit=limit)


def why_not(kb: KnowledgeBase, step: Step, at: At = None, valid: Valid = None) -> StepStanding:
    """Say why a step cannot begin in a state: the conditions that do not hold."""
    state = past(kb, at, valid)
    revision, failed = state.revision, state.why_not(step)
    return StepStanding(revision, not failed, failed)


def can_do(
    kb: KnowledgeBase,
    action: ActionName = "",
    fixed: Fixed | None = None,
    at: At = None,
    valid: Valid = None,
    limit: Steps = 50,
    offset: Offset = 0,
) -> PossibleSteps:
    """List the steps that can begin in a state, of one action or of all."""
    if {"limit", "name"} & set(fixed or {}):
        raise UnsupportedConstructError(
            "parameters that are called limit or name cannot be fixed; write them in capitals"
        )
    state, end = past(kb, at, valid), offset + limit
    arguments: Any = fixed or {}
    revision = state.revision
    found = state.applicable_actions(action or None, limit=end + 1, **arguments)
    steps = list(islice(found, offset, end + 1))
    return PossibleSteps(revision, steps[:limit], end if len(steps) > limit else None)


def would_work(kb: KnowledgeBase, plan: PlanText, at: At = None, valid: Valid = None) -> Validation:
    """Execute a plan in memory: whether it reaches the goal, or which step fails and why."""
    # A text without a line break could be a path.
    return past(kb, at, valid).validate(f"{plan}\n")


def find_plan(kb: KnowledgeBase, engine: Engine = None, timeout: Seconds = 30.0) -> FoundPlan:
    """Find a plan from the present state to the goal. Nothing is recorded or executed."""
    plan = kb.plan(named(engine), timeout=timeout)
    return FoundPlan(plan.revision, plan.engine, plan.status, plan.ignored, plan.steps, plan.value)


def report(
    kb: KnowledgeBase, since: SinceMoment = None, until: UntilMoment = None
) -> IncidentReport:
    """Report a range: writes of each actor, acts, rules, missed goals, unconfirmed effects."""
    reader = sections.ReportReader.of(kb, since or None, until or None)
    summary, read = reader.summary(), Sections(())
    if reader.is_empty:
        return IncidentReport(summary, None, None, None, None, read.errors)
    return IncidentReport(
        summary,
        read("acts", reader.acts),
        read("rules", lambda: reader.rules(None)),
        read("goals", reader.goals),
        read("effects", reader.effects),
        read.errors,
    )


QUESTIONS = (known, when, why, led_to, why_not, can_do, would_work, find_plan, report)
