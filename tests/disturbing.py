"""How to disturb a client of a store: hold its locks, end its connections, lose its answers."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

from kant_sql import ConnectionLostError, KnowledgeBase, retry
from kant_sql.backends import Session, postgresql
from kant_sql.backends.postgresql_session import PostgresqlSession
from tests.worlds import WP2, robot_at

BOUND = 0.4

on_server = pytest.mark.parametrize("shared_url", ["postgresql"], indirect=True)
on_file = pytest.mark.parametrize("shared_url", ["sqlite-file"], indirect=True)


def be_impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for locks, and try again, for a moment only."""
    monkeypatch.setattr(retry, "RETRY_FOR", BOUND)
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "100ms")


@contextmanager
def held(url: str) -> Iterator[Callable[[], None]]:
    """Hold the write lock of a store, as another process would; gives how to let go."""
    connection: Any
    if url.startswith("sqlite"):
        path = url.removeprefix("sqlite:///")
        connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        connection.execute("BEGIN IMMEDIATE")
    else:
        connection = psycopg.connect(url)
        connection.execute("SELECT * FROM head FOR UPDATE")
    with closing(connection):
        yield connection.rollback


def terminate(url: str) -> int:
    """End all connections to a database, as an administrator may; give how many there were."""
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
    """Lose all connections just before a session next does something."""
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
    """Give how to end all connections to a database and to refuse new ones, until the end."""
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
    """Lose the answer to the next COMMIT, with which the work was made or undone."""
    original = Session.commit
    times = iter([commits])

    def commit(session: Session, changed: int | None = None) -> None:
        for done in times:
            original(session, changed) if done else session.rollback()
            also()
            raise ConnectionLostError("the answer was lost")
        original(session, changed)

    monkeypatch.setattr(Session, "commit", commit)
