"""Comparisons of numbers as SQL, exact whatever is calculated.

Numbers are decimals, and a quotient is a pair of them: it is compared by multiplying with the
divisors. Where that is slow, as on SQLite, doubles decide first: most sides differ by more than
the error that doubles can have made, and only the others are calculated exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from functools import reduce
from typing import NamedTuple, Protocol, TypeVar

from ..dto.lexical import decimal_text
from ..errors import UnsupportedConstructError
from ..knowledge import resolved as r
from .dialects.words import Words

T = TypeVar("T")
# The error of a double after one operation is 1.1e-16 of it; what a text is read with may be more.
_ERROR = 2e-15
# Below this, doubles lose digits.
_TINY = "1e-290"
# So many fluents are joined, which reads each one's double and text at once.
_FEW = 8
# A longer text becomes a step of its own, so that steps within steps do not multiply.
_LONG = 120
# A parser may have room for so many levels of a calculation in one expression.
MAX_LEVELS = 6


class NumberWriter(Protocol):
    """Writes what numbers are made of."""

    words: Words
    known_numbers: frozenset[str]

    def parameter(self, value: str | float, is_number: bool = False) -> str:
        """Bind a value; return the parameter as it stands in the text."""

    def alias(self, letter: str) -> str:
        """Make the alias of a table."""

    def value_of(self, fluent: r.NumberOf, places: Mapping[r.Slot, str], column: str) -> str:
        """Write a column of the version of a fluent; NULL without a value."""

    def value_version(
        self, function: int, terms: Sequence[r.Place], places: Mapping[r.Slot, str]
    ) -> tuple[str, list[str]]:
        """Write the version of a fluent whose arguments are bound, as a table and conditions."""


class _Number(NamedTuple):
    """A number, as the text of a decimal and of its divisor, which is positive; None for 1."""

    value: str
    divisor: str | None = None


class ComparisonWriter:
    """Writes one comparison; NULL, for a fluent without a value, makes it false."""

    def __init__(self, writer: NumberWriter, places: Mapping[r.Slot, str]) -> None:
        self._writer = writer
        self._places = places
        self._arithmetic = writer.words.arithmetic
        # Numbers that are not constants -> their doubles, and their texts.
        self._doubles: dict[r.Quantity, str] = {}
        self._texts: dict[r.Quantity, str] = {}
        self._steps: list[str] | None = None
        self._long = _LONG

    def text(self, operator: str, left: r.Quantity, right: r.Quantity) -> str:
        """Write it as a condition that is true or false."""
        if isinstance(left, Decimal) and isinstance(right, Decimal):
            return "TRUE" if r.COMPARE[operator](left, right) else "FALSE"
        leaves = dict.fromkeys(leaf for side in (left, right) for leaf in _leaves(side))
        is_plain = all(isinstance(side, r.NumberOf | Decimal) for side in (left, right))
        rows = self._rows(leaves, is_plain, _divides(left) or _divides(right))
        if is_plain:
            found = self._stored(operator, left, right)
        elif self._arithmetic.is_fast:
            found = self._exactly(operator, left, right)
        elif levels_of(left, right) > MAX_LEVELS:
            self._long = 0
            found = self._exactly(operator, left, right)
        else:
            found = self._by_doubles(operator, left, right)
        return f"COALESCE({f'(SELECT {found}{rows})' if rows else found}, FALSE)"

    def _rows(self, leaves: Iterable[r.Quantity], is_plain: bool, divides: bool) -> str:
        """Write where the numbers are read, each once; empty where each is a subquery."""
        fluents: list[r.NumberOf] = []
        for leaf in leaves:
            if isinstance(leaf, r.NumberOf):
                fluents.append(leaf)
            elif isinstance(leaf, r.Parameter):
                if leaf.name not in self._writer.known_numbers:
                    raise UnsupportedConstructError(f"{leaf.name} has no value in a state")
                self._texts[leaf] = f":{leaf.name}"
                self._doubles[leaf] = f"CAST(:{leaf.name} AS DOUBLE PRECISION)"
        is_fast = self._arithmetic.is_fast
        if is_fast and not is_plain and not divides:
            for fluent in fluents:
                self._texts[fluent] = self._value_of(fluent)
            return ""
        self._steps = []
        if is_plain or (not is_fast and 0 < len(fluents) <= _FEW):
            return self._joined(fluents)
        row = self._writer.alias("x")
        columns = []
        for number, fluent in enumerate(fluents):
            self._texts[fluent] = f"{row}.v{number}"
            self._doubles[fluent] = f"CAST({row}.v{number} AS DOUBLE PRECISION)"
            columns.append(f"{self._value_of(fluent)} AS v{number}")
        return f" FROM (SELECT {', '.join(columns) or '1'}{self._writer.words.fence}) AS {row}"

    def _joined(self, fluents: Iterable[r.NumberOf]) -> str:
        tables: list[str] = []
        where: list[str] = []
        for fluent in fluents:
            table, found = self._writer.value_version(fluent.function, fluent.terms, self._places)
            alias = table.split()[-1]
            tables.append(table)
            where += found
            self._texts[fluent], self._doubles[fluent] = f"{alias}.value", f"{alias}.number"
        return f" FROM {' CROSS JOIN '.join(tables)} WHERE {' AND '.join(where)}"

    def _value_of(self, fluent: r.NumberOf) -> str:
        return self._writer.value_of(fluent, self._places, "value")

    def _stored(self, operator: str, left: r.Quantity, right: r.Quantity) -> str:
        """Compare stored numbers: decimals whose doubles differ compare as doubles."""
        first, second = self._double(left), self._double(right)
        exactly = self._arithmetic.by_texts(operator, self._text(left), self._text(right))
        return f"CASE WHEN {first} <> {second} THEN {first} {operator} {second} ELSE {exactly} END"

    # Doubles, with a bound of their error.

    def _by_doubles(self, operator: str, left: r.Quantity, right: r.Quantity) -> str:
        first, second = self._double(left), self._double(right)
        count = sum(1 for side in (left, right) for _ in r.parts_of(side))
        size = f"({self._size(left)} + {self._size(right)})"
        bound = f"{self._writer.parameter(_ERROR * count)} * {size}"
        return (
            f"CASE WHEN abs({first} - {second}) > {bound} THEN {first} {operator} {second} "
            f"ELSE {self._exactly(operator, left, right)} END"
        )

    def _double(self, quantity: r.Quantity) -> str:
        if isinstance(quantity, Decimal):
            return self._writer.parameter(float(quantity))
        if not isinstance(quantity, r.Operation):
            return self._doubles[quantity]
        found = [self._double(each) for each in quantity.operands]
        if len(found) == 1:
            return f"(- {found[0]})"
        return _folded(quantity.operator, found, f"({{}} {quantity.operator} {{}})".format)

    def _size(self, quantity: r.Quantity) -> str:
        """Write what the error of a number is a small part of."""
        if not isinstance(quantity, r.Operation):
            return f"(abs({self._double(quantity)}) + {_TINY})"
        operator, operands = quantity.operator, quantity.operands
        sizes = [*map(self._size, operands)]
        if operator == "/":
            # NULL, so that doubles do not decide, if the divisor may have lost most of its digits.
            for divisor, size in zip(operands[1:], sizes[1:], strict=True):
                by = f"abs({self._double(divisor)})"
                by = f"CASE WHEN {by} > 1e-3 * {size} THEN 1e-3 * {by} END"
                sizes[0] = f"({sizes[0]} / {by} + {_TINY})"
            return sizes[0]
        if operator == "*":
            return _folded(operator, sizes, f"({{}} * {{}} + {_TINY})".format)
        return _folded("+", sizes, "({} + {})".format)

    # Decimals.

    def _exactly(self, operator: str, left: r.Quantity, right: r.Quantity) -> str:
        first, second = self._number(left), self._number(right)
        sides = self._times(first.value, second.divisor), self._times(second.value, first.divisor)
        found = self._arithmetic.compare.format(sides[0], operator, sides[1])
        return f"(WITH {', '.join(self._steps)} SELECT {found})" if self._steps else found

    def _number(self, quantity: r.Quantity) -> _Number:
        if not isinstance(quantity, r.Operation):
            return _Number(self._arithmetic.decimal.format(self._text(quantity)))
        found = [self._number(each) for each in quantity.operands]
        if len(found) == 1:
            zero = self._arithmetic.decimal.format("'0'")
            return self._step(_Number(self._write("-", zero, found[0].value), found[0].divisor))

        def calculated(left: _Number, right: _Number) -> _Number:
            return self._step(self._calculated(quantity.operator, left, right))

        return _folded(quantity.operator, found, calculated)

    def _calculated(self, operator: str, left: _Number, right: _Number) -> _Number:
        (first, by), (second, also_by) = left, right
        if operator == "/":
            # NULL for a division by zero.
            sign = f"NULLIF({self._arithmetic.sign.format(second)}, 0)"
            positive = self._times(second, sign)
            value = self._times(self._times(first, also_by), sign)
            return _Number(value, self._times(positive, by))
        divisor = by if also_by is None else self._times(also_by, by)
        if operator == "*":
            return _Number(self._times(first, second), divisor)
        sides = self._times(first, also_by), self._times(second, by)
        return _Number(self._write(operator, *sides), divisor)

    def _times(self, number: str, by: str | None) -> str:
        return number if by is None else self._write("*", number, by)

    def _write(self, operator: str, left: str, right: str) -> str:
        return self._arithmetic.operation(operator, left, right)

    def _step(self, number: _Number) -> _Number:
        """Calculate a long number once."""
        is_long = any(len(text) > self._long for text in number if text is not None)
        if not is_long or self._steps is None:
            return number
        name = self._writer.alias("s")
        texts = ", ".join(text for text in number if text is not None)
        columns = "n" if number.divisor is None else "n, d"
        self._steps.append(f"{name} ({columns}) AS MATERIALIZED (SELECT {texts})")
        divisor = None if number.divisor is None else f"(SELECT d FROM {name})"
        return _Number(f"(SELECT n FROM {name})", divisor)

    def _text(self, quantity: r.Quantity) -> str:
        if isinstance(quantity, Decimal):
            return self._writer.parameter(decimal_text(quantity), is_number=True)
        return self._texts[quantity]


def _folded(operator: str, operands: Sequence[T], join: Callable[[T, T], T]) -> T:
    """Join operands by a binary operation: sums and products as a balanced tree, not a deep one."""
    if len(operands) > 2 and operator in "+*":
        half = len(operands) // 2
        return join(
            _folded(operator, operands[:half], join), _folded(operator, operands[half:], join)
        )
    return reduce(join, operands)


def levels_of(*quantities: r.Quantity) -> int:
    """Return how many levels the calculations of numbers have."""
    levels, level = 0, list(quantities)
    while level:
        level = [
            inner for each in level if isinstance(each, r.Operation) for inner in each.operands
        ]
        levels += 1
    return levels


def _leaves(quantity: r.Quantity) -> Iterable[r.Quantity]:
    return (each for each in r.parts_of(quantity) if not isinstance(each, r.Operation))


def _divides(quantity: r.Quantity) -> bool:
    return any(
        isinstance(each, r.Operation) and each.operator == "/" for each in r.parts_of(quantity)
    )
