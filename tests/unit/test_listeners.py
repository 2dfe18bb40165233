"""One listener for all watchers of a process: when it begins, what it forgets, and how it ends."""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from types import SimpleNamespace
from typing import ClassVar, NamedTuple

import pytest

from kant_sql.sql.dialects import postgresql_sharing as sharing
from kant_sql.sql.dialects.postgresql_sharing import (
    LINGER,
    POLL_PAUSE,
    CannotListenError,
    ListenerThread,
    PostgresqlListener,
    SharedListening,
    channel,
)
from tests.support.processes.workers import PATIENCE, wait_for

MOMENT = 0.1


@pytest.fixture(autouse=True)
def no_open_sockets() -> Iterator[None]:
    yield
    while Connection.sockets:
        Connection.sockets.pop().close()


class Notice(NamedTuple):
    """A notification."""

    channel: str


class Connection:
    """A driver's connection that only listens, in a pool of one."""

    sockets: ClassVar[list[socket.socket]] = []

    def __init__(self) -> None:
        self.statements: list[str] = []
        self.returned: list[str] = []
        self._told, self._tell = socket.socketpair()
        self._told.setblocking(False)
        self.sockets.extend((self._told, self._tell))

    @property
    def driver_connection(self) -> Connection:
        return self

    def fileno(self) -> int:
        return self._told.fileno()

    def execute(self, statement: str) -> None:
        self.statements += statement.split("; ")

    def notify(self, kb_id: int) -> None:
        self._tell.send(bytes([kb_id]))

    def notifies(self, timeout: float) -> Iterator[Notice]:
        try:
            yield from (Notice(channel(kb_id)) for kb_id in self._told.recv(100))
        except BlockingIOError:
            return

    def close(self) -> None:
        self.returned.append("close")

    def invalidate(self) -> None:
        self.returned.append("invalidate")


class Line:
    """What gives listeners their connections, or an error."""

    label = "here"

    def __init__(self, *errors: Exception) -> None:
        self.is_closed = False
        self.connection = Connection()
        self.taken_at: list[float] = []
        self.failures: list[Exception] = []
        self._errors = list(errors)

    def refuse_closed(self) -> None:
        if self.is_closed:
            raise ValueError("it was closed")

    def take_listening(self) -> Connection:
        self.taken_at.append(time.monotonic())
        if self._errors:
            raise self._errors.pop(0)
        return self.connection

    def listening_failed(self, error: Exception) -> None:
        self.failures.append(error)

    def heard(self, error: Exception) -> Exception:
        return LookupError(f"translated: {error}")


class Standby(Exception):
    """What the driver raises on a standby."""

    sqlstate = "25006"


def pooled() -> CannotListenError:
    return CannotListenError("on the moon")


def listeners_on(line: Line, number: int = 1) -> tuple[SharedListening, list[PostgresqlListener]]:
    shared = SharedListening(line)
    return shared, [PostgresqlListener(shared) for _ in range(number)]


def thread_of(shared: SharedListening) -> ListenerThread:
    assert shared._current is not None
    return shared._current


# Where it cannot listen.


def test_a_listener_that_ends_at_once_keeps_nobody_waiting(
    caplog: pytest.LogCaptureFixture,
) -> None:
    # The thread often ends before the one that has started it goes on.
    shared, listeners = listeners_on(Line(*[pooled() for _ in range(50)]), 50)
    with ThreadPoolExecutor(len(listeners)) as pool:
        for call in [pool.submit(each.wait, 1, PATIENCE) for each in listeners]:
            assert call.result(PATIENCE / 4) is None
    assert caplog.text.count("LISTEN is not possible on the moon") == 1
    before = time.monotonic()
    with caplog.at_level(logging.WARNING):
        caplog.clear()
        listeners[0].wait(1, PATIENCE)
    assert time.monotonic() - before >= POLL_PAUSE
    assert caplog.text == ""
    shared.close()


@pytest.mark.parametrize(("error", "attempts"), [(Standby(), 3), (pooled(), 1)])
def test_a_standby_is_tried_again_and_a_pooler_is_not(
    error: Exception,
    attempts: int,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(sharing, "STANDBY_FOR", MOMENT)
    line = Line(error, error)
    shared, [listener] = listeners_on(line)
    while len(line.taken_at) < attempts:
        listener.wait(1, MOMENT)
    for _ in range(3):
        listener.wait(1, MOMENT)
    wait_for(lambda: (f"LISTEN {channel(1)}" in line.connection.statements) == (attempts == 3))
    assert len(line.taken_at) == attempts
    assert all(later - earlier >= MOMENT for earlier, later in pairwise(line.taken_at))
    assert caplog.text.count("LISTEN is not possible") == 1
    shared.close()


def test_the_error_of_a_listener_is_raised_by_each_call() -> None:
    line = Line(*[ConnectionError("gone") for _ in range(200)])
    shared, [listener] = listeners_on(line)
    started = time.monotonic()
    for _ in range(200):
        with pytest.raises(LookupError, match="translated: gone"):
            listener.wait(1, PATIENCE)
    assert time.monotonic() - started < PATIENCE
    shared.close()


def test_a_lost_connection_is_distrusted_once_for_all_who_wait() -> None:
    line = Line()
    shared, listeners = listeners_on(line, 20)
    for listener in listeners:
        listener.wait(1, PATIENCE)
    with ThreadPoolExecutor(len(listeners)) as pool:
        calls = [pool.submit(each.wait, 1, PATIENCE) for each in listeners]
        line.connection.notifies = lambda timeout: iter([Notice("nonsense")])  # type: ignore[method-assign]
        line.connection.notify(1)
        for call in calls:
            with pytest.raises(LookupError, match="translated: "):
                call.result(PATIENCE)
    assert len(line.failures) == 1
    assert line.connection.returned == ["invalidate"]
    shared.close()


# When nobody watches.


def test_what_nobody_watches_is_forgotten_while_others_are_busy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sharing, "LINGER", MOMENT)
    line = Line()
    shared, [busy, left] = listeners_on(line, 2)
    for kb_id, listener in enumerate((busy, left), 1):
        listener.wait(kb_id, PATIENCE)
    thread = thread_of(shared)
    over = threading.Event()

    def keep_busy() -> None:
        while not over.wait(MOMENT / 10):
            line.connection.notify(1)

    busyness = threading.Thread(target=keep_busy)
    busyness.start()
    try:
        left.close()
        wait_for(lambda: f"UNLISTEN {channel(2)}" in line.connection.statements)
        assert f"UNLISTEN {channel(1)}" not in line.connection.statements
        busy.close()
        wait_for(lambda: not thread._thread.is_alive())
    finally:
        over.set()
        busyness.join()
    assert line.connection.returned == ["close"]
    # Who comes back is heard.
    busy.wait(1, PATIENCE)
    assert thread_of(shared) is not thread
    shared.close()


def test_what_somebody_watches_again_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(sharing, "time", SimpleNamespace(monotonic=lambda: now))
    line = Line()
    shared, [listener] = listeners_on(line)

    def has_looked() -> bool:
        return thread_of(shared)._look_at > now

    for _ in range(5):
        listener.wait(1, PATIENCE)
        now += LINGER * 0.6
        listener.close()
        now += LINGER * 0.6
        # It looks only now whom to forget.
        line.connection.notify(1)
        wait_for(has_looked)
    assert line.connection.statements == [f"LISTEN {channel(1)}"]
    shared.close()


# Beginning and end.


def test_a_thread_that_cannot_start_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line()
    shared, [first, second] = listeners_on(line, 2)
    made: list[ListenerThread] = []

    class Noted(ListenerThread):
        def __init__(self, line: sharing.ListeningBackend) -> None:
            super().__init__(line)
            made.append(self)

    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(sharing, "ListenerThread", Noted)
        patch.setattr(threading.Thread, "start", refuse)
        with pytest.raises(LookupError, match="translated: can't start new thread"):
            first.wait(1, PATIENCE)
    assert [end.fileno() for end in (made[0]._waking, made[0]._woken)] == [-1, -1]
    shared.close()
    second.wait(1, PATIENCE)
    assert line.connection.statements == [f"LISTEN {channel(1)}"]
    shared.close()


def test_closing_just_when_it_looks_whom_to_forget_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "LINGER", MOMENT)
    line = Line()
    shared, [listener] = listeners_on(line)
    looking, forget = threading.Event(), ListenerThread._forget_unwatched

    def closed_meanwhile(thread: ListenerThread, connection: object) -> None:
        looking.set()
        wait_for(lambda: thread._is_over)
        forget(thread, connection)

    monkeypatch.setattr(ListenerThread, "_forget_unwatched", closed_meanwhile)
    listener.wait(1, PATIENCE)
    thread = thread_of(shared)
    assert looking.wait(PATIENCE)
    line.is_closed = True
    shared.close()
    assert not thread._thread.is_alive()
    # The pool is closed, and would keep it.
    assert line.connection.returned == ["invalidate"]


def test_nobody_begins_to_listen_after_the_end() -> None:
    line = Line()
    shared, [first, second] = listeners_on(line, 2)
    first.wait(1, PATIENCE)
    line.is_closed = True
    for _ in range(2):
        with pytest.raises(ValueError, match="it was closed"):
            second.wait(1, PATIENCE)
        shared.close()
    assert len(line.taken_at) == 1
