"""The numbers of conditions, effects and continuous change.

Conditions compare doubles, effects calculate exactly, and while numbers change linearly, both sides
of a comparison are exact linear functions of the time since the change began.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

from typing_extensions import override

from ..dao.function_value import DECREASE, INCREASE, SCALE_DOWN, SCALE_UP, calculate
from ..errors import UnsupportedConstructError

T = TypeVar("T")

COMPARE: dict[str, Callable[[float | Fraction, float | Fraction], bool]] = {
    "<": lambda left, right: left < right,
    "<=": lambda left, right: left <= right,
    "=": lambda left, right: left == right,
    ">=": lambda left, right: left >= right,
    ">": lambda left, right: left > right,
}


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


class Doubles(Numbers[float]):
    """Doubles, as databases and VAL compare."""

    @override
    def of(self, number: Decimal) -> float:
        return float(number)

    @override
    def add(self, left: float, right: float) -> float | None:
        return _finite(left + right)

    @override
    def subtract(self, left: float, right: float) -> float | None:
        return _finite(left - right)

    @override
    def multiply(self, left: float, right: float) -> float | None:
        return _finite(left * right)

    @override
    def divide(self, left: float, right: float) -> float | None:
        return _finite(left / right) if right else None


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


class Decimals(Numbers[Decimal]):
    """Decimals, exact as in `kb.function_values.increase()`."""

    @override
    def of(self, number: Decimal) -> Decimal:
        return number

    @override
    def add(self, left: Decimal, right: Decimal) -> Decimal:
        return calculate(INCREASE, left, right)

    @override
    def subtract(self, left: Decimal, right: Decimal) -> Decimal:
        return calculate(DECREASE, left, right)

    @override
    def multiply(self, left: Decimal, right: Decimal) -> Decimal:
        return calculate(SCALE_UP, left, right)

    @override
    def divide(self, left: Decimal, right: Decimal) -> Decimal | None:
        return calculate(SCALE_DOWN, left, right) if right else None


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


DOUBLES, DECIMALS, LINEARS = Doubles(), Decimals(), Linears()


def decimal_of(number: Fraction) -> Decimal:
    """Convert a fraction, exactly where it has a decimal expansion."""
    found = calculate(SCALE_DOWN, Decimal(number.numerator), Decimal(number.denominator))
    return found.normalize() if found else Decimal(0)
