"""What makes the statements of a session obey a limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from ...limits import Limit, questions_of


class StatementGuard:
    """The statements of one session while it obeys a limit: a `with` block around each.

    `was_stopped` is whether the database was asked to end one.
    """

    __slots__ = ("_deadline", "_questions", "_stop", "cursor", "is_running", "limit", "was_stopped")

    def __init__(self, limit: Limit, cursor: Any, stop: Callable[[], None]) -> None:
        self.limit = limit
        self.cursor = cursor
        self.is_running = self.was_stopped = False
        self._questions = questions_of(limit)
        self._stop = stop
        self._deadline = 0.0

    def join(self) -> None:
        """Let the statements obey from now on."""
        self._questions.join(self)

    def leave(self) -> None:
        """Let them obey no more; nothing is stopped once this returns."""
        self._questions.leave(self)

    def stop(self) -> None:
        """Ask the database to end the statement that runs."""
        self.was_stopped = True
        self._stop()

    def is_over(self) -> bool:
        """Return whether the statement that runs must end; SQLite asks this from time to time."""
        return time.monotonic() > self._deadline or self.limit.is_cancelled

    def __enter__(self) -> None:
        self._questions.begin(self)
        self._deadline = time.monotonic() + self.limit.seconds

    def __exit__(self, *_: object) -> None:
        self._questions.end(self)


class GuardedCursor:
    """A driver's cursor whose statements, and the fetching of their rows, obey a limit."""

    rowcount: int

    def __init__(self, cursor: Any, guard: StatementGuard) -> None:
        self._cursor = cursor
        self._guard = guard

    def execute(self, sql: str, parameters: Any = (), /) -> Any:
        """Run a statement."""
        with self._guard:
            result = self._cursor.execute(sql, parameters)
        self.rowcount = self._cursor.rowcount
        return result

    def executemany(self, sql: str, parameters: Any, /) -> Any:
        """Run a statement for each set of parameters."""
        with self._guard:
            result = self._cursor.executemany(sql, parameters)
        self.rowcount = self._cursor.rowcount
        return result

    def fetchall(self) -> list[tuple[Any, ...]]:
        """Fetch the remaining rows, which SQLite finds only now."""
        with self._guard:
            rows: list[tuple[Any, ...]] = self._cursor.fetchall()
            return rows

    def fetchmany(self, size: int = 1, /) -> list[tuple[Any, ...]]:
        """Fetch the next rows."""
        with self._guard:
            rows: list[tuple[Any, ...]] = self._cursor.fetchmany(size)
            return rows

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cursor, name)
