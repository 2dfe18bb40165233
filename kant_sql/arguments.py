"""What is given to a call: checked where it comes in, and named in the refusal.

A refusal says which argument it is about, what was expected, and what was given instead.
"""

from __future__ import annotations

import math
import reprlib
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from itertools import islice
from typing import Any, TypeVar

from .errors import (
    InvalidArgumentError,
    InvalidKnowledgeError,
    InvalidTimeoutError,
    KantSqlError,
)

T = TypeVar("T")

# Longer than any list that knowledge has: an iterator without end is refused.
MAX_ITEMS = 1_000_000
# Integers of more bits are not written out: Python refuses that from 4,300 digits on.
_PRINTABLE_BITS = 400
_TEXTS = (str, bytes, bytearray, memoryview)


class _Shown(reprlib.Repr):
    """Bounds what a message shows of a value, and survives values that cannot be shown."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = 80
        self.maxlong = 60

    def repr1(self, x: Any, level: int) -> str:
        if isinstance(x, int) and not isinstance(x, bool):
            return self.repr_int(x, level)
        try:
            return super().repr1(x, level)
        except Exception:
            # Its class may only be named like one that reprlib knows.
            return self.repr_instance(x, level)

    def repr_int(self, x: int, level: int) -> str:
        if int.bit_length(x) > _PRINTABLE_BITS:
            return f"an integer of {int.bit_length(x)} bits"
        return int.__repr__(x)


_REPR = _Shown()


def shown(value: object, length: int = 80) -> str:
    """Show a value in a message: bounded, on one line, and whatever its `repr()` does.

    Args:
        value: the value.
        length: the most characters to give.

    Returns:
        Its `repr()`, shortened.
    """
    return " ".join(_REPR.repr(value).split("\n"))[:length]


def refusal(
    role: str, expected: str, value: object, error: type[KantSqlError] = InvalidKnowledgeError
) -> KantSqlError:
    """Make the error for an argument.

    Args:
        role: what the argument is, for example `the predicate of a proposition`.
        expected: what it has to be, for example `a PddlPredicateDto`.
        value: what was given.
        error: the class of the error.

    Returns:
        The error.
    """
    return error(f"{role} is {expected}, not {type(value).__name__}: {shown(value)}")


def expect(
    value: Any,
    wanted: type[T] | tuple[type[T], ...],
    role: str,
    error: type[KantSqlError] = InvalidKnowledgeError,
    expected: str | None = None,
) -> T:
    """Check that a value is of the class that its place asks for.

    Args:
        value: the value.
        wanted: the class, or several.
        role: what the value is, for the message.
        error: the class of the error.
        expected: what it has to be, for the message; by default one of the classes.

    Returns:
        The value.

    Raises:
        InvalidKnowledgeError: it is something else.
    """
    if not isinstance(value, wanted):
        raise refusal(role, expected or _named(wanted), value, error)
    return value


def _named(wanted: type | tuple[type, ...]) -> str:
    names = [each.__name__ for each in (wanted if isinstance(wanted, tuple) else (wanted,))]
    return f"a {' or '.join(names)}"


def expect_list(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> Sequence[T]:
    """Check that a value is a list, or a tuple, of what its place asks for.

    Args:
        value: the value.
        wanted: the class, or several.
        role: what the list is, for the message.

    Returns:
        The value.

    Raises:
        InvalidKnowledgeError: it, or something in it, is something else.
    """
    if not isinstance(value, tuple):
        expect(value, list, role)
    for item in value:
        if not isinstance(item, wanted):
            expect(item, wanted, f"each item of {role}")
    return value  # type: ignore[no-any-return]


def expect_tuple(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> tuple[T, ...]:
    """Check what is to be a tuple, and make one of a list.

    Args:
        value: a tuple or a list.
        wanted: the class of each item, or several.
        role: what the tuple is, for the message.

    Returns:
        The tuple.

    Raises:
        InvalidKnowledgeError: it, or something in it, is something else.
    """
    kind = type(value)
    if kind is not tuple:
        if not isinstance(value, list | tuple):
            raise refusal(role, "a tuple", value)
        value = tuple(value)
    for item in value:
        if not isinstance(item, wanted):
            expect(item, wanted, f"each item of {role}")
    return value  # type: ignore[no-any-return]


def items(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> list[T]:
    """Copy what is to be a list, and check what is in it.

    Args:
        value: an iterable with an order; None for no items.
        wanted: the class of each item, or several.
        role: what the list is, for the message.

    Returns:
        The items.

    Raises:
        InvalidKnowledgeError: it has no order, something in it is of another class, or it does not
            end.
    """
    kind = type(value)
    if kind is list or kind is tuple:
        given = list(value)
    elif value is None:
        return []
    else:
        given = _collected(value, wanted, role)
    for item in given:
        if not isinstance(item, wanted):
            expect(item, wanted, f"each item of {role}")
    return given


def _collected(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> list[T]:
    if isinstance(value, Mapping | Set):
        raise refusal(role, "a list, which has an order", value)
    iterator = iterate(value, role)
    given = []
    for item in islice(iterator, MAX_ITEMS + 1):
        # Checked as it comes: an iterator without end is refused with its first wrong item.
        given.append(expect(item, wanted, f"each item of {role}"))
    if len(given) > MAX_ITEMS:
        raise InvalidKnowledgeError(f"{role} has more than {MAX_ITEMS} items; split it up")
    return given


def iterate(value: Any, role: str, expected: str = "a list") -> Iterator[Any]:
    """Begin to iterate over what has several items.

    Args:
        value: an iterable.
        role: what it is, for the message.
        expected: what it has to be, for the message.

    Returns:
        The iterator; what it raises is the caller's own error, and passes.

    Raises:
        InvalidKnowledgeError: it is not iterable, or a text.
    """
    if isinstance(value, _TEXTS) or not isinstance(value, Iterable):
        raise refusal(role, expected, value)
    try:
        return iter(value)
    except Exception as error:
        raise refusal(role, f"{expected} that can be iterated over", value) from error


def whole_number(
    value: Any,
    role: str,
    *,
    least: int | None = 0,
    expected: str = "a whole number from 0 on",
    error: type[KantSqlError] = InvalidArgumentError,
) -> int:
    """Check a whole number.

    Args:
        value: the number; True and False are none.
        role: what it is, for the message.
        least: the least that it can be; None for any.
        expected: what it has to be, for the message.
        error: the class of the error.

    Returns:
        The number.

    Raises:
        InvalidArgumentError: it is no whole number, or too small.
    """
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or (least is not None and value < least):
        raise refusal(role, expected, value, error)
    return value  # type: ignore[no-any-return]


def seconds(timeout: Any) -> float:
    """Check how long to wait.

    Args:
        timeout: seconds; None for as long as it takes.

    Returns:
        The seconds; infinity for None.

    Raises:
        InvalidTimeoutError: it is no number, or negative.
    """
    if timeout is None:
        return math.inf
    is_number = isinstance(timeout, int | float) and not isinstance(timeout, bool)
    if not is_number or not timeout >= 0:
        expected = "a number of seconds from 0 on, or None for as long as it takes"
        raise refusal("timeout", expected, timeout, InvalidTimeoutError)
    # A larger integer is not added to a time.
    return float(min(timeout, sys.float_info.max))


def optional_text(
    value: Any, role: str, error: type[KantSqlError] = InvalidArgumentError
) -> str | None:
    """Check a text that may be left out.

    Args:
        value: the text, or None.
        role: what it is, for the message.
        error: the class of the error.

    Returns:
        The value.

    Raises:
        InvalidArgumentError: it is neither a string nor None.
    """
    if value is not None and not isinstance(value, str):
        raise refusal(role, "a string or None", value, error)
    return value


def optional_call(value: Any, role: str) -> None:
    """Check what is to be called back.

    Args:
        value: a function, or None.
        role: what it is, for the message.

    Raises:
        InvalidArgumentError: it cannot be called.
    """
    if value is not None and not callable(value):
        raise refusal(role, "a function or None", value, InvalidArgumentError)


def one_of(
    value: Any,
    choices: Sequence[str],
    role: str,
    error: type[KantSqlError] = InvalidArgumentError,
) -> str:
    """Check a word of a few.

    Args:
        value: the word.
        choices: the words that there are.
        role: what it is, for the message.
        error: the class of the error.

    Returns:
        The word.

    Raises:
        InvalidArgumentError: it is none of them.
    """
    if not isinstance(value, str) or value not in choices:
        few = " or ".join(map(repr, choices))
        expected = few if len(choices) < 3 else f"one of {', '.join(choices)}"
        raise error(f"{role} is {shown(value)}, expected {expected}")
    return value


def flag(value: Any, role: str, error: type[KantSqlError] = InvalidKnowledgeError) -> bool:
    """Check a truth value.

    Args:
        value: the value.
        role: what it is, for the message.
        error: the class of the error.

    Returns:
        The value.

    Raises:
        InvalidKnowledgeError: it is neither True nor False.
    """
    if value is not True and value is not False:
        raise refusal(role, "True or False", value, error)
    return value
