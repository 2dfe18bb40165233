"""Migration 0004 adds an index of the steps that run now."""

from __future__ import annotations

import pytest
from sqlalchemy import text

import kant_sql
from kant_sql.plans import dao
from kant_sql.sql.dialects import create_backend
from tests.migrations.stores import Make, record, rows_of, write_story
from tests.migrations.test_golden import connected, dump_of
from tests.support.reading import findings

# A migration that has landed is frozen.
pytestmark = pytest.mark.more

SIZE = 20_000


def write_old(url: str) -> None:
    """Write what the first version wrote, and bring the tables to version 0003."""
    write_story(url)
    kant_sql.upgrade(url)
    kant_sql.operations.downgrade(url, revision="0003")


@pytest.fixture
def old_url(make: Make) -> str:
    """The URL of a store of version 0003."""
    return make(write_old)


def test_nothing_else_changes(old_url: str) -> None:
    before = rows_of(old_url)
    assert dump_of(old_url) == record("0003", old_url)
    kant_sql.upgrade(old_url, revision="0004")
    assert (rows_of(old_url), dump_of(old_url)) == (before, record("0004", old_url))
    kant_sql.upgrade(old_url)
    assert findings(old_url) == []
    kant_sql.operations.downgrade(old_url, revision="0003")
    assert (rows_of(old_url), dump_of(old_url)) == (before, record("0003", old_url))


def test_running_steps_are_found_without_reading_the_others(empty_url: str) -> None:
    kant_sql.upgrade(empty_url)
    with connected(empty_url) as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SET session_replication_role = replica"))
        connection.execute(
            text(
                "WITH RECURSIVE t (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t WHERE n < :size)"
                " INSERT INTO plan_step_version (kb_id, plan_id, position, since, status, text)"
                " SELECT 1, n / 10, n % 10, 1, CASE n WHEN 7 THEN 'started' ELSE 'succeeded' END,"
                " 'x' FROM t"
            ),
            {"size": SIZE},
        )
        explain = "EXPLAIN QUERY PLAN" if connection.dialect.name == "sqlite" else "EXPLAIN"
        # The text is kept for all who ask: it needs the parameters of the library's dialect.
        asked = dao._RUNNING.text(create_backend(empty_url).dialect)
        found = connection.exec_driver_sql(f"{explain} {asked}", {"kb": 1}).all()
        plan = "\n".join(str(row[-1]) for row in found)
        assert " ix_plan_step_version_running" in plan, plan
        assert "scan plan_step" not in plan.lower(), plan
        connection.rollback()
