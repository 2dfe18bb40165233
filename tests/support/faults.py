"""Faults of a store: locks held, connections and answers lost, rows damaged."""

from __future__ import annotations

import random
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects import base as retry
from kant_sql.sql.dialects import postgresql
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.dialects.postgresql import PostgresqlSession
from tests.support.worlds.robots import WP2, robot_at
from tests.support.worlds.story import DOMAIN, NAME, PROBLEM, write_story

BOUND = 0.4

on_server = pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
on_file = pytest.mark.parametrize("shared_url", ["sqlite-file"], indirect=True)


def be_impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for locks, and retry, only for a moment."""
    monkeypatch.setattr(retry, "RETRY_FOR", BOUND)
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "100ms")


@contextmanager
def held(url: str) -> Iterator[Callable[[], None]]:
    """Hold the write lock of a store, as another process would; yield how to release it."""
    connection: Any
    if url.startswith("sqlite"):
        path = url.removeprefix("sqlite:///")
        connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        connection.execute("BEGIN IMMEDIATE")
    else:
        connection = psycopg.connect(url)
        for (kb_id,) in connection.execute("SELECT kb_id FROM head").fetchall():
            # On one shard of a cluster.
            connection.execute(f"SELECT * FROM head WHERE kb_id = {kb_id:d} FOR UPDATE")
    with closing(connection):
        yield connection.rollback
        # A server's process that merely loses its client still holds the lock for a while.
        connection.rollback()


def change(url: str, *statements: str) -> None:
    """Run statements that no call of the library runs."""
    with kant_sql.open_store(url) as store, store.catalog._backend.open_session() as session:
        for statement in statements:
            session.define(statement)


def terminate(url: str) -> int:
    """End all connections to a database, as an administrator may; return their number."""
    with psycopg.connect(url, autocommit=True) as connection:
        ended = connection.execute(
            "SELECT pg_terminate_backend(pid, 5000) FROM pg_stat_activity"
            " WHERE datname = current_database() AND pid <> pg_backend_pid()"
        )
        return len(ended.fetchall())


WRITES: dict[str, Callable[[KnowledgeBase], object]] = {}


def write(function: Callable[[KnowledgeBase], object]) -> Callable[[KnowledgeBase], object]:
    WRITES[function.__name__] = function
    return function


@write
def one_call(kb: KnowledgeBase) -> object:
    return kb.propositions.insert(robot_at(place=WP2))


@write
def many_dtos(kb: KnowledgeBase) -> object:
    return kb.propositions.save_all([robot_at(place=WP2)]) == 1


@write
def a_transaction(kb: KnowledgeBase) -> object:
    with kb.transaction():
        return kb.propositions.insert(robot_at(place=WP2))


each_write = pytest.mark.parametrize("work", WRITES.values(), ids=WRITES)


def lose_at(monkeypatch: pytest.MonkeyPatch, url: str, method: str) -> None:
    """Lose all connections just before a session's next call of a method."""
    owner = PostgresqlSession if method == "insert" else Session
    original = getattr(owner, method)
    times = iter([url])

    def lose(session: Session, *arguments: Any, **parameters: Any) -> Any:
        for lost in times:
            terminate(lost)
        return original(session, *arguments, **parameters)

    monkeypatch.setattr(owner, method, lose)


@contextmanager
def closed_door(url: str) -> Iterator[Callable[[], None]]:
    """Yield a function that ends all connections to a database; refuse new ones in the block."""
    name = make_url(url).database
    elsewhere = make_url(url).set(database="postgres").render_as_string(hide_password=False)
    with psycopg.connect(elsewhere, autocommit=True) as connection:

        def close_door() -> None:
            connection.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS false".encode())
            connection.execute(
                "SELECT pg_terminate_backend(pid, 5000) FROM pg_stat_activity WHERE datname = %s",
                [name],
            )

        yield close_door
        connection.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS true".encode())


def lose_answer(monkeypatch: pytest.MonkeyPatch, commits: bool, also: Callable[[], object]) -> None:
    """Lose the answer to the next COMMIT, which has or has not committed the work."""
    original = Session.commit
    times = iter([commits])

    def commit(session: Session, changed: int | None = None) -> None:
        for done in times:
            original(session, changed) if done else session.rollback()
            also()
            raise ConnectionLostError("the answer was lost")
        original(session, changed)

    monkeypatch.setattr(Session, "commit", commit)


# Values of cells that the library never writes.
VERIFIED_AT = "2026-03-02T14:00:00.000000Z"
JUNK: tuple[Any, ...] = (
    *(None, -1, 0, 1, 2, 10**6, 2**62, -(2**63), 1.5, float("inf"), -0.0),
    *("", "x", "(", "()", "?x", "nan", "NaN", "inf", "1e999999", "1/3", "and", "at", "\0", "a b"),
    *("{", "[]", "null", "2026-13-45T99:99:99.000000Z", "2026-01-31T09:30:00.000000Z"),
    *(b"", b"\xff\xfe", b"and"),
)
# SQLite accepts any bytes as text.
NO_UTF8 = "CAST(x'61ff62' AS TEXT)"


Call = Callable[[], Any]


class Damage(NamedTuple):
    """A change of one cell, or of a row.

    Attributes:
        table: the table.
        column: the column; None if the row is removed.
        key: the columns that name the row, and their values.
        value: the new value of the cell, as SQL.
        parameters: its parameters.
    """

    table: str
    column: str | None
    key: tuple[str, tuple[Any, ...]]
    value: str
    parameters: tuple[Any, ...]

    def apply(self, path: Path) -> None:
        with closing(sqlite3.connect(path, isolation_level=None)) as bare:
            bare.execute("PRAGMA ignore_check_constraints=ON")
            columns, values = self.key
            which = f"({columns}) = ({', '.join('?' for _ in values)})"
            if self.column is None:
                bare.execute(f"DELETE FROM {self.table} WHERE {which}", values)
                return
            # The key of a table without rowid is never NULL.
            with suppress(sqlite3.IntegrityError):
                bare.execute(
                    f"UPDATE OR REPLACE {self.table} SET {self.column} = {self.value} "
                    f"WHERE {which}",
                    (*self.parameters, *values),
                )


def write_rich_story(path: Path) -> None:
    """Fill a file with rows in each table, without constraints."""
    write_story(f"sqlite:///{path}", f"sqlite:///{path.with_suffix('.archive')}")
    with kant_sql.connect(f"sqlite:///{path}", knowledge_base=NAME) as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    with closing(sqlite3.connect(path, isolation_level=None)) as bare:
        unguard(bare)
        # This story is made for damage, so these values need not be true either.
        bare.execute("INSERT INTO verification VALUES (1, 1, 'x', ?, NULL)", (VERIFIED_AT,))
        bare.execute("INSERT INTO promotion VALUES (1, 999, 2, 1, 'sqlite:///robot.db', 'x')")
        bare.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def unguard(bare: sqlite3.Connection) -> None:
    """Remove the guards against damage: NOT NULL, unique indexes and foreign keys."""
    bare.execute("PRAGMA writable_schema=ON")
    for name, sql in bare.execute(
        "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND sql IS NOT NULL"
    ).fetchall():
        bare.execute(
            "UPDATE sqlite_master SET sql = ? WHERE type = 'table' AND name = ?",
            (re.sub("(?<!IS) NOT NULL", "", sql), name),
        )
    bare.execute("PRAGMA writable_schema=RESET")


def damages(path: Path, seed: int) -> Iterator[Damage]:
    """Yield endless damages, each of a random cell; the same ones for the same seed."""
    chance = random.Random(seed)
    with closing(sqlite3.connect(path)) as bare:
        bare.text_factory = lambda raw: raw.decode(errors="replace")
        names = [
            name
            for (name,) in bare.execute(
                "SELECT name FROM sqlite_master WHERE type = 'table' AND name <> "
                "'kant_sql_version' AND name NOT LIKE 'sqlite%' ORDER BY name"
            )
        ]
        cells = {
            name: (
                [row[1] for row in bare.execute(f"PRAGMA table_info({name})")],
                [(key, row) for row in bare.execute(f"SELECT {key} FROM {name}")],
            )
            for name in names
            for key in [_key_of(bare, name)]
        }
    filled = [name for name in names if cells[name][1]]
    while True:
        table = chance.choice(filled)
        columns, keys = cells[table]
        column, key = chance.choice(columns), chance.choice(keys)
        own, other = chance.choice(keys)
        kind = chance.random()
        if kind < 0.05:
            yield Damage(table, None, key, "", ())
        elif kind < 0.2:
            which = f"({own}) = ({', '.join('?' for _ in other)})"
            taken = f"(SELECT {column} FROM {table} WHERE {which})"
            yield Damage(table, column, key, taken, other)
        elif kind < 0.25:
            yield Damage(table, column, key, NO_UTF8, ())
        else:
            yield Damage(table, column, key, "?", (chance.choice(JUNK),))


def _key_of(bare: sqlite3.Connection, table: str) -> str:
    """Return the columns that identify a row: a few tables have no rowid."""
    try:
        bare.execute(f"SELECT rowid FROM {table}")
    except sqlite3.OperationalError:
        return ", ".join(row[1] for row in bare.execute(f"PRAGMA table_info({table})") if row[5])
    return "rowid"


def _dao_calls(kb: KnowledgeBase) -> Iterator[Call]:
    for dao in vars(kb).values():
        if hasattr(dao, "get_all"):
            yield dao.get_all
    yield kb.pddl.metric.get
    yield kb.goals.get_propositions
    yield lambda: kb.propositions.get_by_predicate("at")
    yield lambda: kb.actions.get("drive")
    yield lambda: kb.functions.get("fuel")
    yield lambda: kb.objects.get("t1")


def _plan_texts(kb: KnowledgeBase) -> list[str]:
    return [str(step) for plan in kb.plans.get_all() for step in plan.steps]


def _read_calls(kb: KnowledgeBase) -> Iterator[Call]:
    truck = PddlObjectDto(PddlTypeDto("truck"), "t1")
    yield from _dao_calls(kb)
    yield lambda: [call() for call in _dao_calls(kb.at(12))]
    yield lambda: kb.revision
    yield kb.store.revisions
    yield lambda: list(kb.log())
    yield lambda: list(kb.log(element=truck))
    yield lambda: list(kb.changes())
    yield lambda: kb.diff(10, kb.revision)
    yield lambda: kb.history("(at t1 p1)")
    yield lambda: kb.blame("(at t1 p1)")
    yield lambda: kb.history("rest")
    yield kb.domain_pddl
    yield kb.problem_pddl
    yield lambda: kb.at(11).domain_pddl()
    yield lambda: kb.at(11).problem_pddl()
    yield kb.pddl.requirements
    yield lambda: _plan_texts(kb)
    yield lambda: kb.watch(0, timeout=0)
    yield kb.store.anchor


def _heavy_calls(kb: KnowledgeBase, url: str, archive: str) -> Iterator[Call]:
    """List slow calls, and calls that read before they write."""
    yield kb.store.verify
    yield lambda: kant_sql.operations.update_views(url)
    yield lambda: kb.store.archive(15, to=archive, dry_run=True)
    yield lambda: kb.objects.save(PddlObjectDto(PddlTypeDto("truck"), "new"))
    yield kb.propositions.delete_all
    yield lambda: kb.restore(11)
    yield lambda: kb.load_problem(PROBLEM, mode="merge")
    yield lambda: kb.store.archive(15, to=archive)


def errors_of_reading(url: str, archive: str | None = None) -> Iterator[Exception]:
    """Make all calls that read, and with an archive those that write; yield the raised errors."""
    try:
        kb = kant_sql.connect(url, knowledge_base=NAME, actor="reader")
    except Exception as error:
        yield error
        return
    with kb:
        heavy = () if archive is None else _heavy_calls(kb, url, archive)
        for call in (*_read_calls(kb), *heavy):
            try:
                call()
            except Exception as error:
                yield error
