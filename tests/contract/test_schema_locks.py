"""Changes of the schema on PostgreSQL wait for nobody without end, and hold nobody up."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import psycopg
import pytest

import kant_sql
from kant_sql import StoreBusyError
from kant_sql.sql import schema
from kant_sql.sql.dialects import base as retry
from kant_sql.sql.predicate_views import update_views
from tests.support.processes.workers import PATIENCE
from tests.support.roles import members
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at, waypoint

# What anyone could lock who can connect, as earlier versions did for migrations.
ADVISORY = "SELECT pg_advisory_lock(hashtext('kant_sql')), pg_advisory_lock(7737587080895885676)"


@pytest.fixture
def url(server: Server, connect: Connect) -> str:
    """A store with roles and something in it."""
    url = server.new_store()
    connect(url, knowledge_base="tiago").propositions.save(robot_at())
    kant_sql.operations.create_roles(url)
    return url


def renew_roles(url: str) -> None:
    """Set all rights as they are to be."""
    kant_sql.operations.create_roles(url)


def migrate(url: str) -> None:
    """Change tables."""
    kant_sql.operations.downgrade(url, revision="0010")
    kant_sql.upgrade(url)


@pytest.mark.more
@pytest.mark.parametrize("change", [renew_roles, migrate])
def test_an_open_transaction_of_a_reader_is_named_and_holds_nobody_up(
    change: Callable[[str], None], url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", 3)
    kb = connect(url, knowledge_base="tiago")
    version = schema.current(url)
    with members(url, kant_sql.operations.create_roles(url)) as users, ThreadPoolExecutor() as pool:
        with psycopg.connect(users.reader, application_name="dashboard") as reader:
            reader.execute("SELECT FROM proposition")
            changing = pool.submit(change, url)
            longest, number = 0.0, 0
            while not changing.done():
                number += 1
                began = time.monotonic()
                kb.propositions.save(robot_at(place=waypoint(number)))
                longest = max(longest, time.monotonic() - began)
            with pytest.raises(
                StoreBusyError, match=r"nothing was changed.*process \d+ of user"
            ) as e:
                changing.result(PATIENCE)
            assert f"process {reader.info.backend_pid} of user" in str(e.value)
            assert "(dashboard)" in str(e.value)
            assert "pg_terminate_backend" in str(e.value)
            # A writer waited for one attempt at most, not for the reader.
            assert number > 1
            assert longest < 10
            assert schema.current(url) == version
        change(url)
    assert kb.store.verify().is_intact


def test_a_reader_that_ends_in_time_is_waited_for(url: str) -> None:
    with (
        members(url, kant_sql.operations.create_roles(url)) as users,
        psycopg.connect(users.reader) as reader,
        ThreadPoolExecutor() as pool,
    ):
        reader.execute("SELECT FROM head")
        changing = pool.submit(renew_roles, url)
        waiting = "SELECT FROM pg_locks WHERE locktype = 'relation' AND NOT granted"
        with psycopg.connect(url, autocommit=True) as owner:
            while not owner.execute(waiting).fetchall():
                assert not changing.done()
        reader.rollback()
        changing.result(PATIENCE)


def locked_by(user: str) -> psycopg.Connection[tuple[object, ...]]:
    """A connection that keeps what a user can lock without a table that is to be changed."""
    connection = psycopg.connect(user)
    connection.execute(ADVISORY.encode())
    connection.execute("SELECT FROM kant_sql_version")
    for mode in ("ROW SHARE", "SHARE UPDATE EXCLUSIVE", "SHARE", "EXCLUSIVE", "ACCESS EXCLUSIVE"):
        with pytest.raises(psycopg.errors.InsufficientPrivilege), connection.transaction():
            connection.execute(f"LOCK TABLE kant_sql_version IN {mode} MODE NOWAIT".encode())
    return connection


@pytest.mark.more
@pytest.mark.parametrize("role", range(2))
def test_no_login_of_a_role_keeps_the_lock_of_the_schema(role: int, url: str) -> None:
    with members(url, kant_sql.operations.create_roles(url)) as users, locked_by(users[role]):
        kant_sql.operations.create_roles(url)
        assert update_views(url)
        migrate(url)


def test_those_who_change_the_schema_come_one_after_the_other(url: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            changes = [pool.submit(each, url) for each in (renew_roles, update_views) * 2]
            for change in changes:
                change.result(PATIENCE)


def test_several_create_one_store(server: Server) -> None:
    url = server.new_database()
    with ThreadPoolExecutor(4) as pool:
        for made in [pool.submit(kant_sql.upgrade, url) for _ in range(4)]:
            made.result(PATIENCE)
    schema.check(url)
