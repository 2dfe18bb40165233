"""What `docs/tools.md` says of other tools is true of every view."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import duckdb
import pandas
import polars
import psycopg
import pytest
from sqlalchemy import create_engine, make_url

from tests.audit.duck import install_sqlite_extension
from tests.audit.test_views import VIEWS, columns_of

# DuckDB writes UNION ALL with parentheses, which SQLite refuses.
WITH_UNIONS = {"audit_change", "audit_definition", "audit_action_literal"}
OF_COURIER = "WHERE knowledge_base = 'courier'"


@pytest.fixture(scope="module")
def duck(sqlite_story: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """DuckDB with the story attached."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        install_sqlite_extension()
        with duckdb.connect() as tool:
            file = make_url(sqlite_story).database
            tool.execute(f"ATTACH '{file}' AS store (TYPE sqlite, READ_ONLY)")
            yield tool


def rows(url: str, view: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(str(make_url(url).database))) as store:
        return store.execute(f"SELECT * FROM {view} {OF_COURIER}").fetchall()


@pytest.mark.parametrize("view", VIEWS)
def test_duckdb_reads_every_view_by_a_query(duck: Any, sqlite_story: str, view: str) -> None:
    question = f"SELECT * FROM sqlite_query('store', $$SELECT * FROM {view} {OF_COURIER}$$)"
    assert sorted_(duck.execute(question).fetchall()) == sorted_(rows(sqlite_story, view))


@pytest.mark.parametrize("view", VIEWS)
def test_duckdb_reads_views_as_they_are_but_for_those_with_unions(
    duck: Any, sqlite_story: str, view: str
) -> None:
    question = f"SELECT * FROM store.{view} {OF_COURIER}"
    if view in WITH_UNIONS:
        with pytest.raises(duckdb.Error, match="Failed to prepare query"):
            duck.execute(question)
    else:
        assert sorted_(duck.execute(question).fetchall()) == sorted_(rows(sqlite_story, view))


def sorted_(found: list[tuple[Any, ...]]) -> list[str]:
    """Show rows as texts: DuckDB has no other types of a view of SQLite."""
    return sorted(repr([None if v is None else str(v) for v in row]) for row in found)


def leading_nulls(view: str, column: str) -> str:
    """Select a column whose values all come after over a hundred NULLs."""
    return (
        f"WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 150) "
        f"SELECT {column} FROM (SELECT NULL AS {column}, i FROM n UNION ALL "
        f"SELECT {column}, 1000 FROM {view} {OF_COURIER}) AS all_rows ORDER BY i"
    )


def test_polars_looks_at_all_rows(sqlite_story: str) -> None:
    question = leading_nulls("audit_fact", "duration")
    with closing(sqlite3.connect(str(make_url(sqlite_story).database))) as store:
        with pytest.raises(polars.exceptions.ComputeError, match="could not append value"):
            polars.read_database(question, store)
        frame = polars.read_database(question, store, infer_schema_length=None)
    assert frame.schema == {"duration": polars.Float64}
    assert frame["duration"].drop_nulls().len() > 10


@pytest.mark.parametrize("view", VIEWS)
def test_polars_reads_every_view(story_url: str, view: str) -> None:
    question = f"SELECT * FROM {view} {OF_COURIER}"
    file = str(make_url(story_url).database)
    is_sqlite = story_url.startswith("sqlite")
    with closing(sqlite3.connect(file) if is_sqlite else psycopg.connect(story_url)) as store:
        frame = polars.read_database(question, store, infer_schema_length=None)
    assert frame.columns == columns_of(story_url, view)
    known = {"since": polars.Int64, "since_epoch": polars.Float64, "text": polars.String}
    if not frame.is_empty():
        assert {name: frame.schema[name] for name in known if name in frame.columns} == {
            name: type_ for name, type_ in known.items() if name in frame.columns
        }


def test_pandas_has_the_types_of_postgresql(postgresql_story: str) -> None:
    engine = create_engine(make_url(postgresql_story).set(drivername="postgresql+psycopg"))
    question = f"SELECT since, since_at, duration FROM audit_fact {OF_COURIER}"
    frame = pandas.read_sql_query(question, engine)
    engine.dispose()
    assert [str(frame.dtypes[name])[:7] for name in frame.columns] == [
        "int64",
        "datetim",
        "float64",
    ]
