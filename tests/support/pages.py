"""Pages of the docs, and SQL on stores that are opened without the library."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import psycopg
from sqlalchemy import make_url

Execute = Callable[[str, dict[str, Any]], list[tuple[Any, ...]]]

FOLDER = Path(__file__).parents[2] / "docs"


class Page:
    """A page of the docs.

    Attributes:
        text: its whole text.
        blocks: language and text of each code block, in order.
    """

    def __init__(self, name: str) -> None:
        self.text = (FOLDER / name).read_text(encoding="utf-8")
        self.blocks: list[tuple[str, str]] = re.findall(
            r"^```(\w+)\n(.*?)^```$", self.text, re.DOTALL | re.MULTILINE
        )

    def of(self, language: str) -> list[str]:
        """Return the code blocks in one language."""
        return [block for named, block in self.blocks if named == language]


class Opened(NamedTuple):
    """A store, opened without the library.

    Attributes:
        dialect: its dialect's name in the docs.
        execute: runs SQL with parameters such as `:name`.
    """

    dialect: str
    execute: Execute


@contextmanager
def opened(url: str) -> Iterator[Opened]:
    """Open a store with the bare driver."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        with closing(sqlite3.connect(str(parsed.database), isolation_level=None)) as file:
            yield Opened("SQLite", lambda sql, values: file.execute(sql, values).fetchall())
        return

    def execute(sql: str, values: dict[str, Any]) -> list[tuple[Any, ...]]:
        named = sql
        for name in values:
            named = re.sub(rf":{name}\b", f"%({name})s", named)
        cursor = server.execute(named.encode(), values)
        return cursor.fetchall() if cursor.description else []

    with psycopg.connect(url, autocommit=True) as server:
        yield Opened("PostgreSQL", execute)


Ask = Callable[[str], list[str]]


def shown(value: object) -> str:
    """Show a value in the same form for each database."""
    if value is None:
        return "NULL"
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat(timespec="microseconds")[:26] + "Z"
    return str(int(value)) if isinstance(value, bool) else str(value)


def ask(url: str, sql: str) -> list[str]:
    """Run a query, and show each row on a line."""
    return [" | ".join(map(shown, row)) for row in rows_of(url, sql)]


def rows_of(url: str, sql: str) -> list[tuple[Any, ...]]:
    """Run a query."""
    with opened(url) as store:
        return store.execute(sql, {})
