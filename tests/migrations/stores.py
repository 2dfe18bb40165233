"""Stores of earlier versions of the tables, and all that is in them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from sqlalchemy import inspect, make_url, text

import kant_sql
from kant_sql.errors import SchemaError
from kant_sql.knowledge.canonical import revision_hash
from kant_sql.sql.schema import current
from kant_sql.sql.tables.base import VERSION_TABLE
from kant_sql.store import transaction
from tests.migrations.test_golden import connected, digests, dump_of
from tests.support.pages import ask

HERE = Path(__file__).parent
STORY = (HERE / "store-0001.sql").read_text(encoding="utf-8")
REVISIONS = {"tiago": 9, "Küche 🤖": 1}

Rows = dict[str, list[dict[str, Any]]]
# What fills an empty database, and what gives the URL of one that is filled so.
Fill = Callable[[str], None]
Make = Callable[[Fill], str]


def run_script(url: str, script: str) -> None:
    """Run statements in one transaction, with foreign keys checked."""
    with connected(url) as connection:
        driver: Any = connection.connection.driver_connection
        if connection.dialect.name == "sqlite":
            driver.executescript(f"PRAGMA foreign_keys=ON; BEGIN; {script}; COMMIT")
        else:
            driver.execute(script)


def write_story(url: str) -> None:
    """Create a store as version 0001 wrote it."""
    kant_sql.upgrade(url, revision="0001")
    run_script(url, STORY)


def write_migrated_story(url: str) -> None:
    """Create a store as version 0001 wrote it, and bring its tables to the last version."""
    write_story(url)
    kant_sql.upgrade(url)


@cache
def written(name: str, revision: str = "0007") -> Fill:
    """Write what version 0007 wrote, and bring the tables down to a version."""
    script = (HERE / f"{name}-0007.sql").read_text(encoding="utf-8")

    def fill(url: str) -> None:
        kant_sql.upgrade(url, revision="0007")
        run_script(url, script)
        if revision != "0007":
            kant_sql.operations.downgrade(url, revision=revision)

    return fill


@contextmanager
def in_form_1() -> Iterator[None]:
    """Write revisions as the library did before version 0010: hashed in form 1, without a seed."""
    system = mock.Mock(wraps=os, urandom=lambda size: None)
    hashed = partial(revision_hash, form=1)
    with mock.patch.multiple(transaction, FORM=1, revision_hash=hashed, os=system):
        yield


def rows_of(url: str) -> Rows:
    """All rows of all tables that have any."""
    with connected(url) as connection:
        tables = set(inspect(connection).get_table_names()) - {VERSION_TABLE}
        found = {
            table: [
                dict(row) for row in connection.execute(text(f"SELECT * FROM {table}")).mappings()
            ]
            for table in tables
        }
    return {table: in_order(rows) for table, rows in found.items() if rows}


def in_order(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Sort rows, whatever the order of their columns."""
    return sorted(({name: row[name] for name in sorted(row)} for row in rows), key=repr)


def without(rows: list[dict[str, Any]], *columns: str) -> list[dict[str, Any]]:
    """The same rows without some columns."""
    return in_order([{name: row[name] for name in row if name not in columns} for row in rows])


ADDED = (
    *("first_object_id", "second_object_id"),
    *("origin", "origin_revision", "origin_committed_at", "heard_at"),
    "seed",
)


# The tables that version 0008 made of others, with what it added to them.
EXECUTIONS = {
    "execution": ("plan_step", ("since", "name")),
    "execution_argument": ("plan_step_argument", ("value",)),
    "execution_version": (
        "plan_step_version",
        ("kind", "outcome", "code", "message", "started_at", "ended_at"),
    ),
    "revision_execution": ("revision_plan_step", ()),
}


def as_before(url: str) -> Rows:
    """All rows, as the first versions of the tables had them: without the columns added since."""
    found: Rows = {}
    for table, rows in rows_of(url).items():
        before, added = EXECUTIONS.get(table, (table, ()))
        kept = [_in_old_words(row) for row in rows] if before != table else rows
        found[before] = without(kept, *ADDED, *added)
    return found


def _in_old_words(row: dict[str, Any]) -> dict[str, Any]:
    """Give an outcome as a status."""
    if "outcome" not in row:
        return row
    said = {"running": "started"}.get(row["outcome"], row["outcome"])
    return {**row, "status": said}


def views(url: str) -> set[str]:
    """The names of all views."""
    with connected(url) as connection:
        return set(inspect(connection).get_view_names())


def columns_of(url: str) -> dict[str, str]:
    """The columns of each view, as text."""
    names = views(url)
    with connected(url) as connection:
        empty = {
            view: connection.exec_driver_sql(f"SELECT * FROM {view} LIMIT 0") for view in names
        }
        return {view: ", ".join(rows.keys()) for view, rows in empty.items()}


def answers(url: str, names: set[str]) -> dict[str, list[str]]:
    return {view: sorted(ask(url, f"SELECT * FROM {view}")) for view in names}


def record(version: str, url: str) -> str:
    """The digest of the schema of a version, as it is on record."""
    return digests()[f"{make_url(url).get_backend_name()}-{version}"]


def refusal(url: str, revision: str) -> str:
    """Why a downgrade is refused that changes nothing."""
    before = rows_of(url), dump_of(url), current(url)
    with pytest.raises(SchemaError) as caught:
        kant_sql.operations.downgrade(url, revision=revision)
    assert (rows_of(url), dump_of(url), current(url)) == before
    message = str(caught.value)
    assert "\n" not in message
    return message
