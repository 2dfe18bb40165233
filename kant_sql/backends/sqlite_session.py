"""Sessions on SQLite, and the SQL that differs there."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING, Any

from sqlalchemy.ext.compiler import compiles

from ..canonical import time_text
from ..tables.types import text_time
from .cursor import Row
from .query import InList, InRows, Query, StoreClock, StorePlace
from .session import FETCH_SIZE, Session, log_statement

if TYPE_CHECKING:
    from .sqlite import SqliteBackend


@compiles(InList, "sqlite")
def _in_list(element: InList, compiler: Any, **options: Any) -> str:
    column, values = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} IN (SELECT value FROM json_each({values}))"


@compiles(InRows, "sqlite")
def _in_rows(element: InRows, compiler: Any, **options: Any) -> str:
    column, rows = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} IN {rows}"


@compiles(StoreClock, "sqlite")
def _store_clock(element: StoreClock, compiler: Any, **options: Any) -> str:
    return "NULL"


@compiles(StorePlace, "sqlite")
def _store_place(element: StorePlace, compiler: Any, **options: Any) -> str:
    return "(SELECT file FROM pragma_database_list WHERE name = 'main')"


class SqliteSession(Session):
    """A session on SQLite."""

    placeholder = "?"

    def in_transaction(self) -> bool:
        """Tell whether a transaction is open."""
        connection: Any = self._pooled.driver_connection
        return bool(connection is not None and connection.in_transaction)

    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Give a query's rows one after the other, by a cursor of their own."""
        sql = query.text(self.backend.dialect)
        cursor: Any = self._cursor if self.is_abandoned else self._pooled.cursor()
        started = time.perf_counter()
        try:
            cursor.execute(sql, parameters)
            log_statement(sql, started)
            while rows := cursor.fetchmany(FETCH_SIZE):
                yield from rows
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error
        finally:
            # After Ctrl-C this may be given up when the connection is closed already.
            with suppress(*self.backend.driver_errors):
                cursor.close()

    def replan(self) -> None:
        """Do nothing: there are no plans but those of a statement that is run."""

    def lock_definitions(self) -> None:
        """Wait for nobody: who writes is alone already."""

    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Give the form that `json_each` reads."""
        return json.dumps(values, ensure_ascii=False)

    def from_time(self, moment: datetime) -> Any:
        """Give the text that is stored."""
        return time_text(moment)

    def to_time(self, raw: Any) -> datetime:
        """Read the text that is stored."""
        return text_time(raw)


class FileSession(SqliteSession):
    """A session on a file. It is kept for the next call: a turn through the pool takes longer."""

    def __init__(self, backend: SqliteBackend, connection: Any) -> None:
        super().__init__(backend, connection)
        self._keep = backend.keep
        self._file = backend.file

    def begin(self, write: bool) -> None:
        """Begin a transaction; before a write, look at the log."""
        if write:
            self._file.check_log()
        super().begin(write)

    def _commit(self, changed: int | None) -> None:
        super()._commit(changed)
        self._file.check_committed()

    def close(self) -> None:
        """Wait for the next call, or give the connection back to the pool."""
        if self._file.is_long and self.is_current and not self.in_transaction():
            connection: Any = self._pooled.driver_connection
            self._file.shorten(connection)
        if not self._keep(self):
            super().close()


class Turns:
    """A lock that its thread may take again, and that any thread may give back.

    A `with` block may be left in another thread than it was entered in; an `RLock` would then stay
    locked for ever.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._thread: int | None = None
        self._depth = 0

    def begin(self, seconds: float) -> bool:
        """Wait for a turn, some seconds at most; tell whether it is this thread's turn."""
        here = threading.get_ident()
        if self._thread != here:
            if not self._lock.acquire(timeout=seconds):
                return False
            self._thread = here
        self._depth += 1
        return True

    def end(self) -> None:
        """End a turn, whichever thread began it."""
        self._depth -= 1
        if not self._depth:
            self._thread = None
            self._lock.release()


class MemorySession(SqliteSession):
    """A session on the one connection that an in-memory store has; threads take turns on it.

    A thread that reads the past while it has a transaction open reads within it: what it has not
    committed belongs to a revision that no past read sees.
    """

    def __init__(self, backend: SqliteBackend, connection: Any) -> None:
        super().__init__(backend, connection)
        self._turns = backend.turns
        self._commits = backend.commits
        self._is_nested = self.in_transaction()

    def begin(self, write: bool) -> None:
        """Begin a transaction, unless this thread is in one."""
        if not self._is_nested:
            super().begin(write)

    def _commit(self, changed: int | None) -> None:
        super()._commit(changed)
        self._commits.tell()

    def rollback(self) -> None:
        """Roll back, unless the transaction is another session's of this thread."""
        if not self._is_nested:
            super().rollback()

    def close(self) -> None:
        """Let the next thread have the connection."""
        super().close()
        self._turns.end()
