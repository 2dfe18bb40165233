"""What the benchmarks share: stores to measure on, the bare drivers, and how to compare."""

from __future__ import annotations

import gc
import shutil
import sqlite3
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import psycopg

import kant_sql
from tests.support.servers import Server

Row = tuple[Any, ...]
NewStore = Callable[[], str]
_numbers = count(1)


@contextmanager
def stores(names: Sequence[str]) -> Iterator[dict[str, NewStore]]:
    """Give, for each backend, what makes an empty store with its tables and gives its URL."""
    folder = Path(tempfile.mkdtemp(prefix="kantbench"))
    server = Server(folder / "pg") if "postgresql" in names else None

    def sqlite() -> str:
        url = f"sqlite:///{folder / f'store{next(_numbers)}.db'}"
        kant_sql.connect(url).close()
        return url

    def postgresql() -> str:
        assert server is not None
        url = server.new_database()
        kant_sql.upgrade(url)
        return url

    try:
        yield {name: {"sqlite": sqlite, "postgresql": postgresql}[name] for name in names}
    finally:
        if server is not None:
            server._server.cleanup()
        shutil.rmtree(folder, ignore_errors=True)


class Bare(ABC):
    """A bare driver: the same few steps on each backend."""

    @abstractmethod
    def execute(self, sql: str, parameters: Row = ()) -> list[Row]:
        """Run a statement whose parameters are `?`, and give its rows."""

    @abstractmethod
    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        """Insert rows in the fastest way that the driver has."""

    @abstractmethod
    def settle(self) -> None:
        """Do what the database would do by itself in time: statistics, clean-up, checkpoint."""

    @abstractmethod
    def do_not_wait(self) -> None:
        """Let no commit in this store wait for the disk: that would hide what it costs itself."""

    @abstractmethod
    def without_checks(self) -> None:
        """Let rows in without looking up what they refer to: to load what is known to be right."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""


class BareSqlite(Bare):
    """sqlite3, set as the library sets it."""

    def __init__(self, url: str) -> None:
        self._connection = sqlite3.connect(url.removeprefix("sqlite:///"), isolation_level=None)
        self._connection.execute("PRAGMA foreign_keys=ON")
        self._connection.execute("PRAGMA synchronous=NORMAL")

    def execute(self, sql: str, parameters: Row = ()) -> list[Row]:
        return self._connection.execute(sql, parameters).fetchall()

    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        values = ", ".join("?" * width)
        self._connection.executemany(f"INSERT INTO {table} VALUES ({values})", rows)

    def settle(self) -> None:
        self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def do_not_wait(self) -> None:
        # In WAL mode, as the library sets it, none does.
        pass

    def without_checks(self) -> None:
        self._connection.execute("PRAGMA foreign_keys=OFF")

    def close(self) -> None:
        self._connection.close()


class BarePostgresql(Bare):
    """psycopg 3."""

    def __init__(self, url: str) -> None:
        self._connection = psycopg.connect(url, autocommit=True)

    def execute(self, sql: str, parameters: Row = ()) -> list[Row]:
        cursor: Any = self._connection.cursor()
        cursor.execute(sql.replace("?", "%s"), parameters)
        return list(cursor.fetchall()) if cursor.description else []

    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        cursor: Any = self._connection.cursor()
        with cursor.copy(f"COPY {table} FROM STDIN") as copy:
            for row in rows:
                copy.write_row(row)

    def settle(self) -> None:
        self._connection.execute("VACUUM ANALYZE")
        self._connection.execute("CHECKPOINT")

    def do_not_wait(self) -> None:
        name = self._connection.info.dbname
        self._connection.execute(f'ALTER DATABASE "{name}" SET synchronous_commit = off'.encode())

    def without_checks(self) -> None:
        self._connection.execute("SET session_replication_role = replica")

    def close(self) -> None:
        self._connection.close()


def bare(url: str) -> Bare:
    """Open a store with its bare driver."""
    return BareSqlite(url) if url.startswith("sqlite") else BarePostgresql(url)


def seconds(call: Callable[[], Any]) -> float:
    """Tell how long a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def alternate(
    repeat: int, *makes: Callable[[int], Callable[[], Any]], clean: bool = False
) -> list[list[float]]:
    """Time calls in turn, each round another one first, and give the times of each, sorted.

    What disturbs one disturbs all: other programs, and the garbage that they leave to each other.

    Args:
        repeat: how often each is called.
        *makes: gives the call of a round, set up and ready.
        clean: whether to collect garbage before each call.
    """
    times: list[list[float]] = [[] for _ in makes]
    for number in range(repeat):
        for turn in range(len(makes)):
            side = (number + turn) % len(makes)
            call = makes[side](number)
            if clean:
                gc.collect()
            times[side].append(seconds(call))
    return [sorted(taken) for taken in times]


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table in aligned columns, the first to the left; short rows end early."""
    lines = [list(header), *([*row] + [""] * (len(header) - len(row)) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    print(f"\n{title}")
    for line in lines:
        cells = [
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]
        print("  " + "  ".join(cells).rstrip())
