"""What is no longer used is freed: blocks of tasks, and knowledge bases that nobody closed."""

from __future__ import annotations

import asyncio
import gc
import weakref
from collections import Counter
from collections.abc import Callable

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlTypeDto, aio

BLOCKS = 30


def census() -> Counter[str]:
    """Count the objects of this process that a block could leave behind."""
    gc.collect()
    return Counter(
        f"{type(each).__module__}.{type(each).__qualname__}"
        for each in gc.get_objects()
        if type(each).__module__ in ("kant_sql.aio", "kant_sql.store.ownership")
        or type(each).__name__ in ("Thread", "ThreadPoolExecutor", "Context", "Task")
    )


def test_a_task_keeps_none_of_its_ended_blocks(common_url: str) -> None:
    async def child(kb: aio.AsyncKnowledgeBase, begun: asyncio.Event, go: asyncio.Event) -> None:
        # Its context is a copy of that of the block that it was started in.
        begun.set()
        await go.wait()
        await kb.types.save(PddlTypeDto("late"))

    async def work() -> None:
        async with aio.connect(common_url, knowledge_base="soak") as kb:
            go = asyncio.Event()

            async def block(number: int) -> None:
                async with kb.transaction():
                    await kb.types.save(PddlTypeDto(f"type{number}"))
                    async with kb.transaction():
                        await kb.types.get("type0")

            await block(0)
            begun = asyncio.Event()
            async with kb.transaction():
                late = asyncio.create_task(child(kb, begun, go))
                await begun.wait()
            before = census()
            for number in range(BLOCKS):
                await block(number)
            grown = census() - before
            go.set()
            await late
            assert sum(grown.values()) < BLOCKS // 2, grown

    asyncio.run(work())


def opened(url: str) -> KnowledgeBase:
    return kant_sql.connect(url, knowledge_base="dropped")


def branched(url: str) -> KnowledgeBase:
    with kant_sql.connect(url, knowledge_base="origin") as kb:
        kb.types.save(PddlTypeDto("robot"))
        return kb.branch()


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("make", [opened, branched])
def test_what_nobody_closed_is_freed(common_url: str, make: Callable[[str], KnowledgeBase]) -> None:
    kb: KnowledgeBase | None = make(common_url)
    assert kb is not None
    kb.types.save(PddlTypeDto("door"))
    with kb.transaction():
        kb.types.get_all()
    backend = kb.store.factory._store.backend  # type: ignore[attr-defined]
    kept = [weakref.ref(each) for each in (kb, backend, backend.engine, backend.engine.pool)]
    del kb, backend
    # The first collection gives the connections back to their pool.
    gc.collect()
    gc.collect()
    assert [each() for each in kept] == [None] * len(kept)
