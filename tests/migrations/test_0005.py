"""Migration 0005 writes each view on SQLite once more, for DuckDB. No row and no answer changes."""

from __future__ import annotations

import pytest
from sqlalchemy import Connection, text

import kant_sql
from tests.migrations.stores import Make, answers, record, rows_of, views, write_story
from tests.migrations.test_golden import connected, dump_of
from tests.support.reading import findings

# A migration that has landed is frozen.
pytestmark = pytest.mark.more


def write_old(url: str) -> None:
    """Write what the first version wrote, and bring the tables to version 0004."""
    write_story(url)
    kant_sql.upgrade(url, revision="0004")


@pytest.fixture
def old_url(make: Make) -> str:
    """The URL of a store of version 0004."""
    return make(write_old)


def test_views_say_the_same_before_and_after(old_url: str) -> None:
    before = rows_of(old_url)
    names = views(old_url)
    said = answers(old_url, names)
    assert dump_of(old_url) == record("0004", old_url)
    kant_sql.upgrade(old_url, revision="0005")
    assert (rows_of(old_url), dump_of(old_url)) == (before, record("0005", old_url))
    assert answers(old_url, names) == said
    kant_sql.upgrade(old_url)
    assert findings(old_url) == []
    kant_sql.operations.downgrade(old_url, revision="0004")
    assert (rows_of(old_url), dump_of(old_url)) == (before, record("0004", old_url))
    assert answers(old_url, names) == said


@pytest.mark.parametrize("dialect", ["sqlite"])
def test_sqlite_runs_the_same_programs_as_before(make: Make) -> None:
    """What is for DuckDB is a comment to SQLite, so each plan stays as it was."""
    url = make(write_old)
    with connected(url) as connection:
        before = {view: program(connection, view) for view in views(url)}
    kant_sql.upgrade(url, revision="0005")
    with connected(url) as connection:
        assert {view: program(connection, view) for view in views(url)} == before


def program(connection: Connection, view: str) -> list[str]:
    """Give SQLite's instructions, without the addresses of pages."""
    rows = connection.execute(text(f"EXPLAIN SELECT * FROM {view}"))
    return [str(row[1]) for row in rows]
