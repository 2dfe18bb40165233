"""Few connections for many knowledge bases: turns of writers, and one listener for all watchers."""

from __future__ import annotations

import logging
import selectors
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from weakref import WeakValueDictionary

from .base import Listener, WriterLock

logger = logging.getLogger("kant_sql.postgresql")

# Seconds between polls where LISTEN is not possible.
POLL_PAUSE = 0.1
# SQLSTATE "read-only": LISTEN is not possible on a standby server.
_STANDBY = "25006"
# Seconds for which channels without a watcher stay open: most who watch come back at once.
LINGER = 5.0
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
    """LISTEN is not possible, where or why the text says."""


def why_deaf(error: Exception) -> str | None:
    """Return where LISTEN is not possible, if that is what an error says."""
    if isinstance(error, CannotListenError):
        return str(error)
    return "on a standby" if getattr(error, "sqlstate", None) == _STANDBY else None


def warn_of_polling(label: str, reason: str) -> None:
    """Log that who watches polls."""
    logger.warning("%s: LISTEN is not possible %s; polling every %g s", label, reason, POLL_PAUSE)


class WriterTurns:
    """Makes writers wait without a connection.

    Of the writers of one knowledge base, who would wait for each other in the database, one has a
    connection. All together leave one connection free, on which those with a transaction
    read what is outside of it: otherwise they could wait for each other.
    """

    def __init__(self, connections: int) -> None:
        self._slots = threading.Semaphore(connections - 1)
        self._locks: WeakValueDictionary[str, threading.Lock] = WeakValueDictionary()
        self._guard = threading.Lock()

    def of(self, knowledge_base: str) -> WriterLock:
        """Return the lock of the writers of a knowledge base, for one of them."""
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

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Wait for both; return whether they came in time."""
        deadline = time.monotonic() + timeout
        if not self._lock.acquire(blocking, timeout):
            return False
        left = max(0.0, deadline - time.monotonic()) if timeout >= 0 else None
        if self._slots.acquire(blocking, left):
            return True
        self._lock.release()
        return False

    def release(self) -> None:
        """Release both."""
        self._slots.release()
        self._lock.release()


class _Channel:
    """What is heard of one knowledge base.

    Attributes:
        watchers: how many wait for it.
        is_heard: whether the server notifies of it already.
        error: the driver's error that ended it.
    """

    def __init__(self) -> None:
        self.watchers = 0
        self.is_heard = False
        self.error: Exception | None = None
        self._number = 0
        self._changed = threading.Condition()

    def tell(self) -> None:
        """Note a notification, and wake all watchers."""
        with self._changed:
            self._number += 1
            self._changed.notify_all()

    def hear(self) -> None:
        """Note that it is listened to."""
        self.is_heard = True
        self.tell()

    def fail(self, error: Exception | None) -> None:
        """End it, with an error if it was not ended on purpose."""
        self.is_heard, self.error = False, error
        self.tell()

    def wait(self, seen: int | None, seconds: float) -> int | None:
        """Wait for a notification after what was seen, or until it is listened to.

        Returns what was seen now; None while it is not listened to.
        """
        with self._changed:
            if self.is_heard and seen is None:
                return self._number
            if self.error is not None:
                return None
            before = self._number if seen is None else seen
            self._changed.wait_for(lambda: self._number != before, seconds)
            return self._number if self.is_heard else None


class Ear:
    """A thread with one connection, which listens for all watchers of a process.

    It ends when nobody has watched for a while, or when the connection is lost.
    """

    def __init__(self, connect: Callable[[], Any]) -> None:
        self._connect = connect
        self._channels: dict[int, _Channel] = {}
        self._lock = threading.Lock()
        self._is_over = False
        self._waking, self._woken = socket.socketpair()
        for end in (self._waking, self._woken):
            end.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="kant_sql listener", daemon=True)

    def start(self, kb_id: int) -> _Channel:
        """Begin to listen, for a first watcher."""
        # There before the thread, which may end at once: the channel says why.
        first = self._channels[kb_id] = _Channel()
        first.watchers = 1
        self._thread.start()
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

    def close(self) -> None:
        """End it, and wait for its thread."""
        with self._lock:
            self._is_over = True
        self._wake()
        if self._thread is not threading.current_thread():
            self._thread.join(_END_TIMEOUT)

    def forget(self) -> None:
        """Leave it to the parent process, in its child."""
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
            pooled = self._connect()
            self._serve(pooled.driver_connection)
            # Otherwise the server queues notifications for it.
            pooled.driver_connection.execute("UNLISTEN *")
        except Exception as failure:
            # Those who wait raise it.
            error = failure
        finally:
            self._end(error)
            if pooled is not None:
                (pooled.close if error is None else pooled.invalidate)()

    def _end(self, error: Exception | None) -> None:
        with self._lock:
            self._is_over = True
            channels = [*self._channels.values()]
        for each in channels:
            each.fail(error)
        self.forget()

    def _serve(self, connection: Any) -> None:
        with Selector() as selector:
            selector.register(connection, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while self._listen(connection):
                # Before waiting: some may have come with the answer to LISTEN.
                for notice in connection.notifies(timeout=0):
                    self._tell(notice.channel)
                if not selector.select(LINGER):
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
        with self._lock:
            unwatched = [id_ for id_, each in self._channels.items() if not each.watchers]
            for id_ in unwatched:
                del self._channels[id_]
            self._is_over = not self._channels
        if unwatched:
            connection.execute("; ".join(f"UNLISTEN {channel(id_)}" for id_ in unwatched))

    def _tell(self, name: str) -> None:
        with self._lock:
            found = self._channels.get(int(name.removeprefix(channel(0)[:-1])))
        if found is not None:
            found.tell()


class Ears:
    """The ear of a process: it is made when somebody watches, and again after it has ended."""

    def __init__(self, connect: Callable[[], Any]) -> None:
        self._connect = connect
        self._ear: Ear | None = None
        self._lock = threading.Lock()
        self.is_deaf = False

    def join(self, kb_id: int) -> tuple[Ear, _Channel]:
        """Begin to watch a knowledge base."""
        with self._lock:
            found = None if self._ear is None else self._ear.join(kb_id)
            if self._ear is None or found is None:
                self._ear = Ear(self._connect)
                found = self._ear.start(kb_id)
            return self._ear, found

    def become_deaf(self) -> bool:
        """Note that LISTEN is not possible; return whether that is new."""
        with self._lock:
            is_new, self.is_deaf = not self.is_deaf, True
        return is_new

    def close(self) -> None:
        """End the thread."""
        with self._lock:
            ear, self._ear = self._ear, None
        if ear is not None:
            ear.close()

    def forked(self) -> None:
        """Leave the thread and its connection to the parent process, in its child."""
        self._lock = threading.Lock()
        ear, self._ear = self._ear, None
        if ear is not None:
            ear.forget()


class SharedListener(Listener):
    """Waits for what the ear of the process hears of one knowledge base."""

    def __init__(self, ears: Ears, label: str, raising: Callable[[Exception], Exception]) -> None:
        self._ears = ears
        self._label = label
        self._raising = raising
        self._joined: tuple[Ear, _Channel] | None = None
        self._seen: int | None = None

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a notification; the first call begins to listen."""
        if kb_id is None or self._ears.is_deaf:
            # There is no channel yet, or LISTEN is not possible.
            time.sleep(min(POLL_PAUSE, seconds))
            return
        if self._joined is None:
            self._joined = self._ears.join(kb_id)
        watched = self._joined[1]
        self._seen = watched.wait(self._seen, seconds)
        if self._seen is None and watched.error is not None:
            self._fail(watched.error)

    def _fail(self, error: Exception) -> None:
        self.close()
        reason = why_deaf(error)
        if reason is None:
            raise self._raising(error) from error
        if self._ears.become_deaf():
            warn_of_polling(self._label, reason)

    def close(self) -> None:
        """Stop watching; the ear listens on for a while."""
        joined, self._joined, self._seen = self._joined, None, None
        if joined is not None:
            ear, watched = joined
            ear.leave(watched)
