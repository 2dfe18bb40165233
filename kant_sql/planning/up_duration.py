"""The duration of a durative action: in unified-planning an interval between two bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from ..dto.formula import (
    AT_END,
    And,
    Comparison,
    Expression,
    Fluent,
    Formula,
    Timed,
    Variable,
)
from ..dto.name import fold
from ..dto.node import walk
from ..pddl.document import Action
from .context import Context, Scope
from .up_formulas import Formulas

if TYPE_CHECKING:
    from unified_planning.model import DurationInterval, FNode

DURATION = "duration"
_FLIPPED = {"<": ">", "<=": ">=", "=": "=", ">=": "<=", ">": "<"}


def duration(
    action: Action, scope: Scope, context: Context, formulas: Formulas
) -> DurationInterval:
    """Convert what a durative action says of its duration.

    Args:
        action: the action.
        scope: its parameters.
        context: the conversion.
        formulas: what converts expressions.

    Returns:
        The interval; without a lower bound it begins at 0.

    Raises:
        UnsupportedConstructError: there is no upper bound, or more than an interval is said.
    """
    from unified_planning.model import DurationInterval

    lower: list[tuple[FNode, bool]] = []
    upper: list[tuple[FNode, bool]] = []
    for operator, bound in _bounds(action.duration, context):
        node = formulas.expression(bound, scope)
        if operator in {"=", ">", ">="}:
            lower.append((node, operator == ">"))
        if operator in {"=", "<", "<="}:
            upper.append((node, operator == "<"))
    if not upper:
        text = " ".join(map(str, action.duration)) or "a duration without a bound"
        raise context.unsupported(text, "the duration needs an upper bound; give it one")
    zero = (context.environment.expression_manager.Int(0), False)
    (least, left), (most, right) = (
        _tightest(lower or [zero], 1, context),
        _tightest(upper, -1, context),
    )
    return DurationInterval(least, most, left, right)


def fixed(action: Action, context: Context) -> Expression | None:
    """Give the value of a duration that is fixed when the action starts.

    Args:
        action: a durative action.
        context: the conversion.

    Returns:
        The value, when it is the same throughout the action; else None.
    """
    bounds = list(_bounds(action.duration, context))
    if len(bounds) == 1 and bounds[0][0] == "=" and _is_static(bounds[0][1], context):
        return bounds[0][1]
    return None


def _bounds(
    constraints: Iterable[Formula], context: Context, time: str | None = None
) -> Iterator[tuple[str, Expression]]:
    for constraint in constraints:
        match constraint:
            case And(parts):
                yield from _bounds(parts, context, time)
            case Timed(when, inner):
                yield from _bounds([inner], context, when)
            case Comparison(operator, left, right):
                if not _is_duration(left):
                    operator, left, right = _FLIPPED[operator], right, left
                if not _is_duration(left) or any(map(_is_duration, walk(right))):
                    raise context.unsupported(constraint, "it is no bound of ?duration")
                if time == AT_END and not _is_static(right, context):
                    reason = "a bound that is only known at the end has no counterpart"
                    raise context.unsupported(constraint, reason)
                yield operator, right
            case _:
                raise context.unsupported(constraint, "it is no bound of ?duration")


def _is_duration(node: object) -> bool:
    return isinstance(node, Variable) and fold(node.name) == DURATION


def _is_static(node: Expression, context: Context) -> bool:
    return all(
        fold(part.function) in context.static for part in walk(node) if isinstance(part, Fluent)
    )


def _tightest(bounds: list[tuple[FNode, bool]], sign: int, context: Context) -> tuple[FNode, bool]:
    distinct = list(dict.fromkeys(bounds))
    if len(distinct) == 1:
        return distinct[0]
    if not all(node.is_constant() for node, _ in distinct):
        text = " and ".join(str(node) for node, _ in distinct)
        raise context.unsupported(text, "a duration has one lower and one upper bound there")
    return max(distinct, key=lambda bound: (sign * bound[0].constant_value(), bound[1]))
