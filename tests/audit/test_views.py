"""The views are as `docs/audit.md` describes them, and the same on both databases."""

from __future__ import annotations

import re
from collections.abc import Callable

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql.sql.audit_views import AUDIT_VIEWS, ColumnType
from tests.audit.ward import record_ward
from tests.support.citus import view_of
from tests.support.pages import Page, ask, rows_of

pytestmark = pytest.mark.every_backend

PAGE = Page("audit.md")


def described() -> dict[str, list[str]]:
    """The columns of each view that the page lists, with those that many views share."""
    parts = re.split(r"^### ", PAGE.text, flags=re.MULTILINE)[1:]
    listed = {
        part.partition("\n")[0].strip("`"): re.findall(r"^\| ([`*]\w+[`*]) \|", part, re.MULTILINE)
        for part in parts
    }
    interval, revision = listed.pop("The interval"), listed.pop("The revision")
    shared = {"*interval*": interval, "*revision*": revision, "*period*": listed.pop("The period")}
    shared["*beginning*"] = interval[: interval.index("`until`")]
    return {
        view: [
            "knowledge_base",
            *(name.strip("`") for column in columns for name in shared.get(column, [column])),
        ]
        for view, columns in listed.items()
    }


VIEWS = described()


def columns_of(url: str, view: str) -> list[str]:
    if make_url(url).get_backend_name() == "sqlite":
        return [row[1] for row in rows_of(url, f"PRAGMA table_info({view})")]
    with psycopg.connect(url) as connection:
        query = f"SELECT * FROM {view_of(url, view, 'courier')} LIMIT 0"
        cursor = connection.execute(query.encode())
        return [column.name for column in cursor.description or ()]


def views_of(url: str) -> set[str]:
    names = (
        "SELECT name FROM sqlite_master WHERE type = 'view'"
        if make_url(url).get_backend_name() == "sqlite"
        else "SELECT viewname FROM pg_views WHERE schemaname = 'public' AND viewname !~ '^citus'"
    )
    return {row[0] for row in rows_of(url, names)}


def test_the_page_describes_every_view_and_no_other(story_url: str) -> None:
    assert views_of(story_url) == VIEWS.keys()


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_has_the_columns_described_in_their_order(story_url: str, view: str) -> None:
    assert columns_of(story_url, view) == VIEWS[view]
    assert VIEWS[view][0] == "knowledge_base"


def test_every_column_has_a_type() -> None:
    assert {name: [*view.columns] for name, view in AUDIT_VIEWS.items()} == VIEWS


POSTGRESQL_TYPES = {
    ColumnType.TEXT: {"text", "varchar", "json"},
    ColumnType.INTEGER: {"int4", "int8"},
    ColumnType.DOUBLE: {"float8"},
    ColumnType.BOOLEAN: {"bool"},
    ColumnType.TIME: {"timestamptz"},
}
SQLITE_TYPES = {
    ColumnType.TEXT: {"text"},
    ColumnType.INTEGER: {"integer"},
    ColumnType.DOUBLE: {"real"},
    ColumnType.BOOLEAN: {"integer"},
    ColumnType.TIME: {"text"},
}


@pytest.mark.parametrize("view", VIEWS)
def test_columns_have_these_types_on_postgresql(postgresql_story: str, view: str) -> None:
    with psycopg.connect(postgresql_story) as connection:
        cursor = connection.execute(f"SELECT * FROM {view} LIMIT 0".encode())
        types = connection.adapters.types
        found = {column.name: types[column.type_code].name for column in cursor.description or ()}
    wanted = AUDIT_VIEWS[view].columns
    assert [name for name in found if found[name] not in POSTGRESQL_TYPES[wanted[name]]] == []


@pytest.mark.parametrize("view", VIEWS)
def test_values_are_of_these_types_on_sqlite(sqlite_story: str, view: str) -> None:
    for name, type_ in AUDIT_VIEWS[view].columns.items():
        found = {
            row[0] for row in rows_of(sqlite_story, f"SELECT DISTINCT typeof({name}) FROM {view}")
        }
        assert found <= {"null", *SQLITE_TYPES[type_]}, name


@pytest.mark.parametrize("view", VIEWS)
def test_rows_are_sorted_by_what_tells_them_apart(story_url: str, view: str) -> None:
    order = ", ".join(("knowledge_base", *AUDIT_VIEWS[view].order))
    keys = rows_of(story_url, f"SELECT {order} FROM {view_of(story_url, view, 'courier')}")
    assert len(keys) == len(set(keys))


# What the story does not do; other stores do.
UNTOLD = ("audit_archive", "audit_promotion", "audit_confirmation", "audit_erasure")


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_says_the_same_of_the_same_story_on_both_databases(
    sqlite_story: str, postgresql_story: str, view: str
) -> None:
    # What is hashed is the same, so hashes are, too.
    query = f"SELECT * FROM {view} WHERE knowledge_base = 'courier'"
    lines = [sorted(ask(url, query)) for url in (sqlite_story, postgresql_story)]
    assert lines[0] == lines[1]
    assert lines[0] or view in UNTOLD


@pytest.mark.usefixtures("server")
def test_acts_and_confirmations_are_alike_on_both_databases(scratch: Callable[[str], str]) -> None:
    urls = [record_ward(scratch(dialect)) for dialect in ("sqlite", "postgresql")]
    for view in ("audit_confirmation", "audit_effect", "audit_execution", "audit_statistics"):
        # Each store has ids of its own for knowledge bases.
        columns = ", ".join(name for name in VIEWS[view] if name != "kb_id")
        query = f"SELECT {columns} FROM {view} WHERE knowledge_base = 'ward'"
        lines = [sorted(ask(url, query)) for url in urls]
        assert lines[0] == lines[1] != []


@pytest.mark.parametrize("view", VIEWS)
def test_nothing_of_another_knowledge_base_is_mixed_in(story_url: str, view: str) -> None:
    """The other one has but its own few names, of which the story has some, too."""
    read = view_of(story_url, view, "other")
    rows = ask(story_url, f"SELECT * FROM {read} WHERE knowledge_base = 'other'")
    words = {word for row in rows for word in re.findall(r"\((?:robot_at|served) [^)]*\)", row)}
    assert words <= {"(robot_at rb1 t2)", "(robot_at ?r0 - robot ?p1 - place)"}
    numbers = {"audit_revision": 2, "audit_change": 7, "audit_fact": 2, "audit_goal": 1}
    numbers["audit_fact_valid"] = 1
    numbers |= {
        "audit_knowledge_base": 1,
        "audit_fact_argument": 4,
        "audit_object": 2,
        "audit_definition": 5,
    }
    assert len(rows) == numbers.get(view, 0)


def test_each_change_is_a_line_of_the_revision(story_url: str) -> None:
    """The view says what the library's own log says."""
    with kant_sql.connect(story_url, knowledge_base="courier") as kb:
        logged = sorted(
            (entry.revision.number, change.sign, change.kind, change.text)
            for entry in kb.log()
            for change in entry.changes
        )
    query = "SELECT revision, sign, kind, text FROM audit_change WHERE knowledge_base = 'courier'"
    assert sorted(rows_of(story_url, query)) == logged
