"""The interface of a dialect: connections, sessions, locks, inserts, errors, notifications."""

from __future__ import annotations

import logging
import os
import random
import shlex
import threading
import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from datetime import UTC, datetime
from math import isinf
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

from sqlalchemy import URL, Connection, Dialect, Engine, PoolProxiedConnection, Table
from sqlalchemy.engine.interfaces import DBAPICursor
from sqlalchemy.exc import InvalidRequestError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from ...errors import (
    ClosedError,
    ConnectionLostError,
    ForkedError,
    InvalidArgumentError,
    InvalidUrlError,
    QuestionCancelledError,
    StatementTimeoutError,
    StoreBusyError,
    StoreError,
    StoreUnreachableError,
    printable,
)
from ...limits import LIMIT, PATIENCE, GuardedCursor, Limit, StatementGuard
from ..query import IdsQuery, Insert, Query, insert_text, raw
from .structure import IndexFault, Statement, ViewDialect
from .words import RAW, NestedLoops, Words

Row = tuple[Any, ...]


class Overlay(Protocol):
    """Replaces some tables in the statements of a session.

    Attributes:
        oldest: the first revision that it reads.
    """

    oldest: int

    def text(self, sql: str, dialect: Dialect, words: Words) -> str:
        """Replace the tables that a statement names."""

    def parameters(self, session: Session) -> dict[str, Any]:
        """Return the additional parameters."""


class AbandonedCursor:
    """The cursor of a session whose connection belongs to the parent process."""

    def __getattr__(self, name: str) -> Any:
        raise ForkedError(
            "this process was forked within a transaction of its parent, and writes nothing of it; "
            "begin another one"
        )


class Roles(NamedTuple):
    """Four roles; users get their rights as members.

    Attributes:
        writer: the role that adds revisions and cannot change past ones; None for distributed
            tables.
        reader: the role that reads tables and views.
        auditor: the role that reads views.
        eraser: the role that may write and erase; None without a writer.
        schema: the schema of the auditor's views, if it is not that of the tables.
        knowledge_base: the knowledge base that they are limited to; None for all.
        statements: the SQL that creates or updates them.
        remaining: the SQL that revokes rights from PUBLIC that these roles must not have, for
            somebody with more rights than the caller.
    """

    writer: str | None
    reader: str
    auditor: str
    eraser: str | None
    schema: str | None
    knowledge_base: str | None
    statements: tuple[str, ...] = ()
    remaining: tuple[str, ...] = ()


T = TypeVar("T")


class Listener(ABC):
    """Waits for commits to a store, by any process. One thread uses it."""

    @abstractmethod
    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait until something may have been committed since the last call.

        The first call only begins to listen, so read after each call. A wait may end without a
        commit.
        """

    def guarded(self, work: Callable[[], T]) -> T:
        """Run a read; a fork of this process waits for it."""
        return work()

    @abstractmethod
    def close(self) -> None:
        """Stop listening."""


class WriterLock(Protocol):
    """The lock that writers of this process wait for before they take a connection."""

    def acquire(self, *, timeout: float) -> bool:
        """Wait for a turn; return whether it came in time."""

    def release(self) -> None:
        """End a turn, in any thread."""


class Shared(Protocol):
    """An object that the threads of a process share."""

    def forked(self) -> None:
        """Start over in a forked child process."""


class Commits:
    """Counts commits, for the threads of this process that wait for the next one."""

    def __init__(self) -> None:
        self._number = self._waiting = 0
        # Entered itself: a condition takes two more calls, with each commit in memory.
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)

    def notify(self) -> None:
        """Wake all waiting threads."""
        with self._lock:
            self._number += 1
            if self._waiting:
                self._changed.notify_all()

    def wait(self, seen: int | None, seconds: float) -> int:
        """Wait for a commit after the number that an earlier call returned."""
        with self._lock:
            self._waiting += 1
            try:
                self._changed.wait_for(lambda: self._number != seen, seconds)
            finally:
                self._waiting -= 1
            return self._number


# Logs every statement at DEBUG; the tests count them here.
statement_log = logging.getLogger("kant_sql.sql")
if statement_log.level == logging.NOTSET:
    # Otherwise a program that sets the root logger to DEBUG, or to NOTSET, gets each statement: on
    # a store in memory, a save took 2.7 times as long. The loggers of pools are below this one, and
    # at INFO they would log each connection although the root's level silences them.
    statement_log.setLevel(logging.WARNING)

LONGEST_LOGGED = 200


# Rows per INSERT statement: drivers take longer to run one for each row.
FEW_ROWS = 4


class Session(ABC):
    """A database connection that one thread uses for one transaction at a time.

    It translates driver errors to those of `kant_sql.errors`, raised from the driver's.

    Attributes:
        backend: the database.
        keeps_limit: whether the connection keeps a question's limit until it gets another.
        is_abandoned: whether the connection belongs to the parent process, after a fork.
        is_logged: whether to log its statements; read once for each use.
        overlay: replaces some tables in its statements; None for the tables.
    """

    placeholder = "?"
    keeps_limit = False
    overlay: Overlay | None = None

    def __init__(self, backend: Backend, connection: PoolProxiedConnection) -> None:
        self.backend = backend
        self._pooled = connection
        self._pool = backend.engine.pool
        self._cursor: DBAPICursor = connection.cursor()
        self._dialect = backend.dialect
        self.is_logged = statement_log.isEnabledFor(logging.DEBUG)
        self._savepoints = 0
        self._guard: StatementGuard | None = None
        self.is_abandoned = False
        backend.sessions[self] = threading.get_ident()

    def obey(self, limit: Limit | None) -> None:
        """Apply a limit, until the transaction is rolled back or the session ends.

        None means no limit.
        """
        if limit is not None:
            guard = self._guard = StatementGuard(limit, self._cursor, self._stop)
            self._cursor = GuardedCursor(self._cursor, guard)
            guard.join()

    def _end_limit(self) -> None:
        """End the limit; after this returns, nothing is stopped."""
        guard = self._guard
        if guard is not None:
            self._guard = None
            guard.leave()
            if not self.is_abandoned:
                self._cursor = guard.cursor
                self._unlimited(guard)

    @abstractmethod
    def _unlimited(self, guard: StatementGuard) -> None:
        """Clear the connection after the end of a limit."""

    def _guarded(self, cursor: Any) -> Any:
        """Apply the limit, if any, to another cursor of this connection."""
        return cursor if self._guard is None else GuardedCursor(cursor, self._guard)

    @property
    def words(self) -> Words:
        """The words of generated conditions for the tables or the overlay."""
        words = self.backend.words
        return words if self.overlay is None else words._replace(is_one_state=True)

    @property
    def loops(self) -> NestedLoops:
        """The words of joins in a fixed order."""
        return self.backend.words.loops

    @contextmanager
    def overlaid(self, overlay: Overlay) -> Iterator[None]:
        """Apply an overlay to the statements of a `with` block."""
        self.overlay = overlay
        try:
            yield
        finally:
            self.overlay = None

    def for_driver(self, sql: str, parameters: Any) -> tuple[str, Any]:
        """Return a statement and its parameters as the overlay, if any, has them."""
        if self.overlay is not None:
            given, sql = sql, self.overlay.text(sql, self._dialect, self.backend.words)
            if sql != given or RAW in sql:
                parameters = {**dict(parameters), **self.overlay.parameters(self)}
        return sql, parameters

    @abstractmethod
    def _stop(self) -> None:
        """Ask the database to end the running statement; another thread calls this."""

    def rows(self, query: Query, **parameters: Any) -> list[Row]:
        """Run a query and fetch all rows."""
        self._execute(query, parameters)
        return self._fetch()

    def first(self, query: Query, **parameters: Any) -> Row | None:
        """Run a query and fetch its first row."""
        self._execute(query, parameters)
        rows = self._fetch()
        return rows[0] if rows else None

    def run(self, query: Query, **parameters: Any) -> int:
        """Run a statement without rows; return the number of changed rows."""
        self._execute(query, parameters)
        return self._cursor.rowcount

    def run_many(self, query: Query, parameters: Sequence[dict[str, Any]]) -> int:
        """Run a statement for each set of parameters."""
        if len(parameters) == 1:
            return self.run(query, **parameters[0])
        if parameters:
            self._execute_many(query.text(self._dialect), parameters)
            return self._cursor.rowcount
        return 0

    def run_for(self, query: IdsQuery, ids: Sequence[int], **parameters: Any) -> None:
        """Run a statement for each id."""
        self.run_many(query.each, [{"id": id_, **parameters} for id_ in ids])

    def define(self, statement: str) -> None:
        """Run a DDL statement given as text."""
        self._execute(statement)

    def insert(self, into: Insert, rows: Sequence[Row]) -> None:
        """Insert rows."""
        count = len(rows)
        if count == 1:
            self._execute(insert_text(into, self.placeholder), rows[0])
        elif 1 < count <= FEW_ROWS:
            values = [value for row in rows for value in row]
            self._execute(insert_text(into, self.placeholder, count), values)
        elif rows:
            self._execute_many(insert_text(into, self.placeholder), rows)

    def together(self) -> AbstractContextManager[None]:
        """Let a server insert the few rows of a block with one statement."""
        return nullcontext()

    def begin(self, write: bool) -> None:
        """Begin a transaction."""
        self._execute(self.backend.begin_write if write else self.backend.begin_read)

    def commit(self, changed: int | None = None) -> None:
        """Commit the transaction; `changed` is the knowledge base with a new revision."""
        self._commit(changed)

    def _commit(self, changed: int | None) -> None:
        self._execute("COMMIT")

    def rollback(self) -> None:
        """Roll the transaction back; a lost connection has done so itself."""
        self._savepoints = 0
        self._end_limit()
        if not self.is_abandoned and self.in_transaction():
            self._execute("ROLLBACK")

    def savepoint(self) -> str:
        """Set a savepoint."""
        self._savepoints += 1
        name = f"kant_sql_{self._savepoints}"
        self._execute(f"SAVEPOINT {name}")
        return name

    def rollback_to(self, name: str) -> None:
        """Roll back to a savepoint and release it."""
        self._execute(f"ROLLBACK TO SAVEPOINT {name}")
        self.release(name)

    def release(self, name: str) -> None:
        """Release a savepoint."""
        self._execute(f"RELEASE SAVEPOINT {name}")

    @property
    def is_current(self) -> bool:
        """Whether the connection belongs to the current pool and process."""
        backend = self.backend
        return not (self.is_abandoned or backend.is_closed) and self._pool is backend.engine.pool

    def close(self) -> None:
        """Return the connection to the pool."""
        self._end_limit()
        self.backend.sessions.pop(self, None)
        if self.is_current or self.is_abandoned:
            self._pooled.close()
            if not (self.is_current or self.is_abandoned):
                # It was closed at that moment, and would keep the returned connection.
                self._pool.dispose()
        else:
            # The pool was closed while this was in use.
            self._pooled.invalidate()

    def abandon(self) -> None:
        """Stop using the connection, in a forked process: it belongs to the parent."""
        self.is_abandoned = True
        self._cursor = AbandonedCursor()

    def now(self, raw: Any) -> datetime:
        """Read the value of `StoreClock`."""
        return datetime.now(UTC) if raw is None else self.to_time(raw)

    def make_durable(self) -> None:
        """Make later commits of this session survive a power cut."""
        self.define(self.backend.durable)

    def overwrite_deleted(self) -> None:  # noqa: B027 (a server's pages are written again later)
        """Overwrite rows deleted from now on, if the database would leave their bytes."""

    def replan(self) -> None:  # noqa: B027 (only servers cache plans)
        """Discard cached plans before a large write."""

    def planned_now(self) -> AbstractContextManager[None]:
        """Plan statements for the present tables, not for those of their first run."""
        return nullcontext()

    def lock_definitions(self) -> None:  # noqa: B027 (an exclusive transaction needs none)
        """Lock the schema against other changes, in a write transaction."""

    @abstractmethod
    def in_transaction(self) -> bool:
        """Return whether a transaction is open."""

    @abstractmethod
    def stream(self, query: Query, **parameters: Any) -> Iterator[Row]:
        """Run a query and yield its rows in constant memory."""

    @abstractmethod
    def list_value(self, values: Sequence[int] | Sequence[str]) -> Any:
        """Return the driver's form of a list parameter, for `in_list`."""

    @abstractmethod
    def from_time(self, moment: datetime, text: str | None = None) -> Any:
        """Return the driver's form of a time; `text` is its text, if known."""

    @abstractmethod
    def to_time(self, raw: Any) -> datetime:
        """Read the driver's form of a time, in UTC."""

    def rows_of(self, sql: str) -> list[Row]:
        """Run a textual query without parameters."""
        return self.rows(raw(sql))

    @abstractmethod
    def describe(self, names: Collection[str]) -> Iterator[Statement]:
        """Describe some live tables and views, with all that belongs to them."""

    @abstractmethod
    def index_faults(self, tables: Sequence[str]) -> Iterator[IndexFault]:
        """Compare the indexes of some tables with the tables, for all knowledge bases."""

    def wrong_values(self, tables: tuple[Table, ...], kb_id: int) -> Iterator[tuple[str, str, int]]:
        """Count values of a wrong type: table, column and number."""
        # Only for databases without strict types.
        return iter(())

    def plan_for_all(self) -> None:  # noqa: B027 (only cursors of a server need it)
        """Plan streamed queries of this transaction for all rows, not for the first ones."""

    def query_of_view(self, name: str, kb_id: int) -> str | None:
        """Return a query of a view's rows of one knowledge base, if the view is too slow."""
        return None

    def translate(self, error: Exception) -> StoreError:
        """Translate a driver's error; for an ended statement, add the reason."""
        made, guard = self.backend.translate(error), self._guard
        if guard is None or not isinstance(made, StatementTimeoutError):
            return made
        if guard.limit.is_cancelled:
            return QuestionCancelledError(f"{self.backend.label}: this question was cancelled")
        if isinf(guard.limit.seconds):
            return made
        return StatementTimeoutError(
            f"{self.backend.label}: a statement of this question took longer than "
            f"{guard.limit.seconds:g} s and was ended; ask for less, or allow more time"
        )

    def _fetch(self) -> list[Row]:
        try:
            return self._cursor.fetchall()  # type: ignore[return-value]
        except self.backend.driver_errors as error:
            raise self.translate(error) from error

    def _execute(self, statement: str | Query, parameters: Any = ()) -> None:
        sql = statement
        if not isinstance(sql, str):
            sql = sql.texts.get(self._dialect.name) or sql.text(self._dialect)
        if self.overlay is not None:
            sql, parameters = self.for_driver(sql, parameters)
        if self.is_logged:
            self._logged(self._cursor.execute, sql, parameters)
            return
        try:
            self._cursor.execute(sql, parameters)
        except self.backend.driver_errors as error:
            raise self.translate(error) from error

    def _execute_many(self, sql: str, parameters: Sequence[Any]) -> None:
        self._logged(self._cursor.executemany, sql, parameters)

    def _logged(self, execute: Callable[[str, Any], Any], sql: str, parameters: Any) -> None:
        """Run a statement, and log it with its time."""
        started = time.perf_counter()
        try:
            execute(sql, parameters)
        except self.backend.driver_errors as error:
            raise self.translate(error) from error
        finally:
            log_statement(sql, started)


def log_statement(sql: str, started: float) -> None:
    """Log a statement, shortened, without parameters: these are the robot's knowledge."""
    if not statement_log.isEnabledFor(logging.DEBUG):
        return
    took = (time.perf_counter() - started) * 1e3
    text = " ".join(sql.split())
    if len(text) > LONGEST_LOGGED:
        text = f"{text[:LONGEST_LOGGED]}..."
    said = {"sql": sql, "milliseconds": took}
    statement_log.debug("%s (%.3f ms)", printable(text), took, extra=said)


class Backend(ABC):
    """The database of a URL. Threads may share it; it survives a fork.

    Attributes:
        sessions: the open sessions, each with the thread that uses it.
        has_answered: whether a server has answered before, so it may come back.
        is_closed: whether it was closed.
        is_read_only: whether the database refuses all writes of these connections.
        most_connections: the maximum number of connections to a server, besides that of listeners;
            None if the backend decides.
        has_one_connection: whether all threads take turns on one connection.
        sharers: shared objects to reset in a forked child process.
        when_closed: functions to call when it is closed.
        is_server: whether it is a server, which gets credentials.
        patience: seconds that a call waits for another writer.
        no_roles: why there are no roles, and the alternative; None if there are.
        revision_comes_last: whether the row of a revision is written last: with it, row policies
            treat its versions as past.
        durable: the statement that makes later commits of a connection survive a power cut.
        views: writes and finds generated views.
        words: the words of generated conditions.
    """

    has_answered = False
    is_closed = False
    has_one_connection = False
    is_server = False
    patience = PATIENCE
    no_roles: str | None = None
    revision_comes_last = False
    begin_read: str
    begin_write: str
    durable: str
    views: ViewDialect
    words: Words

    def __init__(
        self, url: URL, *, read_only: bool = False, connections: int | None = None
    ) -> None:
        self.url = url
        self.is_read_only = read_only
        self.most_connections = connections
        self.engine = self.create_engine()
        # With the driver's parameter style.
        self.dialect: Dialect = self.engine.dialect
        self.driver_errors: tuple[type[Exception], ...] = (
            self.engine.dialect.loaded_dbapi.Error,
            # A driver refuses text or numbers that its protocol cannot carry.
            UnicodeError,
            OverflowError,
        )
        self.sessions: dict[Session, int] = {}
        self.sharers: weakref.WeakSet[Shared] = weakref.WeakSet()
        self.when_closed: list[Callable[[], None]] = []
        _BACKENDS.add(self)

    @property
    def label(self) -> str:
        """The URL for messages, without passwords."""
        return url_label(self.url)

    @property
    def address(self) -> str:
        """The URL by which this process can open the database again, with its password."""
        return self.url.render_as_string(hide_password=False)

    def copy_to(self, file: Path, progress: Callable[[int, int], None] | None) -> None:
        """Copy the whole database, at one moment, into an empty file."""
        name, given = self.url.get_backend_name(), self.url
        url = URL.create(name, given.username, None, given.host, given.port, given.database)
        command = f"pg_dump --format=custom --file=FILE {shlex.quote(str(url))}"
        raise InvalidArgumentError(
            f"{self.label}: a server is backed up by its own program: {printable(command)}"
        )

    def reader(self) -> Session:
        """Take a connection for questions, under the limit of this context."""
        return self.session(LIMIT.get())

    def session(self, limit: Limit | None = None) -> Session:
        """Take a connection without a limit, for writes and internal reads."""
        if limit is not None:
            limit.check()
        session = self.connected()
        if limit is not None or session.keeps_limit:
            try:
                session.obey(limit)
            except BaseException:
                session.close()
                raise
        return session

    def connected(self) -> Session:
        """Take a connection from the pool."""
        if self.is_closed:
            self.refuse_closed()
        return self.wrap(self.take(self.engine))

    def refuse_closed(self) -> None:
        """Raise if it is closed."""
        if self.is_closed:
            raise self.closed_error()

    def closed_error(self) -> ClosedError:
        """Make the error for a call on a closed store."""
        return ClosedError(f"{self.label}: this knowledge base was closed; connect again")

    def take(self, engine: Engine) -> PoolProxiedConnection:
        """Take a connection from a pool."""
        try:
            return engine.raw_connection()
        except PoolTimeoutError as error:
            raise StoreBusyError(
                f"{self.label}: all connections of this process are in use; close transactions "
                "that wait, or use fewer threads at once"
            ) from error
        except InvalidRequestError as error:
            raise ConnectionLostError(
                f"{self.label}: connections are lost as fast as they are made; nothing was "
                "written, try again"
            ) from error
        except self.driver_errors as error:
            raise self.translate_connect(error) from error

    def open_session(self) -> closing[Session]:
        """Take a connection for the length of a `with` block."""
        return closing(self.session())

    def close(self) -> None:
        """Close all connections, even if closing one raises."""
        self.is_closed = True
        closers, self.when_closed = self.when_closed, []
        with ExitStack() as steps:
            # In reverse order.
            for step in (self.engine.dispose, *closers):
                steps.callback(step)

    def examine_fork(self) -> None:  # noqa: B027 (only some drivers do not survive every fork)
        """Note in a child process whether the database is usable after the fork."""

    def forked(self) -> None:
        """Start over in a child process: the connections belong to the parent."""
        self.leave_connections()
        for session in self.sessions:
            session.abandon()
        self.sessions = {}
        for sharer in self.sharers:
            sharer.forked()

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child."""
        self.engine.dispose(close=False)

    def exists(self) -> bool:
        """Return whether there is a database, if connecting would create it."""
        return True

    def remove(self) -> bool:
        """Remove the database unless it is in use, or has a revision."""
        return False

    def wipe(self) -> tuple[str, ...]:
        """Remove bytes of erased texts; return where some may remain, and how to remove them."""
        return ()

    def create_roles(self, knowledge_base: str | None, dry_run: bool) -> Roles:
        """Create the roles of the database, or update them."""
        raise StoreError(f"{self.label}: {self.no_roles}")

    def layout_fault(self) -> str | None:
        """Return the fault of a store with tables on several servers, or None."""
        return None

    @staticmethod
    def migrating(connection: Connection, label: str) -> AbstractContextManager[None]:
        """Let migrations create tables in the place of the store's."""
        return nullcontext()

    @staticmethod
    def roles_set_aside(connection: Connection) -> AbstractContextManager[None]:
        """Drop policies and views of roles during a migration, and recreate them."""
        return nullcontext()

    def renew(self) -> None:  # noqa: B027 (connections to a file are not lost)
        """Replace existing connections on next use, after one was lost."""

    @abstractmethod
    def create_engine(self) -> Engine:
        """Create the engine with the pool of the sessions."""

    @abstractmethod
    def wrap(self, connection: Any) -> Session:
        """Wrap a connection of the pool."""

    @abstractmethod
    def translate(self, error: Exception) -> StoreError:
        """Translate a driver's error."""

    def translate_connect(self, error: Exception) -> StoreError:
        """Translate a driver's failure to connect."""
        return self.translate(error)

    @abstractmethod
    def queue(self, knowledge_base: str) -> Hashable:
        """Identify the queue of a knowledge base's writers: equal values are one queue."""

    @abstractmethod
    def write_lock(self, knowledge_base: str) -> WriterLock | None:
        """Return the queue of this process's writers of a knowledge base, if any."""

    def is_empty(self, session: Session) -> bool:
        """Return whether the store is new: then opening it creates the tables."""
        # On a server, only an explicit upgrade creates tables.
        return False

    @abstractmethod
    def listener(self) -> Listener:
        """Create a listener for one thread, which closes it."""

    @abstractmethod
    def migration_connection(self) -> AbstractContextManager[Connection]:
        """Open a connection on which migrations run exclusively, in one transaction."""


_BACKENDS: weakref.WeakSet[Backend] = weakref.WeakSet()


def _in_child() -> None:
    backends = list(_BACKENDS)
    # All of them, before the first closes anything: they may share locks of the process.
    for backend in backends:
        backend.examine_fork()
    for backend in backends:
        backend.forked()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


def unforked() -> threading.RLock:
    """Make a lock that a fork of this process waits for, so no child finds it held."""
    lock = threading.RLock()
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(
            before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release
        )
    return lock


# Held while connections are opened or closed, before sessions get them.
NO_FORK = unforked()


def url_label(url: URL) -> str:
    """Return a URL for messages, without passwords."""
    hidden = {key: "..." for key in url.query if "pass" in key.lower()}
    return printable(url.update_query_dict(hidden).render_as_string(hide_password=True))


def refuse_unknown_options(url: URL, known: set[str]) -> None:
    """Refuse a URL with unknown options."""
    unknown = sorted(set(url.query) - known)
    if unknown:
        raise InvalidUrlError(
            f"{url_label(url)}: unknown option {unknown[0]!r}; "
            f"known ones are {', '.join(sorted(known))}"
        )


_retry_logger = logging.getLogger("kant_sql.retry")

# Errors after which the same call may succeed.
PASSING = StoreBusyError, ConnectionLostError, StoreUnreachableError
RETRY_FOR = 10.0
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 0.5


def retrying(backend: Backend, work: Callable[[], T]) -> T:
    """Retry `work` for some seconds while the store is busy or the connection is lost."""
    began = time.monotonic()
    pause = FIRST_PAUSE
    attempt = 0
    while True:
        attempt += 1
        try:
            return work()
        except PASSING as error:
            if isinstance(error, ConnectionLostError):
                # The other connections of the pool are probably lost, too.
                backend.renew()
            elif isinstance(error, StoreUnreachableError) and not backend.has_answered:
                raise
            is_busy = isinstance(error, StoreBusyError)
            most = min(RETRY_FOR, backend.patience) if is_busy else RETRY_FOR
            if time.monotonic() + pause > began + most:
                raise
            _retry_logger.warning(
                "attempt %d failed, trying again: %s", attempt, printable(str(error))
            )
        time.sleep(pause * random.uniform(0.5, 1.5))
        pause = min(2 * pause, LONGEST_PAUSE)
