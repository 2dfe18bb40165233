"""Executes one step of any kind in memory, with the code that validates plans.

The world of the task takes the states of the step: before it, after its start, while its numbers
change, after its end. `operators` needs none of this for the steps that it grounds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

from ..dto.formulas import AT_END, AT_START
from ..errors import NotApplicableError
from ..planning import PlanStep
from .actions import Schema, Snap, Update, broken_within, first_broken, rates_of
from .arithmetic import EXACT, decimal_of
from .effects import not_applicable
from .failures import TOLERANCE, FailedCondition
from .operators import Assignments, At, GroundedTask, changed_values
from .promise import AFTER_START, check_linear, is_executable, limits_of, no_duration, promise_of
from .steps import GroundStep, PreparedAction, misfits
from .world import FluentRow


class Durations(NamedTuple):
    """The durations that the constraints of a step allow in a state.

    Attributes:
        least: the shortest.
        most: the longest; None without a bound.
    """

    least: Decimal
    most: Decimal | None


class StepRun:
    """One step, judged and executed in memory; the caller holds the task's lock."""

    def __init__(self, task: GroundedTask, step: GroundStep) -> None:
        self._task, self._step, self._action = task, step, step.action
        self._compiler = task.compiler(step.action)
        self._refuse(misfits(task.definitions, step))

    def finish(self, at: At) -> At:
        """Return the state after the step, as `durative.apply` writes it."""
        start, at = self.begin(at)
        if not self._action.is_durative:
            return at
        world, running = self._task.world, [start]
        self._task.go(at)
        lasts, rates = Fraction(start.duration or 0), rates_of(world, running)
        broken = broken_within(world, running, rates, lasts)
        self._refuse(broken[1] if broken else ())
        at = self._changed(
            at, {each: [Update("increase", rate * lasts)] for each, rate in rates.items()}
        )
        end = Snap(world, start.schema, self._step.ids, AT_END, 0, start.duration, start.memory)
        return self._happen(end, at)

    def begin(self, at: At) -> tuple[Snap, At]:
        """Return the start of the step, and the state after it; or refuse the step."""
        task, step, action = self._task, self._step, self._action
        time, duration = None, None
        if action.is_durative:
            check_linear(action)
            time, duration = AT_START, self._duration(at)
        schema = task.kept((Schema, action.name), lambda: Schema(task.world, action.node))
        snap = Snap(task.world, schema, step.ids, time, 0, duration, {})
        after = self._happen(snap, at)
        if action.is_durative:
            task.go(after)
            _, broken = first_broken([snap]) or (snap, [])
            self._refuse([replace(one, reason=f"{one.reason} {AFTER_START}") for one in broken])
        task.go(at)
        part = promise_of(action).part
        test = task.kept((StepRun, action.name), lambda: self._compiler.test(part))
        if not test(self._compiler.env(step.ids, duration)):
            self._refuse([FailedCondition(str(step), "its condition does not hold")])
        return snap, after

    def durations(self, at: At) -> Durations:
        """Return the allowed durations; refuse a step that has none."""
        self._task.go(at)
        least, most = Decimal(0), None
        for operator, quantity, needs in limits_of(self._action):
            found = self._compiler.number(quantity, needs)(
                self._compiler.env(self._step.ids), EXACT
            )
            if found is None:
                reason = "a number that limits it has no value"
                raise not_applicable(self._step, [FailedCondition("?duration", reason)])
            limit = decimal_of(found)
            if operator in (">", ">=", "="):
                least = max(least, limit)
            if operator in ("<", "<=", "="):
                most = limit if most is None else min(most, limit)
        if most is not None and least - most > 2 * TOLERANCE:
            reason = f"no duration is from {least:f} to {most:f}"
            self._refuse([FailedCondition("?duration", reason, least, most)])
        return Durations(least, None if most is None else max(least, most))

    def _refuse(self, failed: Sequence[FailedCondition]) -> None:
        if failed:
            raise not_applicable(self._step, failed)

    def _duration(self, at: At) -> Decimal | None:
        """Return the given or fixed duration; None if it does not matter."""
        given, limits = self._step.duration, self._action.constraints(AT_START)
        if given is None and any(each.operator == "=" for each in limits):
            return self.durations(at).least
        self._refuse(no_duration(self._step, given))
        return given

    def _happen(self, snap: Snap, at: At) -> At:
        """Return the state after a part of the step; refuse it if its condition does not hold."""
        self._task.go(at)
        self._refuse(snap.phase.unmet(snap) or snap.prepare())
        (bits, values), changes = at, snap.changes
        for fact in changes.deletes:
            bits &= ~self._task.bit(fact)
        for fact in changes.adds:
            bits |= self._task.bit(fact)
        return self._changed((bits, values), changes.updates)

    def _changed(self, at: At, updates: dict[FluentRow, list[Update]]) -> At:
        task, made = self._task, Assignments()
        for fluent, found in updates.items():
            text = task.world.text((False, fluent[0]), fluent[1])
            made[task.fluent(fluent)] = text, [*found]
        values, failed = changed_values(at[1], made)
        self._refuse(failed)
        return at[0], values


def listed(
    task: GroundedTask, action: PreparedAction, at: At
) -> Iterator[tuple[tuple[int, ...], PlanStep]]:
    """Yield the durative steps that can begin, each with its shortest duration and its order."""
    if not is_executable(action):
        return
    compiler, condition = task.compiler(action), action.condition(AT_START)
    rows = task.kept((action.name, listed), lambda: compiler.rows(action.parameters, condition))
    task.go(at)
    for ids in rows(compiler.env()):
        step = GroundStep(action, ids, task.world.names(ids))
        try:
            least = StepRun(task, step).durations(at).least
            StepRun(task, replace(step, duration=least)).begin(at)
        except NotApplicableError:
            continue
        order = task.actions.index(action), *ids
        yield order, PlanStep(None, action.name, step.names, least)
