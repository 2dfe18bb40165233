"""On SQLite 3.34 to 3.41, no statement asks what is answered wrong where statistics are."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy.exc import CompileError

from kant_sql.sql.dialects import create_backend
from tests.support.sharding import every_query
from tests.support.statistics import loses_bound
from tests.support.stores import new_file_store

DIALECT = create_backend("sqlite://").dialect
# In the index of past values `since` follows `fork`; in that of facts an argument comes between.
READ = (
    "SELECT * FROM function_value_version WHERE kb_id = 1 AND function_id = 5 AND fork IN (0, 4, 6)"
)
CONDITIONS = {
    "": False,
    "AND since <= 6": True,
    "AND since < 6": True,
    "AND since >= 2": True,
    "AND since BETWEEN 2 AND 6": True,
    "AND since > 0 AND since <= 6": False,
    "AND likelihood(since > 0, 1.0) AND since <= 6": False,
    "AND since > 2 - 1 AND since <= 6": False,
}


@pytest.fixture
def analyzed(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    url = new_file_store(tmp_path / "store.db")
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
        yield connection


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_bound_after_an_in_is_lost_unless_it_is_above_a_number(
    analyzed: sqlite3.Connection, condition: str
) -> None:
    assert loses_bound(analyzed, f"{READ} {condition}") is CONDITIONS[condition]


def test_no_statement_loses_a_bound(analyzed: sqlite3.Connection) -> None:
    found = []
    for name, query in every_query():
        try:
            text = query.text(DIALECT)
        except CompileError:
            # It is PostgreSQL's.
            continue
        if loses_bound(analyzed, text):
            found.append((name, text))
    assert found == []
