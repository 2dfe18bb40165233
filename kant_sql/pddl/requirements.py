"""Which requirements a domain and a problem really use, whatever they declare.

The rules for `:action-costs` are those of the competition that introduced it: Modeling Action Costs
in IPC-2008, https://ipc08.icaps-conference.org/deterministic/PddlActionCosts.html, which Kovacs
repeats (Complete BNF description of PDDL 3.1, section 1.3). The comments number them as there.

The rules are those of Kovacs, Complete BNF description of PDDL 3.1 (2011), where each production
names its requirement, with `:time` for processes and events (Fox and Long, Modelling mixed
discrete-continuous domains for planning, 2006). There is one deviation: Kovacs asks for
`:numeric-fluents` wherever there is a metric, while PDDL 2.1 (appendix A) and PDDL 3.0 (section 3)
do not, nor do the files of the competitions; here a metric over `total-time` and preferences alone
does not need it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..arguments import expect
from ..dto.formulas import (
    DURATION,
    TOTAL_COST,
    TOTAL_TIME,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Equal,
    Exists,
    Expression,
    Fluent,
    Forall,
    Imply,
    IsViolated,
    Metric,
    Modal,
    Node,
    Not,
    Number,
    Or,
    Preference,
    Term,
    Timed,
    TypedName,
    Variable,
    When,
    children,
    walk,
)
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidArgumentError
from .document import (
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

NUMERIC_FLUENTS, ACTION_COSTS = ":numeric-fluents", ":action-costs"


def numeric_requirement(domain: Domain, problem: Problem | None = None) -> str | None:
    """Return which requirement the numbers have."""
    costs = any(
        fold(function.name) == TOTAL_COST and not function.parameters and not function.types
        for function in domain.functions
    )
    effects = _numeric_effects(domain)
    values = [] if problem is None else [v for v in problem.values if isinstance(v.value, Number)]
    metric = None if problem is None else problem.metric
    if _looks_numbers_up(domain, problem):
        return NUMERIC_FLUENTS
    if not (effects or values or _measures(metric)) and all(f.types for f in domain.functions):
        return None
    if costs and _only_costs(effects) and _starts_well(values):
        durative = any(action.kind == DURATIVE_ACTION for action in domain.actions)
        if metric is None or _minimizes_costs(metric, durative):
            return ACTION_COSTS
    return NUMERIC_FLUENTS


def _numeric_effects(domain: Domain) -> list[Assign]:
    objects = {fold(function.name) for function in domain.functions if function.types}
    return [
        node
        for action in domain.actions
        for node in walk(*action.effect)
        if isinstance(node, Assign) and fold(node.fluent.function) not in objects
    ]


def _looks_numbers_up(domain: Domain, problem: Problem | None) -> bool:
    """Whether numbers decide what is possible, or change by themselves (rule 1)."""
    if problem is not None and any(
        isinstance(timed.effect, Assign) and not isinstance(timed.effect.value, Constant)
        for timed in problem.timed
    ):
        return True
    durations = walk(*(formula for action in domain.actions for formula in action.duration))
    return any(isinstance(node, Comparison) for node in _all_but_durations(domain, problem)) or any(
        isinstance(node, Fluent | Arithmetic)
        or (isinstance(node, Variable) and fold(node.name) != DURATION)
        for node in durations
    )


def _all_but_durations(domain: Domain, problem: Problem | None) -> Iterator[Node]:
    roots: list[Node] = [*domain.constraints, *domain.derived]
    for action in domain.actions:
        roots += [*action.condition, *action.effect]
    if problem is not None:
        roots += [*problem.goal, *problem.constraints]
    return walk(*roots)


def _measures(metric: Metric | None) -> bool:
    return metric is not None and any(
        isinstance(node, Fluent) and fold(node.function) != TOTAL_TIME for node in walk(metric)
    )


def is_function(node: Node, *names: str) -> bool:
    """Return whether a node is one of the named functions, without terms."""
    return isinstance(node, Fluent) and not node.terms and fold(node.function) in names


def _only_costs(effects: list[Assign]) -> bool:
    """Whether effects do nothing but add a cost that is never negative (rules 2 and 3)."""
    return all(
        effect.operator == "increase"
        and is_function(effect.fluent, TOTAL_COST)
        and _is_cost(effect.value)
        for effect in effects
    )


def _is_cost(value: Expression | Term) -> bool:
    if isinstance(value, Number):
        return value.value >= 0
    return (
        isinstance(value, Fluent)
        and fold(value.function) != TOTAL_COST
        and not any(isinstance(term, Fluent) for term in value.terms)
    )


def _starts_well(values: list[FunctionValue]) -> bool:
    """Whether costs begin at 0 and none is negative (rules 2 and 4).

    Without a value at first, costs cannot be added to under any requirement: planners take 0.
    """
    numbers = [(v.fluent, v.value.value) for v in values if isinstance(v.value, Number)]
    return all(
        number == 0 if is_function(fluent, TOTAL_COST) else number >= 0
        for fluent, number in numbers
    )


def _minimizes_costs(metric: Metric, durative: bool) -> bool:
    """Whether the metric is the costs, or with durations a sum of costs and time (rule 5)."""
    if metric.optimization != "minimize":
        return False
    if is_function(metric.expression, TOTAL_COST):
        return True
    return durative and all(map(_is_of_linear_sum, walk(metric.expression)))


def _is_of_linear_sum(node: Node) -> bool:
    match node:
        case Number():
            return node.value >= 0
        case Fluent():
            return is_function(node, TOTAL_COST, TOTAL_TIME)
        case Arithmetic("+"):
            return not any(isinstance(child, Number) for child in children(node))
        case Arithmetic("*"):
            return sum(not isinstance(child, Number) for child in children(node)) == 1
    return False


REQUIREMENTS = (
    ":strips",
    ":typing",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":equality",
    ":existential-preconditions",
    ":universal-preconditions",
    ":conditional-effects",
    ":numeric-fluents",
    ":object-fluents",
    ":durative-actions",
    ":duration-inequalities",
    ":continuous-effects",
    ":derived-predicates",
    ":timed-initial-literals",
    ":preferences",
    ":constraints",
    ":action-costs",
    ":time",
)


def used_requirements(domain: Domain, *, problem: Problem | None = None) -> tuple[str, ...]:
    """Return which requirements are really used.

    Numbers that only count costs need `:action-costs` instead of `:numeric-fluents`. Abbreviations
    such as `:adl` are written out, and `:strips` is always among them.

    Args:
        domain: the domain.
        problem: a problem of it, whose uses count as well.

    Returns:
        The requirements, in the order of the standard.
    """
    expect(domain, Domain, "the domain", InvalidArgumentError)
    if problem is not None:
        expect(problem, Problem, "the problem", InvalidArgumentError)
    used = {":strips", numeric_requirement(domain, problem), *_of_domain(domain)}
    if problem is not None:
        used.update(_of_problem(problem))
    if _is_typed(domain, problem):
        used.add(":typing")
    if any(map(_takes_fluent, _all_nodes(domain, problem))):
        used.add(":object-fluents")
    return tuple(requirement for requirement in REQUIREMENTS if requirement in used)


def _of_domain(domain: Domain) -> Iterator[str]:
    if any(function.types for function in domain.functions):
        yield ":object-fluents"
    for rule in domain.derived:
        yield ":derived-predicates"
        yield from _of_condition(walk(rule.formula))
    for action in domain.actions:
        yield from _of_action(action)
    for constraint in domain.constraints:
        yield from _of_constraint(constraint)


def _of_problem(problem: Problem) -> Iterator[str]:
    if any(isinstance(literal, Equal) for literal in problem.literals):
        yield ":equality"
    if any(isinstance(value.value, Constant) for value in problem.values):
        yield ":object-fluents"
    for timed in problem.timed:
        yield ":timed-initial-literals"
        if isinstance(timed.effect, Assign) and isinstance(timed.effect.value, Constant):
            yield ":object-fluents"
    yield from _of_condition(walk(*problem.goal))
    for constraint in problem.constraints:
        yield from _of_constraint(constraint)
    if problem.metric is not None:
        for node in walk(problem.metric):
            if isinstance(node, IsViolated):
                yield ":preferences"


def _of_action(action: Action) -> Iterator[str]:
    if action.kind in (PROCESS, EVENT):
        yield ":time"
    if action.kind == DURATIVE_ACTION:
        yield ":durative-actions"
        yield from _of_duration(action)
    yield from _of_condition(walk(*action.condition))
    yield from _of_effects(action.effect)


def _of_duration(action: Action) -> Iterator[str]:
    constraints = [n for n in walk(*action.duration) if isinstance(n, Comparison)]
    if len(constraints) > 1 or any(constraint.operator != "=" for constraint in constraints):
        yield ":duration-inequalities"
    for node in walk(*action.effect):
        if isinstance(node, ContinuousTime):
            yield ":continuous-effects"
        elif isinstance(node, Variable) and fold(node.name) == DURATION:
            yield ":duration-inequalities"


def _of_condition(nodes: Iterable[Node]) -> Iterator[str]:
    for node in nodes:
        match node:
            case Not(Atom() | Equal()):
                yield ":negative-preconditions"
            case Not() | Or() | Imply():
                yield ":disjunctive-preconditions"
            case Equal():
                yield ":equality"
            case Exists():
                yield ":existential-preconditions"
            case Forall():
                yield ":universal-preconditions"
            case Preference():
                yield ":preferences"


def _of_constraint(constraint: Node) -> Iterator[str]:
    yield ":constraints"
    yield from _of_condition(node for node in walk(constraint) if not _is_of_constraints(node))


def _is_of_constraints(node: Node) -> bool:
    """Whether it quantifies over constraints, which is a part of `:constraints`."""
    if not isinstance(node, Forall):
        return False
    within = list(walk(node.formula))
    return any(isinstance(part, Modal | Timed) for part in within) and not any(
        isinstance(part, Preference) for part in within
    )


def _of_effects(effects: Iterable[Node]) -> Iterator[str]:
    stack = list(effects)
    while stack:
        node = stack.pop()
        if isinstance(node, When | Forall):
            yield ":conditional-effects"
        if isinstance(node, When):
            yield from _of_condition(walk(node.condition))
            stack.append(node.effect)
        elif not isinstance(node, Assign):
            stack.extend(children(node))


def _all_nodes(domain: Domain, problem: Problem | None) -> Iterator[Node]:
    roots: list[Node] = [*domain.constraints, *domain.derived]
    for action in domain.actions:
        roots += [*action.duration, *action.condition, *action.effect]
    if problem is not None:
        roots += [*problem.goal, *problem.constraints]
    return walk(*roots)


def _takes_fluent(node: Node) -> bool:
    return isinstance(node, Atom | Equal | Fluent) and any(
        isinstance(term, Fluent) for term in children(node)
    )


def _is_typed(domain: Domain, problem: Problem | None) -> bool:
    names: list[TypedName] = [*domain.constants, *(problem.objects if problem else ())]
    skeletons: list[Predicate | Function | Action] = [
        *domain.predicates,
        *domain.functions,
        *domain.actions,
    ]
    for skeleton in skeletons:
        names += skeleton.parameters
    for node in _all_nodes(domain, problem):
        names += getattr(node, "variables", ())
    return bool(domain.types) or any(name.types != (ROOT_TYPE,) for name in names)
