"""PostgreSQL, by psycopg 3.

A writer notifies after its commit: NOTIFY within the transaction locks the whole database until the
commit is on disk, so writers of different knowledge bases would wait for each other.
"""

from __future__ import annotations

import itertools
import logging
import re
import threading
import time
from collections.abc import Collection, Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from datetime import UTC, datetime
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, quote_plus

from sqlalchemy import (
    Connection,
    CursorResult,
    Dialect,
    Engine,
    LargeBinary,
    PoolProxiedConnection,
    Select,
    String,
    create_engine,
    event,
    text,
)
from sqlalchemy.dialects.postgresql.base import PGDialect
from sqlalchemy.exc import ArgumentError, DBAPIError, DisconnectionError
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.pool import NullPool, QueuePool
from sqlalchemy.types import TypeEngine

from ...errors import (
    AuthenticationError,
    ConnectionLostError,
    InvalidUrlError,
    ReadOnlyStoreError,
    StatementTimeoutError,
    StoreBusyError,
    StoreError,
    StoreFullError,
    StoreIntegrityError,
    StoreUnreachableError,
    TableMissingError,
)
from ...limits import PATIENCE, Limit, StatementGuard
from ..query import (
    AtKey,
    Fork,
    FoundRows,
    IdsQuery,
    InList,
    InRows,
    Insert,
    Listed,
    Query,
    RowsOfIds,
    Seconds,
    StoreClock,
    StorePlace,
    insert_texts,
    write_as,
)
from ..tables import Base
from .base import (
    FEW_ROWS,
    Backend,
    Listener,
    Roles,
    Row,
    Session,
    WriterLock,
    log_statement,
    refuse_unknown_options,
)
from .postgresql_roles import holders, lock_schema, make_roles, roles_set_aside
from .postgresql_sharing import (
    IS_POOLED,
    OPTION,
    CannotListenError,
    PostgresqlListener,
    SharedListening,
    WriterTurns,
    channel,
    local,
    read_pooler,
    settle,
)
from .postgresql_structure import (
    EXTENSIONS,
    ClusterExtension,
    Nodes,
    PostgresqlViews,
    cluster_among,
    cluster_of,
    describe,
    index_faults,
)
from .structure import IndexFault, Statement
from .words import POSTGRESQL_WORDS

if TYPE_CHECKING:
    from psycopg.adapt import Loader

logger = logging.getLogger("kant_sql.postgresql")

COPY_FROM_ROWS = 50
LIST_FROM_IDS = 10
REPLAN_FROM_ROWS = 2_500
# Several cursors may be open at once.
_STREAMS = itertools.count(1)
FETCH_SIZE = 5_000

_work = threading.local()


class _ReportedAlready(logging.Filter):
    """Suppresses psycopg's warning about an error that follows the raised one.

    When the connection breaks within a pipeline (`executemany`) or a COPY, psycopg raises the
    first error and logs the next one, which has no news.
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
    """Do not log an error that the block raises."""
    _work.is_ours = True
    try:
        yield
    finally:
        _work.is_ours = False


write_as(InList, "{0} = ANY({1})", "postgresql")
write_as(InRows, "{0} = ANY(ARRAY{1})", "postgresql")
# A column that equals a constant is dropped from the order, and then any index is as good.
write_as(AtKey, "{0} BETWEEN {1} AND {1}", "postgresql")
write_as(StoreClock, "clock_timestamp()", "postgresql")
write_as(Seconds, PostgresqlViews.seconds, "postgresql")
write_as(
    StorePlace,
    "(SELECT concat_ws(' ', extract(epoch FROM pg_postmaster_start_time()), oid, "
    "current_schema()) FROM pg_database WHERE datname = current_database())",
    "postgresql",
)


@compiles(Listed, "postgresql")
def _listed(element: Listed, compiler: Any, **options: Any) -> str:
    (values,) = (compiler.process(clause, **options) for clause in element.clauses)
    return f"unnest(CAST({values} AS {_array_of(element.kind, compiler.dialect)}))"


def _array_of(type_: TypeEngine[Any], dialect: Dialect) -> str:
    # A text is compiled with its collation, which no array has.
    return f"{'text' if isinstance(type_, String) else type_.compile(dialect)}[]"


@compiles(FoundRows, "postgresql")
def _found_rows(element: FoundRows, compiler: Any, **options: Any) -> str:
    return _looked_up(element.values, element.each, compiler, options)


def _looked_up(listed: Listed, each: Select[Any], compiler: Any, options: Any) -> str:
    values, rows = (compiler.process(part, **options) for part in (listed, each))
    # The planner cannot pull up a subquery with an offset: it looks each value up.
    loop = f"{values} AS wanted CROSS JOIN LATERAL ({rows} OFFSET 0) AS found"
    return f"(SELECT found.* FROM {loop})"


@compiles(Fork, "postgresql")
def _fork(element: Fork, compiler: Any, **options: Any) -> str:
    since, until = (compiler.process(clause, **options) for clause in element.clauses)
    # The highest bit in which they differ.
    differing = f"CAST(({since} - 1) # ({until} - 1) AS bit(64))"
    shift = f"(64 - position(B'1' IN {differing}))"
    return f"(({until} - 1) >> {shift} << {shift})"


@compiles(RowsOfIds, "postgresql")
def _rows_of_ids(element: RowsOfIds, compiler: Any, **options: Any) -> str:
    return f"ctid = ANY(ARRAY{_looked_up(element.ids, element.each, compiler, options)})"


def read_all_times(connection: Any) -> None:
    """Load times beyond Python's datetime as text: the driver would refuse the whole result."""
    from psycopg import pq

    registry = connection.adapters
    oid = registry.types["timestamptz"].oid
    registry.register_loader(oid, _any_time(registry.get_loader(oid, pq.Format.TEXT)))


# The driver keeps each class that it is given, so all connections share one.
@cache
def _any_time(driver: type[Loader]) -> type[Loader]:
    from psycopg import DataError
    from psycopg.adapt import Loader

    class AnyTime(Loader):
        def __init__(self, oid: int, context: Any = None) -> None:
            super().__init__(oid, context)
            self._load = driver(oid, context).load

        def load(self, data: Any) -> Any:
            try:
                return self._load(data)
            except DataError:
                return bytes(data).decode()

    return AnyTime


@cache
def _unnest_text(into: Insert) -> str:
    """Write the statement that inserts many rows, one list for each column."""
    dialect: Dialect = PGDialect()  # type: ignore[no-untyped-call]
    types = (column.type.dialect_impl(dialect) for column in into.columns)
    lists = ", ".join(f"%s::{_array_of(type_, dialect)}" for type_ in types)
    return f"INSERT INTO {into.into} SELECT * FROM unnest({lists})"


class PostgresqlSession(Session):
    """A session on PostgreSQL."""

    backend: PostgresqlBackend
    placeholder = "%s"
    keeps_limit = True
    _is_replanned = False
    _gathered: list[tuple[Insert, Sequence[Row]]] | None = None

    def obey(self, limit: Limit | None) -> None:
        """Let the server end slow statements: the connection keeps the limit."""
        self._allow(None if limit is None else _milliseconds(limit.seconds))
        super().obey(limit)

    def _allow(self, milliseconds: int | None) -> None:
        info = self._pooled.info
        if info.get(_TIMEOUT) != milliseconds:
            # Before the statement: if it fails, its outcome is unknown.
            info[_TIMEOUT] = _UNKNOWN
            value = "DEFAULT" if milliseconds is None else str(milliseconds)
            self._execute(f"SET statement_timeout = {value}")
            info[_TIMEOUT] = milliseconds

    def _unlimited(self, guard: StatementGuard) -> None:
        if guard.was_stopped:
            # The request may still be on its way, and would end the next statement of anybody.
            connection: Any = self._pooled.driver_connection
            connection.close()

    def _stop(self) -> None:
        connection: Any = self._pooled.driver_connection
        with suppress(*self.backend.driver_errors):
            connection.cancel_safe(timeout=CANCEL_TIMEOUT)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Insert the few rows of the inserts of a block by one statement.

        Foreign keys are checked at its end; each message to the server takes longer than a row.
        """
        if self._nodes is not None or self._is_limited():
            # A cluster refuses such a statement, and row policies do not see its rows.
            yield
            return
        self._gathered = []
        try:
            yield
            self._insert_gathered()
        finally:
            self._gathered = None

    def _insert_gathered(self) -> None:
        gathered = self._gathered
        if gathered:
            self._gathered = []
            sql = insert_texts(tuple([(into, len(rows)) for into, rows in gathered]), "%s")
            self._execute(sql, [value for _, rows in gathered for row in rows for value in row])

    def _execute(self, statement: str | Query, parameters: Any = ()) -> None:
        if self._gathered:
            self._insert_gathered()
        super()._execute(statement, parameters)

    def insert(self, into: Insert, rows: Sequence[Row]) -> None:
        """Insert rows: many of them by COPY."""
        if self._gathered is not None and len(rows) <= FEW_ROWS:
            self._gathered += [(into, rows)] if rows else []
            return
        self._insert_gathered()
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
        self._insert_gathered()
        with _one_report():
            super()._execute_many(sql, parameters)

    def run_for(self, query: IdsQuery, ids: Sequence[int], **parameters: Any) -> None:
        """Run a statement for each id: many of them at once."""
        if len(ids) < LIST_FROM_IDS:
            super().run_for(query, ids, **parameters)
        else:
            with self.planned_now():
                self.run(query.listed, ids=self.list_value(ids), **parameters)

    @contextmanager
    def planned_now(self) -> Iterator[None]:
        """Prepare no statement meanwhile.

        In a small table the server prefers to read a whole knowledge base to finding the rows of a
        list, and would keep that plan when the table has grown.
        """
        connection: Any = self._pooled.driver_connection
        threshold = connection.prepare_threshold
        connection.prepare_threshold = None
        try:
            yield
        finally:
            connection.prepare_threshold = threshold

    def replan(self) -> None:
        """Discard cached plans.

        The server plans the check of a foreign key once per connection; the plan for a small table
        may scan a large one for each row.
        """
        self._execute("DISCARD PLANS")
        nodes = self._nodes
        if nodes is not None and self.in_transaction():
            self._is_replanned = not self._is_replanned
            self._execute(nodes.replanning(self._is_replanned))

    def make_durable(self) -> None:
        """Make later commits of this connection, on any node, survive a power cut."""
        super().make_durable()
        nodes = self._nodes
        if nodes is not None:
            self._execute("SHOW synchronous_commit")
            self._pooled.info[_NODES] = nodes.committing(str(self._fetch()[0][0]))

    @property
    def _nodes(self) -> Nodes | None:
        found: Nodes | None = self._pooled.info.get(_NODES)
        return found

    def begin(self, write: bool) -> None:
        """Begin a transaction, with the same settings on all nodes."""
        nodes = self._nodes
        self._is_replanned = False
        if write and nodes is not None:
            settings = {**nodes.settings(), "lock_timeout": LOCK_TIMEOUT}
            self._execute(f"{self.backend.begin_write}{local(settings)}")
        else:
            super().begin(write)

    def _is_limited(self) -> bool:
        """Return whether row policies bind this user: the server then refuses COPY."""
        limited = self._pooled.info.get("is_limited")
        if limited is None:
            self._execute(_IS_LIMITED)
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
        return self._status() != 0

    def _status(self) -> int:
        connection: Any = self._pooled.driver_connection
        if connection is None or connection.closed:
            return 0
        return int(connection.info.transaction_status)

    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Yield a query's rows from a server-side cursor."""
        connection: Any = self._pooled.driver_connection
        sql, given = self.for_driver(query.text(self.backend.dialect), parameters)
        started = time.perf_counter()
        try:
            with connection.cursor(name=f"kant_sql_stream_{next(_STREAMS)}") as cursor:
                source = self._guarded(cursor)
                source.execute(sql, given)
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
        """Return the time: the driver takes it unchanged."""
        return moment

    def to_time(self, raw: Any) -> datetime:
        """Return the time in UTC, whatever the connection's zone."""
        if not isinstance(raw, datetime):
            raise ValueError(f"{raw!r} is not a time of the years 1 to 9999")
        return raw.astimezone(UTC)

    def describe(self, names: Collection[str]) -> Iterator[Statement]:
        """Describe some tables and views as they are, and what belongs to them."""
        return describe(self.rows_of, names)

    def plan_for_all(self) -> None:
        """Plan cursors for all of their rows.

        For the first tenth, the server looks each row of a view's joins up in the order of the
        result: 20,000 facts without statistics take 7.8 s, and 0.2 when it sorts them.
        """
        if self.in_transaction():
            self._execute("SET LOCAL cursor_tuple_fraction = 1")

    def query_of_view(self, name: str, kb_id: int) -> str | None:
        """Return a query that one shard of a cluster answers."""
        cluster = self.backend.cluster
        row = None if cluster is None else self.first(_VIEW, view=name)
        if cluster is None or row is None:
            return None
        query, schema = row
        return cluster.of_one_shard(query.rstrip().rstrip(";"), schema, kb_id)

    def index_faults(self, tables: Sequence[str]) -> Iterator[IndexFault]:
        """Compare the indexes of some tables with the tables."""
        return index_faults(self, tables, self._nodes)

    def close(self) -> None:
        """Return the connection to the pool, unless it is broken."""
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


class PooledSession(PostgresqlSession):
    """A session whose transactions may use different connections of the server.

    Other sessions set options once, these in each transaction. If there are options, a statement
    outside of a transaction gets one, which lasts until `rollback`.
    """

    _is_enclosed = _is_durable = False
    _allowed: int | None = None

    def _allow(self, milliseconds: int | None) -> None:
        self._allowed = milliseconds

    def make_durable(self) -> None:
        """Make later commits of this session survive a power cut."""
        self._is_durable = True

    def begin(self, write: bool) -> None:
        """Begin a transaction."""
        self._leave()
        self._set_and_begin(self.backend.begin_write if write else self.backend.begin_read, write)

    def _set_and_begin(self, text: str, write: bool) -> None:
        nodes = self._nodes
        settings = {} if nodes is None else nodes.settings(is_durable=self._is_durable)
        settings["lock_timeout"] = LOCK_TIMEOUT
        if self._allowed is not None:
            settings[_TIMEOUT] = str(self._allowed)
        if write and self.backend.is_read_only:
            text = f"{text} READ ONLY"
        durable = f"; {_DURABLE.format('true')}" if write and self._is_durable else ""
        # In one message.
        super()._execute(f"{text}{local(settings)}{durable}")

    def _execute(self, statement: str | Query, parameters: Any = ()) -> None:
        self._enclose()
        super()._execute(statement, parameters)

    def _execute_many(self, sql: str, parameters: Sequence[Any]) -> None:
        self._enclose()
        super()._execute_many(sql, parameters)

    def _enclose(self) -> None:
        """Begin a transaction for a statement that needs settings."""
        if self._is_enclosed and self._status() == _FAILED:
            self._leave()
        needs = self._allowed is not None or self.backend.is_read_only
        if needs and not self.in_transaction():
            self._set_and_begin(_ENCLOSING, write=False)
            self._is_enclosed = True

    def _leave(self) -> None:
        """End the transaction of a single statement."""
        if self._is_enclosed:
            self._is_enclosed = False
            if not self.is_abandoned and self.in_transaction():
                super()._execute("ROLLBACK")

    def rollback(self) -> None:
        """Roll the transaction back."""
        self._is_enclosed = False
        super().rollback()

    def close(self) -> None:
        """Return the connection to the pool."""
        self._end_limit()
        try:
            self._leave()
        finally:
            super().close()


_VIEW = Query(
    text(
        "SELECT pg_get_viewdef(oid, true), CAST(CAST(relnamespace AS regnamespace) AS text) "
        "FROM pg_class WHERE oid = to_regclass(:view)"
    )
)
# The oldest major version that the tests use.
OLDEST_SERVER = 14
LOCK_TIMEOUT = f"{PATIENCE:g}s"
# The formats that the driver and the structure checks expect, whatever the role's own settings.
READABLE = {
    **{"DateStyle": "ISO", "client_encoding": "UTF8"},
    **{"standard_conforming_strings": "on", "quote_all_identifiers": "off"},
}
_IS_LIMITED = "SELECT row_security_active(to_regclass('revision'))"
# The number of libpq's state of a transaction in which a statement has failed.
_FAILED = 3
_DURABLE = (
    "SELECT set_config('synchronous_commit', 'on', {}) "
    "WHERE current_setting('synchronous_commit') = 'off'"
)
# Around a single statement that needs settings.
_ENCLOSING = "BEGIN ISOLATION LEVEL READ COMMITTED READ ONLY"
# Seconds until a request to cancel a statement is given up.
CANCEL_TIMEOUT = 2.0
# The key in a connection's record of its work for other nodes.
_NODES = "nodes"
# The key in a connection's record of its timeout, and the value after a change that may have
# failed.
_TIMEOUT, _UNKNOWN = "statement_timeout", -1
# The server counts milliseconds in 31 bits.
_LONGEST_TIMEOUT = 2**31 - 1
CONNECT_TIMEOUT = "10"
POOL_SIZE, MAX_CONNECTIONS = 8, 64
# Tables of other roles that this user may not maintain.
_OF_OTHERS = text(
    "SELECT c.relname FROM pg_class AS c WHERE c.oid = ANY (SELECT to_regclass(n) FROM "
    "unnest(CAST(:names AS text[])) AS n) AND NOT pg_has_role(c.relowner, 'USAGE') "
    "AND NOT CASE WHEN current_setting('server_version_num')::integer >= 170000 "
    "THEN has_table_privilege(c.oid, 'MAINTAIN') ELSE false END"
)
_ROWS_GONE = "rows that were replaced in the tables of"
_OWNER_VACUUMS = "run VACUUM (FULL, ANALYZE) as the owner of the tables"
# Seconds that an erasure waits for a table in use, and then lets others read it.
_TURN = 1.0
# SQLSTATE: lock timeout, deadlock, table created or dropped meanwhile.
_IN_THE_WAY = frozenset({"55P03", "40P01", "23505", "42P07"})
# The errors of the server and of PgBouncer when all connections are in use.
_CROWDED = re.compile(
    "too many clients|remaining connection slots|too many connections|query_wait_timeout"
    "|no more connections allowed"
)
_REFUSED = re.compile('authentication failed|no password|role ".*" (does not|is not)|pg_hba.conf')


def _milliseconds(seconds: float) -> int | None:
    """Convert a limit, or None. Zero would mean no limit to the server."""
    milliseconds = max(1.0, seconds * 1e3)
    return None if milliseconds > _LONGEST_TIMEOUT else round(milliseconds)


class PostgresqlBackend(Backend):
    """A PostgreSQL database.

    Listeners have their own engine. `cluster` is the plugin of an extension for tables on several
    servers, if there is one.
    """

    listening: Engine
    cluster: ClusterExtension | None = None
    begin_read = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"
    begin_write = "BEGIN ISOLATION LEVEL READ COMMITTED"
    durable = _DURABLE.format("false")
    # Row policies allow a writer to change only versions without that row.
    revision_comes_last = True
    is_server = True
    views = PostgresqlViews()
    words = POSTGRESQL_WORDS
    _lost_at = 0.0
    # For a backend with few connections for many knowledge bases.
    _turns: WriterTurns | None = None
    _shared_listening: SharedListening

    def create_engine(self) -> Engine:
        """Create the engines; sessions control transactions."""
        # Listeners must not exhaust the pool of sessions.
        self.listening = self._create_pool(1, -1)
        self._shared_listening = SharedListening(self)
        most = self.most_connections
        if most is None:
            return self._create_pool(POOL_SIZE, MAX_CONNECTIONS - POOL_SIZE)
        self._turns = WriterTurns(most)
        return self._create_pool(most, 0)

    def _create_pool(self, size: int, overflow: int) -> Engine:
        pooler = read_pooler(self.url)
        engine = self._engine(
            poolclass=QueuePool,
            pool_reset_on_return=None,
            pool_size=size,
            max_overflow=overflow,
            pool_timeout=self.patience,
            # As in `create_pool_from_url`: without the five statements of SQLAlchemy's first
            # connection, which only reflection and literals need.
            _initialize=False,
        )

        @event.listens_for(engine, "connect")
        def configure(connection: Any, record: Any) -> None:
            record.info["made_at"] = time.monotonic()
            connection.autocommit = True
            # In another zone, the first and the last times of the calendar would overflow.
            settings = {"lock_timeout": LOCK_TIMEOUT, "TimeZone": "UTC", **READABLE}
            if self.is_read_only:
                settings["default_transaction_read_only"] = "on"
            record.info[IS_POOLED] = settle(connection, pooler, settings)
            self.cluster = cluster_among(name for (name,) in connection.execute(EXTENSIONS))
            record.info[_NODES] = self.cluster and self.cluster.nodes(connection)
            # Unknown before there are tables.
            [record.info["is_limited"]] = connection.execute(_IS_LIMITED).fetchone()
            read_all_times(connection)

        @event.listens_for(engine, "checkout")
        def refuse_old(_: object, record: Any, __: object) -> None:
            if record.info["made_at"] <= self._lost_at:
                raise DisconnectionError  # The pool makes a new one instead.

        return engine

    def close(self) -> None:
        """Close all connections, even if closing one raises."""
        with ExitStack() as steps:
            # The last one comes first.
            steps.callback(self.listening.dispose)
            steps.callback(self._shared_listening.close)
            steps.callback(super().close)

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child."""
        super().leave_connections()
        self.listening.dispose(close=False)
        if self.most_connections is not None:
            self._turns = WriterTurns(self.most_connections)
        self._shared_listening.forked()

    def take_listening(self) -> PoolProxiedConnection:
        """Take a connection for listening, unless a pooler answers."""
        pooled = self.take(self.listening)
        if self.is_closed:
            # Closed meanwhile: the new connection would stay open.
            pooled.invalidate()
            raise self.closed_error()
        if pooled.info[IS_POOLED]:
            pooled.close()
            raise CannotListenError("through a pooler; watch by the server's own address")
        return pooled

    def listener(self) -> Listener:
        """Create a listener."""
        return PostgresqlListener(self._shared_listening)

    def listening_failed(self, error: Exception) -> None:
        """Replace the other connections on next use, if the listening one was lost."""
        if isinstance(self.heard(error), ConnectionLostError):
            self.renew()

    def heard(self, error: Exception) -> StoreError:
        """Translate the error of a listening thread for a watcher."""
        return type(error)(*error.args) if isinstance(error, StoreError) else self.translate(error)

    def wipe(self) -> tuple[str, ...]:
        """Rewrite the tables with texts, without deleted rows, as their owner."""
        texts = [
            table.name
            for table in Base.metadata.sorted_tables
            if any(isinstance(column.type, String | LargeBinary) for column in table.c)
        ]
        engine = self._engine(poolclass=NullPool, isolation_level="AUTOCOMMIT")
        try:
            with engine.connect() as connection:
                of_others = connection.execute(_OF_OTHERS, {"names": texts}).scalars().all()
                used = () if of_others else self._rewrite(connection, texts)
        except DBAPIError as error:
            return (f"{_ROWS_GONE} {self.label}: {error.orig}; {_OWNER_VACUUMS}",)
        finally:
            engine.dispose()
        if not (of_others or used):
            return ()
        why = f": others use {', '.join(used)}" if used else ""
        return (f"{_ROWS_GONE} {self.label}{why}; {_OWNER_VACUUMS}",)

    def _rewrite(self, connection: Connection, tables: list[str]) -> list[str]:
        """Rewrite tables; return those that others used all the time."""
        # New users of a table wait behind it, so it waits briefly, many times.
        connection.exec_driver_sql(f"SET lock_timeout = '{min(self.patience, _TURN):g}s'")
        until = time.monotonic() + self.patience
        while tables:
            used = []
            for table in tables:
                try:
                    connection.exec_driver_sql(f"VACUUM (FULL, ANALYZE) {table}")
                except DBAPIError as error:
                    if getattr(error.orig, "sqlstate", None) != "55P03":
                        raise
                    used.append(table)
            tables = used
            if time.monotonic() > until:
                break
            if tables:
                time.sleep(_TURN)
        return tables

    def renew(self) -> None:
        """Replace existing connections at their next checkout."""
        self._lost_at = time.monotonic()

    def _engine(self, **options: Any) -> Engine:
        url = self.url.set(drivername="postgresql+psycopg").difference_update_query([OPTION])
        if "connect_timeout" not in url.query:
            url = url.update_query_dict({"connect_timeout": CONNECT_TIMEOUT})
        try:
            from psycopg import pq

            known = {option.keyword.decode() for option in pq.Conninfo.get_defaults()}
            refuse_unknown_options(self.url, known | {OPTION})
            engine = create_engine(url, **options)
        except ImportError as error:
            raise InvalidUrlError(
                f"{self.label}: PostgreSQL needs the psycopg driver; "
                "install it with: pip install 'kant-sql[postgres]'"
            ) from error
        except ArgumentError as error:
            raise InvalidUrlError(f"{self.label}: {error}") from error

        # Before SQLAlchemy, which cannot read bytes.
        @event.listens_for(engine, "connect", insert=True)
        def refuse_server(connection: Any, _: object) -> None:
            major, minor = divmod(connection.info.server_version, 10_000)
            if major < OLDEST_SERVER:
                connection.close()
                raise StoreError(
                    f"{self.label}: the server is PostgreSQL {major}.{minor}, and kant_sql needs "
                    f"{OLDEST_SERVER} or later; upgrade the server"
                )
            if connection.info.parameter_status("server_encoding") == "SQL_ASCII":
                connection.close()
                raise StoreError(
                    f"{self.label}: the database has the encoding SQL_ASCII, bytes without "
                    "characters; use one with the encoding UTF8"
                )

        return engine

    def wrap(self, connection: Any) -> Session:
        """Wrap a connection of the pool."""
        self.has_answered = True
        made = PooledSession if connection.info[IS_POOLED] else PostgresqlSession
        return made(self, connection)

    def queue(self, knowledge_base: str) -> Hashable:
        """Identify the row of the head."""
        url = self.url
        hosts = tuple(str(url.query.get(key, "")) for key in ("host", "port", "dbname"))
        return (url.host, url.port, url.database, hosts, knowledge_base)

    def write_lock(self, knowledge_base: str) -> WriterLock | None:
        """Return the turn if connections are few; otherwise the server has the only queue."""
        return None if self._turns is None else self._turns.of(knowledge_base)

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Open a connection that holds the lock of all schema changes of this database."""
        # Without prepared statements: there may be a pooler, and most statements run once.
        engine = self._engine(poolclass=NullPool, connect_args={"prepare_threshold": None})
        try:
            with engine.connect() as connection, connection.begin():
                lock_schema(lambda sql: _says_true(connection.exec_driver_sql(sql)))
                connection.exec_driver_sql(local(READABLE).removeprefix("; "))
                self.cluster = cluster_of(connection)
                if self.cluster is not None:
                    self.cluster.use_one_connection(connection)
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
        """Make the error for a locked table or a concurrent schema change."""
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

    def layout_fault(self) -> str | None:
        """Return the fault of a store with only some tables distributed."""
        engine = self._engine(poolclass=NullPool)
        try:
            with engine.connect() as connection:
                cluster = cluster_of(connection)
                return None if cluster is None else cluster.fault(connection, self.label)
        except self.driver_errors as error:
            raise self.translate_connect(error) from error
        except DBAPIError as error:
            raise self.translate_connect(error) from error
        finally:
            engine.dispose()

    @staticmethod
    def migrating(connection: Connection, label: str) -> AbstractContextManager[None]:
        """Let migrations create tables in the place of the store's."""
        cluster = cluster_of(connection)
        return nullcontext() if cluster is None else cluster.migrating(connection, label)

    @staticmethod
    def roles_set_aside(connection: Connection) -> AbstractContextManager[None]:
        """Drop policies and auditors' own views during a migration."""
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
        if state == "53100":
            return StoreFullError(
                f"{self.label}: {text}; nothing was written: free space on the server's disk, "
                "and try again"
            )
        if _CROWDED.search(text):
            return self._is_crowded(text)
        if "statement pooling" in text:
            return StoreError(
                f"{self.label}: the pooler gives a connection for one statement, so there are no "
                f"transactions ({text}); set pool_mode = transaction in it"
            )
        if state in ("42501", "25006"):
            return ReadOnlyStoreError(f"{self.label}: {text}; ask for that right, or only read")
        if state == "42P01":
            return TableMissingError(f"{self.label}: {text}")
        if state.startswith("23"):
            return StoreIntegrityError(f"{self.label}: {text}; nothing was written")
        is_lost = state.startswith(("57P", "08", "25P03", "25P04")) or (
            not state and isinstance(error, self.engine.dialect.loaded_dbapi.OperationalError)
        )
        cluster = self.cluster
        if is_lost or (cluster is not None and cluster.has_lost_a_node(state, text)):
            return ConnectionLostError(
                f"{self.label}: the connection was lost ({text}); nothing of the open transaction "
                "was written, try again"
            )
        return StoreError(f"{self.label}: {type(error).__name__}: {text}")

    def translate_connect(self, error: Exception) -> StoreError:
        """Translate a failure to connect, which SQLAlchemy may have wrapped."""
        original = getattr(error, "orig", None) or error
        state, text = getattr(original, "sqlstate", None) or "", self._text(original)
        # The driver gives no SQLSTATE here.
        if state.startswith("28") or _REFUSED.search(text):
            return AuthenticationError(
                f"{self.label}: the server refused the user or the password ({text}); "
                "check both in the URL"
            )
        if _CROWDED.search(text):
            return self._is_crowded(text)
        if not state and isinstance(original, self.engine.dialect.loaded_dbapi.OperationalError):
            return StoreUnreachableError(
                f"{self.label}: no connection ({text}); check that the server runs, and host, "
                "port and database in the URL"
            )
        return self.translate(original)

    def _is_crowded(self, text: str) -> StoreBusyError:
        return StoreBusyError(
            f"{self.label}: no connection was free ({text}); nothing was written, try again, or "
            "allow more connections on the server or its pooler"
        )

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
