"""The conversion of a problem of unified-planning to documents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from math import prod
from typing import TYPE_CHECKING

from ..arguments import expect
from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidArgumentError, UnsupportedConstructError
from ..pddl.document import (
    ACTION,
    DURATIVE_ACTION,
    EVENT,
    PROCESS,
    Action,
    Domain,
    Function,
    FunctionValue,
    Predicate,
    Problem,
)
from ..pddl.requirements import used_requirements
from .names import (
    FUNCTION,
    OBJECT,
    PREDICATE,
    SHARED_MODALS,
    TYPE,
    VARIABLE,
    PddlNames,
    number,
    pddl_name,
    require_unified_planning,
    unsupported,
    unused_name,
)

if TYPE_CHECKING:
    from unified_planning.model import (
        DurationInterval,
        Effect,
        FNode,
        Object,
        Parameter,
        Timing,
        Transition,
        Type,
    )
    from unified_planning.model import Fluent as UpFluent
    from unified_planning.model import Problem as UpProblem
    from unified_planning.model import Variable as UpVariable
    from unified_planning.model.timing import TimeInterval


@dataclass(frozen=True, slots=True)
class PddlVariables:
    """The parameters and variables in scope.

    Attributes:
        names: the name of each in PDDL.
    """

    names: dict[Parameter | UpVariable, str] = field(default_factory=dict)

    def bind(self, variables: Iterable[Parameter | UpVariable]) -> PddlVariables:
        """Bind more variables, under unused names."""
        names = dict(self.names)
        for variable in variables:
            taken = {fold(name) for name in names.values()}
            names[variable] = unused_name(pddl_name(VARIABLE, variable.name), taken)
        return PddlVariables(names)


def category_of(fluent: UpFluent) -> str:
    """Return what a fluent is in PDDL."""
    return PREDICATE if fluent.type.is_bool_type() else FUNCTION


class PddlExpressions:
    """Converts expressions of one problem."""

    def __init__(self, names: PddlNames) -> None:
        self._names = names
        self.where = "the problem"

    def unsupported(self, construct: object, reason: str) -> UnsupportedConstructError:
        """Make the error for a construct that PDDL cannot express."""
        return unsupported("PDDL", construct, self.where, reason)

    def type_name(self, type_: Type) -> str:
        """Return the name of a type."""
        if not type_.is_user_type():
            raise self.unsupported(f"a parameter of type {type_}", "parameters are objects")
        if type_.father is None and fold(type_.name) == ROOT_TYPE:
            return ROOT_TYPE
        return self._names.of(TYPE, type_.name)

    def typed(
        self, variables: Iterable[Parameter | UpVariable], bound: PddlVariables
    ) -> tuple[f.TypedName, ...]:
        """Write variables with their types."""
        return tuple(
            f.TypedName(bound.names[variable], (self.type_name(variable.type),))
            for variable in variables
        )

    def conjuncts(self, nodes: Iterable[FNode], bound: PddlVariables) -> tuple[f.Formula, ...]:
        """Convert conditions to a list of conjuncts."""
        found: list[f.Formula] = []
        for node in nodes:
            if node.is_and():
                found.extend(self.conjuncts(node.args, bound))
            elif not node.is_true():
                found.append(self.formula(node, bound))
        return tuple(found)

    def formula(self, node: FNode, bound: PddlVariables) -> f.Formula:
        """Convert a condition or a constraint."""
        from unified_planning.model import OperatorKind

        kind = node.node_type
        if kind in {OperatorKind.FORALL, OperatorKind.EXISTS}:
            within = bound.bind(node.variables())
            quantifier = f.Forall if kind == OperatorKind.FORALL else f.Exists
            variables = self.typed(node.variables(), within)
            return quantifier(variables, self.formula(node.arg(0), within))
        if kind == OperatorKind.BOOL_CONSTANT:
            return f.And() if node.is_true() else f.Or()
        if kind in {OperatorKind.LE, OperatorKind.LT} or (
            kind == OperatorKind.EQUALS and not node.arg(0).type.is_user_type()
        ):
            sign = {OperatorKind.LE: "<=", OperatorKind.LT: "<"}.get(kind, "=")
            left, right = (self.expression(part, bound) for part in node.args)
            return f.Comparison(sign, left, right)
        if kind == OperatorKind.EQUALS:
            return f.Equal(*(self.term(part, bound) for part in node.args))
        if kind == OperatorKind.FLUENT_EXP:
            terms = tuple(self.term(part, bound) for part in node.args)
            return f.Atom(self._names.of(PREDICATE, node.fluent().name), terms)
        return self._connective(node, bound)

    def _connective(self, node: FNode, bound: PddlVariables) -> f.Formula:
        from unified_planning.model import OperatorKind

        kind = node.node_type
        modal = kind.name.lower().replace("_", "-")
        connectives = {OperatorKind.AND, OperatorKind.OR, OperatorKind.NOT}
        connectives |= {OperatorKind.IMPLIES, OperatorKind.IFF}
        if kind not in connectives and modal not in SHARED_MODALS:
            raise self.unsupported(node, "it is no formula of PDDL")
        parts = tuple(self.formula(part, bound) for part in node.args)
        if modal in SHARED_MODALS:
            return f.Modal(modal, (), parts)
        if kind == OperatorKind.NOT:
            return f.Not(parts[0])
        if kind == OperatorKind.IMPLIES:
            return f.Imply(*parts)
        if kind == OperatorKind.IFF:
            return f.And((f.Imply(*parts), f.Imply(*reversed(parts))))
        return f.And(parts) if kind == OperatorKind.AND else f.Or(parts)

    def term(self, node: FNode, bound: PddlVariables) -> f.Term:
        """Convert a term."""
        if node.is_object_exp():
            return f.Constant(self._names.of(OBJECT, node.object().name))
        if node.type.is_user_type():
            if node.is_parameter_exp():
                return f.Variable(bound.names[node.parameter()])
            if node.is_variable_exp():
                return f.Variable(bound.names[node.variable()])
            if node.is_fluent_exp():
                return self.fluent(node, bound)
        raise self.unsupported(node, "it is no object")

    def fluent(self, node: FNode, bound: PddlVariables) -> f.Fluent:
        """Convert a numeric or object fluent."""
        terms = tuple(self.term(part, bound) for part in node.args)
        return f.Fluent(self._names.of(FUNCTION, node.fluent().name), terms)

    def expression(self, node: FNode, bound: PddlVariables) -> f.Expression:
        """Convert a numeric expression."""
        from unified_planning.model import OperatorKind

        operators = {
            OperatorKind.PLUS: "+",
            OperatorKind.MINUS: "-",
            OperatorKind.TIMES: "*",
            OperatorKind.DIV: "/",
        }
        if node.is_int_constant() or node.is_real_constant():
            return number(node.constant_value())
        if node.is_fluent_exp() and not node.type.is_user_type():
            return self.fluent(node, bound)
        if node.node_type in operators:
            operands = tuple(self.expression(part, bound) for part in node.args)
            return f.Arithmetic(operators[node.node_type], operands)
        raise self.unsupported(node, "it is no number")


class PddlActions:
    """Converts the actions of one problem."""

    def __init__(self, names: PddlNames, expressions: PddlExpressions) -> None:
        self._names, self._expressions = names, expressions

    def action(self, action: Transition, cost: FNode | None) -> Action:
        """Convert an action, a process or an event."""
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
        bound = PddlVariables().bind(action.parameters)
        timed = kind == DURATIVE_ACTION
        effects = list(
            self._durative_effects(action, bound) if timed else self._effects(action, bound)
        )
        if cost is not None:
            value = self._expressions.expression(cost, bound)
            increase = f.Assign("increase", f.Fluent(f.TOTAL_COST), value)
            effects.append(f.Timed(f.AT_END, increase) if timed else increase)
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

    def _duration(self, interval: DurationInterval, bound: PddlVariables) -> tuple[f.Formula, ...]:
        variable = f.Variable(f.DURATION)
        lower = self._expressions.expression(interval.lower, bound)
        upper = self._expressions.expression(interval.upper, bound)
        if interval.lower == interval.upper:
            return (f.Comparison("=", variable, lower),)
        left = ">" if interval.is_left_open() else ">="
        right = "<" if interval.is_right_open() else "<="
        return f.Comparison(left, variable, lower), f.Comparison(right, variable, upper)

    def _conditions(self, action: Transition, bound: PddlVariables) -> Iterator[f.Formula]:
        for interval, nodes in action.conditions.items():
            for node in self._expressions.conjuncts(nodes, bound):
                for time in self._times(interval):
                    yield f.Timed(time, node)

    def _times(self, interval: TimeInterval) -> Iterator[str]:
        lower, upper = self._time(interval.lower), self._time(interval.upper)
        if lower == upper:
            yield lower
            return
        if (lower, upper) != (f.AT_START, f.AT_END):
            raise self._expressions.unsupported(interval, "it ends before it starts")
        if not interval.is_left_open():
            yield f.AT_START
        yield f.OVER_ALL
        if not interval.is_right_open():
            yield f.AT_END

    def _time(self, timing: Timing) -> str:
        from unified_planning.model.timing import TimepointKind

        times = {TimepointKind.START: f.AT_START, TimepointKind.END: f.AT_END}
        if timing.delay != 0 or timing.timepoint.kind not in times:
            reason = "a time in an action is its start or its end"
            raise self._expressions.unsupported(f"time {timing}", reason)
        return times[timing.timepoint.kind]

    def _effects(self, action: Transition, bound: PddlVariables) -> Iterator[f.Formula]:
        for effect in action.effects:
            yield from self.effect(effect, None, bound)

    def _durative_effects(self, action: Transition, bound: PddlVariables) -> Iterator[f.Formula]:
        for timing, effects in action.effects.items():
            for effect in effects:
                yield from self.effect(effect, self._time(timing), bound)
        for interval, effects in action.continuous_effects.items():
            if list(self._times(interval)) != [f.AT_START, f.OVER_ALL, f.AT_END]:
                reason = "a continuous effect lasts throughout its action"
                raise self._expressions.unsupported(interval, reason)
            for effect in effects:
                yield from self.effect(effect, None, bound)

    def effect(self, effect: Effect, time: str | None, bound: PddlVariables) -> Iterator[f.Formula]:
        """Convert an effect."""
        within = bound.bind(effect.forall)
        conditions = self._expressions.conjuncts([effect.condition], within)
        for extra, change in self._changes(effect, within):
            parts = tuple(
                part if time is None else f.Timed(time, part) for part in (*conditions, *extra)
            )
            formula: f.Formula = change if time is None else f.Timed(time, change)
            if parts:
                formula = f.When(parts[0] if len(parts) == 1 else f.And(parts), formula)
            if effect.forall:
                formula = f.Forall(self._expressions.typed(effect.forall, within), formula)
            yield formula

    def _changes(
        self, effect: Effect, bound: PddlVariables
    ) -> Iterator[tuple[tuple[f.Formula, ...], f.Formula]]:
        expressions, target, value = self._expressions, effect.fluent, effect.value
        if target.type.is_bool_type():
            atom = expressions.formula(target, bound)
            if not value.is_bool_constant():
                condition = expressions.formula(value, bound)
                yield (condition,), atom
                yield (f.Not(condition),), f.Not(atom)
            else:
                yield (), atom if value.is_true() else f.Not(atom)
            return
        fluent = expressions.fluent(target, bound)
        if target.type.is_user_type():
            yield (), f.Assign("assign", fluent, expressions.term(value, bound))
            return
        amount = expressions.expression(value, bound)
        if effect.is_continuous_increase() or effect.is_continuous_decrease():
            operator = "increase" if effect.is_continuous_increase() else "decrease"
            yield (), f.Assign(operator, fluent, f.Arithmetic("*", (f.ContinuousTime(), amount)))
        elif effect.is_assignment():
            yield (), f.Assign("assign", fluent, amount)
        else:
            yield (), f.Assign("increase" if effect.is_increase() else "decrease", fluent, amount)


def initial_state(
    problem: UpProblem, expressions: PddlExpressions
) -> tuple[tuple[f.Atom, ...], tuple[FunctionValue, ...]]:
    """Convert the initial state."""
    facts, values = [], []
    for fluent in problem.fluents:
        for target, value in _values(problem, fluent, expressions):
            if fluent.type.is_bool_type():
                fact = expressions.formula(target, PddlVariables())
                if value.is_true() and isinstance(fact, f.Atom):
                    facts.append(fact)
                continue
            function = expressions.fluent(target, PddlVariables())
            values.append(FunctionValue(function, _value(value, fluent, expressions)))
    return tuple(facts), tuple(values)


def _value(value: FNode, fluent: UpFluent, expressions: PddlExpressions) -> f.Number | f.Constant:
    if fluent.type.is_user_type():
        item = expressions.term(value, PddlVariables())
        if isinstance(item, f.Constant):
            return item
        raise expressions.unsupported(value, "it is no object")
    number = expressions.expression(value, PddlVariables())
    if isinstance(number, f.Number):
        return number
    raise expressions.unsupported(value, "no decimal number is equal to it")


def _values(
    problem: UpProblem, fluent: UpFluent, expressions: PddlExpressions
) -> Iterator[tuple[FNode, FNode]]:
    from unified_planning.model.fluent import get_all_fluent_exp

    explicit = {
        target: value
        for target, value in problem.explicit_initial_values.items()
        if target.fluent() == fluent
    }
    default = problem.fluents_defaults.get(fluent)
    if default is not None and not default.is_false():
        for target in get_all_fluent_exp(problem, fluent):
            yield target, explicit.get(target, default)
        return
    if fluent.type.is_bool_type() and default is None:
        sizes = (len(list(problem.objects(part.type))) for part in fluent.signature)
        if len(explicit) != prod(sizes):
            reason = "atoms that are not listed are false; give it a default initial value"
            raise expressions.unsupported(f"unknown values of {fluent.name}", reason)
    yield from explicit.items()


_PREFERENCE = "goal-"


def from_unified_planning(problem: UpProblem) -> tuple[Domain, Problem]:
    """Make a domain and a problem that mean what a problem of unified-planning means.

    Names become ones that the grammar of PDDL allows: `left arm` is `left_arm`. Where letters'
    case alone tells elements of different categories apart, predicates, functions and types have
    their category appended.

    Args:
        problem: the problem.

    Returns:
        The domain, named after the problem with `-domain`, and the problem.

    Raises:
        PlannerMissingError: unified-planning is not installed.
        InvalidNameError: two elements of one category would have one name in PDDL.
        UnsupportedConstructError: PDDL cannot express something exactly, or it is nested too deeply
            for unified-planning's own recursion; the message says what.
    """
    require_unified_planning()
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


class PddlDocuments:
    """One conversion of a problem."""

    def __init__(self, problem: UpProblem) -> None:
        self._problem = problem
        self._names = PddlNames()
        self._expressions = PddlExpressions(self._names)
        self._check()
        for category, element in _elements(problem):
            self._names.claim(category, element.name)
        if self._costs():
            self._names.claim(FUNCTION, f.TOTAL_COST)
        self._actions = PddlActions(self._names, self._expressions)

    def _check(self) -> None:
        problem, unsupported = self._problem, self._expressions.unsupported
        if type(problem).__name__ != "Problem":
            raise unsupported(f"a {type(problem).__name__}", "it knows problems of actions alone")
        if problem.discrete_time or problem.self_overlapping:
            reason = "its time is continuous and an action does not overlap with itself"
            raise unsupported("this model of time", reason)
        if len(problem.quality_metrics) > 1:
            raise unsupported("several metrics", "a problem has one")

    def documents(self) -> tuple[Domain, Problem]:
        """Return the domain and the problem."""
        name = pddl_name("problem", self._problem.name or "problem")
        domain = self._domain(f"{name}-domain")
        constants = {part.name for part in _constants(domain)}
        objects = [
            f.TypedName(self._names.of(OBJECT, item.name), self._type(item.type))
            for item in self._problem.all_objects
        ]
        self._expressions.where = "the initial state"
        facts, values = initial_state(self._problem, self._expressions)
        if self._costs():
            values = (*values, FunctionValue(f.Fluent(f.TOTAL_COST), f.Number(Decimal(0))))
        problem = Problem(
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

    def _domain(self, name: str) -> Domain:
        names, problem, predicates, functions = self._names, self._problem, [], []
        for fluent in problem.fluents:
            self._expressions.where = f"fluent {fluent.name}"
            called = names.of(category_of(fluent), fluent.name)
            parameters = self._expressions.typed(
                fluent.signature, PddlVariables().bind(fluent.signature)
            )
            if fluent.type.is_bool_type():
                predicates.append(Predicate(called, parameters))
            elif fluent.type.is_user_type():
                functions.append(Function(called, parameters, self._type(fluent.type)))
            elif fluent.type.lower_bound is None and fluent.type.upper_bound is None:
                functions.append(Function(called, parameters))
            else:
                raise self._expressions.unsupported(
                    fluent, "a number has no bounds; compile with BOUNDED_TYPES_REMOVING first"
                )
        costs = self._costs()
        if costs:
            functions.append(Function(f.TOTAL_COST))
        return Domain(
            name,
            types=tuple(
                f.TypedName(
                    names.of(TYPE, type_.name),
                    (ROOT_TYPE,) if type_.father is None else self._type(type_.father),
                )
                for type_ in _types(problem)
            ),
            predicates=tuple(predicates),
            functions=tuple(functions),
            actions=tuple(
                self._actions.action(action, costs.get(action.name))
                for action in (*problem.actions, *problem.processes, *problem.events)
            ),
        )

    def _type(self, type_: object) -> tuple[str, ...]:
        return (self._expressions.type_name(type_),)

    def _costs(self) -> dict[str, FNode]:
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
        self._expressions.where = "the timed effects"
        for timing, effects in self._problem.timed_effects.items():
            time = number(timing.delay)
            for effect in effects:
                if timing.is_from_end() or not isinstance(time, f.Number):
                    raise self._expressions.unsupported(timing, "no decimal number is equal to it")
                constant = effect.value.is_constant() or effect.value.is_object_exp()
                if effect.is_conditional() or not constant or not effect.is_assignment():
                    reason = "what happens at a time is certain, and no increase"
                    raise self._expressions.unsupported(effect, reason)
                for change in self._actions.effect(effect, None, PddlVariables()):
                    if not isinstance(change, f.Atom | f.Not | f.Assign):
                        raise self._expressions.unsupported(effect, "it is no single literal")
                    yield f.TimedLiteral(time, change)

    def _with_goals(self, problem: Problem) -> Problem:
        expressions, up_problem = self._expressions, self._problem
        expressions.where = "the goals"
        goals = list(expressions.conjuncts(up_problem.goals, PddlVariables()))
        for interval, nodes in up_problem.timed_goals.items():
            if not (interval.lower == interval.upper and interval.lower.is_from_end()):
                raise expressions.unsupported(f"a goal in {interval}", "goals hold at the end")
            goals.extend(expressions.conjuncts(nodes, PddlVariables()))
        for number_, (goal, _) in enumerate(self._gains().items(), start=1):
            preferred = expressions.formula(goal, PddlVariables())
            goals.append(f.Preference(f"{_PREFERENCE}{number_}", preferred))
        expressions.where = "the trajectory constraints"
        constraints = expressions.conjuncts(up_problem.trajectory_constraints, PddlVariables())
        return replace(problem, goal=tuple(goals), constraints=constraints)

    def _gains(self) -> dict[FNode, Fraction | int]:
        for metric in self._problem.quality_metrics:
            if metric.is_oversubscription():
                gains: dict[FNode, Fraction | int] = metric.goals
                return gains
        return {}

    def _metric(self) -> f.Metric | None:
        self._expressions.where = "the metric"
        for metric in self._problem.quality_metrics:
            if metric.is_minimize_makespan():
                return f.Metric("minimize", f.Fluent(f.TOTAL_TIME))
            if metric.is_minimize_action_costs() or metric.is_minimize_sequential_plan_length():
                return f.Metric("minimize", f.Fluent(f.TOTAL_COST)) if self._costs() else None
            if metric.is_oversubscription():
                terms: tuple[f.Expression, ...] = tuple(
                    f.Arithmetic("*", (number(gain), f.IsViolated(f"{_PREFERENCE}{position}")))
                    for position, gain in enumerate(metric.goals.values(), start=1)
                )
                if not terms:
                    return None
                sum_ = terms[0] if len(terms) == 1 else f.Arithmetic("+", terms)
                return f.Metric("minimize", sum_)
            if metric.is_temporal_oversubscription():
                raise self._expressions.unsupported(metric, "a preferred goal has no time")
            sense = "maximize" if metric.is_maximize_expression_on_final_state() else "minimize"
            return f.Metric(sense, self._expressions.expression(metric.expression, PddlVariables()))
        return None


def _constants(domain: Domain) -> Iterator[f.Constant]:
    for action in domain.actions:
        for node in f.walk(*action.duration, *action.condition, *action.effect):
            if isinstance(node, f.Constant):
                yield node


def _types(problem: UpProblem) -> Iterator[Type]:
    for type_ in problem.user_types:
        if type_.father is not None or fold(type_.name) != ROOT_TYPE:
            yield type_


def _elements(
    problem: UpProblem,
) -> Iterator[tuple[str, Object | Transition | UpFluent | Type]]:
    from unified_planning.model import DurativeAction

    yield from ((OBJECT, item) for item in problem.all_objects)
    for action in problem.actions:
        yield DURATIVE_ACTION if isinstance(action, DurativeAction) else ACTION, action
    yield from ((PROCESS, process) for process in problem.processes)
    yield from ((EVENT, event) for event in problem.events)
    yield from ((category_of(fluent), fluent) for fluent in problem.fluents)
    yield from ((TYPE, type_) for type_ in _types(problem))
