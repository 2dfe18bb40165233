"""What `docs/tools.md` says of other tools is true of every view."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import duckdb
import pandas
import polars
import psycopg
import pytest
from sqlalchemy import create_engine, make_url

import kant_sql
from kant_sql.sql.audit_views import AUDIT_VIEWS, ColumnType
from tests.audit.duck import install_sqlite_extension
from tests.audit.test_literals import CONDITIONS, DOMAIN, DURATIVE, EFFECTS
from tests.audit.test_views import VIEWS, columns_of
from tests.support.citus import view_of
from tests.support.pages import rows_of

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


def rows(url: str, view: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(str(make_url(url).database))) as store:
        return store.execute(f"SELECT * FROM {view} {OF_COURIER}").fetchall()


@pytest.mark.parametrize("view", VIEWS)
def test_duckdb_reads_every_view_by_a_query(duck: Any, sqlite_story: str, view: str) -> None:
    question = f"SELECT * FROM sqlite_query('store', $$SELECT * FROM {view} {OF_COURIER}$$)"
    assert sorted_(duck.execute(question).fetchall()) == sorted_(rows(sqlite_story, view))


@pytest.mark.parametrize("view", VIEWS)
def test_duckdb_reads_every_view_as_it_is_with_types(
    duck: Any, sqlite_story: str, view: str
) -> None:
    found = duck.execute(f"SELECT * FROM store.{view} {OF_COURIER}")
    columns = AUDIT_VIEWS[view].columns
    assert [(name, str(type_)) for name, type_, *_ in found.description] == [
        (name, DUCKDB_TYPES[type_]) for name, type_ in columns.items()
    ]
    read = [tuple(row.values()) for row in found.to_arrow_table().to_pylist()]
    kept = [
        tuple(typed(value, type_) for value, type_ in zip(row, columns.values(), strict=True))
        for row in rows(sqlite_story, view)
    ]
    assert sorted(map(repr, read)) == sorted(map(repr, kept))
    assert read or view in ("audit_archive", "audit_promotion")


def typed(value: Any, type_: ColumnType) -> Any:
    """Give what SQLite has as a value of its type."""
    if value is None or type_ not in (ColumnType.BOOLEAN, ColumnType.TIME):
        return value
    if type_ is ColumnType.BOOLEAN:
        return bool(value)
    return datetime.fromisoformat(value).replace(tzinfo=ZoneInfo("Etc/UTC"))


def test_duckdb_counts_and_compares_as_numbers_and_times(duck: Any, sqlite_story: str) -> None:
    question = f"SELECT max(revision), max(delay) FROM store.audit_change {OF_COURIER}"
    (last,) = rows_of(
        sqlite_story, f"SELECT max(revision), max(delay) FROM audit_change {OF_COURIER}"
    )
    assert duck.execute(question).fetchone() == last
    asked = f"SELECT count(*) FROM STORE.audit_fact {OF_COURIER} AND since_at < TIME"
    noon = "'2026-03-02T12:00:00.000000Z'"
    counts = [
        duck.execute(asked.replace("STORE", "store").replace("TIME", noon)).fetchall(),
        rows_of(sqlite_story, asked.replace("STORE.", "").replace("TIME", noon)),
    ]
    assert counts[0] == counts[1] != [(0,)]


def test_duckdb_lists_the_store(duck: Any) -> None:
    """One view that DuckDB cannot read, and it lists none."""
    question = "SELECT view_name FROM duckdb_views() WHERE database_name = 'store'"
    assert {row[0] for row in duck.execute(question).fetchall()} == VIEWS.keys()


def test_duckdb_reads_literals_of_every_form(duck: Any, tmp_path: Path) -> None:
    """DuckDB walks all trees at once, in words of its own."""
    file = tmp_path / "store.db"
    forms = [(DOMAIN, condition, "(and)") for condition in CONDITIONS]
    forms += [(DOMAIN, "(and)", effect) for effect in EFFECTS]
    forms += [
        (DURATIVE, "(over all (not (or (p ?a) (r))))", "(when (at start (r)) (at end (p ?b)))")
    ]
    for number, (domain, condition, effect) in enumerate(forms):
        with kant_sql.connect(f"sqlite:///{file}", knowledge_base=f"kb {number}") as kb:
            kb.load_domain(domain.format(name="act", condition=condition, effect=effect))
    duck.execute(f"ATTACH '{file}' AS literals (TYPE sqlite, READ_ONLY)")
    columns = "knowledge_base, kind, section, position, role, predicate, literal, time, since"
    question = f"SELECT {columns}, CAST(is_conditional AS INTEGER) FROM audit_action_literal"
    read = duck.execute(question.replace("audit_", "literals.audit_")).fetchall()
    assert sorted(map(repr, read)) == sorted(map(repr, rows_of(f"sqlite:///{file}", question)))
    assert len(read) > len(forms)
    duck.execute("DETACH literals")


def test_duckdb_reads_generated_views_with_types(
    sqlite_story: str, tmp_path: Path, duck: Any
) -> None:
    file = tmp_path / "store.db"
    with (
        closing(sqlite3.connect(str(make_url(sqlite_story).database))) as story,
        closing(sqlite3.connect(file)) as copy,
    ):
        story.backup(copy)
    url = f"sqlite:///{file}"
    made = kant_sql.update_views(url)
    duck.execute(f"ATTACH '{file}' AS generated (TYPE sqlite, READ_ONLY)")
    for view in made:
        found = duck.execute(f"SELECT * FROM generated.{view.name}")
        types = {name: str(type_) for name, type_, *_ in found.description}
        assert tuple(types) == view.columns
        wanted = {
            "since": "BIGINT",
            "until_at": DUCKDB_TYPES[ColumnType.TIME],
            "duration": "DOUBLE",
        }
        assert {name: types[name] for name in wanted} == wanted
        assert types[view.columns[0]] in ("VARCHAR", "BIGINT")
        read = [tuple(row.values()) for row in found.to_arrow_table().to_pylist()]
        times = [name.endswith("_at") for name in view.columns]
        kept = [
            tuple(
                typed(value, ColumnType.TIME if is_time else ColumnType.TEXT)
                for value, is_time in zip(row, times, strict=True)
            )
            for row in rows_of(url, f"SELECT * FROM {view.name}")
        ]
        assert sorted(map(repr, read)) == sorted(map(repr, kept))
    with kant_sql.connect(url, knowledge_base="courier") as kb:
        assert kb.verify().is_intact
    duck.execute("DETACH generated")


def sorted_(found: list[tuple[Any, ...]]) -> list[str]:
    """Show rows as texts: a query that DuckDB passes on has no other types."""
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
