"""Many knowledge bases over few connections: in threads, in tasks, after forks and losses."""

from __future__ import annotations

import asyncio
import gc
import os
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any
from unittest import mock

import psycopg
import pytest
from sqlalchemy import event

import kant_sql
from kant_sql import (
    InvalidArgumentError,
    KnowledgeStore,
    PddlTypeDto,
    ReadOnlyError,
    StoreBusyError,
    aio,
)
from kant_sql.errors import (
    ClosedError,
    InvalidMetadataError,
    InvalidUrlError,
    SchemaMissingError,
    TransactionOpenError,
)
from kant_sql.sql.dialects import base as dialect_base
from kant_sql.sql.dialects import postgresql
from kant_sql.sql.dialects.postgresql_sharing import SharedListening
from tests.support.faults import on_server, terminate
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.statements import count
from tests.support.worlds.robots import RB1, WP2, robot_at, waypoint

ROBOTS, CONNECTIONS, THREADS = 1_000, 8, 24


@pytest.fixture
def store(url: str) -> Iterator[KnowledgeStore]:
    with kant_sql.open_store(url) as opened:
        yield opened


def count_others(connection: psycopg.Connection[Any]) -> int:
    """Count the other connections to a database."""
    [(found,)] = connection.execute(
        "SELECT count(*) FROM pg_stat_activity"
        " WHERE datname = current_database() AND pid <> pg_backend_pid()"
        " AND backend_type = 'client backend'"
    ).fetchall()
    return int(found)


class Census:
    """The most connections to a database that were there at a time, besides its own."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._ended = threading.Event()
        self.most = 0
        self.looks = 0

    def _run(self) -> None:
        with psycopg.connect(self._url, autocommit=True) as connection:
            while not self._ended.is_set():
                self.most = max(self.most, count_others(connection))
                self.looks += 1
                self._ended.wait(0.005)

    @classmethod
    @contextmanager
    def taken(cls, url: str) -> Iterator[Census]:
        census = cls(url)
        thread = threading.Thread(target=census._run)
        thread.start()
        try:
            yield census
        finally:
            census._ended.set()
            thread.join()


# What it is, on each backend.


def test_its_knowledge_bases_are_apart_and_listed(store: KnowledgeStore) -> None:
    tiago, pepper = store.knowledge_base("tiago", actor="me"), store.knowledge_base("pepper")
    tiago.propositions.save(robot_at())
    assert pepper.propositions.get_all() == []
    pepper.objects.save(RB1)
    tiago.propositions.save(robot_at(place=WP2))
    found = [(one.name, one.revision, one.actor, one.facts) for one in store.knowledge_bases()]
    assert found == [("tiago", 2, "me", 2), ("pepper", 1, None, 0)]
    assert tiago.at(1).propositions.get_all() == [robot_at()]
    for kb in (tiago, pepper):
        assert kb.store.verify().is_intact


def test_opening_a_knowledge_base_takes_no_statement(store: KnowledgeStore) -> None:
    store.knowledge_base("tiago").objects.save(RB1)
    assert count(lambda: store.knowledge_base("tiago")) == 0
    with pytest.raises(InvalidMetadataError):
        store.knowledge_base("")


def test_closing_one_leaves_the_others_open(store: KnowledgeStore) -> None:
    tiago, pepper = store.knowledge_base("tiago"), store.knowledge_base("pepper")
    same = store.knowledge_base("tiago")
    for kb in (tiago, pepper):
        kb.objects.save(RB1)
    past = tiago.at(1)
    tiago.close()
    tiago.close()
    for call in (
        tiago.objects.get_all,
        lambda: past.objects.get("rb1"),
        lambda: tiago.objects.save(waypoint(1)),
        lambda: tiago.transaction().__enter__(),
        lambda: tiago.watch(0),
        lambda: tiago.revision,
        lambda: next(iter(tiago.log())),
        tiago.store.verify,
    ):
        with pytest.raises(ClosedError):
            call()
    assert "closed" in repr(tiago)
    assert pepper.objects.get_all() == same.objects.get_all() == [RB1]
    assert pepper.objects.insert(waypoint(1))
    with store.knowledge_base("tiago") as again:
        assert again.objects.get_all() == [RB1]


def test_closing_it_closes_all_of_them(url: str) -> None:
    store = kant_sql.open_store(url)
    kbs = [store.knowledge_base(name) for name in ("tiago", "pepper")]
    for kb in kbs:
        kb.objects.save(RB1)
    store.close()
    store.close()
    for kb in kbs:
        with pytest.raises(ClosedError):
            kb.objects.get_all()
        kb.close()
    for call in (store.knowledge_base, store.knowledge_bases):
        with pytest.raises(ClosedError):
            call()
    assert "closed" in repr(store)


@pytest.mark.parametrize("ends_store", [False, True])
def test_closing_rolls_back_what_this_thread_has_open(url: str, ends_store: bool) -> None:
    store = kant_sql.open_store(url)
    tiago, pepper = store.knowledge_base("tiago"), store.knowledge_base("pepper")
    tiago.objects.save(RB1)

    def write_and_close() -> None:
        with tiago.transaction():
            tiago.objects.save(waypoint(1))
            (store if ends_store else tiago).close()
            with pytest.raises(ClosedError):
                tiago.objects.get_all()

    with pytest.raises(ClosedError):
        write_and_close()
    if not ends_store:
        # Nothing holds a connection or a turn.
        assert pepper.objects.insert(RB1)
        with store.knowledge_base("tiago") as again:
            assert (again.revision, again.objects.insert(waypoint(1))) == (1, True)
        store.close()


def test_a_branch_in_the_store_is_one_of_its_knowledge_bases(store: KnowledgeStore) -> None:
    kb = store.knowledge_base("tiago", actor="me")
    kb.propositions.save(robot_at())
    with kb.branch("trial") as trial:
        assert trial.propositions.get_all() == [robot_at()]
        trial.propositions.delete_all()
    assert kb.propositions.get_all() == [robot_at()]
    assert [one.name for one in store.knowledge_bases()] == ["tiago", "trial"]


def test_two_transactions_at_once_are_refused_where_one_may_write(store: KnowledgeStore) -> None:
    tiago, pepper = store.knowledge_base("tiago"), store.knowledge_base("pepper")
    with tiago.transaction():
        tiago.objects.save(RB1)
        if store.writers == 1:
            with pytest.raises(TransactionOpenError):
                pepper.objects.save(RB1)
        else:
            pepper.objects.save(RB1)
        assert len(pepper.objects.get_all()) == (store.writers > 1)
    assert tiago.objects.get_all() == [RB1]


def test_what_is_given_is_checked(url: str, tmp_path: Any) -> None:
    for wrong in (1, 0, -1, True, "8", 8.0, None):
        with pytest.raises(InvalidArgumentError, match="connections"):
            kant_sql.open_store(url, connections=wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidUrlError):
        kant_sql.open_store("nothing")
    with pytest.raises(SchemaMissingError):
        kant_sql.open_store(f"sqlite:///{tmp_path / 'none.db'}", read_only=True)


def test_it_may_be_for_reading_only(shared_url: str) -> None:
    with kant_sql.connect(shared_url, knowledge_base="tiago") as kb:
        kb.propositions.save(robot_at())
    with kant_sql.open_store(shared_url, read_only=True) as store:
        kb = store.knowledge_base("tiago")
        assert kb.propositions.get_all() == [robot_at()]
        assert kb.store.verify().is_intact
        for call in (lambda: kb.objects.save(WP2), lambda: kb.branch("trial")):
            with pytest.raises(ReadOnlyError):
                call()


# Many at once.


def work_on(store: KnowledgeStore, number: int) -> None:
    """Write and read as a service does for one of its robots."""
    kb = store.knowledge_base(f"robot {number}", actor=f"robot {number}")
    kb.propositions.save(robot_at())
    with kb.transaction(reason="moved"):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
        # Outside of the transaction, on another connection.
        assert kb.at(1).propositions.get_all() == [robot_at()]
    assert kb.propositions.get_all() == [robot_at(place=WP2)]
    if number % 2:
        kb.close()


@on_server
def test_who_loses_a_number_takes_the_next_one_at_once(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialect_base, "RETRY_FOR", 0)
    waiting = "SELECT FROM pg_locks WHERE NOT granted"
    with (
        kant_sql.connect(shared_url, knowledge_base="third") as kb,
        psycopg.connect(shared_url) as other,
        psycopg.connect(shared_url, autocommit=True) as looking,
        ThreadPoolExecutor(1) as pool,
    ):
        other.execute("INSERT INTO knowledge_base (id, name) VALUES (1, 'second')")
        saving = pool.submit(kb.propositions.save, robot_at())
        wait_for(lambda: looking.execute(waiting).fetchone() is not None)
        other.commit()
        assert saving.result() is True
        found = looking.execute("SELECT id, name FROM knowledge_base ORDER BY id").fetchall()
    assert found == [(1, "second"), (2, "third")]


@pytest.mark.more
@on_server
def test_a_thousand_in_threads(shared_url: str) -> None:
    with (
        kant_sql.open_store(shared_url, connections=CONNECTIONS) as store,
        Census.taken(shared_url) as census,
        ThreadPoolExecutor(THREADS) as pool,
    ):
        list(pool.map(lambda number: work_on(store, number), range(ROBOTS)))
        found = store.knowledge_bases()
    assert {(one.name, one.revision) for one in found} == {
        (f"robot {number}", 2) for number in range(ROBOTS)
    }
    assert census.looks > 10
    assert 1 < census.most <= CONNECTIONS


async def work_in_a_task(store: aio.AsyncKnowledgeStore, number: int) -> None:
    kb = store.knowledge_base(f"robot {number}", actor=f"robot {number}")
    await kb.propositions.save(robot_at())
    async with kb.transaction(reason="moved"):
        await kb.propositions.delete(robot_at())
        await kb.propositions.save(robot_at(place=WP2))
        assert await (await kb.at(1)).propositions.get_all() == [robot_at()]
    assert await kb.propositions.get_all() == [robot_at(place=WP2)]
    if number % 2:
        await kb.close()


@pytest.mark.more
@on_server
def test_a_thousand_in_tasks(shared_url: str) -> None:
    async def main() -> tuple[list[kant_sql.operations.Inventory], int]:
        async with aio.open_store(shared_url, connections=CONNECTIONS) as store:
            most = 0

            async def look() -> None:
                nonlocal most
                while True:
                    most = max(most, threading.active_count())
                    await asyncio.sleep(0.01)

            # More would wait longer for their turn, on a slow machine, than a call may.
            places = asyncio.Semaphore(4 * THREADS)

            async def work(number: int) -> None:
                async with places:
                    await work_in_a_task(store, number)

            looking = asyncio.create_task(look())
            await asyncio.gather(*(work(number) for number in range(ROBOTS)))
            looking.cancel()
            return await store.knowledge_bases(), most

    before = threading.active_count()
    with Census.taken(shared_url) as census:
        found, most = asyncio.run(main())
    assert {one.revision for one in found} == {2}
    assert len(found) == ROBOTS
    assert 1 < census.most <= CONNECTIONS
    # A thread for each connection, one for each open transaction, and those that just end, of which
    # a busy machine has more; not one for each robot.
    assert most - before <= 6 * CONNECTIONS


@on_server
def test_writers_who_read_the_past_do_not_wait_for_each_other(shared_url: str) -> None:
    with kant_sql.open_store(shared_url, connections=2) as store, ThreadPoolExecutor(16) as pool:
        began = time.monotonic()
        list(pool.map(lambda number: work_on(store, number), range(32)))
        assert time.monotonic() - began < dialect_base.Backend.patience


@on_server
def test_writers_of_a_held_knowledge_base_hold_up_no_other(shared_url: str) -> None:
    """Of all who wait for the same head, one has a connection."""
    with kant_sql.open_store(shared_url, connections=3) as store:
        held, other = store.knowledge_base("held"), store.knowledge_base("other")
        for kb in (held, other):
            kb.objects.save(RB1)
        with psycopg.connect(shared_url) as elsewhere, ThreadPoolExecutor(8) as pool:
            elsewhere.execute("SELECT * FROM head WHERE kb_id = 1 FOR UPDATE")
            waiting = [pool.submit(held.objects.save, waypoint(number)) for number in range(8)]
            time.sleep(0.2)
            for number in range(20):
                other.objects.save(waypoint(number))
            assert len(other.objects.get_all()) == 21
            assert not any(each.done() for each in waiting)
            elsewhere.rollback()
            for each in waiting:
                each.result(PATIENCE)
        assert held.revision == 9


@on_server
def test_who_waits_for_a_connection_too_long_is_refused(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialect_base.Backend, "patience", 0.2)
    monkeypatch.setattr(dialect_base, "RETRY_FOR", 0.2)
    with kant_sql.open_store(shared_url, connections=2) as store:
        kb, other = store.knowledge_base("tiago"), store.knowledge_base("pepper")
        kb.objects.save(RB1)
        with kb.transaction(), ThreadPoolExecutor(1) as pool:
            kb.objects.save(WP2)
            with pytest.raises(StoreBusyError, match="nothing was written"):
                pool.submit(other.objects.save, RB1).result(PATIENCE)
            # Reading goes on.
            assert pool.submit(kb.objects.get_all).result(PATIENCE) == [RB1]
        assert other.objects.insert(RB1)


# Watching.


def started(calls: list[Callable[[], Any]]) -> tuple[ThreadPoolExecutor, list[Any]]:
    pool = ThreadPoolExecutor(len(calls))
    return pool, [pool.submit(call) for call in calls]


@pytest.mark.more
@on_server
def test_all_who_watch_share_one_connection(shared_url: str, only_told: None) -> None:
    with kant_sql.open_store(shared_url, connections=4) as store:
        kbs = [store.knowledge_base(f"robot {number}") for number in range(50)]
        for kb in kbs:
            kb.objects.save(RB1)
        with Census.taken(shared_url) as census:
            pool, waiting = started([lambda kb=kb: kb.watch(1) for kb in kbs])  # type: ignore[misc]
            wait_for(lambda: listening(shared_url))
            time.sleep(0.3)
            for kb in kbs[:40]:
                kb.objects.save(WP2)
            with kant_sql.connect(shared_url, knowledge_base="robot 40") as beside:
                beside.objects.save(WP2)
            assert [each.result(PATIENCE) for each in waiting[:41]] == [2] * 41
            assert not any(each.done() for each in waiting[41:])
            assert len([t for t in threading.enumerate() if t.name == "kant_sql listener"]) == 1
            for kb in kbs[41:]:
                kb.objects.save(WP2)
            pool.shutdown()
        # Those of the store, the one that listens, of one beside two, and the look.
        assert census.most <= 4 + 1 + 2 + 1
    assert not [t for t in threading.enumerate() if t.name == "kant_sql listener"]


def listening(url: str, then: str = "pid") -> list[Any]:
    """Ask something of all connections that listen to a channel."""
    statement = (
        f"SELECT {then} FROM pg_stat_activity WHERE datname = current_database()"
        " AND query LIKE 'LISTEN%'"
    )
    with psycopg.connect(url, autocommit=True) as elsewhere:
        return elsewhere.execute(statement.encode()).fetchall()


def test_closing_ends_those_who_watch(url: str) -> None:
    store = kant_sql.open_store(url)
    tiago, pepper = store.knowledge_base("tiago"), store.knowledge_base("pepper")
    for kb in (tiago, pepper):
        kb.objects.save(RB1)
    pool, (first, second) = started([lambda: tiago.watch(1), lambda: pepper.watch(1)])
    time.sleep(0.1)
    tiago.close()
    with pytest.raises(ClosedError):
        first.result(PATIENCE)
    assert not second.done()
    store.close()
    with pytest.raises(ClosedError):
        second.result(PATIENCE)
    pool.shutdown()


@on_server
def test_watching_waits_once_for_a_connection(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialect_base.Backend, "patience", 0.2)
    monkeypatch.setattr(dialect_base, "RETRY_FOR", 0.1)
    with kant_sql.open_store(shared_url, connections=2) as store:
        kb = store.knowledge_base("tiago")
        kb.objects.save(RB1)
        with store._backend.open_session(), store._backend.open_session():
            take = mock.Mock(wraps=store._backend.take)
            monkeypatch.setattr(store._backend, "take", take)
            with pytest.raises(StoreBusyError, match="all connections of this process are in use"):
                kb.watch(1, timeout=0.1)
            assert take.call_count == 1
        assert kb.watch(1, timeout=0.1) is None


@on_server
def test_a_lost_listener_does_not_replace_the_connections_again_and_again(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with kant_sql.open_store(shared_url, connections=3) as store:
        kbs = [store.knowledge_base(f"robot {number}") for number in range(12)]
        for kb in kbs:
            kb.objects.save(RB1)
        renewed = mock.Mock(wraps=store._backend.renew)
        monkeypatch.setattr(store._backend, "renew", renewed)
        pool, waiting = started([lambda kb=kb: kb.watch(1) for kb in kbs])  # type: ignore[misc]
        wait_for(lambda: listening(shared_url))
        assert len(listening(shared_url, "pg_terminate_backend(pid, 5000)")) == 1
        for kb in kbs:
            kb.objects.save(WP2)
        assert [each.result(PATIENCE) for each in waiting] == [2] * 12
        pool.shutdown()
    assert renewed.call_count == 1


@on_server
def test_closing_leaves_no_listener_that_begins_meanwhile(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = SharedListening.join

    def closed_just_before(listening: SharedListening, kb_id: int) -> Any:
        kb.close()
        return original(listening, kb_id)

    kb = kant_sql.connect(shared_url)
    kb.objects.save(RB1)
    monkeypatch.setattr(SharedListening, "join", closed_just_before)
    with pytest.raises(ClosedError):
        kb.watch(timeout=PATIENCE)
    with psycopg.connect(shared_url, autocommit=True) as look:
        wait_for(lambda: not count_others(look))
    assert not [t for t in threading.enumerate() if t.name == "kant_sql listener"]


def test_closing_goes_on_when_something_cannot_be_closed(
    shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = kant_sql.open_store(shared_url)
    store.knowledge_base("tiago").watch(timeout=0.01)
    backend, closed = store._backend, []

    def fail() -> None:
        raise ZeroDivisionError

    backend.when_closed += [lambda: closed.append("first"), fail]
    engines = [backend.engine]
    if isinstance(backend, postgresql.PostgresqlBackend):
        engines.append(backend.listening)
        monkeypatch.setattr(backend._shared_listening, "close", fail)
    for engine in engines:
        event.listen(engine, "engine_disposed", lambda _: closed.append("engine"))
    with pytest.raises(ZeroDivisionError):
        store.close()
    assert closed == ["first"] + ["engine"] * len(engines)
    monkeypatch.undo()
    if isinstance(backend, postgresql.PostgresqlBackend):
        backend.close()


@pytest.mark.more
@on_server
def test_lost_connections_are_replaced_for_writers_and_watchers(shared_url: str) -> None:
    with kant_sql.open_store(shared_url, connections=3) as store:
        kbs = [store.knowledge_base(f"robot {number}") for number in range(6)]
        for kb in kbs:
            kb.objects.save(RB1)
        pool, waiting = started([lambda kb=kb: kb.watch(1) for kb in kbs])  # type: ignore[misc]
        for number in range(3):
            wait_for(lambda: listening(shared_url))
            assert terminate(shared_url) > 1
            kbs[number].objects.save(WP2)
            assert waiting[number].result(PATIENCE) == 2
        for kb in kbs[3:]:
            kb.objects.save(WP2)
        assert [each.result(PATIENCE) for each in waiting] == [2] * 6
        pool.shutdown()


# Forks and memory.


def test_a_forked_child_goes_on_with_connections_of_its_own(shared_url: str) -> None:
    with kant_sql.open_store(shared_url, connections=2) as store:
        tiago, pepper = store.knowledge_base("tiago"), store.knowledge_base("pepper")
        tiago.objects.save(RB1)
        tiago.watch(timeout=0.01)
        with tiago.transaction():
            tiago.objects.save(waypoint(1))
            child = os.fork()
            if not child:
                code = 1
                try:
                    # The parent's transaction holds its own turn, not one of this process.
                    if not shared_url.startswith("sqlite"):
                        pepper.objects.save(RB1)
                        pepper.watch(0, timeout=5)
                    code = len(pepper.objects.get_all()) - (not shared_url.startswith("sqlite"))
                finally:
                    os._exit(code)
            _, status = os.waitpid(child, 0)
            assert status == 0
        assert tiago.objects.insert(waypoint(2))
        assert pepper.revision == (not shared_url.startswith("sqlite"))


@pytest.mark.more
def test_an_open_knowledge_base_takes_little_memory(shared_url: str) -> None:
    """What a knowledge base keeps is of its definitions and of a bounded number of facts."""
    with kant_sql.open_store(shared_url) as store:
        for number in range(2):
            work_on(store, number)
        tracemalloc.start()
        try:
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
            kbs = [store.knowledge_base(f"robot {number}") for number in range(100)]
            gc.collect()
            opened = tracemalloc.get_traced_memory()[0]
            for kb in kbs:
                kb.types.save(PddlTypeDto("robot"))
                kb.propositions.save(robot_at())
                kb.propositions.get_all()
            gc.collect()
            used = tracemalloc.get_traced_memory()[0]
            del kb, kbs
            gc.collect()
            after = tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()
    assert (opened - before) / 100 < 16_000
    assert (used - before) / 100 < 64_000
    # What is dropped without being closed is freed, too.
    assert (after - before) / 100 < 4_000
