"""Actions, durative actions, processes and events as those of unified-planning."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING

from ..dto.formula import (
    AT_END,
    AT_START,
    And,
    Assign,
    Atom,
    Forall,
    Formula,
    Not,
    Timed,
)
from ..dto.name import fold
from ..pddl.document import DURATIVE_ACTION, EVENT, PROCESS, Action
from .context import Context, Scope
from .cost import TOTAL_COST
from .up_continuous import Rates, is_continuous
from .up_duration import DURATION, duration, fixed
from .up_effects import Change, Effect, single_effects
from .up_formulas import Formulas
from .up_preferences import Preferences

if TYPE_CHECKING:
    from unified_planning.model import FNode, Timing, Transition
    from unified_planning.model.types import Type


class Actions:
    """Converts actions; one with `either` becomes one action for each choice of types."""

    def __init__(self, context: Context, formulas: Formulas, preferences: Preferences) -> None:
        """Convert within a context.

        Args:
            context: the conversion.
            formulas: what converts formulas.
            preferences: which preferences count.
        """
        self._context, self._formulas, self._preferences = context, formulas, preferences
        self._change, self._rates = Change(context, formulas), Rates(context, formulas)
        self._names: set[str] = set()
        self._costs: dict[str, FNode] = {}

    def costs(self) -> dict[Transition, FNode]:
        """Give what the actions add to the total cost.

        Returns:
            The cost of each action of the problem that has one.
        """
        return {
            made: self._costs[made.name]
            for made in self._context.problem.actions
            if made.name in self._costs
        }

    def add(self, action: Action) -> None:
        """Add an action to the problem.

        Args:
            action: the action of the document.

        Raises:
            UnsupportedConstructError: something in it has no exact counterpart.
        """
        parameters = [fold(parameter.name) for parameter in action.parameters]
        if len(set(parameters)) != len(parameters):
            text = " ".join(f"?{name}" for name in parameters)
            raise self._context.unsupported(text, "a parameter is named twice; rename one")
        branches = [self._context.types.branches(part.types) for part in action.parameters]
        name = self._context.names.of(action.kind, action.name)
        if all(len(types) == 1 for types in branches):
            self._add(action, name, [types[0] for types in branches])
            return
        for chosen in product(*branches):
            split = [
                types.name for types, all_ in zip(chosen, branches, strict=True) if len(all_) > 1
            ]
            self._add(action, self._context.names.unused("_".join([name, *split])), list(chosen))

    def _add(self, action: Action, name: str, types: list[Type]) -> None:
        from unified_planning import model

        classes = {
            DURATIVE_ACTION: model.DurativeAction,
            PROCESS: model.Process,
            EVENT: model.Event,
        }
        named = zip((part.name for part in action.parameters), types, strict=True)
        made = classes.get(action.kind, model.InstantaneousAction)(
            name, OrderedDict(named), self._context.environment
        )
        scope = Scope()
        for parameter in made.parameters:
            node = self._context.environment.expression_manager.ParameterExp(parameter)
            scope = scope.bind(parameter.name, node)
        if action.kind == DURATIVE_ACTION:
            made.set_duration_constraint(duration(action, scope, self._context, self._formulas))
            value = fixed(action, self._context)
            if value is not None and DURATION not in scope.bound:
                scope = scope.bind(DURATION, self._formulas.expression(value, scope))
        self._conditions(action, made, scope)
        for effect in action.effect:
            outer = Effect(scope)
            for single in single_effects(effect, self._context, self._formulas, outer):
                self._effect(action, made, single)
        self._register(action, made)

    def _register(self, action: Action, made: Transition) -> None:
        problem = self._context.problem
        if action.kind == PROCESS:
            problem.add_process(made)
        elif action.kind == EVENT:
            problem.add_event(made)
        else:
            if made.name in self._names:
                raise self._context.unsupported(made.name, "two actions have this name")
            # `add_action` looks at each action before: too slow for thousands of them.
            self._names.add(made.name)
            problem.actions.append(made)
            for parameter in made.parameters:
                problem._add_user_type(parameter.type)
            self._context.names.stands_for(made.name, action.name)

    def _conditions(self, action: Action, made: Transition, scope: Scope) -> None:
        for condition in self._preferences.without(action.condition):
            if action.kind != DURATIVE_ACTION:
                made.add_precondition(self._formulas.formula(condition, scope))
                continue
            for time, node in self._timed(condition, scope):
                made.add_condition(self._interval(time), node)

    def _timed(self, condition: Formula, scope: Scope) -> Iterator[tuple[str, FNode]]:
        match condition:
            case And(parts):
                for part in parts:
                    yield from self._timed(part, scope)
            case Forall(names, inner):
                for variables, within in self._formulas.variables(names, scope):
                    for time, node in self._timed(inner, within):
                        quantify = self._context.environment.expression_manager.Forall
                        yield time, quantify(node, *variables) if variables else node
            case Timed(time, inner):
                yield time, self._formulas.formula(inner, scope)
            case _:
                reason = "a condition of a durative action needs a time"
                raise self._context.unsupported(condition, reason)

    def _interval(self, time: str) -> object:
        from unified_planning import model

        start, end = model.StartTiming(), model.EndTiming()
        if time == AT_START:
            return model.TimePointInterval(start)
        if time == AT_END:
            return model.TimePointInterval(end)
        return model.OpenTimeInterval(start, end)

    def _effect(self, action: Action, made: Transition, effect: Effect) -> None:
        if is_continuous(effect):
            self._continuous(action, made, effect)
            return
        change = effect.change
        if action.kind != DURATIVE_ACTION and effect.time is not None:
            raise self._context.unsupported(change, "only a durative action's effects have a time")
        if action.kind == PROCESS:
            raise self._context.unsupported(change, "an effect of a process is continuous")
        if self._context.costed and _is_cost(change):
            self._cost(made, effect)
            return
        condition, target = self._change.condition(effect), self._change.target(effect)
        operator, value = self._change.value(effect, target)
        repeats = self._change.repeats(effect, [condition, target, value])
        if repeats == 0 or condition.is_false():
            return
        if repeats > 1 and isinstance(change, Assign) and change.operator != "assign":
            if operator == "assign":
                raise self._context.unsupported(change, "it happens more than once")
            value = self._context.environment.expression_manager.Times(repeats, value)
        timing = [self._timing(effect)] if action.kind == DURATIVE_ACTION else []
        add = {
            "assign": made.add_effect,
            "increase": made.add_increase_effect,
            "decrease": made.add_decrease_effect,
        }[operator]
        add(*timing, target, value, condition, effect.variables)

    def _timing(self, effect: Effect) -> Timing:
        from unified_planning import model

        if effect.time == AT_START:
            return model.StartTiming()
        if effect.time == AT_END:
            return model.EndTiming()
        reason = "an effect of a durative action is at start or at end"
        raise self._context.unsupported(effect.change, reason)

    def _cost(self, made: Transition, effect: Effect) -> None:
        manager = self._context.environment.expression_manager
        cost = self._change.number(effect)
        earlier = self._costs.get(made.name)
        self._costs[made.name] = cost if earlier is None else manager.Plus(earlier, cost)

    def _continuous(self, action: Action, made: Transition, effect: Effect) -> None:
        from unified_planning import model

        change = effect.change
        assert isinstance(change, Assign)
        if action.kind not in {PROCESS, DURATIVE_ACTION}:
            raise self._context.unsupported(change, "an instantaneous action takes no time")
        if effect.conditions or effect.variables:
            reason = "a continuous effect with a condition or a quantifier has no counterpart"
            raise self._context.unsupported(change, reason)
        target, rate = self._change.target(effect), self._rates.rate(effect)
        interval = []
        if action.kind == DURATIVE_ACTION:
            if effect.time is not None:
                raise self._context.unsupported(change, "it has a time of its own")
            interval = [model.ClosedTimeInterval(model.StartTiming(), model.EndTiming())]
        if change.operator == "decrease":
            made.add_decrease_continuous_effect(*interval, target, rate)
        else:
            made.add_increase_continuous_effect(*interval, target, rate)


def _is_cost(change: Atom | Not | Assign | None) -> bool:
    return isinstance(change, Assign) and fold(change.fluent.function) == TOTAL_COST
