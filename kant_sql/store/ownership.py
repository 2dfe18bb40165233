"""The ownership of transactions: each belongs to one thread, one task and one context.

`asyncio.create_task`, `loop.call_soon` and `asyncio.to_thread` copy the caller's context, so with a
context variable alone a new task could join the block of its creator. So each block knows where it
was opened, and only that place can join it.
"""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable, Hashable
from contextvars import ContextVar, Token
from typing import TYPE_CHECKING, Any

from ..errors import TransactionOpenError

if TYPE_CHECKING:
    from .transaction import Transaction


class Block:
    """An open transaction, and where it was opened; None replaces it when it has ended."""

    def __init__(self, store: object, queue: Hashable, transaction: Transaction) -> None:
        """Open it."""
        self.store: object | None = store
        self.transaction: Transaction | None = transaction
        self._thread = threading.get_ident()
        self._task = _task()
        self._place: tuple[int, Hashable] | None = (self._thread, queue)
        self._name = transaction.name
        self._actor = transaction.metadata.actor
        others = OPEN.get()
        if others:
            others = tuple(block for block in others if block.store is not None)
        self._token: Token[tuple[Block, ...]] = OPEN.set((*others, self))
        _QUEUES[self._thread, queue] = self

    def close(self) -> None:
        """End it, from anywhere."""
        place, self._place = self._place, None
        # A task that outlives the block keeps a copy of the context, which must not keep more
        # alive.
        self.store = self.transaction = self._task = None
        if place is not None and _QUEUES.get(place) is self:
            del _QUEUES[place]
        # Another context keeps the empty block until it opens one of its own.
        OPEN.set(tuple([block for block in OPEN.get() if block is not self]))

    def is_mine(self) -> bool:
        """Return whether it was opened in exactly this thread, task and context."""
        if self._thread != threading.get_ident() or self._task is not _task():
            return False
        seen = OPEN.get()
        try:
            # A token belongs to one context: a copy of that context refuses it.
            OPEN.reset(self._token)
        except ValueError:
            return False
        self._token = OPEN.set(seen)
        return True

    def refuse(self, what: str) -> TransactionOpenError:
        """Make the error for a caller that would wait for this block in its own thread."""
        who = "no actor" if self._actor is None else f"actor {self._actor!r}"
        task: asyncio.Task[Any] | None = self._task
        where = "outside of any task" if task is None else f"in task {task.get_name()!r}"
        return TransactionOpenError(
            f"knowledge base {self._name!r} has a transaction of {who} open in this thread, "
            f"{where}, which only its own task and context may use: {what} would block the thread "
            "forever; end that block first, use kant_sql.aio, or go to another thread"
        )


class LoopBlock:
    """A transaction in its own thread, which only its event loop can end.

    So a writer in the loop's thread would wait for itself.
    """

    def __init__(self, queue: Hashable, label: Callable[[], str]) -> None:
        """Note it for the running thread."""
        self._place = threading.get_ident(), queue
        self._label = label
        self._task = _task()
        _LOOPS.setdefault(self._place, []).append(self)

    def close(self) -> None:
        """Forget it: its loop has ended it."""
        ahead = _LOOPS.get(self._place, [])
        if self in ahead:
            ahead.remove(self)
        if not ahead:
            _LOOPS.pop(self._place, None)

    def is_mine(self) -> bool:
        """Return False: calls in the loop's own thread are never in it."""
        return False

    def refuse(self, what: str) -> TransactionOpenError:
        """Make the error for a caller that would wait for it in the thread of its loop."""
        where = "" if self._task is None else f" by task {self._task.get_name()!r}"
        return TransactionOpenError(
            f"knowledge base {self._label()} has a transaction of kant_sql.aio open{where} in the "
            f"event loop of this thread: {what} would stop the loop, which has to end it, until "
            "the timeout; await the same call of kant_sql.aio, or go to another thread"
        )


OPEN: ContextVar[tuple[Block, ...]] = ContextVar("kant_sql_open", default=())
# The blocks that hold queues of writers, by thread.
_QUEUES: dict[tuple[int, Hashable], Block] = {}
# The transactions of event loops that hold them, by the loop's thread.
_LOOPS: dict[tuple[int, Hashable], list[LoopBlock]] = {}

if hasattr(os, "register_at_fork"):
    # The parent process ends its own transaction.
    os.register_at_fork(after_in_child=_QUEUES.clear)
    os.register_at_fork(after_in_child=_LOOPS.clear)


def _task() -> asyncio.Task[Any] | None:
    # The check of `asyncio.current_task` without its exception: most threads have no loop.
    if asyncio._get_running_loop() is None:
        return None
    return asyncio.current_task()


def own_block(store: object) -> Block | None:
    """Find the block that this thread, task and context has open."""
    # The newest first: an older one may be from before a fork.
    for block in reversed(OPEN.get()):
        if block.store is store and block.is_mine():
            return block
    return None


def block_ahead(queue: Hashable) -> Block | LoopBlock | None:
    """Find the block that cannot end while a writer of this thread waits for it."""
    place = threading.get_ident(), queue
    found = _QUEUES.get(place)
    if found is None and place in _LOOPS:
        return _LOOPS[place][-1]
    return found


def blocks_of_thread() -> list[Block]:
    """Find all open blocks of this thread, of any task."""
    here = threading.get_ident()
    return [block for (thread, _), block in list(_QUEUES.items()) if thread == here]
