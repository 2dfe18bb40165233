"""Shared connections: poolers, turns of writers, and one listener for all watchers.

A pooler in transaction mode, such as PgBouncer, gives a client one of the server's connections for
each transaction. So session settings (SET, LISTEN, PREPARE) reach the next client of that
connection, and are lost to the client itself. Sessions through a pooler set everything for one
transaction.
"""

from __future__ import annotations

import logging
import math
import selectors
import socket
import threading
import time
from contextlib import suppress
from enum import Enum
from typing import Any, Protocol
from weakref import WeakValueDictionary

from sqlalchemy import URL

from ...errors import InvalidUrlError
from .base import Commits, Listener, WriterLock, url_label

# The option of a URL about a pooler.
OPTION = "pooler"
# The key in a connection's record of whether a pooler answers.
IS_POOLED = "is_pooled"


class Pooler(Enum):
    """The option of a URL about a pooler; without it, each connection detects one."""

    UNKNOWN = ""
    SESSION = "session"
    TRANSACTION = "transaction"


def read_pooler(url: URL) -> Pooler:
    """Read the option of a URL about a pooler."""
    value = url.query.get(OPTION, "")
    try:
        pooler = Pooler(value)
    except ValueError:
        raise InvalidUrlError(
            f"{url_label(url)}: {OPTION}={value} is unknown; write {OPTION}=transaction for a "
            f"pooler that gives a connection for a transaction, or {OPTION}=session"
        ) from None
    if pooler is Pooler.TRANSACTION and "options" in url.query:
        raise InvalidUrlError(
            f"{url_label(url)}: options= are of a session, which {OPTION}=transaction has "
            "not; use ALTER ROLE ... SET or ALTER DATABASE ... SET on the server"
        )
    return pooler


def settle(connection: Any, pooler: Pooler, settings: dict[str, str]) -> bool:
    """Set up a new connection; return whether each transaction may get another session."""
    if pooler is not Pooler.TRANSACTION:
        calls = ", ".join(
            f"set_config('{key}', '{value}', false)" for key, value in settings.items()
        )
        # One statement detects and sets: settings of a pooled session reach other clients. A pooler
        # invents the process number, which is half of the key to cancel a statement.
        is_direct = f"pg_backend_pid() = {connection.info.backend_pid:d}"
        where = "" if pooler is Pooler.SESSION else f" WHERE {is_direct}"
        if connection.execute(f"SELECT {calls}{where}").fetchone() is not None:
            return False
    # Another client would find this one's prepared statements, under the same names.
    connection.prepare_threshold = None
    return True


def local(settings: dict[str, str]) -> str:
    """Write the statements that set options for one transaction."""
    return "".join(f"; SET LOCAL {key} = '{value}'" for key, value in settings.items())


logger = logging.getLogger("kant_sql.postgresql")

# Seconds between polls if LISTEN is not possible.
POLL_PAUSE = 0.1
# SQLSTATE "read-only": LISTEN is not possible on a standby server.
_STANDBY = "25006"
# Seconds that channels without a watcher stay open: most watchers come back at once.
LINGER = 5.0
# Seconds until LISTEN is tried again on a standby, which may have been promoted meanwhile.
STANDBY_FOR = 60.0
# Seconds that closing waits for the thread of a listener.
_END_TIMEOUT = 5.0
# It has no file descriptor that the child of a fork would keep open.
Selector: type[selectors.BaseSelector] = getattr(
    selectors, "PollSelector", selectors.SelectSelector
)


def channel(kb_id: int) -> str:
    """Return the notification channel of a knowledge base."""
    return f"kant_sql_{kb_id:d}"


class CannotListenError(Exception):
    """LISTEN is not possible; the text says where or why."""


class ListeningBackend(Protocol):
    """The source of connections for listeners."""

    is_closed: bool

    @property
    def label(self) -> str:
        """Its name in messages."""

    def refuse_closed(self) -> None:
        """Raise when it is closed."""

    def take_listening(self) -> Any:
        """Take a connection that can listen."""

    def listening_failed(self, error: Exception) -> None:
        """Distrust the other connections, if the one that listened was lost."""

    def heard(self, error: Exception) -> Exception:
        """Translate the error of a listener, for one of those who wait."""


class ListenPause:
    """The pause before LISTEN is tried again."""

    def __init__(self, backend: ListeningBackend) -> None:
        self._backend = backend
        self._until = -math.inf
        self._is_known = False
        self._lock = threading.Lock()

    @property
    def is_over(self) -> bool:
        """Whether to try LISTEN."""
        return time.monotonic() >= self._until

    def explains(self, error: Exception) -> bool:
        """Return whether an error says that LISTEN is not possible, and note it."""
        if isinstance(error, CannotListenError):
            reason, seconds = str(error), math.inf
        elif getattr(error, "sqlstate", None) == _STANDBY:
            reason, seconds = "on a standby", STANDBY_FOR
        else:
            return False
        with self._lock:
            is_new, self._is_known = not self._is_known, True
            self._until = time.monotonic() + seconds
        if is_new:
            label = self._backend.label
            logger.warning(
                "%s: LISTEN is not possible %s; polling every %g s", label, reason, POLL_PAUSE
            )
        return True


class WriterTurns:
    """Lets writers wait without a connection.

    Only one of the writers of a knowledge base has a connection: the others would wait for it in
    the database. All writers together leave one connection free, for reads outside of their
    transactions: otherwise they could wait for each other.
    """

    def __init__(self, connections: int) -> None:
        self._slots = threading.Semaphore(connections - 1)
        self._locks: WeakValueDictionary[str, threading.Lock] = WeakValueDictionary()
        self._guard = threading.Lock()

    def of(self, knowledge_base: str) -> WriterLock:
        """Return the lock of a knowledge base's writers, for one writer."""
        with self._guard:
            lock = self._locks.get(knowledge_base)
            if lock is None:
                lock = self._locks[knowledge_base] = threading.Lock()
        return _Turn(lock, self._slots)


class _Turn:
    """The lock of a knowledge base, and one of the places for writers."""

    def __init__(self, lock: threading.Lock, slots: threading.Semaphore) -> None:
        self._lock = lock
        self._slots = slots

    def acquire(self, *, timeout: float) -> bool:
        """Wait for both; return whether they came in time."""
        deadline = time.monotonic() + timeout
        if not self._lock.acquire(timeout=timeout):
            return False
        if self._slots.acquire(timeout=max(0.0, deadline - time.monotonic())):
            return True
        self._lock.release()
        return False

    def release(self) -> None:
        """Release both."""
        self._slots.release()
        self._lock.release()


class _Channel(Commits):
    """The notifications about one knowledge base.

    `is_heard`: the server already notifies about it; `error`: the driver's error that ended it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.watchers = 0
        self.left_at = math.inf
        self.is_heard = False
        self.error: Exception | None = None

    def is_left(self, now: float) -> bool:
        """Whether nobody has watched it for a while."""
        return not self.watchers and now - self.left_at >= LINGER

    def hear(self) -> None:
        """Note that listening has begun."""
        self.is_heard = True
        self.notify()

    def fail(self, error: Exception | None) -> None:
        """End it, with an error if it was not ended on purpose."""
        self.is_heard, self.error = False, error
        self.notify()

    def wait_to_hear(self, seen: int | None, seconds: float) -> int | None:
        """Wait for a notification after the last seen one, or until listening begins.

        Returns the number of the last notification; None before listening begins.
        """
        before = self._number if seen is None else seen
        if self.is_heard and seen is None:
            return before
        if self.error is not None:
            return None
        number = self.wait(before, seconds)
        return number if self.is_heard else None


class ListenerThread:
    """A thread with one connection, which listens for all watchers of a process.

    It ends when nobody has watched for a while, or when the connection is lost.
    """

    def __init__(self, backend: ListeningBackend) -> None:
        self._backend = backend
        self._channels: dict[int, _Channel] = {}
        self._lock = threading.Lock()
        self._is_over = False
        self._look_at = time.monotonic() + LINGER
        self._waking, self._woken = socket.socketpair()
        for end in (self._waking, self._woken):
            end.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="kant_sql listener", daemon=True)

    def start(self, kb_id: int) -> _Channel:
        """Begin to listen, for a first watcher."""
        # There before the thread, which may end at once: the channel says why.
        first = self._channels[kb_id] = _Channel()
        first.watchers = 1
        try:
            self._thread.start()
        except BaseException:
            self.close_sockets()
            raise
        return first

    def join(self, kb_id: int) -> _Channel | None:
        """Begin to watch a knowledge base; None when it has ended."""
        with self._lock:
            if self._is_over:
                return None
            found = self._channels.setdefault(kb_id, _Channel())
            found.watchers += 1
            is_heard = found.is_heard
        if not is_heard:
            self._wake()
        return found

    def leave(self, watched: _Channel) -> None:
        """Stop watching."""
        with self._lock:
            watched.watchers -= 1
            watched.left_at = time.monotonic()

    def close(self) -> None:
        """End it, and wait for its thread."""
        with self._lock:
            self._is_over = True
        self._wake()
        if self._thread is not threading.current_thread():
            self._thread.join(_END_TIMEOUT)

    def close_sockets(self) -> None:
        """Close the sockets that wake it, when it has ended or is the parent process's."""
        self._waking.close()
        self._woken.close()

    def _wake(self) -> None:
        # A full buffer wakes as well; a closed one has nobody to wake.
        with suppress(OSError):
            self._waking.send(b"\0")

    def _run(self) -> None:
        error: Exception | None = None
        pooled: Any = None
        try:
            pooled = self._backend.take_listening()
            self._serve(pooled.driver_connection)
            # Otherwise the server queues notifications for it.
            pooled.driver_connection.execute("UNLISTEN *")
        except Exception as failure:
            # Those who wait raise it.
            error = failure
            self._backend.listening_failed(failure)
        finally:
            try:
                if pooled is not None:
                    is_of_use = error is None and not self._backend.is_closed
                    (pooled.close if is_of_use else pooled.invalidate)()
            finally:
                self._end(error)

    def _end(self, error: Exception | None) -> None:
        with self._lock:
            self._is_over = True
            channels = [*self._channels.values()]
        for each in channels:
            each.fail(error)
        self.close_sockets()

    def _serve(self, connection: Any) -> None:
        with Selector() as selector:
            selector.register(connection, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while self._listen(connection):
                # Before waiting: some notifications may have come with the answer to LISTEN.
                for notice in connection.notifies(timeout=0):
                    self._tell(notice.channel)
                selector.select(max(0.0, self._look_at - time.monotonic()))
                if time.monotonic() >= self._look_at:
                    self._forget_unwatched(connection)
                with suppress(BlockingIOError):
                    self._woken.recv(4096)

    def _listen(self, connection: Any) -> bool:
        """Listen to the new channels; return whether to go on."""
        with self._lock:
            if self._is_over:
                return False
            new = {id_: each for id_, each in self._channels.items() if not each.is_heard}
        if new:
            connection.execute("; ".join(f"LISTEN {channel(id_)}" for id_ in new))
            for each in new.values():
                each.hear()
        return True

    def _forget_unwatched(self, connection: Any) -> None:
        """Stop listening to channels whose last watcher left a while ago.

        With none left, it ends.
        """
        now = time.monotonic()
        self._look_at = now + LINGER
        with self._lock:
            unwatched = [id_ for id_, each in self._channels.items() if each.is_left(now)]
            for id_ in unwatched:
                del self._channels[id_]
            # It may have been closed just before.
            self._is_over = self._is_over or not self._channels
        if unwatched:
            connection.execute("; ".join(f"UNLISTEN {channel(id_)}" for id_ in unwatched))

    def _tell(self, name: str) -> None:
        with self._lock:
            found = self._channels.get(int(name.removeprefix(channel(0)[:-1])))
        if found is not None:
            found.notify()


class SharedListening:
    """The listener thread of a process, started on demand."""

    def __init__(self, backend: ListeningBackend) -> None:
        self.backend = backend
        self.pause = ListenPause(backend)
        self._current: ListenerThread | None = None
        self._lock = threading.Lock()

    def join(self, kb_id: int) -> tuple[ListenerThread, _Channel]:
        """Begin to watch a knowledge base."""
        with self._lock:
            # A closed backend ends the thread afterwards, under this lock: no later one stays.
            self.backend.refuse_closed()
            if self._current is not None:
                found = self._current.join(kb_id)
                if found is not None:
                    return self._current, found
            thread = ListenerThread(self.backend)
            first = thread.start(kb_id)
            # Only now: nobody may join one whose thread could not be started.
            self._current = thread
            return thread, first

    def close(self) -> None:
        """End the thread, after the line was closed."""
        with self._lock:
            thread, self._current = self._current, None
        if thread is not None:
            thread.close()

    def forked(self) -> None:
        """Leave the thread and its connection to the parent process, in its child."""
        self._lock, self.pause = threading.Lock(), ListenPause(self.backend)
        thread, self._current = self._current, None
        if thread is not None:
            thread.close_sockets()


class PostgresqlListener(Listener):
    """Waits for notifications about one knowledge base from the process's thread."""

    def __init__(self, shared: SharedListening) -> None:
        self._shared = shared
        self._joined: tuple[ListenerThread, _Channel] | None = None
        self._seen: int | None = None

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a notification; the first call begins to listen."""
        if kb_id is None or not self._shared.pause.is_over:
            # There is no channel yet, or LISTEN is not possible.
            time.sleep(min(POLL_PAUSE, seconds))
            return
        if self._joined is None:
            self._joined = self._join(kb_id)
        watched = self._joined[1]
        self._seen = watched.wait_to_hear(self._seen, seconds)
        if self._seen is None and watched.error is not None:
            self._fail(watched.error)

    def _join(self, kb_id: int) -> tuple[ListenerThread, _Channel]:
        try:
            return self._shared.join(kb_id)
        except RuntimeError as error:
            # No further thread can be started.
            raise self._shared.backend.heard(error) from error

    def _fail(self, error: Exception) -> None:
        self.close()
        if not self._shared.pause.explains(error):
            raise self._shared.backend.heard(error) from error

    def close(self) -> None:
        """Stop watching; the thread listens on for a while."""
        joined, self._joined, self._seen = self._joined, None, None
        if joined is not None:
            thread, watched = joined
            thread.leave(watched)
