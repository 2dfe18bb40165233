"""What `docs/tools.md` says of other tools is true of every view."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

import duckdb
import pandas
import polars
import psycopg
import pytest
from sqlalchemy import create_engine, make_url

from kant_sql.sql.audit_views import AUDIT_VIEWS, ColumnType
from tests.audit.duck import install_sqlite_extension
from tests.audit.test_views import UNTOLD, VIEWS, columns_of
from tests.support.citus import view_of

OF_COURIER = "WHERE knowledge_base = 'courier'"
DUCKDB_TYPES = {
    ColumnType.TEXT: "VARCHAR",
    ColumnType.INTEGER: "BIGINT",
    ColumnType.DOUBLE: "DOUBLE",
    ColumnType.BOOLEAN: "BOOLEAN",
    ColumnType.TIME: "TIMESTAMP WITH TIME ZONE",
}


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


@pytest.mark.parametrize("view", VIEWS)
def test_duckdb_reads_every_view_by_a_query(duck: Any, sqlite_story: str, view: str) -> None:
    columns = AUDIT_VIEWS[view].columns
    casts = ", ".join(f"CAST({name} AS {DUCKDB_TYPES[type_]})" for name, type_ in columns.items())
    question = f"FROM sqlite_query('store', $$SELECT * FROM {view} {OF_COURIER}$$)"
    found = duck.execute(f"SELECT {casts} {question}").to_arrow_table()
    read = [tuple(row.values()) for row in found.to_pylist()]
    kept = [
        tuple(typed(value, type_) for value, type_ in zip(row, columns.values(), strict=True))
        for row in rows(sqlite_story, view)
    ]
    assert sorted(map(repr, read)) == sorted(map(repr, kept))
    assert read or view in UNTOLD


def rows(url: str, view: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(str(make_url(url).database))) as store:
        return store.execute(f"SELECT * FROM {view} {OF_COURIER}").fetchall()


def typed(value: Any, type_: ColumnType) -> Any:
    """Give what SQLite has as DuckDB reads it."""
    if value is None or type_ in (ColumnType.TEXT, ColumnType.INTEGER):
        return value
    if type_ is ColumnType.DOUBLE:
        return float(f"{value:.15g}")
    if type_ is ColumnType.BOOLEAN:
        return bool(value)
    return datetime.fromisoformat(value).replace(tzinfo=ZoneInfo("Etc/UTC"))


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
    question = f"SELECT * FROM {view_of(story_url, view, 'courier')} {OF_COURIER}"
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
