"""`kb.watch`: waits until there is news, whoever makes it."""

from __future__ import annotations

import math
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from kant_sql import KnowledgeBase, ReadOnlyError, StoreError, UnknownRevisionError
from kant_sql.errors import InvalidTimeoutError, StoreIntegrityError
from kant_sql.history import follow as watching
from kant_sql.sql.dialects import postgresql, postgresql_sharing
from kant_sql.sql.dialects.base import Session
from tests.support.faults import on_file, on_server, terminate
from tests.support.processes.forks import fork_beside_a_watching_thread
from tests.support.processes.watchers import Waiting, open_files, waiting, write_many
from tests.support.processes.workers import PATIENCE, in_processes
from tests.support.reading import present, undone
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.robots import waypoint


def save(kb: KnowledgeBase, number: int) -> None:
    assert kb.objects.insert(waypoint(number))


@pytest.fixture
def tiago(shared_url: str, connect: Connect) -> KnowledgeBase:
    """A knowledge base with a revision, in a store that processes share."""
    kb = connect(shared_url, knowledge_base="tiago")
    save(kb, 0)
    return kb


# What there is to know already.


def test_what_is_new_already_is_told_at_once(kb: KnowledgeBase) -> None:
    for number in range(3):
        save(kb, number)
    assert [kb.watch(after) for after in (0, 1, 2)] == [3, 3, 3]
    assert kb.watch(0, timeout=0) == 3
    for timeout in (1e9, 10**400, math.inf):
        assert kb.watch(2, timeout=timeout) == 3


def test_when_time_is_over_there_is_no_news(kb: KnowledgeBase) -> None:
    for _ in range(2):
        for timeout in (0, 0.0, 0.01):
            assert kb.watch(timeout=timeout) is None
            assert kb.watch(kb.revision, timeout=timeout) is None
        save(kb, kb.revision)


def test_to_look_once_costs_one_statement(kb: KnowledgeBase) -> None:
    save(kb, 1)
    assert count(lambda: kb.watch(1, timeout=0)) == 1
    assert count(lambda: kb.watch(0)) == 1


# What is refused.


def test_a_revision_that_is_not_there_yet_is_refused(kb: KnowledgeBase) -> None:
    save(kb, 1)
    wrong: list[Any] = [2, 2**70, -1, True, "2", 1.0]
    for after in wrong:
        with pytest.raises(UnknownRevisionError, match="revision"):
            kb.watch(after, timeout=0)


def test_a_time_that_is_none_is_refused(kb: KnowledgeBase) -> None:
    wrong: list[Any] = [-1, -0.001, math.nan, -math.inf, "1", True]
    for timeout in wrong:
        with pytest.raises(InvalidTimeoutError, match="timeout is a number of seconds from 0 on"):
            kb.watch(timeout=timeout)


def test_on_the_past_there_is_nothing_to_wait_for(kb: KnowledgeBase) -> None:
    save(kb, 1)
    save(kb, 2)
    with pytest.raises(ReadOnlyError, match="which never changes"):
        kb.at(1).watch(timeout=0)


def test_within_a_transaction_it_would_wait_for_itself(kb: KnowledgeBase) -> None:
    with kb.transaction():
        save(kb, 1)
        with pytest.raises(ReadOnlyError, match="transaction"):
            kb.watch(timeout=0)
    assert kb.watch(0) == 1


# News.


@pytest.mark.usefixtures("only_told")
def test_who_waits_is_told_of_each_revision(kb: KnowledgeBase) -> None:
    save(kb, 0)
    for revision in (2, 3, 4):
        with waiting(kb, revision - 1) as call:
            save(kb, revision)
            assert call.result() == revision


@pytest.mark.usefixtures("only_told")
def test_without_a_revision_it_waits_for_the_next(kb: KnowledgeBase) -> None:
    save(kb, 0)
    with waiting(kb) as call:
        with kb.transaction():
            save(kb, 1)
            save(kb, 2)
        assert call.result() == 2


def test_the_first_revision_of_all_is_news(kb: KnowledgeBase) -> None:
    with waiting(kb) as call:
        save(kb, 0)
        assert call.result() == 1


@pytest.mark.usefixtures("only_told")
def test_what_changes_nothing_is_no_news(kb: KnowledgeBase) -> None:
    save(kb, 0)
    with waiting(kb) as call:
        kb.objects.save(waypoint(0))
        with undone(kb):
            save(kb, 1)
        assert kb.revision == 1
        save(kb, 2)
        assert call.result() == 2


@pytest.mark.usefixtures("only_told")
def test_other_processes_make_news(shared_url: str, tiago: KnowledgeBase) -> None:
    with waiting(tiago) as call:
        in_processes((write_many, shared_url, 1, 1))
        assert call.result() == 2


@on_file
@pytest.mark.usefixtures("only_told")
def test_who_may_only_read_can_wait(
    shared_url: str, connect: Connect, tiago: KnowledgeBase
) -> None:
    with waiting(connect(f"{shared_url}?mode=ro", knowledge_base="tiago")) as call:
        save(tiago, 1)
        assert call.result() == 2


def test_other_knowledge_bases_make_none(shared_url: str, connect: Connect) -> None:
    kb, other = (connect(shared_url, knowledge_base=name) for name in ("tiago", "other"))
    save(kb, 0)
    with waiting(kb) as call:
        for number in (1, 2, 3):
            save(other, number)
        save(kb, 1)
        assert call.result() == 2


@pytest.mark.usefixtures("only_told")
def test_many_threads_wait_and_leave_the_connections_to_who_works(
    url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(postgresql, "POOL_SIZE", 1)
    monkeypatch.setattr(postgresql, "MAX_CONNECTIONS", 2)
    kb = connect(url, knowledge_base="tiago")
    save(kb, 0)
    calls = [Waiting(kb, 1, None) for _ in range(5)]
    for call in calls:
        call.listens()
    save(kb, 1)
    assert [call.result() for call in calls] == [2] * 5


def test_nothing_stays_open(tiago: KnowledgeBase) -> None:
    before = open_files()
    for number in range(20):
        assert tiago.watch(timeout=0.001) is None
        with waiting(tiago) as call:
            save(tiago, 1 + number)
            call.result()
    # The pools keep what was in use at once: a few connections, of some files each.
    assert open_files() < before + 20


def test_every_revision_is_met_while_several_write(shared_url: str, tiago: KnowledgeBase) -> None:
    with ThreadPoolExecutor(1) as pool:
        writers = [(write_many, shared_url, 100 * writer, 20) for writer in (1, 2)]
        running = pool.submit(in_processes, *writers)
        seen: list[int] = []
        while len(seen) < 41:
            news = present(tiago.watch(len(seen), timeout=PATIENCE))
            seen += [entry.revision.number for entry in tiago.changes(len(seen))]
            assert seen[-1] >= news
        running.result(PATIENCE)
    assert seen == list(range(1, 42))


# What can go wrong.


@on_server
@pytest.mark.usefixtures("only_told")
def test_lost_connections_are_made_anew(shared_url: str, tiago: KnowledgeBase) -> None:
    with waiting(tiago) as call:
        for _ in range(3):
            terminate(shared_url)
        in_processes((write_many, shared_url, 1, 1))
        assert call.result() == 2
    assert tiago.watch(2, timeout=0.01) is None


@on_server
def test_news_of_which_no_word_came_is_found(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(postgresql, "channel", lambda _: "elsewhere")
    kb = connect(shared_url, knowledge_base="tiago")
    save(kb, 0)
    with waiting(kb) as call:
        save(kb, 1)
        assert call.result() == 2


@on_server
@pytest.mark.usefixtures("only_told")
def test_a_standby_that_cannot_be_listened_to_is_looked_at(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusal = "kant_sql; DO $$ BEGIN RAISE SQLSTATE '25006'; END $$"
    monkeypatch.setattr(postgresql_sharing, "channel", lambda _: refusal)
    kb = connect(shared_url, knowledge_base="tiago")
    save(kb, 0)
    with waiting(kb) as call:
        save(kb, 1)
        assert call.result() == 2


@on_server
def test_a_notification_that_fails_does_not_undo_what_is_committed(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    too_long = "x" * 9_000
    monkeypatch.setattr(postgresql, "channel", lambda kb: f"kant_sql_{kb}, '{too_long}'")
    kb = connect(shared_url, knowledge_base="tiago")
    save(kb, 0)
    with kb.transaction():
        save(kb, 1)
    assert [str(dto) for dto in kb.objects.get_all()] == ["wp0 - wp", "wp1 - wp"]
    assert kb.revision == 2


@on_server
def test_a_commit_that_is_refused_is_no_notification_that_failed(
    monkeypatch: pytest.MonkeyPatch, tiago: KnowledgeBase
) -> None:
    commit = Session.commit

    def commit_too_much(session: Session, changed: int | None = None) -> None:
        session._execute(
            "INSERT INTO archive (kb_id, id, since, revision, target, versions, rest, text)"
            " VALUES (1, 999, 999, 1, 'x', 0, 'x', 'x')"
        )
        commit(session, changed)

    monkeypatch.setattr(Session, "commit", commit_too_much)
    with pytest.raises(StoreIntegrityError, match="nothing was written"):
        save(tiago, 1)
    assert tiago.revision == 1


def test_a_fork_beside_a_thread_that_waits_is_survived(shared_url: str) -> None:
    in_processes((fork_beside_a_watching_thread, shared_url))


def test_who_waits_sees_that_it_is_closed(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching, "LOOK_EVERY", 0.05)
    save(kb, 0)
    with waiting(kb) as call:
        kb.close()
        with pytest.raises(StoreError, match="'tiago' was closed while this call waited"):
            call.result()


def test_signals_do_not_make_it_wait_for_longer(kb: KnowledgeBase) -> None:
    save(kb, 0)
    over = threading.Event()

    def disturb() -> None:
        # Bounded, so that a call that they do keep waiting ends, too late.
        for _ in range(200):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGUSR1)
            if over.wait(0.02):
                return
        late.set()

    late = threading.Event()
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    thread = threading.Thread(target=disturb)
    thread.start()
    try:
        assert kb.watch(1, timeout=0.1) is None
        assert not late.is_set()
    finally:
        over.set()
        thread.join()
        signal.signal(signal.SIGUSR1, before)
