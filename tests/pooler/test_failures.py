"""Through a pooler: servers that are killed, forks, and stores that are not there."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import ConnectionLostError, SchemaMissingError
from kant_sql.sql.dialects import base as retry
from tests.support.chain import check_chain
from tests.support.poolers import Pooler
from tests.support.processes import forks
from tests.support.processes.workers import PATIENCE, in_processes, wait_for
from tests.support.servers import MortalServer, Server
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import waypoint


def test_clients_survive_a_killed_server_and_do_everything_once(
    mortal_server: MortalServer,
    mortal_url: str,
    connect: Connect,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)
    pooler = Pooler(mortal_server, default_pool_size="4", server_login_retry="1")
    done = threading.Event()
    inserted, counted = [0], [0]

    def insert(kb: KnowledgeBase) -> None:
        while not done.is_set():
            assert kb.objects.insert(waypoint(inserted[0]))
            inserted[0] += 1

    def count(kb: KnowledgeBase) -> None:
        while not done.is_set():
            try:
                counter.increment(kb, 1)
            except ConnectionLostError:
                # This transaction did nothing.
                continue
            counted[0] += 1

    def both_go_on() -> None:
        before = inserted[0], counted[0]
        wait_for(lambda: inserted[0] > before[0] + 1 and counted[0] > before[1] + 1)

    try:
        kb = connect(pooler.url(mortal_url), knowledge_base="tiago")
        counter.start(kb)
        with ThreadPoolExecutor(2) as pool:
            calls = [pool.submit(insert, kb), pool.submit(count, kb)]
            try:
                for _ in range(2):
                    both_go_on()
                    time.sleep(random.uniform(0, 0.2))
                    mortal_server.kill()
                    mortal_server.restart()
                both_go_on()
            finally:
                done.set()
            for call in calls:
                call.result(2 * PATIENCE)
        assert counter.read(kb) == counted[0]
        kb.close()
    finally:
        pooler.stop()
    assert check_chain(mortal_url) == {"tiago": 1 + inserted[0] + counted[0]}


@pytest.mark.parametrize(
    "scenario",
    [
        forks.both_sides_go_on,
        forks.children_close_first,
        forks.within_a_transaction,
        forks.out_of_a_transaction,
    ],
)
def test_an_open_knowledge_base_survives_a_fork(
    wide: str, direct: str, scenario: Callable[[str], None]
) -> None:
    in_processes((scenario, wide))
    check_chain(direct)


@pytest.mark.parametrize("read_only", [False, True])
def test_a_database_without_tables_is_refused_and_served_later(
    server: Server, narrow_pooler: Pooler, connect: Connect, read_only: bool
) -> None:
    direct = server.new_database()
    url = narrow_pooler.url(direct)
    for _ in range(3):
        with pytest.raises(SchemaMissingError, match="kant-sql db upgrade"):
            connect(url, read_only=read_only)
    kant_sql.upgrade(url)
    assert connect(url, read_only=read_only).revision == 0
    server.drop_database(direct)
