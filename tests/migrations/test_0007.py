"""Migration 0007 takes DuckDB's words out of the views on SQLite. No row and no answer changes."""

from __future__ import annotations

import pytest

import kant_sql
from tests.migrations.stores import Make, answers, record, rows_of, views, write_story
from tests.migrations.test_0005 import program
from tests.migrations.test_golden import connected, dump_of
from tests.support.reading import findings


def write_old(url: str) -> None:
    """Write what the first version wrote, and bring the tables to version 0006."""
    write_story(url)
    kant_sql.upgrade(url, revision="0006")


def test_rows_and_answers_are_carried_up_and_down(make: Make, dialect: str) -> None:
    url = make(write_old)
    before, names = rows_of(url), views(url)
    said = answers(url, names)
    assert dump_of(url) == record("0006", url)
    kant_sql.upgrade(url, revision="0007")
    assert (rows_of(url), dump_of(url)) == (before, record("0007", url))
    assert answers(url, names) == said
    assert findings(url) == []
    # PostgreSQL's views never had a second query.
    assert (record("0007", url) == record("0006", url)) is (dialect == "postgresql")
    kant_sql.operations.downgrade(url, revision="0006")
    assert (rows_of(url), dump_of(url)) == (before, record("0006", url))
    assert answers(url, names) == said


@pytest.mark.parametrize("dialect", ["sqlite"])
def test_sqlite_runs_the_same_programs_as_before(make: Make) -> None:
    url = make(write_old)
    with connected(url) as connection:
        before = {view: program(connection, view) for view in views(url)}
    kant_sql.upgrade(url, revision="0007")
    with connected(url) as connection:
        assert {view: program(connection, view) for view in views(url)} == before
    assert "/*" not in dump_of(url)
