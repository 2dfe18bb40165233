"""The few words in which generated conditions differ between dialects.

Conditions are written as text: building one of ten tables with SQLAlchemy Core takes 3 ms, as text
0.2 ms, and it must keep its join order on SQLite.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from .decimals import POSTGRESQL_ARITHMETIC, SQLITE_ARITHMETIC, DecimalWords


class Words(NamedTuple):
    """How one dialect writes what differs.

    Attributes:
        is_fact: the condition that the proposition version of an alias is a fact.
        in_list: the condition that an expression is among the values of a list parameter.
        bounded: what follows it if an upper bound of the revisions in a column does, which comes
            next in an index.
        each: the relation of the values of a list parameter of numbers, with the column `value`. A
            planner takes it for so many that it makes an index of what is found for them.
        rows: the relation of a parameter that holds rows of ids, as JSON, with columns `c0` ...
        list_text: writes a list as a literal.
        arithmetic: how decimals are calculated with.
        fence: what ends a subquery that is to be planned by itself; empty where no planner would
            change the order of a join.
        levels: how deep the parentheses of a statement may be nested; None for any depth.
    """

    is_fact: str
    in_list: str
    bounded: str
    each: str
    rows: Callable[[str, int], str]
    list_text: Callable[[Sequence[int] | Sequence[str]], str]
    arithmetic: DecimalWords
    fence: str
    many: str = ""
    levels: int | None = None


def quoted(text: str) -> str:
    """Write a text as an SQL literal."""
    return "'" + text.replace("'", "''") + "'"


def _sqlite_rows(parameter: str, columns: int) -> str:
    fields = ", ".join(f"json_extract(value, '$[{n}]') AS c{n}" for n in range(columns))
    return f"(SELECT {fields or '1 AS present'} FROM json_each(:{parameter}))"


def _sqlite_list(values: Sequence[int] | Sequence[str]) -> str:
    if all(isinstance(value, int) for value in values):
        return quoted(f"[{', '.join(map(str, values))}]")
    # Arguments are ids and spaces: nothing in them needs an escape.
    return quoted("[" + ", ".join(f'"{value}"' for value in values) + "]")


def _postgresql_rows(parameter: str, columns: int) -> str:
    fields = ", ".join(f"CAST(value ->> {n} AS bigint) AS c{n}" for n in range(columns))
    rows = f"json_array_elements(CAST(:{parameter} AS json)) AS listed (value)"
    return f"(SELECT {fields or '1 AS present'} FROM {rows})"


def _postgresql_list(values: Sequence[int] | Sequence[str]) -> str:
    if all(isinstance(value, int) for value in values):
        return f"CAST(ARRAY[{', '.join(map(str, values))}] AS bigint[])"
    return f"CAST(ARRAY[{', '.join(quoted(str(value)) for value in values)}] AS text[])"


SQLITE_WORDS = Words(
    "{0}.is_goal = 0",
    "{0} IN (SELECT value FROM json_each({1}))",
    # With statistics, SQLite 3.34 to 3.41 may step through the index to the next value of an `IN`,
    # and then jumps over the check of an upper bound; up to 3.39 it also misses rows above a lower
    # one. From a lower bound that excludes its own value it always seeks; that all revisions are
    # above this one leaves the planner's estimates as they are.
    " AND likelihood({0} > 0, 1.0)",
    # Each `json_each` counts as 25 rows, also that of one value.
    "(SELECT f.value FROM json_each('[0]') CROSS JOIN json_each({0}) AS f)",
    _sqlite_rows,
    _sqlite_list,
    SQLITE_ARITHMETIC,
    "",
    # The parser has a stack of 100 entries up to SQLite 3.45.
    levels=45,
)
POSTGRESQL_WORDS = Words(
    "NOT {0}.is_goal",
    "{0} = ANY({1})",
    "",
    "(SELECT unnest(CAST({0} AS bigint[])) AS value)",
    _postgresql_rows,
    _postgresql_list,
    POSTGRESQL_ARITHMETIC,
    " OFFSET 0",
    "generate_series(1, (SELECT 1))",
)
