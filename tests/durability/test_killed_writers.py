"""`kill -9` of a writer at any moment: nothing acknowledged is lost, nothing is half there."""

from __future__ import annotations

import random
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

import kant_sql
from tests.support.chain import check_chain
from tests.support.processes import sharing
from tests.support.processes.crashes import Acknowledged, all_told, check_all, write_for_ever
from tests.support.processes.workers import PATIENCE, killed_later
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds import counter

KILLS = 8
CREATIONS = 4


def test_a_killed_writer_loses_nothing_acknowledged(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    counter.start(kb)
    acknowledged: list[Acknowledged] = []
    for _ in range(KILLS):
        with killed_later(write_for_ever, shared_url) as told:
            acknowledged.append(told.recv())
            assert told.poll(PATIENCE)
            time.sleep(random.uniform(0, 0.15))
        acknowledged += all_told(told)
        check_all(kb, shared_url, acknowledged)
    assert len(acknowledged) > KILLS
    with kant_sql.connect(shared_url, knowledge_base="tiago") as newcomer:
        check_all(newcomer, shared_url, acknowledged)


def create(url: str, tell: Connection) -> None:
    """Say that it begins, create a store, and write once."""
    tell.send(0)
    tell.send(sharing.upgrade_and_write(url, 1))
    time.sleep(30)


@pytest.mark.more
@pytest.mark.parametrize("backend", ["sqlite-file", "postgresql"])
def test_a_store_whose_creation_was_killed_can_be_created(
    server: Server, tmp_path: Path, backend: str
) -> None:
    for number in range(CREATIONS):
        is_file = backend == "sqlite-file"
        url = f"sqlite:///{tmp_path}/{number}.db" if is_file else server.new_database()
        with killed_later(create, url) as told:
            assert told.recv() == 0
            time.sleep(random.uniform(0, 0.25))
        written = len(all_told(told))
        kant_sql.upgrade(url)
        with kant_sql.connect(url, knowledge_base="tiago") as kb:
            assert kb.revision >= written
            assert kb.objects.insert(counter.THE_COUNTER)
        assert set(check_chain(url).values()) <= {1, 2}
