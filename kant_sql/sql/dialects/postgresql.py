"""PostgreSQL, by psycopg 3.

A writer notifies after its commit: NOTIFY within the transaction takes a lock of the whole database
until the commit is on disk, so that writers of different knowledge bases wait for each other.
"""

from __future__ import annotations

import itertools
import logging
import re
import selectors
import threading
import time
from collections.abc import Collection, Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from typing import Any
from urllib.parse import quote, quote_plus

from sqlalchemy import (
    Connection,
    CursorResult,
    Dialect,
    Engine,
    String,
    bindparam,
    create_engine,
    event,
    literal_column,
    select,
)
from sqlalchemy.dialects.postgresql.base import PGDialect
from sqlalchemy.exc import DBAPIError, DisconnectionError
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.pool import NullPool, QueuePool

from ...errors import (
    AuthenticationError,
    ConnectionLostError,
    InvalidUrlError,
    ReadOnlyStoreError,
    StatementTimeoutError,
    StoreBusyError,
    StoreError,
    StoreIntegrityError,
    StoreUnreachableError,
    TableMissingError,
)
from ...limits import Limit
from ..query import IdsQuery, InList, InRows, Insert, Query, RowsOfIds, StoreClock, StorePlace
from .base import (
    FETCH_SIZE,
    Backend,
    Listener,
    Roles,
    Row,
    Session,
    log_statement,
    refuse_unknown_options,
)
from .guard import StatementGuard
from .postgresql_roles import holders, lock_schema, make_roles, roles_set_aside
from .postgresql_structure import PostgresqlViews, describe, index_faults
from .structure import IndexFault, Statement
from .words import POSTGRESQL_WORDS

logger = logging.getLogger("kant_sql.postgresql")

# Seconds between polls where LISTEN is not possible.
POLL_PAUSE = 0.1
# SQLSTATE "read-only": LISTEN is not possible on a standby server.
_STANDBY = "25006"
# It has no file descriptor that the child of a fork would keep open.
_Selector: type[selectors.BaseSelector] = getattr(
    selectors, "PollSelector", selectors.SelectSelector
)


def channel(kb_id: int) -> str:
    """Return the notification channel of a knowledge base."""
    return f"kant_sql_{kb_id:d}"


class PostgresqlListener(Listener):
    """Listens to the channel of one knowledge base on a connection of its own."""

    def __init__(self, backend: PostgresqlBackend) -> None:
        self._backend = backend
        self._pooled: Any = None
        self._pool: Any = None
        self._is_deaf = False

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a notification; the first call begins to listen."""
        if kb_id is None or self._is_deaf:
            # There is no channel yet, or LISTEN is not possible.
            time.sleep(min(POLL_PAUSE, seconds))
            return
        try:
            if self._pooled is None:
                self._listen(kb_id)
            else:
                self._hear(self._pooled.driver_connection, seconds)
        except self._backend.driver_errors as error:
            self._drop()
            self._is_deaf = getattr(error, "sqlstate", None) == _STANDBY
            if self._is_deaf:
                logger.warning(
                    "%s: LISTEN is not possible on a standby; polling every %g s",
                    self._backend.label,
                    POLL_PAUSE,
                )
            else:
                raise self._backend.translate(error) from error

    def _listen(self, kb_id: int) -> None:
        engine = self._backend.listening
        self._pool, self._pooled = engine.pool, self._backend.take(engine)
        self._pooled.driver_connection.execute(f"LISTEN {channel(kb_id)}")

    def _hear(self, connection: Any, seconds: float) -> None:
        # The driver's own wait restarts with each signal to the process, and may never end.
        with _Selector() as selector:
            selector.register(connection, selectors.EVENT_READ)
            if selector.select(seconds):
                for _ in connection.notifies(timeout=0):
                    pass

    def _drop(self) -> None:
        pooled, self._pooled = self._pooled, None
        if pooled is not None:
            pooled.invalidate()

    def close(self) -> None:
        """Stop listening, and keep the connection for the next listener."""
        if self._pooled is None:
            return
        if self._pool is not self._backend.listening.pool:
            self._drop()  # The pool was closed while this was in use.
            return
        try:
            # Otherwise the server queues notifications for it.
            self._pooled.driver_connection.execute("UNLISTEN *")
        except self._backend.driver_errors:
            self._drop()
        else:
            self._pooled.close()


COPY_FROM_ROWS = 50
LIST_FROM_IDS = 10
REPLAN_FROM_ROWS = 2_500
# Several cursors may be open at once.
_STREAMS = itertools.count(1)

_work = threading.local()


class _ReportedAlready(logging.Filter):
    """Suppresses psycopg's warning of an error that follows the one it raises.

    When the connection breaks within a pipeline (`executemany`) or a COPY, psycopg raises the
    first error and logs the next, which says nothing new.
    """

    def filter(self, record: logging.LogRecord) -> bool:
        """Pass all other records, and those of other users of psycopg."""
        doubled = getattr(_work, "is_ours", False) and str(record.msg).startswith("error ignored")
        if doubled:
            logger.debug("psycopg: %s", " ".join(record.getMessage().split()))
        return not doubled


logging.getLogger("psycopg").addFilter(_ReportedAlready())


@contextmanager
def _one_report() -> Iterator[None]:
    """Suppress the log of an error that the block raises."""
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
    """Load times beyond Python's datetime as text: the driver would refuse the whole result."""
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


@cache
def _unnest_text(into: Insert) -> str:
    """Write the statement that inserts many rows, one list for each column."""
    dialect: Dialect = PGDialect()  # type: ignore[no-untyped-call]
    types = [column.type.dialect_impl(dialect) for column in into.columns]
    # A text is compiled with its collation, which no array has.
    names = ["text" if isinstance(type_, String) else type_.compile(dialect) for type_ in types]
    lists = ", ".join(f"%s::{name}[]" for name in names)
    return f"INSERT INTO {into.into} SELECT * FROM unnest({lists})"


class PostgresqlSession(Session):
    """A session on PostgreSQL."""

    placeholder = "%s"

    def obey(self, limit: Limit | None) -> None:
        """Let the server end what takes too long: the connection keeps how long that is."""
        allowed = None if limit is None else _milliseconds(limit.seconds)
        info = self._pooled.info
        if info.get(_TIMEOUT) != allowed:
            # Before the statement: if it fails, its outcome is unknown.
            info[_TIMEOUT] = _UNKNOWN
            value = "DEFAULT" if allowed is None else str(allowed)
            self._execute(f"SET statement_timeout = {value}")
            info[_TIMEOUT] = allowed
        super().obey(limit)

    def _end_limit(self) -> StatementGuard | None:
        guard = super()._end_limit()
        if guard is not None and guard.was_stopped and not self.is_abandoned:
            # The request may still be on its way, and would end the next statement, whosever.
            connection: Any = self._pooled.driver_connection
            connection.close()
        return guard

    def _stop(self) -> None:
        connection: Any = self._pooled.driver_connection
        with suppress(*self.backend.driver_errors):
            connection.cancel_safe(timeout=CANCEL_TIMEOUT)

    def insert(self, into: Insert, rows: Sequence[Row]) -> None:
        """Insert rows: many of them by COPY."""
        if len(rows) < COPY_FROM_ROWS:
            super().insert(into, rows)
            return
        if len(rows) >= REPLAN_FROM_ROWS:
            self.replan()
        if self._is_limited():
            self._execute(_unnest_text(into), [list(values) for values in zip(*rows, strict=True)])
            return
        sql = f"COPY {into.into} FROM STDIN"
        cursor: Any = self._cursor
        started = time.perf_counter()
        try:
            with _one_report(), cursor.copy(sql) as copy:
                for row in rows:
                    copy.write_row(row)
        except self.backend.driver_errors as error:
            raise self.translate(error) from error
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
        """Discard cached plans.

        The server plans a foreign key's check once per connection; the plan for a small table may
        scan a large one for each row.
        """
        self._execute("DISCARD PLANS")

    def _is_limited(self) -> bool:
        """Return whether row policies bind this user: the server then refuses COPY."""
        limited = self._pooled.info.get("is_limited")
        if limited is None:
            self._execute("SELECT row_security_active('revision')")
            limited = self._pooled.info["is_limited"] = self._fetch()[0][0]
        return bool(limited)

    def lock_definitions(self) -> None:
        """Take the lock of all schema changes of this database."""

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
            # Whether COMMIT or NOTIFY failed is unknown.
            raise ConnectionLostError(
                f"{self.backend.label}: COMMIT was answered by an error ({error}); nothing of the "
                "open transaction was written, try again"
            ) from error

    def in_transaction(self) -> bool:
        """Return whether a transaction is open on a live connection."""
        connection: Any = self._pooled.driver_connection
        if connection is None or connection.closed:
            return False
        return int(connection.info.transaction_status) != 0

    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Yield a query's rows from a server-side cursor."""
        connection: Any = self._pooled.driver_connection
        sql = query.text(self.backend.dialect)
        started = time.perf_counter()
        try:
            with connection.cursor(name=f"kant_sql_stream_{next(_STREAMS)}") as cursor:
                source = self._guarded(cursor)
                source.execute(sql, parameters)
                log_statement(sql, started)
                is_over = False
                while not is_over:
                    rows = source.fetchmany(FETCH_SIZE)
                    yield from rows
                    is_over = len(rows) < FETCH_SIZE
        except self.backend.driver_errors as error:
            raise self.translate(error) from error

    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Return the form that `= ANY` reads."""
        return [*values]

    def from_time(self, moment: datetime, text: str | None = None) -> Any:
        """Return the time: the driver takes it as it is."""
        return moment

    def to_time(self, raw: Any) -> datetime:
        """Return the time in UTC, whatever the connection's zone."""
        if not isinstance(raw, datetime):
            raise ValueError(f"{raw!r} is no time of the years 1 to 9999")
        return raw.astimezone(UTC)

    def describe(self, names: Collection[str]) -> Iterator[Statement]:
        """Describe some tables and views as they are, and what belongs to them."""
        return describe(self.rows_of, names)

    def index_faults(self, tables: Sequence[str]) -> Iterator[IndexFault]:
        """Compare the indexes of some tables with the tables."""
        return index_faults(self, tables)

    def close(self) -> None:
        """Return the connection to the pool, unless it is broken."""
        if self._guard is not None:
            # First: this closes a connection whose statement was stopped.
            self._end_limit()
        connection: Any = self._pooled.driver_connection
        if connection is not None and connection.closed:
            if connection.broken and not self.is_abandoned:
                logger.warning("%s: a connection was lost", self.backend.label)
            self.backend.sessions.pop(self, None)
            self._pooled.invalidate()
        else:
            super().close()


LOCK_TIMEOUT = "20s"
# Seconds until a request to cancel a statement is given up.
CANCEL_TIMEOUT = 2.0
# What a connection's record calls its timeout, and its value when a change may have failed.
_TIMEOUT, _UNKNOWN = "statement_timeout", -1
# The server counts milliseconds in 31 bits.
_LONGEST_TIMEOUT = 2**31 - 1
CONNECT_TIMEOUT = "10"
POOL_SIZE, MAX_CONNECTIONS = 8, 64
# SQLSTATE: lock timeout, deadlock, table created or dropped meanwhile.
_IN_THE_WAY = frozenset({"55P03", "40P01", "23505", "42P07"})
_REFUSED = re.compile('authentication failed|no password|role ".*" (does not|is not)|pg_hba.conf')


def _milliseconds(seconds: float) -> int | None:
    """Convert a limit; None where there is none. Zero would mean none to the server."""
    milliseconds = max(1.0, seconds * 1e3)
    return None if milliseconds > _LONGEST_TIMEOUT else round(milliseconds)


class PostgresqlBackend(Backend):
    """A PostgreSQL database.

    Attributes:
        listening: the engine of listeners' connections.
    """

    listening: Engine
    begin_read = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"
    begin_write = "BEGIN ISOLATION LEVEL READ COMMITTED"
    durable = (
        "SELECT set_config('synchronous_commit', 'on', false) "
        "WHERE current_setting('synchronous_commit') = 'off'"
    )
    # Row policies let a writer change only versions without it.
    revision_comes_last = True
    views = PostgresqlViews()
    words = POSTGRESQL_WORDS
    _lost_at = 0.0

    def create_engine(self) -> Engine:
        """Create the engines; sessions control transactions."""
        # Listeners must not exhaust the pool of sessions.
        self.listening = self._create_pool(1, -1)
        return self._create_pool(POOL_SIZE, MAX_CONNECTIONS - POOL_SIZE)

    def _create_pool(self, size: int, overflow: int) -> Engine:
        engine = self._engine(
            poolclass=QueuePool,
            pool_reset_on_return=None,
            pool_size=size,
            max_overflow=overflow,
            # As in `create_pool_from_url`: without the five statements of SQLAlchemy's first
            # connection, which only reflection and literals need.
            _initialize=False,
        )

        @event.listens_for(engine, "connect")
        def configure(connection: Any, record: Any) -> None:
            record.info["made_at"] = time.monotonic()
            connection.autocommit = True
            connection.execute(f"SET lock_timeout = '{LOCK_TIMEOUT}'")
            if self.is_read_only:
                connection.execute("SET default_transaction_read_only = on")
            read_all_times(connection)

        @event.listens_for(engine, "checkout")
        def refuse_old(_: object, record: Any, __: object) -> None:
            if record.info["made_at"] <= self._lost_at:
                raise DisconnectionError  # The pool makes a new one instead.

        return engine

    def close(self) -> None:
        """Close all connections."""
        super().close()
        self.listening.dispose()

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child."""
        super().leave_connections()
        self.listening.dispose(close=False)

    def listener(self) -> Listener:
        """Create a listener."""
        return PostgresqlListener(self)

    def renew(self) -> None:
        """Replace existing connections at their next checkout."""
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
        """Wrap a connection of the pool."""
        self.has_answered = True
        return PostgresqlSession(self, connection)

    def queue(self, knowledge_base: str) -> Hashable:
        """Identify the row of the head."""
        url = self.url
        hosts = tuple(str(url.query.get(key, "")) for key in ("host", "port", "dbname"))
        return (url.host, url.port, url.database, hosts, knowledge_base)

    def write_lock(self) -> threading.Lock | None:
        """Return None: the server queues writers on the head's row."""
        return None

    def is_empty(self, session: Session) -> bool:
        """Return False: on a server, nothing is created unasked."""
        return False

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Open a connection that holds the lock of all schema changes of this database."""
        engine = self._engine(poolclass=NullPool)
        try:
            with engine.connect() as connection, connection.begin():
                lock_schema(lambda sql: _says_true(connection.exec_driver_sql(sql)))
                yield connection
        except DBAPIError as error:
            if getattr(error.orig, "sqlstate", None) not in _IN_THE_WAY:
                raise
            raise self._is_in_the_way(engine) from error
        except self.driver_errors as error:
            raise self.translate_connect(error) from error
        finally:
            engine.dispose()

    def _is_in_the_way(self, engine: Engine) -> StoreBusyError:
        """Build the error for a locked table or a concurrent schema change."""
        with engine.connect() as connection:
            who = holders(connection)
        remedy = (
            f"tables are in use by {who}; try again when that has ended, or end it with "
            "SELECT pg_terminate_backend(PROCESS)"
            if who
            else "another process changes tables or views just now; try again"
        )
        return StoreBusyError(f"{self.label}: nothing was changed: {remedy}")

    def create_roles(self, knowledge_base: str | None, dry_run: bool) -> Roles:
        """Create the roles by grants and row policies, or update them."""
        try:
            with self.migration_connection() as connection:
                return make_roles(connection, knowledge_base, dry_run)
        except DBAPIError as error:
            original = error.orig if isinstance(error.orig, Exception) else error
            if getattr(original, "sqlstate", None) == "42501":
                raise StoreError(
                    f"{self.label}: {self._text(original)}; connect as the owner of the tables, "
                    "with the right to create roles (ALTER ROLE ... CREATEROLE), and for --kb "
                    "schemas (GRANT CREATE ON DATABASE ...)"
                ) from error
            raise self.translate_connect(original) from error

    @staticmethod
    def roles_set_aside(connection: Connection) -> AbstractContextManager[None]:
        """Drop policies and auditors' own views for the length of a migration."""
        return roles_set_aside(connection)

    def translate(self, error: Exception) -> StoreError:
        """Translate an error of psycopg by its SQLSTATE."""
        state = getattr(error, "sqlstate", None) or ""
        text = self._text(error)
        if state in ("40001", "40P01", "55P03", "55006"):
            return StoreBusyError(
                f"{self.label}: another writer held the knowledge base for too long ({text}); "
                "nothing was written, try again"
            )
        if state == "57014":
            return StatementTimeoutError(
                f"{self.label}: the server ended the statement ({text}): it took longer than "
                "statement_timeout allows, or somebody cancelled it; nothing of the open "
                "transaction was written"
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
        """Translate a failure to connect."""
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
        secrets: list[object] = [self.url.password]
        for key, value in self.url.query.items():
            if "pass" in key.lower():
                secrets += [value] if isinstance(value, str) else value
        for secret in map(str, filter(None, secrets)):
            for form in (secret, quote(secret), quote(secret, safe=""), quote_plus(secret)):
                text = text.replace(form, "***")
        return text


def _says_true(result: CursorResult[Any]) -> bool:
    return result.returns_rows and bool(result.scalar())
