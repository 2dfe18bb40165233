"""Actions, durative actions, processes and events of unified-planning as those of a document."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..dto.formula import (
    AT_END,
    AT_START,
    OVER_ALL,
    And,
    Arithmetic,
    Assign,
    Comparison,
    ContinuousTime,
    Fluent,
    Forall,
    Formula,
    Not,
    Timed,
    Variable,
    When,
)
from ..pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS, Action
from .cost import TOTAL_COST
from .from_formulas import Bound, Expressions
from .from_names import PddlNames
from .up_duration import DURATION

if TYPE_CHECKING:
    from unified_planning.model import DurationInterval, Effect, FNode, Timing, Transition
    from unified_planning.model.timing import TimeInterval


class FromActions:
    """Converts the actions of one problem."""

    def __init__(self, names: PddlNames, expressions: Expressions) -> None:
        """Convert with the names of a problem.

        Args:
            names: what its elements are called.
            expressions: what converts expressions.
        """
        self._names, self._expressions = names, expressions

    def action(self, action: Transition, cost: FNode | None) -> Action:
        """Convert an action, a process or an event.

        Args:
            action: the action.
            cost: what it adds to the total cost, if anything.

        Returns:
            The action of the document.

        Raises:
            UnsupportedConstructError: PDDL cannot express something in it.
        """
        from unified_planning import model

        kinds = {
            model.InstantaneousAction: ACTION,
            model.DurativeAction: DURATIVE_ACTION,
            model.Process: PROCESS,
            model.Event: EVENT,
        }
        self._expressions.where = f"action {action.name}"
        if type(action) not in kinds:
            raise self._expressions.unsupported(type(action).__name__, "PDDL has no such action")
        kind = kinds[type(action)]
        simulated = "simulated_effects" if kind == DURATIVE_ACTION else "simulated_effect"
        if getattr(action, simulated, None) if kind != PROCESS else None:
            raise self._expressions.unsupported("a simulated effect", "its meaning is a program")
        bound = Bound().bind(action.parameters)
        timed = kind == DURATIVE_ACTION
        effects = list(
            self._durative_effects(action, bound) if timed else self._effects(action, bound)
        )
        if cost is not None:
            value = self._expressions.expression(cost, bound)
            increase = Assign("increase", Fluent(TOTAL_COST), value)
            effects.append(Timed(AT_END, increase) if timed else increase)
        return Action(
            kind,
            self._names.of(kind, action.name),
            self._expressions.typed(action.parameters, bound),
            self._duration(action.duration, bound) if timed else (),
            tuple(self._conditions(action, bound))
            if timed
            else self._expressions.conjuncts(action.preconditions, bound),
            tuple(effects),
        )

    def _duration(self, interval: DurationInterval, bound: Bound) -> tuple[Formula, ...]:
        variable = Variable(DURATION)
        lower = self._expressions.expression(interval.lower, bound)
        upper = self._expressions.expression(interval.upper, bound)
        if interval.lower == interval.upper:
            return (Comparison("=", variable, lower),)
        left = ">" if interval.is_left_open() else ">="
        right = "<" if interval.is_right_open() else "<="
        return Comparison(left, variable, lower), Comparison(right, variable, upper)

    def _conditions(self, action: Transition, bound: Bound) -> Iterator[Formula]:
        for interval, nodes in action.conditions.items():
            for node in self._expressions.conjuncts(nodes, bound):
                for time in self._times(interval):
                    yield Timed(time, node)

    def _times(self, interval: TimeInterval) -> Iterator[str]:
        lower, upper = self._time(interval.lower), self._time(interval.upper)
        if lower == upper:
            yield lower
            return
        if (lower, upper) != (AT_START, AT_END):
            raise self._expressions.unsupported(interval, "it ends before it starts")
        if not interval.is_left_open():
            yield AT_START
        yield OVER_ALL
        if not interval.is_right_open():
            yield AT_END

    def _time(self, timing: Timing) -> str:
        from unified_planning.model.timing import TimepointKind

        times = {TimepointKind.START: AT_START, TimepointKind.END: AT_END}
        if timing.delay != 0 or timing.timepoint.kind not in times:
            reason = "a time in an action is its start or its end"
            raise self._expressions.unsupported(f"time {timing}", reason)
        return times[timing.timepoint.kind]

    def _effects(self, action: Transition, bound: Bound) -> Iterator[Formula]:
        for effect in action.effects:
            yield from self.effect(effect, None, bound)

    def _durative_effects(self, action: Transition, bound: Bound) -> Iterator[Formula]:
        for timing, effects in action.effects.items():
            for effect in effects:
                yield from self.effect(effect, self._time(timing), bound)
        for interval, effects in action.continuous_effects.items():
            if list(self._times(interval)) != [AT_START, OVER_ALL, AT_END]:
                reason = "a continuous effect lasts throughout its action"
                raise self._expressions.unsupported(interval, reason)
            for effect in effects:
                yield from self.effect(effect, None, bound)

    def effect(self, effect: Effect, time: str | None, bound: Bound) -> Iterator[Formula]:
        """Convert an effect.

        Args:
            effect: the effect.
            time: when it happens in a durative action.
            bound: what it may mention.

        Yields:
            The effect; two of them where a truth value is assigned that a condition decides.
        """
        within = bound.bind(effect.forall)
        conditions = self._expressions.conjuncts([effect.condition], within)
        for extra, change in self._changes(effect, within):
            parts = tuple(
                part if time is None else Timed(time, part) for part in (*conditions, *extra)
            )
            formula: Formula = change if time is None else Timed(time, change)
            if parts:
                formula = When(parts[0] if len(parts) == 1 else And(parts), formula)
            if effect.forall:
                formula = Forall(self._expressions.typed(effect.forall, within), formula)
            yield formula

    def _changes(
        self, effect: Effect, bound: Bound
    ) -> Iterator[tuple[tuple[Formula, ...], Formula]]:
        expressions, target, value = self._expressions, effect.fluent, effect.value
        if target.type.is_bool_type():
            atom = expressions.formula(target, bound)
            if not value.is_bool_constant():
                condition = expressions.formula(value, bound)
                yield (condition,), atom
                yield (Not(condition),), Not(atom)
            else:
                yield (), atom if value.is_true() else Not(atom)
            return
        fluent = expressions.fluent(target, bound)
        if target.type.is_user_type():
            yield (), Assign("assign", fluent, expressions.term(value, bound))
            return
        amount = expressions.expression(value, bound)
        if effect.is_continuous_increase() or effect.is_continuous_decrease():
            operator = "increase" if effect.is_continuous_increase() else "decrease"
            yield (), Assign(operator, fluent, Arithmetic("*", (ContinuousTime(), amount)))
        elif effect.is_assignment():
            yield (), Assign("assign", fluent, amount)
        else:
            yield (), Assign("increase" if effect.is_increase() else "decrease", fluent, amount)
