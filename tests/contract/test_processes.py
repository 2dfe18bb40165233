"""One store, shared by processes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from kant_sql import KnowledgeBase
from tests.support.chain import check_chain
from tests.support.parts import dao_of
from tests.support.processes import caches, forks
from tests.support.processes.workers import change, count, in_processes, watch
from tests.support.stores import Connect
from tests.support.worlds import counter

PROCESSES = 4
TIMES = 12


@pytest.mark.parametrize("way", counter.WAYS_TO_COUNT)
def test_processes_that_read_modify_and_write_lose_no_update(
    shared_url: str, connect: Connect, way: Callable[[KnowledgeBase, int], None]
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    counter.start(kb)
    in_processes(*[(count, shared_url, way, TIMES)] * PROCESSES)
    assert counter.read(kb) == PROCESSES * TIMES
    numbers = [revision.number for revision in kb.store.revisions()]
    assert numbers == [*range(1, PROCESSES * TIMES + 2)]
    assert check_chain(shared_url) == {"tiago": PROCESSES * TIMES + 1}


@pytest.mark.more
def test_processes_that_read_while_others_write_see_whole_revisions(
    shared_url: str, connect: Connect
) -> None:
    counter.start(connect(shared_url, knowledge_base="tiago"))
    in_processes(*[(count, shared_url, counter.increment, 15)] * 2, *[(watch, shared_url, 30)] * 2)


@pytest.mark.parametrize(("changes", "then"), caches.CHANGES)
def test_a_process_acts_on_what_another_has_changed(
    shared_url: str,
    connect: Connect,
    changes: list[caches.Call],
    then: Callable[[KnowledgeBase], None],
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    caches.world(kb)
    in_processes((change, shared_url, partial(caches.make, changes)))
    then(kb)
    newcomer = connect(shared_url, knowledge_base="tiago")
    for dao in ("types", "objects", "predicates", "actions", "propositions"):
        assert repr(dao_of(kb, dao).get_all()) == repr(dao_of(newcomer, dao).get_all())
    check_chain(shared_url)


@pytest.mark.parametrize(
    "scenario",
    [
        *(forks.both_sides_go_on, forks.children_close_first, forks.within_a_transaction),
        *(forks.out_of_a_transaction, forks.beside_a_thread_in_a_transaction),
        forks.beside_a_thread_that_asks,
    ],
)
def test_an_open_knowledge_base_survives_a_fork(
    shared_url: str, scenario: Callable[[str], None]
) -> None:
    in_processes((scenario, shared_url))
    check_chain(shared_url)


@pytest.mark.more
@pytest.mark.parametrize("other", ["sqlite:///{}/other.db", "sqlite://"])
@pytest.mark.parametrize(
    "scenario", [forks.beside_a_thread_in_another_store, forks.beside_reading_threads]
)
def test_no_child_waits_for_a_mutex_of_sqlite(
    tmp_path: Path, scenario: Callable[[str, str], None], other: str
) -> None:
    in_processes((scenario, f"sqlite:///{tmp_path}/robot.db", other.format(tmp_path)))


@pytest.mark.more
def test_a_child_is_not_forked_while_a_connection_is_opened(tmp_path: Path) -> None:
    in_processes((forks.beside_a_thread_that_connects, f"sqlite:///{tmp_path}/robot.db"))


@pytest.mark.more
def test_a_child_does_not_undo_what_its_parent_has_written(tmp_path: Path) -> None:
    in_processes((forks.within_a_large_transaction, f"sqlite:///{tmp_path}/robot.db"))


def test_a_child_can_push_whatever_a_thread_of_its_parent_did(tmp_path: Path) -> None:
    urls = (f"sqlite:///{tmp_path}/{name}.db" for name in ("robot", "server"))
    in_processes((forks.beside_a_thread_that_pushes, *urls))


def test_a_fork_waits_for_a_migration(tmp_path: Path) -> None:
    in_processes((forks.beside_a_first_open, str(tmp_path)))


def test_a_child_has_a_copy_of_a_store_in_memory() -> None:
    in_processes((forks.in_memory,))
