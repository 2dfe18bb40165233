"""One knowledge base, shared by threads."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from kant_sql import KnowledgeBase
from kant_sql.sql.dialects.base import Backend
from kant_sql.store.ledger import PropositionLedger
from tests.support.chain import check_chain, check_sqlite
from tests.support.processes.workers import watch_with
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1, WP2, robot_at, waypoint

THREADS = 8
TIMES = 6
# Who waits for another waits longer.
PROMPTLY = Backend.patience / 2


def in_threads(*calls: Callable[[], Any]) -> list[Any]:
    """Run calls at the same moment, each in a thread of its own, and give what they return."""
    barrier = threading.Barrier(len(calls))

    def run(call: Callable[[], Any]) -> Any:
        barrier.wait(60)
        return call()

    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(run, calls))


def check(kb: KnowledgeBase, url: str) -> dict[str, int]:
    """Recompute the chain, also of a store in memory, which only its own connection can read."""
    if url != "sqlite://":
        return check_chain(url)
    with kb.store.factory._store.backend.open_session() as session:  # type: ignore[attr-defined]
        connection: sqlite3.Connection = session._pooled.driver_connection
        return check_sqlite(connection)


@pytest.mark.parametrize("way", counter.WAYS_TO_COUNT)
def test_threads_that_read_modify_and_write_lose_no_update(
    kb: KnowledgeBase, url: str, way: Callable[[KnowledgeBase, int], None]
) -> None:
    counter.start(kb)
    in_threads(*[lambda: way(kb, TIMES)] * THREADS)
    assert counter.read(kb) == THREADS * TIMES
    numbers = [revision.number for revision in kb.store.revisions()]
    assert numbers == [*range(1, THREADS * TIMES + 2)]
    assert check(kb, url) == {"tiago": THREADS * TIMES + 1}


def test_threads_that_read_while_others_write_see_whole_revisions(kb: KnowledgeBase) -> None:
    counter.start(kb)
    has_read = threading.Event()

    def write() -> None:
        counter.increment(kb, 1)
        assert has_read.wait(60)
        counter.increment(kb, 9)

    def read() -> None:
        counter.read(kb)
        has_read.set()
        watch_with(kb, 20)

    in_threads(*[write] * 2, *[read] * 4)


def test_a_transaction_belongs_to_its_thread(url: str, connect: Connect) -> None:
    kb = connect(url, actor="perception")
    entered, left = threading.Event(), threading.Event()

    def first() -> None:
        with kb.transaction(actor="executive", reason="moving"):
            kb.propositions.save(robot_at())
            entered.set()
            time.sleep(0.1)
            assert not left.is_set(), "the other thread has written into this transaction"
            kb.goals.save(robot_at(is_goal=True))

    def second() -> None:
        entered.wait(60)
        kb.propositions.save(robot_at(place=WP2))
        left.set()

    in_threads(first, second)
    assert [(entry.revision.actor, len(entry.changes)) for entry in kb.log()] == [
        ("perception", 2),
        ("executive", 7),
    ]


def test_readers_see_what_is_committed_and_do_not_wait_for_a_writer(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    with kb.transaction():
        kb.objects.delete(RB1)
        assert kb.propositions.get_all() == []  # Now it is in the tables, too.
        began = time.monotonic()
        found = in_threads(
            kb.propositions.get_all,
            lambda: kb.objects.get("rb1"),
            lambda: len(kb.at(kb.revision).objects.get_all()),
            lambda: len(kb.store.revisions()),
            lambda: len(list(kb.log())),
            lambda: len(connect(shared_url).propositions.get_all()),
        )
        assert time.monotonic() - began < PROMPTLY
    assert found == [[robot_at()], RB1, 2, 1, 1, 1]


def test_writers_of_different_knowledge_bases_do_not_wait_on_postgresql(
    server: Server, connect: Connect
) -> None:
    url = server.new_store()
    first, second, third = (connect(url, knowledge_base=name) for name in ("a", "b", "c"))
    second.propositions.save(robot_at())
    with first.transaction():
        first.propositions.save(robot_at())
        first.propositions.get_all()
        began = time.monotonic()
        in_threads(
            lambda: second.propositions.save(robot_at(place=WP2)),
            lambda: third.propositions.save(robot_at(place=WP2)),
        )
        assert time.monotonic() - began < PROMPTLY
    assert check_chain(url) == {"a": 1, "b": 2, "c": 1}


def test_what_a_slow_thread_has_seen_does_not_hide_what_a_quicker_one_has_done(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(place=WP2))
    kb.propositions.delete(robot_at(place=WP2))
    publish = PropositionLedger.publish
    ended, go_on = threading.Event(), threading.Event()

    def slowly(propositions: PropositionLedger, revision: int) -> None:
        if threading.current_thread() is slow:
            ended.set()
            go_on.wait(60 if shared_url.startswith("postgresql") else 0.2)
        publish(propositions, revision)

    monkeypatch.setattr(PropositionLedger, "publish", slowly)
    slow = threading.Thread(target=lambda: kb.propositions.delete(robot_at(place=WP2)))
    slow.start()
    assert ended.wait(60)
    assert kb.propositions.insert(robot_at(place=WP2))
    with kb.transaction():
        go_on.set()
        slow.join()
        assert not kb.propositions.insert(robot_at(place=WP2))


@pytest.mark.more
def test_more_threads_than_connections_take_turns(kb: KnowledgeBase, url: str) -> None:
    kb.propositions.save(robot_at())
    threads = 70
    saves = [lambda n=n: kb.propositions.save(robot_at(place=waypoint(n))) for n in range(threads)]
    reads = [kb.propositions.get_all] * 10
    in_threads(*saves, *reads)
    assert check(kb, url) == {"tiago": threads}
    assert len(kb.propositions.get_all()) == threads
