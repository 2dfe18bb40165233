"""The words in which generated statements differ between dialects.

Conditions are written as text: building one of ten tables with SQLAlchemy Core takes 3 ms, as text
0.2 ms, and they must keep their join order on SQLite.

The functions of exact decimals are those of SQLite's extension `decimal`, which its shell includes,
so you can paste statements there.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from typing import NamedTuple

from typing_extensions import override

from ...dto.lexical import EXACT_DECIMALS
from ..query import text_literal


class DecimalWords(NamedTuple):
    """Calculations with exact decimals in one dialect.

    Attributes:
        operation: writes `+`, `-` or `*` of two decimals.
        sign: the sign of a decimal, as -1, 0 or 1.
        compare: compares two decimals by an operator.
        decimal: a text as a decimal.
        by_texts: compares the texts of two decimals whose doubles are equal.
        is_fast: whether exact calculation is cheap; otherwise doubles decide if possible.
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
    """Add the functions on decimals to a connection."""
    for name, function in _FUNCTIONS.items():
        connection.create_function(name, 2, function, deterministic=True)


# A saying is known, and covers the time. A sum uses no index: PostgreSQL without statistics rates
# the index of revisions as good as that of the element.
COVERS = (
    "{0}.kb_id = :kb AND {0}.since + 0 <= :valid_known AND {0}.valid_from <= :valid_moment "
    "AND {0}.valid_until > :valid_moment"
)
# Before the name of a table of versions: its own rows, also for a state of valid time.
RAW = "/**/"


class Words(NamedTuple):
    """The differing words of one dialect.

    Attributes:
        is_fact: the condition that the proposition version of an alias is a fact.
        in_list: the condition that an expression is among the values of a list parameter.
        bounded: what follows it if an upper bound of the revisions in a column does, which comes
            next in an index.
        held: the rows of a table of versions, as `v`, whose fork is in a list; and those of one
            object, of which another condition says which.
        each: the relation of the values of a list parameter of numbers, with the column `value`. A
            planner takes it for so many that it makes an index of what is found for them.
        loops: writes joins in a fixed order.
        list_text: writes a list as a literal.
        is_row: the condition that columns of an index have some values, by which no other index is
            to be chosen.
        arithmetic: how decimals are calculated with.
        fence: what ends a subquery that is to be planned by itself; empty where no planner would
            change the order of a join.
        levels: the maximum depth of parentheses in a statement; None for any depth.
        is_one_state: whether the versions that are read are those of one state only, of valid time.
        is_true: the condition that a boolean column is true.
        looked_up: the condition that values are among rows that were read before.
        of_owners: the rows of a table, as `s`, whose owner is any of a table and whose fork is in a
            list, and the column of their owner; where one owner is given, that alone is looked up.
    """

    is_fact: str
    in_list: str
    bounded: str
    held: tuple[str, str]
    each: str
    loops: NestedLoops
    list_text: Callable[[Sequence[int] | Sequence[str]], str]
    is_row: str
    arithmetic: DecimalWords
    fence: str
    many: str = ""
    levels: int | None = None
    is_one_state: bool = False
    is_true: str = "{0}"
    looked_up: str = "{0}"
    of_owners: tuple[str, str] = (
        "{table} AS s WHERE s.{owner}_id = ANY(ARRAY(SELECT p.id FROM {owner} AS p WHERE "
        "p.kb_id = :kb)) AND s.fork = ANY({forks})",
        "s.{owner}_id",
    )


def _sqlite_rows(parameter: str, columns: int) -> str:
    values = [f", json_extract(value, '$[{n}]') AS c{n}" for n in range(columns)]
    return f"(SELECT key AS place{''.join(values)} FROM json_each(:{parameter}))"


def _sqlite_list(values: Sequence[int] | Sequence[str]) -> str:
    if all(isinstance(value, int) for value in values):
        return text_literal(f"[{', '.join(map(str, values))}]")
    # Arguments are ids and spaces: nothing in them needs an escape.
    return text_literal("[" + ", ".join(f'"{value}"' for value in values) + "]")


def _postgresql_rows(parameter: str, columns: int) -> str:
    values = [f", CAST(value ->> {n} AS bigint) AS c{n}" for n in range(columns)]
    rows = f"json_array_elements(CAST(:{parameter} AS json)) WITH ORDINALITY"
    return f"(SELECT place - 1 AS place{''.join(values)} FROM {rows} AS listed (value, place))"


def _postgresql_list(values: Sequence[int] | Sequence[str]) -> str:
    if all(isinstance(value, int) for value in values):
        return f"CAST(ARRAY[{', '.join(map(str, values))}] AS bigint[])"
    return f"CAST(ARRAY[{', '.join(text_literal(str(value)) for value in values)}] AS text[])"


# By dialect: the operator between a text and a pattern; see `containing.py`.
OPERATORS = {"sqlite": "GLOB", "postgresql": "~"}
# More than any walk gives: the planner takes an index that has the order for a query with a limit.
_ENDLESS = "20000"


class Walk(NamedTuple):
    """The versions of one identity: an alias, their table, and what its column equals."""

    alias: str
    table: str
    column: str
    identity: str

    @property
    def key(self) -> str:
        """The end of the primary key."""
        return f"{self.alias}.{self.column}, {self.alias}.since"

    def where(self, wanted: str, conditions: str) -> str:
        """Write a query of a knowledge base's rows."""
        alias = self.alias
        rows = f"SELECT {wanted} FROM {self.table} AS {alias} WHERE {alias}.kb_id = :kb"
        return f"{rows} AND {conditions}"

    @property
    def own(self) -> str:
        """The condition that a row is of the identity."""
        return f"{self.alias}.{self.column} = {self.identity}"


class NestedLoops:
    """Joins in a fixed order for SQLite, which keeps the order of a CROSS JOIN.

    Attributes:
        larger: the function of the largest of some numbers.
        smaller: the function of the smallest.
        contains: the operator between a text and a pattern; see `containing.py`.
        unsought: what begins a column by which no index is to be chosen; see `Unsought`.
        rows: the relation of a parameter that holds rows of ids, as JSON, with columns `place`,
            from 0, and `c0`, `c1` ...
    """

    larger, smaller, contains, unsought = "max", "min", OPERATORS["sqlite"], "+"
    rows = staticmethod(_sqlite_rows)

    def times(self, parameter: str) -> str:
        """Write the relation of times, as JSON texts, with columns `place` and `moment`."""
        return f"(SELECT key AS place, value AS moment FROM json_each(:{parameter}))"

    def loop(self, alias: str, table: str, conditions: str) -> str:
        """Write an inner loop."""
        return f" CROSS JOIN {table} AS {alias} ON {conditions}"

    def ordered(self, alias: str, table: str, conditions: str, column: str) -> str:
        """Write an inner loop by an index that has the order of a column, too."""
        return self.loop(alias, table, conditions)

    def last(self, walk: Walk, revision: str, wanted: str) -> str:
        """Write the subquery of the last row up to a revision."""
        since = f"{walk.alias}.since"
        found = walk.where(wanted, f"{walk.own} AND {since} <= {revision}")
        return f"({found} ORDER BY {since} DESC LIMIT 1)"

    def part(self, walk: Walk, after: str, upto: str, number: str, wanted: str) -> str:
        """Write the query of rows that began after a revision, up to another one."""
        since = f"{walk.alias}.since"
        began = f"{walk.own} AND {since} > {after} AND {since} <= {upto}"
        return f"{walk.where(wanted, began)} LIMIT {number}"

    def walk(self, walk: Walk, first: str, upto: str) -> str:
        """Write an inner loop over the few rows that began from one revision up to another."""
        return self.range(walk, first, upto)

    def range(self, walk: Walk, first: str, upto: str) -> str:
        """Write the same loop, however many rows it has."""
        since = f"{walk.alias}.since"
        began = f"{walk.own} AND {since} >= {first} AND {since} <= {upto}"
        return self.loop(walk.alias, walk.table, f"{walk.alias}.kb_id = :kb AND {began}")

    def latest(self, walk: Walk, revision: str) -> str:
        """Write an inner loop over the last row up to a revision."""
        since = self.last(walk._replace(alias="l"), revision, "l.since")
        return self.range(walk, since, since)


class _LateralLoops(NestedLoops):
    """The same for PostgreSQL, by lateral subqueries that it cannot pull up.

    Without statistics it would otherwise hash millions of versions for a few ids.
    """

    larger, smaller, contains, unsought = "greatest", "least", OPERATORS["postgresql"], ""
    rows = staticmethod(_postgresql_rows)

    @override
    def times(self, parameter: str) -> str:
        texts = f"json_array_elements_text(CAST(:{parameter} AS json)) WITH ORDINALITY"
        moment = "CAST(value AS timestamptz) AS moment"
        return f"(SELECT place - 1 AS place, {moment} FROM {texts} AS listed (value, place))"

    @override
    def loop(self, alias: str, table: str, conditions: str) -> str:
        inner = f"SELECT * FROM {table} AS {alias} WHERE {conditions} OFFSET 0"
        return f" CROSS JOIN LATERAL ({inner}) AS {alias}"

    @override
    def ordered(self, alias: str, table: str, conditions: str, column: str) -> str:
        # Without statistics other indexes are as good.
        return self.loop(alias, table, f"{conditions} ORDER BY {column}")

    @override
    def last(self, walk: Walk, revision: str, wanted: str, also: str = "") -> str:
        # Only the primary key has this order: sorted by revision alone, the planner may go through
        # all versions of the knowledge base, backwards, to find one of the identity.
        alias, key = walk.alias, walk.key
        found = walk.where(f"{alias}.*", f"({key}) <= ({walk.identity}, {revision}){also}")
        found += f" ORDER BY {key.replace(',', ' DESC,')} DESC LIMIT 1"
        return f"(SELECT {wanted} FROM ({found}) AS {alias} WHERE {walk.own})"

    @override
    def part(self, walk: Walk, after: str, upto: str, number: str, wanted: str) -> str:
        # If nearly all versions are of one identity, the planner takes the index of revisions for
        # as good as the primary key, and reads what began of all others.
        return f"{_between(walk, '>', after, upto, wanted)} ORDER BY {walk.key} LIMIT {number}"

    @override
    def walk(self, walk: Walk, first: str, upto: str) -> str:
        inner = _between(walk, ">=", first, upto, f"{walk.alias}.*")
        inner += f" ORDER BY {walk.key} LIMIT {_ENDLESS}"
        return f" CROSS JOIN LATERAL ({inner}) AS {walk.alias}"

    @override
    def range(self, walk: Walk, first: str, upto: str) -> str:
        # Rows are compared, too: by an index of revisions alone, it would read all of them.
        inner = _between(walk, ">=", first, upto, "*")
        return f" CROSS JOIN LATERAL ({inner} OFFSET 0) AS {walk.alias}"

    @override
    def latest(self, walk: Walk, revision: str) -> str:
        # No index has the place of a row: else one that has all columns, but not this order, is
        # read as a whole and sorted, if PostgreSQL knows how many rows there are and nothing more.
        found = self.last(walk, revision, f"{walk.alias}.*", f" AND {walk.alias}.ctid <> '(0,0)'")
        return f" CROSS JOIN LATERAL {found} AS {walk.alias}"


def _between(walk: Walk, begin: str, first: str, upto: str, wanted: str) -> str:
    """Write the query of a range of the primary key."""
    key, own = walk.key, walk.identity
    return walk.where(wanted, f"({key}) {begin} ({own}, {first}) AND ({key}) <= ({own}, {upto})")


def id_rows(ids: Iterable[int]) -> str:
    """Write a parameter of rows of one id each."""
    return json.dumps([[id_] for id_ in ids])


# No version has a fork after the head.
HEAD = "(SELECT h.revision FROM head AS h WHERE h.kb_id = :kb)"
_KEPT = (
    f"{{table}} AS v WHERE v.fork IN (SELECT value FROM json_each({{forks}}) WHERE value <= {HEAD})"
)
SQLITE_WORDS = Words(
    "{0}.is_goal = 0",
    "{0} IN (SELECT value FROM json_each({1}))",
    # With statistics, SQLite 3.34 to 3.41 may step through the index to the next value of an `IN`,
    # and then jumps over the check of an upper bound; up to 3.39 it also misses rows above a lower
    # one. From a lower bound that excludes its own value it always seeks; that all revisions are
    # above this one leaves the planner's estimates as they are.
    " AND likelihood({0} > 0, 1.0)",
    (_KEPT, _KEPT),
    # Each `json_each` counts as 25 rows, also that of one value.
    "(SELECT f.value FROM json_each('[0]') CROSS JOIN json_each({0}) AS f)",
    NestedLoops(),
    _sqlite_list,
    "({0}) = ({1})",
    SQLITE_ARITHMETIC,
    "",
    # The parser has a stack of 100 entries up to SQLite 3.45; tests of types take some, too.
    levels=40,
    is_true="{0} = 1",
    of_owners=(
        "{owner} AS p CROSS JOIN json_each({forks}) AS f CROSS JOIN {table} AS s WHERE "
        "p.kb_id = :kb AND s.{owner}_id = p.id AND s.fork = f.value",
        "p.id",
    ),
)
POSTGRESQL_WORDS = Words(
    "NOT {0}.is_goal",
    "{0} = ANY({1})",
    "",
    (
        "{table} AS v WHERE v.fork = ANY({forks})",
        # Only the right index has this order: without statistics others are as good.
        f"(SELECT unnest(CAST({{forks}} AS bigint[])) AS value) AS f CROSS JOIN LATERAL "
        "(SELECT r.* FROM {table} AS r WHERE r.kb_id = :kb AND r.fork = f.value ORDER BY r.since) "
        f"AS v WHERE f.value <= {HEAD}",
    ),
    "(SELECT unnest(CAST({0} AS bigint[])) AS value)",
    _LateralLoops(),
    _postgresql_list,
    # Without statistics an index of one column is as good as one of all; rows need that of all.
    "({0}) >= ({1}) AND ({0}) <= ({1})",
    POSTGRESQL_ARITHMETIC,
    " OFFSET 0",
    "generate_series(1, (SELECT 1))",
    # Hashed. Where PostgreSQL expects few rows, it would join them, and compare all with each.
    looked_up="({0}) IS TRUE",
)
