"""The front door for asyncio: the same calls, awaitable, and no call blocks the event loop.

The calls run in threads: those of a transaction in a thread of its own, all others in a pool.
Names, arguments, results and errors are those of `kant_sql`; the types are taken from its methods.
"""

from __future__ import annotations

import asyncio
import contextvars
import threading
import weakref
from collections import deque
from collections.abc import (
    AsyncIterator,
    Callable,
    Coroutine,
    Generator,
    Iterable,
    Iterator,
    Mapping,
)
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import AbstractAsyncContextManager, AbstractContextManager, ExitStack, suppress
from contextvars import ContextVar
from functools import cached_property, partial, update_wrapper
from inspect import isawaitable
from types import MethodType, TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from . import knowledge_base as sync
from .acts import Execution
from .dao.interfaces import (
    AnyDao,
    Dao,
    FactLike,
    FormulaDao,
    GoalDao,
    GoalLike,
    MetricDao,
    NamedDao,
    PddlFunctionValueDao,
    PddlObjectDao,
    PddlPropositionDao,
    RedefinableDao,
    ValueLike,
)
from .dto import (
    Dto,
    PddlActionDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from .dto.formulas import Derived, Equal, Formula, Node, Not, TimedLiteral
from .errors import ClosedError, StoreBusyError, TransactionCancelledError, TransactionOpenError
from .factory import DaoFactory
from .history.diff import diff_lines, state_lines
from .history.follow import watch_until
from .history.merged import Decision, Merge
from .knowledge.sayings import COMMITTED
from .knowledge_base import (
    Executions,
    KeptRules,
    KnowledgeBase,
    KnowledgeStore,
    Operations,
    PddlParts,
    factory_of,
    state_of,
)
from .limits import limited
from .moment_text import When
from .plans import PlanDao
from .reasoning.ask import Answers
from .reasoning.execute import Dispatch, ExecutedPlan, Executive, check_call
from .reasoning.replan import PlanOptions
from .reasoning.rule_watch import watcher_of
from .reasoning.rules import Rules, Verdict
from .reasoning.validate import GivenPlan
from .sql.changes import Change
from .sql.inventory import Inventory
from .store.ownership import LoopBlock

__all__ = [
    "AsyncDao",
    "AsyncExecutions",
    "AsyncFormulaDao",
    "AsyncFunctionValueDao",
    "AsyncGoalDao",
    "AsyncKeptRules",
    "AsyncKnowledgeBase",
    "AsyncKnowledgeStore",
    "AsyncMetricDao",
    "AsyncNamedDao",
    "AsyncObjectDao",
    "AsyncOperations",
    "AsyncPddlParts",
    "AsyncPlanDao",
    "AsyncPropositionDao",
    "AsyncRedefinableDao",
    "Opening",
    "connect",
    "open_store",
]

P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")
T = TypeVar("T")
E = TypeVar("E", bound=Dto | Node)
D = TypeVar("D", bound=Dto)
Given = TypeVar("Given")
N = TypeVar("N", bound=Node)
C = TypeVar("C", KnowledgeBase, KnowledgeStore)
A = TypeVar("A", bound="AsyncKnowledgeBase | AsyncKnowledgeStore")

POOL_SIZE = 8
# Seconds for which a waiting call may take a thread of the pool.
SHORT_WATCH = 0.5
BATCH = 100


def _contained(call: Callable[[], R]) -> R:
    """Run a call; convert `StopIteration`, which a future cannot raise."""
    try:
        return call()
    except StopIteration as error:
        raise RuntimeError("code within this call raised StopIteration") from error


class _Lane:
    """A thread that runs calls one after the other in one context."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "kant_sql")
        self._context = contextvars.copy_context()

    def submit(self, call: Callable[[], R]) -> Future[R]:
        """Queue a call."""
        return self._thread.submit(self._context.run, _contained, call)

    def end(self, wait: bool = False) -> None:
        """End the thread after its last call."""
        self._thread.shutdown(wait=wait)
        # A copy of the caller's context, in which an earlier lane may be.
        self._context = contextvars.Context()


async def _finish(
    future: Future[R], *, is_droppable: bool = False
) -> asyncio.CancelledError | None:
    """Wait for a call's end even when cancelled; return that cancellation, if any.

    A cancelled call that has not begun, and may be dropped, never begins.
    """
    waiter = asyncio.ensure_future(asyncio.wrap_future(future))
    cancelled = None
    while not waiter.done():
        try:
            await asyncio.wait([waiter])
        except asyncio.CancelledError as error:
            cancelled = error
            if is_droppable:
                future.cancel()
    if not waiter.cancelled():
        waiter.exception()  # Retrieved; the caller reads it from the future.
    return cancelled


class _Block:
    """An open transaction in its lane, and the task that may use it."""

    def __init__(self, door: _Door, manager: AbstractContextManager[None]) -> None:
        self.door = door
        self.manager = manager
        self.lane = _Lane()
        self.task = asyncio.current_task()
        self.is_broken = False
        self.is_open = False
        # Set before it begins: even to begin, it may hold what a call in this thread waits for.
        factory = factory_of(door.kb)
        self._in_loop = LoopBlock(factory.queue, lambda: factory.label)

    async def run(self, call: Callable[[], R]) -> R:
        """Run a call within the transaction; a cancelled call marks the block for rollback."""
        self.door.refuse_closed()
        if self.is_broken:
            raise _cancelled()
        try:
            return await asyncio.wrap_future(self.lane.submit(call))
        except asyncio.CancelledError:
            self.is_broken = True
            raise

    def run_in_thread(self, call: Callable[[], R]) -> R:
        """Run a call within the transaction, from a thread that waits for it."""
        try:
            future = self.lane.submit(call)
        except RuntimeError as error:
            raise ClosedError(
                f"{factory_of(self.door.kb).label}: this was begun within a transaction that has "
                "ended since; call it again, and await it within the block or outside of any"
            ) from error
        return future.result()

    def leave(
        self, error: BaseException | None, traceback: TracebackType | None = None
    ) -> Future[bool | None]:
        """Commit, or roll back for an error, after the running calls."""
        self.is_open = False
        self._in_loop.close()
        kind = None if error is None else type(error)
        return self.lane.submit(partial(self.manager.__exit__, kind, error, traceback))

    def abandon(self, entering: Future[None]) -> Future[None]:
        """Roll back a transaction whose caller was cancelled while it began."""

        def roll_back() -> None:
            if not entering.cancelled() and entering.exception() is None:
                error = _cancelled()
                with suppress(TransactionCancelledError):
                    self.manager.__exit__(type(error), error, None)

        return self.lane.submit(roll_back)

    def end(self) -> None:
        """End the thread; a task that outlives the block keeps only this object."""
        self.lane.end()
        self._in_loop.close()
        self.task = None
        _BLOCKS.set(tuple([block for block in _BLOCKS.get() if block is not self]))


def _closed() -> ClosedError:
    return ClosedError("this knowledge base was closed; connect again")


def _cancelled() -> TransactionCancelledError:
    return TransactionCancelledError(
        "a call within this transaction was cancelled, so its effect is unknown: nothing of the "
        "transaction is written; begin it again"
    )


_BLOCKS: ContextVar[tuple[_Block, ...]] = ContextVar("kant_sql_aio_blocks", default=())


class _Crew:
    """The threads of front doors, and how many of their tasks may write at once."""

    def __init__(self, size: int = POOL_SIZE, writers: int | None = None) -> None:
        self._pool = ThreadPoolExecutor(size, "kant_sql")
        self._is_over = False
        self.writers = writers
        self._doors: weakref.WeakSet[_Door] = weakref.WeakSet()
        self._guard = threading.Lock()
        self._places: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Semaphore] = (
            weakref.WeakKeyDictionary()
        )

    def admit(self, door: _Door) -> None:
        """Note that a door has its threads here."""
        with self._guard:
            self._doors.add(door)

    def begin_to_close(self) -> list[Callable[[], None]]:
        """Refuse further calls of all doors; return what a thread has to do then."""
        # Other event loops may open doors meanwhile.
        with self._guard:
            doors = [*self._doors]
        return [door.begin_to_close() for door in doors if not door.is_closed]

    def submit(self, call: Callable[[], R]) -> Future[R]:
        """Queue a call."""
        try:
            return self._pool.submit(contextvars.copy_context().run, _contained, call)
        except RuntimeError as error:
            if self._is_over:
                raise _closed() from error
            raise

    def shutdown(self) -> None:
        """End the threads after their last calls."""
        self._is_over = True
        self._pool.shutdown()

    def places(self) -> Iterator[asyncio.Semaphore]:
        """Yield the limits besides their queue that writers of the running event loop wait for."""
        if self.writers is not None:
            with self._guard:
                loop = asyncio.get_running_loop()
                places = self._places.get(loop)
                if places is None:
                    places = self._places[loop] = asyncio.Semaphore(self.writers)
            yield places


class _Door:
    """One front door: its threads, and the queue of its writers in each event loop."""

    def __init__(self, kb: KnowledgeBase, shared: _Crew | None = None) -> None:
        self.kb = kb
        self.is_closed = False
        self.is_closing = threading.Event()
        self._is_shared = shared is not None
        self._crew = _Crew() if shared is None else shared
        self._crew.admit(self)
        self._running: set[Future[Any]] = set()
        self._guard = threading.Lock()
        self._queues: weakref.WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Lock] = (
            weakref.WeakKeyDictionary()
        )
        self.blocks: set[_Block] = set()

    def refuse_closed(self) -> None:
        """Raise `ClosedError` if it was closed."""
        if self.is_closed:
            raise _closed()

    def _is_behind(self, block: _Block) -> bool:
        """Return whether this door would wait for the end of a block."""
        door, queue = block.door, factory_of(self.kb).queue
        # Two front doors may share a knowledge base or a file.
        is_same = door is self or (queue is not None and factory_of(door.kb).queue == queue)
        return is_same or (self._crew.writers == 1 and door._crew is self._crew)

    def own_block(self) -> _Block | None:
        """Find the open block of the running task."""
        task = asyncio.current_task()
        for block in reversed(_BLOCKS.get()):
            if block.door is self and block.is_open and block.task is task:
                return block
        return None

    def refuse_inherited(self) -> None:
        """Refuse to wait for the block that started this task: it may wait for the task."""
        for block in _BLOCKS.get():
            if block.is_open and self._is_behind(block):
                name = "a task" if block.task is None else f"task {block.task.get_name()!r}"
                if block.task is asyncio.current_task():
                    raise TransactionOpenError(
                        f"{name} has a transaction open by another object of this knowledge base, "
                        "or of a store with one writer at a time, and would wait for itself: end "
                        "it first, or write by the object that opened it"
                    )
                raise TransactionOpenError(
                    f"this task was started within a transaction of {name} that is still open: "
                    "only that task may use it, and it may wait for this one; write in the task "
                    "that opened it, or end the transaction first"
                )

    def refuse_to_wait(self) -> None:
        """Refuse a read outside of a block, which may wait for a block, or after the end."""
        self.refuse_closed()
        if factory_of(self.kb).has_one_connection:
            self.refuse_inherited()

    def queue(self) -> asyncio.Lock:
        """Return the queue of writers of the running event loop."""
        loop = asyncio.get_running_loop()
        with self._guard:
            return self._queues.setdefault(loop, asyncio.Lock())

    async def enter_queue(self) -> ExitStack:
        """Wait for the turn to write; closing what this returns ends the turn."""
        queues: tuple[asyncio.Lock | asyncio.Semaphore, ...] = self.queue(), *self._crew.places()
        patience = factory_of(self.kb).patience
        with ExitStack() as turn:
            try:
                async with asyncio.timeout(patience):
                    for queue in queues:
                        await queue.acquire()
                        turn.callback(queue.release)
            except TimeoutError as error:
                raise StoreBusyError(
                    f"other tasks held the knowledge base for over {patience:g} s; nothing "
                    "was written, try again"
                ) from error
            return turn.pop_all()

    async def read(self, call: Callable[[], R]) -> R:
        """Run a call that only reads: in the task's transaction, or in the pool."""
        block = self.own_block()
        if block is not None:
            return await block.run(call)
        self.refuse_to_wait()
        return await asyncio.wrap_future(self._submit(call))

    async def write(self, call: Callable[[], R]) -> R:
        """Run a call that writes: in the task's transaction, or when it is this task's turn."""
        block = self.own_block()
        if block is not None:
            return await block.run(call)
        self.refuse_inherited()
        self.refuse_closed()
        with await self.enter_queue():
            future = self._submit(call)
            cancelled = await _finish(future, is_droppable=True)
        if cancelled is not None:
            # A running commit cannot be undone.
            raise cancelled
        return future.result()

    def _submit(self, call: Callable[[], R]) -> Future[R]:
        self.refuse_closed()
        future = self._crew.submit(call)
        self._running.add(future)
        future.add_done_callback(self._running.discard)
        return future

    async def close(self) -> None:
        """Roll back open transactions, close the knowledge base, and wait for the threads."""
        if not self.is_closed:
            await _in_a_thread(self.begin_to_close())

    def begin_to_close(self) -> Callable[[], None]:
        """Refuse further calls; return the rest of the work, for a thread."""
        self.is_closed = True
        self.is_closing.set()
        error = ClosedError("this knowledge base was closed; nothing of the block was written")
        # Its own task ends a block that is about to begin.
        blocks = [block for block in self.blocks if block.is_open]
        leaving = [block.leave(error) for block in blocks]

        def close() -> None:
            for future in leaving:
                future.exception()
            self.kb.close()
            wait([*self._running])
            if not self._is_shared:
                self._crew.shutdown()
            for block in blocks:
                block.lane.end(wait=True)

        return close


async def _in_a_thread(call: Callable[[], None]) -> None:
    """Run a call to its end in a thread of its own, even when cancelled."""
    lane = _Lane()
    future = lane.submit(call)
    cancelled = await _finish(future)
    lane.end()
    if cancelled is not None:
        raise cancelled
    future.result()


async def _until_stopped(call: Callable[[], R], stop: Callable[[], object]) -> R:
    """Run a call in a thread of its own; when cancelled, stop it, and wait for its end."""
    lane = _Lane()
    future = lane.submit(call)
    waiter = asyncio.wrap_future(future)
    # The cancelled caller reads no error.
    waiter.add_done_callback(lambda one: one.cancelled() or one.exception())
    try:
        return await asyncio.shield(waiter)
    except asyncio.CancelledError:
        stopping = stop()
        if isawaitable(stopping):
            await stopping
        await _finish(future)
        raise
    finally:
        lane.end()


class _Transaction(AbstractAsyncContextManager[None]):
    """`async with kb.transaction(...)`: a block in a thread of its own."""

    def __init__(self, door: _Door, make: Callable[[], AbstractContextManager[None]]) -> None:
        self._door = door
        self._make = make
        self._joined: tuple[_Block, AbstractContextManager[None]] | None = None
        self._block: _Block | None = None
        self._turn: ExitStack | None = None

    async def __aenter__(self) -> None:
        self._door.refuse_closed()
        outer = self._door.own_block()
        if outer is not None:
            manager = self._make()
            await outer.run(manager.__enter__)
            self._joined = (outer, manager)
            return
        self._door.refuse_inherited()
        self._turn = await self._door.enter_queue()
        try:
            self._door.refuse_closed()
            block = _Block(self._door, self._make())
        except BaseException:
            self._turn.close()
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
            # BEGIN may wait for another process: the lane's thread rolls it back.
            loop = asyncio.get_running_loop()
            block.abandon(entering).add_done_callback(
                lambda _: self._call_soon(loop, partial(self._end, block))
            )
            block.end()
            raise
        except BaseException:
            self._end(block)
            raise

    @staticmethod
    def _call_soon(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # The loop is closed: no task waits in it.
            loop.call_soon_threadsafe(call)

    def _end(self, block: _Block) -> None:
        block.end()
        self._door.blocks.discard(block)
        if self._turn is not None:
            self._turn.close()

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
            # The front door was closed within the block.
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
    """The items of a store's iterator, read in batches in a thread."""

    def __init__(self, door: _Door, make: Callable[[], Iterable[R]]) -> None:
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
        # A cancelled read may still run: its items are kept.
        with self._reading:
            try:
                if self._iterator is None:
                    self._iterator = iter(self._make())
                while len(self._ready) < BATCH:
                    self._ready.append(next(self._iterator))
            except StopIteration:
                self._is_over = True
            except Exception as error:
                self._is_over, self._error = True, error


class _Part:
    """A synchronous object, the front door or one of its DAOs, whose calls run in threads."""

    def __init__(self, door: _Door, *, find: Callable[[], Any]) -> None:
        self._door = door
        # Looked up by each call: it may be closed by then.
        self._find = find


class _Call(Generic[P, R]):
    """A method of the synchronous interface, which `run` calls in a thread."""

    def __init__(
        self, method: Callable[Concatenate[S, P], T], run: Callable[[_Door, Callable[[], T]], R]
    ) -> None:
        self._method: Callable[..., T] = method
        self._run: Callable[[_Door, Callable[[], T]], R] = run
        self.__doc__ = method.__doc__

    def __get__(self, part: _Part, owner: type[_Part] | None = None) -> Callable[P, R]:
        if part is None:
            return self  # type: ignore[unreachable]
        name, run = self._method.__name__, self._run

        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            return run(part._door, lambda: getattr(part._find(), name)(*args, **kwargs))

        return update_wrapper(call, MethodType(self._method, part))


def _read(method: Callable[Concatenate[S, P], R]) -> _Call[P, Coroutine[object, object, R]]:
    return _Call(method, _Door.read)


def _write(method: Callable[Concatenate[S, P], R]) -> _Call[P, Coroutine[object, object, R]]:
    return _Call(method, _Door.write)


def _iterate(method: Callable[Concatenate[S, P], Iterable[R]]) -> _Call[P, AsyncIterator[R]]:
    return _Call(method, _Entries)


async def _until_answered(door: _Door, ask: Callable[[], R]) -> R:
    """Run planners; cancellation ends them."""
    with limited() as limit:
        if door.own_block() is not None:
            return await door.read(ask)
        door.refuse_to_wait()
        return await _until_stopped(ask, lambda: asyncio.to_thread(limit.cancel))


async def _read_all(door: _Door, ask: Callable[[], Answers]) -> Answers:
    """Evaluate a condition, and read all answers in the same thread."""

    def read() -> Answers:
        answers = ask()
        len(answers)
        return answers

    return await door.read(read)


async def _open_past(door: _Door, ask: Callable[[], KnowledgeBase]) -> AsyncKnowledgeBase:
    """Open a past state; closing the front door closes it."""
    return AsyncKnowledgeBase(door, kb=await door.read(ask))


def _begin_branch(door: _Door, begin: Callable[[], KnowledgeBase]) -> Opening[AsyncKnowledgeBase]:
    """Begin a branch, in the thread of the task's transaction if there is one."""
    door.refuse_closed()
    block = door.own_block()
    if block is not None:
        return Opening(partial(block.run_in_thread, begin), wrap=_front_door)
    door.refuse_to_wait()
    return Opening(begin, wrap=_front_door)


def _search(method: Callable[Concatenate[S, P], R]) -> _Call[P, Coroutine[object, object, R]]:
    return _Call(method, _until_answered)


class _Beside(cached_property[T]):
    """A part of a front door: the synchronous part of the same name, wrapped on first use."""

    def __init__(self, make: Callable[..., T]) -> None:
        def made(part: _Part) -> T:
            return make(part._door, find=lambda: getattr(part._find(), str(self.attrname)))

        super().__init__(made)


class _AsyncElements(_Part, Generic[E, Given]):
    get_all = _read(AnyDao[E, Given].get_all)
    insert = _write(AnyDao[E, Given].insert)
    save_all = _write(AnyDao[E, Given].save_all)
    delete = _write(AnyDao[E, Given].delete)
    delete_all = _write(AnyDao[E, Given].delete_all)


class AsyncDao(_AsyncElements[D, Given]):
    """`Dao` for asyncio."""

    save = _write(Dao[D, Given].save)
    update = _write(Dao[D, Given].update)


class AsyncNamedDao(AsyncDao[D, D | str]):
    """`NamedDao` for asyncio: the DAOs of actions, processes and events."""

    get = _read(NamedDao[D].get)


class AsyncRedefinableDao(_AsyncElements[D, D | str]):
    """`RedefinableDao` for asyncio: the DAOs of types, objects, predicates and functions."""

    get = _read(RedefinableDao[D].get)
    save = _write(RedefinableDao[D].save)
    update = _write(RedefinableDao[D].update)


class AsyncObjectDao(AsyncRedefinableDao[PddlObjectDto]):
    """`PddlObjectDao` for asyncio."""

    get_by_type = _read(PddlObjectDao.get_by_type)


class AsyncPropositionDao(AsyncDao[PddlPropositionDto, FactLike]):
    """`PddlPropositionDao` for asyncio."""

    get_by_predicate = _read(PddlPropositionDao.get_by_predicate)
    get_by_object = _read(PddlPropositionDao.get_by_object)
    confirm = _write(PddlPropositionDao.confirm)


class AsyncFunctionValueDao(AsyncDao[PddlFunctionValueDto, ValueLike]):
    """`PddlFunctionValueDao` for asyncio."""

    get = _read(PddlFunctionValueDao.get)
    get_by_function = _read(PddlFunctionValueDao.get_by_function)
    set = _write(PddlFunctionValueDao.set)
    unset = _write(PddlFunctionValueDao.unset)
    increase = _write(PddlFunctionValueDao.increase)
    decrease = _write(PddlFunctionValueDao.decrease)
    scale_up = _write(PddlFunctionValueDao.scale_up)
    scale_down = _write(PddlFunctionValueDao.scale_down)


class AsyncFormulaDao(_AsyncElements[N, Given]):
    """`FormulaDao` for asyncio: the DAOs of goals, constraints, derived predicates and so on."""

    save = _write(FormulaDao[N, Given].save)


class AsyncGoalDao(AsyncFormulaDao[Formula, GoalLike]):
    """`GoalDao` for asyncio."""

    get_propositions = _read(GoalDao.get_propositions)


class AsyncMetricDao(_Part):
    """`MetricDao` for asyncio."""

    get = _read(MetricDao.get)
    set = _write(MetricDao.set)


class AsyncPlanDao(_Part):
    """`PlanDao` for asyncio."""

    record = _write(PlanDao.record)
    get = _read(PlanDao.get)
    get_all = _read(PlanDao.get_all)
    set_status = _write(PlanDao.set_status)


class AsyncPddlParts(_Part):
    """`PddlParts` for asyncio."""

    processes = _Beside(AsyncNamedDao[PddlProcessDto])
    events = _Beside(AsyncNamedDao[PddlEventDto])
    derived_predicates = _Beside(AsyncFormulaDao[Derived, Derived | str])
    timed_initial_literals = _Beside(AsyncFormulaDao[TimedLiteral, TimedLiteral | str])
    initial_literals = _Beside(AsyncFormulaDao[Not | Equal, Not | Equal | str])
    constraints = _Beside(AsyncFormulaDao[Formula, Formula | str])
    domain_constraints = _Beside(AsyncFormulaDao[Formula, Formula | str])
    metric = _Beside(AsyncMetricDao)

    metric_value = _read(PddlParts.metric_value)
    check_rules = _read(PddlParts.check_rules)
    causal_links = _read(PddlParts.causal_links)
    broken_invariants = _read(PddlParts.broken_invariants)
    domain = _read(PddlParts.domain)
    problem = _read(PddlParts.problem)
    requirements = _read(PddlParts.requirements)
    complete = _read(PddlParts.complete)
    to_unified_planning = _read(PddlParts.to_unified_planning)
    load_unified_planning = _write(PddlParts.load_unified_planning)


class AsyncExecutions(_Part):
    """`Executions` for asyncio."""

    get = _read(Executions.get)
    get_all = _iterate(Executions.get_all)
    report = _write(Executions.report)


class AsyncKeptRules(_Part):
    """`KeptRules` for asyncio."""

    get = _read(KeptRules.get)
    get_all = _read(KeptRules.get_all)
    save = _write(KeptRules.save)
    delete = _write(KeptRules.delete)
    standing = _read(KeptRules.standing)


class AsyncOperations(_Part):
    """`Operations` for asyncio."""

    revisions = _read(Operations.revisions)
    verify = _read(Operations.verify)
    anchor = _read(Operations.anchor)
    archive = _write(Operations.archive)
    retain = _write(Operations.retain)
    # This reads: other tasks write meanwhile.
    push = _read(Operations.push)
    promote = _write(Operations.promote)
    to_arrow = _read(Operations.to_arrow)

    @property
    def factory(self) -> DaoFactory:
        """The factory of the synchronous DAOs, as `Operations.factory`."""
        return factory_of(self._find())


class AsyncKnowledgeBase(_Part):
    """`KnowledgeBase` for asyncio: the same methods and DAOs, with awaitable calls.

    Tasks, event loops and threads may share it. A transaction belongs to the task that opened it.
    Use it as an asynchronous context manager, or await `close`.
    """

    types = _Beside(AsyncRedefinableDao[PddlTypeDto])
    objects = _Beside(AsyncObjectDao)
    predicates = _Beside(AsyncRedefinableDao[PddlPredicateDto])
    functions = _Beside(AsyncRedefinableDao[PddlFunctionDto])
    function_values = _Beside(AsyncFunctionValueDao)
    propositions = _Beside(AsyncPropositionDao)
    goals = _Beside(AsyncGoalDao)
    actions = _Beside(AsyncNamedDao[PddlActionDto])
    plans = _Beside(AsyncPlanDao)
    pddl = _Beside(AsyncPddlParts)
    executions = _Beside(AsyncExecutions)
    rules = _Beside(AsyncKeptRules)
    store = _Beside(AsyncOperations)

    transaction = _Call(KnowledgeBase.transaction, _Transaction)
    load_domain = _write(KnowledgeBase.load_domain)
    load_problem = _write(KnowledgeBase.load_problem)
    domain_pddl = _read(KnowledgeBase.domain_pddl)
    problem_pddl = _read(KnowledgeBase.problem_pddl)
    query = _Call(KnowledgeBase.query, _read_all)
    holds = _read(KnowledgeBase.holds)
    when = _iterate(KnowledgeBase.when)
    consequences = _read(KnowledgeBase.consequences)
    origins = _read(KnowledgeBase.origins)
    unsatisfied = _read(KnowledgeBase.unsatisfied)
    why_not = _read(KnowledgeBase.why_not)
    applicable_actions = _iterate(KnowledgeBase.applicable_actions)
    apply = _write(KnowledgeBase.apply)
    start = _write(KnowledgeBase.start)
    end = _write(KnowledgeBase.end)
    abort = _write(KnowledgeBase.abort)
    fail = _write(KnowledgeBase.fail)
    statistics = _read(KnowledgeBase.statistics)
    plan = _search(KnowledgeBase.plan)
    replan = _search(KnowledgeBase.replan)
    validate = _read(KnowledgeBase.validate)
    state = _read(KnowledgeBase.state)
    commit = _write(KnowledgeBase.commit)
    log = _iterate(KnowledgeBase.log)
    changes = _iterate(KnowledgeBase.changes)
    history = _read(KnowledgeBase.history)
    blame = _read(KnowledgeBase.blame)
    unconfirmed = _read(KnowledgeBase.unconfirmed)
    contradicted = _read(KnowledgeBase.contradicted)
    corrections = _read(KnowledgeBase.corrections)
    stale = _read(KnowledgeBase.stale)
    timeline = _read(KnowledgeBase.timeline)
    restore = _write(KnowledgeBase.restore)
    erasure_preview = _write(KnowledgeBase.erasure_preview)
    erase = _write(KnowledgeBase.erase)
    at = _Call(KnowledgeBase.at, _open_past)
    branch = _Call(KnowledgeBase.branch, _begin_branch)

    def __init__(self, door: _Door, *, kb: KnowledgeBase) -> None:
        """Wrap a knowledge base; `connect` does this.

        Args:
            door: the threads, shared with the views of the past.
            kb: the synchronous knowledge base.
        """
        super().__init__(door, find=lambda: kb)
        self._kb = kb

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {factory_of(self._kb).label}>"

    async def diff(
        self,
        a: When | AsyncKnowledgeBase | KnowledgeBase,
        b: When | AsyncKnowledgeBase | KnowledgeBase,
        *,
        clock: str = COMMITTED,
    ) -> list[Change]:
        """Compare two states, as `KnowledgeBase.diff`."""
        kinds = AsyncKnowledgeBase | KnowledgeBase
        if clock != COMMITTED or not (isinstance(a, kinds) or isinstance(b, kinds)):
            call = partial(self._kb.diff, _plain(a), _plain(b), clock=clock)
            return await self._door.read(call)
        here, there = await self._lines(a), await self._lines(b)
        return diff_lines(here, there)

    async def merge_preview(
        self,
        branch: AsyncKnowledgeBase | KnowledgeBase,
        *,
        decide: Mapping[str, Decision] | None = None,
    ) -> Merge:
        """Compare a branch with this knowledge base, as `KnowledgeBase.merge_preview`."""
        call = partial(self._kb.merge_preview, _plain(branch), decide=decide)
        return await self._door.write(call)

    async def merge(
        self,
        branch: AsyncKnowledgeBase | KnowledgeBase,
        *,
        decide: Mapping[str, Decision] | None = None,
        reason: str | None = None,
        actor: str | None = None,
        expected_revision: int | None = None,
    ) -> Merge:
        """Merge a branch, as `KnowledgeBase.merge`."""
        own: Any = {"decide": decide, "reason": reason, "actor": actor}
        call = partial(self._kb.merge, _plain(branch), **own, expected_revision=expected_revision)
        return await self._door.write(call)

    async def _lines(self, of: When | AsyncKnowledgeBase | KnowledgeBase) -> list[tuple[str, str]]:
        """Read a state in the block that its task has open, if any, or else in the pool."""
        if not isinstance(of, AsyncKnowledgeBase | KnowledgeBase):
            of = await self.at(of)
        door, kb = of._door if isinstance(of, AsyncKnowledgeBase) else self._door, _plain(of)
        return await door.read(lambda: state_lines(state_of(kb)))

    async def revision(self) -> int:
        """Read the number of the last revision, as `KnowledgeBase.revision`."""
        return await self._door.read(lambda: self._kb.revision)

    async def execute(
        self,
        plan: GivenPlan,
        dispatch: Dispatch,
        *,
        cancel: Dispatch | None = None,
        timeout: float | None = 0,
        speed: float = 1,
        reason: str | None = None,
        replan: PlanOptions | None = None,
    ) -> ExecutedPlan:
        """Execute a plan, as `KnowledgeBase.execute`; `dispatch` may be a coroutine function.

        Coroutines run in this event loop, and are cancelled when the plan ends early; functions run
        in threads. Cancelling this call cancels the plan.
        """
        check_call(cancel, "cancel")
        loop = asyncio.get_running_loop()
        tasks: dict[str, asyncio.Task[Any] | None] = {}

        def do(step: Execution) -> object:
            made = dispatch(step)
            if not isawaitable(made):
                return made

            async def run() -> object:
                if step.id in tasks:  # It was cancelled before it began.
                    raise asyncio.CancelledError
                tasks[step.id] = asyncio.current_task()
                return await made

            return asyncio.run_coroutine_threadsafe(run(), loop).result()

        def call_off(step: Execution) -> None:
            task = tasks.setdefault(step.id, None)
            if task is not None:
                task.cancel()

        def stop(step: Execution) -> None:
            loop.call_soon_threadsafe(call_off, step)
            if cancel is not None:
                cancel(step)

        given = plan, do, stop, timeout, speed, reason, replan
        executive = await self._door.write(lambda: Executive(state_of(self._kb), *given))
        return await _until_stopped(executive.run, executive.give_up)

    async def watch(self, after: When | None = None, *, timeout: float | None = None) -> int | None:
        """Wait for a new revision, as `KnowledgeBase.watch`.

        Each waiting call has a thread of its own, which ends within half a second after the call
        is cancelled.
        """
        is_plain = isinstance(timeout, int | float) and timeout <= SHORT_WATCH
        if self._door.own_block() is not None or is_plain:
            return await self._door.read(partial(self._kb.watch, after, timeout=timeout))
        self._door.refuse_to_wait()
        lane, cancelled = _Lane(), threading.Event()
        try:
            return await asyncio.wrap_future(
                lane.submit(
                    lambda: watch_until(state_of(self._kb), after, timeout, cancelled.is_set)
                )
            )
        finally:
            cancelled.set()
            lane.end()

    async def watch_rules(
        self,
        rules: Rules | None = None,
        *,
        after: When | None = None,
        since: When | None = None,
        timeout: float | None = None,
    ) -> AsyncIterator[Verdict]:
        """Follow rules, as `KnowledgeBase.watch_rules`; it waits as `watch`."""
        begin = partial(watcher_of, state_of(self._kb), rules, after, since)
        watcher = await self._door.read(begin)
        while (head := await self.watch(watcher.last, timeout=timeout)) is not None:
            for verdict in await self._door.read(partial(watcher.follow, head)):
                yield verdict

    async def close(self) -> None:
        """Close the connections and end the threads, as `KnowledgeBase.close`."""
        if self._kb is self._door.kb:
            await self._door.close()

    async def __aenter__(self) -> AsyncKnowledgeBase:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()


class AsyncKnowledgeStore:
    """`KnowledgeStore` for asyncio: many knowledge bases over few connections and threads.

    Tasks, event loops and threads may share it. Use it as an asynchronous context manager, or await
    `close`.
    """

    def __init__(self, store: KnowledgeStore) -> None:
        self._store = store
        self._crew = _Crew(store.connections, store.writers)
        self._is_closed = False

    def knowledge_base(
        self, name: str = "default", *, actor: str | None = None, clock: str = COMMITTED
    ) -> AsyncKnowledgeBase:
        """Open a knowledge base of the store, as `KnowledgeStore.knowledge_base`.

        This takes no statement, so it is not awaited.
        """
        kb = self._store.knowledge_base(name, actor=actor, clock=clock)
        return AsyncKnowledgeBase(_Door(kb, self._crew), kb=kb)

    async def knowledge_bases(self) -> list[Inventory]:
        """List the knowledge bases that have a revision, as `KnowledgeStore.knowledge_bases`."""
        if self._is_closed:
            # Raises the error.
            return self._store.knowledge_bases()
        return await asyncio.wrap_future(self._crew.submit(self._store.knowledge_bases))

    async def close(self) -> None:
        """Close all knowledge bases and connections, and end the threads."""
        if self._is_closed:
            return
        self._is_closed = True
        closing = self._crew.begin_to_close()

        def close() -> None:
            for end in closing:
                end()
            self._store.close()
            self._crew.shutdown()

        await _in_a_thread(close)

    async def __aenter__(self) -> AsyncKnowledgeStore:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()


class Opening(AbstractAsyncContextManager[A]):
    """A knowledge base or store that is being opened: await it, or use it in `async with`."""

    def __init__(self, make: Callable[[], C], *, wrap: Callable[[C], A]) -> None:
        self._make: Callable[[], Any] = make
        self._wrap: Callable[[Any], A] = wrap
        self._opened: A | None = None

    def __await__(self) -> Generator[object, None, A]:
        return self._open().__await__()

    async def __aenter__(self) -> A:
        self._opened = await self._open()
        return self._opened

    async def __aexit__(self, *error: object) -> None:
        if self._opened is not None:
            await self._opened.close()

    async def _open(self) -> A:
        """Open it in a thread; close it if the caller was cancelled meanwhile."""
        lane = _Lane()
        future = lane.submit(self._make)
        cancelled = await _finish(future)
        if cancelled is not None:
            if future.exception() is None:
                await _finish(lane.submit(future.result().close))
            lane.end()
            raise cancelled
        lane.end()
        return self._wrap(future.result())


def _plain(given: T | AsyncKnowledgeBase) -> T | KnowledgeBase:
    """Return the synchronous knowledge base of an asynchronous one; other arguments unchanged."""
    return given._kb if isinstance(given, AsyncKnowledgeBase) else given


def _front_door(kb: KnowledgeBase) -> AsyncKnowledgeBase:
    return AsyncKnowledgeBase(_Door(kb), kb=kb)


def connect(
    url: str,
    *,
    knowledge_base: str = "default",
    actor: str | None = None,
    read_only: bool = False,
    clock: str = COMMITTED,
) -> Opening[AsyncKnowledgeBase]:
    """Open a knowledge base for asyncio, with `await` or `async with`.

    Args:
        url: the database URL, as for `kant_sql.connect`.
        knowledge_base: the knowledge base's name; the first write creates it.
        actor: who writes, by default.
        read_only: whether the database refuses all writes, as for `kant_sql.connect`.
        clock: the valid time of a transaction with `observed_at`, as for `kant_sql.connect`.

    Returns:
        An awaitable; it raises what `kant_sql.connect` raises.

    Examples:
        >>> import asyncio
        >>> from kant_sql import aio
        >>> async def main():
        ...     async with aio.connect("sqlite://") as kb:
        ...         await kb.types.save(PddlTypeDto("robot"))
        ...         return await kb.revision()
        >>> asyncio.run(main())
        1
    """
    own: Any = {"knowledge_base": knowledge_base, "actor": actor, "read_only": read_only}
    make = partial(sync.connect, url, **own, clock=clock)
    return Opening(make, wrap=_front_door)


def open_store(
    url: str, *, connections: int = 8, read_only: bool = False
) -> Opening[AsyncKnowledgeStore]:
    """Open a store for asyncio, with `await` or `async with`.

    It runs the calls in as many threads as it has connections; further tasks wait in the event
    loop.

    Args:
        url: the database URL, as for `kant_sql.connect`.
        connections: the maximum number of connections to a server, as for `kant_sql.open_store`.
        read_only: whether the database refuses all writes of these connections.

    Returns:
        An awaitable; it raises what `kant_sql.open_store` raises.

    Examples:
        >>> import asyncio
        >>> from kant_sql import PddlTypeDto, aio
        >>> async def main():
        ...     async with aio.open_store("sqlite://") as store:
        ...         for name in ("tiago", "pepper"):
        ...             await store.knowledge_base(name).types.save(PddlTypeDto("robot"))
        ...         return [one.name for one in await store.knowledge_bases()]
        >>> asyncio.run(main())
        ['tiago', 'pepper']
    """
    make = partial(sync.open_store, url, connections=connections, read_only=read_only)
    return Opening(make, wrap=AsyncKnowledgeStore)
