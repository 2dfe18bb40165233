"""Validation of plans, by executing them in memory from a state.

A plan is a sequence of happenings: instantaneous steps, starts and ends of durative steps, and
timed initial literals. Those at most `SIMULTANEOUS` after the first one of a group share its time,
and may not interfere. Over all conditions hold from right after the start until right before the
end (PDDL 2.1, Fox and Long 2003, definition 18). A step without a start time is at 1, 2, 3 ... in
the order of the plan.

As in VAL, durations may deviate from their constraints by `TOLERANCE`, and timed initial literals
after the last step also happen before the goal is judged. Unlike in VAL, comparisons have no
tolerance (VAL accepts a difference of 0.0001), and an effect such as `increase` on a fluent without
a value fails (VAL treats it as 0).

While fluents change continuously, a comparison changes its truth value only where its sides, which
are linear in time, are equal. So an invariant is evaluated at these times, and once between each
two of them, which is exact. Trajectory constraints are judged in the states at happenings.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from typing import Any, NamedTuple

from .. import html
from ..acts import Execution
from ..arguments import iterate, shown
from ..documents.exchange import read_task
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import PlanError, UnsupportedConstructError
from ..history.moments import state_at
from ..knowledge.grounding import substitute
from ..knowledge.resolved import Resolver
from ..moment_text import When
from ..pddl.cursor import hint
from ..pddl.document import DURATIVE_ACTION, EVENT, PROCESS, Domain, Problem
from ..pddl.reader import without_collector
from ..planning import Plan, PlanStep
from ..plans import RecordedPlan
from ..plans.dao import SqlPlanDao
from ..store.state import State
from .actions import (
    Changes,
    Schema,
    Snap,
    Update,
    apply_changes,
    broken_within,
    interference,
    pass_time,
    rates_of,
)
from .arithmetic import decimal_of
from .derived import read_world
from .evaluate import Compiler, Conditions
from .failures import FailedCondition, failed_parts
from .steps import Step as GivenStep
from .steps import preferred, read_plan_step
from .trajectory import Moment, Rule, Trajectory
from .world import Row, World, fact_of, value_of

SIMULTANEOUS = Decimal("0.001")
ANONYMOUS = "anonymous"

Step = PlanStep | Execution
GivenPlan = Plan | RecordedPlan | int | str | os.PathLike[str] | Iterable[GivenStep]


@dataclass(frozen=True)
class FailedStep:
    """The step that cannot be executed.

    Attributes:
        position: its index in the plan, from 0.
        step: the step.
        time: when it fails, from the start of the plan; for `over all`, the time of the next
            happening.
        phase: `at start`, `over all` or `at end` of a durative step; None for another one.
        unsatisfied: the parts that do not hold, or why it cannot be executed.
    """

    _json_ = "position", "*step", "time", "phase", "unsatisfied"

    position: int
    step: Step
    time: Decimal
    phase: str | None
    unsatisfied: tuple[FailedCondition, ...]

    def __str__(self) -> str:
        phase = "" if self.phase is None else f" {self.phase}"
        lines = [f"step {self.position}, {self.step}, fails at {self.time:f}{phase}:"]
        return "\n".join([*lines, *(f"  {one}" for one in self.unsatisfied)])


@dataclass(frozen=True)
class ViolatedConstraint:
    """A trajectory constraint that a plan violates.

    Attributes:
        constraint: the constraint as PDDL text, with objects for its variables.
        time: the time of the first state that violates it.
        position: the index of the last step with an effect on that state; None for the initial one.
    """

    constraint: str
    time: Decimal
    position: int | None

    def __str__(self) -> str:
        return f"{self.constraint} is violated at {self.time:f}"


@dataclass(frozen=True)
class Validation:
    """The result of executing a plan in memory.

    Attributes:
        valid: whether all steps can be executed, the goal is reached, and no constraint is
            violated.
        failed_step: the first step that cannot be executed, with the reasons.
        is_goal_reached: whether the goal holds after the plan.
        unsatisfied_goals: the parts of the goal that do not hold then; empty if a step fails.
        makespan: the time at which the last step ends; the number of steps in a domain without
            durative actions.
        metric_value: the value of the metric; None without one, without a defined value, or if a
            step fails.
        violated_preferences: how often each preference is violated, by name; those without a name
            count as `anonymous`. Empty if a step fails.
        violated_constraints: the trajectory constraints that are violated.
    """

    valid: bool
    failed_step: FailedStep | None
    is_goal_reached: bool
    unsatisfied_goals: tuple[FailedCondition, ...]
    makespan: Decimal
    metric_value: Decimal | None
    violated_preferences: Mapping[str, int]
    violated_constraints: tuple[ViolatedConstraint, ...]

    def __str__(self) -> str:
        lines = ["the plan is valid" if self.valid else "the plan is not valid"]
        if self.failed_step is not None:
            lines.append(str(self.failed_step))
        else:
            lines += [f"the goal {goal}" for goal in self.unsatisfied_goals]
        lines += [str(one) for one in self.violated_constraints]
        if self.failed_step is None:
            lines.append(f"makespan {self.makespan:f}")
            if self.metric_value is not None:
                lines.append(f"metric {self.metric_value:f}")
            lines += [
                f"preference {name} violated {count} time{'s' * (count > 1)}"
                for name, count in self.violated_preferences.items()
            ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html.lines(str(self))


def validate(state: State, plan: GivenPlan, *, at: When | None = None) -> Validation:
    """Execute a plan in memory from a state of the store; nothing is written.

    Sequential and temporal plans are executed as PDDL 2.1 defines (Fox and Long, 2003), with
    timed initial literals, derived predicates, preferences, trajectory constraints and
    continuous change that is linear in time. Durations may deviate from their constraints by
    0.01, and happenings at most 0.001 apart share a time, as in VAL. Steps without a start time
    are executed one after another.

    Args:
        plan: a plan, its text or path (see `Plan.read`), a list of steps, each as for `kb.apply`,
            or a recorded plan or its id. It is executed from the state chosen here, not from the
            state that it was made from.
        at: a revision, given as for `kb.at`; None for the present, or the past state that
            this view shows.

    Returns:
        Whether the plan is valid; if not, the first step that cannot be executed with its
        unsatisfied conditions, or the goals and constraints that it does not satisfy; its
        makespan, in the plan's units, the value of the metric, and its violated preferences.

    Raises:
        UnsupportedConstructError: the domain has processes or events, nonlinear continuous
            change, or constraints that PDDL 3.0 gives no meaning.
        UnknownRevisionError: there is no such revision yet, or the time lies in the future or
            has no zone.
        ArchivedError: that state was moved to an archive.
        PlanError: there is no recorded plan with that id, or an element of the list is no step.
        PddlError: the text is not a plan.
        InvalidKnowledgeError: `plan` is not a plan, or derived predicates are not stratified.

    Examples:
        >>> from kant_sql import Plan, PlanStep
        >>> kb.load_domain('''(define (domain doors) (:predicates (open) (locked))
        ...   (:action unlock :parameters () :precondition (locked) :effect (not (locked)))
        ...   (:action push :parameters () :precondition (not (locked)) :effect (open)))'''
        ... ).revision
        2
        >>> kb.load_problem('''(define (problem enter) (:domain doors)
        ...   (:init (locked)) (:goal (open)))''').revision
        3
        >>> steps = (PlanStep(None, "unlock"), PlanStep(None, "push"))
        >>> print(kb.validate(Plan(steps, "by hand", "unknown")))
        the plan is valid
        makespan 2
        >>> print(kb.validate(Plan(steps[1:], "by hand", "unknown")))
        the plan is not valid
        step 0, (push), fails at 1:
          (not (locked)): does not hold
    """
    revision = state.at if at is None else state_at(state, at)
    given = read_any_plan(state, plan)
    task = read_task(State(state.store, revision))
    found = validate_plan(task.domain, task.problem, given)
    if not found.valid and was_renamed(state, plan, given):
        return validate(state, plan, at=at)
    return found


def was_renamed(state: State, plan: GivenPlan, read: Plan | RecordedPlan) -> bool:
    """Return whether a name was erased since a plan was read by its id."""
    return isinstance(plan, int) and not has_same_steps(read_any_plan(state, plan), read)


def has_same_steps(one: Plan | RecordedPlan, other: Plan | RecordedPlan) -> bool:
    """Return whether two plans have the same steps by their texts."""
    return [*map(str, one.steps)] == [*map(str, other.steps)]


def read_any_plan(state: State, plan: GivenPlan) -> Plan | RecordedPlan:
    """Read the plan from a caller's argument: a plan, its id, its text or path, or its steps."""
    if isinstance(plan, Plan | RecordedPlan):
        return plan
    if isinstance(plan, int) and not isinstance(plan, bool):
        # It may have been recorded after the state that it is executed from.
        found = SqlPlanDao(state.store, None).get(plan)
        if found is None:
            raise PlanError(
                f"knowledge base {state.store.name!r} has no plan {shown(plan)}; see: kb.plans"
            )
        return found
    if isinstance(plan, str | os.PathLike):
        return Plan.read(plan)
    steps = iterate(plan, "the plan", "a Plan, its id, its text, its path or a list of steps")
    return Plan(tuple([read_plan_step(step) for step in steps]), "", "")


@without_collector()
def validate_plan(domain: Domain, problem: Problem, plan: Plan | RecordedPlan) -> Validation:
    """Execute a plan from the initial state of a problem; raise as `validate`."""
    check_validated(domain)
    return PlanExecution(domain, problem, plan.steps).run()


def check_validated(domain: Domain) -> None:
    """Refuse a domain with processes or events."""
    for action in domain.actions:
        if action.kind in (PROCESS, EVENT):
            raise UnsupportedConstructError(
                f"the {action.kind} {action.name} happens by itself, which cannot be validated; "
                "remove it from the domain, or use a validator for PDDL+, such as VAL"
            )


class _Entry(NamedTuple):
    """A part of a happening: a step or a timed initial literal, by position."""

    time: Decimal
    phase: str | None
    position: int
    is_literal: bool = False


class _Failure(Exception):  # noqa: N818
    """A step fails."""

    def __init__(
        self, position: int, phase: str | None, unsatisfied: Sequence[FailedCondition]
    ) -> None:
        super().__init__()
        self.position, self.phase, self.unsatisfied = position, phase, tuple(unsatisfied)


@dataclass
class PlanExecution:
    """The execution of one plan."""

    domain: Domain
    problem: Problem
    steps: Sequence[Step]
    now: Decimal = Decimal(0)
    running: dict[int, Snap] = field(default_factory=dict)
    memories: dict[int, dict[int, set[Row]]] = field(default_factory=dict)
    positions: list[int | None] = field(default_factory=list)
    violated: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.world: World = read_world(self.domain, self.problem)
        self.conditions = Conditions(self.world)
        self.actions = {fold(one.name): one for one in self.domain.actions}
        self.schemas: dict[str, Schema] = {}
        constraints = (*self.domain.constraints, *self.problem.constraints)
        self.trajectory = Trajectory(constraints, self.world.range_of)
        self.is_temporal = any(one.kind == DURATIVE_ACTION for one in self.domain.actions)
        self.makespan = Decimal(0)

    def run(self) -> Validation:
        """Execute the plan, and judge the goals, preferences and constraints."""
        failed = self.execute()
        self.trajectory.conclude()
        constraints = [
            self._constraint(rule, rule.violation)
            for rule in self.trajectory.violated()
            if not rule.is_soft and rule.violation is not None
        ]
        goals: list[FailedCondition] = []
        value = None
        if failed is None:
            for goal in self.problem.goal:
                goals += failed_parts(self.world, goal, {})
            self._count_preferences()
            value = self._value()
        return Validation(
            valid=failed is None and not goals and not constraints,
            failed_step=failed,
            is_goal_reached=failed is None and not goals,
            unsatisfied_goals=tuple(goals),
            makespan=self.makespan,
            metric_value=value,
            violated_preferences=dict(sorted(self.violated.items())) if failed is None else {},
            violated_constraints=tuple(constraints),
        )

    def execute(self) -> FailedStep | None:
        """Execute the steps; return the first one that cannot be executed."""
        self._observe(None)
        for happening in self._happenings():
            time = happening[0].time
            try:
                self._pass(time)
                self._happen(happening)
            except _Failure as failure:
                step = self.steps[failure.position]
                place = failure.position, step, time, failure.phase
                return FailedStep(*place, failure.unsatisfied)
            positions = [one.position for one in happening if not one.is_literal]
            self._observe(max(positions) if positions else self.positions[-1])
            if positions:
                self.makespan = time if self.is_temporal else Decimal(len(self.steps))
        return None

    def _observe(self, position: int | None) -> None:
        self.positions.append(position)
        self.trajectory.observe(self.now, self.conditions.holds)

    # Happenings.

    def _happenings(self) -> Iterator[list[_Entry]]:
        """Yield groups of entries at one time, in order."""
        entries = sorted(self._entries(), key=lambda entry: entry.time)
        group: list[_Entry] = []
        for entry in entries:
            if group and entry.time - group[0].time > SIMULTANEOUS:
                yield group
                group = []
            group.append(entry)
        if group:
            yield group

    def _entries(self) -> Iterator[_Entry]:
        for number, literal in enumerate(self.problem.timed):
            yield _Entry(literal.time.value, None, number, True)
        untimed = 0
        for position, step in enumerate(self.steps):
            start = step.start
            if start is None:
                untimed += 1
                start = Decimal(untimed)
            action = self.actions.get(fold(step.action))
            if action is None or action.kind != DURATIVE_ACTION:
                yield _Entry(start, None, position)
                continue
            yield _Entry(start, f.AT_START, position)
            if step.duration is not None:
                yield _Entry(start + step.duration, f.AT_END, position)

    def _happen(self, entries: Sequence[_Entry]) -> None:
        """Execute the entries of one time."""
        literals = [self._literal(one.position) for one in entries if one.is_literal]
        snaps = [self._snap(one) for one in entries if not one.is_literal]
        for snap in snaps:
            failed = snap.phase.unmet(snap) or snap.prepare() or snap.conflicts()
            if failed:
                raise _Failure(snap.position, snap.time, failed)
        self._check_interference(snaps, literals)
        for snap in snaps:
            self._note(snap.phase.violated(snap.arguments))
        self._apply(literals, snaps)
        for snap in snaps:
            if snap.time == f.AT_START:
                self.running[snap.position] = snap
            else:
                self.running.pop(snap.position, None)

    def _apply(self, literals: Sequence[Changes], snaps: Sequence[Snap]) -> None:
        apply_changes(self.world, [*literals, *(snap.changes for snap in snaps)])

    def _literal(self, number: int) -> Changes:
        """Return the changes of a timed initial literal."""
        effect, changes = self.problem.timed[number].effect, Changes()
        if isinstance(effect, f.Assign):
            function, row, value = value_of(self.world, effect.fluent, effect.value)
            changes.updates[function, row] = [Update("assign", value)]
            return changes
        atom: Any = effect.formula if isinstance(effect, f.Not) else effect
        into = changes.deletes if isinstance(effect, f.Not) else changes.adds
        into.add(fact_of(self.world, atom))
        return changes

    def _snap(self, entry: _Entry) -> Snap:
        """Return a step at its start, at its end, or as a whole."""
        step = self.steps[entry.position]
        action = self.actions.get(fold(step.action))
        if action is None:
            near = hint(step.action, [one.name for one in self.domain.actions])
            failed = FailedCondition(str(step), f"there is no action {step.action}{near}")
            raise _Failure(entry.position, None, [failed])
        key = fold(action.name)
        if key not in self.schemas:
            self.schemas[key] = Schema(self.world, action)
        schema = self.schemas[key]
        misfit = schema.misfit(self.world, step.arguments)
        if misfit is not None:
            raise _Failure(entry.position, entry.phase, [misfit])
        reason = ""
        if action.kind == DURATIVE_ACTION and (step.duration is None or step.duration < 0):
            reason = "a durative action has a duration from 0 on"
        elif step.start is not None and step.start < 0:
            reason = "it starts before the plan does, at 0"
        if reason:
            raise _Failure(entry.position, entry.phase, [FailedCondition(str(step), reason)])
        found = map(self.world.object, step.arguments)
        ids = tuple([one for one in found if one is not None])
        memory = self.memories.setdefault(entry.position, {})
        return Snap(self.world, schema, ids, entry.phase, entry.position, step.duration, memory)

    def _check_interference(self, snaps: Sequence[Snap], literals: Sequence[Changes]) -> None:
        if len(snaps) + len(literals) < 2:
            return
        for number, snap in enumerate(snaps):
            reads = snap.reads()
            others = [one.changes for at, one in enumerate(snaps) if at != number]
            for changes in (*others, *literals):
                found = interference(self.world, snap.changes, reads, changes)
                if found is not None:
                    raise _Failure(snap.position, snap.time, [found])

    # Continuous change and invariants.

    def _pass(self, time: Decimal) -> None:
        """Go to the time of the next happening."""
        elapsed, running = Fraction(time - self.now), [*self.running.values()]
        rates = rates_of(self.world, running)
        broken = broken_within(self.world, running, rates, elapsed)
        if broken is not None:
            raise _Failure(broken[0].position, f.OVER_ALL, broken[1])
        if rates and elapsed > 0:
            self.world.rates = rates
            pass_time(self.world, elapsed)
        was, self.now = self.now, time
        if rates and time > was:
            self._observe(self.positions[-1])

    # Preferences, constraints and the metric.

    def _note(self, names: Iterable[str | None]) -> None:
        """Count violations of preferences."""
        for name in names:
            key = name or ANONYMOUS
            self.violated[key] = self.violated.get(key, 0) + 1

    def _count_preferences(self) -> None:
        compiler, resolver = Compiler(self.world), Resolver(self.world.definitions)
        for goal in self.problem.goal:
            for preference in preferred(goal):
                name, variables, formula = preference
                _, rows = compiler.counterexamples(resolver, variables, formula)
                self._note([name] * len(rows(compiler.env())))
        self._note(rule.preference for rule in self.trajectory.violated() if rule.is_soft)

    def _constraint(self, rule: Rule, violation: Moment) -> ViolatedConstraint:
        parts = [one for one in rule.violated if one.violation == violation]
        text = str(substitute(parts[0].formula, parts[0].binding))
        return ViolatedConstraint(text, violation.time, self.positions[violation.index])

    def _value(self) -> Decimal | None:
        if self.problem.metric is None:
            return None
        self.world.total_time = self.makespan
        cost = self.world.definitions.functions.named(f.TOTAL_COST)
        if cost is not None:
            # A plan without costs has the cost 0 (IPC 2008), whether the problem says so or not.
            self.world.table(cost.id).setdefault((), Decimal(0))
        for name, count in self.violated.items():
            key = fold(name)
            self.world.violations[key] = self.world.violations.get(key, 0) + count
        found = self.conditions.exact_number(self.problem.metric.expression, {})
        return None if found is None else decimal_of(found)
