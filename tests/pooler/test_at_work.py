"""Through PgBouncer all of the library works; only LISTEN becomes polling."""

from __future__ import annotations

import logging
import random
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase, StoreBusyError, StoreError
from kant_sql.errors import InvalidUrlError
from kant_sql.history import follow as watching
from kant_sql.sql.dialects import base as retry
from kant_sql.sql.dialects.postgresql import PooledSession
from tests.support.chain import check_chain
from tests.support.poolers import Pooler
from tests.support.processes.watchers import Waiting
from tests.support.processes.workers import PATIENCE, count, in_processes, wait_for
from tests.support.reading import store_of
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import robot_at, waypoint


@contextmanager
def running(server: Server, mode: str = "transaction", **settings: str) -> Iterator[Pooler]:
    pooler = Pooler(server, pool_mode=mode, **settings)
    try:
        yield pooler
    finally:
        pooler.stop()


def is_pooled(kb: KnowledgeBase) -> bool:
    with store_of(kb).backend.open_session() as session:
        return isinstance(session, PooledSession)


# Which sessions there are.


@pytest.mark.parametrize("mode", ["transaction", "statement", "session"])
def test_a_pooler_is_found_out(server: Server, direct: str, connect: Connect, mode: str) -> None:
    with running(server, mode) as pooler:
        if mode == "statement":
            with pytest.raises(StoreError, match=r"statement pooling.* set pool_mode"):
                connect(pooler.url(direct)).propositions.save(robot_at())
            return
        assert is_pooled(connect(pooler.url(direct)))
        assert not is_pooled(connect(direct))
        # What the URL says counts.
        said = make_url(direct).update_query_dict({"pooler": "transaction"})
        assert is_pooled(connect(said.render_as_string(hide_password=False)))


def test_a_pooler_that_keeps_sessions_can_be_listened_through(
    server: Server, direct: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "LOOK_EVERY", 10 * PATIENCE)
    with running(server, "session", default_pool_size="8") as pooler:
        kb = connect(pooler.url(direct, pooler="session"), knowledge_base="tiago")
        assert not is_pooled(kb)
        kb.propositions.save(robot_at())
        call = Waiting(kb, 1, None)
        call.listens()
        with psycopg.connect(direct) as raw:
            [(listeners,)] = raw.execute(
                "SELECT count(*) FROM pg_stat_activity WHERE query LIKE 'LISTEN kant_sql%'"
            )
        assert listeners == 1
        connect(direct, knowledge_base="tiago").propositions.delete_all()
        assert call.result() == 2
        kb.close()


@pytest.mark.parametrize("value", ["none", "Transaction", "statement"])
def test_an_unknown_pooler_is_refused(direct: str, value: str) -> None:
    url = make_url(direct).update_query_dict({"pooler": value})
    with pytest.raises(InvalidUrlError, match=f"pooler={value} is unknown; write pooler=trans"):
        kant_sql.connect(url.render_as_string(hide_password=False))


def test_settings_of_a_session_are_refused(direct: str) -> None:
    more = {"pooler": "transaction", "options": "-c synchronous_commit=off"}
    url = make_url(direct).update_query_dict(more)
    with pytest.raises(InvalidUrlError, match=r"options= .* ALTER ROLE \.\.\. SET"):
        kant_sql.connect(url.render_as_string(hide_password=False))


def test_a_session_of_the_server_itself_is_set_once(direct: str, connect: Connect) -> None:
    kb = connect(direct, knowledge_base="tiago")
    with store_of(kb).backend.open_session() as session:
        kb.propositions.save(robot_at())
        assert session.rows_of("SHOW lock_timeout") == [("20s",)]
    reader = connect(direct, knowledge_base="tiago", read_only=True)
    with store_of(reader).backend.open_session() as session:
        assert session.rows_of("SHOW transaction_read_only") == [("on",)]
        assert session.rows_of("SHOW lock_timeout") == [("20s",)]


# At work.


@pytest.mark.parametrize("size", ["narrow", "wide"])
def test_processes_lose_no_update(
    request: pytest.FixtureRequest, direct: str, connect: Connect, size: str
) -> None:
    url: str = request.getfixturevalue(size)
    kb = connect(url, knowledge_base="tiago")
    counter.start(kb)
    in_processes(*[(count, url, counter.increment, 12)] * 4)
    assert counter.read(kb) == 48
    assert check_chain(direct) == {"tiago": 49}
    assert kb.store.verify().findings == ()


def test_many_knowledge_bases_take_turns_on_one_connection(narrow: str, direct: str) -> None:
    def write(number: int) -> None:
        with kant_sql.connect(narrow, knowledge_base=f"robot {number}") as kb:
            for place in range(10):
                kb.objects.save(waypoint(place))
            assert kb.watch(9, timeout=PATIENCE) == 10

    with ThreadPoolExecutor(20) as pool:
        assert [*pool.map(write, range(20))] == [None] * 20
    assert check_chain(direct) == {f"robot {number}": 10 for number in range(20)}


def test_those_who_wait_hold_no_connection_of_the_server(
    narrow: str, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    kb = connect(narrow, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    with caplog.at_level(logging.WARNING, "kant_sql.postgresql"):
        calls = [Waiting(kb, 1, None) for _ in range(10)]
        for call in calls:
            call.listens()
    kb.propositions.delete_all()
    assert [call.result() for call in calls] == [2] * 10
    assert "LISTEN is not possible through a pooler" in caplog.text


def test_a_store_of_many_knowledge_bases_polls_for_all(
    narrow: str, caplog: pytest.LogCaptureFixture
) -> None:
    with kant_sql.open_store(narrow, connections=2) as store:
        kbs = [store.knowledge_base(f"robot {number}") for number in range(5)]
        for kb in kbs:
            kb.propositions.save(robot_at())
        calls = [Waiting(kb, 1, None) for kb in kbs]
        with caplog.at_level(logging.WARNING, "kant_sql.postgresql"):
            for call in calls:
                call.listens()
        for kb in kbs:
            kb.propositions.delete_all()
        assert [call.result() for call in calls] == [2] * 5
    assert caplog.text.count("LISTEN is not possible through a pooler") == 1


def test_a_crowded_pooler_is_busy_and_says_so(
    server: Server, direct: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", 0.2)
    with running(server, max_client_conn="5", query_wait_timeout="1") as pooler:
        url = pooler.url(direct)
        kb = connect(url, knowledge_base="tiago")
        kb.propositions.save(robot_at())
        with psycopg.connect(url) as holder:
            holder.execute("SELECT 1")
            with pytest.raises(StoreBusyError, match=r"no connection .*query_wait_timeout"):
                kb.propositions.delete_all()
        assert kb.propositions.get_all() == [robot_at()]
        crowd = [psycopg.connect(url) for _ in range(4)]
        with pytest.raises(StoreBusyError, match=r"no connection .*no more connections"):
            connect(url)
        for client in crowd:
            client.close()
        assert connect(url, knowledge_base="tiago").revision == 1


def test_a_killed_pooler_loses_nothing(
    server: Server, direct: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)
    done = threading.Event()
    inserted = [0, 0, 0]

    def insert(kb: KnowledgeBase, writer: int) -> None:
        while not done.is_set():
            assert kb.objects.insert(waypoint(inserted[writer]))
            inserted[writer] += 1

    def all_go_on() -> None:
        before = [*inserted]
        wait_for(lambda: all(now > then + 1 for now, then in zip(inserted, before, strict=True)))

    with running(server, default_pool_size="4") as pooler:
        kbs = [connect(pooler.url(direct), knowledge_base=f"robot {n}") for n in range(3)]
        with ThreadPoolExecutor(3) as pool:
            calls = [pool.submit(insert, kb, number) for number, kb in enumerate(kbs)]
            try:
                for _ in range(4):
                    all_go_on()
                    time.sleep(random.uniform(0, 0.1))
                    pooler.kill()
                    pooler.start()
                all_go_on()
            finally:
                done.set()
            for call in calls:
                call.result(2 * PATIENCE)
        for kb in kbs:
            kb.close()
    assert check_chain(direct) == {f"robot {n}": inserted[n] for n in range(3)}


def test_a_read_waits_for_a_locked_table_as_long_as_the_database_says(
    wide: str, wide_pooler: Pooler, direct: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", 0.3)
    kb = connect(wide, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    with psycopg.connect(direct) as migration, ThreadPoolExecutor(1) as pool:
        migration.execute("LOCK TABLE proposition_version")
        call = pool.submit(kb.propositions.get_all)
        with pytest.raises(TimeoutError):
            call.result(0.5)
        migration.rollback()
        assert call.result(PATIENCE) == [robot_at()]
    with psycopg.connect(direct, autocommit=True) as owner:
        name = owner.info.dbname
        owner.execute(f"ALTER DATABASE {name} SET lock_timeout = '100ms'".encode())
        wide_pooler.ask(f"RECONNECT {name}")
        owner.execute("BEGIN; LOCK TABLE proposition_version")
        with pytest.raises(StoreBusyError, match="lock timeout"):
            kb.propositions.get_all()
        owner.execute("ROLLBACK")
    assert kb.propositions.get_all() == [robot_at()]


def test_sizes_are_read_in_one_state_while_another_writes(wide: str, connect: Connect) -> None:
    """Snapshots span statements, whichever connection a transaction gets."""
    writer, reader = (connect(wide, knowledge_base="tiago") for _ in range(2))
    done = threading.Event()

    def write() -> None:
        for number in range(60):
            with writer.transaction():
                writer.objects.save(waypoint(2 * number))
                writer.objects.save(waypoint(2 * number + 1))
        done.set()

    thread = threading.Thread(target=write)
    thread.start()
    sizes = []
    while not done.is_set():
        sizes.append(len(reader.objects.get_all()))
    thread.join()
    assert all(size % 2 == 0 for size in sizes)
    assert all(before <= after for before, after in pairwise(sizes))
    assert reader.store.verify().findings == ()
