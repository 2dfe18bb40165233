"""Checks of arguments; an error names the argument, the expected and the given value."""

from __future__ import annotations

import math
import re
import reprlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from datetime import datetime, timedelta
from itertools import islice
from typing import Any, TypeVar

from typing_extensions import TypeIs

from .errors import InvalidArgumentError, InvalidKnowledgeError, InvalidTimeoutError, KantSqlError

T = TypeVar("T")

# Called with the number of items done, and the number in total.
Progress = Callable[[int, int], None]

# No list of knowledge is longer; the limit refuses endless iterators.
MAX_ITEMS = 1_000_000
# Messages shorten longer integers: Python refuses to write 4,300 digits or more.
_PRINTABLE_BITS = 400
# The environment variable that names the store if no URL is given.
URL_VARIABLE = "KANT_SQL_URL"
# Characters that no text of a store has.
UNSTORABLE = re.compile("[\0\ud800-\udfff]")
_TEXTS = (str, bytes, bytearray, memoryview)


class Readable:
    """A value that messages show by its `str()`, not its `repr()`."""

    __slots__ = ()


class _Shown(reprlib.Repr):
    """A bounded `repr` that never fails."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = 80
        self.maxlong = 60

    def repr1(self, x: Any, level: int) -> str:
        if isinstance(x, int) and not isinstance(x, bool):
            return self.repr_int(x, level)
        try:
            if isinstance(x, datetime):
                return x.isoformat()
            return str(x) if isinstance(x, Readable) else super().repr1(x, level)
        except Exception:
            # Its class may share its name with a class that reprlib knows.
            return self.repr_instance(x, level)

    def repr_int(self, x: int, level: int) -> str:
        if int.bit_length(x) > _PRINTABLE_BITS:
            return f"an integer of {int.bit_length(x)} bits"
        return int.__repr__(x)


_REPR = _Shown()


def shown(value: object, length: int = 80) -> str:
    """Return a value for a message: bounded, on one line, even if its `repr()` fails."""
    return " ".join(_REPR.repr(value).split("\n"))[:length]


def refusal(
    role: str, expected: str, value: object, error: type[KantSqlError] = InvalidKnowledgeError
) -> KantSqlError:
    """Make the error for an argument."""
    return error(f"{role} is {expected}, not {type(value).__name__}: {shown(value)}")


def expect(
    value: Any,
    wanted: type[T] | tuple[type[T], ...],
    role: str,
    error: type[KantSqlError] = InvalidKnowledgeError,
    expected: str | None = None,
) -> T:
    """Check the class of a value."""
    if not isinstance(value, wanted):
        raise refusal(role, expected or _named(wanted), value, error)
    return value


def _named(wanted: type | tuple[type, ...]) -> str:
    names = [each.__name__ for each in (wanted if isinstance(wanted, tuple) else (wanted,))]
    return f"a {' or '.join(names)}"


def is_many(given: object) -> TypeIs[list[Any] | tuple[Any, ...]]:
    """Return whether the argument of `save` is a list of elements."""
    return isinstance(given, list | tuple)


def refuse_many(given: object) -> None:
    """Refuse a list in place of one element."""
    if is_many(given):
        raise InvalidKnowledgeError(
            "this takes one element, not a list: save, save_all and delete_all take lists"
        )


def expect_list(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> Sequence[T]:
    """Check a list or tuple and the class of its items."""
    if not isinstance(value, list | tuple):
        expect(value, list, role)
    for item in value:
        if not isinstance(item, wanted):
            expect(item, wanted, f"each item of {role}")
    return value  # type: ignore[no-any-return]


def expect_tuple(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> tuple[T, ...]:
    """Check a tuple and the class of its items; convert a list."""
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
    """Copy an iterable to a list, and check the class of its items."""
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
        # Check items one by one, so an endless iterator fails at its first wrong item.
        given.append(expect(item, wanted, f"each item of {role}"))
    if len(given) > MAX_ITEMS:
        raise InvalidKnowledgeError(f"{role} has more than {MAX_ITEMS} items; split it up")
    return given


def iterate(
    value: Any,
    role: str,
    expected: str = "a list",
    error: type[KantSqlError] = InvalidKnowledgeError,
) -> Iterator[Any]:
    """Return an iterator over a value that is not text."""
    if isinstance(value, _TEXTS) or not isinstance(value, Iterable):
        raise refusal(role, expected, value, error)
    try:
        return iter(value)
    except Exception as failed:
        raise refusal(role, f"{expected} that can be iterated over", value, error) from failed


def whole_number(
    value: Any,
    role: str,
    *,
    least: int | None = 0,
    expected: str = "a whole number from 0 on",
    error: type[KantSqlError] = InvalidArgumentError,
) -> int:
    """Check a whole number."""
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or (least is not None and value < least):
        raise refusal(role, expected, value, error)
    return value  # type: ignore[no-any-return]


def count_limit(value: Any, role: str = "the limit") -> int:
    """Check a limit; a database never counts more."""
    return min(whole_number(value, role), sys.maxsize)


def seconds(timeout: Any) -> float:
    """Check a timeout; None is infinite."""
    if timeout is None:
        return math.inf
    is_number = isinstance(timeout, int | float) and not isinstance(timeout, bool)
    if not is_number or not timeout >= 0:
        expected = "a number of seconds from 0 on, or None for as long as it takes"
        raise refusal("timeout", expected, timeout, InvalidTimeoutError)
    # Larger integers cannot be added to a time.
    return float(min(timeout, sys.float_info.max))


# A longer age means: did it ever happen?
_LONGEST = timedelta(days=365 * 100)


def period(value: Any, role: str) -> timedelta:
    """Check a number of seconds, from 0; cap it at a century."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not value >= 0:
        raise refusal(role, "a number of seconds, from 0", value, InvalidArgumentError)
    limit = _LONGEST.total_seconds()
    return _LONGEST if value >= limit else timedelta(seconds=value)


def optional_text(
    value: Any, role: str, error: type[KantSqlError] = InvalidArgumentError
) -> str | None:
    """Check a text or None."""
    if value is not None and not isinstance(value, str):
        raise refusal(role, "a string or None", value, error)
    return value


def storable_text(
    value: Any, role: str, error: type[KantSqlError] = InvalidArgumentError
) -> str | None:
    """Check a text, or None, that a database can store unchanged."""
    text = optional_text(value, role, error)
    if UNSTORABLE.search(text or ""):
        raise error(
            f"{role} {shown(text)} has a NUL character or an unpaired surrogate; leave it out"
        )
    return text


def optional_call(value: Any, role: str) -> None:
    """Check a callable or None."""
    if value is not None and not callable(value):
        raise refusal(role, "a function or None", value, InvalidArgumentError)


def one_of(
    value: Any,
    choices: Sequence[str],
    role: str,
    error: type[KantSqlError] = InvalidArgumentError,
) -> str:
    """Check that a word is one of the given."""
    if not isinstance(value, str) or value not in choices:
        few = " or ".join(map(repr, choices))
        expected = few if len(choices) < 3 else f"one of {', '.join(choices)}"
        raise error(f"{role} is {shown(value)}, expected {expected}")
    return value


def flag(value: Any, role: str, error: type[KantSqlError] = InvalidKnowledgeError) -> bool:
    """Check a boolean."""
    if value is not True and value is not False:
        raise refusal(role, "True or False", value, error)
    return value
