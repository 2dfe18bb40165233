"""Arithmetic of conditions, effects and continuous change.

Conditions and effects calculate exactly: with decimals, or with fractions if a quotient has no
finite decimal. While numbers change linearly, both sides of a comparison are exact linear functions
of the time since the change began.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from decimal import Context, Decimal
from fractions import Fraction
from typing import Any, Generic, NamedTuple, TypeVar

from ..dao.function_value import INCREASE, ROUNDED_DIGITS, SCALE_DOWN, calculate
from ..dto.lexical import EXACT_DECIMALS
from ..errors import UnsupportedConstructError

T = TypeVar("T")
Exact = Decimal | Fraction

# The operators of effects on fluents, as operators of arithmetic.
CHANGES = {"increase": "+", "decrease": "-", "scale-up": "*", "scale-down": "/"}
# Changes of one of these kinds commute.
ADDITIVE, SCALING = {"increase", "decrease"}, {"scale-up", "scale-down"}


def _operations(context: Context) -> dict[str, Callable[[Any, Any], Decimal]]:
    add, subtract = context.add, context.subtract
    return {"+": add, "-": subtract, "*": context.multiply, "/": context.divide}


_DECIMALS = _operations(EXACT_DECIMALS)
# Few digits, as in most numbers; longer ones, and non-decimals, raise one of the errors.
_FEW = Context(ROUNDED_DIGITS, Emin=-ROUNDED_DIGITS, Emax=ROUNDED_DIGITS)
_FEW.traps = dict.fromkeys(_FEW.traps, True)
FEW_DIGITS, NOT_FEW = _operations(_FEW), (TypeError, ArithmeticError)
_FRACTIONS: dict[str, Callable[[Any, Any], Fraction]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}


class Numbers(NamedTuple, Generic[T]):
    """A kind of numbers: `apply` takes `+`, `-`, `*` or `/`, and returns None for division by 0."""

    of: Callable[[Decimal], T]
    apply: Callable[[str, T, T], T | None]

    def calculate(self, symbol: str, operands: Sequence[T | None]) -> T | None:
        """Apply an operator to one or more operands; None if one has no value."""
        found = operands[0]
        if len(operands) == 1:
            return None if found is None else self.apply("-", self.of(Decimal(0)), found)
        for operand in operands[1:]:
            if found is None or operand is None:
                return None
            found = self.apply(symbol, found, operand)
        return found


def _exact(symbol: str, left: Exact, right: Exact) -> Exact | None:
    try:
        return FEW_DIGITS[symbol](left, right)
    except NOT_FEW:
        if symbol == "/" and not right:
            return None
    if symbol != "/" and isinstance(left, Decimal) and isinstance(right, Decimal):
        return _DECIMALS[symbol](left, right)
    return _FRACTIONS[symbol](Fraction(left), Fraction(right))


class Linear(NamedTuple):
    """A linear function of time: `value + rate * time`."""

    value: Fraction
    rate: Fraction

    def at(self, time: Fraction) -> Fraction:
        """Return the value at a time."""
        return self.value + self.rate * time


def _linear(symbol: str, left: Linear, right: Linear) -> Linear | None:
    if symbol in "+-":
        return Linear(*map(_FRACTIONS[symbol], left, right))
    if right.rate and (left.rate or symbol == "/"):
        what = "product of two numbers that change"
        if symbol == "/":
            what = "division by a number that changes"
        raise UnsupportedConstructError(
            f"a {what} continuously is not linear in time; only linear change can be validated"
        )
    if symbol == "*":
        rate = left.rate * right.value + left.value * right.rate
        return Linear(left.value * right.value, rate)
    return Linear(left.value / right.value, left.rate / right.value) if right.value else None


EXACT: Numbers[Exact] = Numbers(lambda number: number, _exact)
LINEARS: Numbers[Linear] = Numbers(lambda number: Linear(Fraction(number), Fraction(0)), _linear)


def decimal_of(number: Exact) -> Decimal:
    """Convert a number for writing: exactly, if it has a finite decimal of few enough digits."""
    if isinstance(number, Decimal):
        text = str(number)
        if len(text) <= ROUNDED_DIGITS and "E" not in text:
            # Few digits, as in most numbers: there is nothing to round.
            return number
        return calculate(INCREASE, number, Decimal(0))
    return calculate(SCALE_DOWN, Decimal(number.numerator), Decimal(number.denominator))
