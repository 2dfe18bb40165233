"""What is not archived, or not there: nothing is removed that is not somewhere else."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto
from kant_sql.errors import (
    ConflictError,
    ReadOnlyError,
    ReadOnlyStoreError,
    ReplicaError,
    SchemaMissingError,
    UnknownRevisionError,
)
from kant_sql.history.archive import archive as archiving
from tests.support.archives import count, damage, rows_of, target_url
from tests.support.roles import members
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1


def never(*_: object) -> None:
    """End as if Ctrl-C was pressed."""
    raise KeyboardInterrupt


def test_the_past_and_the_future_cannot_be_archived(file_kb: KnowledgeBase, tmp_path: Path) -> None:
    count(file_kb, 3)
    url = target_url(tmp_path)
    with pytest.raises(ReadOnlyError):
        file_kb.at(2).store.archive(2, to=url)
    with pytest.raises(ReadOnlyError, match="transaction open"), file_kb.transaction():
        file_kb.store.archive(2, to=url)
    with pytest.raises(UnknownRevisionError):
        file_kb.store.archive(4, to=url)
    with pytest.raises(UnknownRevisionError, match="future"):
        file_kb.store.archive(
            file_kb.store.revisions()[-1].committed_at + timedelta(days=1), to=url
        )
    assert not (tmp_path / "archive.db").exists()


def test_a_store_is_no_archive_of_its_own(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    count(kb, 6)
    before = rows_of(shared_url)
    for url in (shared_url, shared_url.replace("sqlite:///", "sqlite:////.")):
        with pytest.raises(ConflictError, match="name another"):
            kb.store.archive(5, to=url)
    assert rows_of(shared_url) == before


def test_an_archive_in_memory_is_refused(counted: KnowledgeBase) -> None:
    with pytest.raises(ConflictError, match="name a file"):
        counted.store.archive(5, to="sqlite://")
    assert counted.revision == 6


def test_a_server_must_have_the_tables(counted: KnowledgeBase, server: Server) -> None:
    with pytest.raises(SchemaMissingError, match="kant-sql db upgrade"):
        counted.store.archive(5, to=server.new_database())


def test_another_knowledge_base_of_the_name_is_left_alone(
    counted: KnowledgeBase, archive_url: str, connect: Connect
) -> None:
    with connect(archive_url, knowledge_base="tiago") as other:
        counter.start(other)
    before = rows_of(archive_url)
    with pytest.raises(ConflictError, match="has another knowledge base"):
        counted.store.archive(5, to=archive_url)
    assert rows_of(archive_url) == before
    assert counted.revision == 6


def test_an_archive_that_was_written_to_is_left_alone(
    counted: KnowledgeBase, archive_url: str, connect: Connect
) -> None:
    counted.store.archive(4, to=archive_url)
    with connect(archive_url, knowledge_base="tiago") as archive:
        with pytest.raises(ReplicaError):
            archive.objects.save(PddlObjectDto(RB1.type, "rb2"))
        archive.store.promote()
        archive.objects.save(PddlObjectDto(RB1.type, "rb2"))
    with pytest.raises(ConflictError, match="was written to"):
        counted.store.archive(6, to=archive_url)
    assert counted.revision == 7


def test_what_was_moved_before_must_be_where_the_rest_goes(
    counted: KnowledgeBase, archive_url: str, tmp_path: Path
) -> None:
    counted.store.archive(4, to=archive_url)
    with pytest.raises(ConflictError, match="it lacks the versions that ended up to revision 3"):
        counted.store.archive(6, to=target_url(tmp_path, "another.db"))
    assert counted.store.archive(6, to=archive_url).upto == 5


def test_nothing_is_removed_that_the_archive_has_lost(
    file_kb: KnowledgeBase, file_url: str, archive_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    count(file_kb, 8)
    before = rows_of(file_url)
    with monkeypatch.context() as patch:
        patch.setattr(archiving, "_move_all", never)
        with pytest.raises(KeyboardInterrupt):
            file_kb.store.archive(7, to=archive_url)
    for statement in (
        "UPDATE proposition_version SET since = since - 1 WHERE until = 5",
        "UPDATE proposition SET text = '(value c n9)' WHERE text = '(value c n2)'",
        "DELETE FROM proposition_argument WHERE position = 1 AND proposition_id IN"
        " (SELECT id FROM proposition WHERE text = '(value c n3)')",
        "DELETE FROM proposition_version WHERE until = 4",
    ):
        shutil.copy(archive_url.removeprefix("sqlite:///"), f"{file_url[10:]}.damaged")
        damage(f"{file_url}.damaged", statement)
        with pytest.raises(ConflictError, match="nothing was removed"):
            file_kb.store.archive(7, to=f"{file_url}.damaged")
        assert rows_of(file_url) == before
    assert file_kb.store.archive(7, to=archive_url).revision == 9


def test_an_archive_that_lost_what_holds_is_not_gone_on_with(
    file_kb: KnowledgeBase, archive_url: str
) -> None:
    count(file_kb, 8)
    file_kb.store.archive(4, to=archive_url)
    damage(archive_url, "DELETE FROM proposition_version WHERE until IS NULL")
    with pytest.raises(ConflictError, match="rows of proposition_version are missing"):
        file_kb.store.archive(7, to=archive_url)


def test_who_may_not_remove_is_told_before_anything_is_done(
    server: Server, tmp_path: Path, connect: Connect
) -> None:
    url = server.new_store()
    count(connect(url, knowledge_base="tiago"), 6)
    with (
        members(url, kant_sql.operations.create_roles(url)) as own,
        kant_sql.connect(own.writer, knowledge_base="tiago") as kb,
        pytest.raises(ReadOnlyStoreError),
    ):
        kb.store.archive(5, to=target_url(tmp_path))
    assert not (tmp_path / "archive.db").exists()
