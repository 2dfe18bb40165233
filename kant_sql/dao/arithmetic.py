"""Exact decimal arithmetic on the values of functions."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Context, Decimal, Inexact, localcontext

from ..dto.number import MAX_DIGITS
from ..errors import InvalidKnowledgeError

# What no decimal says exactly, as a third, or not in `MAX_DIGITS` digits, is rounded to so many.
ROUNDED_DIGITS = 28

Operation = Callable[[Context, Decimal, Decimal], Decimal]


def _divide(context: Context, number: Decimal, by: Decimal) -> Decimal:
    if not by:
        raise InvalidKnowledgeError("no number can be divided by 0")
    return context.divide(number, by)


INCREASE: Operation = Context.add
DECREASE: Operation = Context.subtract
SCALE_UP: Operation = Context.multiply
SCALE_DOWN: Operation = _divide


def calculate(operation: Operation, number: Decimal, by: Decimal) -> Decimal:
    """Calculate exactly, where the result has an end and at most `MAX_DIGITS` digits.

    Args:
        operation: one of the four of this module.
        number: the number.
        by: by how much.

    Returns:
        The result; else rounded to `ROUNDED_DIGITS` significant digits.

    Raises:
        InvalidKnowledgeError: it is a division by zero.
    """
    with localcontext(prec=MAX_DIGITS) as context:
        context.clear_flags()
        result = operation(context, number, by)
        if not context.flags[Inexact] and -int(result.as_tuple().exponent) <= MAX_DIGITS:
            return result
        context.prec = ROUNDED_DIGITS
        return operation(context, number, by)
