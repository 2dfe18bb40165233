"""What is tried again, for how long, and what is raised when that does not help."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import psycopg
import pytest

from kant_sql import KnowledgeBase, StoreBusyError, StoreError
from kant_sql.errors import ConnectionLostError, StoreFullError
from kant_sql.sql.dialects import create_backend, postgresql
from kant_sql.sql.dialects.base import Backend, Session
from tests.support.chain import check_chain
from tests.support.faults import BOUND, each_write, held, lose_answer, on_file, on_server, one_call
from tests.support.processes.workers import PATIENCE
from tests.support.stores import Connect, new_file_store
from tests.support.worlds.robots import WP2, robot_at, waypoint


def quickly(url: str) -> str:
    """Let a file's writers wait for a lock for a moment only."""
    return f"{url}?timeout={BOUND}" if url.startswith("sqlite") else url


# Busy stores.


@each_write
def test_a_writer_waits_for_another_that_is_soon_done(
    shared_url: str,
    connect: Connect,
    work: Callable[[KnowledgeBase], object],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(postgresql, "LOCK_TIMEOUT", "100ms")  # So that it tries again.
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    with held(shared_url) as let_go, ThreadPoolExecutor(1) as pool:
        outcome = pool.submit(work, kb)
        time.sleep(0.25)
        assert not outcome.done()
        let_go()
        assert outcome.result(PATIENCE) is True
    assert kb.revision == 2


@pytest.mark.more
@each_write
@pytest.mark.usefixtures("impatient")
def test_a_writer_gives_up_on_another_that_is_never_done(
    shared_url: str, connect: Connect, work: Callable[[KnowledgeBase], object]
) -> None:
    kb = connect(quickly(shared_url))
    kb.propositions.save(robot_at())
    with held(shared_url):
        began = time.monotonic()
        with pytest.raises(StoreBusyError, match="nothing was written, try again") as caught:
            work(kb)
        assert BOUND / 2 < time.monotonic() - began < 20 * BOUND
        assert kb.propositions.get_all() == [robot_at()]
    assert caught.value.__cause__ is not None
    assert kb.revision == 1
    assert work(kb) is True


@pytest.mark.more
@on_file
@each_write
def test_the_seconds_of_a_url_bound_all_that_a_writer_waits(
    shared_url: str, connect: Connect, work: Callable[[KnowledgeBase], object]
) -> None:
    kb = connect(quickly(shared_url))
    kb.propositions.save(robot_at())
    began = time.monotonic()
    with held(shared_url), pytest.raises(StoreBusyError, match="nothing was written"):
        work(kb)
    with kb.transaction(), ThreadPoolExecutor(1) as pool:
        refused = pool.submit(one_call, kb).exception(10)
    assert f"another thread held the store for over {BOUND:g} s" in str(refused)
    assert time.monotonic() - began < Backend.patience / 2


@pytest.mark.usefixtures("impatient")
def test_a_thread_gives_up_on_another_that_is_never_done(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Backend, "patience", 0.2)
    with kb.transaction():
        kb.propositions.save(robot_at())
        with ThreadPoolExecutor(1) as pool:
            outcome = pool.submit(one_call, kb)
            with pytest.raises(StoreBusyError, match="another"):
                outcome.result(10)
    assert kb.propositions.get_all() == [robot_at()]


@on_server
@pytest.mark.parametrize(
    "error", [psycopg.errors.SerializationFailure, psycopg.errors.DeadlockDetected]
)
def test_a_call_that_the_server_gave_up_is_made_again(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch, error: type[psycopg.Error]
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    failures = iter([error("could not serialize"), error("again")])
    move_head = Session.run

    def run(session: Session, *arguments: Any, **parameters: Any) -> int:
        for failure in failures:
            raise session.backend.translate(failure) from failure
        return move_head(session, *arguments, **parameters)

    monkeypatch.setattr(Session, "run", run)
    assert one_call(kb) is True
    assert check_chain(shared_url) == {"default": 2}


# Disks that are full.


def test_a_full_disk_is_said_and_nothing_is_written(
    tmp_path: Path, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(new_file_store(tmp_path / "store.db"))
    kb.propositions.save(robot_at())
    begin = Session.begin

    def on_full_disk(session: Session, write: bool) -> None:
        session.define("PRAGMA max_page_count = 1")
        begin(session, write)

    monkeypatch.setattr(Session, "begin", on_full_disk)
    with pytest.raises(StoreFullError, match="full; nothing was written: free space"):
        kb.objects.save_all([waypoint(number) for number in range(20_000)])
    assert kb.revision == 1


def test_a_server_s_full_disk_is_told_by_its_state(shared_url: str, connect: Connect) -> None:
    if shared_url.startswith("sqlite"):
        pytest.skip("psycopg's error")
    with closing(create_backend(shared_url)) as backend:
        error = backend.translate(psycopg.errors.DiskFull("could not extend file"))
    assert isinstance(error, StoreFullError)
    assert "free space on the server's disk" in str(error)


@pytest.mark.parametrize("commits", [True, False])
@each_write
def test_what_a_lost_answer_said_is_found_out(
    shared_url: str,
    connect: Connect,
    monkeypatch: pytest.MonkeyPatch,
    work: Callable[[KnowledgeBase], object],
    commits: bool,
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    lose_answer(monkeypatch, commits, lambda: None)
    if commits or work is one_call:
        assert work(kb) is True
    else:
        with pytest.raises(ConnectionLostError):
            work(kb)
        assert kb.revision == 1
        assert work(kb) is True
    assert kb.revision == 2
    assert kb.propositions.delete(robot_at(place=WP2))
    assert not kb.propositions.delete(robot_at(place=WP2))
    assert [len(entry.changes) for entry in kb.log()] == [1, 2, 6]


@on_file
def test_a_transaction_that_the_database_has_undone_cannot_be_committed(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    with closing(sqlite3.connect(shared_url.removeprefix("sqlite:///"))) as connection:
        connection.execute(
            "CREATE TRIGGER full BEFORE INSERT ON object WHEN NEW.name = 'wp3'"
            " BEGIN SELECT RAISE(ROLLBACK, 'disk full'); END"
        )

    def save_and_read() -> None:
        with kb.transaction():
            kb.objects.save(waypoint(3))
            kb.propositions.get_all()

    def go_on() -> None:
        with kb.transaction():
            kb.propositions.save(robot_at(place=WP2))
            assert len(kb.propositions.get_all()) == 2
            with pytest.raises(StoreError, match="disk full"):
                save_and_read()
            kb.goals.save(robot_at(is_goal=True))

    with pytest.raises(StoreError):
        go_on()
    assert kb.propositions.get_all() == [robot_at()]
    assert check_chain(shared_url) == {"default": 1}
    assert one_call(kb) is True
