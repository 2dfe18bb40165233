"""The total cost of a plan: when `total-cost` is nothing but the sum of the actions' costs."""

from __future__ import annotations

from collections.abc import Iterator

from ..dto.formula import And, Assign, Fluent, Formula, Node, Number, Timed, TimedLiteral
from ..dto.name import fold
from ..dto.node import walk
from ..pddl.document import ACTION, DURATIVE_ACTION, Action, Domain, Problem

TOTAL_COST, TOTAL_TIME = "total-cost", "total-time"


def is_function(node: Node | None, name: str) -> bool:
    """Tell whether a node is a function without terms.

    Args:
        node: the node.
        name: the function's name, folded.

    Returns:
        Whether it is that function.
    """
    return isinstance(node, Fluent) and fold(node.function) == name and not node.terms


def static_functions(domain: Domain, problem: Problem) -> frozenset[str]:
    """Find the functions whose values never change.

    Args:
        domain: the domain.
        problem: the problem.

    Returns:
        Their folded names.
    """
    effects: list[Node] = [effect for action in domain.actions for effect in action.effect]
    effects.extend(timed.effect for timed in problem.timed)
    changed = {fold(node.fluent.function) for node in walk(*effects) if isinstance(node, Assign)}
    return frozenset(fold(function.name) for function in domain.functions) - changed


def is_sum_of_costs(domain: Domain, problem: Problem) -> bool:
    """Tell whether the metric minimizes what the actions cost, and nothing else asks for the sum.

    Args:
        domain: the domain.
        problem: the problem.

    Returns:
        Whether `total-cost` starts at 0, only ever grows by an action's own cost, and is read by
        the metric alone.
    """
    metric = problem.metric
    if metric is None or metric.optimization != "minimize":
        return False
    if not is_function(metric.expression, TOTAL_COST):
        return False
    starts = [value for fluent, value in problem.values if is_function(fluent, TOTAL_COST)]
    if not starts or not all(isinstance(value, Number) and value.value == 0 for value in starts):
        return False
    static = static_functions(domain, problem)
    return not any(_mentions(node) for node in _readers(domain, problem)) and all(
        _adds_up(action, static) for action in domain.actions
    )


def _adds_up(action: Action, static: frozenset[str]) -> bool:
    for effect in _unconditional(action.effect):
        if not isinstance(effect, Assign) or not is_function(effect.fluent, TOTAL_COST):
            if _mentions(effect):
                return False
            continue
        functions = {fold(n.function) for n in walk(effect.value) if isinstance(n, Fluent)}
        if effect.operator != "increase" or TOTAL_COST in functions:
            return False
        if action.kind == DURATIVE_ACTION and not functions <= static:
            return False
        if action.kind not in {ACTION, DURATIVE_ACTION}:
            return False
    return True


def _unconditional(effects: tuple[Formula, ...]) -> Iterator[Formula]:
    for effect in effects:
        if isinstance(effect, And):
            yield from _unconditional(effect.formulas)
        elif isinstance(effect, Timed):
            yield from _unconditional((effect.formula,))
        else:
            yield effect


def _readers(domain: Domain, problem: Problem) -> Iterator[Node]:
    for action in domain.actions:
        yield from (*action.condition, *action.duration)
    yield from (rule.formula for rule in domain.derived)
    yield from (*domain.constraints, *problem.goal, *problem.constraints)
    yield from (_effect(timed) for timed in problem.timed)


def _effect(timed: TimedLiteral) -> Node:
    return timed.effect


def _mentions(node: Node) -> bool:
    return any(is_function(part, TOTAL_COST) for part in walk(node))
