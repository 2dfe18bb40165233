"""Knowledge bases that are opened for reading only."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import InvalidArgumentError, KnowledgeBase, ReadOnlyError, aio
from kant_sql.errors import ReadOnlyStoreError, SchemaMissingError
from kant_sql.factory import SqlDaoFactory
from kant_sql.sql.query import raw
from tests.support.stores import Connect
from tests.support.worlds.robots import WP1, WP2, robot_at

WRITES: dict[str, Callable[[KnowledgeBase], Any]] = {
    "save": lambda kb: kb.propositions.save(robot_at(place=WP2)),
    "save what is there": lambda kb: kb.propositions.save(robot_at()),
    "delete": lambda kb: kb.propositions.delete_all(),
    "objects": lambda kb: kb.objects.save(WP1),
    "load": lambda kb: kb.load_domain("(define (domain d))"),
    "restore": lambda kb: kb.restore(0),
    "branch": lambda kb: kb.branch("other"),
}


def in_transaction(kb: KnowledgeBase) -> None:
    with kb.transaction():
        pass


@pytest.mark.parametrize("write", [*WRITES.values(), in_transaction], ids=[*WRITES, "transaction"])
def test_writes_are_refused_and_reads_are_not(
    shared_url: str, connect: Connect, write: Callable[[KnowledgeBase], Any]
) -> None:
    kb = connect(shared_url)
    kb.propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with pytest.raises(ReadOnlyError, match="read_only=True"):
        write(reader)
    assert reader.propositions.get_all() == [robot_at()]
    assert (reader.revision, kb.revision) == (1, 1)
    kb.propositions.save(robot_at(place=WP2))
    assert len(reader.propositions.get_all()) == 2
    assert reader.at(1).propositions.get_all() == [robot_at()]
    assert reader.store.verify().findings == ()
    assert reader.watch(after=1, timeout=0) == 2


def test_an_archive_is_refused(shared_url: str, connect: Connect, tmp_path: Path) -> None:
    connect(shared_url).propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with pytest.raises(ReadOnlyError, match="read_only=True"):
        reader.store.archive(1, to=f"sqlite:///{tmp_path / 'archive.db'}")
    assert not (tmp_path / "archive.db").exists()


def test_a_branch_to_another_store_only_reads(shared_url: str, connect: Connect) -> None:
    connect(shared_url).propositions.save(robot_at())
    reader = connect(shared_url, read_only=True)
    with reader.branch() as trial:
        assert trial.propositions.save(robot_at(place=WP2))
    assert reader.propositions.get_all() == [robot_at()]


@pytest.mark.parametrize(
    "sql", ["DELETE FROM head", "CREATE TABLE mine (id INTEGER)", "UPDATE head SET revision = 7"]
)
def test_the_database_itself_refuses(shared_url: str, connect: Connect, sql: str) -> None:
    connect(shared_url).propositions.save(robot_at())
    factory = connect(shared_url, read_only=True).store.factory
    assert isinstance(factory, SqlDaoFactory)
    store = factory._store
    with pytest.raises(ReadOnlyStoreError):
        store.query(lambda session, _: session.run(raw(sql)))
    with pytest.raises(ReadOnlyStoreError):
        store.query_in_snapshot(lambda session, _: session.run(raw(sql)))


def test_a_file_that_is_missing_or_empty_stays_so(tmp_path: Path) -> None:
    path = tmp_path / "none.db"
    with pytest.raises(SchemaMissingError, match="no such file"):
        kant_sql.connect(f"sqlite:///{path}", read_only=True)
    assert not path.exists()
    path.touch()
    with pytest.raises(SchemaMissingError, match="no kant_sql tables"):
        kant_sql.connect(f"sqlite:///{path}", read_only=True)
    assert path.read_bytes() == b""
    assert [*tmp_path.iterdir()] == [path]


def test_a_store_in_memory_is_new_and_has_nothing_to_read() -> None:
    with pytest.raises(SchemaMissingError):
        kant_sql.connect("sqlite://", read_only=True)


def test_a_knowledge_base_that_was_never_written_is_empty(
    shared_url: str, connect: Connect
) -> None:
    reader = connect(shared_url, knowledge_base="nobody", read_only=True)
    assert (reader.revision, reader.propositions.get_all()) == (0, [])


def test_it_is_the_same_for_asyncio(shared_url: str, connect: Connect) -> None:
    connect(shared_url).propositions.save(robot_at())

    async def main() -> None:
        async with aio.connect(shared_url, read_only=True) as kb:
            assert await kb.propositions.get_all() == [robot_at()]
            with pytest.raises(ReadOnlyError):
                await kb.propositions.save(robot_at(place=WP2))

    asyncio.run(main())


@pytest.mark.parametrize("junk", [None, 1, "yes"])
def test_read_only_is_true_or_false(junk: object) -> None:
    with pytest.raises(InvalidArgumentError, match="read_only"):
        kant_sql.connect("sqlite://", read_only=junk)  # type: ignore[arg-type]
