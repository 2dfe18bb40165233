"""News on SQLite: a file says by its data version that another connection has changed it."""

from __future__ import annotations

import os
import sqlite3
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from .waiting import Listener

if TYPE_CHECKING:
    from .sqlite import SqliteBackend

T = TypeVar("T")

FIRST_PAUSE, LONGEST_PAUSE = 0.001, 0.05

# A fork in the middle of a look would leave the child a connection that it can neither use nor
# close.
_LOOKING = threading.RLock()

if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_LOOKING.acquire,
        after_in_parent=_LOOKING.release,
        after_in_child=_LOOKING.release,
    )


class FileListener(Listener):
    """Looks at a file's data version again and again, on a connection of its own."""

    def __init__(self, backend: SqliteBackend) -> None:
        self._backend = backend
        self._connection: sqlite3.Connection | None = None
        self._version: int | None = None
        self._pause = FIRST_PAUSE

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait until the file is of another version; the first call begins to look."""
        deadline = time.monotonic() + seconds
        seen = self._version
        try:
            self._version = self._version_now()
            while self._version == seen and (left := deadline - time.monotonic()) > 0:
                time.sleep(min(self._pause, left))
                self._pause = min(2 * self._pause, LONGEST_PAUSE)
                self._version = self._version_now()
        except self._backend.driver_errors as error:
            self.close()
            raise self._backend.translate(error) from error

    def look(self, work: Callable[[], T]) -> T:
        """Look at the file; who forks this process waits meanwhile."""
        with _LOOKING:
            return work()

    def _version_now(self) -> int:
        with _LOOKING:
            self._backend.file.check()
            if self._connection is None:
                self._connection = self._backend.connect()
                # So that the child of a fork closes it, too.
                self._backend.connections.add(self._connection)
                self._connection.execute("PRAGMA busy_timeout=0")
            version: int = self._connection.execute("PRAGMA data_version").fetchone()[0]
            return version

    def close(self) -> None:
        """Look no more."""
        connection, self._connection, self._version = self._connection, None, None
        if connection is not None:
            with _LOOKING:
                self._backend.connections.discard(connection)
                connection.close()


class MemoryListener(Listener):
    """Waits until another thread commits to the store in memory."""

    def __init__(self, backend: SqliteBackend) -> None:
        self._commits = backend.commits
        self._seen: int | None = None

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a commit; the first call begins to."""
        self._seen = self._commits.wait(self._seen, seconds)

    def close(self) -> None:
        """Do nothing: there is no connection."""
