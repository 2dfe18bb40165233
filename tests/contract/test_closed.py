"""A closed knowledge base refuses every call, and writes nothing that it had open."""

from __future__ import annotations

import asyncio
import gc
import inspect
import threading
import weakref
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlFunctionDto, PddlTypeDto, Plan, aio
from kant_sql.errors import ClosedError
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.query import Query
from tests.support.generators.junk import Calling, Case, World, signature
from tests.support.reading import store_of
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.robots import RB1, robot_at

REMEDY = "was closed; connect again"
# What needs no store: it ends, or leaves the store to whom it is of.
FREE = {"address", "label", "name"}


class Call(NamedTuple):
    """A call of a method, or a look at a property."""

    owner: str
    name: str
    positional: list[Any]
    named: dict[str, Any]

    def of(self, thing: Any) -> Any:
        """Make the call, or take the property."""
        found = getattr(thing, self.name)
        return found(*self.positional, **self.named) if callable(found) else found


def calls(world: World) -> Iterator[Call]:
    """All that is public of a knowledge base, of its past, of their DAOs and of the factory."""
    calling = Calling(lambda: world)
    for owner, get in world.subjects().items():
        if owner.split(".")[0] not in ("kb", "past", "factory"):
            continue
        thing = get()
        for name in dir(type(thing)):
            if name.startswith("_") or name in ("close", "factory"):
                continue
            found = inspect.getattr_static(type(thing), name)
            if isinstance(found, property):
                yield Call(owner, name, [], {})
            elif inspect.isfunction(inspect.unwrap(found) if callable(found) else found):
                case = Case(owner, name, None, "usual")
                yield Call(owner, name, *calling.arguments(case, signature(getattr(thing, name))))


def error_of(call: Call, thing: Any) -> Exception | None:
    try:
        made = call.of(thing)
        if call.name == "transaction":
            made.__enter__()
    except Exception as error:
        return error
    return None


@pytest.fixture
def open_kb(url: str) -> KnowledgeBase:
    """A knowledge base that the test closes."""
    return kant_sql.connect(url, knowledge_base="tiago", actor="test")


@pytest.mark.usefixtures("closed_stores")
def test_every_call_after_close_is_refused(open_kb: KnowledgeBase, tmp_path: Path) -> None:
    pytest.importorskip("unified_planning")
    world = World(open_kb, tmp_path)
    made = [call for call in calls(world) if call.name not in FREE]
    things = {call.owner: world.subjects()[call.owner]() for call in made}
    open_kb.close()
    assert len(made) > 240
    wrong = {}
    for call in made:
        error = error_of(call, things[call.owner])
        if not isinstance(error, ClosedError) or REMEDY not in str(error):
            wrong[f"{call.owner}.{call.name}"] = repr(error)
    assert wrong == {}
    for read in (world.recorded.domain_pddl, world.recorded.problem_pddl):
        with pytest.raises(ClosedError):
            read()


def test_closing_twice_is_fine(open_kb: KnowledgeBase) -> None:
    open_kb.propositions.save(robot_at())
    with open_kb:
        open_kb.close()
    open_kb.close()
    with pytest.raises(ClosedError), open_kb:
        open_kb.types.get_all()


def test_iterators_begun_before_end_with_the_error(open_kb: KnowledgeBase) -> None:
    for number in range(300):
        open_kb.function_values.set(PddlFunctionDto("n"), objects=(), value=number)
    log, changes = open_kb.log(), open_kb.changes()
    of_one = open_kb.log(element="(n)")
    for iterator in (log, changes, of_one):
        next(iterator)
    open_kb.close()
    for iterator in (log, changes, of_one):
        with pytest.raises(ClosedError):
            list(iterator)


@pytest.mark.parametrize("is_flushed", [True, False])
def test_what_was_open_is_not_written(url: str, is_flushed: bool, connect: Connect) -> None:
    kb = kant_sql.connect(url, knowledge_base="tiago")
    kb.objects.save(RB1)

    def write_and_close() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at())
            if is_flushed:
                assert kb.propositions.get_all() == [robot_at()]
            kb.close()
            for call in (
                kb.propositions.get_all,
                lambda: kb.propositions.delete(robot_at()),
                lambda: kb.objects.get("rb1"),
                lambda: kb.transaction().__enter__(),
                lambda: kb.revision,
            ):
                with pytest.raises(ClosedError):
                    call()

    with pytest.raises(ClosedError, match=REMEDY):
        write_and_close()
    if url != "sqlite://":
        again = connect(url, knowledge_base="tiago")
        assert (again.revision, again.propositions.get_all()) == (1, [])
        # Nothing holds a lock.
        again.propositions.save(robot_at())


def test_an_error_of_the_block_is_not_hidden_by_the_close(open_kb: KnowledgeBase) -> None:
    def fail() -> None:
        with open_kb.transaction():
            open_kb.propositions.save(robot_at())
            open_kb.close()
            raise KeyError

    with pytest.raises(KeyError):
        fail()


def test_a_block_of_another_thread_is_not_written(url: str, connect: Connect) -> None:
    kb = kant_sql.connect(url, knowledge_base="tiago")
    kb.objects.save(RB1)
    is_open, may_go_on = threading.Event(), threading.Event()
    caught: list[BaseException] = []

    def write() -> None:
        try:
            with kb.transaction():
                kb.propositions.save(robot_at())
                is_open.set()
                may_go_on.wait(30)
        except ClosedError as error:
            caught.append(error)

    writer = threading.Thread(target=write)
    writer.start()
    is_open.wait(30)
    backend = kb.store.factory._store.backend  # type: ignore[attr-defined]
    closing = threading.Thread(target=kb.close)
    closing.start()
    while not backend.is_closed:
        pass
    may_go_on.set()
    writer.join(30)
    closing.join(30)
    assert len(caught) == 1
    if url != "sqlite://":
        assert connect(url, knowledge_base="tiago").revision == 1


def test_other_knowledge_bases_go_on(shared_url: str, connect: Connect) -> None:
    kb, other = kant_sql.connect(shared_url), connect(shared_url)
    kb.propositions.save(robot_at())
    kb.close()
    assert other.propositions.get_all() == [robot_at()]
    with pytest.raises(ClosedError):
        kb.propositions.get_all()


def test_a_view_of_the_past_closes_nothing_and_closes_with_the_rest(open_kb: KnowledgeBase) -> None:
    open_kb.propositions.save(robot_at())
    with open_kb.at(1) as past:
        assert past.propositions.get_all() == [robot_at()]
    assert open_kb.propositions.get_all() == [robot_at()]
    open_kb.close()
    with pytest.raises(ClosedError):
        past.propositions.get_all()
    with pytest.raises(ClosedError):
        assert past.revision


def test_a_connection_that_comes_back_while_the_store_is_closed_is_closed_too(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = kant_sql.connect(server.new_store())
    kb.types.save("robot")
    backend = store_of(kb).backend
    session = backend.session()
    give_back, connection = session._pooled.close, session._pooled.driver_connection
    assert connection is not None

    def close_first() -> None:
        kb.close()
        give_back()

    monkeypatch.setattr(session._pooled, "close", close_first)
    session.close()
    with pytest.raises(backend.driver_errors):
        connection.execute("SELECT 1")


def test_a_file_is_let_go_although_a_read_ends_while_it_is_closed(
    file_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(file_url)
    kb.types.save("robot")
    is_current = vars(Session)["is_current"].fget

    def closed_after(session: Session) -> bool:
        monkeypatch.undo()
        found: bool = is_current(session)
        with ThreadPoolExecutor(1) as other:
            other.submit(kb.close).result(60)
        return found

    monkeypatch.setattr(Session, "is_current", property(closed_after))
    assert kb.revision == 1
    # SQLite removes its log with the last connection.
    assert not Path(f"{file_url.removeprefix('sqlite:///')}-wal").exists()


# What nobody closed.


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


async def test_a_task_keeps_none_of_its_ended_blocks(common_url: str) -> None:
    async def child(kb: aio.AsyncKnowledgeBase, begun: asyncio.Event, go: asyncio.Event) -> None:
        # Its context is a copy of that of the block that it was started in.
        begun.set()
        await go.wait()
        await kb.types.save(PddlTypeDto("late"))

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


def opened(url: str) -> KnowledgeBase:
    return kant_sql.connect(url, knowledge_base="dropped")


def branched(url: str) -> KnowledgeBase:
    with kant_sql.connect(url, knowledge_base="origin") as kb:
        kb.types.save(PddlTypeDto("robot"))
        return kb.branch()


def asked(url: str) -> KnowledgeBase:
    """Have questions remember something for their next call."""
    kb = opened(url)
    kb.load_domain("(define (domain go) (:predicates (there)) (:action go :effect (there)))")
    kb.rules.save("away", "(always (not (there)))")
    kb.rules.standing()
    kb.plans.record(Plan.read("(go)"))
    kb.replan()
    return kb


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("make", [opened, branched, asked])
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


def used(url: str) -> None:
    """Write and read, then close."""
    with opened(url) as kb:
        kb.types.save(PddlTypeDto("robot"))
        kb.types.delete("robot")
        kb.holds("(and)")
        assert kb.revision


def test_a_program_that_connects_again_and_again_keeps_nothing(
    common_url: str, made_queries: list[Query]
) -> None:
    def live() -> Counter[str]:
        for _ in range(5):
            used(common_url)
        made_queries.clear()
        gc.collect()
        gc.collect()
        return Counter(type(each).__qualname__ for each in gc.get_objects())

    live()
    before = live()
    grown = live() - before
    assert grown.total() < 5, grown
