"""The two drivers, each with the settings that a careful program would give it."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import psycopg

Row = tuple[Any, ...]


class SqliteDriver:
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
    def open(cls, path: Path) -> SqliteDriver:
        """Open a file, which is in WAL mode since its tables were made."""
        return cls(sqlite3.connect(path))

    def run(self, sql: str, parameters: Sequence[Any] = ()) -> sqlite3.Cursor:
        """Run a statement; sqlite3 keeps it prepared."""
        return self.cursor.execute(sql, parameters)

    def run_many(self, sql: str, rows: list[Row]) -> None:
        """Run a statement for each row."""
        self.cursor.executemany(sql, rows)

    def moment(self, text: str) -> Any:
        """Give the form in which a time is stored."""
        return text


class PsycopgDriver:
    """psycopg 3, every statement prepared."""

    begin = "BEGIN"
    lock = " FOR UPDATE"

    def __init__(self, url: str) -> None:
        self.connection = psycopg.connect(url, autocommit=True, prepare_threshold=0)
        self.cursor: psycopg.Cursor[Row] = self.connection.cursor()

    def run(self, sql: str, parameters: Sequence[Any] = ()) -> psycopg.Cursor[Row]:
        """Run a statement."""
        return self.cursor.execute(_percent(sql), parameters or None)

    def run_many(self, sql: str, rows: list[Row]) -> None:
        """Run a statement for each row, in one batch."""
        self.cursor.executemany(_percent(sql), rows)

    def moment(self, text: str) -> Any:
        """Give the form in which a time is stored."""
        return datetime.fromisoformat(text)


@cache
def _percent(sql: str) -> Any:
    return sql.replace("?", "%s")


Driver = SqliteDriver | PsycopgDriver
