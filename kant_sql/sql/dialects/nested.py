"""Nested loops in the order that is written, as each dialect keeps it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from .containing import OPERATORS

# More than any walk gives: the planner takes an index that has the order for a query with a limit.
_ENDLESS = "20000"


class NestedLoops(NamedTuple):
    """How one dialect writes a join whose order is fixed.

    SQLite keeps the order of a CROSS JOIN. PostgreSQL keeps that of lateral subqueries that it
    cannot pull up; without statistics it would otherwise hash millions of versions for a few ids.

    Attributes:
        rows: the relation of a parameter that holds rows of ids as JSON, with columns `place`,
            from 0, and `id0`, `id1` ...
        loop: writes an inner loop: its alias, its table and its conditions.
        last: writes the subquery of the last row up to a revision: an alias, its table, the column
            of the identity, that identity, the revision, and what it gives of that row.
        part: writes the query of the rows that began after a revision and up to another one, at
            most so many: an alias, its table, the column of the identity, that identity, the two
            revisions, the number, and what it gives of each row.
        walk: writes an inner loop over such rows; the first revision is included.
        range: writes the same loop, however many rows it has.
        times: the relation of a parameter that holds times as JSON texts, with columns `place`,
            from 0, and `moment`.
        larger: the function of the largest of some numbers.
        smaller: the function of the smallest.
        contains: the operator between a text and a pattern; see `containing.py`.
    """

    rows: Callable[[str, int], str]
    loop: Callable[[str, str, str], str]
    last: Callable[[str, str, str, str, str, str], str]
    part: Callable[[str, str, str, str, str, str, str, str], str]
    walk: Callable[[str, str, str, str, str, str], str]
    range: Callable[[str, str, str, str, str, str], str]
    times: Callable[[str], str]
    larger: str
    smaller: str
    contains: str


def _sqlite_rows(parameter: str, columns: int) -> str:
    ids = ", ".join(f"json_extract(value, '$[{n}]') AS id{n}" for n in range(columns))
    return f"(SELECT key AS place, {ids} FROM json_each(:{parameter}))"


def _postgresql_rows(parameter: str, columns: int) -> str:
    ids = ", ".join(f"CAST(value ->> {n} AS bigint) AS id{n}" for n in range(columns))
    rows = f"json_array_elements(CAST(:{parameter} AS json)) WITH ORDINALITY"
    return f"(SELECT place - 1 AS place, {ids} FROM {rows} AS listed (value, place))"


def _sqlite_loop(alias: str, table: str, conditions: str) -> str:
    return f" CROSS JOIN {table} AS {alias} ON {conditions}"


def _postgresql_loop(alias: str, table: str, conditions: str) -> str:
    inner = f"SELECT * FROM {table} AS {alias} WHERE {conditions} OFFSET 0"
    return f" CROSS JOIN LATERAL ({inner}) AS {alias}"


def _sqlite_last(
    alias: str, table: str, column: str, identity: str, revision: str, wanted: str
) -> str:
    return (
        f"(SELECT {wanted} FROM {table} AS {alias} WHERE {alias}.kb_id = :kb AND"
        f" {alias}.{column} = {identity} AND {alias}.since <= {revision}"
        f" ORDER BY {alias}.since DESC LIMIT 1)"
    )


def _postgresql_last(
    alias: str, table: str, column: str, identity: str, revision: str, wanted: str
) -> str:
    # Only the primary key has this order: sorted by revision alone, the planner may go through all
    # versions of the knowledge base, backwards, to find one of the identity.
    key = f"{alias}.{column}, {alias}.since"
    found = (
        f"SELECT {alias}.* FROM {table} AS {alias} WHERE {alias}.kb_id = :kb"
        f" AND ({key}) <= ({identity}, {revision})"
        f" ORDER BY {key.replace(',', ' DESC,')} DESC LIMIT 1"
    )
    return f"(SELECT {wanted} FROM ({found}) AS {alias} WHERE {alias}.{column} = {identity})"


def _sqlite_part(
    alias: str,
    table: str,
    column: str,
    identity: str,
    after: str,
    upto: str,
    number: str,
    wanted: str,
) -> str:
    return (
        f"SELECT {wanted} FROM {table} AS {alias} WHERE {alias}.kb_id = :kb"
        f" AND {alias}.{column} = {identity} AND {alias}.since > {after}"
        f" AND {alias}.since <= {upto} LIMIT {number}"
    )


# If nearly all versions are of one identity, the planner takes the index of revisions for as good
# as the primary key, and reads what began of all others. Only the primary key has this order.
def _postgresql_key_range(
    alias: str, table: str, column: str, begin: str, end: str, number: str, wanted: str
) -> str:
    key = f"{alias}.{column}, {alias}.since"
    return (
        f"SELECT {wanted} FROM {table} AS {alias} WHERE {alias}.kb_id = :kb"
        f" AND ({key}) {begin} AND ({key}) <= {end} ORDER BY {key} LIMIT {number}"
    )


def _postgresql_part(
    alias: str,
    table: str,
    column: str,
    identity: str,
    after: str,
    upto: str,
    number: str,
    wanted: str,
) -> str:
    begin, end = f"> ({identity}, {after})", f"({identity}, {upto})"
    return _postgresql_key_range(alias, table, column, begin, end, number, wanted)


def _sqlite_walk(alias: str, table: str, column: str, identity: str, first: str, upto: str) -> str:
    conditions = (
        f"{alias}.kb_id = :kb AND {alias}.{column} = {identity}"
        f" AND {alias}.since >= {first} AND {alias}.since <= {upto}"
    )
    return _sqlite_loop(alias, table, conditions)


def _postgresql_walk(
    alias: str, table: str, column: str, identity: str, first: str, upto: str
) -> str:
    begin, end = f">= ({identity}, {first})", f"({identity}, {upto})"
    inner = _postgresql_key_range(alias, table, column, begin, end, _ENDLESS, f"{alias}.*")
    return f" CROSS JOIN LATERAL ({inner}) AS {alias}"


# Rows are compared as in a walk: by an index of revisions alone, a planner would read all of them.
def _postgresql_range(
    alias: str, table: str, column: str, identity: str, first: str, upto: str
) -> str:
    key = f"({alias}.{column}, {alias}.since)"
    conditions = f"{alias}.kb_id = :kb AND {key} >= ({identity}, {first})"
    return _postgresql_loop(alias, table, f"{conditions} AND {key} <= ({identity}, {upto})")


def _sqlite_times(parameter: str) -> str:
    return f"(SELECT key AS place, value AS moment FROM json_each(:{parameter}))"


def _postgresql_times(parameter: str) -> str:
    texts = f"json_array_elements_text(CAST(:{parameter} AS json)) WITH ORDINALITY"
    moment = "CAST(value AS timestamptz) AS moment"
    return f"(SELECT place - 1 AS place, {moment} FROM {texts} AS listed (value, place))"


NESTED_LOOPS = {
    "sqlite": NestedLoops(
        _sqlite_rows,
        _sqlite_loop,
        _sqlite_last,
        _sqlite_part,
        _sqlite_walk,
        _sqlite_walk,
        _sqlite_times,
        "max",
        "min",
        OPERATORS["sqlite"],
    ),
    "postgresql": NestedLoops(
        _postgresql_rows,
        _postgresql_loop,
        _postgresql_last,
        _postgresql_part,
        _postgresql_walk,
        _postgresql_range,
        _postgresql_times,
        "greatest",
        "least",
        OPERATORS["postgresql"],
    ),
}
