"""The asynchronous front door: nothing acknowledged is lost, and nothing waits in vain."""

from __future__ import annotations

import asyncio
import inspect
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, assert_type

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql.aio import AsyncKnowledgeBase
from kant_sql.errors import (
    ClosedError,
    ConnectionLostError,
    TransactionCancelledError,
    TransactionOpenError,
)
from kant_sql.sql.dialects import base as retry
from kant_sql.sql.dialects.base import Backend, Session
from kant_sql.store.store import Store
from tests.contract.test_closed import calls
from tests.support.generators.junk import World
from tests.support.parts import DAOS, FRONTS, part
from tests.support.processes.workers import PATIENCE
from tests.support.profile import PROFILE, hunting
from tests.support.reading import Undone, present
from tests.support.worlds.robots import RB1, ROBOT, WP2, robot_at, waypoint

# Who waits for another waits longer.
PROMPTLY = Backend.patience / 2


@asynccontextmanager
async def opened(url: str) -> AsyncIterator[AsyncKnowledgeBase]:
    """A knowledge base for a minute at most, whose threads are all gone afterwards."""
    before = own_threads()
    async with (
        kant_sql.aio.connect(url, knowledge_base="tiago", actor="base") as kb,
        asyncio.timeout(60),
    ):
        yield kb
    for thread in own_threads() - before:
        await asyncio.to_thread(thread.join, PATIENCE)
        assert not thread.is_alive()


def own_threads() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name.startswith("kant_sql")}


async def written(kb: AsyncKnowledgeBase) -> list[tuple[str | None, list[str]]]:
    return [
        (entry.revision.actor, [one.text for one in entry.changes if one.kind in ("fact", "goal")])
        async for entry in kb.changes()
    ]


@asynccontextmanager
async def free_loop() -> AsyncIterator[None]:
    """Check that the loop goes on meanwhile."""
    longest = 0.0

    async def tick() -> None:
        nonlocal longest
        while True:
            began = time.monotonic()
            await asyncio.sleep(0.01)
            longest = max(longest, time.monotonic() - began)

    ticking = asyncio.create_task(tick())
    yield
    ticking.cancel()
    assert longest < PROMPTLY


async def test_it_can_do_all_that_the_synchronous_front_door_can() -> None:
    def names(cls: type) -> set[str]:
        return {name for name in dir(cls) if not name.startswith("_")}

    async with opened("sqlite://") as kb:
        for path, cls in {**FRONTS, **DAOS}.items():
            assert names(cls) <= {name for name in dir(part(kb, path)) if name[0] != "_"}, path


async def test_types_are_those_of_the_synchronous_methods() -> None:
    """The type checker judges this: what it does not refuse here is an unused `ignore`."""

    async with opened("sqlite://") as kb:
        await kb.types.save(ROBOT, cascade=True)
        assert_type(await kb.types.get("robot"), kant_sql.PddlTypeDto | None)
        assert_type(await kb.propositions.get_all(), list[kant_sql.PddlPropositionDto])
        assert_type(await kb.watch(0, timeout=1), int | None)
        async for entry in kb.changes(0):
            assert_type(entry, kant_sql.LogEntry)
        with pytest.raises(kant_sql.InvalidKnowledgeError):
            await kb.types.save(5)  # type: ignore[arg-type]
        with pytest.raises(TypeError):
            await kb.restore(1, "reason")  # type: ignore[call-arg]
        with pytest.raises(TypeError):
            await kb.transaction("actor").__aenter__()  # type: ignore[call-arg]
        await kb.propositions.save(robot_at())


async def test_each_transaction_is_its_own_tasks(url: str) -> None:
    async with opened(url) as kb:
        is_open, may_end = asyncio.Event(), asyncio.Event()

        async def well() -> None:
            async with kb.transaction(actor="well"):
                await kb.propositions.save(robot_at())
                is_open.set()
                await may_end.wait()
                assert await kb.propositions.get_all() == [robot_at()]

        async def badly() -> None:
            await is_open.wait()
            may_end.set()
            async with kb.transaction(actor="badly"):
                await kb.propositions.save(robot_at(place=WP2))
                raise Undone

        async with free_loop():
            ends = await asyncio.gather(well(), badly(), return_exceptions=True)
        assert [type(end) for end in ends] == [type(None), Undone]
        assert await written(kb) == [("well", ["(robot_at rb1 wp1)"])]


async def test_independent_tasks_queue_without_blocking_the_loop(url: str) -> None:
    async with opened(url) as kb:

        async def writer(number: int) -> None:
            async with kb.transaction(actor=f"t{number}"):
                await kb.propositions.save(robot_at(place=waypoint(2 * number)))
                await asyncio.sleep(0.001)
                await kb.propositions.save(robot_at(place=waypoint(2 * number + 1)))

        async def single(number: int) -> None:
            await kb.propositions.save(robot_at(place=waypoint(100 + number)))

        async with free_loop():
            await asyncio.gather(*map(writer, range(20)), *map(single, range(20)))
        found = await written(kb)
        assert sorted(len(facts) for _, facts in found) == [1] * 20 + [2] * 20
        assert len({actor for actor, facts in found if len(facts) == 2}) == 20


async def test_the_seconds_of_the_url_bound_the_wait_for_a_turn(tmp_path: Path) -> None:
    async with opened(f"sqlite:///{tmp_path / 'robot.db'}?timeout=0.2") as kb:
        is_open = asyncio.Event()

        async def hold() -> None:
            async with kb.transaction():
                is_open.set()
                await asyncio.sleep(600)

        holding = asyncio.create_task(hold())
        await is_open.wait()
        with pytest.raises(kant_sql.StoreBusyError, match=r"over 0\.2 s"):
            await kb.objects.save(RB1)
        holding.cancel()


async def test_a_task_started_in_a_block_is_refused_at_once(url: str) -> None:
    async with opened(url) as kb:

        async def opens() -> None:
            async with kb.transaction():
                raise AssertionError

        async with kb.transaction(actor="parent"):
            await kb.propositions.save(robot_at())
            began = time.monotonic()
            ends = await asyncio.gather(
                kb.propositions.save(robot_at(place=WP2)), opens(), return_exceptions=True
            )
            assert time.monotonic() - began < PROMPTLY
            assert [type(end) for end in ends] == [TransactionOpenError] * 2
            async with kb.transaction(actor="inner"):
                await kb.goals.save(robot_at(is_goal=True))
        assert [actor for actor, _ in await written(kb)] == ["parent"]
        assert await kb.propositions.get_all() == [robot_at()]
        assert await kb.goals.get_propositions() == [robot_at(is_goal=True)]


async def test_what_a_child_reads_is_committed_or_refused(url: str) -> None:
    async with opened(url) as kb:
        await kb.objects.save(RB1)
        async with kb.transaction():
            await kb.propositions.save(robot_at())
            reading = asyncio.create_task(kb.propositions.get_all())
            if url == "sqlite://":
                with pytest.raises(TransactionOpenError):
                    await reading
            else:
                assert await reading == []


async def test_an_inner_block_that_fails_is_undone_alone(url: str) -> None:
    async with opened(url) as kb:
        async with kb.transaction():
            await kb.propositions.save(robot_at())
            with suppress(Undone):
                async with kb.transaction():
                    await kb.propositions.save(robot_at(place=WP2))
                    raise Undone
        assert await kb.propositions.get_all() == [robot_at()]
        with pytest.raises(kant_sql.StaleRevisionError):
            async with kb.transaction(expected_revision=7):
                raise AssertionError
        await kb.propositions.save(robot_at(place=WP2))


@pytest.mark.parametrize("where", ["call", "pause", "swallowed"])
async def test_cancellation_rolls_back(url: str, where: str) -> None:
    async with opened(url) as kb:

        async def block() -> None:
            async with kb.transaction():
                await kb.propositions.save(robot_at())
                many = [robot_at(place=waypoint(number)) for number in range(3000)]
                if where == "pause":
                    await asyncio.sleep(60)
                elif where == "call":
                    await kb.propositions.save_all(many)
                    await asyncio.sleep(60)
                else:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(0.01):
                            await kb.propositions.save_all(many)

        if where == "swallowed":
            with pytest.raises(TransactionCancelledError):
                await block()
        else:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.05):
                    await block()
        assert await kb.revision() == 0
        await kb.propositions.save(robot_at(place=WP2))
        assert await kb.propositions.get_all() == [robot_at(place=WP2)]


async def test_a_commit_under_way_is_waited_for(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    commit, has_begun = Store.commit, threading.Event()

    def slow(self: Store, *arguments: Any) -> None:
        has_begun.set()
        time.sleep(0.2)
        commit(self, *arguments)

    async with opened(url) as kb:

        async def block() -> None:
            async with kb.transaction(actor="block"):
                await kb.propositions.save(robot_at())
                monkeypatch.setattr(Store, "commit", slow)

        writing = asyncio.create_task(block())
        await asyncio.to_thread(has_begun.wait, 30)
        writing.cancel()
        with pytest.raises(asyncio.CancelledError) as caught:
            await writing
        assert "was committed" in caught.value.__notes__[0]
        assert [actor for actor, _ in await written(kb)] == ["block"]


async def test_closed_within_an_inner_block(url: str) -> None:
    async with opened(url) as kb:

        async def nested() -> None:
            async with kb.transaction(), kb.transaction():
                await kb.propositions.save(robot_at())
                await kb.close()

        with pytest.raises(ClosedError):
            await nested()


async def test_who_waits_for_a_turn_can_be_cancelled(shared_url: str) -> None:
    with kant_sql.connect(shared_url, knowledge_base="tiago") as other:
        other.objects.save(RB1)
        async with opened(shared_url) as kb:

            async def write() -> None:
                async with kb.transaction():
                    await kb.propositions.save(robot_at())

            with other.transaction(actor="thread"):
                other.propositions.save(robot_at(place=WP2))
                began = time.monotonic()
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.1):
                        await write()
                assert time.monotonic() - began < PROMPTLY
            await write()
            assert [actor for actor, _ in await written(kb)] == [None, "thread", "base"]


@hunting(PROFILE.tasks)
@given(seed=st.integers(0, 2**32))
def test_cancelled_anywhere_nothing_acknowledged_is_lost(seed: int) -> None:
    """Tasks write pairs of facts in blocks, and are cancelled at any moment."""

    async def main() -> None:
        async with opened("sqlite://") as kb:
            chance = random.Random(seed)
            acknowledged: set[int] = set()

            async def writer(number: int) -> None:
                async with kb.transaction(actor=f"t{number}"):
                    await kb.propositions.save(robot_at(place=waypoint(2 * number)))
                    await asyncio.sleep(chance.random() / 500)
                    await kb.propositions.save(robot_at(place=waypoint(2 * number + 1)))
                acknowledged.add(number)

            tasks = [asyncio.create_task(writer(number)) for number in range(12)]
            for task in chance.sample(tasks, 8):
                await asyncio.sleep(chance.random() / 200)
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            there = {proposition.objects[1].name for proposition in await kb.propositions.get_all()}
            for number in range(12):
                pair = {f"wp{2 * number}", f"wp{2 * number + 1}"}
                # Whole or not at all; and whole when its writer went on.
                assert pair <= there or (not pair & there and number not in acknowledged)
            async with kb.transaction():
                await kb.propositions.delete_all()

    asyncio.run(main())


async def test_a_write_that_has_not_begun_is_dropped_when_cancelled(shared_url: str) -> None:
    is_over, begun = threading.Event(), threading.Barrier(3)

    def busy(_: object) -> bool:
        begun.wait(PATIENCE)
        return is_over.wait(PATIENCE)

    async with kant_sql.aio.open_store(shared_url, connections=2) as store:
        kb, other = store.knowledge_base("tiago"), store.knowledge_base("pepper")
        await kb.objects.save(RB1)
        slow = [asyncio.create_task(other._door.read(partial(busy, number))) for number in range(2)]
        await asyncio.to_thread(begun.wait, PATIENCE)
        late = asyncio.create_task(kb.propositions.save(robot_at()))
        await asyncio.sleep(0.05)
        late.cancel()
        done, _ = await asyncio.wait([late], timeout=PATIENCE / 2)
        is_over.set()
        assert done == {late}
        assert late.cancelled()
        await asyncio.gather(*slow)
        assert await kb.propositions.get_all() == []
        # Its place and its turn are free.
        await kb.propositions.save(robot_at(place=WP2))
        assert await kb.revision() == 2


@pytest.mark.parametrize("where", ["task", "callback", "begun"])
async def test_a_synchronous_write_does_not_stop_the_loop_of_an_open_block(
    shared_url: str, where: str
) -> None:
    def write(kb: kant_sql.KnowledgeBase) -> None:
        with pytest.raises(
            TransactionOpenError, match=r"transaction of kant_sql\.aio open by task"
        ):
            kb.propositions.save(robot_at(place=WP2))
        assert kb.propositions.get_all() == []

    with kant_sql.connect(shared_url) as kb:
        async with kant_sql.aio.connect(shared_url) as door:
            await door.objects.save_all([RB1, WP2])
            entered, leave, done = asyncio.Event(), asyncio.Event(), asyncio.Event()

            async def block() -> None:
                async with door.transaction():
                    await door.goals.save(robot_at(is_goal=True))
                    entered.set()
                    await leave.wait()

            task = asyncio.create_task(block())
            # Its thread may have the lock before the task goes on.
            await (asyncio.sleep(0) if where == "begun" else entered.wait())
            if where == "callback":

                def call_back() -> None:
                    write(kb)
                    done.set()

                task.get_loop().call_soon(call_back)
                await asyncio.wait_for(done.wait(), 30)
            else:
                write(kb)
            waiting = asyncio.create_task(asyncio.to_thread(kb.propositions.save, robot_at()))
            leave.set()
            await task
            assert await waiting
            assert kb.propositions.save(robot_at(place=WP2))
            assert await door.revision() == 4


async def test_no_task_waits_for_a_block_of_its_own_by_another_door(shared_url: str) -> None:
    async def check(one: AsyncKnowledgeBase, other: AsyncKnowledgeBase) -> None:
        await one.objects.save(RB1)
        began = time.monotonic()
        async with one.transaction():
            await one.propositions.save(robot_at())
            with pytest.raises(TransactionOpenError, match="by another object"):
                await other.propositions.save(robot_at(place=WP2))
            with pytest.raises(TransactionOpenError, match="by another object"):
                async with other.transaction():
                    raise AssertionError
            with pytest.raises(TransactionOpenError, match="started within a transaction"):
                await asyncio.create_task(other.propositions.delete_all())
            assert await other.propositions.get_all() == []
        assert time.monotonic() - began < PROMPTLY
        await other.propositions.save(robot_at(place=WP2))
        assert len(await one.propositions.get_all()) == 2

    async with kant_sql.aio.open_store(shared_url, connections=3) as store:
        await check(store.knowledge_base("tiago"), store.knowledge_base("tiago"))
    async with (
        kant_sql.aio.connect(shared_url, knowledge_base="pepper") as one,
        kant_sql.aio.connect(shared_url, knowledge_base="pepper") as other,
    ):
        await check(one, other)


async def test_a_branch_begun_in_a_block_is_refused_after_it(url: str) -> None:
    async with opened(url) as kb:
        async with kb.transaction():
            await kb.propositions.save(robot_at())
            late = kb.branch(url="sqlite://")
        with pytest.raises(ClosedError, match="a transaction that has ended"):
            await late
        async with kb.branch(url="sqlite://") as trial:
            assert await trial.propositions.get_all() == [robot_at()]


async def test_changes_and_log_are_followed(url: str) -> None:
    async with opened(url) as kb:
        for number in range(5):
            await kb.function_values.set(kant_sql.PddlFunctionDto("n"), objects=(), value=number)
        assert [entry.revision.number async for entry in kb.changes(2)] == [3, 4, 5]
        assert [entry.revision.number async for entry in kb.log(limit=2)] == [5, 4]
        with pytest.raises(kant_sql.UnknownRevisionError):
            await anext(kb.changes(99))
        past = await kb.at(2)
        assert await past.revision() == 2
        assert await past.function_values.get("n") == 1
        await past.close()
        assert await kb.function_values.get("n") == 4
        assert [one.number for one in await kb.store.revisions(limit=1)] == [1]


async def test_watch_hears_of_others_and_can_be_cancelled(url: str) -> None:
    async with opened(url) as kb:
        watching = [asyncio.create_task(kb.watch(0)) for _ in range(12)]
        await asyncio.sleep(0.3)
        # More wait than the pool has threads, and the others go on.
        await kb.propositions.save(robot_at())
        assert await asyncio.gather(*watching) == [1] * 12
        assert await kb.watch(1, timeout=0.01) is None
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await kb.watch(1)
        with pytest.raises(kant_sql.ReadOnlyError):
            async with kb.transaction():
                await kb.watch(1)
        last = asyncio.create_task(kb.watch(1))
        await asyncio.sleep(0.05)
        await kb.close()
        with pytest.raises(ClosedError):
            await last


@pytest.mark.more
async def test_a_watch_outlasts_what_other_calls_do_not(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", 0.1)
    take, is_lost = Store._take_session, threading.Event()

    def lost(self: Store) -> Session:
        if is_lost.is_set():
            raise ConnectionLostError("the server restarts")
        return take(self)

    monkeypatch.setattr(Store, "_take_session", lost)

    async with opened(url) as kb:
        await kb.propositions.save(robot_at())
        endless, long = (asyncio.create_task(kb.watch(1, timeout=most)) for most in (None, 30))
        cancelled = asyncio.create_task(kb.watch(1))
        await asyncio.sleep(0.2)
        is_lost.set()
        await asyncio.sleep(1.5)
        cancelled.cancel()
        is_lost.clear()
        await kb.propositions.save(robot_at(place=WP2))
        assert [await endless, await long] == [2, 2]
        with pytest.raises(asyncio.CancelledError):
            await cancelled


async def test_closed_within_a_block_nothing_of_it_is_written(url: str) -> None:
    async with opened(url) as kb:
        await kb.propositions.save(robot_at())
        past, begun = await kb.at(1), kb.changes()

        async def write_and_close() -> None:
            async with kb.transaction():
                await kb.propositions.save(robot_at(place=WP2))
                await kb.close()
                with pytest.raises(ClosedError):
                    await kb.propositions.get_all()

        with pytest.raises(ClosedError):
            await write_and_close()
        await kb.close()
        for call in (past.propositions.get_all, past.revision, lambda: anext(begun)):
            with pytest.raises(ClosedError):
                await call()
    if url != "sqlite://":
        with kant_sql.connect(url, knowledge_base="tiago") as later:
            assert later.revision == 1


async def test_several_loops_share_it(shared_url: str) -> None:
    shared: list[AsyncKnowledgeBase] = []

    async def write(number: int) -> None:
        for step in range(4):
            async with shared[0].transaction(actor=f"loop {number}"):
                await shared[0].propositions.save(robot_at(place=waypoint(10 * number + step)))

    async with opened(shared_url) as kb:
        shared.append(kb)
        threads = [threading.Thread(target=lambda n=n: asyncio.run(write(n))) for n in range(3)]
        for thread in threads:
            thread.start()
        await write(9)
        for thread in threads:
            await asyncio.to_thread(thread.join)
        assert await kb.revision() == 16


async def test_what_is_opened_while_its_store_is_closed_is_closed(common_url: str) -> None:
    store = await kant_sql.aio.open_store(common_url)
    is_read, may_end = threading.Event(), threading.Event()

    def hold() -> None:
        is_read.set()
        may_end.wait(PATIENCE)

    reading = asyncio.create_task(store.knowledge_base("tiago")._door.read(hold))
    await asyncio.to_thread(is_read.wait, PATIENCE)
    closing = asyncio.create_task(store.close())
    await asyncio.sleep(0)
    late = store.knowledge_base("tiago")
    may_end.set()
    await asyncio.gather(reading, closing)
    for call in (late.types.get_all, partial(late.types.save, ROBOT), late.watch):
        with pytest.raises(ClosedError):
            await call()
    with pytest.raises(ClosedError):
        await store.knowledge_bases()


async def test_another_event_loop_opens_what_it_likes_while_a_store_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    store = await kant_sql.aio.open_store("sqlite://")
    kept = [store.knowledge_base(name) for name in ("tiago", "pepper")]
    begin = kant_sql.aio._Door.begin_to_close

    def open_more(door: kant_sql.aio._Door) -> Callable[[], None]:
        kept.append(store.knowledge_base("late"))
        return begin(door)

    monkeypatch.setattr(kant_sql.aio._Door, "begin_to_close", open_more)
    await store.close()
    for kb in kept:
        with pytest.raises(ClosedError):
            await kb.revision()


async def test_what_cannot_be_opened_is_refused_as_on_the_other_side() -> None:
    with pytest.raises(kant_sql.errors.InvalidUrlError):
        await kant_sql.aio.connect("nonsense")
    kb = await kant_sql.aio.connect("sqlite://")
    assert await kb.revision() == 0
    await kb.close()
    assert (
        inspect.signature(kant_sql.aio.connect).parameters["actor"].kind
        is inspect.Parameter.KEYWORD_ONLY
    )


async def test_every_call_after_close_is_refused(shared_url: str, tmp_path: Path) -> None:
    pytest.importorskip("unified_planning")
    with kant_sql.connect(shared_url, knowledge_base="tiago", actor="test") as kb:
        made = [
            call for call in calls(World(kb, tmp_path)) if call.owner.split(".")[-1] != "factory"
        ]

    async with opened(shared_url) as kb:
        views = {"kb": kb, "past": await kb.at(1)}
        await kb.close()
        wrong = {}
        for call in made:
            view, _, path = call.owner.partition(".")
            try:
                await used(call.of(part(views[view], path)))
                wrong[f"{call.owner}.{call.name}"] = "nothing was raised"
            except ClosedError:
                pass
            except Exception as error:
                wrong[f"{call.owner}.{call.name}"] = repr(error)
        assert len(made) > 200
        assert wrong == {}


async def used(made: Any) -> None:
    """Use what a call returns."""
    if inspect.isawaitable(made):
        await made
    elif hasattr(made, "__aenter__"):
        await made.__aenter__()
    else:
        await anext(made)


@pytest.mark.parametrize("where", ["read", "write", "block"])
async def test_stop_iteration_of_the_callers_code_is_no_endless_wait(url: str, where: str) -> None:
    def progress(*_: object) -> None:
        raise StopIteration("of the caller")

    async with opened(url) as kb:
        await kb.propositions.save(robot_at())

        async def load() -> None:
            await kb.load_domain("(define (domain d) (:predicates (p)))", progress=progress)

        async def within() -> None:
            async with kb.transaction():
                await load()

        calls = {"read": lambda: kb.store.verify(progress=progress), "write": load, "block": within}
        with pytest.raises(RuntimeError, match="StopIteration"):
            await calls[where]()
        assert await kb.revision() == 1


INTERRUPTED = """
import asyncio, signal, sys
from kant_sql import PddlTypeDto, aio

signal.signal(signal.SIGINT, signal.default_int_handler)

async def main():
    async with aio.connect(sys.argv[1], knowledge_base="tiago", actor="child") as kb:
        await kb.types.save(PddlTypeDto("before"))
        async with kb.transaction():
            await kb.types.save(PddlTypeDto("within"))
            print("ready", flush=True)
            for number in range(1_000_000):
                await kb.types.save(PddlTypeDto(f"t{number}"))

asyncio.run(main())
"""


@pytest.mark.more
def test_ctrl_c_in_a_block_writes_nothing_of_it_and_ends(shared_url: str) -> None:
    command = [sys.executable, "-c", INTERRUPTED, shared_url]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert present(child.stdout).readline() == "ready\n"
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=60)
    assert "KeyboardInterrupt" in errors
    assert child.returncode != 0
    with kant_sql.connect(shared_url, knowledge_base="tiago") as kb:
        assert [found.name for found in kb.types.get_all()] == ["before"]
        assert kb.store.verify().is_intact


def test_the_parts_of_the_class_are_there_for_whoever_inspects_it() -> None:
    for name in ("types", "goals", "pddl"):
        assert inspect.getattr_static(AsyncKnowledgeBase, name) is getattr(AsyncKnowledgeBase, name)
