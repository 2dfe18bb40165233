"""Transactions of clients, over several requests: each runs in its own thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, Literal

from starlette.exceptions import HTTPException

from ..errors import ConnectionLostError
from ..knowledge_base import KnowledgeBase

Step = Literal["begin", "call", "commit", "rollback"]
Work = Callable[[KnowledgeBase], Any]
Lend = Callable[[], AbstractContextManager[KnowledgeBase]]

# Seconds that a transaction waits for its next request: other writers wait for it.
IDLE = 10.0
# Each has a thread, a connection and, on SQLite, the lock of the whole store.
MOST_OPEN = 4
# Seconds for which the last answer of an ended transaction can be repeated.
KEPT = 30.0
GONE = (
    f"this transaction was rolled back: its client did not call for {IDLE:g} s, or the server was "
    "restarted; nothing of it was written, begin it again"
)


class _RolledBack(BaseException):
    """An error of the client ends a block."""


class _Left(BaseException):
    """The client makes no more calls, or the server ends."""


@dataclass(frozen=True)
class _Request:
    step: Step
    work: Work
    answer: Future[Any]


class OpenTransaction:
    """A transaction of a client. The event loop sends requests, and its thread answers."""

    def __init__(self, lend: Lend) -> None:
        self.ended_at: float | None = None
        self._lend = lend
        self._last, self._answer = 0, Future[Any]()
        self._requests: SimpleQueue[_Request | None] = SimpleQueue()
        self._guard = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="kant_sql client", daemon=True)
        self._thread.start()

    def ask(self, number: int, step: Step, work: Work) -> Future[Any]:
        """Take a request; find the answer to a repeated one."""
        # For a call, `work` returns the result; for a `begin`, it opens the block.
        with self._guard:
            if number != self._last:
                if self.ended_at is not None or number < self._last:
                    raise ConnectionLostError(GONE)
                self._last, self._answer = number, Future()
                self._requests.put(_Request(step, work, self._answer))
            return self._answer

    def close(self) -> None:
        """Roll it back if it is open, after a running call."""
        self._requests.put(None)
        self._thread.join(IDLE)

    def _run(self) -> None:
        first: _Request | None = None
        try:
            first = self._next()
            with self._lend() as kb:
                self._block(kb, first)
        except (Exception, _Left) as error:
            if first is not None and not first.answer.done():
                first.answer.set_exception(error)
        with self._guard:
            self.ended_at = time.monotonic()
            while not self._requests.empty():
                late = self._requests.get()
                if late is not None:
                    late.answer.set_exception(ConnectionLostError(GONE))

    def _next(self) -> _Request:
        try:
            request = self._requests.get(timeout=IDLE)
        except Empty:
            request = None
        if request is None:
            raise _Left
        return request

    def _block(self, kb: KnowledgeBase, begin: _Request) -> None:
        """Run a block and those within it, until the client ends it."""
        ending = begin
        try:
            with begin.work(kb):
                begin.answer.set_result({"revision": kb.revision})
                ending = self._calls(kb)
                if ending.step == "rollback":
                    raise _RolledBack
        except _RolledBack:
            pass
        except Exception as error:
            ending.answer.set_exception(error)
            raise
        ending.answer.set_result({})

    def _calls(self, kb: KnowledgeBase) -> _Request:
        """Run the calls of a block; return the request that ends it."""
        while (request := self._next()).step in ("begin", "call"):
            if request.step == "begin":
                # The client has its error, and decides about the outer block.
                with suppress(Exception):
                    self._block(kb, request)
                continue
            try:
                request.answer.set_result(request.work(kb))
            except Exception as error:
                request.answer.set_exception(error)
        return request


class Transactions:
    """The open transactions of clients, and those that have recently ended."""

    def __init__(self) -> None:
        self._kept: dict[Hashable, OpenTransaction] = {}

    def ask(
        self, key: Hashable, number: int, step: Step, lend: Lend, work: Work
    ) -> Future[Any] | None:
        """Send a request to its transaction; None without one, if this does not begin it."""
        found = self._kept.get(key)
        if found is None and step == "begin" and number == 1:
            found = self._kept[key] = self._open(lend)
        return None if found is None else found.ask(number, step, work)

    def _open(self, lend: Lend) -> OpenTransaction:
        now = time.monotonic()
        for key, one in [*self._kept.items()]:
            if one.ended_at is not None and now > one.ended_at + KEPT:
                del self._kept[key]
        if sum(one.ended_at is None for one in self._kept.values()) >= MOST_OPEN:
            message = f"{MOST_OPEN} transactions are open; nothing was written, try again"
            raise HTTPException(429, message, {"Retry-After": "1"})
        return OpenTransaction(lend)

    def close(self) -> None:
        """Roll back open transactions."""
        for one in self._kept.values():
            one.close()
