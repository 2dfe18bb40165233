"""Each statement of the library is one task on Citus: it goes to its knowledge base's shard."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import psycopg
import pytest
from psycopg._queries import PostgresQuery
from psycopg.adapt import Transformer

import kant_sql
from kant_sql.sql.audit_views import AUDIT_VIEWS, rows_of_view
from tests.support.citus import Cluster
from tests.support.sharding import DIALECT, OF_ALL, every_insert, every_query
from tests.support.statements import READS, fill, seen

# A value of each type that a parameter has.
VALUES: dict[str, Any] = {
    "bigint": 1,
    "integer": 1,
    "smallint": 1,
    "double precision": 1.5,
    "boolean": True,
    "text": "x",
    "character varying": "x",
    "timestamp with time zone": "2026-01-01T00:00:00Z",
    "json": "[[1, 1, 1, 1]]",
    "bigint[]": [1, 2],
    "smallint[]": [1, 2],
    "text[]": ["x", "y"],
    "character varying[]": ["x", "y"],
}
# In these views Citus looks up rows of other tables in all shards, or refuses to: of the last, a
# recursive query.
LOOKED_UP = {
    *("audit_fact_argument", "audit_value_argument", "audit_plan", "audit_plan_step"),
    "audit_action_literal",
}


@pytest.fixture(scope="module")
def distributed(cluster: Cluster) -> Iterator[str]:
    """A distributed store with one knowledge base in it."""
    url = cluster.new_store()
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        fill(kb, 3)
    yield url
    cluster.drop_database(url)


@pytest.fixture
def connection(distributed: str) -> Iterator[psycopg.Connection]:
    with psycopg.connect(distributed, autocommit=True, prepare_threshold=None) as opened:
        yield opened


def parameters_of(connection: psycopg.Connection, sql: str) -> Mapping[str, Any]:
    """Give each parameter of a statement a value of its type."""
    names = {*re.findall(r"%\((\w+)\)s", sql)}
    if not names:
        return {}
    query = PostgresQuery(Transformer(connection))
    query.convert(sql, dict.fromkeys(names))
    connection.execute(b"PREPARE asked AS " + query.query)
    row = connection.execute(
        "SELECT parameter_types::text[] FROM pg_prepared_statements WHERE name = 'asked'"
    ).fetchone()
    connection.execute("DEALLOCATE asked")
    assert row is not None
    return {name: VALUES[type_] for name, type_ in zip(query._order or [], row[0], strict=True)}


def tasks(connection: psycopg.Connection, sql: str, parameters: Any) -> list[int]:
    """Give the number of tasks of each part of a plan: of none, it is asked of no shard."""
    rows = connection.execute(f"EXPLAIN (COSTS OFF) {sql}".encode(), parameters or None)
    plan = "\n".join(row[0] for row in rows)
    assert "Distributed Subplan" not in plan, plan
    return [int(number) for number in re.findall(r"Task Count: (\d+)", plan)]


def test_every_statement_is_one_task(connection: psycopg.Connection) -> None:
    faults = {}
    for name, query in every_query():
        sql = query.text(DIALECT)
        if name in OF_ALL or "sqlite" in name:
            continue
        found = tasks(connection, sql, parameters_of(connection, sql))
        if found not in ([], [1]):
            faults[f"{name}: {sql}"] = found
    assert not faults


def test_every_insert_is_one_task(connection: psycopg.Connection) -> None:
    for insert in every_insert():
        # A plan checks no constraint.
        row = ["1", *("NULL" for _ in insert.columns[1:])]
        sql = f"INSERT INTO {insert.into} VALUES ({', '.join(row)})"
        assert tasks(connection, sql, None) == [1], sql


@pytest.mark.parametrize("view", sorted({*AUDIT_VIEWS} - LOOKED_UP))
@pytest.mark.parametrize("windowed", [False, True])
def test_every_view_of_one_knowledge_base_is_one_task(
    connection: psycopg.Connection, view: str, windowed: bool
) -> None:
    sql = rows_of_view(view, windowed).text(DIALECT)
    if not LOOKED_UP & {*re.findall(r"\w+", sql)}:
        assert tasks(connection, sql, parameters_of(connection, sql)) == [1]


def test_what_calls_run_is_one_task(distributed: str, connection: psycopg.Connection) -> None:
    with kant_sql.connect(distributed, knowledge_base="rosie") as kb, seen() as statements:
        fill(kb, 30)
        for read in READS.values():
            read(kb)
            read(kb.at(1))
        kb.propositions.delete_all()
    ran = {sql: given for sql, given in statements if re.match("SELECT|UPDATE|DELETE|INSERT", sql)}
    assert len(ran) > 20
    for sql, given in ran.items():
        assert tasks(connection, sql, given) in ([], [1]), sql
