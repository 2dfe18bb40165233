"""Conversion of documents to a problem of unified-planning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..arguments import expect
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidArgumentError, UnsupportedConstructError
from ..pddl.document import DURATIVE_ACTION, PROCESS, Domain, Problem
from ..pddl.requirements import is_function
from . import names as n
from .metrics import hinted, is_sum_of_costs, refusal, static_functions, variants
from .solving import check_documents
from .up_actions import SingleEffect, UpActions, UpEffects
from .up_formulas import Bindings, ConversionContext, UpFormulas, UpPreferences, UpTypes

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import FNode, Parameter
    from unified_planning.model import Problem as UpProblem
    from unified_planning.model import Variable as UpVariable


class UpConversion:
    """One conversion of documents."""

    def __init__(
        self, domain: Domain, problem: Problem, environment: Environment, integers: bool = False
    ) -> None:
        from unified_planning.model import Problem as UpProblem

        self._domain, self._document = domain, problem
        names = n.UpNames(domain, problem)
        manager = environment.expression_manager
        # The state of all parts; its `problem` is the result.
        self.context = ConversionContext(
            environment,
            UpProblem(
                problem.name,
                environment,
                initial_defaults={environment.type_manager.BoolType(): manager.FALSE()},
            ),
            names,
            UpTypes(domain, problem, names, environment),
            static=static_functions(domain, problem),
            integers=integers,
            costed=is_sum_of_costs(domain, problem),
        )
        self._formulas = UpFormulas(self.context)
        self._declare()
        self._preferences = UpPreferences(problem.metric, self.context, self._formulas)
        self._actions = UpActions(self.context, self._formulas, self._preferences)
        for action in domain.actions:
            with self.context.at(f"{action.kind} {action.name}"):
                self._actions.add(action)
        with self.context.at("the initial state"):
            self._initial_state()
        with self.context.at("the goal"):
            for goal in self._preferences.goals(problem.goal, Bindings()):
                self.context.problem.add_goal(goal)
        with self.context.at("the constraints"):
            for constraint in self._preferences.without(
                (*domain.constraints, *problem.constraints)
            ):
                self._constraint(constraint, (), Bindings())
        with self.context.at("the metric"):
            self._metric(problem.metric)

    def _declare(self) -> None:
        context = self.context
        manager = context.environment.type_manager
        for rule in self._domain.derived:
            context.rules.setdefault(fold(rule.predicate), []).append(rule)
        with context.at("the types"):
            for type_ in context.types.all():
                context.problem._add_user_type(type_)
        for predicate in self._domain.predicates:
            if fold(predicate.name) not in context.rules:
                with context.at(f"predicate {predicate.name}"):
                    self._fluent(
                        n.PREDICATE, predicate.name, manager.BoolType(), predicate.parameters
                    )
        number = manager.IntType() if context.integers else manager.RealType()
        for function in self._domain.functions:
            if not (context.costed and fold(function.name) == f.TOTAL_COST):
                with context.at(f"function {function.name}"):
                    value = context.types.widest(function.types) if function.types else number
                    self._fluent(n.FUNCTION, function.name, value, function.parameters)
        for item in (*self._domain.constants, *self._document.objects):
            with context.at(f"object {item.name}"):
                self._object(item)

    def _fluent(
        self, category: str, name: str, value: object, parameters: tuple[f.TypedName, ...]
    ) -> None:
        from unified_planning.model import Fluent, Parameter

        context, scope = self.context, Bindings()
        signature: list[Parameter] = []
        for parameter in parameters:
            type_ = context.types.widest(parameter.types)
            made = Parameter(scope.fresh(parameter.name), type_, context.environment)
            scope = Bindings({}, scope.names | {fold(made.name)})
            signature.append(made)
        fluent = Fluent(context.names.of(category, name), value, signature, context.environment)
        context.fluents[category, fold(name)] = context.problem.add_fluent(fluent)

    def _object(self, item: f.TypedName) -> None:
        from unified_planning.model import Object

        context = self.context
        types = context.types.narrowest(item.types)
        if len(types) > 1:
            raise context.unsupported(
                f"{item.name} - {item.type_text}", "an object has one type there; give it one"
            )
        made = Object(context.names.of(n.OBJECT, item.name), types[0], context.environment)
        known = context.objects.setdefault(fold(item.name), made)
        if known is not made and known.type != made.type:
            raise context.unsupported(item.name, f"it is of {known.type.name} as well")
        if known is made:
            # `add_object` compares with all other objects, which is too slow for many.
            context.problem.all_objects.append(made)
            context.problem._add_user_type(made.type)

    def _initial_state(self) -> None:
        problem, formulas, scope = self.context.problem, self._formulas, Bindings()
        manager = self.context.environment.expression_manager
        for literal in self._document.literals:
            match literal:
                case f.Not(f.Equal()):
                    continue
                case f.Not(inner):
                    problem.set_initial_value(formulas.formula(inner, scope), manager.FALSE())
                case f.Equal(f.Constant(left), f.Constant(right)) if fold(left) == fold(right):
                    continue
                case _:
                    raise self.context.unsupported(literal, "two objects are never one there")
        for fact in self._document.facts:
            if fold(fact.predicate) in self.context.rules:
                raise self.context.unsupported(fact, "a derived predicate is not a fluent there")
            problem.set_initial_value(formulas.formula(fact, scope), manager.TRUE())
        for fluent, value in self._document.values:
            if self.context.costed and is_function(fluent, f.TOTAL_COST):
                continue
            node = formulas.fluent(fluent, scope)
            if isinstance(value, f.Constant):
                problem.set_initial_value(node, formulas.term(value, scope))
            else:
                problem.set_initial_value(node, formulas.expression(value, scope))
        self._timed_effects()

    def _timed_effects(self) -> None:
        from unified_planning.model import GlobalStartTiming

        change = UpEffects(self.context, self._formulas)
        for timed in self._document.timed:
            single = SingleEffect(Bindings(), change=timed.effect)
            target = change.target(single)
            operator, value = change.value(single, target)
            if isinstance(timed.effect, f.Assign) and operator != "assign":
                raise self.context.unsupported(timed, "a timed value is assigned")
            time = self._formulas.expression(timed.time, Bindings()).constant_value()
            self.context.problem.add_timed_effect(GlobalStartTiming(time), target, value)

    def _constraint(
        self, node: f.Formula, variables: tuple[UpVariable, ...], scope: Bindings
    ) -> None:
        match node:
            case f.And(parts):
                for part in parts:
                    self._constraint(part, variables, scope)
            case f.Forall(names, inner):
                for bound, within in self._formulas.variables(names, scope):
                    self._constraint(inner, variables + bound, within)
            case f.Timed(time, inner) if time == f.AT_END:
                goal = self._formulas.formula(inner, scope)
                self.context.problem.add_goal(self._formulas.quantified(goal, variables))
            case f.Modal():
                constraint = self._formulas.quantified(self._modal(node, scope), variables)
                if not constraint.is_true():
                    self.context.problem.add_trajectory_constraint(constraint)
            case _:
                raise self.context.unsupported(
                    node, "it is not a constraint on the trajectory there"
                )

    def _modal(self, node: f.Modal, scope: Bindings) -> FNode:
        manager = self.context.environment.expression_manager
        if node.operator not in n.SHARED_MODALS:
            raise self.context.unsupported(node, f"{node.operator} has no counterpart")
        build = getattr(manager, node.operator.title().replace("-", ""))
        return build(*(self._formulas.formula(part, scope) for part in node.formulas))

    def _metric(self, metric: f.Metric | None) -> None:
        if metric is None:
            return
        from unified_planning import model

        problem, environment = self.context.problem, self.context.environment
        minimize = metric.optimization == "minimize"
        if self.context.costed:
            zero = environment.expression_manager.Int(0)
            made = model.MinimizeActionCosts(self._actions.costs(), zero, environment)
        elif is_function(metric.expression, f.TOTAL_TIME) and minimize:
            timed = self._document.timed or any(
                action.kind in {DURATIVE_ACTION, PROCESS} for action in self._domain.actions
            )
            kind = model.MinimizeMakespan if timed else model.MinimizeSequentialPlanLength
            made = kind(environment)
        elif self._preferences.weights:
            made = model.Oversubscription(self._preferences.gains, environment)
        elif not f.mentions(f.IsViolated, metric.expression):
            optimization = "Minimize" if minimize else "Maximize"
            kind = getattr(model, f"{optimization}ExpressionOnFinalState")
            made = kind(self._formulas.expression(metric.expression, Bindings()), environment)
        else:
            return
        problem.add_quality_metric(made)


def convert(
    domain: Domain, problem: Problem, environment: Environment, integers: bool = False
) -> ConversionContext:
    """Convert documents."""
    try:
        return UpConversion(domain, problem, environment, integers).context
    except RecursionError as error:
        raise n.too_deep(problem) from error


def convert_whole(domain: Domain, problem: Problem, environment: Environment) -> UpProblem:
    """Convert documents, or a variant of them with all soft goals."""
    error: UnsupportedConstructError | None = None
    ignored: tuple[str, ...] = ()
    for variant in variants(domain, problem):
        is_whole = not (variant.ignored or ignored)
        ignored = ignored or variant.ignored
        if not is_whole and variant.problem.metric is not None:
            continue
        try:
            made = convert(variant.domain, variant.problem, environment).problem
        except UnsupportedConstructError as refused:
            error = refused
            continue
        if is_whole:
            return made
        # It works without the soft goals, so these are at fault.
        raise refusal(ignored) from error
    assert error is not None
    raise hinted(error, problem)


def to_unified_planning(
    domain: Domain, *, problem: Problem, environment: Environment | None = None
) -> UpProblem:
    """Convert documents to a problem of unified-planning of the same meaning.

    Names stay as they are, except where unified-planning requires different names: there,
    predicates, functions and types get their category appended (`move_predicate`). Predicates are
    initially false unless the problem states otherwise. Some constructs are rewritten, exactly:

    - `either` in a parameter: one action for each type;
    - a derived predicate that does not depend on itself: the body of its rules;
    - `scale-up` and `scale-down`: assignments;
    - `(at end ...)` among the constraints: a goal;
    - `?duration`: the value of the duration, if that is an equation; a fluent `duration-of-` the
      action keeps it for the end, if it depends on the state;
    - preferences in the goal, if the metric counts only these: an oversubscription metric;
    - a metric without such a counterpart: the result of a plugin of the group
      `kant_sql.compilations`. The problem may then have additional actions; `kant_sql.Plan`s of
      `solve` are without them.

    Preferences that no metric counts are left out: they affect neither which plans are valid nor
    their quality.

    Args:
        environment: unified-planning's environment; by default its global one.

    Returns:
        The problem.

    Raises:
        PlannerMissingError: unified-planning is not installed.
        UnsupportedConstructError: a construct has no exact counterpart; the message names it and
            its place.
    """
    check_documents(domain, problem)
    n.require_unified_planning()
    from unified_planning.environment import Environment, get_environment

    if environment is not None:
        expect(environment, Environment, "the environment", InvalidArgumentError)

    return convert_whole(domain, problem, get_environment(environment))
