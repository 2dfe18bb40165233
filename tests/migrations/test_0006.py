"""Migration 0006 adds what a fleet needs; nothing that was stored changes, and no answer."""

from __future__ import annotations

import pytest

import kant_sql
from kant_sql.sql.audit_views import AUDIT_VIEWS
from tests.migrations.stores import (
    Make,
    answers,
    record,
    refusal,
    rows_of,
    run_script,
    views,
    without,
    write_story,
)
from tests.migrations.test_golden import connected, dump_of
from tests.support.pages import ask
from tests.support.reading import findings

# A migration that has landed is frozen.
pytestmark = pytest.mark.more

NEW_VIEW = "audit_promotion"
LATER = ("origin", "verified_revision", "verified_at", "kb_id")
ORIGIN = ("origin", "origin_revision", "origin_committed_at", "heard_at")
TIME = "2026-03-02T14:00:00.000000Z"


def write_old(url: str) -> None:
    """Write what the first version wrote, and bring the tables to version 0005."""
    write_story(url)
    kant_sql.upgrade(url, revision="0005")


@pytest.fixture
def old_url(make: Make) -> str:
    """The URL of a store of version 0005."""
    return make(write_old)


def test_rows_and_answers_are_carried_up_and_down(old_url: str) -> None:
    before = rows_of(old_url)
    names = views(old_url)
    assert names == AUDIT_VIEWS.keys() - {NEW_VIEW}
    said = answers(old_url, names)
    assert dump_of(old_url) == record("0005", old_url)

    kant_sql.upgrade(old_url, revision="0006")
    assert dump_of(old_url) == record("0006", old_url)
    after = rows_of(old_url)
    assert [row for row in after["head"] if any(row[name] is not None for name in ORIGIN)] == []
    after["head"] = without(after["head"], *ORIGIN)
    assert after == before
    for name in names:
        columns = [each for each in AUDIT_VIEWS[name].columns if each not in LATER]
        if name == "audit_archive":
            assert columns[0] == "knowledge_base"
        assert sorted(ask(old_url, f"SELECT {', '.join(columns)} FROM {name}")) == said[name]
    kant_sql.upgrade(old_url)
    assert findings(old_url) == []

    kant_sql.operations.downgrade(old_url, revision="0005")
    assert (rows_of(old_url), dump_of(old_url)) == (before, record("0005", old_url))
    assert answers(old_url, names) == said


@pytest.mark.parametrize("view", AUDIT_VIEWS)
def test_the_last_column_of_each_view_finds_one_knowledge_base(old_url: str, view: str) -> None:
    kant_sql.upgrade(old_url)
    with connected(old_url) as connection:
        pairs = connection.exec_driver_sql(f"SELECT DISTINCT knowledge_base, kb_id FROM {view}")
        known = connection.exec_driver_sql("SELECT name, id FROM knowledge_base")
        assert {*map(tuple, pairs)} <= {*map(tuple, known)}
        (last,) = [*connection.exec_driver_sql(f"SELECT * FROM {view} LIMIT 0").keys()][-1:]
    assert last == "kb_id"


def test_views_of_users_survive_the_way_up(make: Make, dialect: str) -> None:
    url = make(write_old)
    run_script(url, "CREATE VIEW mine AS SELECT text FROM audit_fact WHERE until IS NULL")
    before = ask(url, "SELECT * FROM mine")
    kant_sql.upgrade(url)
    assert ask(url, "SELECT * FROM mine") == before


def test_what_was_verified_and_replicated_is_lost_on_the_way_down(old_url: str) -> None:
    before = rows_of(old_url)
    kant_sql.upgrade(old_url)
    run_script(
        old_url,
        f"UPDATE head SET origin = 'sqlite:///r.db', origin_revision = 9, heard_at = '{TIME}';"
        f"INSERT INTO verification VALUES (1, 1, 'x', '{TIME}', NULL)",
    )
    kant_sql.operations.downgrade(old_url, revision="0005")
    assert rows_of(old_url) == before


def test_promotions_which_hashes_cover_are_not_dropped(old_url: str) -> None:
    kant_sql.upgrade(old_url)
    run_script(old_url, "INSERT INTO promotion VALUES (1, 999, 2, 1, 'sqlite:///r.db', 'x')")
    for revision in ("0005", "0001", "-2"):
        assert "promotions (1)" in refusal(old_url, revision)
    kant_sql.operations.downgrade(old_url, revision="base")
    assert rows_of(old_url) == {}
