"""PostgreSQL, by psycopg 3."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, Engine, Table, create_engine, event
from sqlalchemy.exc import DisconnectionError
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.pool import NullPool, QueuePool

from ..errors import (
    AuthenticationError,
    ConnectionLostError,
    InvalidUrlError,
    ReadOnlyStoreError,
    StoreBusyError,
    StoreError,
    StoreIntegrityError,
    StoreUnreachableError,
    TableMissingError,
)
from .backend import Backend, refuse_unknown_options
from .query import InList, InRows, Query, StoreClock
from .session import FETCH_SIZE, Row, Session, logger

COPY_FROM_ROWS = 50
REPLAN_FROM_ROWS = 2_500
LOCK_TIMEOUT = "20s"
CONNECT_TIMEOUT = "10"
# One advisory lock for all who migrate one database: the ASCII codes of "kant_sql".
MIGRATION_LOCK = 0x6B616E745F73716C
MAX_CONNECTIONS = 64
_REFUSED = re.compile('authentication failed|no password|role ".*" (does not|is not)|pg_hba.conf')


@compiles(InList, "postgresql")
def _in_list(element: InList, compiler: Any, **options: Any) -> str:
    column, values = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} = ANY({values})"


@compiles(InRows, "postgresql")
def _in_rows(element: InRows, compiler: Any, **options: Any) -> str:
    column, rows = (compiler.process(clause, **options) for clause in element.clauses)
    return f"{column} = ANY(ARRAY{rows})"


@compiles(StoreClock, "postgresql")
def _store_clock(element: StoreClock, compiler: Any, **options: Any) -> str:
    return "clock_timestamp()"


class PostgresqlSession(Session):
    """A session on PostgreSQL."""

    placeholder = "%s"

    def insert(self, table: Table, rows: Sequence[Row]) -> None:
        """Insert whole rows: many of them by COPY."""
        if len(rows) < COPY_FROM_ROWS:
            super().insert(table, rows)
            return
        if len(rows) >= REPLAN_FROM_ROWS:
            # The server plans the check of a foreign key once for each connection: what was right
            # for a small table may read all of a large one, for each row.
            self._execute("DISCARD PLANS")
        columns = ", ".join(column.name for column in table.columns)
        sql = f"COPY {table.name} ({columns}) FROM STDIN"
        logger.debug("%s", sql)
        cursor: Any = self._cursor
        try:
            with cursor.copy(sql) as copy:
                for row in rows:
                    copy.write_row(row)
        except self.backend.driver_errors as error:
            raise self.backend.translate(error) from error

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
        logger.debug("%s", sql)
        try:
            with connection.cursor(name="kant_sql_stream") as cursor:
                cursor.itersize = FETCH_SIZE
                cursor.execute(sql, parameters)
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
        moment: datetime = raw
        return moment.astimezone(UTC)

    def close(self) -> None:
        """Give the connection back, unless it is broken."""
        connection: Any = self._pooled.driver_connection
        if connection is not None and connection.closed:
            self.backend.sessions.pop(self, None)
            self._pooled.invalidate()
        else:
            super().close()


class PostgresqlBackend(Backend):
    """A PostgreSQL database."""

    begin_read = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"
    begin_write = "BEGIN ISOLATION LEVEL READ COMMITTED"
    _lost_at = 0.0

    def create_engine(self) -> Engine:
        """Make the engine; its connections leave transactions to us."""
        engine = self._engine(
            poolclass=QueuePool,
            pool_reset_on_return=None,
            pool_size=8,
            max_overflow=MAX_CONNECTIONS - 8,
            # As in `create_pool_from_url`: SQLAlchemy would greet the server with five statements
            # whose answers only reflection and literals need, and a migration has its own engine.
            _initialize=False,
        )

        @event.listens_for(engine, "connect")
        def configure(connection: Any, record: Any) -> None:
            record.info["made_at"] = time.monotonic()
            connection.autocommit = True
            connection.execute(f"SET lock_timeout = '{LOCK_TIMEOUT}'")

        @event.listens_for(engine, "checkout")
        def refuse_old(_: object, record: Any, __: object) -> None:
            if record.info["made_at"] <= self._lost_at:
                raise DisconnectionError  # The pool makes a new one instead.

        return engine

    def renew(self) -> None:
        """Make connections anew that were made before now."""
        self._lost_at = time.monotonic()

    def _engine(self, **options: Any) -> Engine:
        url = self.url.set(drivername="postgresql+psycopg")
        if "connect_timeout" not in url.query:
            url = url.update_query_dict({"connect_timeout": CONNECT_TIMEOUT})
        try:
            from psycopg import pq

            known = {option.keyword.decode() for option in pq.Conninfo.get_defaults()}
            refuse_unknown_options(self.url, known)
            return create_engine(url, **options)
        except ImportError as error:
            raise InvalidUrlError(
                f"{self.label}: PostgreSQL needs the psycopg driver; "
                "install it with: pip install 'kant-sql[postgres]'"
            ) from error

    def wrap(self, connection: Any) -> Session:
        """Make a session."""
        self.has_answered = True
        return PostgresqlSession(self, connection)

    def write_lock(self) -> threading.Lock | None:
        """Give none: the server queues writers on the head's row."""
        return None

    def is_empty(self, session: Session) -> bool:
        """Say no: on a server nothing is created without being asked for."""
        return False

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Give a connection that holds the lock of all who migrate this database.

        Yields:
            The connection, in a transaction.
        """
        engine = self._engine(poolclass=NullPool)
        try:
            with engine.connect() as connection, connection.begin():
                connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({MIGRATION_LOCK})")
                yield connection
        except self.driver_errors as error:
            raise self.translate_connect(error) from error
        finally:
            engine.dispose()

    def translate(self, error: Exception) -> StoreError:
        """Make an error of this library from one of psycopg, by its SQLSTATE."""
        state = getattr(error, "sqlstate", None) or ""
        text = self._text(error)
        if state in ("40001", "40P01", "55P03", "55006"):
            return StoreBusyError(
                f"{self.label}: another writer held the knowledge base for too long ({text}); "
                "nothing was written, try again"
            )
        if state in ("42501", "25006"):
            return ReadOnlyStoreError(f"{self.label}: {text}; ask for the right, or only read")
        if state == "42P01":
            return TableMissingError(f"{self.label}: {text}")
        if state.startswith("23"):
            return StoreIntegrityError(f"{self.label}: {text}; nothing was written")
        if state.startswith(("57P", "08", "25P03", "25P04")) or (
            not state and isinstance(error, self.engine.dialect.loaded_dbapi.OperationalError)
        ):
            return ConnectionLostError(
                f"{self.label}: the connection was lost ({text}); nothing of the open transaction "
                "was written, try again"
            )
        return StoreError(f"{self.label}: {type(error).__name__}: {text}")

    def translate_connect(self, error: Exception) -> StoreError:
        """Make an error of this library from a failure to connect."""
        original = getattr(error, "orig", None) or error
        state, text = getattr(original, "sqlstate", None) or "", self._text(original)
        # The driver gives no SQLSTATE here.
        if state.startswith("28") or _REFUSED.search(text):
            return AuthenticationError(
                f"{self.label}: the server refused the user or the password ({text}); "
                "check both in the URL"
            )
        if not state and isinstance(original, self.engine.dialect.loaded_dbapi.OperationalError):
            return StoreUnreachableError(
                f"{self.label}: no connection ({text}); check that the server runs, and host, "
                "port and database in the URL"
            )
        return self.translate(original)

    def _text(self, error: Exception) -> str:
        text = " ".join(str(error).split())
        for password in (self.url.password, self.url.query.get("password")):
            if password:
                text = text.replace(str(password), "***")
        return text
