"""Which requirement the numbers of a domain and a problem have.

The rules for `:action-costs` are those of the competition that introduced it: Modeling Action Costs
in IPC-2008, https://ipc08.icaps-conference.org/deterministic/PddlActionCosts.html, which Kovacs
repeats (Complete BNF description of PDDL 3.1, section 1.3). The comments number them as there.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..dto.formula import (
    Arithmetic,
    Assign,
    Comparison,
    Constant,
    Expression,
    Fluent,
    Metric,
    Node,
    Number,
    Term,
    Variable,
)
from ..dto.name import fold
from ..dto.node import children, walk
from .document import DURATIVE_ACTION, Domain, FunctionValue, Problem

TOTAL_COST, TOTAL_TIME, DURATION = "total-cost", "total-time", "duration"
NUMERIC_FLUENTS, ACTION_COSTS = ":numeric-fluents", ":action-costs"


def numeric_requirement(domain: Domain, problem: Problem | None = None) -> str | None:
    """Tell which requirement the numbers have.

    Args:
        domain: the domain.
        problem: a problem of it, whose uses count as well.

    Returns:
        `:numeric-fluents`; the weaker `:action-costs`, where there is a `total-cost` and all keeps
        to its rules; None when there are no numbers.
    """
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


def _is_total(node: Expression | Term, *names: str) -> bool:
    return isinstance(node, Fluent) and not node.terms and fold(node.function) in names


def _only_costs(effects: list[Assign]) -> bool:
    """Whether effects do nothing but add a cost that is never negative (rules 2 and 3)."""
    return all(
        effect.operator == "increase"
        and _is_total(effect.fluent, TOTAL_COST)
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
        number == 0 if _is_total(fluent, TOTAL_COST) else number >= 0 for fluent, number in numbers
    )


def _minimizes_costs(metric: Metric, durative: bool) -> bool:
    """Whether the metric is the costs, or with durations a sum of costs and time (rule 5)."""
    if metric.optimization != "minimize":
        return False
    if _is_total(metric.expression, TOTAL_COST):
        return True
    return durative and all(map(_is_of_linear_sum, walk(metric.expression)))


def _is_of_linear_sum(node: Node) -> bool:
    match node:
        case Number():
            return node.value >= 0
        case Fluent():
            return _is_total(node, TOTAL_COST, TOTAL_TIME)
        case Arithmetic("+"):
            return not any(isinstance(child, Number) for child in children(node))
        case Arithmetic("*"):
            return sum(not isinstance(child, Number) for child in children(node)) == 1
    return False
