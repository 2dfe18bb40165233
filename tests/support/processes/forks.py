"""Processes that fork with a knowledge base open; each function runs in a new process."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import ForkedError
from kant_sql.history.replication import calls
from kant_sql.reasoning import operators
from kant_sql.reasoning.rule_watch import RuleWatcher
from kant_sql.sql import schema
from kant_sql.sql.dialects.structure import Statement
from tests.support.processes.watchers import waiting
from tests.support.processes.workers import Child
from tests.support.reading import store_of
from tests.support.worlds.robots import robot_at, waypoint

# Enough facts for more pages than SQLite's cache can hold.
MANY = 20_000


def _save(kb: KnowledgeBase, number: int) -> None:
    assert kb.propositions.insert(robot_at(place=waypoint(number)))


def both_sides_go_on(url: str) -> None:
    """Write in the parent and in the child, even after the other has closed."""
    kb = kant_sql.connect(url)
    _save(kb, 1)
    parent_closed, tell = os.pipe()

    def child() -> None:
        os.close(tell)
        _save(kb, 2)
        assert robot_at(place=waypoint(1)) in kb.propositions.get_all()
        os.read(parent_closed, 1)
        _save(kb, 3)
        kb.close()

    forked = Child(child)
    _save(kb, 4)
    kb.close()
    os.close(tell)
    forked.join()
    with kant_sql.connect(url) as later:
        assert len(later.propositions.get_all()) == later.revision == 4


def children_close_first(url: str) -> None:
    """Let children come and go while the parent continues with its open knowledge base."""
    with kant_sql.connect(url) as kb:
        for number in range(4):
            _save(kb, number)

            def child(number: int = number) -> None:
                _save(kb, 10 + number)
                kb.close()

            Child(child).join()
        assert len(kb.propositions.get_all()) == kb.revision == 8


def within_a_transaction(url: str) -> None:
    """Fork in a transaction: it stays the parent's, and the child has its own."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)
        with kb.transaction(), kb.transaction():
            _save(kb, 2)
            assert len(kb.propositions.get_all()) == 2

            has_read, say = os.pipe()

            def child() -> None:
                assert len(kb.propositions.get_all()) == 1
                os.write(say, b"1")
                with kb.transaction(reason="child"):
                    _save(kb, 3)

            forked = Child(child)
            os.close(say)
            # The child must not see later commits. Without an answer, the child has failed, and
            # prints why.
            os.read(has_read, 1)
            os.close(has_read)
            time.sleep(0.1)
            _save(kb, 4)
        forked.join()
        assert len(kb.propositions.get_all()) == 4
        assert [revision.reason for revision in kb.store.revisions()] == [None, None, "child"]


def out_of_a_transaction(url: str) -> None:
    """Let the child leave the block that the parent has entered."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)
        pid = 0
        try:
            with kb.transaction():
                _save(kb, 2)
                pid = os.fork()
        except ForkedError:
            os._exit(7)
        finally:
            if pid == 0:
                os._exit(8)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 7
        _save(kb, 3)
        assert len(kb.propositions.get_all()) == kb.revision == 3


@contextmanager
def _in_a_transaction(kb: KnowledgeBase) -> Iterator[None]:
    """Keep a thread in a transaction until the end of the block."""
    entered, leave = threading.Event(), threading.Event()

    def work() -> None:
        with kb.transaction():
            _save(kb, 2)
            assert robot_at(place=waypoint(2)) in kb.propositions.get_all()
            entered.set()
            leave.wait(30)

    thread = threading.Thread(target=work)
    thread.start()
    entered.wait(30)
    yield
    leave.set()
    thread.join()


@contextmanager
def _again_and_again(work: Callable[[], object], threads: int) -> Iterator[None]:
    """Let threads repeat something until the end of the block."""
    is_over = threading.Event()

    def repeat() -> None:
        while not is_over.is_set():
            work()

    running = [threading.Thread(target=repeat) for _ in range(threads)]
    for thread in running:
        thread.start()
    try:
        yield
    finally:
        is_over.set()
        for thread in running:
            thread.join()


def _refused(work: Callable[[], object]) -> None:
    try:
        work()
    except ForkedError:
        return
    raise AssertionError("SQLite would not survive this")


def beside_a_thread_in_a_transaction(url: str) -> None:
    """Fork while another thread is in a transaction: the child works, or says why it cannot."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)

        def child() -> None:
            if url.startswith("sqlite"):
                _refused(kb.propositions.get_all)
            else:
                _save(kb, 3)

        with _in_a_transaction(kb):
            forked = Child(child)
            time.sleep(0.1)
        forked.join()
        _save(kb, 4)
        assert len(kb.propositions.get_all()) == kb.revision


def in_memory() -> None:
    """Fork with a store in memory: the child has a copy, as of all memory."""
    with kant_sql.connect("sqlite://") as kb:
        _save(kb, 1)
        with kb.transaction():
            _save(kb, 2)
            assert len(kb.propositions.get_all()) == 2

            def child() -> None:
                assert len(kb.propositions.get_all()) == 1
                _save(kb, 3)
                assert kb.revision == 2

            Child(child).join()
        assert [str(fact) for fact in kb.propositions.get_all()] == [
            "(robot_at rb1 wp1)",
            "(robot_at rb1 wp2)",
        ]


def fork_beside_a_watching_thread(url: str) -> None:
    """Fork while a thread waits for news: parent and child continue, and each can wait."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.objects.save(waypoint(1))
        with waiting(kb) as call:

            def child() -> None:
                assert kb.watch(0, timeout=0) == 1
                assert kb.objects.insert(waypoint(2))
                assert kb.watch(1, timeout=0) == 2
                assert kb.watch(2, timeout=0.01) is None
                kb.close()

            Child(child).join()
            assert call.result() == 2
        with waiting(kb, 2) as call:
            Child(lambda: None).join()
            kb.objects.save(waypoint(3))
            assert call.result() == 3


def beside_a_thread_in_another_store(url: str, other_url: str) -> None:
    """Fork while a thread is in a transaction of another SQLite store: the child says so."""
    with kant_sql.connect(url) as kb, kant_sql.connect(other_url) as other:
        _save(kb, 1)

        def child() -> None:
            _refused(kb.propositions.get_all)
            _refused(other.propositions.get_all)
            _refused(partial(kant_sql.connect, f"{url}.new"))
            kb.close()

        with _in_a_transaction(other):
            forked = Child(child)
        forked.join()
        _save(kb, 2)
        assert len(kb.propositions.get_all()) == 2
        Child(partial(_save, kb, 3)).join()
        assert len(kb.propositions.get_all()) == 3


def within_a_large_transaction(url: str) -> None:
    """Fork when SQLite has written pages of an open transaction: they stay, the child says so."""
    many = [robot_at(place=waypoint(number)) for number in range(MANY)]
    with kant_sql.connect(url) as kb:
        _save(kb, MANY)
        with kb.transaction():
            kb.propositions.save_all(many)
            Child(lambda: _refused(kb.propositions.get_all)).join()
            assert len(kb.propositions.get_all()) == MANY + 1
            kb.propositions.delete(many[0])
        assert len(kb.propositions.get_all()) == MANY
        assert kb.store.verify().is_intact
        Child(lambda: _save(kb, MANY + 1)).join()


def beside_reading_threads(url: str, other_url: str) -> None:
    """Fork repeatedly while threads read another store: no child waits for ever."""
    with kant_sql.connect(url) as kb, kant_sql.connect(other_url) as other:
        _save(kb, 1)
        _save(other, 1)
        with _again_and_again(other.propositions.get_all, threads=2):
            for _ in range(60):
                Child(lambda: None).join()
        assert len(kb.propositions.get_all()) == 1


def beside_a_first_open(folder: str) -> None:
    """Fork while a thread creates the tables of a new store: the child does not wait for it."""
    begun = threading.Event()
    recorded = schema.recorded

    def slowly(dialect_name: str) -> list[Statement]:
        begun.set()
        time.sleep(0.3)
        return recorded(dialect_name)

    def create(name: str) -> None:
        with kant_sql.connect(f"sqlite:///{Path(folder, name)}") as kb:
            _save(kb, 1)
            assert kb.revision == 1

    schema.recorded = slowly
    thread = threading.Thread(target=create, args=("parents.db",))
    thread.start()
    assert begun.wait(30)
    schema.recorded = recorded

    def child() -> None:
        # After the migration, the thread may already use its store.
        with suppress(ForkedError):
            create("childs.db")

    forked = Child(child)
    thread.join()
    forked.join()


def beside_a_thread_that_pushes(url: str, target: str) -> None:
    """Fork while a thread holds the lock that all pushes share: the child can push."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)
        kb.store.push(target)
        _save(kb, 2)
        held = threading.Event()

        def hold() -> None:
            with calls._GUARD:
                held.set()
                time.sleep(0.3)

        def child() -> None:
            kb.store.push(target)

        thread = threading.Thread(target=hold)
        thread.start()
        held.wait(30)
        Child(child).join()
        thread.join()
    with kant_sql.connect(target) as replica:
        assert replica.revision == 2


def beside_a_thread_that_asks(url: str) -> None:
    """Fork while a thread holds the cache of questions: the child asks them again."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)
        kb.rules.save("there", "(sometime (robot_at rb1 wp1))")
        state = kb.state()
        assert len(kb.rules.standing()) == 1
        watcher = store_of(kb).remembered[RuleWatcher]
        held, is_over = threading.Event(), threading.Event()

        def hold() -> None:
            with watcher._lock, state._task.lock:
                with operators._LOCK:
                    held.set()
                    time.sleep(0.3)
                is_over.wait(30)

        def child() -> None:
            assert len(kb.rules.standing()) == 1
            assert kb.state().holds("(robot_at rb1 wp1)")

        thread = threading.Thread(target=hold)
        thread.start()
        held.wait(30)
        Child(child).join()
        is_over.set()
        thread.join()


def beside_a_thread_that_connects(url: str) -> None:
    """Fork repeatedly while a thread opens and closes the store: children continue or say why."""
    with kant_sql.connect(url) as kb:
        _save(kb, 1)

        def child() -> None:
            with suppress(ForkedError):
                assert len(kb.propositions.get_all()) == 1

        with _again_and_again(lambda: kant_sql.connect(url).close(), threads=1):
            for _ in range(40):
                Child(child).join()
        assert len(kb.propositions.get_all()) == 1
