"""Opening a store on a server: what is refused, and that no error tells a password."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from unittest import mock
from urllib.parse import quote_plus

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KantSqlError, StoreError, StoreUnreachableError
from kant_sql.errors import AuthenticationError, ReadOnlyStoreError
from kant_sql.sql.dialects import base as retry
from kant_sql.sql.dialects import postgresql
from tests.support.pages import rows_of
from tests.support.processes.workers import PATIENCE
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at

pytestmark = pytest.mark.usefixtures("real_migrations", "patient")

PASSWORD = "p@ss/w:rd"
# Whatever is tried again, or waits for an answer, takes twice as long.
PROMPTLY = PATIENCE / 2


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)
    monkeypatch.setattr(postgresql, "CONNECT_TIMEOUT", str(PATIENCE))


def assert_silent(error: BaseException | None, *secrets: str) -> None:
    """Check that no message on the way tells a secret."""
    while error is not None:
        for secret in secrets:
            assert secret not in str(error)
            assert secret not in repr(error)
        error = error.__cause__ or error.__context__


@pytest.fixture(scope="module")
def guarded(server: Server) -> Iterator[str]:
    """The URL of a user who needs a password, which the URL has."""
    rules = Path(server._server.pgdata) / "pg_hba.conf"
    before = rules.read_text()
    url = make_url(server.new_database())
    kant_sql.upgrade(url.render_as_string(hide_password=False))
    with psycopg.connect(server._server.get_uri(), autocommit=True) as connection:
        connection.execute(f"CREATE ROLE guarded LOGIN PASSWORD '{PASSWORD}'".encode())
        rules.write_text(f"local all guarded scram-sha-256\n{before}")
        connection.execute("SELECT pg_reload_conf()")
        with closing(psycopg.connect(server.url.render_as_string())) as fresh:
            assert fresh.execute("SELECT 1").fetchone() == (1,)
        yield url.set(username="guarded", password=PASSWORD).render_as_string(hide_password=False)
        rules.write_text(before)
        connection.execute("SELECT pg_reload_conf()")
        # Tests of other modules may come between those of this one, which then make it again.
        connection.execute("DROP ROLE guarded")


@pytest.mark.parametrize("opens", [kant_sql.connect, kant_sql.upgrade])
@pytest.mark.parametrize("password", ["wrong&secret", "", None])
def test_a_wrong_password_is_refused_and_not_repeated(
    guarded: str, password: str | None, opens: Callable[[str], object]
) -> None:
    given = "" if password is None else f":{quote_plus(password)}"
    url = guarded.replace(f":{quote_plus(PASSWORD)}", given)
    began = time.monotonic()
    with pytest.raises(AuthenticationError, match="refused the user or the password") as caught:
        opens(url)
    assert time.monotonic() - began < PROMPTLY
    assert_silent(caught.value, "wrong&secret", "wrong%26secret")


@pytest.mark.parametrize("opens", [kant_sql.connect, kant_sql.upgrade])
def test_a_server_that_is_too_old_is_refused_by_its_version(
    server: Server, opens: Callable[[str], object]
) -> None:
    url = server.new_store()
    refused = r"PostgreSQL 13\.22, and kant_sql needs 14 or later; upgrade the server"
    with (
        mock.patch.object(psycopg.ConnectionInfo, "server_version", 130_022),
        pytest.raises(StoreError, match=refused),
    ):
        opens(url)


@pytest.mark.parametrize("opens", [kant_sql.connect, kant_sql.upgrade])
def test_a_database_of_bytes_is_refused_by_its_encoding(
    server: Server, opens: Callable[[str], object]
) -> None:
    url = make_url(server.new_database())
    name = f"{url.database}_bytes"
    options = "ENCODING 'SQL_ASCII' LC_COLLATE 'C' LC_CTYPE 'C' TEMPLATE template0"
    with psycopg.connect(server._server.get_uri(), autocommit=True) as connection:
        connection.execute(f'CREATE DATABASE "{name}" {options}'.encode())
    with pytest.raises(StoreError, match="use one with the encoding UTF8"):
        opens(url.set(database=name).render_as_string(hide_password=False))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("DateStyle", "'German, DMY'"),
        ("client_encoding", "'LATIN1'"),
        ("standard_conforming_strings", "off"),
        ("quote_all_identifiers", "on"),
    ],
)
def test_settings_of_a_database_change_nothing(server: Server, name: str, value: str) -> None:
    url = server.new_store()
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(
            f'ALTER DATABASE "{make_url(url).database}" SET {name} TO {value}'.encode()
        )
    with kant_sql.connect(url, knowledge_base="台") as kb:
        kb.types.save("台")
        (revision,) = kb.store.revisions()
        assert kb.at(revision.committed_at).types.get("台") is not None
        assert kb.store.verify().findings == ()
    sql = kant_sql.operations.create_roles(url, knowledge_base="台", dry_run=True).statements
    assert sql


def test_an_unknown_user_is_refused(guarded: str) -> None:
    url = make_url(guarded).set(username="nobody", password=PASSWORD)
    with pytest.raises(AuthenticationError, match="nobody") as caught:
        kant_sql.connect(url.render_as_string(hide_password=False))
    assert_silent(caught.value, PASSWORD, "p%40ss")


def test_a_database_that_is_not_there_is_refused(guarded: str) -> None:
    url = make_url(guarded).set(username="postgres", database="missing")
    with pytest.raises(StoreUnreachableError, match='database "missing" does not exist') as caught:
        kant_sql.connect(url.render_as_string(hide_password=False))
    assert_silent(caught.value, PASSWORD, "p%40ss")


def test_a_user_without_rights_is_told_so_and_reads_with_the_right_to_read(
    guarded: str, connect: Connect
) -> None:
    owner = make_url(guarded).set(username="postgres").render_as_string(hide_password=False)
    connect(owner).propositions.save(robot_at())
    with pytest.raises(ReadOnlyStoreError, match="permission denied"):
        connect(guarded)
    rows_of(owner, "GRANT SELECT ON ALL TABLES IN SCHEMA public TO guarded")
    kb = connect(guarded)
    assert kb.propositions.get_all() == [robot_at()]
    with pytest.raises(ReadOnlyStoreError, match="permission denied"):
        kb.goals.save(robot_at(is_goal=True))
    rows_of(owner, "REVOKE SELECT ON ALL TABLES IN SCHEMA public FROM guarded")


def test_a_server_that_only_reads_says_so(server: Server, connect: Connect) -> None:
    url = server.new_store()
    connect(url).propositions.save(robot_at())
    name = make_url(url).database
    rows_of(url, f"ALTER DATABASE {name} SET default_transaction_read_only = on")
    kb = connect(url)
    assert kb.propositions.get_all() == [robot_at()]
    with pytest.raises(ReadOnlyStoreError, match="read-only transaction"):
        kb.goals.save(robot_at(is_goal=True))


@pytest.fixture
def closed_port() -> Iterator[int]:
    """A port that is taken, so that nobody else can listen on it."""
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        yield taken.getsockname()[1]


@pytest.mark.parametrize("opens", [kant_sql.connect, kant_sql.upgrade])
@pytest.mark.parametrize("secret", ["{}:s3cret@", "{}@"])
def test_a_port_that_nobody_listens_on_is_refused_at_once(
    closed_port: int, opens: Callable[[str], object], secret: str
) -> None:
    url = f"postgresql://{secret.format('user')}127.0.0.1:{closed_port}/robots?password=s3cret"
    began = time.monotonic()
    with pytest.raises(StoreUnreachableError, match="check that the server runs") as caught:
        opens(url)
    assert time.monotonic() - began < PROMPTLY
    assert_silent(caught.value, "s3cret")


@pytest.mark.more
def test_a_server_that_does_not_answer_is_not_waited_for_for_ever() -> None:
    began = time.monotonic()
    with closing(socket.create_server(("127.0.0.1", 0))) as silent:
        url = f"postgresql://user:s3cret@127.0.0.1:{silent.getsockname()[1]}/db?connect_timeout=2"
        with pytest.raises(StoreUnreachableError, match="timeout") as caught:
            kant_sql.connect(url)
    assert time.monotonic() - began < PROMPTLY
    assert_silent(caught.value, "s3cret")


@pytest.mark.parametrize("option", ["sslmode=odd", "nonsense=1", "connect_timeout=soon"])
def test_an_option_that_the_driver_refuses_is_reported(closed_port: int, option: str) -> None:
    with pytest.raises(KantSqlError, match=option.partition("=")[0]) as caught:
        kant_sql.connect(f"postgresql://user:s3cret@127.0.0.1:{closed_port}/robots?{option}")
    assert_silent(caught.value, "s3cret")
