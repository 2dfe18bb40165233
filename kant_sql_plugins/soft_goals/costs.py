"""The metric as a weighted sum, and its fluents as costs of actions.

Cost planners minimize the sum of the costs of a plan's actions (PDDL 3.1, `:action-costs`). A
numeric fluent that actions only increase, by amounts that never change, is such a sum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from math import prod
from operator import add, mul, sub, truediv
from typing import Any

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.knowledge.grounding import replaced
from kant_sql.pddl.document import ACTION, DURATIVE_ACTION, Action, Domain, Problem
from kant_sql.planning.action_costs import MOST_COSTS, ActionCost, Objects, Values, functions_read
from kant_sql.planning.metrics import folded, static_functions, unconditional

# The weights of the fluents of each function in a metric to minimize, with folded names.
Weights = dict[str, Values]


@dataclass(frozen=True)
class _Increase:
    fluent: f.Fluent
    value: f.Expression
    sign: int


class NoCostError(Exception):
    """A fluent is not a sum of costs; the argument is the reason."""


class Costs:
    """The weighted fluents of a metric as costs of actions.

    Args:
        weights: the weight of each fluent in a metric to minimize, with folded names.
    """

    def __init__(
        self, domain: Domain, problem: Problem, weights: Mapping[f.Fluent, Fraction]
    ) -> None:
        self._domain, self._objects = domain, Objects(domain, problem)
        self._static = static_functions(domain, problem)
        self._initial: dict[f.Fluent, Fraction] = {
            folded(fluent): Fraction(value.value)
            for fluent, value in problem.values
            if isinstance(value, f.Number)
        }
        self._timed = {
            fold(timed.effect.fluent.function)
            for timed in problem.timed
            if isinstance(timed.effect, f.Assign)
        }
        self._weights: Weights = {}
        for fluent, weight in weights.items():
            terms = tuple(str(term) for term in fluent.terms)
            self._weights.setdefault(fluent.function, {})[terms] = weight
        # The amounts that each action adds to the weighted functions, by its name.
        self._increases: dict[str, list[_Increase]] = {}
        self.refused: dict[str, str] = {}
        for function in list(self._weights):
            self._take(function)
        self.free = self._free_functions(problem)

    def _free_functions(self, problem: Problem) -> frozenset[str]:
        """Return the functions that change, but that no condition needs."""
        numeric = {fold(one.name) for one in self._domain.functions if not one.types}
        found = numeric - self._static - functions_read(self._domain, problem) - self._timed
        for function in sorted(found - self._weights.keys() - self.refused.keys()):
            self._take(function)
        return frozenset(found & self._weights.keys())

    def _take(self, function: str) -> None:
        """Use the amounts that actions add to a function as costs, or record why not."""
        if function in self._static:
            return  # a constant changes no comparison of plans
        is_weighted = bool(self._weights.setdefault(function, {}))
        try:
            if function in self._timed:
                raise NoCostError("it changes at given times")
            found = {
                fold(action.name): self._of_whole_action(action, function, is_weighted)
                for action in self._domain.actions
            }
        except NoCostError as error:
            self.refused[function] = str(error)
            del self._weights[function]
            return
        self._increases.update(found)

    def _of_whole_action(self, action: Action, function: str, is_weighted: bool) -> list[_Increase]:
        """Return the amounts of an action, including those for other functions."""
        known = self._increases.get(fold(action.name), [])
        found = list(self._of_action(action, function))
        table = self._table(action, found)
        if any(value < 0 for value in (table.values or {}).values()):
            raise NoCostError(f"action {action.name} makes it better")
        if not (is_weighted or table.undefined):
            return known
        self._table(action, [*known, *found])
        return [*known, *found]

    def _of_action(self, action: Action, function: str) -> Iterator[_Increase]:
        for effect in unconditional(action.effect):
            changed = effect.fluent if isinstance(effect, f.Assign) else None
            if changed is None or fold(changed.function) != function:
                if any(_changes(node, function) for node in f.walk(effect)):
                    raise NoCostError(f"action {action.name} changes it under a condition")
                continue
            assert isinstance(effect, f.Assign)
            if action.kind not in {ACTION, DURATIVE_ACTION}:
                raise NoCostError(f"{action.kind} {action.name} changes it")
            if effect.operator not in {"increase", "decrease"}:
                raise NoCostError(f"action {action.name} assigns it")
            if isinstance(effect.value, f.Constant):
                raise NoCostError(f"action {action.name} assigns it an object")
            sign = 1 if effect.operator == "increase" else -1
            yield _Increase(changed, _with_duration(effect.value, action), sign)

    def of(self, action: Action) -> ActionCost:
        """Return the cost of an action."""
        return self._table(action, self._increases.get(fold(action.name), []))

    def _table(self, action: Action, increases: Sequence[_Increase]) -> ActionCost:
        if not increases:
            return ActionCost()
        nodes = [node for one in increases for node in (one.fluent, one.value)]
        used = {fold(node.name) for node in f.walk(*nodes) if isinstance(node, f.Variable)}
        parameters = tuple(part for part in action.parameters if fold(part.name) in used)
        if len(parameters) != len(used):
            raise NoCostError(f"the amount in action {action.name} is not a constant")
        ranges = [self._objects.of(part.types) for part in parameters]
        if prod(map(len, ranges)) > MOST_COSTS:
            raise NoCostError(f"action {action.name} would have more than {MOST_COSTS} costs")
        values: Values = {}
        undefined: list[tuple[str, ...]] = []
        for chosen in product(*ranges):
            bound = {fold(p.name): fold(o) for p, o in zip(parameters, chosen, strict=True)}
            cost = self._cost(action, increases, bound)
            if cost is None:
                undefined.append(chosen)
            else:
                values[chosen] = cost
        return ActionCost(parameters, values, tuple(undefined))

    def _cost(
        self, action: Action, increases: Sequence[_Increase], bound: Mapping[str, str]
    ) -> Fraction | None:
        total = Fraction(0)
        for one in increases:
            value = self._evaluate(action, one.value, bound)
            if value is None:
                return None
            terms = tuple(self._object(action, term, bound) for term in one.fluent.terms)
            weight = self._weights[fold(one.fluent.function)].get(terms, Fraction(0))
            total += one.sign * value * weight
        return total

    def _object(self, action: Action, term: f.Term, bound: Mapping[str, str]) -> str:
        match term:
            case f.Constant(name):
                return fold(name)
            case f.Variable(name) if fold(name) in bound:
                return bound[fold(name)]
        raise NoCostError(f"the amount in action {action.name} depends on the state")

    def _evaluate(
        self, action: Action, node: f.Expression | f.Term, bound: Mapping[str, str]
    ) -> Fraction | None:
        match node:
            case f.Number(value):
                return Fraction(value)
            case f.Fluent(function, terms) if fold(function) in self._static:
                names = tuple(f.Constant(self._object(action, term, bound)) for term in terms)
                return self._initial.get(f.Fluent(fold(function), names))
            case f.Arithmetic(operator, operands):
                values = [self._evaluate(action, operand, bound) for operand in operands]
                return None if None in values else _calculate(operator, values)
        raise NoCostError(f"the amount in action {action.name} depends on the state")


def _changes(node: f.Node, function: str) -> bool:
    return isinstance(node, f.Assign) and fold(node.fluent.function) == function


def _with_duration(value: f.Expression, action: Action) -> f.Expression:
    """Replace `?duration` by its value, if the action has one equation for it."""
    match action.duration:
        case (f.Comparison("=", f.Variable(name), bound),) if fold(name) == f.DURATION:
            return replaced(value, {f.DURATION: bound})
    return value


_OPERATORS = {"+": add, "-": sub, "*": mul, "/": truediv}


def _calculate(operator: str, values: Sequence[Any]) -> Fraction | None:
    if operator == "-" and len(values) == 1:
        return Fraction(-values[0])
    try:
        return Fraction(reduce(_OPERATORS[operator], values))
    except ZeroDivisionError:
        return None
