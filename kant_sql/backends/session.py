"""A session: one connection of the pool, with transactions and errors under our control."""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from sqlalchemy import PoolProxiedConnection, Table

from ..errors import printable
from .cursor import AbandonedCursor, Cursor, Row
from .query import IdsQuery, Query, insert_text

if TYPE_CHECKING:
    from .backend import Backend

# Every statement is logged here at DEBUG, which is also how the tests count them.
logger = logging.getLogger("kant_sql.sql")

FETCH_SIZE = 5_000
LONGEST_LOGGED = 200


class Session(ABC):
    """A database connection that one thread uses for one transaction at a time.

    Driver errors leave it as errors of `kant_sql.errors`, raised from the driver's.

    Attributes:
        backend: the database.
        is_abandoned: whether the connection is the one of the process that this was forked from.
    """

    placeholder = "?"

    def __init__(self, backend: Backend, connection: PoolProxiedConnection) -> None:
        self.backend = backend
        self._pooled = connection
        self._pool = backend.engine.pool
        self._cursor: Cursor = connection.cursor()  # type: ignore[assignment]
        self._savepoints = 0
        self.is_abandoned = False
        backend.sessions[self] = threading.get_ident()

    def rows(self, query: Query, **parameters: Any) -> list[Row]:
        """Run a query and give all its rows.

        Args:
            query: the query.
            **parameters: the value of each of its parameters.

        Returns:
            The rows, as tuples of the driver's values.
        """
        self._execute(query.text(self.backend.dialect), parameters)
        return self._fetch()

    def first(self, query: Query, **parameters: Any) -> Row | None:
        """Run a query and give its first row.

        Args:
            query: the query.
            **parameters: the value of each of its parameters.

        Returns:
            The row, or None.
        """
        rows = self.rows(query, **parameters)
        return rows[0] if rows else None

    def run(self, query: Query, **parameters: Any) -> int:
        """Run a statement that gives no rows.

        Args:
            query: the statement.
            **parameters: the value of each of its parameters.

        Returns:
            How many rows it changed.
        """
        self._execute(query.text(self.backend.dialect), parameters)
        return self._cursor.rowcount

    def run_many(self, query: Query, parameters: Sequence[dict[str, Any]]) -> int:
        """Run a statement for each set of parameters.

        Args:
            query: the statement.
            parameters: the sets of parameters.

        Returns:
            How many rows were changed in all.
        """
        if len(parameters) == 1:
            return self.run(query, **parameters[0])
        if parameters:
            self._execute_many(query.text(self.backend.dialect), parameters)
            return self._cursor.rowcount
        return 0

    def run_for(self, query: IdsQuery, ids: Sequence[int], **parameters: Any) -> None:
        """Run a statement for each of some ids.

        Args:
            query: the statement.
            ids: the ids.
            **parameters: the value of each of its other parameters.
        """
        self.run_many(query.each, [{"id": id_, **parameters} for id_ in ids])

    def define(self, statement: str) -> None:
        """Run a statement that creates or drops something, given as text.

        Args:
            statement: the SQL.
        """
        self._execute(statement)

    def insert(self, table: Table, rows: Sequence[Row]) -> None:
        """Insert whole rows.

        Args:
            table: the table.
            rows: the values of each row, in the order of the table's columns.
        """
        if len(rows) == 1:
            self._execute(insert_text(table, self.placeholder), rows[0])
        elif rows:
            self._execute_many(insert_text(table, self.placeholder), rows)

    def begin(self, write: bool) -> None:
        """Begin a transaction.

        Args:
            write: whether it will write; a reader sees one snapshot and takes no lock.
        """
        self._execute(self.backend.begin_write if write else self.backend.begin_read)

    def commit(self, changed: int | None = None) -> None:
        """Commit the transaction.

        Args:
            changed: the knowledge base that has a new revision then, for those who wait for it;
                None for none.
        """
        self._commit(changed)

    def _commit(self, changed: int | None) -> None:
        self._execute("COMMIT")

    def rollback(self) -> None:
        """Roll the transaction back; a connection that is gone has done so itself."""
        self._savepoints = 0
        if not self.is_abandoned and self.in_transaction():
            self._execute("ROLLBACK")

    def savepoint(self) -> str:
        """Set a savepoint.

        Returns:
            Its name.
        """
        self._savepoints += 1
        name = f"kant_sql_{self._savepoints}"
        self._execute(f"SAVEPOINT {name}")
        return name

    def rollback_to(self, name: str) -> None:
        """Undo what was done since a savepoint, and forget it.

        Args:
            name: the savepoint's name.
        """
        self._execute(f"ROLLBACK TO SAVEPOINT {name}")
        self.release(name)

    def release(self, name: str) -> None:
        """Forget a savepoint and keep what was done since.

        Args:
            name: the savepoint's name.
        """
        self._execute(f"RELEASE SAVEPOINT {name}")

    @property
    def is_current(self) -> bool:
        """Whether the connection is of the pool that is in use, and of this process."""
        backend = self.backend
        return not (self.is_abandoned or backend.is_closed) and self._pool is backend.engine.pool

    def close(self) -> None:
        """Give the connection back to the pool."""
        self.backend.sessions.pop(self, None)
        if self.is_current or self.is_abandoned:
            self._pooled.close()
        else:
            # The pool was closed while this was in use.
            self._pooled.invalidate()

    def abandon(self) -> None:
        """Use the connection no more: this process was forked from the one that it belongs to."""
        self.is_abandoned = True
        self._cursor = AbandonedCursor()

    def now(self, raw: Any) -> datetime:
        """Read the value of `StoreClock`.

        Args:
            raw: the driver's value.

        Returns:
            The store's time, in UTC.
        """
        return datetime.now(UTC) if raw is None else self.to_time(raw)

    @abstractmethod
    def replan(self) -> None:
        """Let the server plan anew what it checks for each row, before much is written."""

    @abstractmethod
    def lock_definitions(self) -> None:
        """Wait, in a transaction that writes, until nobody else changes tables or views."""

    @abstractmethod
    def in_transaction(self) -> bool:
        """Tell whether a transaction is open."""

    @abstractmethod
    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Run a query and give its rows one after the other, in constant memory.

        Args:
            query: the query.
            **parameters: the value of each of its parameters.

        Returns:
            The rows. Other statements may be run meanwhile, and other streams be read.
        """

    @abstractmethod
    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Give the driver's form of a list parameter, for `in_list`."""

    @abstractmethod
    def from_time(self, moment: datetime) -> Any:
        """Give the driver's form of a moment."""

    @abstractmethod
    def to_time(self, raw: Any) -> datetime:
        """Read the driver's form of a moment, in UTC."""

    def _fetch(self) -> list[Row]:
        try:
            return self._cursor.fetchall()
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error

    def _execute(self, sql: str, parameters: Any = ()) -> None:
        started = time.perf_counter() if logger.isEnabledFor(logging.DEBUG) else None
        try:
            self._cursor.execute(sql, parameters)
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error
        finally:
            if started is not None:
                log_statement(sql, started)

    def _execute_many(self, sql: str, parameters: Sequence[Any]) -> None:
        started = time.perf_counter() if logger.isEnabledFor(logging.DEBUG) else None
        try:
            self._cursor.executemany(sql, parameters)
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error
        finally:
            if started is not None:
                log_statement(sql, started)


def log_statement(sql: str, started: float) -> None:
    """Log a statement, shortened; without its parameters, which are the robot's knowledge.

    Args:
        sql: the statement; the record has all of it as `sql`.
        started: when it began, by `time.perf_counter`.
    """
    if not logger.isEnabledFor(logging.DEBUG):
        return
    took = (time.perf_counter() - started) * 1e3
    text = " ".join(sql.split())
    if len(text) > LONGEST_LOGGED:
        text = f"{text[:LONGEST_LOGGED]}..."
    said = {"sql": sql, "milliseconds": took}
    logger.debug("%s (%.3f ms)", printable(text), took, extra=said)
