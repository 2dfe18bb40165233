"""A synchronous facade of the asynchronous front door, so its tests test the other one, too."""

from __future__ import annotations

import asyncio
import inspect
import threading
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future
from types import TracebackType
from typing import Any

from kant_sql import KnowledgeBase, aio
from kant_sql.knowledge_base import factory_of
from tests.support.reading import beside as same_store


class Loop:
    """An event loop in a thread, with one task for each thread that uses it."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._local = threading.local()
        self._tasks: list[asyncio.Task[None]] = []
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def call(self, make: Callable[[], Awaitable[Any]]) -> Any:
        """Await something in the task of this thread."""
        if not hasattr(self._local, "calls"):
            self._local.calls = asyncio.run_coroutine_threadsafe(self._begin(), self._loop).result()
        future: Future[Any] = Future()
        self._loop.call_soon_threadsafe(self._local.calls.put_nowait, (make, future))
        return future.result()

    async def _begin(self) -> asyncio.Queue[Any]:
        calls: asyncio.Queue[Any] = asyncio.Queue()
        self._tasks.append(asyncio.create_task(self._serve(calls)))
        return calls

    @staticmethod
    async def _serve(calls: asyncio.Queue[Any]) -> None:
        while True:
            make, future = await calls.get()
            try:
                future.set_result(await make())
            except Exception as error:
                future.set_exception(error)
            except BaseException as error:
                # Ctrl-C and other ends of a program concern the caller.
                future.set_exception(error)
                if isinstance(error, asyncio.CancelledError):
                    raise

    def close(self) -> None:
        async def end() -> None:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

        asyncio.run_coroutine_threadsafe(end(), self._loop).result(30)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(30)
        self._loop.close()


class _Face:
    """Calls an object's coroutines and waits for them; iterates over its iterators."""

    def __init__(self, loop: Loop, thing: Any) -> None:
        self._loop = loop
        self._thing = thing

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._thing, name)
        if isinstance(found, aio._Part):
            return _Face(self._loop, found)
        if not callable(found):
            return found

        def call(*args: Any, **options: Any) -> Any:
            made = found(*args, **options)
            if inspect.isawaitable(made):
                return self._loop.call(lambda: made)
            return _Items(self._loop, made)

        return call


class _Items(Iterator[Any]):
    def __init__(self, loop: Loop, items: Any) -> None:
        self._loop, self._items = loop, items
        # Wrong arguments raise at once, as in the synchronous front door.
        self._first = [self._next()]

    def _next(self) -> Any:
        async def step() -> Any:
            return await anext(self._items, self)

        return self._loop.call(step)

    def __next__(self) -> Any:
        item = self._first.pop() if self._first else self._next()
        if item is self:
            raise StopIteration
        return item


class _Block:
    def __init__(self, loop: Loop, block: Any) -> None:
        self._loop, self._block = loop, block

    def __enter__(self) -> None:
        self._loop.call(self._block.__aenter__)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._loop.call(lambda: self._block.__aexit__(kind, error, traceback))


class Face(KnowledgeBase):
    """A knowledge base whose every call goes through the asynchronous front door."""

    def __init__(self, loop: Loop, kb: aio.AsyncKnowledgeBase) -> None:
        self._loop = loop
        self._async = kb
        self._factory = factory_of(kb._kb)
        self._state = kb._kb._state

    def __getattribute__(self, name: str) -> Any:
        own = ("transaction", "at", "revision", "close", "_loop", "_async", "_factory", "_state")
        if name in own or name.startswith("__"):
            return super().__getattribute__(name)
        if name.startswith("_"):
            return getattr(self._async._kb, name)
        return getattr(_Face(self._loop, self._async), name)

    def transaction(self, **options: Any) -> Any:
        return _Block(self._loop, self._async.transaction(**options))

    def at(self, when: Any = None, **clocks: Any) -> Face:
        return Face(self._loop, self._loop.call(lambda: self._async.at(when, **clocks)))

    @property
    def revision(self) -> int:
        number: int = self._loop.call(self._async.revision)
        return number

    def close(self) -> None:
        self._loop.call(self._async.close)


def beside(loop: Loop, kb: KnowledgeBase, name: str) -> Face:
    """Open another knowledge base on the same connections, which stay open when it closes."""
    own = same_store(kb, name)
    own.close = lambda: None  # type: ignore[method-assign]
    return Face(loop, aio.AsyncKnowledgeBase(aio._Door(own), kb=own))


def connect(loop: Loop, url: str, **options: Any) -> Face:
    """Open a knowledge base through the asynchronous front door."""

    async def open_() -> aio.AsyncKnowledgeBase:
        return await aio.connect(url, **options)

    return Face(loop, loop.call(open_))
