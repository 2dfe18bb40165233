"""The knowledge bases of one store, opened for reading on first use, and questions on them."""

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
from ..errors import ClosedError, StoreBusyError, StoreReplacedError, UnknownNameError
from ..knowledge_base import KnowledgeBase, KnowledgeStore, open_store
from ..limits import Limit, limited
from ..sql.inventory import Catalog
from .rendering import Folders
from .verifying import Verifier

T = TypeVar("T")

# Connections that all questions share; a verification holds one for its whole duration.
CONNECTIONS = 16
# The maximum number of knowledge bases whose definitions are kept for the next question.
MOST_OPEN = 256
# The maximum seconds of one statement for a page.
STATEMENT_SECONDS = 15.0
# The maximum number of questions that wait for a thread; readers get an error for more.
MOST_WAITING = 64


class OpenStore:
    """A store that the threads of the server share."""

    def __init__(self, url: str, *, read_only: bool = True) -> None:
        self.url = url
        self._is_read_only = read_only
        self.folders = Folders(url)  # replaces the server's folders in messages
        # Verifies its knowledge bases.
        self.verifier = Verifier(self.knowledge_base, self.folders)
        self._store = self._open()
        self._opened: OrderedDict[str, KnowledgeBase] = OrderedDict()
        self._lock = threading.Lock()
        self._limits: set[Limit] = set()

    def _open(self) -> KnowledgeStore:
        return open_store(self.url, connections=CONNECTIONS, read_only=self._is_read_only)

    def read_catalog(self, read: Callable[[Catalog], T]) -> T:
        """Read the list of knowledge bases; from the new file if the file was replaced."""
        store = self._store
        try:
            with self._as_replaced(store):
                return read(store.catalog)
        except StoreReplacedError:
            return read(self._reopen(store).catalog)

    def _reopen(self, replaced: KnowledgeStore) -> KnowledgeStore:
        """Open the present file, unless another thread has."""
        with self._lock:
            if self._store is replaced:
                self._store = self._open()
                self._opened.clear()
            store = self._store
        replaced.close()
        return store

    @contextmanager
    def _as_replaced(self, store: KnowledgeStore) -> Iterator[None]:
        """Raise `StoreReplacedError` if another thread has closed a replaced store."""
        try:
            yield
        except ClosedError as error:
            if store is self._store:
                # The server ends.
                raise
            raise StoreReplacedError(str(error)) from error

    def choose(self, name: str | None) -> str:
        """Return the given name, or the only one."""
        if name:
            return name
        names = self.read_catalog(lambda catalog: catalog.first_names(2))
        if len(names) == 1:
            return names[0]
        many = "several knowledge bases" if names else "no knowledge base yet"
        raise UnknownNameError(f"this store has {many}; choose one with the parameter kb")

    def require(self, name: str) -> None:
        """Raise if there is no knowledge base of a name."""
        if not self.read_catalog(lambda catalog: catalog.has(name)):
            raise UnknownNameError(f"this store has no knowledge base {shown(name)}")

    @contextmanager
    def knowledge_base(self, name: str) -> Iterator[KnowledgeBase]:
        """Lend a knowledge base, and keep it for the next question."""
        store, kb = self._take(name)
        try:
            with self._as_replaced(store):
                yield kb
        except StoreReplacedError:
            # The next question opens the present file.
            self._reopen(store)
            raise

    def _take(self, name: str) -> tuple[KnowledgeStore, KnowledgeBase]:
        # A missing one would open without an error: its first write creates it.
        if self._is_read_only and name not in self._opened:
            self.require(name)
        with self._lock:
            kb = self._opened.get(name)
            if kb is None:
                kb = self._opened[name] = self._store.knowledge_base(name)
                if len(self._opened) > MOST_OPEN:
                    self._opened.popitem(last=False)
            self._opened.move_to_end(name)
            return self._store, kb

    @contextmanager
    def asking(self, limiter: anyio.CapacityLimiter) -> Iterator[Limit]:
        """Limit the question of a block; cancel it if the store is closed."""
        if limiter.statistics().tasks_waiting >= MOST_WAITING:
            raise StoreBusyError("too many questions are asked at the same time; try again")
        with limited(seconds=STATEMENT_SECONDS) as limit:
            self._limits.add(limit)
            try:
                yield limit
            finally:
                self._limits.discard(limit)

    def cancel(self) -> None:
        """Cancel all running questions."""
        self.verifier.close()
        for limit in list(self._limits):
            limit.cancel()

    def close(self) -> None:
        """Cancel all questions, and close all knowledge bases."""
        self.cancel()
        self._store.close()


async def answer(request: Request, work: Callable[[], T]) -> T:
    """Run a question in a thread; cancel it if the reader leaves."""
    store: OpenStore = request.app.state.store
    limiter: anyio.CapacityLimiter = request.app.state.limiter
    with store.asking(limiter) as limit:
        leaving = asyncio.create_task(_cancel_when_left(request, limit))
        try:
            return await anyio.to_thread.run_sync(persistent, work, limiter=limiter)
        finally:
            leaving.cancel()
            with suppress(asyncio.CancelledError):
                await leaving


def persistent(work: Callable[[], T]) -> T:
    """Ask again if another store has replaced this one."""
    try:
        return work()
    except StoreReplacedError:
        # This has closed the store: the second time, the present file is opened.
        return work()


async def _cancel_when_left(request: Request, limit: Limit) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    await anyio.to_thread.run_sync(limit.cancel)
