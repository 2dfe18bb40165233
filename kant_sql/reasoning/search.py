"""The search for plans, also for cheap ones by costs learned from executions.

Each plan of a planner is validated from the state before it is returned.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Literal

from .. import planning
from ..acts.statistics import Statistics, statistics
from ..arguments import one_of
from ..documents.exchange import PlanningTask, read_task
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError
from ..pddl import write
from ..pddl.document import EXECUTABLE, Action
from ..planning.action_costs import (
    MOST_COSTS,
    ActionCost,
    CostedAction,
    Objects,
    UnusedNames,
    functions_read,
    write_costs,
)
from ..planning.metrics import refusal
from ..planning.solving import Judged
from ..store.snapshot import read_position
from ..store.state import State
from .validate import validate_plan


def plan(
    state: State,
    engine: str | None = None,
    *,
    engines: Iterable[str] | None = None,
    keep: Literal["first", "best"] = "first",
    costs: Literal["history"] | None = None,
    timeout: float | None = None,
    memory: int | None = None,
    strict: bool = False,
) -> planning.Plan:
    """Find a plan from the present state to the goals.

    Each plan is validated as by `validate` before it is returned, unless the domain has processes
    or events. A plugin converts preferences and metrics to costs of actions. Those that a planner
    cannot get are named in the plan's `ignored` and logged as a warning; planners get all other
    parts of the problem.

    Args:
        engine: an engine's name in unified-planning, for example `fast-downward`; None to
            choose an installed one that supports the problem. Or a command line with a name, as in
            `lama: fast-downward.py --alias lama-first {domain} {problem}`, or a name of the file of
            engines (`docs/planners.md`).
        engines: several engines, which run side by side.
        keep: which plan of `engines` to return: the `first` one, or the `best` when all have
            ended or the time is up, by the metric, or else the makespan.
        costs: `history`: a step costs its expected time until success, by the outcomes of
            executions up to this state (`docs/learning.md` has the formula). This replaces the
            metric, which is named in `ignored`.
        timeout: seconds to wait; None to wait without limit. Plans of problems with soft
            goals or costs are improved for 10 seconds, or half of the timeout if that is less.
        memory: the maximum megabytes of addresses for each process of a planner; None for no limit.
        strict: refuse to ignore a part of the metric or a preference.

    Returns:
        The plan, with the revision of the state, and the run of each engine as `runs`. If soft
        goals were compiled away or ignored, or with `costs`, it has the planner's input as
        `domain_pddl` and `problem_pddl`.

    Raises:
        NoPlanError: there is no plan, none was found in time, or it is not valid; `runs` has the
            result of each engine.
        UnsupportedConstructError: planners cannot express a part of the problem, or with `strict`
            a part of its metric or preferences.
        PlannerMissingError: unified-planning or the engine is not installed.
        QuestionCancelledError: the limit of `kant_sql.limited` was cancelled.
        InvalidArgumentError: an engine is not a command line with `{domain}` and `{problem}`, or
            the file of engines cannot be read.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open))
        ...   (:action unlock :parameters () :effect (open)))''').revision
        2
        >>> kb.load_problem('''(define (problem enter) (:domain doors)
        ...   (:init) (:goal (open)))''').revision
        3
        >>> print(kb.plan("pyperplan"), end="")
        (unlock)
    """
    if costs is None:
        task, ignored = read_task(state), tuple[str, ...]()
        judge = partial(_judge, task)
    else:
        one_of(costs, ("history",), "costs")
        known, task, ignored = _read_with_history(state)
        judge = partial(_judge, known)
        if strict and ignored:
            raise refusal(ignored)
    found = planning.solve(
        task.domain,
        problem=task.problem,
        engine=engine,
        engines=engines,
        keep=keep,
        timeout=timeout,
        memory=memory,
        strict=strict,
        is_costed=costs is not None,
        judge=judge,
    )
    given = write(task.domain) if found.domain_pddl is None else found.domain_pddl
    asked = write(task.problem) if found.problem_pddl is None else found.problem_pddl
    if costs is not None:
        found = dataclasses.replace(
            found, ignored=(*ignored, *found.ignored), domain_pddl=given, problem_pddl=asked
        )
    digest = planning.problem_hash(given, problem=asked)
    return dataclasses.replace(found, revision=task.revision, problem_hash=digest)


def _judge(task: PlanningTask, found: planning.Plan) -> Judged:
    """Validate a plan, and describe its cost."""
    try:
        validation = validate_plan(task.domain, task.problem, found)
    except UnsupportedConstructError as error:
        return Judged(True, f"{len(found.steps)} steps, not validated: {error}")
    if not validation.valid:
        _, *why = map(str.strip, str(validation).splitlines())
        return Judged(False, "; ".join(why).replace(":; ", ": "))
    metric, cost = task.problem.metric, validation.metric_value
    text = f"{len(found.steps)} steps, makespan {validation.makespan:f}"
    if metric is None or cost is None:
        return Judged(True, text, validation.makespan)
    is_maximized = metric.optimization == "maximize"
    return Judged(True, f"{text}, metric {cost:f}", -cost if is_maximized else cost)


# The statistics of an action count as this many cases, besides those with the same arguments.
WEIGHT = 2
# Costs are whole hundredths of a second, because planners want whole numbers.
UNIT = 100


@dataclasses.dataclass(frozen=True)
class Expected:
    """The expected result of an execution."""

    seconds: Fraction  # how long it takes
    success: Fraction  # the probability of its success, above 0

    @property
    def cost(self) -> Fraction:
        """The expected time until success (Wald's equation), in whole hundredths of a second.

        An attempt costs at least a second, or failing would cost nothing.
        """
        return Fraction(math.ceil(UNIT * max(self.seconds, Fraction(1)) / self.success))

    def updated(self, seen: Statistics | None) -> Expected:
        """Return the expectation after executions; this one counts as `WEIGHT` of them."""
        if seen is None or seen.mean is None:
            return self
        count = seen.succeeded + seen.failed
        return Expected(
            (count * Fraction(seen.mean) + WEIGHT * self.seconds) / (count + WEIGHT),
            (seen.succeeded + WEIGHT * self.success) / (count + WEIGHT),
        )


def expected_of_action(seen: Statistics | None, usual: Fraction) -> Expected:
    """Return the expectation for an action: the mean of success after the prior Beta(1, 1)."""
    if seen is None or seen.mean is None:
        return Expected(usual, Fraction(1, 2))
    success = Fraction(seen.succeeded + 1, seen.succeeded + seen.failed + 2)
    return Expected(Fraction(seen.mean), success)


def _read_with_history(state: State) -> tuple[PlanningTask, PlanningTask, tuple[str, ...]]:
    """Read the task, and write it with costs; also return what is ignored."""
    erased = state.store.query(read_position).erased
    task = read_task(state)
    # This state does not know of later executions.
    found = task, *_with_history(task, State(state.store, task.revision))
    if state.store.query(read_position).erased != erased:
        # The executions may have another name of an object than the task.
        return _read_with_history(state)
    return found


def _with_history(task: PlanningTask, past: State) -> tuple[PlanningTask, tuple[str, ...]]:
    """Replace the metric by costs from executions; return the replaced metric, too."""
    domain, problem = task.domain, task.problem
    metric, ignored = problem.metric, list[str]()
    if metric is not None:
        ignored.append(f"the metric ({metric.optimization} {metric.expression}): costs of history")
    whole, by_act = (statistics(past, by=by) for by in (("action",), ("arguments",)))
    [mean] = [one.mean for one in statistics(past, by=())] or [None]
    usual = Fraction(1 if mean is None else mean)
    seen = {fold(one.action or ""): one for one in whole}
    objects, made = Objects(domain, problem), []
    for action in domain.actions:
        if action.kind not in EXECUTABLE:
            made.append(CostedAction(action))
            continue
        expected = expected_of_action(seen.get(fold(action.name)), usual)
        acts = [one for one in by_act if fold(one.action or "") == fold(action.name)]
        if math.prod(len(objects.of(part.types)) for part in action.parameters) > MOST_COSTS:
            ignored.append(f"what became of {action.name} with its objects: more than {MOST_COSTS}")
            acts = []
        made.append(_costed(action, expected, acts, objects))
    problem = dataclasses.replace(problem, metric=None)
    # Numbers that no longer decide anything would require a planner that supports numbers.
    numeric = frozenset(fold(one.name) for one in domain.functions if not one.types)
    free = numeric - functions_read(domain, problem)
    documents = write_costs(domain, problem, made, free, UnusedNames(domain, problem))
    return PlanningTask(task.revision, *documents), tuple(ignored)


def _costed(
    action: Action, expected: Expected, acts: Iterable[Statistics], objects: Objects
) -> CostedAction:
    """Return an action with its cost for all objects; unknown ones cost as much as the action."""
    seen = {tuple(map(fold, act.arguments or ())): act for act in acts}
    if not seen:
        return CostedAction(action, amount=expected.cost)
    ranges = (objects.of(part.types) for part in action.parameters)
    values = {
        words: expected.updated(seen.get(tuple(map(fold, words)))).cost
        for words in product(*ranges)
    }
    return CostedAction(action, ActionCost(action.parameters, values))
