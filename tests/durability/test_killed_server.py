"""`kill -9` of the PostgreSQL server: nothing acknowledged is lost, and clients go on."""

from __future__ import annotations

import random
import time

import pytest

from kant_sql.sql.dialects import base as retry
from tests.support.chain import check_chain
from tests.support.processes.crashes import Acknowledged, all_told, check_all, go_on, write_for_ever
from tests.support.processes.workers import PATIENCE, killed_later
from tests.support.servers import MortalServer
from tests.support.stores import Connect
from tests.support.worlds import counter

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
    revisions = go_on(connect(mortal_url, knowledge_base="tiago"), mortal_server.crash)
    assert check_chain(mortal_url) == {"tiago": revisions}
