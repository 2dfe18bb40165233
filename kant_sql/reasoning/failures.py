"""The parts of a condition that do not hold."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from typing_extensions import override

from .. import html
from ..dto import formulas as f
from ..history.revisions import Revision
from ..knowledge.grounding import Binding, bound, substitute
from ..knowledge.resolved import Resolver
from .arithmetic import Exact, decimal_of
from .evaluate import Compiler, Conditions
from .world import World

# The caption of one item in notebooks.
FAILED = "failed condition"
# The maximum number of named parts of one universal quantifier.
MAX_INSTANCES = 20
# Why an effect has no result.
NO_OBJECT = "an object fluent in it has no value"
UNDEFINED = "its value is undefined: a fluent in it has no value, or it divides by 0"
NO_VALUE = "has no value that could be changed"
BY_ZERO = "the step divides it by 0"
# The number of parts to judge together.
TOGETHER = 200
# How far a duration may deviate from its constraints, as in VAL.
TOLERANCE = Decimal("0.01")
# A comparison of a duration with its limit -> whether their difference satisfies it.
_ALLOWS: dict[str, Callable[[Decimal], bool]] = {
    "=": lambda difference: abs(difference) <= TOLERANCE,
    "<=": lambda difference: difference <= TOLERANCE,
    "<": lambda difference: difference < TOLERANCE,
    ">=": lambda difference: difference >= -TOLERANCE,
    ">": lambda difference: difference > -TOLERANCE,
}


@dataclass(frozen=True)
class FailedCondition(html.OneRow):
    """A part of a condition that does not hold, or another reason why a step fails.

    Attributes:
        condition: the part as PDDL text, with objects for its variables.
        reason: why it fails.
        left: the value of the left side of a comparison; None without a value.
        right: the value of its right side.
        retracted: for a fact that held before, the revision that retracted it, with its time,
            actor and reason.
    """

    condition: str
    reason: str
    left: Decimal | None = None
    right: Decimal | None = None
    retracted: Revision | None = None

    def __str__(self) -> str:
        return f"{self.condition}: {self.reason}"

    def _html_row_(self) -> html.Row:
        by = self.retracted
        return {
            "condition": self.condition,
            "reason": self.reason,
            "left": self.left,
            "right": self.right,
            "retracted in": None if by is None else by.number,
            "retracted at": None if by is None else by.committed_at,
            "who, why, source": None if by is None else tuple(by.said()),
        }


def duration_failure(
    constraint: f.Comparison, left: Decimal | None, right: Decimal | None
) -> list[FailedCondition]:
    """Return how the sides of a constraint on a duration violate it, if they do."""
    if left is not None and right is not None and _ALLOWS[constraint.operator](left - right):
        return []
    reason = f"{sides_text(left, right)}; a duration may deviate by {TOLERANCE}"
    return [FailedCondition(str(constraint), reason, left, right)]


class Explaining(ABC):
    """Finds the parts of closed formulas that do not hold; `said` is the time of judging."""

    said = ""

    @abstractmethod
    def false(self, nodes: Sequence[f.Formula]) -> list[f.Formula]:
        """Return the formulas that do not hold, in order."""

    @abstractmethod
    def counterexamples(self, node: f.Forall) -> Sequence[Sequence[str]]:
        """Return the first `MAX_INSTANCES` objects for which a quantified formula does not hold."""

    @abstractmethod
    def exact(self, expression: f.Expression) -> Exact | None:
        """Return the value of an expression; None without one."""

    def failed_nodes(self, formulas: Iterable[f.Formula]) -> list[f.Formula]:
        """Return the parts that do not hold; replace quantifiers by counterexamples."""
        found: list[f.Formula] = []
        pending = [part for formula in formulas for part in conjuncts(formula)]
        for start in range(0, len(pending), TOGETHER):
            for node in self.false(pending[start : start + TOGETHER]):
                if isinstance(node, f.Forall):
                    bindings = (bound(node.variables, row) for row in self.counterexamples(node))
                    found += self.failed_nodes(substitute(node.formula, one) for one in bindings)
                else:
                    found.append(node)
        return found

    def failure(self, node: f.Formula) -> FailedCondition:
        """Describe why a part does not hold."""
        comparison = node.formula if isinstance(node, f.Not) else node
        if isinstance(comparison, f.Comparison):
            left, right = (self.exact(each) for each in (comparison.left, comparison.right))
            first, second = (None if side is None else decimal_of(side) for side in (left, right))
            said = f"{sides_text(left, right)}{self.said}"
            return FailedCondition(str(node), said, first, second)
        return FailedCondition(str(node), f"does not hold{self.said}")


def conjuncts(formula: f.Formula) -> list[f.Formula]:
    """Return the parts of a conjunction, with negations pushed inwards."""
    found: list[f.Formula] = []
    stack: list[tuple[f.Formula, bool]] = [(formula, False)]
    while stack:
        part, negated = stack.pop()
        match part:
            case f.Not(inner):
                stack.append((inner, not negated))
            case f.And(parts) if not negated:
                stack += [(inner, False) for inner in reversed(parts)]
            case f.Or(parts) if negated:
                stack += [(inner, True) for inner in reversed(parts)]
            case f.Imply(condition, then) if negated:
                stack += [(then, True), (condition, False)]
            case f.Exists(variables, inner) if negated:
                found.append(f.Forall(variables, f.Not(inner)))
            case _:
                found.append(f.Not(part) if negated else part)
    return found


class _InMemory(Explaining):
    """Explains conditions in a world."""

    def __init__(self, world: World, duration: Decimal | None) -> None:
        self._world = world
        self._duration = duration
        self._conditions = Conditions(world)

    @override
    def false(self, nodes: Sequence[f.Formula]) -> list[f.Formula]:
        holds, duration = self._conditions.holds, self._duration
        return [node for node in nodes if not holds(node, {}, duration)]

    @override
    def counterexamples(self, node: f.Forall) -> Sequence[Sequence[str]]:
        resolver, compiler = Resolver(self._world.definitions), Compiler(self._world)
        _, find = compiler.counterexamples(resolver, node.variables, node.formula)
        rows = sorted(find(compiler.env(duration=self._duration)))
        return [self._world.names(row) for row in rows[:MAX_INSTANCES]]

    @override
    def exact(self, expression: f.Expression) -> Exact | None:
        return self._conditions.exact_number(expression, {}, self._duration)


def failed_parts(
    world: World, formula: f.Formula, binding: Binding, duration: Decimal | None = None
) -> list[FailedCondition]:
    """Return the parts of a condition that do not hold in a world."""
    explaining = _InMemory(world, duration)
    return [
        explaining.failure(node) for node in explaining.failed_nodes([substitute(formula, binding)])
    ]


def sides_text(left: Exact | None, right: Exact | None) -> str:
    """Write the values of both sides of a comparison."""
    return f"the sides are {_side(left)} and {_side(right)}"


def _side(side: Exact | None) -> str:
    if side is None:
        return "no value"
    number = decimal_of(side)
    text = f"{number:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if number == side:
        return text
    fraction = str(Fraction(side))
    return fraction if len(fraction) <= len(text) else f"about {text}"
