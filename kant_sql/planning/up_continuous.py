"""Continuous effects: how fast a number changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..dto.formula import Arithmetic, Assign, Constant, ContinuousTime, Expression
from ..dto.node import walk
from .context import Context
from .up_effects import Effect, number_of
from .up_formulas import Formulas

if TYPE_CHECKING:
    from unified_planning.model import FNode


def is_continuous(effect: Effect) -> bool:
    """Tell whether an effect is continuous.

    Args:
        effect: the effect.

    Returns:
        Whether its value mentions `#t`.
    """
    change = effect.change
    if not isinstance(change, Assign) or isinstance(change.value, Constant):
        return False
    return _has_time(change.value)


class Rates:
    """Converts the rates of continuous effects."""

    def __init__(self, context: Context, formulas: Formulas) -> None:
        """Convert within a context.

        Args:
            context: the conversion.
            formulas: what converts expressions.
        """
        self._context, self._formulas = context, formulas
        self._manager = context.environment.expression_manager

    def rate(self, effect: Effect) -> FNode:
        """Convert the rate of a continuous effect.

        Args:
            effect: the effect, of which `is_continuous` is true.

        Returns:
            The change in a unit of time.

        Raises:
            UnsupportedConstructError: it is no multiple of `#t`.
        """
        if getattr(effect.change, "operator", None) not in {"increase", "decrease"}:
            raise self._context.unsupported(effect.change, "it gives no rate of change")
        return self._rate(number_of(effect.change), effect)

    def _rate(self, node: Expression, effect: Effect) -> FNode:
        match node:
            case ContinuousTime():
                return self._manager.Int(1)
            case Arithmetic("*", operands):
                timed = [part for part in operands if _has_time(part)]
                if len(timed) == 1:
                    factors = [
                        self._formulas.expression(part, effect.scope)
                        for part in operands
                        if part is not timed[0]
                    ]
                    if isinstance(timed[0], ContinuousTime):
                        return self._manager.Times(factors)
                    return self._manager.Times(self._rate(timed[0], effect), *factors)
            case Arithmetic("/", (dividend, divisor)) if not _has_time(divisor):
                return self._manager.Div(
                    self._rate(dividend, effect), self._formulas.expression(divisor, effect.scope)
                )
        raise self._context.unsupported(effect.change, "it is no multiple of #t")


def _has_time(node: Expression) -> bool:
    return any(isinstance(part, ContinuousTime) for part in walk(node))
