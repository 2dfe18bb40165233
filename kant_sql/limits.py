"""Limits of questions: the time of a statement, and cancelling it from another thread.

A context variable keeps the limit, so that it reaches the calls of `kant_sql.aio` and
`asyncio.to_thread`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from .arguments import expect
from .arguments import seconds as seconds_of
from .errors import InvalidArgumentError, QuestionCancelledError

__all__ = ["Limit", "limited"]

# Seconds that a call waits for another writer, unless the URL sets them.
PATIENCE = 20.0
# Seconds until another request to cancel: a server ignores one that arrives before the statement.
STOP_AGAIN = 0.05
# The maximum wait of `cancel`, in seconds.
CANCEL_WITHIN = 5.0


class Limit:
    """The limit of the questions in a `limited` block. Threads may share it.

    Attributes:
        seconds: the maximum time of each statement; infinite without a limit.
    """

    def __init__(self, seconds: float | None = None, *, outer: Limit | None = None) -> None:
        """Create a limit; `limited` applies it to the questions of a block.

        Args:
            seconds: how long each statement may take; None for as long as it takes.
            outer: the limit of the outer block, which also applies.
        """
        self.seconds: float = seconds_of(seconds)
        # The limits that apply, this one first, and the sessions under this one.
        self._all: tuple[Limit, ...] = (self,)
        self._obeying: set[StatementGuard] = set()
        self._changed = threading.Condition()
        self._is_cancelled = False
        if outer is not None:
            expect(outer, Limit, "the outer limit", InvalidArgumentError)
            self.seconds = min(self.seconds, outer.seconds)
            self._all, self._changed = (self, *outer._all), outer._changed

    @property
    def is_cancelled(self) -> bool:
        """Whether this limit or an outer one was cancelled."""
        return any(each._is_cancelled for each in self._all)

    def cancel(self) -> None:
        """End the running questions of the block, and refuse further ones; from any thread.

        They raise `QuestionCancelledError`. The call returns when no statement of the block is
        running, or after some seconds. It may open a connection to the server, so call it in a
        thread from an event loop.
        """
        deadline, pause = time.monotonic() + CANCEL_WITHIN, STOP_AGAIN
        with self._changed:
            self._is_cancelled = True
            while (running := self._running()) and time.monotonic() < deadline:
                # Under the lock: a question that ends now keeps its connection for a moment, so the
                # next one gets it undisturbed.
                for question in running:
                    # A server that does not answer makes each request wait.
                    if time.monotonic() < deadline:
                        question.stop()
                self._changed.wait_for(lambda: not self._running(), pause)
                pause *= 2

    def _running(self) -> list[StatementGuard]:
        return [question for question in self._obeying if question.is_running]

    def check(self) -> None:
        """Raise if the limit was cancelled, for work between statements.

        Raises:
            QuestionCancelledError: the limit was cancelled.
        """
        if self.is_cancelled:
            raise QuestionCancelledError(
                "this question was cancelled by Limit.cancel(), and reads nothing any more; ask in "
                "another block of kant_sql.limited()"
            )


class StatementGuard:
    """The statements of one session while it obeys a limit: a `with` block around each.

    `is_running`: a statement is on its way or running; `was_stopped`: the database was asked to end
    one.
    """

    __slots__ = ("_changed", "_deadline", "_stop", "cursor", "is_running", "limit", "was_stopped")

    def __init__(self, limit: Limit, cursor: Any, stop: Callable[[], None]) -> None:
        self.limit = limit
        self.cursor = cursor
        self.is_running = self.was_stopped = False
        self._changed = limit._changed
        self._stop = stop
        self._deadline = 0.0

    def join(self) -> None:
        """Apply the limit from now on."""
        with self._changed:
            for each in self.limit._all:
                each._obeying.add(self)

    def leave(self) -> None:
        """End the limit; after this returns, nothing is stopped."""
        with self._changed:
            self.is_running = False
            for each in self.limit._all:
                each._obeying.discard(self)
            self._changed.notify_all()

    def stop(self) -> None:
        """Ask the database to end the running statement."""
        self.was_stopped = True
        self._stop()

    def is_over(self) -> bool:
        """Return whether the running statement must end; SQLite calls this regularly."""
        return time.monotonic() > self._deadline or self.limit.is_cancelled

    def __enter__(self) -> None:
        with self._changed:
            self.limit.check()
            self.is_running = True
        self._deadline = time.monotonic() + self.limit.seconds

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self.is_running = False
            self._changed.notify_all()


class GuardedCursor:
    """A driver's cursor that runs statements and fetches rows under a limit."""

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
        """Fetch the remaining rows, which SQLite only computes now."""
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


# The limit of this context.
LIMIT: ContextVar[Limit | None] = ContextVar("kant_sql_limit", default=None)


@contextmanager
def limited(seconds: float | None = None) -> Iterator[Limit]:
    """Limit the questions within a `with` block, and allow cancelling them.

    All reads of this context obey it, on any knowledge base, also those that `kant_sql.aio` and
    `asyncio.to_thread` run in other threads. Writes, and reads within an open transaction, do not:
    they hold a lock that others wait for. A nested block obeys both limits.

    Args:
        seconds: the maximum time of each statement in the database; None for no limit.

    Yields:
        The limit, whose `cancel` may be called from any thread.

    Raises:
        StatementTimeoutError: a statement of a call in the block took too long.
        QuestionCancelledError: the limit was cancelled during a call in the block.
        InvalidTimeoutError: `seconds` is not a number of seconds.

    Examples:
        >>> with limited(seconds=5):
        ...     kb.holds("(robot_at rb1 wp1)")
        True
        >>> with limited() as limit:
        ...     limit.cancel()  # Another thread does, as a rule.
        ...     kb.propositions.get_all()
        Traceback (most recent call last):
            ...
        kant_sql.errors.QuestionCancelledError: this question was cancelled by Limit.cancel(), ...
    """
    limit = Limit(seconds, outer=LIMIT.get())
    with obeying(limit):
        yield limit


@contextmanager
def obeying(limit: Limit) -> Iterator[None]:
    """Apply an existing limit to the questions within a `with` block."""
    token = LIMIT.set(limit)
    try:
        yield
    finally:
        LIMIT.reset(token)
