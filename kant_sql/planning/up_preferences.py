"""Preferences: what the metric counts becomes a goal with a gain, the rest counts for nothing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING

from ..dto.formula import (
    And,
    Arithmetic,
    Expression,
    Forall,
    Formula,
    IsViolated,
    Metric,
    Node,
    Number,
    Preference,
    TypedName,
)
from ..dto.name import fold
from ..dto.node import walk
from .context import Context, Scope
from .up_formulas import Formulas

if TYPE_CHECKING:
    from unified_planning.model import FNode

_CONSTANT = ""


class Preferences:
    """The preferences of a problem, and what the metric makes of them.

    Attributes:
        gains: what each preferred goal is worth.
    """

    def __init__(self, metric: Metric | None, context: Context, formulas: Formulas) -> None:
        """Find what the metric counts.

        Args:
            metric: the metric.
            context: the conversion.
            formulas: what converts formulas.

        Raises:
            UnsupportedConstructError: the metric is no weighted sum of violations alone.
        """
        self._context, self._formulas = context, formulas
        self._weights: dict[str, Fraction] = {}
        self.gains: dict[FNode, Fraction] = {}
        if metric is not None and mentions(IsViolated, metric.expression):
            with context.at("the metric"):
                sign = 1 if metric.optimization == "minimize" else -1
                weights = self._linear(metric.expression)
                weights.pop(_CONSTANT, None)
                self._weights = {name: sign * weight for name, weight in weights.items() if weight}

    @property
    def counted(self) -> bool:
        """Whether the metric is about preferences."""
        return bool(self._weights)

    def without(self, nodes: Iterable[Formula]) -> Iterator[Formula]:
        """Leave out the preferences that nothing counts.

        Args:
            nodes: conditions or constraints.

        Yields:
            The rest of them.

        Raises:
            UnsupportedConstructError: the metric counts one of them.
        """
        for node in nodes:
            if not mentions(Preference, node):
                yield node
                continue
            match node:
                case And(parts):
                    yield from self.without(parts)
                case Forall(variables, inner):
                    rest = tuple(self.without([inner]))
                    if rest:
                        yield Forall(variables, And(rest))
                case Preference(name, _) if not self._weight(name):
                    continue
                case Preference():
                    reason = "only a preference in the goal can be counted by a metric there"
                    raise self._context.unsupported(node, reason)
                case _:
                    raise self._context.unsupported(node, "a preference stands at an odd place")

    def goals(self, nodes: Iterable[Formula], scope: Scope) -> Iterator[FNode]:
        """Convert goals, and remember the gain of those that are preferences.

        Args:
            nodes: the goals.
            scope: the variables that they may mention.

        Yields:
            The goals that are none.
        """
        for node in nodes:
            match node:
                case Preference(name, inner):
                    if weight := self._weight(name):
                        goal = self._formulas.formula(inner, scope)
                        self.gains[goal] = self.gains.get(goal, Fraction(0)) + weight
                case And(parts):
                    yield from self.goals(parts, scope)
                case Forall(variables, inner) if mentions(Preference, inner):
                    for within in self._instances(variables, scope):
                        yield from self.goals([inner], within)
                case _:
                    yield self._formulas.formula(node, scope)

    def _instances(self, variables: Sequence[TypedName], scope: Scope) -> Iterator[Scope]:
        choices = []
        for variable in variables:
            branches = self._context.types.branches(variable.types)
            choices.append(
                [
                    item
                    for item in self._context.objects.values()
                    if any(branch.is_compatible(item.type) for branch in branches)
                ]
            )
        manager = self._context.environment.expression_manager
        for chosen in product(*choices):
            within = scope
            for variable, item in zip(variables, chosen, strict=True):
                within = within.bind(variable.name, manager.ObjectExp(item))
            yield within

    def _weight(self, name: str | None) -> Fraction:
        return self._weights.get(fold(name), Fraction(0)) if name else Fraction(0)

    def _linear(self, node: Expression) -> dict[str, Fraction]:
        match node:
            case Number(value):
                return {_CONSTANT: Fraction(value)}
            case IsViolated(preference):
                return {fold(preference): Fraction(1)}
            case Arithmetic(operator, operands):
                parts = [self._linear(operand) for operand in operands]
                if operator in {"+", "-"}:
                    first = -1 if operator == "-" and len(parts) == 1 else 1
                    sign = 1 if operator == "+" else -1
                    return _sum([(first, parts[0]), *((sign, part) for part in parts[1:])])
                constants = [part.get(_CONSTANT) for part in parts if part.keys() <= {_CONSTANT}]
                if operator == "*" and len(constants) >= len(parts) - 1:
                    return self._product(parts)
                if operator == "/" and len(parts) == 2 and parts[1].keys() == {_CONSTANT}:
                    divisor = parts[1][_CONSTANT]
                    if divisor:
                        return _sum([(1 / divisor, parts[0])])
        reason = "a sum of violations and other quantities has no counterpart"
        raise self._context.unsupported(node, reason)

    def _product(self, parts: Sequence[dict[str, Fraction]]) -> dict[str, Fraction]:
        result: dict[str, Fraction] = {_CONSTANT: Fraction(1)}
        for part in parts:
            left, right = (result, part) if part.keys() <= {_CONSTANT} else (part, result)
            result = _sum([(right.get(_CONSTANT, Fraction(0)), left)])
        return result


def _sum(parts: Iterable[tuple[Fraction | int, dict[str, Fraction]]]) -> dict[str, Fraction]:
    total: dict[str, Fraction] = {}
    for factor, part in parts:
        for name, weight in part.items():
            total[name] = total.get(name, Fraction(0)) + factor * weight
    return total


def mentions(kind: type[Node], *nodes: Node) -> bool:
    """Tell whether nodes have one of a kind within them.

    Args:
        kind: the kind of node.
        nodes: where to look.

    Returns:
        Whether there is one.
    """
    return any(isinstance(node, kind) for node in walk(*nodes))
