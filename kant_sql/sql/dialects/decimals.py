"""Exact decimals in SQL: a type of PostgreSQL, and functions on texts for SQLite.

The functions are those of SQLite's extension `decimal`, which its shell has: a statement with them
can be pasted there.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from decimal import Decimal
from typing import NamedTuple

from ...dto.lexical import EXACT_DECIMALS


class DecimalWords(NamedTuple):
    """How one dialect calculates with exact decimals.

    Attributes:
        operation: writes `+`, `-` or `*` of two decimals.
        sign: the sign of a decimal, as -1, 0 or 1.
        compare: compares two decimals by an operator.
        decimal: a text as a decimal.
        by_texts: compares the texts of two decimals whose doubles are equal.
        is_fast: whether calculating exactly costs little; otherwise doubles decide where they can.
    """

    operation: Callable[[str, str, str], str]
    sign: str
    compare: str
    decimal: str
    by_texts: Callable[[str, str, str], str]
    is_fast: bool


def _by_texts(operator: str, left: str, right: str) -> str:
    # Without the zeros at its end, and of two positive ones the longer whole part is greater.
    keys = ", ".join(
        f"CASE WHEN instr({text}, '.') > 0 THEN rtrim({text}, '0') ELSE {text} || '.' END AS {name}"
        for text, name in ((left, "a"), (right, "b"))
    )
    less = "(instr(a, '.'), a) < (instr(b, '.'), b)"
    less = (
        f"CASE WHEN a LIKE '-%' THEN NOT (b LIKE '-%' AND {less}) "
        f"ELSE b NOT LIKE '-%' AND {less} END"
    )
    order = {
        "<": f"a <> b AND {less}",
        "<=": f"a = b OR {less}",
        "=": "a = b",
        ">=": f"a = b OR NOT {less}",
        ">": f"a <> b AND NOT {less}",
    }
    return f"(SELECT {order[operator]} FROM (SELECT {keys}))"


_NAMES = {"+": "decimal_add", "-": "decimal_sub", "*": "decimal_mul"}
SQLITE_ARITHMETIC = DecimalWords(
    lambda operator, left, right: f"{_NAMES[operator]}({left}, {right})",
    sign="decimal_cmp({}, '0')",
    compare="decimal_cmp({0}, {2}) {1} 0",
    decimal="{}",
    by_texts=_by_texts,
    is_fast=False,
)
POSTGRESQL_ARITHMETIC = DecimalWords(
    lambda operator, left, right: f"({left} {operator} {right})",
    sign="sign({})",
    compare="{} {} {}",
    decimal="CAST({} AS numeric)",
    by_texts=lambda operator, left, right: (
        f"CAST({left} AS numeric) {operator} CAST({right} AS numeric)"
    ),
    is_fast=True,
)


def _function(
    operation: Callable[[Decimal, Decimal], Decimal],
) -> Callable[[str | int | None, str | int | None], str | None]:
    def calculate(left: str | int | None, right: str | int | None) -> str | None:
        if left is None or right is None:
            return None
        return format(operation(Decimal(left), Decimal(right)), "f")

    return calculate


def _compare(left: str | int | None, right: str | int | None) -> int | None:
    if left is None or right is None:
        return None
    first, second = Decimal(left), Decimal(right)
    return (first > second) - (first < second)


_FUNCTIONS = {
    "decimal_add": _function(EXACT_DECIMALS.add),
    "decimal_sub": _function(EXACT_DECIMALS.subtract),
    "decimal_mul": _function(EXACT_DECIMALS.multiply),
    "decimal_cmp": _compare,
}


def add_functions(connection: sqlite3.Connection) -> None:
    """Give a connection the functions on decimals."""
    for name, function in _FUNCTIONS.items():
        connection.create_function(name, 2, function, deterministic=True)
