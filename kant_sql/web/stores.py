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
from ..errors import ClosedError, StoreBusyError, StoreReplacedError, UnknownNameError
from ..knowledge_base import KnowledgeBase, KnowledgeStore, open_store
from ..limits import Limit, limited
from ..sql.inventory import Catalog
from .rendering import Folders
from .verifying import Verifier

T = TypeVar("T")

# Connections that all questions share; a verification holds one for its whole length.
CONNECTIONS = 16
# Knowledge bases whose definitions are kept for the next question.
MOST_OPEN = 256
# Seconds that the database may take for one statement of a page.
STATEMENT_SECONDS = 15.0
# Questions that wait for a thread; a reader who would wait still longer is told so.
MOST_WAITING = 64


class OpenStore:
    """A store, as the threads of the server share it."""

    def __init__(self, url: str, *, read_only: bool = True) -> None:
        self.url = url
        self._is_read_only = read_only
        self.folders = Folders(url)  # what is said instead of the server's folders
        # What verifies its knowledge bases.
        self.verifier = Verifier(self.knowledge_base, self.folders)
        self._store = self._open()
        self._opened: OrderedDict[str, KnowledgeBase] = OrderedDict()
        self._lock = threading.Lock()
        self._limits: set[Limit] = set()

    def _open(self) -> KnowledgeStore:
        return open_store(self.url, connections=CONNECTIONS, read_only=self._is_read_only)

    def read_catalog(self, read: Callable[[Catalog], T]) -> T:
        """Read what knowledge bases there are; of a file that was replaced, the new one."""
        store = self._store
        try:
            with self._as_replaced(store):
                return read(store.catalog)
        except StoreReplacedError:
            return read(self._reopen(store).catalog)

    def _reopen(self, replaced: KnowledgeStore) -> KnowledgeStore:
        """Open the file that is there now, unless another thread has."""
        with self._lock:
            if self._store is replaced:
                self._store = self._open()
                self._opened.clear()
            store = self._store
        replaced.close()
        return store

    @contextmanager
    def _as_replaced(self, store: KnowledgeStore) -> Iterator[None]:
        """Raise `StoreReplacedError` where another thread has closed a replaced store."""
        try:
            yield
        except ClosedError as error:
            if store is self._store:
                # The server ends.
                raise
            raise StoreReplacedError(str(error)) from error

    def choose(self, name: str | None) -> str:
        """Return a name as it is given, or the only one."""
        if name:
            return name
        names = self.read_catalog(lambda catalog: catalog.first_names(2))
        if len(names) == 1:
            return names[0]
        many = "several knowledge bases" if names else "no knowledge base yet"
        raise UnknownNameError(f"this store has {many}; choose one with the parameter kb")

    def require(self, name: str) -> None:
        """Raise when there is no knowledge base of a name."""
        if not self.read_catalog(lambda catalog: catalog.has(name)):
            raise UnknownNameError(f"this store has no knowledge base {shown(name)}")

    @contextmanager
    def knowledge_base(self, name: str) -> Iterator[KnowledgeBase]:
        """Lend a knowledge base; it is kept for the next question."""
        store, kb = self._take(name)
        try:
            with self._as_replaced(store):
                yield kb
        except StoreReplacedError:
            # The next question opens the file that is there now.
            self._reopen(store)
            raise

    def _take(self, name: str) -> tuple[KnowledgeStore, KnowledgeBase]:
        # Opening one that does not exist would succeed: the first write creates it.
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
        """Limit the question of a block; cancel it when the store is closed meanwhile."""
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
    """Run a question in a thread; it is cancelled when the reader leaves."""
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
    """Ask again where another store took the place of this one."""
    try:
        return work()
    except StoreReplacedError:
        # This has closed the store: the second time, the file that is there now is opened.
        return work()


async def _cancel_when_left(request: Request, limit: Limit) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
    await anyio.to_thread.run_sync(limit.cancel)
