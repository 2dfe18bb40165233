"""Actions, processes and events with their effects and durations, converted to unified-planning."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

from ..dto import formulas as f
from ..dto.lexical import fold
from ..pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS, Action
from ..pddl.requirements import functions_in
from .names import ACTION_CLASSES
from .up_formulas import Bindings, ConversionContext, UpConverter, UpFormulas, UpPreferences

if TYPE_CHECKING:
    from unified_planning.model import DurationInterval, DurativeAction, FNode, Timing, Transition
    from unified_planning.model import Variable as UpVariable
    from unified_planning.model.types import Type


class UpDurations(UpConverter):
    """Converts the constraints on a duration."""

    def interval(self, action: Action, scope: Bindings, formulas: UpFormulas) -> DurationInterval:
        """Convert the constraints on the duration of an action."""
        from unified_planning.model import DurationInterval

        lower: list[tuple[FNode, bool]] = []
        upper: list[tuple[FNode, bool]] = []
        for operator, bound in self._bounds(action.duration):
            node = formulas.expression(bound, scope)
            if operator in {"=", ">", ">="}:
                lower.append((node, operator == ">"))
            if operator in {"=", "<", "<="}:
                upper.append((node, operator == "<"))
        if not upper:
            text = " ".join(map(str, action.duration)) or "a duration without a bound"
            raise self._unsupported(text, "the duration needs an upper bound; give it one")
        least, left = self._tightest(lower or [(self._manager.Int(0), False)], 1)
        most, right = self._tightest(upper, -1)
        return DurationInterval(least, most, left, right)

    def fixed(self, action: Action) -> f.Expression | None:
        """Return the value of a duration that is fixed when the action starts."""
        bounds = list(self._bounds(action.duration))
        return bounds[0][1] if len(bounds) == 1 and bounds[0][0] == "=" else None

    def remembered(self, made: DurativeAction, value: FNode) -> FNode:
        """Return a fluent that stores the duration of an action while it is running."""
        # The values in the duration may change before the action ends.
        from unified_planning.model import Fluent, Parameter, StartTiming

        context = self._context
        manager = context.environment.type_manager
        type_ = manager.IntType() if context.integers else manager.RealType()
        signature = [Parameter(one.name, one.type, one.environment) for one in made.parameters]
        name = context.names.unused(f"duration-of-{made.name}")
        fluent = Fluent(name, type_, signature, context.environment)
        context.problem.add_fluent(fluent, default_initial_value=self._manager.Int(0))
        arguments = [self._manager.ParameterExp(one) for one in made.parameters]
        node = self._manager.FluentExp(fluent, arguments)
        made.add_effect(StartTiming(), node, value)
        return node

    def _bounds(
        self, constraints: Iterable[f.Formula], time: str | None = None
    ) -> Iterator[tuple[str, f.Expression]]:
        for constraint in constraints:
            match constraint:
                case f.And(parts):
                    yield from self._bounds(parts, time)
                case f.Timed(when, inner):
                    yield from self._bounds([inner], when)
                case f.Comparison(operator, left, right):
                    if not _is_duration(left):
                        operator, left, right = f.MIRRORED[operator], right, left
                    if not _is_duration(left) or any(map(_is_duration, f.walk(right))):
                        raise self._unsupported(constraint, "it is not a bound of ?duration")
                    if time == f.AT_END and not self.is_static(right):
                        reason = "a bound that is only known at the end has no counterpart"
                        raise self._unsupported(constraint, reason)
                    yield operator, right
                case _:
                    raise self._unsupported(constraint, "it is not a bound of ?duration")

    def is_static(self, node: f.Expression) -> bool:
        """Return whether the value of a duration is the same in all states."""
        return functions_in(node) <= self._context.static

    def _tightest(self, bounds: list[tuple[FNode, bool]], sign: int) -> tuple[FNode, bool]:
        distinct = list(dict.fromkeys(bounds))
        if len(distinct) > 1 and not all(node.is_constant() for node, _ in distinct):
            text = " and ".join(str(node) for node, _ in distinct)
            raise self._unsupported(text, "a duration has one lower and one upper bound there")
        if len(distinct) == 1:
            return distinct[0]
        return max(distinct, key=lambda bound: (sign * bound[0].constant_value(), bound[1]))


def _is_duration(node: object) -> bool:
    return isinstance(node, f.Variable) and fold(node.name) == f.DURATION


@dataclass(frozen=True, slots=True)
class SingleEffect:
    """A single effect with its context."""

    scope: Bindings
    variables: tuple[UpVariable, ...] = ()  # the variables of its quantifiers
    # Its conditions, each with its time, if any, and its scope.
    conditions: tuple[tuple[str | None, f.Formula, Bindings], ...] = ()
    time: str | None = None  # the time of the effect; None without one, and for a continuous effect
    change: f.Atom | f.Not | f.Assign | None = None  # the literal or assignment


def _timed(
    condition: f.Formula, outer: SingleEffect
) -> Iterator[tuple[str | None, f.Formula, Bindings]]:
    match condition:
        case f.And(parts):
            for part in parts:
                yield from _timed(part, outer)
        case f.Timed(time, inner):
            yield time, inner, outer.scope
        case _:
            yield outer.time, condition, outer.scope


class UpEffects(UpConverter):
    """Splits effects into single effects, and converts their parts."""

    def __init__(self, context: ConversionContext, formulas: UpFormulas) -> None:
        super().__init__(context)
        self._formulas = formulas

    def split(self, effect: f.Formula, outer: SingleEffect) -> Iterator[SingleEffect]:
        """Split an effect into single effects."""
        match effect:
            case f.And(parts):
                for part in parts:
                    yield from self.split(part, outer)
            case f.Forall(names, inner):
                for variables, scope in self._formulas.variables(names, outer.scope):
                    around = replace(outer, scope=scope, variables=outer.variables + variables)
                    yield from self.split(inner, around)
            case f.When(condition, inner):
                conditions = (*outer.conditions, *_timed(condition, outer))
                yield from self.split(inner, replace(outer, conditions=conditions))
            case f.Timed(time, inner) if outer.time is None:
                yield from self.split(inner, replace(outer, time=time))
            case f.Atom() | f.Assign() | f.Not(f.Atom()):
                yield replace(outer, change=effect)
            case _:
                raise self._unsupported(effect, "it is not an effect")

    def condition(self, effect: SingleEffect) -> FNode:
        """Convert the condition of an effect."""
        for time, condition, _ in effect.conditions:
            if time != effect.time:
                reason = "an effect whose condition has another time than itself has no counterpart"
                raise self._unsupported(condition, reason)
        formula = self._formulas.formula
        return self._manager.And([formula(one, scope) for _, one, scope in effect.conditions])

    def target(self, effect: SingleEffect) -> FNode:
        """Convert the fluent that an effect changes."""
        change = effect.change
        fluent = change.fluent if isinstance(change, f.Assign) else _atom(change)
        if f.mentions(f.Fluent, *fluent.terms):
            reason = "an effect on what another fluent denotes has no counterpart"
            raise self._unsupported(change, reason)
        if isinstance(fluent, f.Atom):
            return self._formulas.formula(fluent, effect.scope)
        return self._formulas.fluent(fluent, effect.scope)

    def value(self, effect: SingleEffect, target: FNode) -> tuple[str, FNode]:
        """Return the operator and the value of an effect."""
        change = effect.change
        if not isinstance(change, f.Assign):
            return "assign", self._manager.Bool(isinstance(change, f.Atom))
        if target.type.is_user_type():
            return "assign", self._object(change, effect.scope, target)
        value = self.number(effect)
        if change.operator == "scale-up":
            return "assign", self._manager.Times(target, value)
        if change.operator == "scale-down":
            return "assign", self._manager.Div(target, value)
        return change.operator, value

    def number(self, effect: SingleEffect) -> FNode:
        """Convert the value of an assignment."""
        return self._formulas.expression(number_of(effect.change), effect.scope)

    def _object(self, change: f.Assign, scope: Bindings, target: FNode) -> FNode:
        if not isinstance(change.value, f.Constant | f.Variable | f.Fluent):
            raise self._unsupported(change, "it assigns what is not an object")
        value = self._formulas.term(change.value, scope)
        if not target.type.is_compatible(value.type):
            reason = f"{value} is of type {value.type}, not of {target.type}"
            raise self._unsupported(change, reason)
        return value

    def repeats(self, effect: SingleEffect, nodes: Iterable[FNode]) -> int:
        """Count the occurrences of an effect: unified-planning drops unmentioned variables."""
        oracle = self._context.environment.free_vars_oracle
        mentioned = {variable for node in nodes for variable in oracle.get_free_variables(node)}
        count = 1
        for variable in effect.variables:
            if variable not in mentioned:
                count *= sum(
                    variable.type.is_compatible(item.type)
                    for item in self._context.objects.values()
                )
        return count

    def rate(self, effect: SingleEffect) -> FNode:
        """Convert the rate of a continuous effect."""
        if getattr(effect.change, "operator", None) not in {"increase", "decrease"}:
            raise self._unsupported(effect.change, "it gives no rate of change")
        return self._rate(number_of(effect.change), effect)

    def _rate(self, node: f.Expression, effect: SingleEffect) -> FNode:
        match node:
            case f.ContinuousTime():
                return self._manager.Int(1)
            case f.Arithmetic("*", operands):
                timed = [part for part in operands if f.mentions(f.ContinuousTime, part)]
                if len(timed) == 1:
                    factors = [
                        self._formulas.expression(part, effect.scope)
                        for part in operands
                        if part is not timed[0]
                    ]
                    if isinstance(timed[0], f.ContinuousTime):
                        return self._manager.Times(factors)
                    return self._manager.Times(self._rate(timed[0], effect), *factors)
            case f.Arithmetic("/", (dividend, by)) if not f.mentions(f.ContinuousTime, by):
                return self._manager.Div(
                    self._rate(dividend, effect), self._formulas.expression(by, effect.scope)
                )
        raise self._unsupported(effect.change, "it is not a multiple of #t")


def number_of(change: f.Atom | f.Not | f.Assign | None) -> f.Expression:
    """Return the value of an assignment to a numeric fluent."""
    assert isinstance(change, f.Assign), "only an assignment has a number"
    assert not isinstance(change.value, f.Constant), "a number's fluent is assigned a number"
    return change.value


def _atom(change: f.Atom | f.Not | None) -> f.Atom:
    inner = change.formula if isinstance(change, f.Not) else change
    assert isinstance(inner, f.Atom), "an effect is an atom, its negation or an assignment"
    return inner


class UpActions(UpConverter):
    """Converts actions; one with `either` becomes one action for each choice of types."""

    def __init__(
        self, context: ConversionContext, formulas: UpFormulas, preferences: UpPreferences
    ) -> None:
        super().__init__(context)
        self._formulas, self._preferences = formulas, preferences
        self._durations = UpDurations(context)
        self._effects = UpEffects(context, formulas)
        self._names: set[str] = set()
        self._costs: dict[str, FNode] = {}

    def costs(self) -> dict[Transition, FNode]:
        """Return the cost of each action."""
        return {
            made: self._costs[made.name]
            for made in self._context.problem.actions
            if made.name in self._costs
        }

    def add(self, action: Action) -> None:
        """Add an action to the problem."""
        parameters = [fold(parameter.name) for parameter in action.parameters]
        if len(set(parameters)) != len(parameters):
            text = " ".join(f"?{name}" for name in parameters)
            raise self._unsupported(text, "a parameter is named twice; rename one")
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

        class_ = ACTION_CLASSES.get(action.kind, ACTION_CLASSES[ACTION])
        named = zip((part.name for part in action.parameters), types, strict=True)
        made = getattr(model, class_)(name, OrderedDict(named), self._context.environment)
        scope = Bindings()
        for parameter in made.parameters:
            node = self._manager.ParameterExp(parameter)
            scope = scope.bind(parameter.name, node)
        later = scope
        if action.kind == DURATIVE_ACTION:
            made.set_duration_constraint(self._durations.interval(action, scope, self._formulas))
            scope, later = self._with_duration(action, made, scope)
        self._conditions(action, made, scope)
        for effect in action.effect:
            at_start = self._effects.split(effect, SingleEffect(scope))
            after = self._effects.split(effect, SingleEffect(later))
            for early, late in zip(at_start, after, strict=True):
                self._effect(action, made, early if early.time == f.AT_START else late)
        self._register(action, made)

    def _with_duration(
        self, action: Action, made: DurativeAction, scope: Bindings
    ) -> tuple[Bindings, Bindings]:
        """Bind `?duration`, at the start and later."""
        value = self._durations.fixed(action)
        if value is None or f.DURATION in scope.bound:
            return scope, scope
        node = self._formulas.expression(value, scope)
        early = scope.bind(f.DURATION, node)
        if self._durations.is_static(value) or not any(map(_is_duration, f.walk(*action.effect))):
            return early, early
        return early, scope.bind(f.DURATION, self._durations.remembered(made, node))

    def _register(self, action: Action, made: Transition) -> None:
        problem = self._context.problem
        if action.kind == PROCESS:
            problem.add_process(made)
        elif action.kind == EVENT:
            problem.add_event(made)
        else:
            if made.name in self._names:
                raise self._unsupported(made.name, "two actions have this name")
            # `add_action` compares with all other actions, which is too slow for thousands.
            self._names.add(made.name)
            problem.actions.append(made)
            for parameter in made.parameters:
                problem._add_user_type(parameter.type)
            self._context.names.action_of[made.name] = action.name

    def _conditions(self, action: Action, made: Transition, scope: Bindings) -> None:
        for condition in self._preferences.without(action.condition):
            if action.kind != DURATIVE_ACTION:
                made.add_precondition(self._formulas.formula(condition, scope))
                continue
            for time, node in self._timed(condition, scope):
                made.add_condition(self._interval(time), node)

    def _timed(self, condition: f.Formula, scope: Bindings) -> Iterator[tuple[str, FNode]]:
        match condition:
            case f.And(parts):
                for part in parts:
                    yield from self._timed(part, scope)
            case f.Forall(names, inner):
                for variables, within in self._formulas.variables(names, scope):
                    for time, node in self._timed(inner, within):
                        yield time, self._formulas.quantified(node, variables)
            case f.Timed(time, inner):
                yield time, self._formulas.formula(inner, scope)
            case _:
                raise self._unsupported(condition, "a condition of a durative action needs a time")

    def _interval(self, time: str) -> object:
        from unified_planning import model

        if point := self._point(time):
            return model.TimePointInterval(point)
        return model.OpenTimeInterval(model.StartTiming(), model.EndTiming())

    def _effect(self, action: Action, made: Transition, effect: SingleEffect) -> None:
        change = effect.change
        if isinstance(change, f.Assign) and f.mentions(f.ContinuousTime, change.value):
            self._continuous(action, made, effect)
            return
        if action.kind != DURATIVE_ACTION and effect.time is not None:
            raise self._unsupported(change, "only a durative action's effects have a time")
        if action.kind == PROCESS:
            raise self._unsupported(change, "an effect of a process is continuous")
        if self._context.costed and _is_cost(change):
            self._cost(made, effect)
            return
        condition, target = self._effects.condition(effect), self._effects.target(effect)
        operator, value = self._effects.value(effect, target)
        repeats = self._effects.repeats(effect, [condition, target, value])
        if repeats == 0 or condition.is_false():
            return
        if repeats > 1 and isinstance(change, f.Assign) and change.operator != "assign":
            if operator == "assign":
                raise self._unsupported(change, "it occurs more than once")
            value = self._manager.Times(repeats, value)
        timing = []
        if action.kind == DURATIVE_ACTION:
            timing = [self._point(effect.time)]
            if timing == [None]:
                reason = "an effect of a durative action is at start or at end"
                raise self._unsupported(change, reason)
        add = {
            "assign": made.add_effect,
            "increase": made.add_increase_effect,
            "decrease": made.add_decrease_effect,
        }[operator]
        add(*timing, target, value, condition, effect.variables)

    def _point(self, time: str | None) -> Timing | None:
        from unified_planning import model

        kinds = {f.AT_START: model.StartTiming, f.AT_END: model.EndTiming}
        return kinds[time]() if time in kinds else None

    def _cost(self, made: Transition, effect: SingleEffect) -> None:
        cost = self._effects.number(effect)
        earlier = self._costs.get(made.name)
        self._costs[made.name] = cost if earlier is None else self._manager.Plus(earlier, cost)

    def _continuous(self, action: Action, made: Transition, effect: SingleEffect) -> None:
        from unified_planning import model

        change = effect.change
        assert isinstance(change, f.Assign)
        if action.kind not in {PROCESS, DURATIVE_ACTION}:
            raise self._unsupported(change, "an instantaneous action takes no time")
        if effect.conditions or effect.variables:
            reason = "a continuous effect with a condition or a quantifier has no counterpart"
            raise self._unsupported(change, reason)
        target, rate = self._effects.target(effect), self._effects.rate(effect)
        interval = []
        if action.kind == DURATIVE_ACTION:
            if effect.time is not None:
                raise self._unsupported(change, "it has a time of its own")
            interval = [model.ClosedTimeInterval(model.StartTiming(), model.EndTiming())]
        if change.operator == "decrease":
            made.add_decrease_continuous_effect(*interval, target, rate)
        else:
            made.add_increase_continuous_effect(*interval, target, rate)


def _is_cost(change: f.Atom | f.Not | f.Assign | None) -> bool:
    return isinstance(change, f.Assign) and fold(change.fluent.function) == f.TOTAL_COST
