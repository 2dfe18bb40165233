"""Migrations 0004 to 0007: views, what is lost on the way down, and what is not."""

from __future__ import annotations

import pytest
from sqlalchemy import text

import kant_sql
from kant_sql.acts import recording
from kant_sql.sql.audit_views import AUDIT_VIEWS
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.schema import VERSIONS
from tests.migrations import stores
from tests.migrations.test_golden import connected
from tests.support.pages import ask

# A migration that has landed is frozen.
LANDED = pytest.mark.more
TIME = "2026-03-02T14:00:00.000000Z"
SIZE = 20_000


@LANDED
def test_running_steps_are_found_without_reading_the_others(empty_url: str) -> None:
    kant_sql.upgrade(empty_url)
    with connected(empty_url) as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SET session_replication_role = replica"))
        connection.execute(
            text(
                "WITH RECURSIVE t (n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM t WHERE n < :size)"
                " INSERT INTO execution_version"
                " (kb_id, plan_id, position, since, kind, outcome, text)"
                " SELECT 1, n / 10, n % 10, 1, 'execution',"
                " CASE n WHEN 7 THEN 'running' ELSE 'succeeded' END, 'x' FROM t"
            ),
            {"size": SIZE},
        )
        explain = "EXPLAIN QUERY PLAN" if connection.dialect.name == "sqlite" else "EXPLAIN"
        # The text is kept for all who ask: it needs the parameters of the library's dialect.
        asked = recording.RUNNING_NOW.text(create_backend(empty_url).dialect)
        found = connection.exec_driver_sql(f"{explain} {asked}", {"kb": 1}).all()
        plan = "\n".join(str(row[-1]) for row in found)
        assert " ix_execution_version_running" in plan, plan
        assert "scan execution" not in plan.lower(), plan
        connection.rollback()


@pytest.fixture
def old_url(make: stores.Make) -> str:
    """The URL of a store of version 0005."""
    return make(stores.written("store", "0005"))


@LANDED
@pytest.mark.parametrize("view", AUDIT_VIEWS)
def test_the_last_column_of_each_view_finds_one_knowledge_base(old_url: str, view: str) -> None:
    kant_sql.upgrade(old_url)
    with connected(old_url) as connection:
        pairs = connection.exec_driver_sql(f"SELECT DISTINCT knowledge_base, kb_id FROM {view}")
        known = connection.exec_driver_sql("SELECT name, id FROM knowledge_base")
        assert {*map(tuple, pairs)} <= {*map(tuple, known)}
    # A view that stays in place gets its new columns at the end.
    added = ", unconfirmed" if view == "audit_statistics" else ""
    assert stores.columns_of(old_url)[view].endswith(f", kb_id{added}")


@LANDED
def test_views_of_users_survive_the_way_up(old_url: str) -> None:
    stores.run_script(
        old_url, "CREATE VIEW mine AS SELECT text FROM audit_fact WHERE until IS NULL"
    )
    before = ask(old_url, "SELECT * FROM mine")
    kant_sql.upgrade(old_url)
    assert ask(old_url, "SELECT * FROM mine") == before


@LANDED
def test_what_was_verified_and_replicated_is_lost_on_the_way_down(old_url: str) -> None:
    before = stores.rows_of(old_url)
    kant_sql.upgrade(old_url)
    stores.run_script(
        old_url,
        f"UPDATE head SET origin = 'sqlite:///r.db', origin_revision = 9, heard_at = '{TIME}';"
        f"INSERT INTO verification VALUES (1, 1, 'x', '{TIME}', NULL)",
    )
    kant_sql.operations.downgrade(old_url, revision="0005")
    assert stores.rows_of(old_url) == before


@LANDED
def test_promotions_which_hashes_cover_are_not_dropped(old_url: str) -> None:
    kant_sql.upgrade(old_url)
    stores.run_script(old_url, "INSERT INTO promotion VALUES (1, 999, 2, 1, 'sqlite:///r.db', 'x')")
    for revision in ("0005", "0001", f"-{len(VERSIONS) - 5}"):
        assert "promotions (1)" in stores.refusal(old_url, revision)
    kant_sql.operations.downgrade(old_url, revision="base")
    assert stores.rows_of(old_url) == {}
