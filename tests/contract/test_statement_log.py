"""The log `kant_sql.sql` has each statement that runs, so counting there is honest."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any

import psycopg
import pytest

from kant_sql import KnowledgeBase
from tests.support.servers import Server
from tests.support.statements import READS, fact, fill, is_bracket, recorded
from tests.support.stores import Connect
from tests.support.worlds.robots import waypoint


@contextmanager
def seen_by_sqlite() -> Iterator[list[str]]:
    """Give what SQLite itself runs on the connections that are made in a block."""
    seen: list[str] = []
    connect_ = sqlite3.connect

    def connect(*args: Any, **options: Any) -> sqlite3.Connection:
        connection: sqlite3.Connection = connect_(*args, **options)
        # To look at the file itself, apart from its log, is no statement on the store.
        if "immutable" not in args[0]:
            connection.set_trace_callback(seen.append)
        return connection

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect)
        yield seen


@contextmanager
def seen_by_psycopg() -> Iterator[list[str]]:
    """Give what psycopg is asked to run in a block."""
    seen: list[str] = []

    def spy(owner: Any, name: str) -> None:
        method = getattr(owner, name)

        def spied(self: Any, sql: str, *args: Any, **options: Any) -> Any:
            seen.append(sql)
            return method(self, sql, *args, **options)

        patch.setattr(owner, name, spied)

    with pytest.MonkeyPatch.context() as patch:
        for name in ("execute", "executemany", "copy"):
            spy(psycopg.Cursor, name)
        spy(psycopg.ServerCursor, "execute")
        yield seen


def heads(statements: list[str]) -> list[str]:
    """Tell statements apart by their first words, for a trace has values in place of parameters."""
    return [" ".join(sql.split()[:3]) for sql in statements if not is_bracket(sql)]


def batches_as_one(statements: list[str]) -> list[str]:
    """Take rows that are inserted into one table, one after the other, as one statement."""
    return [
        head
        for head, same in groupby(heads(statements))
        for _ in (same if not head.startswith("INSERT") else [head])
    ]


def work_on(kb: KnowledgeBase) -> None:
    """Use all that runs statements."""
    for read in READS.values():
        read(kb)
    kb.propositions.delete(fact(1))
    with kb.transaction():
        kb.propositions.save(fact(1))
        kb.propositions.get_all()
        kb.propositions.save(fact(2))
    kb.at(1).propositions.get_by_predicate("robot_at")
    kb.store.revisions()
    list(kb.log())
    kb.objects.save_all(waypoint(number) for number in range(10, 100))
    kb.propositions.save_all(fact(number) for number in range(10, 100))


def test_on_sqlite_the_log_has_what_the_database_runs(tmp_path: Path, connect: Connect) -> None:
    url = f"sqlite:///{tmp_path / 'store.db'}"
    fill(connect(url), 10)
    with seen_by_sqlite() as seen, recorded() as logged:
        work_on(connect(url))
    # A connection's own settings.
    seen = [sql for sql in seen if not sql.startswith("PRAGMA")]
    assert len(logged) > 30
    assert batches_as_one(seen) == batches_as_one(logged)


def test_on_postgresql_the_log_has_what_the_driver_is_given(
    server: Server, connect: Connect
) -> None:
    url = server.new_store()
    fill(connect(url), 10)
    with seen_by_psycopg() as seen, recorded() as logged:
        work_on(connect(url))
    assert any(sql.startswith("COPY") for sql in logged)
    # What sets up a connection is not logged.
    made = [
        "SELECT set_config('lock_timeout', '20s',",
        "SELECT extname FROM",
    ]
    assert heads(seen) == [*made, *heads(logged)]
