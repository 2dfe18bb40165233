"""The front door for asyncio: the same calls, awaitable, and no call blocks the event loop.

The calls run in threads: those of a transaction in a thread of its own, all others in a pool.
Names, arguments and results are those of `kant_sql`, from whose methods their types are taken.
"""

from __future__ import annotations

import asyncio
import contextvars
import threading
import time
import weakref
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, AbstractContextManager, suppress
from contextvars import ContextVar
from datetime import datetime
from functools import partial
from types import TracebackType
from typing import Concatenate, Generic, ParamSpec, Protocol, TypeVar

from . import knowledge_base as sync
from .arguments import seconds
from .dao.fluent_interfaces import PddlFunctionDao, PddlFunctionValueDao
from .dao.formula_interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    GoalDao,
    InitialLiteralDao,
    MetricDao,
    TimedInitialLiteralDao,
)
from .dao.interfaces import (
    PddlActionDao,
    PddlEventDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlProcessDao,
    PddlPropositionDao,
    PddlTypeDao,
)
from .errors import (
    ClosedError,
    StoreBusyError,
    TransactionCancelledError,
    TransactionOpenError,
)
from .knowledge_base import KnowledgeBase
from .plans import PlanDao

__all__ = ["AsyncKnowledgeBase", "connect"]

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")

POOL_SIZE = 8
# Writers of one event loop queue for as long as threads do.
QUEUE_TIMEOUT = 20.0
# A call that waits for news looks so often whether it was cancelled.
WATCH_SLICE = 0.5
BATCH = 100


def _contained(call: Callable[[], R]) -> R:
    """Run a call: a `StopIteration` of the caller's own code cannot pass through a future."""
    try:
        return call()
    except StopIteration as error:
        raise RuntimeError("code that this call ran raised StopIteration") from error


class _Lane:
    """A thread for calls that belong together, which run one after the other in one context."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "kant_sql")
        self._context = contextvars.copy_context()

    def submit(self, call: Callable[[], R]) -> Future[R]:
        """Have a call run when those before it have ended."""
        return self._thread.submit(self._context.run, _contained, call)

    def end(self, wait: bool = False) -> None:
        """Let the thread end after its last call."""
        self._thread.shutdown(wait=wait)


async def _finish(future: Future[R]) -> asyncio.CancelledError | None:
    """Wait for a call's end even when cancelled; give the cancellation that came meanwhile."""
    waiter = asyncio.ensure_future(asyncio.wrap_future(future))
    cancelled = None
    while not waiter.done():
        try:
            await asyncio.wait([waiter])
        except asyncio.CancelledError as error:
            cancelled = error
    if not waiter.cancelled():
        waiter.exception()  # The caller asks the future itself.
    return cancelled


class _Block:
    """A transaction that is open in its lane, and the task that may use it."""

    def __init__(self, door: _Door, manager: AbstractContextManager[None]) -> None:
        self.door = door
        self.manager = manager
        self.lane = _Lane()
        self.task = asyncio.current_task()
        self.is_broken = False
        self.is_open = False

    async def run(self, call: Callable[[], R]) -> R:
        """Run a call within the transaction; if it is cancelled, the block is to be rolled back."""
        self.door.refuse_closed()
        if self.is_broken:
            raise _cancelled()
        try:
            return await asyncio.wrap_future(self.lane.submit(call))
        except asyncio.CancelledError:
            self.is_broken = True
            raise

    def leave(
        self, error: BaseException | None, traceback: TracebackType | None = None
    ) -> Future[bool | None]:
        """Commit, or roll back for an error, when the calls that are under way have ended."""
        self.is_open = False
        kind = None if error is None else type(error)
        return self.lane.submit(partial(self.manager.__exit__, kind, error, traceback))

    def abandon(self, entering: Future[None]) -> Future[None]:
        """Roll back, once it has begun, what nobody waits for any more."""

        def roll_back() -> None:
            if not entering.cancelled() and entering.exception() is None:
                error = _cancelled()
                with suppress(TransactionCancelledError):
                    self.manager.__exit__(type(error), error, None)

        return self.lane.submit(roll_back)


def _cancelled() -> TransactionCancelledError:
    return TransactionCancelledError(
        "a call within this transaction was cancelled, so that nobody knows how much of it was "
        "done: nothing of the transaction is written; begin it again"
    )


_BLOCKS: ContextVar[tuple[_Block, ...]] = ContextVar("kant_sql_aio_blocks", default=())


class _Door:
    """What all parts of one front door share: its threads, and who of a loop may write."""

    def __init__(self, kb: KnowledgeBase, has_one_connection: bool) -> None:
        self.kb = kb
        self.has_one_connection = has_one_connection
        self.is_closed = False
        self.is_closing = threading.Event()
        self._pool = ThreadPoolExecutor(POOL_SIZE, "kant_sql")
        self._guard = threading.Lock()
        self._queues: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Lock] = (
            weakref.WeakKeyDictionary()
        )
        self.blocks: set[_Block] = set()

    def refuse_closed(self) -> None:
        """Raise `ClosedError` when it was closed."""
        if self.is_closed:
            raise ClosedError("this knowledge base was closed; connect again to go on")

    def own_block(self) -> _Block | None:
        """Find the block that the running task has open."""
        task = asyncio.current_task()
        for block in reversed(_BLOCKS.get()):
            if block.door is self and block.is_open and block.task is task:
                return block
        return None

    def refuse_inherited(self) -> None:
        """Refuse to wait for a block that may wait for this task: one that it was started in."""
        for block in _BLOCKS.get():
            if block.door is self and block.is_open:
                name = "a task" if block.task is None else f"task {block.task.get_name()!r}"
                raise TransactionOpenError(
                    f"this task was started within a transaction of {name} that is still open, "
                    "which only that task may use and which may wait for this one; write in the "
                    "task that opened it, or end the transaction first"
                )

    def queue(self) -> asyncio.Lock:
        """Give the queue of those who write in the running event loop."""
        loop = asyncio.get_running_loop()
        with self._guard:
            return self._queues.setdefault(loop, asyncio.Lock())

    async def enter_queue(self) -> asyncio.Lock:
        """Wait for the turn to write."""
        queue = self.queue()
        try:
            async with asyncio.timeout(QUEUE_TIMEOUT):
                await queue.acquire()
        except TimeoutError as error:
            raise StoreBusyError(
                f"another task held the knowledge base for over {QUEUE_TIMEOUT:g} s; nothing was "
                "written, try again"
            ) from error
        return queue

    async def read(self, call: Callable[[], R]) -> R:
        """Run a call that writes nothing: in the task's transaction, or in the pool."""
        block = self.own_block()
        if block is not None:
            return await block.run(call)
        if self.has_one_connection:
            self.refuse_inherited()
        return await asyncio.wrap_future(self._submit(call))

    async def write(self, call: Callable[[], R]) -> R:
        """Run a call that writes: in the task's transaction, or when it is this task's turn."""
        block = self.own_block()
        if block is not None:
            return await block.run(call)
        self.refuse_inherited()
        self.refuse_closed()
        queue = await self.enter_queue()
        try:
            future = self._submit(call)
            cancelled = await _finish(future)
        finally:
            queue.release()
        if cancelled is not None:
            # What it did is done: a commit that is under way cannot be taken back.
            raise cancelled
        return future.result()

    def _submit(self, call: Callable[[], R]) -> Future[R]:
        self.refuse_closed()
        return self._pool.submit(contextvars.copy_context().run, _contained, call)

    async def close(self) -> None:
        """Roll back what is open, close the store, and wait for the threads."""
        if self.is_closed:
            return
        self.is_closed = True
        self.is_closing.set()
        error = ClosedError("this knowledge base was closed; nothing of the block was written")
        # What is only about to begin is ended by who begins it.
        blocks = [block for block in self.blocks if block.is_open]
        leaving = [block.leave(error) for block in blocks]
        lane = _Lane()

        def close() -> None:
            for future in leaving:
                future.exception()
            self.kb.close()
            self._pool.shutdown()
            for block in blocks:
                block.lane.end(wait=True)

        future = lane.submit(close)
        cancelled = await _finish(future)
        lane.end()
        if cancelled is not None:
            raise cancelled
        future.result()


class _Transaction(AbstractAsyncContextManager[None]):
    """`async with kb.transaction(...)`: a block in a thread of its own."""

    def __init__(self, door: _Door, make: Callable[[], AbstractContextManager[None]]) -> None:
        self._door = door
        self._make = make
        self._joined: tuple[_Block, AbstractContextManager[None]] | None = None
        self._block: _Block | None = None
        self._queue: asyncio.Lock | None = None

    async def __aenter__(self) -> None:
        self._door.refuse_closed()
        outer = self._door.own_block()
        if outer is not None:
            manager = self._make()
            await outer.run(manager.__enter__)
            self._joined = (outer, manager)
            return
        self._door.refuse_inherited()
        self._queue = await self._door.enter_queue()
        try:
            self._door.refuse_closed()
            block = _Block(self._door, self._make())
        except BaseException:
            self._queue.release()
            raise
        self._door.blocks.add(block)
        await self._begin(block)
        if self._door.is_closed:
            cancelled = await _finish(block.leave(_cancelled()))
            self._end(block)
            if cancelled is not None:
                raise cancelled
            self._door.refuse_closed()
        others = tuple(one for one in _BLOCKS.get() if one.is_open)
        block.is_open = True
        _BLOCKS.set((*others, block))
        self._block = block

    async def _begin(self, block: _Block) -> None:
        entering = block.lane.submit(block.manager.__enter__)
        try:
            await asyncio.wrap_future(entering)
        except asyncio.CancelledError:
            # BEGIN may wait for another process: its own thread ends what it has begun.
            loop = asyncio.get_running_loop()
            block.abandon(entering).add_done_callback(
                lambda _: self._call_soon(loop, partial(self._end, block))
            )
            block.lane.end()
            raise
        except BaseException:
            self._end(block)
            raise

    @staticmethod
    def _call_soon(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # The loop was closed: nobody waits in it any more.
            loop.call_soon_threadsafe(call)

    def _end(self, block: _Block) -> None:
        block.lane.end()
        self._door.blocks.discard(block)
        if self._queue is not None:
            self._queue.release()

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._joined is not None:
            await self._leave_joined(*self._joined, error, traceback)
            return
        block = self._block
        if block is None or not block.is_open:
            if block is not None:
                self._end(block)
            if error is None:
                self._door.refuse_closed()
            return
        broken = _cancelled() if block.is_broken and error is None else None
        future = block.leave(broken or error, traceback)
        cancelled = await _finish(future)
        self._end(block)
        failure = future.exception()
        if failure is not None and failure is not error:
            raise failure
        if broken is not None:
            raise broken
        if cancelled is not None and error is None:
            cancelled.add_note("the transaction was committed before the task was cancelled")
            raise cancelled

    @staticmethod
    async def _leave_joined(
        block: _Block,
        manager: AbstractContextManager[None],
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not block.is_open:
            # The front door was closed within.
            if error is None:
                block.door.refuse_closed()
            return
        kind = None if error is None else type(error)
        future = block.lane.submit(partial(manager.__exit__, kind, error, traceback))
        cancelled = await _finish(future)
        failure = future.exception()
        if failure is not None and failure is not error:
            raise failure
        if cancelled is not None:
            block.is_broken = True
            raise cancelled


class _Entries(AsyncIterator[R]):
    """Gives what an iterator of the store gives, read in batches in a thread."""

    def __init__(self, door: _Door, make: Callable[[], Iterator[R]]) -> None:
        self._door = door
        self._make = make
        self._iterator: Iterator[R] | None = None
        self._ready: deque[R] = deque()
        self._error: Exception | None = None
        self._is_over = False
        self._reading = threading.Lock()

    async def __anext__(self) -> R:
        self._door.refuse_closed()
        if not self._ready and not self._is_over:
            await self._door.read(self._fill)
        if self._ready:
            return self._ready.popleft()
        error, self._error = self._error, None
        if error is not None:
            raise error
        raise StopAsyncIteration

    def _fill(self) -> None:
        # A read that was cancelled may still be at it: what it finds is not lost.
        with self._reading:
            try:
                if self._iterator is None:
                    self._iterator = self._make()
                while len(self._ready) < BATCH:
                    self._ready.append(next(self._iterator))
            except StopIteration:
                self._is_over = True
            except Exception as error:
                self._is_over, self._error = True, error


class _Part(Protocol):
    """What has awaitable calls: the front door, or one of its DAOs."""

    _door: _Door

    @property
    def _sync(self) -> object: ...


class _Call(Generic[P, R]):
    """A method of the synchronous interface, made awaitable. Its types are that method's."""

    def __init__(self, method: Callable[Concatenate[S, P], R], writes: bool) -> None:
        self._name: str = method.__name__
        self._writes = writes
        self.__doc__ = method.__doc__

    def __get__(
        self, part: _Part, owner: type[_Part] | None = None
    ) -> Callable[P, Coroutine[object, object, R]]:
        if part is None:
            return self  # type: ignore[unreachable]
        run = part._door.write if self._writes else part._door.read
        method: Callable[P, R] = getattr(part._sync, self._name)

        def call(*args: P.args, **kwargs: P.kwargs) -> Coroutine[object, object, R]:
            return run(partial(method, *args, **kwargs))

        call.__name__, call.__doc__ = self._name, self.__doc__
        return call


class _Stream(Generic[P, R]):
    """A method of the synchronous interface that iterates, made an asynchronous iterator."""

    def __init__(self, method: Callable[Concatenate[S, P], Iterator[R]]) -> None:
        self._name: str = method.__name__
        self.__doc__ = method.__doc__

    def __get__(
        self, part: _Part, owner: type[_Part] | None = None
    ) -> Callable[P, AsyncIterator[R]]:
        if part is None:
            return self  # type: ignore[unreachable]
        method: Callable[P, Iterator[R]] = getattr(part._sync, self._name)

        def call(*args: P.args, **kwargs: P.kwargs) -> AsyncIterator[R]:
            return _Entries(part._door, partial(method, *args, **kwargs))

        call.__name__, call.__doc__ = self._name, self.__doc__
        return call


class _Opens(Generic[P]):
    """`transaction` of the synchronous interface, made an asynchronous context manager."""

    def __init__(self, method: Callable[Concatenate[S, P], AbstractContextManager[None]]) -> None:
        self._name: str = method.__name__
        self.__doc__ = method.__doc__

    def __get__(
        self, part: _Part, owner: type[_Part] | None = None
    ) -> Callable[P, AbstractAsyncContextManager[None]]:
        if part is None:
            return self  # type: ignore[unreachable]
        method: Callable[P, AbstractContextManager[None]] = getattr(part._sync, self._name)

        def call(*args: P.args, **kwargs: P.kwargs) -> AbstractAsyncContextManager[None]:
            return _Transaction(part._door, partial(method, *args, **kwargs))

        call.__name__, call.__doc__ = self._name, self.__doc__
        return call


def _read(method: Callable[Concatenate[S, P], R]) -> _Call[P, R]:
    return _Call(method, writes=False)


def _write(method: Callable[Concatenate[S, P], R]) -> _Call[P, R]:
    return _Call(method, writes=True)


class _AsyncDao:
    """A DAO whose calls are awaitable."""

    def __init__(self, door: _Door, dao: object) -> None:
        self._door = door
        self._dao = dao

    @property
    def _sync(self) -> object:
        return self._dao


class AsyncPddlTypeDao(_AsyncDao):
    """`PddlTypeDao` for asyncio: the DAO of types."""

    get = _read(PddlTypeDao.get)
    get_all = _read(PddlTypeDao.get_all)
    save = _write(PddlTypeDao.save)
    insert = _write(PddlTypeDao.insert)
    update = _write(PddlTypeDao.update)
    save_all = _write(PddlTypeDao.save_all)
    delete = _write(PddlTypeDao.delete)
    delete_all = _write(PddlTypeDao.delete_all)


class AsyncPddlObjectDao(_AsyncDao):
    """`PddlObjectDao` for asyncio: the DAO of objects."""

    get = _read(PddlObjectDao.get)
    get_all = _read(PddlObjectDao.get_all)
    save = _write(PddlObjectDao.save)
    insert = _write(PddlObjectDao.insert)
    update = _write(PddlObjectDao.update)
    save_all = _write(PddlObjectDao.save_all)
    delete = _write(PddlObjectDao.delete)
    delete_all = _write(PddlObjectDao.delete_all)


class AsyncPddlPredicateDao(_AsyncDao):
    """`PddlPredicateDao` for asyncio: the DAO of predicates."""

    get = _read(PddlPredicateDao.get)
    get_all = _read(PddlPredicateDao.get_all)
    save = _write(PddlPredicateDao.save)
    insert = _write(PddlPredicateDao.insert)
    update = _write(PddlPredicateDao.update)
    save_all = _write(PddlPredicateDao.save_all)
    delete = _write(PddlPredicateDao.delete)
    delete_all = _write(PddlPredicateDao.delete_all)


class AsyncPddlFunctionDao(_AsyncDao):
    """`PddlFunctionDao` for asyncio: the DAO of functions."""

    get = _read(PddlFunctionDao.get)
    get_all = _read(PddlFunctionDao.get_all)
    save = _write(PddlFunctionDao.save)
    insert = _write(PddlFunctionDao.insert)
    update = _write(PddlFunctionDao.update)
    save_all = _write(PddlFunctionDao.save_all)
    delete = _write(PddlFunctionDao.delete)
    delete_all = _write(PddlFunctionDao.delete_all)


class AsyncPddlActionDao(_AsyncDao):
    """`PddlActionDao` for asyncio: the DAO of actions."""

    get = _read(PddlActionDao.get)
    get_all = _read(PddlActionDao.get_all)
    save = _write(PddlActionDao.save)
    insert = _write(PddlActionDao.insert)
    update = _write(PddlActionDao.update)
    save_all = _write(PddlActionDao.save_all)
    delete = _write(PddlActionDao.delete)
    delete_all = _write(PddlActionDao.delete_all)


class AsyncPddlProcessDao(_AsyncDao):
    """`PddlProcessDao` for asyncio: the DAO of processes."""

    get = _read(PddlProcessDao.get)
    get_all = _read(PddlProcessDao.get_all)
    save = _write(PddlProcessDao.save)
    insert = _write(PddlProcessDao.insert)
    update = _write(PddlProcessDao.update)
    save_all = _write(PddlProcessDao.save_all)
    delete = _write(PddlProcessDao.delete)
    delete_all = _write(PddlProcessDao.delete_all)


class AsyncPddlEventDao(_AsyncDao):
    """`PddlEventDao` for asyncio: the DAO of events."""

    get = _read(PddlEventDao.get)
    get_all = _read(PddlEventDao.get_all)
    save = _write(PddlEventDao.save)
    insert = _write(PddlEventDao.insert)
    update = _write(PddlEventDao.update)
    save_all = _write(PddlEventDao.save_all)
    delete = _write(PddlEventDao.delete)
    delete_all = _write(PddlEventDao.delete_all)


class AsyncPddlFunctionValueDao(_AsyncDao):
    """`PddlFunctionValueDao` for asyncio: the DAO of the values of functions."""

    get = _read(PddlFunctionValueDao.get)
    get_all = _read(PddlFunctionValueDao.get_all)
    get_by_function = _read(PddlFunctionValueDao.get_by_function)
    set = _write(PddlFunctionValueDao.set)
    unset = _write(PddlFunctionValueDao.unset)
    increase = _write(PddlFunctionValueDao.increase)
    decrease = _write(PddlFunctionValueDao.decrease)
    scale_up = _write(PddlFunctionValueDao.scale_up)
    scale_down = _write(PddlFunctionValueDao.scale_down)
    save = _write(PddlFunctionValueDao.save)
    insert = _write(PddlFunctionValueDao.insert)
    update = _write(PddlFunctionValueDao.update)
    save_all = _write(PddlFunctionValueDao.save_all)
    delete = _write(PddlFunctionValueDao.delete)
    delete_all = _write(PddlFunctionValueDao.delete_all)


class AsyncPddlPropositionDao(_AsyncDao):
    """`PddlPropositionDao` for asyncio: the DAO of facts and goals."""

    get_all = _read(PddlPropositionDao.get_all)
    get_by_predicate = _read(PddlPropositionDao.get_by_predicate)
    get_goals = _read(PddlPropositionDao.get_goals)
    get_no_goals = _read(PddlPropositionDao.get_no_goals)
    save = _write(PddlPropositionDao.save)
    insert = _write(PddlPropositionDao.insert)
    update = _write(PddlPropositionDao.update)
    save_all = _write(PddlPropositionDao.save_all)
    delete = _write(PddlPropositionDao.delete)
    delete_all = _write(PddlPropositionDao.delete_all)


class AsyncDerivedPredicateDao(_AsyncDao):
    """`DerivedPredicateDao` for asyncio: the DAO of the rules for derived predicates."""

    get_all = _read(DerivedPredicateDao.get_all)
    save = _write(DerivedPredicateDao.save)
    insert = _write(DerivedPredicateDao.insert)
    save_all = _write(DerivedPredicateDao.save_all)
    delete = _write(DerivedPredicateDao.delete)
    delete_all = _write(DerivedPredicateDao.delete_all)


class AsyncTimedInitialLiteralDao(_AsyncDao):
    """`TimedInitialLiteralDao` for asyncio: the DAO of timed initial literals and values."""

    get_all = _read(TimedInitialLiteralDao.get_all)
    save = _write(TimedInitialLiteralDao.save)
    insert = _write(TimedInitialLiteralDao.insert)
    save_all = _write(TimedInitialLiteralDao.save_all)
    delete = _write(TimedInitialLiteralDao.delete)
    delete_all = _write(TimedInitialLiteralDao.delete_all)


class AsyncInitialLiteralDao(_AsyncDao):
    """`InitialLiteralDao` for asyncio: the DAO of what else is said of the initial state."""

    get_all = _read(InitialLiteralDao.get_all)
    save = _write(InitialLiteralDao.save)
    insert = _write(InitialLiteralDao.insert)
    save_all = _write(InitialLiteralDao.save_all)
    delete = _write(InitialLiteralDao.delete)
    delete_all = _write(InitialLiteralDao.delete_all)


class AsyncGoalDao(_AsyncDao):
    """`GoalDao` for asyncio: the DAO of goals of any form."""

    get_all = _read(GoalDao.get_all)
    save = _write(GoalDao.save)
    insert = _write(GoalDao.insert)
    save_all = _write(GoalDao.save_all)
    delete = _write(GoalDao.delete)
    delete_all = _write(GoalDao.delete_all)


class AsyncConstraintDao(_AsyncDao):
    """`ConstraintDao` for asyncio: the DAO of constraints."""

    get_all = _read(ConstraintDao.get_all)
    save = _write(ConstraintDao.save)
    insert = _write(ConstraintDao.insert)
    save_all = _write(ConstraintDao.save_all)
    delete = _write(ConstraintDao.delete)
    delete_all = _write(ConstraintDao.delete_all)


class AsyncMetricDao(_AsyncDao):
    """`MetricDao` for asyncio: the DAO of the metric."""

    get = _read(MetricDao.get)
    set = _write(MetricDao.set)


class AsyncPlanDao(_AsyncDao):
    """`PlanDao` for asyncio: the DAO of recorded plans."""

    record = _write(PlanDao.record)
    get = _read(PlanDao.get)
    get_all = _read(PlanDao.get_all)
    set_status = _write(PlanDao.set_status)


class AsyncKnowledgeBase:
    """A robot's knowledge for asyncio: what `KnowledgeBase` can do, with awaitable calls.

    Tasks, event loops and threads may share it. A transaction belongs to the task that opened it.
    Use it as an asynchronous context manager, or await `close`. The DAOs are the attributes that
    `KnowledgeBase` has, by the same names.
    """

    load_domain = _write(KnowledgeBase.load_domain)
    load_problem = _write(KnowledgeBase.load_problem)
    load_unified_planning = _write(KnowledgeBase.load_unified_planning)
    domain = _read(KnowledgeBase.domain)
    problem = _read(KnowledgeBase.problem)
    domain_pddl = _read(KnowledgeBase.domain_pddl)
    problem_pddl = _read(KnowledgeBase.problem_pddl)
    requirements = _read(KnowledgeBase.requirements)
    to_unified_planning = _read(KnowledgeBase.to_unified_planning)
    plan = _read(KnowledgeBase.plan)
    revisions = _read(KnowledgeBase.revisions)
    diff = _read(KnowledgeBase.diff)
    history = _read(KnowledgeBase.history)
    blame = _read(KnowledgeBase.blame)
    restore = _write(KnowledgeBase.restore)
    verify = _read(KnowledgeBase.verify)
    anchor = _read(KnowledgeBase.anchor)
    archive = _write(KnowledgeBase.archive)
    log = _Stream(KnowledgeBase.log)
    changes = _Stream(KnowledgeBase.changes)
    transaction = _Opens(KnowledgeBase.transaction)

    def __init__(self, door: _Door, *, kb: KnowledgeBase) -> None:
        """Make it; `connect` does.

        Args:
            door: the threads, shared with the views of the past.
            kb: the synchronous knowledge base.
        """
        self._door = door
        self._kb = kb
        self.types = AsyncPddlTypeDao(door, kb.types)
        self.objects = AsyncPddlObjectDao(door, kb.objects)
        self.predicates = AsyncPddlPredicateDao(door, kb.predicates)
        self.functions = AsyncPddlFunctionDao(door, kb.functions)
        self.function_values = AsyncPddlFunctionValueDao(door, kb.function_values)
        self.propositions = AsyncPddlPropositionDao(door, kb.propositions)
        self.actions = AsyncPddlActionDao(door, kb.actions)
        self.processes = AsyncPddlProcessDao(door, kb.processes)
        self.events = AsyncPddlEventDao(door, kb.events)
        self.derived_predicates = AsyncDerivedPredicateDao(door, kb.derived_predicates)
        self.timed_initial_literals = AsyncTimedInitialLiteralDao(door, kb.timed_initial_literals)
        self.initial_literals = AsyncInitialLiteralDao(door, kb.initial_literals)
        self.goals = AsyncGoalDao(door, kb.goals)
        self.constraints = AsyncConstraintDao(door, kb.constraints)
        self.domain_constraints = AsyncConstraintDao(door, kb.domain_constraints)
        self.metric = AsyncMetricDao(door, kb.metric)
        self.plans = AsyncPlanDao(door, kb.plans)

    @property
    def _sync(self) -> object:
        return self._kb

    async def at(self, when: int | datetime) -> AsyncKnowledgeBase:
        """Look at the past, as `KnowledgeBase.at` does.

        Args:
            when: a revision's number (0 is before the first), or an aware time up to now.

        Returns:
            The knowledge base as it was; it is closed with this one.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: a part of that state was moved to an archive.
        """
        return AsyncKnowledgeBase(self._door, kb=await self._door.read(partial(self._kb.at, when)))

    async def revision(self) -> int:
        """Read the number of the last revision, 0 before the first.

        Returns:
            The number; within a transaction, of the revision that it began from; on a view of the
            past, of the one that the view looks at.
        """
        return await self._door.read(lambda: self._kb.revision)

    async def watch(self, after: int | None = None, *, timeout: float | None = None) -> int | None:
        """Wait until there is a revision that the caller does not know.

        Each call that waits has a thread of its own, which ends within half a second when the call
        is cancelled.

        Args:
            after: the last revision that the caller knows; None for the head as it is now.
            timeout: how many seconds to wait; None for as long as it takes.

        Returns:
            The number of the last revision, which is larger than `after`; None when time ran out.

        Raises:
            UnknownRevisionError: the knowledge base has not come to `after` yet.
            ReadOnlyError: this is a view of the past, or the task has a transaction open.
            InvalidTimeoutError: `timeout` is negative, or no number.
            ClosedError: the knowledge base was closed meanwhile.
            StoreError: time ran out while the store could not be reached.
        """
        is_plain = isinstance(timeout, int | float) and timeout <= WATCH_SLICE
        if self._door.own_block() is not None or is_plain:
            return await self._door.read(partial(self._kb.watch, after, timeout=timeout))
        if self._door.has_one_connection:
            self._door.refuse_inherited()
        self._door.refuse_closed()
        lane, is_cancelled = _Lane(), threading.Event()
        try:
            return await asyncio.wrap_future(
                lane.submit(partial(self._watch, after, timeout, is_cancelled))
            )
        finally:
            is_cancelled.set()
            lane.end()

    def _watch(
        self, after: int | None, timeout: float | None, is_cancelled: threading.Event
    ) -> int | None:
        """Wait in slices, until the call is cancelled."""
        deadline = None if timeout is None else time.monotonic() + seconds(timeout)
        if after is None:
            # What cannot be watched is refused at once.
            self._kb.watch(None, timeout=0)
            after = self._kb.revision
        while not is_cancelled.is_set():
            left = WATCH_SLICE if deadline is None else deadline - time.monotonic()
            found = self._kb.watch(after, timeout=min(max(left, 0), WATCH_SLICE))
            if found is not None or left <= 0:
                return found
        return None

    async def close(self) -> None:
        """Close the connections, and end the threads. A view of the past closes nothing.

        Every later call raises `ClosedError`. A transaction that is open is rolled back. A store in
        memory is gone.
        """
        if self._kb is self._door.kb:
            await self._door.close()

    async def __aenter__(self) -> AsyncKnowledgeBase:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()


class Connecting(AbstractAsyncContextManager[AsyncKnowledgeBase]):
    """What `connect` gives: to await, or to use in `async with`."""

    def __init__(self, make: Callable[[], KnowledgeBase]) -> None:
        """Make it.

        Args:
            make: opens the synchronous knowledge base.
        """
        self._make = make
        self._opened: AsyncKnowledgeBase | None = None

    def __await__(self) -> Generator[object, None, AsyncKnowledgeBase]:
        return self._open().__await__()

    async def _open(self) -> AsyncKnowledgeBase:
        lane = _Lane()
        future = lane.submit(self._make)
        cancelled = await _finish(future)
        if cancelled is not None:
            if future.exception() is None:
                await _finish(lane.submit(future.result().close))
            lane.end()
            raise cancelled
        lane.end()
        kb = future.result()
        return AsyncKnowledgeBase(_Door(kb, kb.factory.has_one_connection), kb=kb)

    async def __aenter__(self) -> AsyncKnowledgeBase:
        self._opened = await self._open()
        return self._opened

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._opened is not None:
            await self._opened.close()


def connect(url: str, *, knowledge_base: str = "default", actor: str | None = None) -> Connecting:
    """Open a knowledge base for asyncio, by `await` or by `async with`.

    Args:
        url: the database URL, as for `kant_sql.connect`.
        knowledge_base: the knowledge base's name; it comes to be with its first write.
        actor: who writes, when a transaction does not say.

    Returns:
        What to await; it raises what `kant_sql.connect` raises.
    """
    return Connecting(partial(sync.connect, url, knowledge_base=knowledge_base, actor=actor))
