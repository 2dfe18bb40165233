"""A PgBouncer for the tests, before a PostgreSQL server for the tests."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import make_url

from tests.support.processes.workers import PATIENCE
from tests.support.servers import Server

PORT = 6432
SETTINGS = """
[databases]
* = host={server}

[pgbouncer]
unix_socket_dir = {folder}
unix_socket_mode = 0777
listen_port = {port}
auth_type = trust
auth_file = {folder}/users.txt
admin_users = postgres
logfile = {folder}/log
"""
USUAL = {
    "pool_mode": "transaction",
    "default_pool_size": "1",
    "max_client_conn": "500",
    "query_wait_timeout": "60",
}


def find_pgbouncer() -> str:
    """Find the program, or skip the test."""
    program = shutil.which("pgbouncer") or shutil.which("/usr/sbin/pgbouncer")
    if program is None:
        pytest.skip("there is no pgbouncer here; Debian has it in the package pgbouncer")
    return program


class Pooler:
    """PgBouncer on a socket in its own folder."""

    def __init__(self, server: Server, **settings: str) -> None:
        self._command = [find_pgbouncer(), "-q"]
        self._folder = Path(tempfile.mkdtemp(prefix="kantpb"))
        self._user: str | None = server._server.system_user
        if self._user is not None:
            # It refuses to run as root.
            shutil.chown(self._folder, self._user)
        (self._folder / "users.txt").write_text('"postgres" ""\n')
        places = SETTINGS.format(server=server.url.query["host"], folder=self._folder, port=PORT)
        lines = "".join(f"{key} = {value}\n" for key, value in {**USUAL, **settings}.items())
        (self._folder / "pgbouncer.ini").write_text(places + lines)
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        self._process = subprocess.Popen(
            [*self._command, str(self._folder / "pgbouncer.ini")],
            user=self._user,
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + PATIENCE
        while True:
            with suppress(psycopg.OperationalError):
                self.ask("SHOW VERSION")
                return
            if self._process.poll() is not None or time.monotonic() > end:
                log = self._folder / "log"
                pytest.fail(log.read_text() if log.exists() else "pgbouncer wrote no log")
            time.sleep(0.02)

    def url(self, direct: str, **options: str) -> str:
        """Return the URL of a database through it, from the direct one."""
        query = {"host": str(self._folder), "port": str(PORT), **options}
        return make_url(direct).set(query=query).render_as_string(hide_password=False)

    def ask(self, command: str) -> list[tuple[object, ...]]:
        """Run a command of its administration console."""
        address = f"host={self._folder} port={PORT} user=postgres dbname=pgbouncer"
        with psycopg.connect(address, autocommit=True) as connection:
            cursor = connection.execute(command.encode())
            return cursor.fetchall() if cursor.description else []

    def kill(self) -> None:
        """Kill it at once."""
        self._process.kill()
        self._process.wait(PATIENCE)
        (self._folder / f".s.PGSQL.{PORT}").unlink(missing_ok=True)

    def stop(self) -> None:
        """Stop it."""
        self.kill()
        shutil.rmtree(self._folder, ignore_errors=True)
