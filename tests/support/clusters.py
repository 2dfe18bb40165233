"""PostgreSQL servers with standbys, run by PostgreSQL's programs, on sockets."""

from __future__ import annotations

import random
import shlex
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest

from tests.support.processes.workers import PATIENCE
from tests.support.servers import programs, system_user

DATABASE = "fleet"
# Below the ports that the system assigns, so none is taken before its use.
_PORTS = iter(random.sample(range(20_000, 30_000), 10_000))
SETTINGS = """
listen_addresses = ''
unix_socket_directories = '{folder}'
unix_socket_permissions = 0777
autovacuum = off
max_wal_size = '1GB'
wal_level = replica
hot_standby = on
wal_receiver_status_interval = '100ms'
"""


def run_program(name: str, *words: str | Path, **options: Any) -> str:
    """Run a program of PostgreSQL, and return its output."""
    command = [str(programs() / name), *map(str, words)]
    done: subprocess.CompletedProcess[str] = subprocess.run(
        command, capture_output=True, text=True, user=system_user(), cwd="/", check=False, **options
    )
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
    return done.stdout


def free_port() -> int:
    """Find another port without a listener."""
    for port in _PORTS:
        with socket.socket() as free, suppress(OSError):
            free.bind(("127.0.0.1", port))
            return port
    pytest.fail("no port is free")


def install_programs(folder: Path) -> None:
    """Copy PostgreSQL's programs into a folder, as the user that runs servers."""
    user = system_user()
    words = [] if user is None else ["setpriv", f"--reuid={user}", f"--regid={user}"]
    for program in programs().iterdir():
        command = shlex.join([*words, *(["--clear-groups"] if words else []), str(program)])
        script = folder / program.name
        script.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
        script.chmod(0o755)


def stop_servers(folder: Path) -> None:
    """Stop the servers whose files are in a folder."""
    for running in folder.glob("*/postmaster.pid"):
        with suppress(psutil.NoSuchProcess, ValueError, IndexError):
            process = psutil.Process(int(running.read_text().split()[0]))
            process.send_signal(signal.SIGQUIT)
            psutil.wait_procs([process], PATIENCE)


class Cluster:
    """A folder with servers and the archive of their log."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="kantha"))
        self.log_archive = self.folder / "wal"
        self.log_archive.mkdir()
        for each in (self.folder, self.log_archive):
            if (user := system_user()) is not None:
                shutil.chown(each, user)
        self._nodes: list[Node] = []

    def primary(self, **settings: str) -> Node:
        """Make a server with the database of the fleet."""
        node = self.node(5432)
        run_program("initdb", "-D", node.data, "-U", "postgres", "--auth", "trust", "-N")
        node.configure(**settings)
        node.start()
        node.execute(f"CREATE DATABASE {DATABASE}")
        return node

    def standby(self, of: Node, port: int, name: str = "standby") -> Node:
        """Make a standby from a base backup, and start it."""
        node = self.node(port)
        origin = of.conninfo(application_name=name)
        run_program(
            "pg_basebackup", "-d", origin, "-D", node.data, "-R", "-X", "stream", "-c", "fast"
        )
        node.start()
        return node

    def node(self, port: int) -> Node:
        """Return a server that has no files yet."""
        made = Node(self.folder, port)
        self._nodes.append(made)
        return made

    def stop(self) -> None:
        """Stop all servers."""
        for node in self._nodes:
            node.kill()
        shutil.rmtree(self.folder, ignore_errors=True)


class Node:
    """A server of a cluster."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        self.port = port
        self.data = folder / f"data{port}"
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Host and port, in the form for URLs that may name several."""
        return f"host={self.folder}:{self.port}"

    @property
    def url(self) -> str:
        """The URL of the fleet's database on it."""
        return f"postgresql://postgres@/{DATABASE}?host={self.folder}&port={self.port}"

    def conninfo(self, database: str = DATABASE, **more: str) -> str:
        """Return the connection parameters for PostgreSQL's programs."""
        words = {"host": self.folder, "port": self.port, "user": "postgres", "dbname": database}
        return " ".join(f"{key}={value}" for key, value in {**words, **more}.items())

    def connection(self, database: str = DATABASE) -> psycopg.Connection[Any]:
        """Open a connection without the library."""
        return psycopg.connect(self.conninfo(database), autocommit=True)

    def ask(self, sql: str, database: str = "postgres") -> Any:
        """Query a single value."""
        with self.connection(database) as connection:
            row = connection.execute(sql.encode()).fetchone()
        return None if row is None else row[0]

    def configure(self, **settings: str) -> None:
        """Add settings."""
        with (self.data / "postgresql.conf").open("a") as conf:
            conf.write(SETTINGS.format(folder=self.folder))
            conf.writelines(f"{key} = '{value}'\n" for key, value in settings.items())

    def execute(self, sql: str) -> None:
        """Run a statement."""
        with self.connection("postgres") as connection:
            connection.execute(sql.encode())

    def set(self, **settings: str) -> None:
        """Change settings of the running server."""
        with self.connection("postgres") as connection:
            for key, value in settings.items():
                connection.execute(f"ALTER SYSTEM SET {key} = '{value}'".encode())
            connection.execute("SELECT pg_reload_conf()")

    def start(self) -> None:
        """Start it, and wait until it answers."""
        command = [str(programs() / "postgres"), "-D", str(self.data), "-p", str(self.port)]
        with (self.folder / f"log{self.port}").open("ab") as log:
            self._process = subprocess.Popen(
                command, stdout=log, stderr=log, user=system_user(), cwd="/"
            )
        self.wait_for("SELECT true")

    def wait_for(self, sql: str, database: str = "postgres") -> None:
        """Wait until a query returns true."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            with suppress(psycopg.OperationalError):
                if self.ask(sql, database):
                    return
            if self._process is None or self._process.poll() is not None:
                break
            time.sleep(0.02)
        pytest.fail(f"{sql}\n{(self.folder / f'log{self.port}').read_text()[-4000:]}")

    def promote(self) -> None:
        """Make it the primary."""
        run_program("pg_ctl", "promote", "-D", self.data, "-w")

    def kill(self) -> None:
        """Kill it with all of its processes at once."""
        if self._process is None:
            return
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(self._process.pid)
            family = [process, *process.children(recursive=True)]
            for each in family:
                with suppress(psutil.NoSuchProcess):
                    each.send_signal(signal.SIGKILL)
        self._process.wait(PATIENCE)
        self._process = None
