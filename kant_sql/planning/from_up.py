"""From unified-planning to documents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING

from ..arguments import expect
from ..dto.formula import (
    Arithmetic,
    Assign,
    Atom,
    Constant,
    Expression,
    Fluent,
    IsViolated,
    Metric,
    Not,
    Number,
    Preference,
    TimedLiteral,
    TypedName,
)
from ..dto.name import ROOT_TYPE, fold
from ..dto.node import walk
from ..errors import InvalidArgumentError, UnsupportedConstructError
from ..pddl.document import (
    ACTION,
    DURATIVE_ACTION,
    EVENT,
    PROCESS,
    Domain,
    Function,
    FunctionValue,
    Predicate,
    Problem,
)
from ..pddl.requirements import used_requirements
from .cost import TOTAL_COST, TOTAL_TIME
from .extra import require_unified_planning
from .from_actions import FromActions
from .from_formulas import Bound, Expressions, category_of
from .from_names import PddlNames, pddl_name
from .from_numbers import number
from .from_state import initial_state
from .names import FUNCTION, OBJECT, TYPE

if TYPE_CHECKING:
    from unified_planning.model import Fluent as UpFluent
    from unified_planning.model import FNode, Object, Transition, Type
    from unified_planning.model import Problem as UpProblem

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
        return _Reverse(problem).documents()
    except RecursionError as error:
        raise UnsupportedConstructError(
            f"problem {problem.name} has expressions that are nested too deeply for a conversion "
            "from unified-planning; give their parts fluents of their own"
        ) from error


class _Reverse:
    def __init__(self, problem: UpProblem) -> None:
        self._problem = problem
        self._names = PddlNames()
        self._expressions = Expressions(self._names)
        self._check()
        for category, element in _elements(problem):
            self._names.claim(category, element.name)
        if self._costs():
            self._names.claim(FUNCTION, TOTAL_COST)
        self._actions = FromActions(self._names, self._expressions)

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
        name = pddl_name("problem", self._problem.name or "problem")
        domain = self._domain(f"{name}-domain")
        constants = {part.name for part in _constants(domain)}
        objects = [
            TypedName(self._names.of(OBJECT, item.name), self._type(item.type))
            for item in self._problem.all_objects
        ]
        self._expressions.where = "the initial state"
        facts, values = initial_state(self._problem, self._expressions)
        if self._costs():
            values = (*values, FunctionValue(Fluent(TOTAL_COST), Number(Decimal(0))))
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
            parameters = self._expressions.typed(fluent.signature, Bound().bind(fluent.signature))
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
            functions.append(Function(TOTAL_COST))
        return Domain(
            name,
            types=tuple(
                TypedName(
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

    def _timed(self) -> Iterator[TimedLiteral]:
        self._expressions.where = "the timed effects"
        for timing, effects in self._problem.timed_effects.items():
            time = number(timing.delay)
            for effect in effects:
                if timing.is_from_end() or not isinstance(time, Number):
                    raise self._expressions.unsupported(timing, "no decimal number is equal to it")
                constant = effect.value.is_constant() or effect.value.is_object_exp()
                if effect.is_conditional() or not constant or not effect.is_assignment():
                    reason = "what happens at a time is certain, and no increase"
                    raise self._expressions.unsupported(effect, reason)
                for change in self._actions.effect(effect, None, Bound()):
                    if not isinstance(change, Atom | Not | Assign):
                        raise self._expressions.unsupported(effect, "it is no single literal")
                    yield TimedLiteral(time, change)

    def _with_goals(self, problem: Problem) -> Problem:
        expressions, up_problem = self._expressions, self._problem
        expressions.where = "the goals"
        goals = list(expressions.conjuncts(up_problem.goals, Bound()))
        for interval, nodes in up_problem.timed_goals.items():
            if not (interval.lower == interval.upper and interval.lower.is_from_end()):
                raise expressions.unsupported(f"a goal in {interval}", "goals hold at the end")
            goals.extend(expressions.conjuncts(nodes, Bound()))
        for number_, (goal, _) in enumerate(self._gains().items(), start=1):
            preferred = expressions.formula(goal, Bound())
            goals.append(Preference(f"{_PREFERENCE}{number_}", preferred))
        expressions.where = "the trajectory constraints"
        constraints = expressions.conjuncts(up_problem.trajectory_constraints, Bound())
        return replace(problem, goal=tuple(goals), constraints=constraints)

    def _gains(self) -> dict[FNode, Fraction | int]:
        for metric in self._problem.quality_metrics:
            if metric.is_oversubscription():
                gains: dict[FNode, Fraction | int] = metric.goals
                return gains
        return {}

    def _metric(self) -> Metric | None:
        self._expressions.where = "the metric"
        for metric in self._problem.quality_metrics:
            if metric.is_minimize_makespan():
                return Metric("minimize", Fluent(TOTAL_TIME))
            if metric.is_minimize_action_costs() or metric.is_minimize_sequential_plan_length():
                return Metric("minimize", Fluent(TOTAL_COST)) if self._costs() else None
            if metric.is_oversubscription():
                terms: tuple[Expression, ...] = tuple(
                    Arithmetic("*", (number(gain), IsViolated(f"{_PREFERENCE}{position}")))
                    for position, gain in enumerate(metric.goals.values(), start=1)
                )
                if not terms:
                    return None
                sum_ = terms[0] if len(terms) == 1 else Arithmetic("+", terms)
                return Metric("minimize", sum_)
            if metric.is_temporal_oversubscription():
                raise self._expressions.unsupported(metric, "a preferred goal has no time")
            sense = "maximize" if metric.is_maximize_expression_on_final_state() else "minimize"
            return Metric(sense, self._expressions.expression(metric.expression, Bound()))
        return None


def _constants(domain: Domain) -> Iterator[Constant]:
    for action in domain.actions:
        for node in walk(*action.duration, *action.condition, *action.effect):
            if isinstance(node, Constant):
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
