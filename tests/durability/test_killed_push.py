"""`kill -9` of who pushes, of who writes and of the servers: both stores end up the same."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

import kant_sql
from kant_sql import StoreError
from kant_sql.history.replication import batch
from tests.replication.conftest import target
from tests.support.archives import equal_histories, intact, rows_of, target_url
from tests.support.chain import check_chain
from tests.support.processes.commands import PROGRAM, start
from tests.support.processes.crashes import all_told, die_after, write_for_ever
from tests.support.processes.workers import PATIENCE, dies, killed_later, wait_for
from tests.support.servers import MortalServer
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.story import write_whole_story

__all__ = ["target"]

pytestmark = pytest.mark.more

# Enough statements for several batches; a push of all of them takes more.
MOST = 150
KILLS, SERVER_KILLS = 2, 2


def push_and_die(source: str, target: str, statements: int) -> None:
    """Push in small batches, and be killed behind so many statements."""
    die_after(statements)
    batch.ROWS, batch.FIRST_REVISIONS = 30, 2
    with kant_sql.connect(source, knowledge_base="tiago", read_only=True) as kb:
        kb.store.push(target)


def check_prefix(source: str, target: str) -> int:
    """Check that the target is its source at some revision; give that one."""
    (upto,) = check_chain(target).values() or (0,)
    with (
        kant_sql.connect(source, knowledge_base="tiago") as kb,
        kant_sql.connect(target, knowledge_base="tiago") as replica,
    ):
        assert replica.store.revisions() == kb.store.revisions(limit=upto)
    return upto


def check_same(source: str, target: str) -> None:
    """Check that both have the same rows, and that both verify with the same anchor."""
    equal_histories(source, target)
    with (
        kant_sql.connect(source, knowledge_base="tiago") as kb,
        kant_sql.connect(target, knowledge_base="tiago") as replica,
    ):
        assert replica.store.anchor().heads == kb.store.anchor().heads
        assert replica.store.verify(kb.store.anchor()).findings == ()
    intact(source)


def test_a_killed_push_is_gone_on_with(shared_url: str, target: str) -> None:
    write_whole_story(shared_url)
    before, kills, last = rows_of(shared_url), 0, 0
    is_killed = True
    while is_killed:
        is_killed = dies(push_and_die, shared_url, target, random.randrange(MOST))
        kills += is_killed
        before_it, last = last, check_prefix(shared_url, target)
        assert last >= before_it
    assert kills > 0
    check_same(shared_url, target)
    assert rows_of(shared_url) == before


@contextmanager
def following(source: str, target: str, said: Path) -> Iterator[None]:
    """Follow in a process of its own, until the end of the block; then it is killed."""
    words = "push", source, target, "--follow", "--interval", "0"
    with said.open("wb") as output:
        # Not one that another process has forked: that one would be killed in its place.
        process = start(*words, program=PROGRAM, stdout=output, stderr=output)
    try:
        wait_for(lambda: b"event=pushed" in said.read_bytes())
        yield
        assert process.poll() is None, said.read_text()
    finally:
        process.kill()
        process.wait(PATIENCE)


def test_killed_followers_and_writers(
    shared_url: str, target: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    counter.start(kb)
    written = 0
    for number in range(KILLS):
        said = tmp_path / f"{number}.log"
        with killed_later(write_for_ever, shared_url) as told:
            assert told.poll(PATIENCE)
            with following(shared_url, target, said):
                time.sleep(random.uniform(0, 0.5))
        written += len(all_told(told))
        assert check_prefix(shared_url, target) <= kb.revision
    assert written > KILLS
    kb.store.push(target)
    check_same(shared_url, target)


@pytest.mark.parametrize("is_target", [True, False])
def test_killed_servers(
    mortal_server: MortalServer, mortal_url: str, tmp_path: Path, connect: Connect, is_target: bool
) -> None:
    file = target_url(tmp_path, "file.db")
    kant_sql.upgrade(file)
    source, target = (file, mortal_url) if is_target else (mortal_url, file)
    kb = connect(source, knowledge_base="tiago")
    counter.start(kb)
    with following(source, target, tmp_path / "follow.log"):
        for _ in range(SERVER_KILLS):
            _write_for(kb, random.uniform(0.5, 1.5))
            mortal_server.kill()
            _write_for(kb, 0.3 if is_target else 0)
            mortal_server.restart()
        _write_for(kb, 0.5)
        _wait_until_same(kb, target)
    check_same(source, target)


def _write_for(kb: kant_sql.KnowledgeBase, duration: float) -> None:
    end = time.monotonic() + duration
    while time.monotonic() < end:
        counter.increment(kb, 1)


def _wait_until_same(kb: kant_sql.KnowledgeBase, target: str) -> None:
    """Wait for the follower, which comes back by itself."""

    def is_same() -> bool:
        with suppress(StoreError), kant_sql.connect(target, knowledge_base="tiago") as replica:
            return replica.revision == kb.revision
        return False

    wait_for(is_same)
