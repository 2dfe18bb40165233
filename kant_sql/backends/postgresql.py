"""PostgreSQL, by psycopg 3."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import quote, quote_plus

from sqlalchemy import Connection, CursorResult, Engine, create_engine, event
from sqlalchemy.exc import DBAPIError, DisconnectionError
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
from .postgresql_locks import holders, lock_schema
from .postgresql_roles import make_roles
from .postgresql_session import PostgresqlSession, read_all_times
from .postgresql_waiting import PostgresqlListener
from .roles import Roles
from .session import Session
from .waiting import Listener

LOCK_TIMEOUT = "20s"
CONNECT_TIMEOUT = "10"
POOL_SIZE, MAX_CONNECTIONS = 8, 64
# A lock that was not had in time, a deadlock, or a table that was made or dropped meanwhile.
_IN_THE_WAY = frozenset({"55P03", "40P01", "23505", "42P07"})
_REFUSED = re.compile('authentication failed|no password|role ".*" (does not|is not)|pg_hba.conf')


class PostgresqlBackend(Backend):
    """A PostgreSQL database.

    Attributes:
        listening: makes the connections of those who wait for news.
    """

    listening: Engine
    begin_read = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"
    begin_write = "BEGIN ISOLATION LEVEL READ COMMITTED"
    durable = (
        "SELECT set_config('synchronous_commit', 'on', false) "
        "WHERE current_setting('synchronous_commit') = 'off'"
    )
    # What row policies let a writer do ends with it.
    revision_comes_last = True
    _lost_at = 0.0

    def create_engine(self) -> Engine:
        """Make the engine; its connections leave transactions to us."""
        # Who waits for news must not keep a connection from who works.
        self.listening = self._create_pool(1, -1)
        return self._create_pool(POOL_SIZE, MAX_CONNECTIONS - POOL_SIZE)

    def _create_pool(self, size: int, overflow: int) -> Engine:
        engine = self._engine(
            poolclass=QueuePool,
            pool_reset_on_return=None,
            pool_size=size,
            max_overflow=overflow,
            # As in `create_pool_from_url`: SQLAlchemy would greet the server with five statements
            # whose answers only reflection and literals need, and a migration has its own engine.
            _initialize=False,
        )

        @event.listens_for(engine, "connect")
        def configure(connection: Any, record: Any) -> None:
            record.info["made_at"] = time.monotonic()
            connection.autocommit = True
            connection.execute(f"SET lock_timeout = '{LOCK_TIMEOUT}'")
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
        """Make what waits for notifications."""
        return PostgresqlListener(self)

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

    def queue(self, knowledge_base: str) -> Hashable:
        """Name the row of the head."""
        url = self.url
        hosts = tuple(str(url.query.get(key, "")) for key in ("host", "port", "dbname"))
        return (url.host, url.port, url.database, hosts, knowledge_base)

    def write_lock(self) -> threading.Lock | None:
        """Give none: the server queues writers on the head's row."""
        return None

    def is_empty(self, session: Session) -> bool:
        """Say no: on a server nothing is created without being asked for."""
        return False

    @contextmanager
    def migration_connection(self) -> Iterator[Connection]:
        """Give a connection that holds the lock of all who change the schema of this database.

        Yields:
            The connection, in a transaction; it waits for a table only briefly.

        Raises:
            StoreBusyError: somebody keeps a table locked; the message says who.
        """
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
        """Make the error for a table that somebody keeps locked, or a schema that is in change."""
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
        """Create the roles by grants and row policies, or bring them up to date."""
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
