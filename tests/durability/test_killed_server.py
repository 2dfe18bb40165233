"""`kill -9` of the PostgreSQL server: nothing acknowledged is lost, and clients go on."""

from __future__ import annotations

import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from kant_sql import KnowledgeBase
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects import base as retry
from tests.support.chain import check_chain
from tests.support.processes.crashes import Acknowledged, all_told, check_all, write_for_ever
from tests.support.processes.workers import PATIENCE, killed_later
from tests.support.servers import MortalServer
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import waypoint

pytestmark = pytest.mark.more

KILLS = 2


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a server the time that it takes to come back on a busy machine."""
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)


def test_a_killed_server_loses_nothing_that_was_acknowledged(
    mortal_server: MortalServer, mortal_url: str, connect: Connect
) -> None:
    kb = connect(mortal_url, knowledge_base="tiago")
    counter.start(kb)
    acknowledged: list[Acknowledged] = []
    for _ in range(KILLS):
        with killed_later(write_for_ever, mortal_url) as told:
            acknowledged.append(told.recv())
            assert told.poll(PATIENCE)
            time.sleep(random.uniform(0, 0.3))
            mortal_server.kill()
        acknowledged += all_told(told)
        mortal_server.restart()
        check_all(kb, mortal_url, acknowledged)
    assert len(acknowledged) > KILLS


def test_clients_survive_a_killed_server_and_do_everything_once(
    mortal_server: MortalServer, mortal_url: str, connect: Connect
) -> None:
    kb = connect(mortal_url, knowledge_base="tiago")
    counter.start(kb)
    done = threading.Event()
    with ThreadPoolExecutor(3) as pool:
        calls = [pool.submit(_insert, kb, first, done) for first in (1_000, 2_000)]
        transactions = pool.submit(_count, kb, done)
        try:
            for _ in range(KILLS):
                time.sleep(random.uniform(0.2, 0.4))
                mortal_server.kill()
                mortal_server.restart()
            time.sleep(0.2)
        finally:
            done.set()
        inserted = sum(outcome.result(2 * PATIENCE) for outcome in calls)
        counted = transactions.result(2 * PATIENCE)
    assert counter.read(kb) == counted
    assert len(kb.objects.get_all()) == inserted + counted + 2
    assert check_chain(mortal_url) == {"tiago": 1 + inserted + counted}


def _insert(kb: KnowledgeBase, first: int, done: threading.Event) -> int:
    """Insert by single calls, which notice nothing of what happens to the server."""
    number = first
    while not done.is_set():
        assert kb.objects.insert(waypoint(number))
        number += 1
    return number - first


def _count(kb: KnowledgeBase, done: threading.Event) -> int:
    """Count by transactions, and take each that was lost for one that did nothing."""
    successes = 0
    while not done.is_set():
        try:
            counter.increment(kb, 1)
        except ConnectionLostError:
            continue
        successes += 1
    return successes
