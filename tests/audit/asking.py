"""Asking a store in SQL without the library, and how its answers are shown."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from tests.pages import opened

Ask = Callable[[str], list[str]]


def shown(value: object) -> str:
    """Show a value the same whichever database it comes from."""
    if value is None:
        return "NULL"
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat(timespec="microseconds")[:26] + "Z"
    return str(int(value)) if isinstance(value, bool) else str(value)


def ask(url: str, sql: str) -> list[str]:
    """Run a query, and show each of its rows on a line."""
    return [" | ".join(map(shown, row)) for row in rows_of(url, sql)]


def rows_of(url: str, sql: str) -> list[tuple[Any, ...]]:
    """Run a query."""
    with opened(url) as store:
        return store.execute(sql, {})
