"""Sessions on PostgreSQL, and the SQL that differs there."""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Table, bindparam, literal_column, select
from sqlalchemy.ext.compiler import compiles

from ..errors import ConnectionLostError, StoreError, StoreIntegrityError
from .cursor import Row
from .postgresql_locks import lock_schema
from .postgresql_waiting import channel
from .query import IdsQuery, InList, InRows, Query, RowsOfIds, StoreClock, StorePlace, unnest_text
from .session import FETCH_SIZE, Session, log_statement

COPY_FROM_ROWS = 50
LIST_FROM_IDS = 10
REPLAN_FROM_ROWS = 2_500
# Several may be read at once.
_STREAMS = itertools.count(1)

logger = logging.getLogger("kant_sql.postgresql")
_work = threading.local()


class _ReportedAlready(logging.Filter):
    """Keeps psycopg from warning of an error while it raises the one that came before.

    When the connection breaks within a pipeline, as `executemany` opens one, or within a COPY,
    psycopg raises the error and logs what fails after it. We raise the first; the second says
    nothing new.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        """Let all else through, and whatever is logged while others use psycopg."""
        doubled = getattr(_work, "is_ours", False) and str(record.msg).startswith("error ignored")
        if doubled:
            logger.debug("psycopg: %s", " ".join(record.getMessage().split()))
        return not doubled


logging.getLogger("psycopg").addFilter(_ReportedAlready())


@contextmanager
def _one_report() -> Iterator[None]:
    """Hear of an error of the block only by what is raised."""
    _work.is_ours = True
    try:
        yield
    finally:
        _work.is_ours = False


@compiles(InList, "postgresql")
def _in_list(element: InList, compiler: Any, **options: Any) -> str:
    column, values = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} = ANY({values})"


@compiles(InRows, "postgresql")
def _in_rows(element: InRows, compiler: Any, **options: Any) -> str:
    column, rows = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} = ANY(ARRAY{rows})"


@compiles(RowsOfIds, "postgresql")
def _rows_of_ids(element: RowsOfIds, compiler: Any, **options: Any) -> str:
    rows = select(literal_column("found.ctid")).where(*element.conditions).scalar_subquery()
    return (
        f"ctid = ANY(ARRAY(SELECT {compiler.process(rows, **options)} "
        f"FROM unnest({compiler.process(bindparam('ids'), **options)}) AS wanted (id)))"
    )


@compiles(StoreClock, "postgresql")
def _store_clock(element: StoreClock, compiler: Any, **options: Any) -> str:
    return "clock_timestamp()"


@compiles(StorePlace, "postgresql")
def _store_place(element: StorePlace, compiler: Any, **options: Any) -> str:
    return (
        "(SELECT concat_ws(' ', extract(epoch FROM pg_postmaster_start_time()), oid, "
        "current_schema()) "
        "FROM pg_database WHERE datname = current_database())"
    )


def read_all_times(connection: Any) -> None:
    """Let a connection read times that Python has none for, as texts.

    The driver refuses all rows of an answer for one such time, whoever has written it.

    Args:
        connection: the driver's connection.
    """
    from psycopg import DataError, pq
    from psycopg.adapt import Loader

    registry = connection.adapters
    oid = registry.types["timestamptz"].oid
    driver: type[Loader] = registry.get_loader(oid, pq.Format.TEXT)

    class AnyTime(Loader):
        def __init__(self, oid: int, context: Any = None) -> None:
            super().__init__(oid, context)
            self._load = driver(oid, context).load

        def load(self, data: Any) -> Any:
            try:
                return self._load(data)
            except DataError:
                return bytes(data).decode()

    registry.register_loader(oid, AnyTime)


class PostgresqlSession(Session):
    """A session on PostgreSQL."""

    placeholder = "%s"

    def insert(self, table: Table, rows: Sequence[Row]) -> None:
        """Insert whole rows: many of them by COPY."""
        if len(rows) < COPY_FROM_ROWS:
            super().insert(table, rows)
            return
        if len(rows) >= REPLAN_FROM_ROWS:
            self.replan()
        if self._is_limited():
            self._execute(unnest_text(table), [list(values) for values in zip(*rows, strict=True)])
            return
        columns = ", ".join(column.name for column in table.columns)
        sql = f"COPY {table.name} ({columns}) FROM STDIN"
        cursor: Any = self._cursor
        started = time.perf_counter()
        try:
            with _one_report(), cursor.copy(sql) as copy:
                for row in rows:
                    copy.write_row(row)
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error
        finally:
            log_statement(sql, started)

    def _execute_many(self, sql: str, parameters: Sequence[Any]) -> None:
        with _one_report():
            super()._execute_many(sql, parameters)

    def run_for(self, query: IdsQuery, ids: Sequence[int], **parameters: Any) -> None:
        """Run a statement for each of some ids: many of them at once."""
        if len(ids) < LIST_FROM_IDS:
            super().run_for(query, ids, **parameters)
        else:
            self.run(query.listed, ids=self.list_value(ids), **parameters)

    def replan(self) -> None:
        """Let the server plan anew what it checks for each row."""
        # It plans the check of a foreign key once for each connection: what was right for a small
        # table may read all of a large one, for each row.
        self._execute("DISCARD PLANS")

    def _is_limited(self) -> bool:
        """Tell whether row policies bind this user: the server refuses COPY then."""
        limited = self._pooled.info.get("is_limited")
        if limited is None:
            self._execute("SELECT row_security_active('revision')")
            limited = self._pooled.info["is_limited"] = self._fetch()[0][0]
        return bool(limited)

    def lock_definitions(self) -> None:
        """Take the lock of all who change the schema of this database."""

        def run(statement: str) -> bool:
            self._execute(statement)
            cursor: Any = self._cursor
            return cursor.description is not None and bool(self._fetch()[0][0])

        lock_schema(run)

    def _commit(self, changed: int | None) -> None:
        if changed is None:
            super()._commit(None)
            return
        try:
            # In one message, as two statements: the second has a transaction of its own.
            self._execute(f"COMMIT; NOTIFY {channel(changed)}")
        except (ConnectionLostError, StoreIntegrityError):
            raise
        except StoreError as error:
            # That it was the notification that failed cannot be told from here.
            raise ConnectionLostError(
                f"{self.backend.label}: COMMIT was answered by an error ({error}); nothing of the "
                "open transaction was written, try again"
            ) from error

    def in_transaction(self) -> bool:
        """Tell whether a transaction is open on a connection that is alive."""
        connection: Any = self._pooled.driver_connection
        if connection is None or connection.closed:
            return False
        return int(connection.info.transaction_status) != 0

    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Give a query's rows one after the other, by a cursor in the server."""
        connection: Any = self._pooled.driver_connection
        sql = query.text(self.backend.dialect)
        started = time.perf_counter()
        try:
            with connection.cursor(name=f"kant_sql_stream_{next(_STREAMS)}") as cursor:
                cursor.itersize = FETCH_SIZE
                cursor.execute(sql, parameters)
                log_statement(sql, started)
                yield from cursor
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error

    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Give the form that `= ANY` reads."""
        return [*values]

    def from_time(self, moment: datetime) -> Any:
        """Give the moment: the driver takes it as it is."""
        return moment

    def to_time(self, raw: Any) -> datetime:
        """Give the moment in UTC, whatever zone the connection is set to."""
        if not isinstance(raw, datetime):
            raise ValueError(f"{raw!r} is no time of the years 1 to 9999")
        return raw.astimezone(UTC)

    def close(self) -> None:
        """Give the connection back, unless it is broken."""
        connection: Any = self._pooled.driver_connection
        if connection is not None and connection.closed:
            if connection.broken and not self.is_abandoned:
                logger.warning("%s: a connection was lost", self.backend.label)
            self.backend.sessions.pop(self, None)
            self._pooled.invalidate()
        else:
            super().close()
