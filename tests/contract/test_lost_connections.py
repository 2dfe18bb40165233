"""Connections to a server that are lost, between calls and at every moment of one."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import psycopg
import pytest

from kant_sql import KnowledgeBase, OutcomeUnknownError, StoreError
from kant_sql.errors import ConnectionLostError, StoreReplacedError
from kant_sql.sql.dialects import postgresql
from kant_sql.sql.dialects.base import Session
from kant_sql.sql.dialects.postgresql import PostgresqlSession
from kant_sql.sql.query import Query
from kant_sql.store import store
from kant_sql.store.head import Head, lock_head
from kant_sql_plugins.citus import cluster as citus
from tests.support.chain import check_chain
from tests.support.faults import (
    BOUND,
    WRITES,
    a_transaction,
    change,
    closed_door,
    lose_answer,
    lose_at,
    on_server,
    one_call,
    terminate,
)
from tests.support.statements import text_of
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import WP2, robot_at, waypoint

pytestmark = on_server


@pytest.fixture
def kb(shared_url: str, connect: Connect) -> KnowledgeBase:
    """A knowledge base with a fact."""
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    return kb


def test_connections_that_were_lost_between_calls_are_made_again(
    kb: KnowledgeBase, shared_url: str
) -> None:
    calls: list[Callable[[], object]] = [
        kb.propositions.get_all,
        lambda: kb.objects.get("rb1"),
        lambda: kb.revision,
        lambda: kb.at(1).types.get("robot"),
        lambda: list(kb.log()),
        *(lambda work=work: work(kb) for work in WRITES.values()),
        lambda: kb.propositions.delete(robot_at()),
    ]
    for call in calls:
        assert terminate(shared_url) >= 1
        assert call() is not None
    assert kb.propositions.get_all() == [robot_at(place=WP2)]
    assert check_chain(shared_url) == {"default": 3}


@pytest.mark.parametrize("method", ["begin", "rows", "insert", "run", "commit"])
def test_a_call_whose_connection_is_lost_on_the_way_is_made_once(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    lose_at(monkeypatch, shared_url, method)
    assert one_call(kb) is True
    assert check_chain(shared_url) == {"default": 2}


@pytest.mark.parametrize("method", ["insert", "run", "commit"])
def test_a_transaction_whose_connection_is_lost_raises_and_writes_nothing(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    lose_at(monkeypatch, shared_url, method)
    with pytest.raises(ConnectionLostError, match="nothing of the open transaction was written"):
        a_transaction(kb)
    assert check_chain(shared_url) == {"default": 1}
    assert a_transaction(kb) is True


# What a coordinator of Citus says of a worker that crashes, as an internal error.
CRASHES = [
    "failure on connection marked as essential: worker1:5432",
    "server closed the connection unexpectedly",
    "connection not open",
]


@pytest.fixture
def coordinator(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the server be one of which the plugin for Citus judges the errors."""
    one = SimpleNamespace(nodes=lambda connection: None, has_lost_a_node=citus.has_lost_a_node)
    monkeypatch.setattr(postgresql, "cluster_among", lambda extensions: one)


def crash_at(monkeypatch: pytest.MonkeyPatch, words: str, said: str, *, is_done: bool) -> None:
    """Answer the next statement that begins with some words by this error."""
    execute, times = PostgresqlSession._execute, iter([said])

    def crash(self: PostgresqlSession, statement: str | Query, parameters: Any = ()) -> None:
        for text in times if text_of(self, statement).startswith(words) else ():
            if is_done:
                execute(self, statement, parameters)
            raising = f"RAISE EXCEPTION ''{text}'' USING ERRCODE = ''internal_error''"
            execute(self, f"DO 'BEGIN {raising}; END'")
        execute(self, statement, parameters)

    monkeypatch.setattr(PostgresqlSession, "_execute", crash)


@pytest.mark.usefixtures("coordinator")
@pytest.mark.parametrize("said", CRASHES)
@pytest.mark.parametrize("words", ["SELECT", "INSERT INTO proposition_version", "UPDATE head"])
def test_a_worker_that_crashes_is_an_outage_as_others(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch, words: str, said: str
) -> None:
    crash_at(monkeypatch, words, said, is_done=False)
    assert one_call(kb) is True
    assert check_chain(shared_url) == {"default": 2}


@pytest.mark.usefixtures("coordinator")
def test_a_block_below_which_a_worker_crashes_writes_nothing(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    crash_at(monkeypatch, "UPDATE head", CRASHES[0], is_done=False)
    with pytest.raises(ConnectionLostError, match="nothing of the open transaction was written"):
        a_transaction(kb)
    assert check_chain(shared_url) == {"default": 1}
    assert a_transaction(kb) is True


@pytest.mark.usefixtures("coordinator")
def test_a_worker_that_crashes_after_the_commit_is_looked_up(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    crash_at(monkeypatch, "COMMIT", CRASHES[0], is_done=True)
    assert a_transaction(kb) is True
    assert check_chain(shared_url) == {"default": 2}


def test_a_lost_transaction_cannot_be_saved_by_ignoring_the_error(
    kb: KnowledgeBase, shared_url: str
) -> None:

    def lose() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at(place=WP2))
            terminate(shared_url)
            with pytest.raises(ConnectionLostError):
                kb.propositions.get_all()
            kb.propositions.delete(robot_at())

    with pytest.raises(ConnectionLostError):
        lose()
    assert kb.propositions.get_all() == [robot_at()]


def test_the_error_of_the_block_is_raised_even_if_the_connection_is_lost(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)

    def stumble() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at())
            terminate(shared_url)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        stumble()
    assert kb.revision == 0


def test_a_server_that_ends_an_idle_transaction_is_a_lost_connection(
    shared_url: str, connect: Connect
) -> None:
    with psycopg.connect(shared_url, autocommit=True) as connection:
        name = connection.info.dbname
        connection.execute(
            f"ALTER DATABASE {name} SET idle_in_transaction_session_timeout = '50ms'".encode()
        )
    kb = connect(shared_url)

    def idle() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at())
            time.sleep(0.3)

    with pytest.raises(ConnectionLostError):
        idle()
    assert one_call(kb) is True


@pytest.mark.usefixtures("impatient")
def test_a_server_that_does_not_come_back_is_not_waited_for_for_ever(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closed_door(shared_url) as close_door:
        close_door()
        began = time.monotonic()
        calls: tuple[Callable[[], object], ...] = (kb.propositions.get_all, lambda: one_call(kb))
        for call in calls:
            with pytest.raises(StoreError, match="not currently accepting connections"):
                call()
        assert time.monotonic() - began < 40 * BOUND
    monkeypatch.undo()  # What was lost is made again, however long that takes.
    assert one_call(kb) is True


# Commits whose answer is lost.


def test_a_lost_answer_is_found_out_although_all_connections_were_lost(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ThreadPoolExecutor(4) as pool:  # Fills the pool.
        assert len(list(pool.map(lambda _: kb.propositions.get_all(), range(40)))) == 40
    lose_answer(monkeypatch, True, lambda: terminate(shared_url))
    assert a_transaction(kb) is True
    assert check_chain(shared_url) == {"default": 2}


def test_a_lock_that_is_lost_to_another_thread_is_no_other_store(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lose_lock(session: Session, kb_id: int) -> Head | None:
        monkeypatch.undo()
        head = lock_head(session, kb_id)
        terminate(shared_url)
        with ThreadPoolExecutor(1) as other:
            assert other.submit(kb.objects.insert, waypoint(7)).result(60)
        return head

    monkeypatch.setattr(store, "lock_head", lose_lock)
    assert one_call(kb) is True
    assert check_chain(shared_url) == {"default": 3}


def test_a_replaced_store_is_told_by_the_last_commit_of_all_threads(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish = store.Store._publish

    def let_another_commit(*given: Any) -> None:
        monkeypatch.undo()
        with ThreadPoolExecutor(1) as other:
            assert other.submit(kb.objects.insert, waypoint(8)).result(60)
        publish(*given)

    monkeypatch.setattr(store.Store, "_publish", let_another_commit)
    assert kb.objects.insert(waypoint(7))
    _, second, third = kb.store.revisions()
    assert third.number == 3
    change(
        shared_url,
        "DELETE FROM object_version WHERE since = 3",
        "DELETE FROM revision WHERE number = 3",
        f"UPDATE head SET definition_revision = 2, revision = 2, hash = '{second.hash}'",
    )
    with pytest.raises(StoreReplacedError, match="revision 3, committed before, is not in it"):
        kb.objects.insert(waypoint(9))


@pytest.mark.usefixtures("impatient")
def test_an_answer_that_cannot_be_found_out_names_what_to_look_for(
    kb: KnowledgeBase, shared_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closed_door(shared_url) as close_door:
        lose_answer(monkeypatch, True, close_door)
        with pytest.raises(OutcomeUnknownError) as caught:
            one_call(kb)
    monkeypatch.undo()
    last = kb.store.revisions()[-1]
    assert last.number == 2
    assert f"revision {last.number} with hash {last.hash}" in str(caught.value)
    assert one_call(kb) is False


def test_what_many_threads_do_is_done_once_while_connections_come_and_go(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)
    counter.start(kb)
    disturbed, done = threading.Event(), threading.Event()

    def disturb() -> None:
        ended, pause = 0, 0.05
        # Less and less often: a slow machine needs that long to connect again and be done.
        while not done.wait(pause):
            pause *= 1.2
            ended += terminate(shared_url)
            if ended > 5:
                disturbed.set()

    def save(first: int) -> int:
        for number in range(first, first + 15):
            assert kb.objects.insert(waypoint(number))
        return 15

    def count(_: int) -> int:
        attempts = successes = 0
        while attempts < 15 or not disturbed.is_set():
            attempts += 1
            try:
                counter.increment(kb, 1)
                successes += 1
            except ConnectionLostError:
                continue
        return successes

    with ThreadPoolExecutor(5) as pool:
        pool.submit(disturb)
        try:
            saved = [pool.submit(save, first) for first in (100, 200)]
            counted = [pool.submit(count, number) for number in range(2)]
            saves = sum(outcome.result(60) for outcome in saved)
            counts = sum(outcome.result(60) for outcome in counted)
        finally:
            done.set()
    assert counter.read(kb) == counts
    assert check_chain(shared_url) == {"default": 1 + saves + counts}
