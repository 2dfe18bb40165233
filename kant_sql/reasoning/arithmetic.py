"""The numbers of conditions, effects and continuous change.

Conditions and effects calculate exactly: with decimals, and with fractions where a quotient has no
end. While numbers change linearly, both sides of a comparison are exact linear functions of the
time since the change began.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from decimal import Context, Decimal, Inexact
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

from typing_extensions import override

from ..dao.function_value import INCREASE, ROUNDED_DIGITS, SCALE_DOWN, calculate
from ..dto.lexical import EXACT_DECIMALS
from ..errors import UnsupportedConstructError

T = TypeVar("T")
Exact = Decimal | Fraction


class Numbers(ABC, Generic[T]):
    """A kind of numbers. No result (None) stands for a division by zero."""

    @abstractmethod
    def of(self, number: Decimal) -> T:
        """Convert a number."""

    @abstractmethod
    def add(self, left: T, right: T) -> T | None:
        """Add."""

    @abstractmethod
    def subtract(self, left: T, right: T) -> T | None:
        """Subtract."""

    @abstractmethod
    def multiply(self, left: T, right: T) -> T | None:
        """Multiply."""

    @abstractmethod
    def divide(self, left: T, right: T) -> T | None:
        """Divide."""

    def apply(self, operator: str, left: T, right: T) -> T | None:
        """Apply one of `+`, `-`, `*` and `/`."""
        if operator == "+":
            return self.add(left, right)
        if operator == "-":
            return self.subtract(left, right)
        return self.multiply(left, right) if operator == "*" else self.divide(left, right)


class Exacts(Numbers[Exact]):
    """Decimals, or fractions where a quotient of decimals has no end."""

    @override
    def of(self, number: Decimal) -> Exact:
        return number

    @override
    def add(self, left: Exact, right: Exact) -> Exact:
        if isinstance(left, Decimal) and isinstance(right, Decimal):
            return EXACT_DECIMALS.add(left, right)
        return Fraction(left) + Fraction(right)

    @override
    def subtract(self, left: Exact, right: Exact) -> Exact:
        if isinstance(left, Decimal) and isinstance(right, Decimal):
            return EXACT_DECIMALS.subtract(left, right)
        return Fraction(left) - Fraction(right)

    @override
    def multiply(self, left: Exact, right: Exact) -> Exact:
        if isinstance(left, Decimal) and isinstance(right, Decimal):
            return EXACT_DECIMALS.multiply(left, right)
        return Fraction(left) * Fraction(right)

    @override
    def divide(self, left: Exact, right: Exact) -> Exact | None:
        if not right:
            return None
        if isinstance(left, Decimal) and isinstance(right, Decimal):
            context = Context(prec=ROUNDED_DIGITS)
            result = context.divide(left, right)
            if not context.flags[Inexact]:
                return result
        return Fraction(left) / Fraction(right)


class Linear(NamedTuple):
    """A linear function of time: `value + rate * time`."""

    value: Fraction
    rate: Fraction

    def at(self, time: Fraction) -> Fraction:
        """Return its value at a time."""
        return self.value + self.rate * time


class Linears(Numbers[Linear]):
    """Linear functions of time.

    Raises:
        UnsupportedConstructError: a product or a quotient is not linear.
    """

    @override
    def of(self, number: Decimal) -> Linear:
        return Linear(Fraction(number), Fraction(0))

    @override
    def add(self, left: Linear, right: Linear) -> Linear:
        return Linear(left.value + right.value, left.rate + right.rate)

    @override
    def subtract(self, left: Linear, right: Linear) -> Linear:
        return Linear(left.value - right.value, left.rate - right.rate)

    @override
    def multiply(self, left: Linear, right: Linear) -> Linear:
        if left.rate and right.rate:
            raise _not_linear("a product of two numbers that change")
        rate = left.rate * right.value + left.value * right.rate
        return Linear(left.value * right.value, rate)

    @override
    def divide(self, left: Linear, right: Linear) -> Linear | None:
        if right.rate:
            raise _not_linear("a division by a number that changes")
        if not right.value:
            return None
        return Linear(left.value / right.value, left.rate / right.value)


def _not_linear(construct: str) -> UnsupportedConstructError:
    return UnsupportedConstructError(
        f"{construct} continuously is not linear in time; only linear change can be validated"
    )


EXACT, LINEARS = Exacts(), Linears()
CHANGES: dict[str, Callable[[Exact, Exact], Exact | None]] = {
    "increase": EXACT.add,
    "decrease": EXACT.subtract,
    "scale-up": EXACT.multiply,
    "scale-down": EXACT.divide,
}


def decimal_of(number: Exact) -> Decimal:
    """Convert a number as it is written: exactly, unless it has no end or too many digits."""
    if isinstance(number, Decimal):
        return calculate(INCREASE, number, Decimal(0))
    return calculate(SCALE_DOWN, Decimal(number.numerator), Decimal(number.denominator))
