"""Writers that are killed, and checks of the store afterwards."""

from __future__ import annotations

import itertools
import os
import random
import resource
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import NamedTuple

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, StoreError
from kant_sql.errors import ConnectionLostError
from kant_sql.sql.dialects.base import Session
from tests.support.chain import check_chain
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, navigation, robot_at, waypoint

BULK = 60


class Acknowledged(NamedTuple):
    """A revision whose call has returned to the writer."""

    number: int
    hash: str


def write_for_ever(url: str, tell: Connection) -> None:
    """Write in all possible ways, and report each revision once its call has returned."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="crashing") as kb:
        last = kb.revision
        while True:
            for way in (_one_call, _some_calls, _many_rows, _one_call, _definitions):
                # A transaction lost with its connection has done nothing.
                with suppress(ConnectionLostError):
                    way(kb, last)
                    (revision,) = kb.store.revisions(after=last)
                    tell.send(Acknowledged(revision.number, revision.hash))
                    last = revision.number


def _one_call(kb: KnowledgeBase, last: int) -> None:
    assert kb.objects.insert(PddlObjectDto(ROBOT, f"r{last}"))


def _some_calls(kb: KnowledgeBase, last: int) -> None:
    with kb.transaction(reason=f"after {last}", source={"step": last}):
        counter.move(kb, counter.number_of(kb.propositions.get_by_predicate("value")))


def _many_rows(kb: KnowledgeBase, last: int) -> None:
    kb.propositions.save_all(robot_at(place=waypoint(BULK * last + n)) for n in range(BULK))


def _definitions(kb: KnowledgeBase, last: int) -> None:
    with kb.transaction():
        action = navigation()
        action.duration = last
        kb.actions.save(action)
        assert len(kb.propositions.get_all()) > BULK
        for robot in kb.objects.get_all():
            if robot.type == ROBOT and robot != RB1:
                kb.objects.delete(robot)


def die_after(statements: int) -> None:
    """Let this process be killed after a number of statements."""
    left = itertools.count(statements, -1)

    def counting(execute: Callable[..., None]) -> Callable[..., None]:
        def execute_and_die(*arguments: object) -> None:
            execute(*arguments)
            if next(left) == 0:
                os.kill(os.getpid(), signal.SIGKILL)

        return execute_and_die

    setattr(Session, "_execute", counting(Session._execute))  # noqa: B010


def go_on(kb: KnowledgeBase, kill: Callable[[], object]) -> int:
    """Insert by calls and count by transactions, while something is killed and restarted.

    Returns:
        The number of revisions afterwards.
    """
    done, inserted, counted = threading.Event(), [0], [0]

    def insert() -> None:
        while not done.is_set():
            assert kb.objects.insert(waypoint(inserted[0]))
            inserted[0] += 1

    def count() -> None:
        while not done.is_set():
            # A lost transaction did nothing.
            with suppress(ConnectionLostError):
                counter.increment(kb, 1)
                counted[0] += 1

    def both_go_on() -> None:
        before = inserted[0], counted[0]
        wait_for(lambda: inserted[0] > before[0] + 1 and counted[0] > before[1] + 1)

    counter.start(kb)
    with ThreadPoolExecutor(2) as pool:
        calls = [pool.submit(insert), pool.submit(count)]
        try:
            for _ in range(2):
                both_go_on()
                time.sleep(random.uniform(0, 0.2))
                kill()
            both_go_on()
        finally:
            done.set()
        for call in calls:
            call.result(2 * PATIENCE)
    assert counter.read(kb) == counted[0]
    assert len(kb.objects.get_all()) == inserted[0] + counted[0] + 2
    return 1 + inserted[0] + counted[0]


def all_told(told: Connection) -> list[Acknowledged]:
    """Read the reports of a writer before it was killed."""
    revisions = []
    with told:
        while True:
            try:
                revisions.append(told.recv())
            except EOFError:
                return revisions


def check_all(kb: KnowledgeBase, url: str, acknowledged: list[Acknowledged]) -> None:
    """Check that acknowledged revisions exist, that all are whole, and that writing continues."""
    # A server may still run the last transaction of a lost client: a writer waits for it.
    assert kb.objects.insert(PddlObjectDto(ROBOT, f"checked_at_{kb.revision}"))
    there = {Acknowledged(revision.number, revision.hash) for revision in kb.store.revisions()}
    missing = set(acknowledged) - there
    assert not missing, f"acknowledged and lost: {missing}"
    facts = kb.propositions.get_all()
    assert len([fact for fact in facts if fact.predicate == ROBOT_AT]) % BULK == 0
    number = counter.number_of(fact for fact in facts if fact.predicate.name == "value")
    assert number == counter.number_of(fact for fact in facts if fact.predicate.name == "copy")
    assert check_chain(url) == {"tiago": len(there)}


def fill_disk(url: str) -> tuple[int, int]:
    """Write until the disk is full, then make room and continue.

    Returns:
        The number of calls that returned before, and the last revision.
    """
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        counter.start(kb)
        _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, hard))
        done = 0
        with suppress(StoreError):
            while True:
                _some_calls(kb, done)
                _many_rows(kb, done)
                done += 1
        assert counter.read_by_calls(kb) in (done, done + 1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        _some_calls(kb, done)
        return done, kb.revision
