"""Migration 0004 makes the views of what is there already, and drops them without a trace."""

from __future__ import annotations

import io

import pytest
from alembic import command
from sqlalchemy import inspect, make_url

import kant_sql
from kant_sql.errors import KantSqlError
from kant_sql.schema import alembic_config, current, upgrade_sql
from tests.audit.asking import ask
from tests.migrations.test_0002 import STORY, rows_of, run_script
from tests.migrations.test_golden import FOLDER, connected, dump_of

VIEWS = {
    *("audit_revision", "audit_change", "audit_fact", "audit_goal", "audit_fact_argument"),
    *("audit_value", "audit_value_argument", "audit_object", "audit_definition", "audit_action"),
    *("audit_action_literal", "audit_plan", "audit_plan_step", "audit_plan_step_status"),
    *("audit_plan_step_argument", "audit_archive"),
}


@pytest.fixture
def old_url(empty_url: str) -> str:
    """The URL of a store that version 0001 has written, as version 0003 of the tables has it."""
    kant_sql.upgrade(empty_url, revision="0001")
    run_script(empty_url, STORY)
    kant_sql.upgrade(empty_url, revision="0003")
    return empty_url


def views(url: str) -> set[str]:
    with connected(url) as connection:
        return set(inspect(connection).get_view_names())


def test_the_views_show_what_older_versions_wrote(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0004")
    assert views(old_url) == VIEWS
    assert rows_of(old_url) == before
    facts = "SELECT kind, text, since, until FROM audit_fact WHERE knowledge_base = 'tiago'"
    assert sorted(ask(old_url, facts)) == [
        "fact | (robot_at rb1 wp1) | 1 | 4",
        "fact | (robot_at rb1 wp2) | 4 | NULL",
        "goal | (robot_at rb1 dock) | 4 | NULL",
        "goal | (robot_at rb1 wp2) | 3 | 4",
    ]
    literals = (
        "SELECT role, literal, time FROM audit_action_literal WHERE knowledge_base = 'tiago' "
        "AND action = 'navigation' AND until IS NULL ORDER BY section, position"
    )
    assert len(ask(old_url, literals)) == 5
    revisions = "SELECT count(*), count(observed_at), count(plan_id), min(form) FROM audit_revision"
    assert ask(old_url, revisions) == ["8 | 0 | 0 | 1"]


def test_down_and_up_again(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url, revision="0004")
    whole = dump_of(old_url)
    kant_sql.downgrade(old_url, revision="0003")
    assert views(old_url) == set()
    assert rows_of(old_url) == before
    record = f"{make_url(old_url).get_backend_name()}-0003.sql"
    assert dump_of(old_url) == (FOLDER / record).read_text(encoding="utf-8")
    kant_sql.upgrade(old_url, revision="0004")
    assert dump_of(old_url) == whole
    kant_sql.downgrade(old_url, revision="base")
    assert (views(old_url), rows_of(old_url), current(old_url)) == (set(), {}, None)


def test_a_view_of_somebody_elses_on_these_is_not_dropped_by_the_way(old_url: str) -> None:
    kant_sql.upgrade(old_url, revision="0004")
    run_script(old_url, "CREATE VIEW theirs AS SELECT text FROM audit_fact")
    if make_url(old_url).get_backend_name() == "sqlite":
        kant_sql.downgrade(old_url, revision="0003")
        kant_sql.upgrade(old_url, revision="0004")
    else:
        with pytest.raises(KantSqlError, match="other objects depend on it"):
            kant_sql.downgrade(old_url, revision="0003")
        assert current(old_url) == "0004"
    assert views(old_url) == {*VIEWS, "theirs"}
    assert len(ask(old_url, "SELECT * FROM theirs")) == len(
        ask(old_url, "SELECT 1 FROM audit_fact")
    )


def test_the_sql_that_is_written_offline_has_them(dialect: str) -> None:
    out = io.StringIO()
    upgrade_sql(f"{dialect}://", out)
    assert {
        line.split()[2] for line in out.getvalue().splitlines() if "CREATE VIEW" in line
    } >= VIEWS
    out = io.StringIO()
    config = alembic_config(out)
    config.attributes["url"] = f"{dialect}://"
    command.downgrade(config, "0004:0003", sql=True)
    assert {
        line.split()[2].strip(";") for line in out.getvalue().splitlines() if "DROP V" in line
    } == (VIEWS)
