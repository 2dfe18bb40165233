"""The knowledge bases of one store, opened to read when first asked, and questions on them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import anyio
from fastapi import Request

from ..arguments import shown
from ..errors import UnknownNameError
from ..knowledge_base import KnowledgeBase, connect
from ..sql.catalog import knowledge_bases

T = TypeVar("T")

# Each open knowledge base has connections of its own.
MOST_OPEN = 32


class _Opened:
    """A knowledge base, and how many questions are on it."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self.kb = kb
        self.users = 0


class OpenStore:
    """A store, as the threads of the server share it.

    Attributes:
        url: its URL.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._opened: OrderedDict[str, _Opened] = OrderedDict()
        self._lock = threading.Lock()

    def names(self) -> list[str]:
        """Return the names of its knowledge bases."""
        return list(knowledge_bases(self.url))

    def choose(self, name: str | None) -> str:
        """Return a name as it is given, or the only one."""
        if name:
            return name
        names = self.names()
        if len(names) == 1:
            return names[0]
        raise UnknownNameError(
            f"this store has {len(names)} knowledge bases; choose one with the parameter kb"
        )

    @contextmanager
    def knowledge_base(self, name: str) -> Iterator[KnowledgeBase]:
        """Lend a knowledge base; it stays open for the next question."""
        opened = self._take(name)
        try:
            yield opened.kb
        finally:
            self._give_back(opened)

    def _take(self, name: str) -> _Opened:
        with self._lock:
            opened = self._opened.get(name)
            if opened is None:
                # Opening one that does not exist would succeed: the first write creates it.
                if name not in self.names():
                    raise UnknownNameError(f"this store has no knowledge base {shown(name)}")
                opened = self._opened[name] = _Opened(connect(self.url, knowledge_base=name))
            self._opened.move_to_end(name)
            opened.users += 1
        return opened

    def _give_back(self, opened: _Opened) -> None:
        with self._lock:
            opened.users -= 1
            idle = [name for name, each in self._opened.items() if not each.users]
            for name in idle[: max(0, len(self._opened) - MOST_OPEN)]:
                self._opened.pop(name).kb.close()

    def close(self) -> None:
        """Close all of them."""
        with self._lock:
            while self._opened:
                self._opened.popitem()[1].kb.close()


async def answer(request: Request, work: Callable[[], T]) -> T:
    """Run a question in a thread."""
    return await anyio.to_thread.run_sync(work, limiter=request.app.state.limiter)
