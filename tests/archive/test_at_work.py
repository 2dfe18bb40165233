"""Archiving while others write, and while others archive."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.history.replication import batch as replicating
from tests.support.archives import intact, rows_of, target_url
from tests.support.stores import Connect
from tests.support.worlds import counter

FIRST, ROUNDS, STEP, MOST = 20, 3, 6, 200


@pytest.fixture(autouse=True)
def small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Others come between the steps of an archive only when it takes several."""
    monkeypatch.setattr(replicating, "ROWS", 10)
    monkeypatch.setattr(replicating, "FIRST_REVISIONS", 1)


def counted(kb: KnowledgeBase) -> dict[int, int]:
    """Where the counter stood at each revision, by who made it."""
    where, value = {}, -1
    for revision in kb.store.revisions():
        value += revision.actor == "writer"
        where[revision.number] = value
    return where


def test_writers_go_on_while_it_is_archived(
    shared_url: str, tmp_path: Path, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="archiver")
    writer = connect(shared_url, knowledge_base="tiago", actor="writer")
    counter.start(writer)
    there, is_over = target_url(tmp_path), threading.Event()
    counter.increment(writer, FIRST)

    def write() -> None:
        while not is_over.is_set() and writer.revision < MOST:
            counter.increment(writer, 1)

    with ThreadPoolExecutor() as pool:
        writing = pool.submit(write)
        moved = 0
        try:
            while moved < ROUNDS:
                moved += kb.store.archive(moved * STEP + STEP, to=there).revision is not None
        finally:
            is_over.set()
        writing.result()
    where = counted(kb)
    with kant_sql.connect(there, knowledge_base="tiago") as archive:
        last = archive.revision
        for revision in range(1, last + 1):
            assert counter.read(archive.at(revision)) == where[revision]
    for revision in range(last, kb.revision + 1):
        assert counter.read(kb.at(revision)) == where[revision]
    intact(shared_url)
    intact(there)


def test_who_archives_at_the_same_time_moves_everything_once(
    shared_url: str, tmp_path: Path, connect: Connect
) -> None:
    first, second = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    counter.start(first)
    counter.increment(first, 30)
    there, together = target_url(tmp_path), threading.Barrier(2)

    def archive(kb: KnowledgeBase, before: int) -> int:
        together.wait(30)
        return sum(kb.store.archive(before, to=there).versions.values())

    with ThreadPoolExecutor() as pool:
        moved = [*pool.map(archive, (first, second), (21, 27))]
    assert max(moved) <= 2 * 25
    with kant_sql.connect(there, knowledge_base="tiago") as archive_:
        assert [counter.read(archive_.at(r)) for r in range(1, 27)] == [*range(26)]
    ended = sum(row[2] is not None for row in rows_of(there)["proposition_version"].elements())
    assert ended == 2 * 25
    assert [counter.read(first.at(r)) for r in range(26, 32)] == [*range(25, 31)]
    intact(shared_url)
    intact(there)
