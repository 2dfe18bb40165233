"""The two bare drivers, each with the settings that a careful program would give it."""

from __future__ import annotations

import sqlite3
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import psycopg

Row = tuple[Any, ...]


class Driver(ABC):
    """A bare driver: the same few steps on each backend; parameters are `?`."""

    begin: str  # begins a transaction that writes
    lock: str  # what locks the rows of a SELECT
    connection: Any

    @abstractmethod
    def run(self, sql: str, parameters: Sequence[Any] = ()) -> sqlite3.Cursor | psycopg.Cursor[Row]:
        """Run a statement, which stays prepared; give its cursor."""

    @abstractmethod
    def run_many(self, sql: str, rows: list[Row]) -> None:
        """Run a statement for each row."""

    @abstractmethod
    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        """Insert rows in the fastest way that the driver has."""

    @abstractmethod
    def moment(self, text: str) -> Any:
        """Give the form in which a time is stored."""

    @abstractmethod
    def settle(self) -> None:
        """Do what the database would do by itself in time: statistics, clean-up, checkpoint."""

    @abstractmethod
    def without_checks(self) -> None:
        """Let rows in without looking up what they refer to: to load what is known to be right."""

    def execute(self, sql: str, parameters: Sequence[Any] = ()) -> list[Row]:
        """Run a statement, and give its rows."""
        cursor = self.run(sql, parameters)
        return list(cursor.fetchall()) if cursor.description else []

    def close(self) -> None:
        self.connection.close()


class SqliteDriver(Driver):
    """sqlite3, set up as the library sets it up."""

    begin = "BEGIN IMMEDIATE"
    lock = ""

    def __init__(self, connection: sqlite3.Connection) -> None:
        connection.isolation_level = None
        connection.execute("PRAGMA foreign_keys=ON")
        connection.execute("PRAGMA synchronous=NORMAL")
        self.connection = connection
        self.cursor = connection.cursor()

    @classmethod
    def open(cls, path: Path | str) -> SqliteDriver:
        """Open a file, which is in WAL mode since its tables were made."""
        return cls(sqlite3.connect(path))

    def run(self, sql: str, parameters: Sequence[Any] = ()) -> sqlite3.Cursor:
        return self.cursor.execute(sql, parameters)

    def run_many(self, sql: str, rows: Iterable[Row]) -> None:
        self.cursor.executemany(sql, rows)

    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        self.run_many(f"INSERT INTO {table} VALUES ({', '.join('?' * width)})", rows)

    def moment(self, text: str) -> Any:
        return text

    def settle(self) -> None:
        self.run("PRAGMA wal_checkpoint(TRUNCATE)")

    def without_checks(self) -> None:
        self.run("PRAGMA foreign_keys=OFF")
        self.run("PRAGMA cache_size=-1000000")


class PsycopgDriver(Driver):
    """psycopg 3, every statement prepared."""

    begin = "BEGIN"
    lock = " FOR UPDATE"

    def __init__(self, url: str) -> None:
        self.connection = psycopg.connect(url, autocommit=True, prepare_threshold=0)
        self.cursor: psycopg.Cursor[Row] = self.connection.cursor()

    def run(self, sql: str, parameters: Sequence[Any] = ()) -> psycopg.Cursor[Row]:
        return self.cursor.execute(_percent(sql), parameters or None)

    def run_many(self, sql: str, rows: list[Row]) -> None:
        self.cursor.executemany(_percent(sql), rows)

    def insert(self, table: str, width: int, rows: Iterable[Row]) -> None:
        with self.cursor.copy(f"COPY {table} FROM STDIN".encode()) as copy:
            for row in rows:
                copy.write_row(row)

    def moment(self, text: str) -> Any:
        return datetime.fromisoformat(text)

    def settle(self) -> None:
        self.run("VACUUM ANALYZE")
        self.run("CHECKPOINT")

    def without_checks(self) -> None:
        self.run("SET session_replication_role = replica")


@cache
def _percent(sql: str) -> Any:
    return sql.replace("?", "%s")


def bare(url: str) -> Driver:
    """Open a store with its bare driver."""
    if url.startswith("sqlite"):
        return SqliteDriver.open(url.removeprefix("sqlite:///"))
    return PsycopgDriver(url)
