"""The knowledge bases of one store, opened to read when first asked, and questions on them."""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeVar

import anyio
from fastapi import Request

from ..arguments import shown
from ..errors import StoreBusyError, StoreReplacedError, UnknownNameError
from ..knowledge_base import KnowledgeBase, connect
from ..limits import Limit, limited
from ..sql.inventory import Catalog
from .verifying import Verifier

T = TypeVar("T")

# Each open knowledge base has connections of its own.
MOST_OPEN = 32
# Seconds that the database may take for one statement of a page.
STATEMENT_SECONDS = 15.0
# Questions that wait for a thread; a reader who would wait still longer is told so.
MOST_WAITING = 64


class _Opened:
    """A knowledge base, and how many questions are on it."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self.kb = kb
        self.users = 0


class OpenStore:
    """A store, as the threads of the server share it.

    Attributes:
        url: its URL.
        catalog: its knowledge bases.
        verifier: what verifies them.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.catalog = Catalog(url)
        self.verifier = Verifier(self.knowledge_base)
        self._opened: OrderedDict[str, _Opened] = OrderedDict()
        self._lock = threading.Lock()
        self._limits: set[Limit] = set()

    def choose(self, name: str | None) -> str:
        """Return a name as it is given, or the only one."""
        if name:
            return name
        names = self.catalog.first_names(2)
        if len(names) == 1:
            return names[0]
        many = "several knowledge bases" if names else "no knowledge base yet"
        raise UnknownNameError(f"this store has {many}; choose one with the parameter kb")

    def require(self, name: str) -> None:
        """Raise when there is no knowledge base of a name."""
        if not self.catalog.has(name):
            raise UnknownNameError(f"this store has no knowledge base {shown(name)}")

    @contextmanager
    def knowledge_base(self, name: str) -> Iterator[KnowledgeBase]:
        """Lend a knowledge base; it stays open for the next question."""
        opened = self._take(name)
        try:
            yield opened.kb
        except StoreReplacedError:
            # The next question opens the file that is there now.
            self._forget(name, opened)
            raise
        finally:
            self._give_back(opened)

    def _forget(self, name: str, opened: _Opened) -> None:
        with self._lock:
            if self._opened.get(name) is opened:
                del self._opened[name]
        opened.kb.close()

    def _take(self, name: str) -> _Opened:
        opened = self._use(name, None)
        if opened is not None:
            return opened
        # Opening one that does not exist would succeed: the first write creates it.
        self.require(name)
        # Without the lock: a server that does not answer holds up only those who ask it.
        made = _Opened(connect(self.url, knowledge_base=name, read_only=True))
        opened = self._use(name, made)
        assert opened is not None
        if opened is not made:
            made.kb.close()
        return opened

    def _use(self, name: str, made: _Opened | None) -> _Opened | None:
        """Take what is open, or else what was made."""
        with self._lock:
            opened = self._opened.get(name, made)
            if opened is not None:
                self._opened[name] = opened
                self._opened.move_to_end(name)
                opened.users += 1
            return opened

    def _give_back(self, opened: _Opened) -> None:
        with self._lock:
            opened.users -= 1
            idle = [name for name, each in self._opened.items() if not each.users]
            for name in idle[: max(0, len(self._opened) - MOST_OPEN)]:
                self._opened.pop(name).kb.close()

    @contextmanager
    def asking(self, limit: Limit) -> Iterator[None]:
        """Cancel the questions of a block when the store is closed meanwhile."""
        self._limits.add(limit)
        try:
            yield
        finally:
            self._limits.discard(limit)

    def cancel(self) -> None:
        """Cancel all questions that run, for good."""
        self.verifier.close()
        for limit in list(self._limits):
            limit.cancel()

    def close(self) -> None:
        """Cancel all questions, and close all knowledge bases."""
        self.cancel()
        with self._lock:
            while self._opened:
                self._opened.popitem()[1].kb.close()
        self.catalog.close()


async def answer(request: Request, work: Callable[[], T]) -> T:
    """Run a question in a thread; it is cancelled when the reader leaves."""
    store: OpenStore = request.app.state.store
    limiter: anyio.CapacityLimiter = request.app.state.limiter
    if limiter.statistics().tasks_waiting >= MOST_WAITING:
        raise StoreBusyError("too many questions are asked at the same time; try again")
    with limited(seconds=STATEMENT_SECONDS) as limit, store.asking(limit):
        leaving = asyncio.create_task(_cancel_when_left(request, limit))
        try:
            return await anyio.to_thread.run_sync(_persistent, work, limiter=limiter)
        finally:
            leaving.cancel()
            with suppress(asyncio.CancelledError):
                await leaving


def _persistent(work: Callable[[], T]) -> T:
    try:
        return work()
    except StoreReplacedError:
        # This has closed the knowledge base: the second time, the file that is there now is opened.
        return work()


async def _cancel_when_left(request: Request, limit: Limit) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    await anyio.to_thread.run_sync(limit.cancel)
