"""SQLite: embedded, in a file or in memory."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event
from sqlalchemy.pool import QueuePool, StaticPool

from ..errors import (
    ForkedError,
    InvalidUrlError,
    NotADatabaseError,
    ReadOnlyStoreError,
    StoreBusyError,
    StoreError,
    StoreIntegrityError,
    StoreUnreachableError,
    TableMissingError,
)
from .backend import Backend, refuse_unknown_options, url_label
from .query import Query
from .session import Session
from .sqlite_file import WAL_LIMIT, StoreFile
from .sqlite_session import FileSession, MemorySession, Turns
from .sqlite_waiting import FileListener, MemoryListener
from .waiting import Commits, Listener

OPTIONS = {"synchronous", "timeout", "mode"}
BUSY_TIMEOUT = 20.0
# SQLite counts milliseconds in 31 bits.
LONGEST_TIMEOUT = 2_000_000
TURN_TIMEOUT = 20.0
MAX_CONNECTIONS = 64
POOL_SIZE = 8


class SqliteBackend(Backend):
    """An SQLite file, or a store in memory that lives as long as this object."""

    begin_read = "BEGIN"
    begin_write = "BEGIN IMMEDIATE"
    durable = "PRAGMA synchronous=FULL"
    no_roles = (
        "SQLite has no roles; let the file's permissions say who may write, and open it with "
        "?mode=ro where it is only to be read"
    )

    def __init__(self, url: URL) -> None:
        refuse_unknown_options(url, OPTIONS)
        if url.host or url.port or url.username or url.password:
            # Two slashes too few, most likely: it must not become a store in memory unnoticed.
            raise InvalidUrlError(
                f"{url_label(url)}: SQLite has no host; write three slashes before the file, as in "
                "sqlite:///robot.db, and four before an absolute path"
            )
        self.in_memory = url.database in (None, "", ":memory:")
        self.has_one_connection = self.in_memory
        self.turns = Turns()
        self.commits = Commits()
        self._write_lock = threading.Lock()
        self.connections: set[sqlite3.Connection] = set()
        self._idle: list[FileSession] = []
        self._is_torn = False
        self.file = StoreFile(str(url.database), url_label(url))
        super().__init__(url)

    def create_engine(self) -> Engine:
        """Make the engine; its connections leave transactions to us."""
        query = self.url.query
        synchronous = str(query.get("synchronous", "normal")).upper()
        if synchronous not in ("NORMAL", "FULL"):
            raise InvalidUrlError(f"{self.label}: synchronous is 'normal' or 'full'")
        engine = create_engine(
            URL.create("sqlite"),
            creator=self.connect,
            paramstyle="named",
            poolclass=StaticPool if self.in_memory else QueuePool,
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
            self.connections.add(connection)

        @event.listens_for(engine, "close")
        def forget(connection: sqlite3.Connection, _: object) -> None:
            self.connections.discard(connection)

        return engine

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child.

        SQLite keeps for each process which locks it has on a file. A child has only a copy of that
        book, and must close all of the parent's connections before it opens one: else it would
        write without a lock, and lose what it writes. Of a store in memory, it has a copy.
        """
        self._is_torn |= any(thread != threading.get_ident() for thread in self.sessions.values())
        self.turns, self._write_lock = Turns(), threading.Lock()
        self.commits = Commits()
        connections = [] if self._is_torn else [*self.connections]
        for connection in connections:
            if not self.in_memory:
                connection.close()
            elif connection.in_transaction:
                connection.rollback()
        if not self.in_memory:
            self._idle.clear()
            self.connections.clear()
            self.file.forget()
            super().leave_connections()

    def connect(self) -> sqlite3.Connection:
        """Make a connection; who calls this names it in `connections` while it is open."""
        query = self.url.query
        try:
            timeout = float(str(query.get("timeout", BUSY_TIMEOUT)))
        except ValueError:
            timeout = -1
        if not 0 <= timeout <= LONGEST_TIMEOUT:
            raise InvalidUrlError(
                f"{self.label}: timeout is a number of seconds, {LONGEST_TIMEOUT:,} at most"
            )
        name, is_uri = ":memory:" if self.in_memory else self.file.path, False
        if "mode" in query and not self.in_memory:
            mode = str(query["mode"])
            if mode not in ("ro", "immutable"):
                raise InvalidUrlError(f"{self.label}: mode is 'ro' or 'immutable'")
            option = "mode=ro" if mode == "ro" else "immutable=1"
            name, is_uri = f"file:{quote(name)}?{option}", True

        def make() -> sqlite3.Connection:
            # Without an isolation level the driver begins nothing of its own, so that BEGIN,
            # SAVEPOINT and ROLLBACK mean what SQLite says of them.
            return sqlite3.connect(
                name, timeout=timeout, isolation_level=None, check_same_thread=False, uri=is_uri
            )

        return make() if self.in_memory else self.file.open(make)

    def wrap(self, connection: Any) -> Session:
        """Make a session; in memory, wait for this thread's turn."""
        if self.in_memory:
            return MemorySession(self, connection)
        return FileSession(self, connection)

    def keep(self, session: FileSession) -> bool:
        """Keep a session for the next call, if it is of use and not too many are kept.

        Args:
            session: the session.

        Returns:
            Whether it is kept.
        """
        fit = session.is_current and len(self._idle) < POOL_SIZE
        if fit:
            self.sessions.pop(session, None)
            self._idle.append(session)
        return fit

    def close(self) -> None:
        """Close all connections; in memory, wait until no other thread uses the one there is."""
        self.is_closed = True
        idle, self._idle = self._idle, []
        if self.in_memory:
            self._take_turn()
        try:
            super().close()
        finally:
            if self.in_memory:
                self.turns.end()
        for session in idle:
            session.close()
        self.file.forget()
        # Who waits for news of a store in memory is to see that it is gone.
        self.commits.tell()

    def listener(self) -> Listener:
        """Make what looks for changes of the file, or waits for those of the store in memory."""
        return MemoryListener(self) if self.in_memory else FileListener(self)

    def session(self) -> Session:
        """Take a connection; in memory, wait for this thread's turn."""
        if self._is_torn:
            raise ForkedError(
                f"{self.label}: this process was forked while another thread used the store, which "
                "SQLite does not survive; fork at another moment, or use 'spawn' or 'forkserver'"
            )
        if not self.in_memory:
            if self.is_closed:
                self.refuse_closed()
            self.file.check()
            try:
                session = self._idle.pop()
            except IndexError:
                return super().session()
            self.sessions[session] = threading.get_ident()
            return session
        self._take_turn()
        try:
            return super().session()
        except BaseException:
            self.turns.end()
            raise

    def _take_turn(self) -> None:
        if not self.turns.begin(TURN_TIMEOUT):
            raise StoreBusyError(
                f"{self.label}: another thread held the store for over {TURN_TIMEOUT:g} s; "
                "nothing was written, try again"
            )

    def queue(self, knowledge_base: str) -> Hashable:
        """Name the file: it has one queue for all. A store in memory is nobody else's."""
        return self if self.in_memory else os.path.realpath(str(self.url.database))

    def write_lock(self) -> threading.Lock | None:
        """Give the queue of this process's writers: SQLite itself only polls."""
        return None if self.in_memory else self._write_lock

    def renew(self) -> None:
        """Do nothing: the connection to a file is not lost."""

    def exists(self) -> bool:
        """Tell whether the file is there; a store in memory always is."""
        if self.in_memory:
            return True
        try:
            Path(self.file.path).stat()
        except FileNotFoundError:
            return False
        except OSError:
            # SQLite says better what is wrong with it.
            return True
        return True

    def remove(self, mark: Query) -> bool:
        """Remove the file, if nobody else has it open and nothing is stored in it."""
        if self.in_memory or not self.exists():
            return False
        connection = self.connect()
        try:
            connection.execute("PRAGMA busy_timeout=0")
            # This fails while another connection is open, and leaves one file of three.
            connection.execute("PRAGMA journal_mode=DELETE")
            connection.execute("BEGIN EXCLUSIVE")
            if connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone() and (
                connection.execute(mark.text(self.dialect)).fetchone()
            ):
                return False
            Path(str(self.url.database)).resolve().unlink()
        except (sqlite3.Error, OSError):
            return False
        finally:
            connection.close()
        return True

    def is_empty(self, session: Session) -> bool:
        """Tell whether the database has no tables at all."""
        session._execute("SELECT count(*) FROM sqlite_master")
        return bool(session._fetch()[0][0] == 0)

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Give a connection with foreign keys off, for a rebuilt table must not drop its children.

        Yields:
            The connection, in a transaction that holds the store's write lock.
        """
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
                driver.execute("COMMIT")
                if not self.in_memory:
                    self.file.check_committed()
            except self.driver_errors as error:
                raise self.translate(error) from error
            finally:
                if driver.in_transaction:
                    driver.execute("ROLLBACK")
                driver.execute("PRAGMA foreign_keys=ON")

    def translate(self, error: Exception) -> StoreError:
        """Make an error of this library from one of sqlite3."""
        text, label = str(error), self.label
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL):
            return StoreBusyError(
                f"{label}: another process held the store for too long ({text}); nothing was "
                "written, try again, or give ?timeout= in seconds"
            )
        if code in (sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT):
            return NotADatabaseError(f"{label}: {text}; name an SQLite file, or a new one")
        if code == sqlite3.SQLITE_READONLY:
            return ReadOnlyStoreError(
                f"{label}: the file cannot be written ({text}); check its permissions, or read "
                "it with ?mode=ro, or with ?mode=immutable where not even the folder can be "
                "written and nobody else writes"
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

    def translate_connect(self, error: Exception) -> StoreError:
        """Make an error of this library from a failure to open the file."""
        return self.translate(error)
