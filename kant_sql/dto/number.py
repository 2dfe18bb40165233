"""Numbers as PDDL text: digits with a decimal point, exact, and never an exponent."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite
from typing import Any

from ..arguments import refusal
from ..errors import InvalidKnowledgeError

# So many digits carry any double exactly written out, and no text grows beyond bounds.
MAX_DIGITS = 400
_NUMBERS = (int, float, Decimal)


def check_number(value: Any, role: str) -> Decimal:
    """Check a number that knowledge can have.

    Args:
        value: an `int`, a `Decimal`, or a `float`, which is taken by its shortest digits; True and
            False are none.
        role: what it is, for the message.

    Returns:
        The number, exactly.

    Raises:
        InvalidKnowledgeError: it is none, not finite, or has more than `MAX_DIGITS` digits.
    """
    kind = type(value)
    # Decided by the class for most: a load checks hundreds of thousands.
    if kind is float and isfinite(value):
        # A double has at most 340 digits.
        return Decimal(repr(value))
    if kind is bool or not isinstance(value, _NUMBERS):
        raise refusal(role, "a number", value)
    number = Decimal(float.__repr__(value)) if isinstance(value, float) else Decimal(value)
    if not _is_writable(number):
        raise refusal(role, f"a finite number of at most {MAX_DIGITS} digits", value)
    return number


def _is_writable(number: Decimal) -> bool:
    _, digits, exponent = number.as_tuple()
    return isinstance(exponent, int) and max(len(digits) + exponent, -exponent) <= MAX_DIGITS


def decimal_text(number: Decimal) -> str:
    """Write an exact number.

    Args:
        number: the number.

    Returns:
        Its text, with as many decimals as were given.

    Raises:
        InvalidKnowledgeError: it is not finite, or has more than `MAX_DIGITS` digits.
    """
    if not _is_writable(number):
        raise InvalidKnowledgeError(
            f"{str(number)[:60]} is no number that PDDL text carries; give a finite number of at "
            f"most {MAX_DIGITS} digits"
        )
    # Zero has no sign.
    return format(number if number else number.copy_abs(), "f")


def number_text(number: int | float | Decimal) -> str:
    """Write a number.

    Args:
        number: the number; a `float` by the shortest digits that denote it.

    Returns:
        Its text, for example `10` or `2.5`; a float always has a point.

    Raises:
        InvalidKnowledgeError: as `decimal_text`.
    """
    if isinstance(number, float):
        # The point tells a float from an int when it is read back; the sum has no negative zero.
        text = decimal_text(Decimal(repr(float(number) + 0.0)))
        return text if "." in text else f"{text}.0"
    return decimal_text(Decimal(number))
