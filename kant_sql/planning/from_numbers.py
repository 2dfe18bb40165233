"""The fractions of unified-planning as the decimal numbers of PDDL."""

from __future__ import annotations

from decimal import Context, Decimal, Inexact
from fractions import Fraction

from ..dto.formula import Arithmetic, Number

_EXACT = Context(prec=60, traps=[Inexact])


def number(value: int | Fraction) -> Number | Arithmetic:
    """Write a number, exactly.

    Args:
        value: the number.

    Returns:
        The number, or a quotient where no decimal number is equal to it.
    """
    if isinstance(value, int):
        return Number(Decimal(value))
    try:
        return Number(_EXACT.divide(Decimal(value.numerator), Decimal(value.denominator)))
    except Inexact:
        parts = (Number(Decimal(value.numerator)), Number(Decimal(value.denominator)))
        return Arithmetic("/", parts)
