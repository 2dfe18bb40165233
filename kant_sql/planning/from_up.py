"""Conversion of a problem of unified-planning to documents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING

from ..arguments import expect
from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidArgumentError, UnsupportedConstructError
from ..pddl import document as pddl
from ..pddl.requirements import used_requirements
from . import names as n

if TYPE_CHECKING:
    from unified_planning import model as up
    from unified_planning.model import Problem as UpProblem
    from unified_planning.model.timing import TimeInterval

# The names in PDDL of the parameters and variables in scope.
Bound = dict["up.Parameter | up.Variable", str]
_KINDS = {name: kind for kind, name in n.ACTION_CLASSES.items()}
_ARITHMETIC = {name.upper(): sign for sign, name in n.UP_ARITHMETIC.items()}
_COMPARISONS = {name.upper(): sign for sign, name in n.UP_COMPARISONS.items()}
_CONNECTIVES: dict[str, Callable[..., f.Formula]] = {
    "AND": lambda *parts: f.And(parts),
    "OR": lambda *parts: f.Or(parts),
    "NOT": f.Not,
    "IMPLIES": f.Imply,
    "IFF": lambda left, right: f.And((f.Imply(left, right), f.Imply(right, left))),
}
_TIMES = {"START": f.AT_START, "END": f.AT_END}
_PREFERENCE = "goal-"


def bind(bound: Bound, variables: Iterable[up.Parameter | up.Variable]) -> Bound:
    """Bind more variables to unused names."""
    names = dict(bound)
    for variable in variables:
        taken = {fold(name) for name in names.values()}
        names[variable] = n.unused_name(n.pddl_name(n.VARIABLE, variable.name), taken)
    return names


def category_of(fluent: up.Fluent) -> str:
    """Return the category of a fluent in PDDL."""
    return n.PREDICATE if fluent.type.is_bool_type() else n.FUNCTION


class PddlExpressions:
    """Converts expressions of one problem."""

    def __init__(self) -> None:
        self.names = n.PddlNames()
        self.where = "the problem"

    def unsupported(self, construct: object, reason: str) -> UnsupportedConstructError:
        """Make the error for a construct that PDDL cannot express."""
        return n.unsupported("PDDL", construct, self.where, reason)

    def type_name(self, type_: up.Type) -> str:
        """Return the name of a type."""
        if not type_.is_user_type():
            raise self.unsupported(f"a parameter of type {type_}", "parameters are objects")
        if type_.father is None and fold(type_.name) == ROOT_TYPE:
            return ROOT_TYPE
        return self.names.of(n.TYPE, type_.name)

    def typed(
        self, variables: Iterable[up.Parameter | up.Variable], bound: Bound
    ) -> tuple[f.TypedName, ...]:
        """Write variables with their types."""
        return tuple(f.TypedName(bound[one], (self.type_name(one.type),)) for one in variables)

    def conjuncts(self, nodes: Iterable[up.FNode], bound: Bound) -> tuple[f.Formula, ...]:
        """Convert conditions to a list of conjuncts."""
        found: list[f.Formula] = []
        for node in nodes:
            if node.is_and():
                found.extend(self.conjuncts(node.args, bound))
            elif not node.is_true():
                found.append(self.formula(node, bound))
        return tuple(found)

    def formula(self, node: up.FNode, bound: Bound) -> f.Formula:
        """Convert a condition or a constraint."""
        kind = node.node_type.name
        if kind in {"FORALL", "EXISTS"}:
            within = bind(bound, node.variables())
            quantifier = f.Forall if kind == "FORALL" else f.Exists
            variables = self.typed(node.variables(), within)
            return quantifier(variables, self.formula(node.arg(0), within))
        if kind == "BOOL_CONSTANT":
            return f.And() if node.is_true() else f.Or()
        if kind == "EQUALS" and node.arg(0).type.is_user_type():
            return f.Equal(*self.terms(node, bound))
        if kind in _COMPARISONS:
            left, right = (self.expression(part, bound) for part in node.args)
            return f.Comparison(_COMPARISONS[kind], left, right)
        if kind == "FLUENT_EXP":
            name = self.names.of(n.PREDICATE, node.fluent().name)
            return f.Atom(name, self.terms(node, bound))
        modal = kind.lower().replace("_", "-")
        if kind not in _CONNECTIVES and modal not in n.SHARED_MODALS:
            raise self.unsupported(node, "it is not a formula of PDDL")
        parts = tuple(self.formula(part, bound) for part in node.args)
        if modal in n.SHARED_MODALS:
            return f.Modal(modal, (), parts)
        return _CONNECTIVES[kind](*parts)

    def terms(self, node: up.FNode, bound: Bound) -> tuple[f.Term, ...]:
        """Convert the arguments of a node."""
        return tuple(self.term(part, bound) for part in node.args)

    def term(self, node: up.FNode, bound: Bound) -> f.Term:
        """Convert a term."""
        if node.is_object_exp():
            return f.Constant(self.names.of(n.OBJECT, node.object().name))
        if node.type.is_user_type():
            if node.is_parameter_exp():
                return f.Variable(bound[node.parameter()])
            if node.is_variable_exp():
                return f.Variable(bound[node.variable()])
            if node.is_fluent_exp():
                return self.fluent(node, bound)
        raise self.unsupported(node, "it is not an object")

    def fluent(self, node: up.FNode, bound: Bound) -> f.Fluent:
        """Convert a numeric or object fluent."""
        return f.Fluent(self.names.of(n.FUNCTION, node.fluent().name), self.terms(node, bound))

    def expression(self, node: up.FNode, bound: Bound) -> f.Expression:
        """Convert a numeric expression."""
        kind = node.node_type.name
        if node.is_int_constant() or node.is_real_constant():
            return n.number(node.constant_value())
        if node.is_fluent_exp() and not node.type.is_user_type():
            return self.fluent(node, bound)
        if kind in _ARITHMETIC:
            operands = tuple(self.expression(part, bound) for part in node.args)
            return f.Arithmetic(_ARITHMETIC[kind], operands)
        raise self.unsupported(node, "it is not a number")


class PddlActions(PddlExpressions):
    """Converts also the actions of a problem."""

    def action(self, action: up.Transition, cost: up.FNode | None) -> pddl.Action:
        """Convert an action, a process or an event."""
        self.where = f"action {action.name}"
        kind = _KINDS.get(type(action).__name__)
        if kind is None:
            raise self.unsupported(type(action).__name__, "PDDL has no such action")
        timed = kind == pddl.DURATIVE_ACTION
        simulated = "simulated_effects" if timed else "simulated_effect"
        if getattr(action, simulated, None) if kind != pddl.PROCESS else None:
            raise self.unsupported("a simulated effect", "its meaning is a program")
        bound = bind({}, action.parameters)
        effects = [*(self._durative_effects if timed else self._effects)(action, bound)]
        if cost is not None:
            value = self.expression(cost, bound)
            increase = f.Assign("increase", f.Fluent(f.TOTAL_COST), value)
            effects.append(f.Timed(f.AT_END, increase) if timed else increase)
        return pddl.Action(
            kind,
            self.names.of(kind, action.name),
            self.typed(action.parameters, bound),
            self._duration(action.duration, bound) if timed else (),
            tuple(self._conditions(action, bound))
            if timed
            else self.conjuncts(action.preconditions, bound),
            tuple(effects),
        )

    def _duration(self, interval: up.DurationInterval, bound: Bound) -> tuple[f.Formula, ...]:
        variable = f.Variable(f.DURATION)
        lower = self.expression(interval.lower, bound)
        upper = self.expression(interval.upper, bound)
        if interval.lower == interval.upper:
            return (f.Comparison("=", variable, lower),)
        left = ">" if interval.is_left_open() else ">="
        right = "<" if interval.is_right_open() else "<="
        return f.Comparison(left, variable, lower), f.Comparison(right, variable, upper)

    def _conditions(self, action: up.Transition, bound: Bound) -> Iterator[f.Formula]:
        for interval, nodes in action.conditions.items():
            for node in self.conjuncts(nodes, bound):
                for time in self._times(interval):
                    yield f.Timed(time, node)

    def _times(self, interval: TimeInterval) -> Iterator[str]:
        lower, upper = self._time(interval.lower), self._time(interval.upper)
        if lower == upper:
            yield lower
            return
        if (lower, upper) != (f.AT_START, f.AT_END):
            raise self.unsupported(interval, "it ends before it starts")
        if not interval.is_left_open():
            yield f.AT_START
        yield f.OVER_ALL
        if not interval.is_right_open():
            yield f.AT_END

    def _time(self, timing: up.Timing) -> str:
        kind = timing.timepoint.kind.name
        if timing.delay != 0 or kind not in _TIMES:
            raise self.unsupported(f"time {timing}", "a time in an action is its start or its end")
        return _TIMES[kind]

    def _effects(self, action: up.Transition, bound: Bound) -> Iterator[f.Formula]:
        for effect in action.effects:
            yield from self.effect(effect, None, bound)

    def _durative_effects(self, action: up.Transition, bound: Bound) -> Iterator[f.Formula]:
        for timing, effects in action.effects.items():
            for effect in effects:
                yield from self.effect(effect, self._time(timing), bound)
        for interval, effects in action.continuous_effects.items():
            if list(self._times(interval)) != [f.AT_START, f.OVER_ALL, f.AT_END]:
                raise self.unsupported(interval, "a continuous effect lasts throughout its action")
            for effect in effects:
                yield from self.effect(effect, None, bound)

    def effect(self, effect: up.Effect, time: str | None, bound: Bound) -> Iterator[f.Formula]:
        """Convert an effect."""
        within = bind(bound, effect.forall)
        conditions = self.conjuncts([effect.condition], within)
        for extra, change in self._changes(effect, within):
            parts = tuple(
                part if time is None else f.Timed(time, part) for part in (*conditions, *extra)
            )
            formula: f.Formula = change if time is None else f.Timed(time, change)
            if parts:
                formula = f.When(parts[0] if len(parts) == 1 else f.And(parts), formula)
            if effect.forall:
                formula = f.Forall(self.typed(effect.forall, within), formula)
            yield formula

    def _changes(
        self, effect: up.Effect, bound: Bound
    ) -> Iterator[tuple[tuple[f.Formula, ...], f.Formula]]:
        target, value = effect.fluent, effect.value
        if target.type.is_bool_type():
            atom = self.formula(target, bound)
            if not value.is_bool_constant():
                condition = self.formula(value, bound)
                yield (condition,), atom
                yield (f.Not(condition),), f.Not(atom)
            else:
                yield (), atom if value.is_true() else f.Not(atom)
            return
        fluent = self.fluent(target, bound)
        if target.type.is_user_type():
            yield (), f.Assign("assign", fluent, self.term(value, bound))
            return
        amount = self.expression(value, bound)
        if effect.is_continuous_increase() or effect.is_continuous_decrease():
            amount = f.Arithmetic("*", (f.ContinuousTime(), amount))
        operator = "assign"
        if not effect.is_assignment():
            is_increase = effect.is_increase() or effect.is_continuous_increase()
            operator = "increase" if is_increase else "decrease"
        yield (), f.Assign(operator, fluent, amount)


def from_unified_planning(problem: UpProblem) -> tuple[pddl.Domain, pddl.Problem]:
    """Convert a problem of unified-planning to a domain and a problem of the same meaning.

    Names become names that the grammar of PDDL allows: `left arm` is `left_arm`. Predicates,
    functions and types get their category appended where only letter case distinguishes them from
    an element of another category.

    Returns:
        The domain, named after the problem with `-domain`, and the problem.

    Raises:
        PlannerMissingError: unified-planning is not installed.
        InvalidNameError: two elements of one category would get the same name in PDDL.
        UnsupportedConstructError: PDDL cannot express a construct exactly, or it is nested too
            deeply for unified-planning's own recursion; the message names it.
    """
    n.require_unified_planning()
    from unified_planning.model import AbstractProblem

    expected = "a problem of unified-planning"
    expect(problem, AbstractProblem, "the problem", InvalidArgumentError, expected)
    try:
        return PddlDocuments(problem).documents()
    except RecursionError as error:
        raise UnsupportedConstructError(
            f"problem {problem.name} has expressions that are nested too deeply for a conversion "
            "from unified-planning; give their parts fluents of their own"
        ) from error


class PddlDocuments(PddlActions):
    """One conversion of a problem."""

    def __init__(self, problem: up.Problem) -> None:
        super().__init__()
        self._problem = problem
        self._check()
        for category, name in _elements(problem):
            self.names.claim(category, name)
        if self._costs():
            self.names.claim(n.FUNCTION, f.TOTAL_COST)

    def _check(self) -> None:
        problem, unsupported = self._problem, self.unsupported
        if type(problem).__name__ != "Problem":
            raise unsupported(f"a {type(problem).__name__}", "only Problem has a counterpart")
        if problem.discrete_time or problem.self_overlapping:
            reason = "its time is continuous and an action does not overlap with itself"
            raise unsupported("this model of time", reason)
        if len(problem.quality_metrics) > 1:
            raise unsupported("several metrics", "a problem has one")

    def documents(self) -> tuple[pddl.Domain, pddl.Problem]:
        """Return the domain and the problem."""
        name = n.pddl_name("problem", self._problem.name or "problem")
        domain = self._domain(f"{name}-domain")
        nodes = f.walk(*pddl.formulas(domain))
        constants = {node.name for node in nodes if isinstance(node, f.Constant)}
        objects = [
            f.TypedName(self.names.of(n.OBJECT, item.name), self._type(item.type))
            for item in self._problem.all_objects
        ]
        facts, values = self._initial_state()
        if self._costs():
            values = (*values, pddl.FunctionValue(f.Fluent(f.TOTAL_COST), f.Number(0)))
        problem = pddl.Problem(
            name,
            domain.name,
            objects=tuple(item for item in objects if item.name not in constants),
            facts=facts,
            values=values,
            timed=tuple(self._timed()),
            metric=self._metric(),
        )
        problem = self._with_goals(problem)
        domain = replace(
            domain,
            constants=tuple(item for item in objects if item.name in constants),
            requirements=used_requirements(domain, problem=problem),
        )
        return domain, problem

    def _domain(self, name: str) -> pddl.Domain:
        names, problem, predicates, functions = self.names, self._problem, [], []
        for fluent in problem.fluents:
            self.where = f"fluent {fluent.name}"
            called = names.of(category_of(fluent), fluent.name)
            parameters = self.typed(fluent.signature, bind({}, fluent.signature))
            if fluent.type.is_bool_type():
                predicates.append(pddl.Predicate(called, parameters))
            elif fluent.type.is_user_type():
                functions.append(pddl.Function(called, parameters, self._type(fluent.type)))
            elif fluent.type.lower_bound is None and fluent.type.upper_bound is None:
                functions.append(pddl.Function(called, parameters))
            else:
                raise self.unsupported(
                    fluent, "a number has no bounds; compile with BOUNDED_TYPES_REMOVING first"
                )
        costs = self._costs()
        if costs:
            functions.append(pddl.Function(f.TOTAL_COST))
        return pddl.Domain(
            name,
            types=tuple(
                f.TypedName(
                    names.of(n.TYPE, type_.name),
                    (ROOT_TYPE,) if type_.father is None else self._type(type_.father),
                )
                for type_ in _types(problem)
            ),
            predicates=tuple(predicates),
            functions=tuple(functions),
            actions=tuple(
                self.action(action, costs.get(action.name))
                for action in (*problem.actions, *problem.processes, *problem.events)
            ),
        )

    def _type(self, type_: object) -> tuple[str, ...]:
        return (self.type_name(type_),)

    def _costs(self) -> dict[str, up.FNode]:
        costs = {}
        manager = self._problem.environment.expression_manager
        for metric in self._problem.quality_metrics:
            for action in self._problem.actions:
                cost = None
                if metric.is_minimize_action_costs():
                    cost = metric.get_action_cost(action)
                elif metric.is_minimize_sequential_plan_length():
                    cost = manager.Int(1)
                if cost is not None and not (cost.is_constant() and cost.constant_value() == 0):
                    costs[action.name] = cost
        return costs

    def _timed(self) -> Iterator[f.TimedLiteral]:
        self.where = "the timed effects"
        for timing, effects in self._problem.timed_effects.items():
            time = n.number(timing.delay)
            for effect in effects:
                if timing.is_from_end() or not isinstance(time, f.Number):
                    raise self.unsupported(timing, "no decimal number is equal to it")
                constant = effect.value.is_constant() or effect.value.is_object_exp()
                if effect.is_conditional() or not constant or not effect.is_assignment():
                    reason = "a timed literal is unconditional and assigns a constant"
                    raise self.unsupported(effect, reason)
                for change in self.effect(effect, None, {}):
                    if not isinstance(change, f.Atom | f.Not | f.Assign):
                        raise self.unsupported(effect, "it is no single literal")
                    yield f.TimedLiteral(time, change)

    def _with_goals(self, problem: pddl.Problem) -> pddl.Problem:
        up_problem = self._problem
        self.where = "the goals"
        goals = list(self.conjuncts(up_problem.goals, {}))
        for interval, nodes in up_problem.timed_goals.items():
            if not (interval.lower == interval.upper and interval.lower.is_from_end()):
                raise self.unsupported(f"a goal in {interval}", "goals hold at the end")
            goals.extend(self.conjuncts(nodes, {}))
        gains = (one.goals for one in up_problem.quality_metrics if one.is_oversubscription())
        for number_, goal in enumerate(next(gains, ()), start=1):
            goals.append(f.Preference(f"{_PREFERENCE}{number_}", self.formula(goal, {})))
        self.where = "the trajectory constraints"
        constraints = self.conjuncts(up_problem.trajectory_constraints, {})
        return replace(problem, goal=tuple(goals), constraints=constraints)

    def _metric(self) -> f.Metric | None:
        self.where = "the metric"
        for metric in self._problem.quality_metrics:
            if metric.is_minimize_makespan():
                return f.Metric("minimize", f.Fluent(f.TOTAL_TIME))
            if metric.is_minimize_action_costs() or metric.is_minimize_sequential_plan_length():
                return f.Metric("minimize", f.Fluent(f.TOTAL_COST)) if self._costs() else None
            if metric.is_oversubscription():
                terms: tuple[f.Expression, ...] = tuple(
                    f.Arithmetic("*", (n.number(gain), f.IsViolated(f"{_PREFERENCE}{position}")))
                    for position, gain in enumerate(metric.goals.values(), start=1)
                )
                if not terms:
                    return None
                sum_ = terms[0] if len(terms) == 1 else f.Arithmetic("+", terms)
                return f.Metric("minimize", sum_)
            if metric.is_temporal_oversubscription():
                raise self.unsupported(metric, "a preferred goal has no time")
            sense = "maximize" if metric.is_maximize_expression_on_final_state() else "minimize"
            return f.Metric(sense, self.expression(metric.expression, {}))
        return None

    def _initial_state(self) -> tuple[tuple[f.Atom, ...], tuple[pddl.FunctionValue, ...]]:
        self.where = "the initial state"
        facts, values = [], []
        for fluent in self._problem.fluents:
            for target, value in self._values(fluent):
                if fluent.type.is_bool_type():
                    fact = self.formula(target, {})
                    if value.is_true() and isinstance(fact, f.Atom):
                        facts.append(fact)
                    continue
                values.append(
                    pddl.FunctionValue(self.fluent(target, {}), self._value(value, fluent))
                )
        return tuple(facts), tuple(values)

    def _value(self, value: up.FNode, fluent: up.Fluent) -> f.Number | f.Constant:
        is_object = fluent.type.is_user_type()
        found = self.term(value, {}) if is_object else self.expression(value, {})
        if isinstance(found, f.Constant | f.Number):
            return found
        reason = "it is not an object" if is_object else "no decimal number is equal to it"
        raise self.unsupported(value, reason)

    def _values(self, fluent: up.Fluent) -> Iterator[tuple[up.FNode, up.FNode]]:
        from unified_planning.model.fluent import get_all_fluent_exp

        problem = self._problem
        given = problem.explicit_initial_values.items()
        explicit = {target: value for target, value in given if target.fluent() == fluent}
        default = problem.fluents_defaults.get(fluent)
        if default is not None and not default.is_false():
            for target in get_all_fluent_exp(problem, fluent):
                yield target, explicit.get(target, default)
            return
        if fluent.type.is_bool_type() and default is None:
            sizes = (len(list(problem.objects(part.type))) for part in fluent.signature)
            if len(explicit) != prod(sizes):
                reason = "atoms that are not listed are false; give it a default initial value"
                raise self.unsupported(f"unknown values of {fluent.name}", reason)
        yield from explicit.items()


def _types(problem: up.Problem) -> Iterator[up.Type]:
    for type_ in problem.user_types:
        if type_.father is not None or fold(type_.name) != ROOT_TYPE:
            yield type_


def _elements(problem: up.Problem) -> Iterator[tuple[str, str]]:
    """Yield the category and the name of each element."""
    yield from ((n.OBJECT, item.name) for item in problem.all_objects)
    for action in (*problem.actions, *problem.processes, *problem.events):
        yield _KINDS.get(type(action).__name__, pddl.ACTION), action.name
    yield from ((category_of(fluent), fluent.name) for fluent in problem.fluents)
    yield from ((n.TYPE, type_.name) for type_ in _types(problem))
