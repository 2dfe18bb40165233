"""SQLite: embedded, in a file or in memory."""

from __future__ import annotations

import json
import logging
import os
import re
import sqlite3
import stat
import threading
import time
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeVar
from urllib.parse import quote
from weakref import WeakMethod

from sqlalchemy import (
    URL,
    Boolean,
    Column,
    Connection,
    Double,
    Engine,
    Integer,
    LargeBinary,
    String,
    Table,
    create_engine,
    event,
    text,
)
from sqlalchemy.dialects.sqlite.base import SQLiteDialect
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.pool import ConnectionPoolEntry, Pool, QueuePool, StaticPool

from ...errors import (
    ForkedError,
    InvalidArgumentError,
    InvalidUrlError,
    NotADatabaseError,
    ReadOnlyStoreError,
    StatementTimeoutError,
    StoreBusyError,
    StoreError,
    StoreFullError,
    StoreIntegrityError,
    StoreUnreachableError,
    TableMissingError,
)
from ...knowledge.canonical import text_time, time_text
from ...limits import Limit, StatementGuard
from ..query import (
    Fork,
    FoundRows,
    InList,
    InRange,
    InRows,
    Listed,
    Query,
    Seconds,
    StoreClock,
    StorePlace,
    Unsought,
    raw,
    write_as,
)
from ..tables.base import UtcTime
from .base import (
    NO_FORK,
    Backend,
    Commits,
    Listener,
    Row,
    Session,
    WriterLock,
    log_statement,
    refuse_unknown_options,
    statement_log,
    url_label,
)
from .sqlite_file import WAL_LIMIT, StoreFile
from .structure import (
    MARK,
    MARKED,
    IndexFault,
    Mark,
    Rows,
    Statement,
    ViewDialect,
    mark_of,
    parenthesized,
    parse_statement,
)
from .words import SQLITE_WORDS, add_functions

_OBJECTS = """
SELECT type, name, tbl_name, sql FROM sqlite_master WHERE sql IS NOT NULL
ORDER BY tbl_name, type = 'table' DESC, type, name
"""
_TEMPORARY = "SELECT type || ' ' || name, name, tbl_name FROM sqlite_temp_master"
_TABLES = raw("SELECT name FROM sqlite_master WHERE type = 'table'")
# The storage class of a column's values.
_STORED_AS: tuple[tuple[Any, str], ...] = (
    ((Boolean, Integer), "'integer'"),
    (Double, "'real'"),
    ((String, UtcTime), "'text'"),
    (LargeBinary, "'blob'"),
)
# Fewer than make Python look for garbage among them: with 5,000 it takes a seventh longer.
FETCH_SIZE = 100
# Made once: `json.dumps` makes an encoder for each call, which takes as long as the call.
_TO_JSON = json.JSONEncoder(ensure_ascii=False).encode


def describe(rows: Rows, names: Collection[str] | None = None) -> Iterator[Statement]:
    """Describe a schema, or some tables and views with all that belongs to them."""
    wanted = None if names is None else {name.lower() for name in names}
    for kind, name, table, sql in rows(_OBJECTS):
        if wanted is None or {str(name).lower(), str(table).lower()} & wanted:
            if kind == "table" and "(" in sql:
                form = _sorted_table(sql)
            else:
                form = sql if kind == "view" else " ".join(sql.split())
            yield parse_statement(f"{form};", table)
    for what, name, table in rows(_TEMPORARY):
        if wanted is not None and {name.lower(), table.lower()} & wanted:
            yield parse_statement(f"-- temporary {what}", table)


def _sorted_table(sql: str) -> str:
    """Write columns in their own order, then constraints in the order of their names."""
    name, _, rest = sql.partition("(")
    body, _, options = rest.rpartition(")")
    parts = _split(body)
    columns = [part for part in parts if not part.startswith("CONSTRAINT")]
    constraints = sorted(part for part in parts if part.startswith("CONSTRAINT"))
    return parenthesized(" ".join(name.split()), [*columns, *constraints]) + options.rstrip()


def _split(body: str) -> list[str]:
    parts, depth, start = [], 0, 0
    for match in re.finditer(r"'[^']*'|[(),]", body):
        depth += {"(": 1, ")": -1}.get(match[0], 0)
        if match[0] == "," and depth == 0:
            parts.append(body[start : match.start()])
            start = match.end()
    return [" ".join(part.split()) for part in [*parts, body[start:]]]


@cache
def _wrong(tables: tuple[Table, ...]) -> Query:
    """Build the query that counts the wrong values of each column, in the order of the tables."""
    counts = (f"SELECT {number}, {_counted(table)}" for number, table in enumerate(tables))
    return Query(text(f"{' UNION ALL '.join(counts)} ORDER BY 1"))


def _counted(table: Table) -> str:
    right = [*map(_is_right, table.c)]
    counts = ", ".join(f"count(*) - coalesce(sum({each}), 0)" for each in right)
    # Only rows with a wrong value are counted: in most stores none.
    rows = f"{_quoted(next(iter(table.c)))} = :kb AND NOT ({' AND '.join(right)})"
    return f"json_array({counts}) FROM {table.name} WHERE {rows}"


def _is_right(column: Column[Any]) -> str:
    name, allowed = _quoted(column), ["'null'"] if column.nullable else []
    kind = next(kind for types, kind in _STORED_AS if isinstance(column.type, types))
    is_right = f"typeof({name}) IN ({', '.join([*allowed, kind])})"
    return f"{is_right} AND {name} IN (0, 1)" if isinstance(column.type, Boolean) else is_right


def _quoted(column: Column[Any]) -> str:
    return f'"{column.name}"'


class SqliteViews(ViewDialect):
    """Generated views on SQLite: the mark is a comment in the view's text."""

    relations = "SELECT name, CASE type WHEN 'view' THEN sql END FROM sqlite_master"
    marked = re.compile(rf"CREATE VIEW \S+ AS /\* {MARKED.pattern} \*/")
    columns = "SELECT name FROM pragma_table_info('{0}') ORDER BY cid"
    is_goal = "v.is_goal = 1"
    epoch = "(strftime('%s', substr({0}, 1, 19)) * 1000000 + substr({0}, 21, 6)) / 1000000.0"
    seconds = (
        "((strftime('%s', substr({1}, 1, 19)) - strftime('%s', substr({0}, 1, 19)))"
        " * 1000000 + substr({1}, 21, 6) - substr({0}, 21, 6)) / 1000000.0"
    )
    preparer = SQLiteDialect().identifier_preparer

    def create(self, name: str, definition: str, mark: Mark, readers: Sequence[str]) -> list[str]:
        """Write the statement that creates a view."""
        quoted = self.preparer.quote(name)
        return [f"CREATE VIEW {quoted} AS /* {MARK.format(*mark)} */\n{definition}"]

    def list_altered(self, rows: Rows) -> list[str]:
        """List the views whose definition is not the one in their mark."""
        altered = []
        for name, sql in rows(self.relations):
            mark = self.read_mark(sql)
            # The definition follows the mark and a line feed.
            if mark is not None and mark != mark_of(*mark[:3], sql.partition("*/")[2][1:]):
                altered.append(name)
        return altered


@compiles(InList, "sqlite")
@compiles(InRows, "sqlite")
def _among(element: InList | InRows, compiler: Any, **options: Any) -> str:
    column, values, *bounded = (compiler.process(each, **options) for each in element.clauses)
    template = SQLITE_WORDS.in_list if isinstance(element, InList) else "{0} IN {1}"
    parts = [template.format(column, values), *map(SQLITE_WORDS.bounded.format, bounded)]
    return f"({''.join(parts)})" if bounded else parts[0]


write_as(Unsought, SQLITE_WORDS.loops.unsought + "{0}", "sqlite")
# A lower bound that excludes its own value: see `bounded` in `words.py`.
write_as(InRange, "({0} > {1} - 1 AND {0} <= {2})", "sqlite")
write_as(Listed, "json_each({0})", "sqlite")
write_as(StoreClock, "NULL", "sqlite")
write_as(Seconds, f"({SqliteViews.seconds})", "sqlite")
write_as(StorePlace, "(SELECT file FROM pragma_database_list WHERE name = 'main')", "sqlite")


@compiles(FoundRows, "sqlite")
def _found_rows(element: FoundRows, compiler: Any, **options: Any) -> str:
    return f"({compiler.process(element.listed, **options)})"


@compiles(Fork, "sqlite")
def _fork(element: Fork, compiler: Any, **options: Any) -> str:
    since, until = (compiler.process(clause, **options) for clause in element.clauses)
    before, last = f"({since} - 1)", f"({until} - 1)"
    # The differing bits, and all bits below the highest of them: there is no exact logarithm. The
    # limits keep SQLite from copying each step twice into the next: the first one 64 times.
    bits = f"SELECT ({before} | {last}) - ({before} & {last}) AS bits LIMIT 1 OFFSET 0"
    for shift in (1, 2, 4, 8, 16, 32):
        step = f"SELECT bits | (bits >> {shift}) AS bits FROM ({bits}) AS bits_{shift}"
        bits = f"{step} LIMIT 1 OFFSET 0"
    return f"(SELECT {last} - ({last} & (bits >> 1)) FROM ({bits}) AS bits)"


class SqliteSession(Session):
    """A session on SQLite."""

    def __init__(self, backend: SqliteBackend, connection: Any) -> None:
        super().__init__(backend, connection)
        # Cached: the pool's way to it takes as long as a small statement.
        self._driver: sqlite3.Connection = connection.driver_connection

    def obey(self, limit: Limit | None) -> None:
        """Let SQLite check regularly whether a statement must end."""
        super().obey(limit)
        if self._guard is not None:
            # In memory, one read may run within another, on the same connection.
            self._handlers().append(self._guard.is_over)
            self._driver.set_progress_handler(self._guard.is_over, STEPS)

    def _unlimited(self, guard: StatementGuard) -> None:
        handlers = self._handlers()
        handlers.remove(guard.is_over)
        with suppress(sqlite3.ProgrammingError):
            self._driver.set_progress_handler(handlers[-1] if handlers else None, STEPS)

    def _handlers(self) -> list[Callable[[], bool]]:
        found: list[Callable[[], bool]] = self._pooled.info.setdefault("handlers", [])
        return found

    def _stop(self) -> None:
        # Ends long single steps, such as the check of a table.
        with suppress(sqlite3.ProgrammingError):
            self._driver.interrupt()

    def in_transaction(self) -> bool:
        """Return whether a transaction is open."""
        try:
            return not self.is_abandoned and self._driver.in_transaction
        except sqlite3.ProgrammingError:
            # The connection is closed.
            return False

    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Yield a query's rows from a separate cursor."""
        sql, given = self.for_driver(query.text(self.backend.dialect), parameters)
        cursor: Any = self._cursor
        if not self.is_abandoned:
            cursor = self._guarded(self._pooled.cursor())
        started = time.perf_counter()
        try:
            cursor.execute(sql, given)
            log_statement(sql, started)
            while rows := cursor.fetchmany(FETCH_SIZE):
                yield from rows
        except self.backend.driver_errors as error:
            raise self.translate(error) from error
        finally:
            # After Ctrl-C the connection may be closed already.
            with suppress(*self.backend.driver_errors):
                cursor.close()

    def overwrite_deleted(self, on: bool = True) -> None:
        """Overwrite rows deleted from now on with zeros."""
        self._driver.execute(f"PRAGMA secure_delete={'ON' if on else 'OFF'}")

    def rewrite(self) -> None:
        """Rewrite the whole database: nothing of deleted rows remains."""
        self._driver.execute("VACUUM")
        self.overwrite_deleted(False)

    def empty_log(self) -> bool:
        """Move the log into the file, and empty it; return whether a reader holds it."""
        return bool(self._driver.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0])

    def discard(self) -> None:
        """Return the connection to the pool."""
        super().close()

    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Return the form that `json_each` reads."""
        return _TO_JSON(values)

    def from_time(self, moment: datetime, text: str | None = None) -> Any:
        """Return the stored text."""
        return text or time_text(moment)

    def to_time(self, raw: Any) -> datetime:
        """Read the stored text."""
        return text_time(raw)

    def describe(self, names: Collection[str]) -> Iterator[Statement]:
        """Describe some tables and views as they are, and what belongs to them."""
        return describe(self.rows_of, names)

    def index_faults(self, tables: Sequence[str]) -> Iterator[IndexFault]:
        """Compare the indexes of some tables with the tables, by SQLite's own check."""
        present = {row[0] for row in self.rows(_TABLES)}
        for table in tables:
            if table in present:
                for (message,) in self.rows(raw(f'PRAGMA integrity_check("{table}")')):
                    if message != "ok":
                        yield IndexFault(table, f"the database itself finds: {message}")

    def wrong_values(self, tables: tuple[Table, ...], kb_id: int) -> Iterator[tuple[str, str, int]]:
        """Count values of a wrong type: SQLite stores any type in any column."""
        for table, (_, wrong) in zip(tables, self.rows(_wrong(tables), kb=kb_id), strict=True):
            for column, count in zip(table.c, json.loads(wrong), strict=True):
                if count:
                    yield table.name, column.name, count


class FileSession(SqliteSession):
    """A session on a file, kept for the next call: the pool is slower."""

    def __init__(self, backend: SqliteBackend, connection: Any) -> None:
        super().__init__(backend, connection)
        self._keep = backend.keep
        self._file = backend.file

    def begin(self, write: bool) -> None:
        """Begin a transaction; before a write, check the log."""
        if write:
            self._file.check_log()
        super().begin(write)

    def _commit(self, changed: int | None) -> None:
        self._file.check()
        super()._commit(changed)
        self._file.check_committed()

    def close(self) -> None:
        """Keep the session for the next call, or return the connection to the pool."""
        self._end_limit()
        if self._file.is_long and self.is_current and not self.in_transaction():
            self._file.shorten(self._driver)
        if not self._keep(self):
            self.discard()


class Turns:
    """A reentrant lock that any thread may release.

    A `with` block may be left in another thread than it was entered in, where an `RLock` would
    stay locked.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._thread: int | None = None
        self._depth = 0

    def begin(self, seconds: float) -> bool:
        """Wait for a turn; return whether it came in time."""
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
    """A session on the only connection of an in-memory store; threads take turns on it.

    A thread with an open transaction reads the past within it: its uncommitted versions belong to
    a revision that no past read sees.
    """

    def __init__(self, backend: SqliteBackend, connection: Any) -> None:
        super().__init__(backend, connection)
        self._turns = backend.turns
        self._commits = backend.commits
        self._keep = backend.keep
        self.resume()

    def resume(self) -> None:
        """Start another call; note whether this thread has a transaction open."""
        self._is_nested = self.in_transaction()

    def begin(self, write: bool) -> None:
        """Begin a transaction, unless this thread is in one."""
        if not self._is_nested:
            super().begin(write)

    def _commit(self, changed: int | None) -> None:
        super()._commit(changed)
        self._commits.notify()

    def rollback(self) -> None:
        """Roll back, unless the transaction is another session's of this thread."""
        if not self._is_nested:
            super().rollback()

    def close(self) -> None:
        """Pass the connection to the next thread."""
        self._end_limit()
        if self._is_nested or not self._keep(self):
            self.discard()
        self._turns.end()


T = TypeVar("T")

FIRST_PAUSE, LONGEST_PAUSE = 0.001, 0.05


class FileListener(Listener):
    """Polls a file's data version on a connection of its own."""

    def __init__(self, backend: SqliteBackend) -> None:
        self._backend = backend
        self._connection: sqlite3.Connection | None = None
        self._version: int | None = None
        self._pause = FIRST_PAUSE

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for another data version; the first call begins to poll."""
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

    def guarded(self, work: Callable[[], T]) -> T:
        """Run a read; a fork of this process waits for its end."""
        with NO_FORK:
            return work()

    def _version_now(self) -> int:
        with NO_FORK:
            self._backend.file.check()
            if self._connection is None:
                self._connection = self._backend.connect()
                # A forked child closes it, too.
                self._backend.connections.add(self._connection)
                self._connection.execute("PRAGMA busy_timeout=0")
            version: int = self._connection.execute("PRAGMA data_version").fetchone()[0]
            return version

    def close(self) -> None:
        """Stop polling."""
        connection, self._connection, self._version = self._connection, None, None
        if connection is not None:
            with NO_FORK:
                self._backend.connections.discard(connection)
                connection.close()


class MemoryListener(Listener):
    """Waits until another thread commits to the store in memory."""

    def __init__(self, backend: SqliteBackend) -> None:
        self._commits = backend.commits
        self._seen: int | None = None

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a commit; the first call begins to listen."""
        self._seen = self._commits.wait(self._seen, seconds)

    def close(self) -> None:
        """Do nothing: there is no connection."""


class _Pool(Pool):
    """A pool that opens and closes connections while this process is not forked."""

    def _create_connection(self) -> ConnectionPoolEntry:
        with NO_FORK:
            return super()._create_connection()

    def _close_connection(self, connection: DBAPIConnection, *, terminate: bool = False) -> None:
        with NO_FORK:
            super()._close_connection(connection, terminate=terminate)


class _FilePool(_Pool, QueuePool):
    """The connections to a file."""


class _MemoryPool(_Pool, StaticPool):
    """The only connection to a store in memory."""


def _keep_for_ever(kept: object) -> None:
    """Keep an object until this process ends, beyond the end of the interpreter."""
    import ctypes

    ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))


OPTIONS = {"synchronous", "timeout", "mode"}
# The first that knows AS MATERIALIZED.
OLDEST_SQLITE = (3, 35, 0)
# Steps of SQLite's machine, about a millisecond, between checks whether a statement must end.
STEPS = 50_000
# SQLite counts milliseconds in 31 bits.
LONGEST_TIMEOUT = 2_000_000
MAX_CONNECTIONS = 64
POOL_SIZE = 8
# Pages that a backup copies at once.
COPIED_PAGES = 1_000


def _patience(url: URL) -> float:
    """Read the seconds that a call may wait for another writer, from a URL."""
    try:
        seconds = float(str(url.query["timeout"]))
    except ValueError:
        seconds = -1
    if not 0 <= seconds <= LONGEST_TIMEOUT:
        raise InvalidUrlError(
            f"{url_label(url)}: timeout is a number of seconds, {LONGEST_TIMEOUT:,} at most"
        )
    return seconds


class SqliteBackend(Backend):
    """An SQLite file, or a store in memory that lives as long as this object."""

    # Whether SQLite is unusable in this process because of the moment of its fork.
    _is_torn: ClassVar[bool] = False
    begin_read = "BEGIN"
    begin_write = "BEGIN IMMEDIATE"
    durable = "PRAGMA synchronous=FULL"
    views = SqliteViews()
    words = SQLITE_WORDS
    no_roles = (
        "SQLite has no roles; restrict writing by the file's permissions, and open it with "
        "?mode=ro for reading only"
    )

    def __init__(
        self, url: URL, *, read_only: bool = False, connections: int | None = None
    ) -> None:
        refuse_unknown_options(url, OPTIONS)
        if url.host or url.port or url.username or url.password:
            # Most likely two slashes are missing: it must not become a store in memory unnoticed.
            raise InvalidUrlError(
                f"{url_label(url)}: SQLite has no host; write three slashes before the file, as in "
                "sqlite:///robot.db, and four before an absolute path"
            )
        if "timeout" in url.query:
            self.patience = _patience(url)
        self.in_memory = url.database in (None, "", ":memory:")
        self.has_one_connection = self.in_memory
        self.turns = Turns()
        self.commits = Commits()
        self._write_lock = threading.Lock()
        self.connections: set[sqlite3.Connection] = set()
        self._idle: list[SqliteSession] = []
        self.file = StoreFile(str(url.database), url_label(url))
        super().__init__(url, read_only=read_only, connections=connections)

    def create_engine(self) -> Engine:
        """Create the engine; sessions control transactions."""
        if sqlite3.sqlite_version_info < OLDEST_SQLITE:
            raise StoreError(
                f"{self.label}: this Python uses SQLite {sqlite3.sqlite_version}, and kant_sql "
                f"needs {'.'.join(map(str, OLDEST_SQLITE))} or later; upgrade SQLite or Python"
            )
        query = self.url.query
        synchronous = str(query.get("synchronous", "normal")).upper()
        if synchronous not in ("NORMAL", "FULL"):
            raise InvalidUrlError(f"{self.label}: synchronous is 'normal' or 'full'")
        # A checked-out connection keeps SQLAlchemy's pool, and kept sessions are checked out: a
        # pool that referred to this backend would keep it forever.
        connect, connections = WeakMethod(self.connect), self.connections
        is_read_only = self.is_read_only

        def create() -> sqlite3.Connection:
            made = connect()
            assert made is not None, "a session refers to its backend"
            return made()

        engine = create_engine(
            URL.create("sqlite"),
            creator=create,
            paramstyle="named",
            poolclass=_MemoryPool if self.in_memory else _FilePool,
            pool_reset_on_return=None,
            **(
                {}
                if self.in_memory
                else {"pool_size": POOL_SIZE, "max_overflow": MAX_CONNECTIONS - POOL_SIZE}
            ),
        )

        @event.listens_for(engine, "connect")
        def configure(connection: sqlite3.Connection, _: object) -> None:
            connection.execute("PRAGMA foreign_keys=ON")
            connection.execute(f"PRAGMA synchronous={synchronous}")
            connection.execute(f"PRAGMA journal_size_limit={WAL_LIMIT}")
            if is_read_only:
                connection.execute("PRAGMA query_only=ON")
            connections.add(connection)

        @event.listens_for(engine, "close")
        def forget(connection: sqlite3.Connection, _: object) -> None:
            connections.discard(connection)

        return engine

    def examine_fork(self) -> None:
        """Note whether SQLite is unusable in this child process, for any database.

        SQLite's mutexes belong to the process: a parent's thread that held one does not exist here,
        so opening and closing any connection would wait for it forever. Closing a connection whose
        transaction has spilled would remove the parent's pages from the log.
        """
        in_transaction = any(connection.in_transaction for connection in self.connections)
        has_spilled = not self.in_memory and in_transaction and self.file.has_spilled()
        if has_spilled or {*self.sessions.values()} - {threading.get_ident()}:
            SqliteBackend._is_torn = True

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child.

        SQLite tracks a process's file locks in memory, of which a child only has a copy. The child
        must close all of the parent's connections before it opens one: otherwise it writes without
        a lock and loses its writes. A store in memory is copied.
        """
        self.turns, self._write_lock = Turns(), threading.Lock()
        self.commits = Commits()
        if self._is_torn:
            # Python would close connections without references.
            cursors = [session._cursor for session in self.sessions]
            _keep_for_ever([*self.connections, *self._idle, *self.sessions, *cursors])
        elif self.in_memory:
            for connection in self.connections:
                if connection.in_transaction:
                    connection.rollback()
        else:
            for connection in [*self.connections]:
                connection.close()
        self._idle.clear()
        if self._is_torn or not self.in_memory:
            self.connections.clear()
            self.file.forget()
            super().leave_connections()

    def connect(self) -> sqlite3.Connection:
        """Open a connection; the caller keeps it in `connections` while it is open."""
        query = self.url.query
        name, is_uri = ":memory:" if self.in_memory else self.file.path, False
        mode = str(query.get("mode", "ro" if self.is_read_only else "rw"))
        if ("mode" in query or self.is_read_only) and not self.in_memory:
            if mode not in ("ro", "immutable"):
                raise InvalidUrlError(f"{self.label}: mode is 'ro' or 'immutable'")
            option = "mode=ro" if mode == "ro" else "immutable=1"
            name, is_uri = f"file:{quote(name)}?{option}", True

        def make() -> sqlite3.Connection:
            self._refuse_torn()
            # Without an isolation level the driver issues no BEGIN.
            made = sqlite3.connect(
                name,
                timeout=self.patience,
                isolation_level=None,
                check_same_thread=False,
                uri=is_uri,
            )
            add_functions(made)
            return made

        if not self.in_memory:
            self._refuse_pipe()
        with NO_FORK:
            return make() if self.in_memory else self.file.open(make)

    def _refuse_pipe(self) -> None:
        """Refuse a path that is not a file: opening a pipe would wait for a writer."""
        try:
            mode = os.stat(self.file.path).st_mode
        except (OSError, ValueError):
            return
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise StoreUnreachableError(
                f"{self.label}: this is not a regular file, so it cannot be a store; give the path "
                "of an SQLite file"
            )

    def wipe(self) -> tuple[str, ...]:
        """Rewrite the file without free pages, and empty its log."""
        with self.open_session() as session:
            pooled: Any = session
            try:
                pooled.rewrite()
                held = pooled.empty_log()
            except self.driver_errors as error:
                return (
                    f"the free pages of {self.label}, which could not be written again: "
                    f"{self.translate(error)}; run VACUUM in it, and PRAGMA "
                    "wal_checkpoint(TRUNCATE)",
                )
        if held:
            return (
                f"the write-ahead log of {self.label}: somebody reads it; run PRAGMA "
                "wal_checkpoint(TRUNCATE) in it when they have ended",
            )
        return ()

    def copy_to(self, file: Path, progress: Callable[[int, int], None] | None) -> None:
        """Copy the file by SQLite's online backup; the copy is as secret as the file."""
        if self.in_memory:
            raise InvalidArgumentError(
                f"{self.label}: a store in memory has no file; kb.store.push copies what it has"
            )
        opened: list[sqlite3.Connection] = []
        try:
            with NO_FORK:
                opened += [self.connect(), sqlite3.connect(file, isolation_level=None)]
                self.connections.update(opened)
            self._copy(opened[0], opened[1], progress)
            file.chmod(os.stat(self.file.path).st_mode & 0o777)
        except self.driver_errors as error:
            found = self.translate(error)
            raise type(found)(f"no backup was written: {found}") from error
        finally:
            with NO_FORK:
                for connection in opened:
                    connection.close()
                self.connections.difference_update(opened)

    def _copy(
        self,
        source: sqlite3.Connection,
        target: sqlite3.Connection,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        # Nobody reads it before it is complete and on the disk.
        target.execute("PRAGMA synchronous=OFF")
        # The copy is of this snapshot, and does not restart when somebody writes.
        source.execute("BEGIN")
        source.execute("SELECT count(*) FROM sqlite_master").fetchone()

        def report(_: int, remaining: int, total: int) -> None:
            if progress is not None:
                progress(total - remaining, total)

        source.backup(target, pages=COPIED_PAGES, progress=report)
        source.execute("ROLLBACK")

    def wrap(self, connection: Any) -> Session:
        """Wrap a connection of the pool."""
        if self.in_memory:
            return MemorySession(self, connection)
        return FileSession(self, connection)

    @property
    def address(self) -> str:
        """The URL by which this process can open the store again, in any working directory."""
        url = self.url if self.in_memory else self.url.set(database=self.file.path)
        return url.render_as_string(hide_password=False)

    def keep(self, session: SqliteSession) -> bool:
        """Keep a session for the next call, unless it is stale or enough are kept."""
        fit = session.is_current and len(self._idle) < POOL_SIZE
        if fit:
            self.sessions.pop(session, None)
            self._idle.append(session)
            if self.is_closed:
                # It was closed at that moment, and would keep the returned session.
                self._discard_idle()
        return fit

    def _discard_idle(self) -> None:
        while self._idle:
            # Another thread may take the last one.
            with suppress(IndexError):
                self._idle.pop().discard()

    def close(self) -> None:
        """Close all connections; in memory, wait until no other thread uses the only one."""
        self.is_closed = True
        if self.in_memory:
            self._take_turn()
        try:
            super().close()
        finally:
            if self.in_memory:
                self.turns.end()
        self._discard_idle()
        self.file.forget()
        # Wake the watchers of a store in memory, which is gone now.
        self.commits.notify()

    def listener(self) -> Listener:
        """Create a listener."""
        return MemoryListener(self) if self.in_memory else FileListener(self)

    def connected(self) -> Session:
        """Take a connection; in memory, wait for this thread's turn."""
        if self._is_torn:
            self._refuse_torn()
        if self.in_memory:
            self._take_turn()
        else:
            if self.is_closed:
                self.refuse_closed()
            self.file.check()
        try:
            return self._resumed() or super().connected()
        except BaseException:
            if self.in_memory:
                self.turns.end()
            raise

    def _refuse_torn(self) -> None:
        if self._is_torn:
            raise ForkedError(
                f"{self.label}: this process was forked while another thread used an SQLite store, "
                "or within a large transaction, which SQLite does not survive; fork at another "
                "moment, or use 'spawn' or 'forkserver'"
            )

    def _resumed(self) -> SqliteSession | None:
        """Take a kept session, if there is one."""
        if self.is_closed or not self._idle:
            return None
        try:
            session = self._idle.pop()
        except IndexError:
            # Another thread took it.
            return None
        self.sessions[session] = threading.get_ident()
        session.is_logged = statement_log.isEnabledFor(logging.DEBUG)
        if self.in_memory and isinstance(session, MemorySession):
            session.resume()
        return session

    def _take_turn(self) -> None:
        if not self.turns.begin(self.patience):
            raise StoreBusyError(
                f"{self.label}: another thread held the store for over {self.patience:g} s; "
                "nothing was written, try again"
            )

    def queue(self, knowledge_base: str) -> Hashable:
        """Identify the file, which has one queue for all; a store in memory has its own."""
        return self if self.in_memory else os.path.realpath(str(self.url.database))

    def write_lock(self, knowledge_base: str) -> WriterLock | None:
        """Return the queue of this process's writers: SQLite itself only polls."""
        return None if self.in_memory else self._write_lock

    def exists(self) -> bool:
        """Return whether the file exists; a store in memory always does."""
        if self.in_memory:
            return True
        try:
            Path(self.file.path).stat()
        except FileNotFoundError:
            return False
        except OSError:
            # SQLite's own error is better.
            pass
        return True

    def remove(self) -> bool:
        """Remove the file unless it is in use, or has a revision."""
        if self.in_memory or not self.exists():
            return False
        with NO_FORK:
            return self._remove()

    def _remove(self) -> bool:
        try:
            connection = self.connect()
        except (sqlite3.Error, StoreError):
            # What went wrong before is told, not this.
            return False
        try:
            connection.execute("PRAGMA busy_timeout=0")
            # This fails while another connection is open, and leaves one file of three.
            connection.execute("PRAGMA journal_mode=DELETE")
            connection.execute("BEGIN EXCLUSIVE")
            if connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() and (
                connection.execute("SELECT 1 FROM revision LIMIT 1").fetchone()
            ):
                return False
            Path(str(self.url.database)).resolve().unlink()
        except (sqlite3.Error, OSError):
            return False
        finally:
            connection.close()
        return True

    def is_empty(self, session: Session) -> bool:
        """Return whether the database has no tables at all."""
        session._execute("SELECT count(*) FROM sqlite_master")
        return bool(session._fetch()[0][0] == 0)

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Open a connection without foreign keys: rebuilding a table must not delete children."""
        with self.engine.connect() as connection:
            driver: Any = connection.connection.driver_connection
            driver.execute("PRAGMA foreign_keys=OFF")
            try:
                if not self.in_memory:
                    driver.execute("PRAGMA journal_mode=WAL")
                driver.execute("BEGIN IMMEDIATE")
                yield connection
                broken = driver.execute("PRAGMA foreign_key_check").fetchall()
                if broken:
                    raise StoreIntegrityError(
                        f"{self.label}: the migration would leave {len(broken)} rows that refer "
                        f"to nothing, the first in table {broken[0][0]}; it was undone"
                    )
                if not self.in_memory:
                    self.file.check()
                driver.execute("COMMIT")
                if not self.in_memory:
                    self.file.check_committed()
            except self.driver_errors as error:
                raise self.translate(error) from error
            finally:
                # After Ctrl-C in a statement SQLAlchemy has closed it.
                with suppress(sqlite3.ProgrammingError):
                    if driver.in_transaction:
                        driver.execute("ROLLBACK")
                    driver.execute("PRAGMA foreign_keys=ON")

    def translate(self, error: Exception) -> StoreError:
        """Translate an error of sqlite3."""
        text, label = str(error), self.label
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL):
            return StoreBusyError(
                f"{label}: another process held the store for too long ({text}); nothing was "
                "written, try again, or give ?timeout= in seconds"
            )
        if code == sqlite3.SQLITE_FULL:
            return StoreFullError(
                f"{label}: {text}; nothing was written: free space on its disk, or on that of "
                "temporary files, and try again"
            )
        if code == sqlite3.SQLITE_INTERRUPT:
            return StatementTimeoutError(f"{label}: the statement was ended ({text})")
        if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
            return NotADatabaseError(f"{label}: {text}; name an SQLite file, or a new one")
        if code == sqlite3.SQLITE_READONLY:
            return ReadOnlyStoreError(
                f"{label}: the file cannot be written ({text}); check its permissions, and "
                "those of the files -wal and -shm beside it, which got its former ones, or read it "
                "with ?mode=ro, or with ?mode=immutable if not even the folder is writable and "
                "nobody else writes"
            )
        if code in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR):
            return StoreUnreachableError(
                f"{label}: {text}; check the disk, and that the folder exists and may be "
                "written, or read a copy on a read-only medium with ?mode=immutable"
            )
        if text.startswith("no such table"):
            return TableMissingError(f"{label}: {text}")
        if isinstance(error, sqlite3.IntegrityError):
            return StoreIntegrityError(f"{label}: {text}; nothing was written")
        return StoreError(f"{label}: {type(error).__name__}: {text}")
