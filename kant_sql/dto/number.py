"""Numbers as PDDL text: digits with a decimal point, exact, and never an exponent."""

from __future__ import annotations

from decimal import Decimal

from ..errors import InvalidKnowledgeError

# So many digits carry any double exactly written out, and no text grows beyond bounds.
MAX_DIGITS = 400


def decimal_text(number: Decimal) -> str:
    """Write an exact number.

    Args:
        number: the number.

    Returns:
        Its text, with as many decimals as were given.

    Raises:
        InvalidKnowledgeError: it is not finite, or has more than `MAX_DIGITS` digits.
    """
    digits, exponent = number.as_tuple().digits, number.as_tuple().exponent
    if not isinstance(exponent, int) or max(len(digits) + exponent, -exponent) > MAX_DIGITS:
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
