"""What a dialect has to provide: how to connect, to lock, to insert in bulk and to read errors."""

from __future__ import annotations

import os
import threading
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from sqlalchemy import URL, Connection, Dialect, Engine, PoolProxiedConnection
from sqlalchemy.exc import InvalidRequestError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from ..errors import (
    ClosedError,
    ConnectionLostError,
    InvalidUrlError,
    StoreBusyError,
    StoreError,
    printable,
)
from .query import Query
from .roles import Roles
from .session import Session
from .waiting import Listener


class Backend(ABC):
    """A database that a URL names. Safe to share between threads; it survives a fork.

    Attributes:
        sessions: the sessions that are open, each with the thread that uses it.
        has_answered: whether there is a server that has answered before, and may come back.
        is_closed: whether its connections were closed on purpose, for good.
        has_one_connection: whether all threads take turns on one connection.
        when_forked: what is called in a child process before anything else is done there.
        no_roles: why there are no roles, and what to do instead; None where there are.
        revision_comes_last: whether the row of a revision is written when nothing else of it is to
            be written any more, so that what has such a row is past.
        durable: what makes the commits of a connection survive a power cut from then on.
    """

    has_answered = False
    is_closed = False
    has_one_connection = False
    no_roles: str | None = None
    revision_comes_last = False
    begin_read: str
    begin_write: str
    durable: str

    def __init__(self, url: URL) -> None:
        self.url = url
        self.engine = self.create_engine()
        self.driver_errors: tuple[type[Exception], ...] = (
            self.engine.dialect.loaded_dbapi.Error,
            # A driver refuses text or numbers that its protocol cannot carry before the database
            # sees them.
            UnicodeError,
            OverflowError,
        )
        self.sessions: dict[Session, int] = {}
        self.when_forked: list[Callable[[], None]] = []
        _BACKENDS.add(self)

    @property
    def dialect(self) -> Dialect:
        """The SQLAlchemy dialect, with the driver's parameter style."""
        return self.engine.dialect

    @property
    def label(self) -> str:
        """The URL for messages: without the password, wherever it stands."""
        return url_label(self.url)

    def session(self) -> Session:
        """Take a connection from the pool.

        Returns:
            A session that no other thread uses until it is closed.

        Raises:
            ClosedError: it was closed.
            StoreError: no connection could be made.
        """
        if self.is_closed:
            self.refuse_closed()
        return self.wrap(self.take(self.engine))

    def refuse_closed(self) -> None:
        """Refuse to do anything when it was closed.

        Raises:
            ClosedError: it was.
        """
        if self.is_closed:
            raise ClosedError(
                f"{self.label}: this knowledge base was closed; connect again to go on"
            )

    def take(self, engine: Engine) -> PoolProxiedConnection:
        """Take a connection from a pool.

        Args:
            engine: the engine whose pool it is.

        Returns:
            The connection.

        Raises:
            StoreError: no connection could be made.
        """
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

    @contextmanager
    def open_session(self) -> Iterator[Session]:
        """Take a connection for the length of a `with` block.

        Yields:
            The session.
        """
        session = self.session()
        try:
            yield session
        finally:
            session.close()

    def close(self) -> None:
        """Close all connections, for good."""
        self.is_closed = True
        self.engine.dispose()

    def forked(self) -> None:
        """Begin anew in a child process: the connections are the parent's."""
        self.leave_connections()
        for session in self.sessions:
            session.abandon()
        self.sessions = {}
        for call in self.when_forked:
            call()

    def leave_connections(self) -> None:
        """Leave the connections to the parent process, in its child."""
        self.engine.dispose(close=False)

    def exists(self) -> bool:
        """Tell whether there is a database, where to connect would create it.

        Returns:
            False when a connection would create it.
        """
        return True

    def remove(self, mark: Query) -> bool:
        """Remove the database, if nobody uses it and nothing of the library is stored in it.

        Args:
            mark: what finds a row where something is stored.

        Returns:
            Whether it was removed; a server's database never is.
        """
        return False

    def create_roles(self, knowledge_base: str | None, dry_run: bool) -> Roles:
        """Create the roles of the database, or bring them up to date.

        Args:
            knowledge_base: the knowledge base that three more are limited to; None for none.
            dry_run: whether nothing is to be changed.

        Returns:
            The roles.

        Raises:
            StoreError: the database has no roles, or refused.
        """
        raise StoreError(f"{self.label}: {self.no_roles}")

    @abstractmethod
    def renew(self) -> None:
        """Trust no connection that was made before now, after one was lost."""

    @abstractmethod
    def create_engine(self) -> Engine:
        """Make the engine that the sessions take their connections from."""

    @abstractmethod
    def wrap(self, connection: Any) -> Session:
        """Make a session of a connection of the pool."""

    @abstractmethod
    def translate(self, error: Exception) -> StoreError:
        """Make an error of this library from a driver's.

        Args:
            error: the driver's error.

        Returns:
            The error to raise from it; it says what happened and what to do, without a password.
        """

    @abstractmethod
    def translate_connect(self, error: Exception) -> StoreError:
        """Make an error of this library from a driver's failure to connect."""

    @abstractmethod
    def queue(self, knowledge_base: str) -> Hashable:
        """Name what the writers of a knowledge base wait for: equal names are one queue.

        Args:
            knowledge_base: the knowledge base's name.
        """

    @abstractmethod
    def write_lock(self) -> threading.Lock | None:
        """Give the lock that writers of this process queue on, where the database has no queue."""

    @abstractmethod
    def is_empty(self, session: Session) -> bool:
        """Tell whether the store is new, so that opening it may create the tables."""

    @abstractmethod
    def listener(self) -> Listener:
        """Make what waits for news, for one thread; it is to be closed."""

    @abstractmethod
    def migration_connection(self) -> AbstractContextManager[Connection]:
        """Give a connection on which migrations run, alone and in one transaction."""


_BACKENDS: weakref.WeakSet[Backend] = weakref.WeakSet()


def _in_child() -> None:
    for backend in list(_BACKENDS):
        backend.forked()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


def url_label(url: URL) -> str:
    """Give a URL for messages: without the password, wherever it stands.

    Args:
        url: the URL.

    Returns:
        Its text.
    """
    hidden = {key: "..." for key in url.query if "pass" in key.lower()}
    return printable(url.update_query_dict(hidden).render_as_string(hide_password=True))


def refuse_unknown_options(url: URL, known: set[str]) -> None:
    """Refuse a URL with options that its family does not know.

    Args:
        url: the URL.
        known: the options that it knows.

    Raises:
        InvalidUrlError: there is another.
    """
    unknown = sorted(set(url.query) - known)
    if unknown:
        raise InvalidUrlError(
            f"{url_label(url)}: unknown option {unknown[0]!r}; "
            f"known ones are {', '.join(sorted(known))}"
        )
