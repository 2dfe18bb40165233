"""Followers that are killed, and servers that are: in the end every revision was met."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from kant_sql import KantSqlError, KnowledgeBase
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects import base as retry
from tests.support.processes.watchers import LAST, follow, open_files, waiting, write_many
from tests.support.processes.workers import PATIENCE, PROCESSES, in_processes, killed_later
from tests.support.servers import MortalServer
from tests.support.stores import Connect
from tests.support.worlds.robots import waypoint

pytestmark = pytest.mark.more

WRITERS, WRITES, KILLS = 3, 40, 4


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a server the time that it takes to come back on a busy machine."""
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)


@contextmanager
def follower(url: str, folder: Path) -> Iterator[Connection]:
    """Follow in a process of its own, until the end of the block; then it is killed."""
    with killed_later(partial(follow, folder), url) as told, told:
        assert told.poll(PATIENCE)
        told.recv()
        yield told


def check_seen(folder: Path, kb: KnowledgeBase) -> None:
    """Check that every revision was met at least once, in order and without gaps."""
    met: dict[int, str] = {}
    for line in (folder / "seen").read_text().splitlines():
        number, _, text = line.partition(" ")
        assert int(number) <= len(met) + 1, "a revision was left out"
        assert met.setdefault(int(number), text) == text
    assert [*met.items()] == [
        (entry.revision.number, " ".join(change.text for change in entry.changes))
        for entry in kb.changes()
    ]


def test_a_follower_that_is_killed_again_and_again_meets_every_revision(
    shared_url: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.objects.save(waypoint(0))
    writers = [
        PROCESSES.Process(target=write_many, args=(shared_url, 100 * writer, WRITES), daemon=True)
        for writer in range(1, WRITERS + 1)
    ]
    for writer in writers:
        writer.start()
    for _ in range(KILLS):
        with follower(shared_url, tmp_path):
            time.sleep(random.uniform(0, 0.2))
    for writer in writers:
        writer.join(PATIENCE)
        assert writer.exitcode == 0
    with follower(shared_url, tmp_path) as told:
        with kb.transaction(reason=LAST):
            kb.objects.save(waypoint(1))
        assert told.poll(PATIENCE)
        assert told.recv() == LAST
    assert kb.revision == 2 + WRITERS * WRITES
    check_seen(tmp_path, kb)


def test_who_waits_survives_a_server_that_is_killed_and_restarted(
    mortal_server: MortalServer, mortal_url: str, connect: Connect
) -> None:
    kb = connect(mortal_url, knowledge_base="tiago")
    kb.objects.save(waypoint(0))
    with waiting(kb) as call:
        mortal_server.crash()
        in_processes((write_many, mortal_url, 1, 1))
        assert call.result() == 2
    with waiting(kb) as call:
        # It listens now; before, its thread may have ended with the server, or live on.
        before = open_files()
        for _ in range(2):
            mortal_server.crash()
        in_processes((write_many, mortal_url, 2, 1))
        assert call.result() == 3
    assert open_files() <= before + 1


def test_a_server_that_is_gone_when_time_is_over_is_an_error(
    mortal_server: MortalServer, mortal_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retry, "RETRY_FOR", 0.2)
    kb = connect(mortal_url, knowledge_base="tiago")
    kb.objects.save(waypoint(0))
    mortal_server.kill()
    try:
        for timeout in (0, 0.1):
            with pytest.raises(KantSqlError, match=r"no connection|was lost"):
                kb.watch(1, timeout=timeout)
    finally:
        mortal_server.restart()
    monkeypatch.setattr(retry, "RETRY_FOR", PATIENCE)
    assert kb.watch(1, timeout=0) is None


def test_a_follower_meets_every_revision_while_the_server_is_killed(
    mortal_server: MortalServer, mortal_url: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(mortal_url, knowledge_base="tiago")
    kb.objects.save(waypoint(0))
    written = iter(range(1, 1000))
    with follower(mortal_url, tmp_path) as told:
        for _ in range(2):
            _write_for(0.2, kb, lambda: next(written))
            mortal_server.crash()
        _write_for(0.1, kb, lambda: next(written))
        with kb.transaction(reason=LAST):
            kb.objects.save(waypoint(9999))
        assert told.poll(PATIENCE)
        assert told.recv() == LAST
    check_seen(tmp_path, kb)


def _write_for(seconds: float, kb: KnowledgeBase, number: Callable[[], int]) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with suppress(ConnectionLostError):
            kb.objects.save(waypoint(number()))
