"""A transaction belongs to one thread, task and context: nobody else joins it or waits for it."""

from __future__ import annotations

import asyncio
import contextvars
import gc
import itertools
import time
import weakref
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import TransactionOpenError
from kant_sql.sql.dialects.base import Backend
from kant_sql.store.ownership import OPEN
from tests.support.profile import PROFILE, hunting
from tests.support.reading import Undone
from tests.support.stores import Connect
from tests.support.worlds.robots import RB1, ROBOT, WP2, robot_at, waypoint

# Who waits for another waits longer.
PROMPTLY = Backend.patience / 2


def written(kb: KnowledgeBase) -> list[tuple[str | None, list[str]]]:
    """Who wrote which facts, oldest first."""
    return [
        (entry.revision.actor, [one.text for one in entry.changes if one.kind in ("fact", "goal")])
        for entry in kb.changes()
    ]


def refused_at_once(call: Callable[[], Any]) -> str:
    began = time.monotonic()
    with pytest.raises(TransactionOpenError) as caught:
        call()
    assert time.monotonic() - began < PROMPTLY
    return str(caught.value)


def test_a_task_never_joins_the_block_of_another(kb: KnowledgeBase) -> None:
    async def well(is_open: asyncio.Event, may_end: asyncio.Event) -> None:
        with kb.transaction(actor="well"):
            kb.propositions.save(robot_at())
            is_open.set()
            await may_end.wait()

    async def meanwhile(may_end: asyncio.Event) -> None:
        for call in (
            lambda: kb.propositions.save(robot_at(place=WP2)),
            lambda: kb.transaction(actor="other").__enter__(),
        ):
            message = refused_at_once(call)
            assert "actor 'well'" in message
            assert "in task 'first'" in message
            assert "kant_sql.aio" in message
        may_end.set()
        raise Undone

    async def main() -> Any:
        is_open, may_end = asyncio.Event(), asyncio.Event()
        first = asyncio.create_task(well(is_open, may_end), name="first")
        await is_open.wait()
        return await asyncio.gather(first, meanwhile(may_end), return_exceptions=True)

    ends = asyncio.run(main())
    assert isinstance(ends[1], Undone)
    assert ends[0] is None
    assert written(kb) == [("well", ["(robot_at rb1 wp1)"])]


async def test_a_task_started_in_a_block_does_not_inherit_it(kb: KnowledgeBase) -> None:
    kb.objects.save(RB1)

    async def child() -> None:
        refused_at_once(lambda: kb.propositions.save(robot_at(place=WP2)))

    with kb.transaction(actor="parent"):
        kb.propositions.save(robot_at())
        await asyncio.gather(child(), asyncio.create_task(child()))
        kb.goals.save(robot_at(is_goal=True))
    assert len(written(kb)[-1][1]) == 2
    kb.propositions.delete(robot_at())


def test_callbacks_never_join_a_block(kb: KnowledgeBase) -> None:
    kb.types.save(ROBOT)
    messages: list[str] = []

    def callback() -> None:
        messages.append(refused_at_once(lambda: kb.propositions.save(robot_at())))

    async def main() -> None:
        loop = asyncio.get_running_loop()
        with kb.transaction(actor="block"):
            kb.objects.save(RB1)
            loop.call_soon(callback)
            loop.call_later(0.001, callback)
            await asyncio.sleep(0.01)

    asyncio.run(main())
    # A block that a callback leaves open is not for the callbacks that it asks for.
    with ExitStack() as stack:

        async def again() -> None:
            loop = asyncio.get_running_loop()
            done = loop.create_future()

            def opens() -> None:
                stack.enter_context(kb.transaction(actor="callback"))
                loop.call_soon(callback)
                loop.call_soon(done.set_result, None)

            loop.call_soon(opens)
            await done

        asyncio.run(again())
        # Its own callback could use it; here it is only ended.
    assert len(messages) == 3
    assert "outside of any task" in messages[-1]
    assert kb.revision == 2


def test_a_copied_context_does_not_join_and_its_own_does(kb: KnowledgeBase) -> None:
    context = contextvars.copy_context()
    with ExitStack() as stack:
        context.run(stack.enter_context, kb.transaction(actor="context"))
        context.run(kb.propositions.save, robot_at())
        refused_at_once(lambda: kb.propositions.save(robot_at(place=WP2)))
        refused_at_once(lambda: context.copy().run(kb.propositions.save, robot_at(place=WP2)))
        assert context.run(kb.propositions.get_all) == [robot_at()]
    assert written(kb) == [("context", ["(robot_at rb1 wp1)"])]
    assert kb.propositions.delete(robot_at())


async def test_a_thread_that_inherits_the_context_waits_as_any_other(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url, actor="base")
    with kb.transaction(actor="block"):
        kb.propositions.save(robot_at())
        assert await asyncio.to_thread(kb.propositions.get_all) == []
        waiting = asyncio.create_task(asyncio.to_thread(kb.propositions.save, robot_at(place=WP2)))
        await asyncio.sleep(0.05)
        assert not waiting.done()
    await waiting
    assert [actor for actor, _ in written(kb)] == ["block", "base"]


async def test_what_others_of_the_thread_read_meanwhile_is_committed(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())

    async def reader() -> list[Any]:
        return [kb.propositions.get_all(), kb.revision, kb.at(1).objects.get("rb1")]

    with kb.transaction():
        kb.propositions.delete(robot_at())
        kb.objects.delete(RB1)
        assert kb.propositions.get_all() == []
        assert await asyncio.create_task(reader()) == [[robot_at()], 1, RB1]


def test_in_memory_a_read_that_would_see_what_is_not_committed_is_refused() -> None:
    with kant_sql.connect("sqlite://") as kb:
        kb.propositions.save(robot_at())

        async def reader() -> None:
            for read in (kb.propositions.get_all, lambda: kb.revision, lambda: kb.at(1)):
                assert "to read a store in memory" in refused_at_once(read)

        async def main() -> None:
            with kb.transaction():
                kb.propositions.delete(robot_at())
                assert kb.propositions.get_all() == []
                assert kb.at(1).propositions.get_all() == [robot_at()]
                await asyncio.create_task(reader())
                raise Undone

        with pytest.raises(Undone):
            asyncio.run(main())
        assert kb.propositions.get_all() == [robot_at()]


def test_two_connections_to_one_store_do_not_block_each_other_in_one_thread(
    shared_url: str, connect: Connect
) -> None:
    kb, other = connect(shared_url, actor="one"), connect(shared_url, actor="two")
    with kb.transaction():
        kb.propositions.save(robot_at())
        assert "actor 'one'" in refused_at_once(lambda: other.propositions.save(robot_at()))
        assert other.propositions.get_all() == []
    other.propositions.save(robot_at(place=WP2))
    assert [actor for actor, _ in written(kb)] == ["one", "two"]


def test_blocks_of_two_stores_are_open_in_any_order(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, actor="one")
    with kant_sql.connect("sqlite://", actor="two") as other:
        first, second = kb.transaction(), other.transaction()
        first.__enter__()
        second.__enter__()
        kb.propositions.save(robot_at())
        other.propositions.save(robot_at(place=WP2))
        first.__exit__(None, None, None)
        other.propositions.save(robot_at())
        second.__exit__(None, None, None)
        assert len(written(kb)[0][1]) == 1
        assert len(written(other)[0][1]) == 2


async def test_a_generator_that_another_task_closes_rolls_back(kb: KnowledgeBase) -> None:
    async def writing() -> AsyncIterator[int]:
        with kb.transaction(actor="generator"):
            kb.propositions.save(robot_at())
            yield 1

    generator: Any = writing()
    assert await anext(generator) == 1
    await asyncio.create_task(generator.aclose())
    kb.propositions.save(robot_at(place=WP2))
    assert written(kb) == [(kb.store.factory._store.actor, ["(robot_at rb1 wp2)"])]  # type: ignore[attr-defined]


def test_a_block_left_in_another_thread_ends_well(kb: KnowledgeBase) -> None:
    for number in range(3):
        with ThreadPoolExecutor(1) as pool:
            block = kb.transaction(actor=f"block {number}")
            pool.submit(block.__enter__).result()
            block.__exit__(None, None, None)
            # Neither thread is held up.
            pool.submit(kb.propositions.save, robot_at(place=waypoint(number))).result(30)
            kb.propositions.delete(robot_at(place=waypoint(number)))
    assert kb.revision == 6


def test_nothing_is_kept_of_a_block_that_has_ended() -> None:
    kept: list[contextvars.Context] = []
    kb = kant_sql.connect("sqlite://")
    store = weakref.ref(kb.store.factory._store)  # type: ignore[attr-defined]
    with kb.transaction():
        kb.types.save(ROBOT)
        kept.append(contextvars.copy_context())
    assert OPEN.get() == ()
    kb.close()
    del kb
    gc.collect()
    assert store() is None


Program = list[tuple[int, bool, int]]
_programs = st.lists(
    st.tuples(st.integers(0, 2), st.booleans(), st.integers(0, 3)), min_size=1, max_size=5
)


@hunting(PROFILE.tasks)
@given(programs=st.lists(_programs, min_size=2, max_size=4))
def test_what_tasks_acknowledge_is_there_and_nothing_else(programs: list[Program]) -> None:
    """Tasks of one thread write in blocks that end well or not, in whatever order they come on."""
    with kant_sql.connect("sqlite://") as kb:
        expected: list[tuple[str, list[str]]] = []
        numbers = itertools.count()

        async def task(name: str, program: Program) -> None:
            for pauses, fails, places in program:
                try:
                    with kb.transaction(actor=name):
                        facts = []
                        for _ in range(places):
                            fact = robot_at(place=waypoint(next(numbers)))
                            if kb.propositions.insert(fact):
                                facts.append(str(fact))
                            for _ in range(pauses):
                                await asyncio.sleep(0)
                        if fails:
                            raise Undone
                    if facts:
                        expected.append((name, sorted(facts)))
                except (Undone, TransactionOpenError):
                    await asyncio.sleep(0)

        async def main() -> None:
            await asyncio.gather(*(task(f"t{n}", each) for n, each in enumerate(programs)))

        asyncio.run(main())
        assert written(kb) == expected


def joins(kb: KnowledgeBase) -> Iterator[int]:
    with kb.transaction(actor="generator"):
        yield 1


def test_a_generator_of_the_same_context_is_joined(kb: KnowledgeBase) -> None:
    for _ in joins(kb):
        kb.propositions.save(robot_at())
    assert [actor for actor, _ in written(kb)] == ["generator"]
