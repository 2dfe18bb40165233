"""What changed last is found in the time of the answer, however long the history is."""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from tests.support.pages import rows_of
from tests.support.servers import Server
from tests.support.worlds.robots import BATTERY, RB1, robot_at, waypoint

pytestmark = pytest.mark.every_backend

LENGTHS = {"short": 50, "long": 400}

HERE = "knowledge_base = '{kb}'"
LAST = f"(SELECT revision - 20 FROM audit_knowledge_base WHERE {HERE})"
GREATEST = f"(SELECT max(revision) - 20 FROM audit_revision WHERE {HERE})"
MOMENT = f"(SELECT max(revision) FROM audit_revision WHERE {HERE} AND committed_at <= '{{time}}')"
# What the page recommends, on both databases: the view, and the column that has the bound.
BOUND = {
    "audit_change": "revision",
    "audit_revision": "revision",
    "audit_fact": "since",
    "audit_fact_argument": "since",
    "audit_value": "since",
    "audit_object": "since",
    "audit_definition": "since",
}
RECOMMENDED = {
    **{
        f"{view} by number": f"* FROM {view} WHERE {HERE} AND {column} > {LAST}"
        for view, column in BOUND.items()
    },
    **{
        f"{view} in order": f"* FROM {view} WHERE {HERE} AND {column} > {LAST} "
        f"ORDER BY {column} DESC LIMIT 20"
        for view, column in BOUND.items()
    },
    "facts that ended": f"* FROM audit_fact WHERE {HERE} AND until > {LAST}",
    "of a kind": f"* FROM audit_change WHERE {HERE} AND kind = 'goal' AND revision > {LAST}",
    "of a predicate": f"* FROM audit_fact WHERE {HERE} AND predicate = 'robot_at' "
    f"AND since > {LAST}",
    "of an object": f"* FROM audit_fact_argument WHERE {HERE} AND object = 'rb1' "
    f"AND since > {LAST} ORDER BY since DESC LIMIT 20",
}
GROUPED = (
    f"WITH latest AS MATERIALIZED (SELECT kind FROM audit_change WHERE {HERE} "
    f"AND revision > {LAST}) SELECT kind, count(*) FROM latest GROUP BY kind"
)
QUESTIONS = {name: f"SELECT {question}" for name, question in RECOMMENDED.items()}
QUESTIONS["grouped"] = GROUPED
# SQLite passes these on as well.
ON_SQLITE = {
    **{
        f"{view} without a bound": f"SELECT * FROM {view} WHERE {HERE} "
        f"ORDER BY {column} DESC LIMIT 20"
        for view, column in BOUND.items()
    },
    **{
        f"{view} by the greatest": f"SELECT * FROM {view} WHERE {HERE} AND {column} > {GREATEST}"
        for view, column in BOUND.items()
    },
    **{
        f"{view} after a time": f"SELECT * FROM {view} WHERE {HERE} AND {column} > {MOMENT}"
        for view, column in BOUND.items()
    },
    "some columns": f"SELECT revision, sign, kind, text FROM audit_change WHERE {HERE} "
    "ORDER BY revision DESC LIMIT 20",
    "of a kind without a bound": f"SELECT * FROM audit_change WHERE {HERE} AND kind = 'goal' "
    "ORDER BY revision DESC LIMIT 20",
    "ends of facts": f"SELECT * FROM audit_fact WHERE {HERE} AND until IS NOT NULL "
    "ORDER BY until DESC LIMIT 20",
}


def record(url: str) -> str:
    """Record a short and a long history in a store."""
    for name, length in LENGTHS.items():
        with kant_sql.connect(url, knowledge_base=name, actor="test") as kb:
            kb.goals.save(robot_at(place=waypoint(0), is_goal=True))
            for number in range(length):
                here, there = number % 10, (number + 1) % 10
                with kb.transaction():
                    kb.propositions.delete(robot_at(place=waypoint(here)))
                    kb.propositions.save(robot_at(place=waypoint(there)))
                    kb.function_values.set(BATTERY, objects=[RB1], value=there)
    return url


@pytest.fixture(scope="module")
def sqlite_histories(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a store with both histories, on SQLite."""
    return record(f"sqlite:///{tmp_path_factory.mktemp('last') / 'store.db'}")


@pytest.fixture(scope="module")
def postgresql_histories(server: Server) -> str:
    """The URL of a store with both histories, on PostgreSQL."""
    url = server.new_store()
    with psycopg.connect(url, autocommit=True) as connection:
        tables = "SELECT tablename FROM pg_tables WHERE schemaname = 'public'"
        for (table,) in connection.execute(tables).fetchall():
            connection.execute(f"ALTER TABLE {table} SET (autovacuum_enabled = off)".encode())
    return record(url)


@pytest.fixture(scope="module")
def analysed(sqlite_histories: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a copy that has statistics."""
    path = tmp_path_factory.mktemp("analysed") / "store.db"
    with closing(sqlite3.connect(str(make_url(sqlite_histories).database))) as file:
        file.execute("VACUUM INTO ?", [str(path)])
    with closing(sqlite3.connect(path)) as file:
        file.execute("ANALYZE")
    return f"sqlite:///{path}"


def about(url: str, question: str, kb: str) -> str:
    """Ask a question about one of the knowledge bases."""
    time = f"SELECT committed_at FROM audit_revision WHERE {HERE} AND revision = {LENGTHS[kb] - 19}"
    ((moment,),) = rows_of(url, time.format(kb=kb))
    return question.format(kb=kb, time=moment)


def sqlite_steps(url: str, question: str) -> int:
    """Count the steps of SQLite's virtual machine, in tens."""
    counter = itertools.count()
    with closing(sqlite3.connect(str(make_url(url).database))) as file:
        file.execute("SELECT 1 FROM audit_change LIMIT 0").fetchall()
        file.set_progress_handler(lambda: next(counter) < 0, 10)
        file.execute(question).fetchall()
    return next(counter)


def postgresql_rows(url: str, question: str) -> int:
    """Count the rows that the steps of a plan read, or read in vain."""
    with psycopg.connect(url) as connection:
        explained = f"EXPLAIN (ANALYZE, TIMING OFF, FORMAT JSON) {question}"
        ((plans,),) = connection.execute(explained.encode()).fetchall()
    return int(sum(own_rows(node) for node in nodes(plans[0]["Plan"])))


def nodes(plan: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield plan
    for part in plan.get("Plans", ()):
        yield from nodes(part)


def own_rows(node: dict[str, Any]) -> float:
    removed = ("Rows Removed by Filter", "Rows Removed by Join Filter")
    return float(
        (node["Actual Rows"] + sum(node.get(k, 0) for k in removed)) * node["Actual Loops"]
    )


def check(work: dict[str, int], spare: int) -> None:
    """A history that is eight times as long takes hardly more."""
    assert work["long"] <= 1.2 * work["short"] + spare, work


@pytest.mark.parametrize("question", [*QUESTIONS, *ON_SQLITE])
@pytest.mark.more
def test_sqlite_does_not_read_the_history(sqlite_histories: str, question: str) -> None:
    sql = {**QUESTIONS, **ON_SQLITE}[question]
    url = sqlite_histories
    check({kb: sqlite_steps(url, about(url, sql, kb)) for kb in LENGTHS}, 20)


# With statistics, SQLite begins at the predicate, and skips all that it ever had.
@pytest.mark.parametrize("question", sorted(QUESTIONS.keys() - {"of a predicate"}))
def test_statistics_change_nothing_of_it(analysed: str, question: str) -> None:
    sql = QUESTIONS[question]
    check({kb: sqlite_steps(analysed, about(analysed, sql, kb)) for kb in LENGTHS}, 20)


@pytest.mark.parametrize("question", QUESTIONS)
@pytest.mark.more
def test_postgresql_does_not_read_the_history(postgresql_histories: str, question: str) -> None:
    url = postgresql_histories
    check({kb: postgresql_rows(url, about(url, QUESTIONS[question], kb)) for kb in LENGTHS}, 100)


@pytest.mark.parametrize("dialect", ["sqlite", "postgresql"])
@pytest.mark.parametrize("view", BOUND)
def test_all_forms_have_one_answer(request: pytest.FixtureRequest, dialect: str, view: str) -> None:
    url: str = request.getfixturevalue(f"{dialect}_histories")
    column, kb = BOUND[view], "short"
    literal = f"SELECT * FROM {view} WHERE {HERE} AND {column} > {LENGTHS[kb] - 19}"
    expected = sorted(map(str, rows_of(url, literal.format(kb=kb))))
    forms = [LAST, GREATEST, MOMENT]
    for bound in forms:
        question = f"SELECT * FROM {view} WHERE {HERE} AND {column} > {bound}"
        assert sorted(map(str, rows_of(url, about(url, question, kb)))) == expected
    ordered = f"SELECT {column} FROM {view} WHERE {HERE} ORDER BY {column} DESC LIMIT 20"
    last = [row[0] for row in rows_of(url, ordered.format(kb=kb))]
    every = rows_of(url, f"SELECT {column} FROM {view} WHERE {HERE}".format(kb=kb))
    assert last == sorted((row[0] for row in every), reverse=True)[:20]
    assert expected or view in ("audit_object", "audit_definition")
