"""What the source has no more is pushed from its archive, or named."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import ArchivedError
from tests.support.archives import count, damage, intact, rows_of, states, target_url
from tests.support.servers import Server
from tests.support.stores import Connect, new_file_store
from tests.support.worlds import counter
from tests.support.worlds.robots import WP2, robot_at
from tests.support.worlds.story import write_whole_story

VERSIONS = ("proposition_version", "function_value_version", "execution_version", "object_version")


def test_an_archived_history_arrives_whole(
    shared_url: str, target: str, tmp_path: Path, connect: Connect
) -> None:
    write_whole_story(shared_url)
    kb = connect(shared_url, knowledge_base="tiago")
    head = kb.revision
    then, before = states(kb, range(head + 1)), rows_of(shared_url)
    for upto in (head // 2, head - 2):
        kb.store.archive(upto + 1, to=target_url(tmp_path))
    sent = kb.store.push(target)
    assert sent.revision == kb.revision == head + 2
    intact(target)
    there = rows_of(target)
    for table in VERSIONS:
        assert there[table] == before[table], table
    assert there["archive"] == rows_of(shared_url)["archive"]
    with kant_sql.connect(target, knowledge_base="tiago") as replica:
        assert states(replica, range(head + 1)) == then
        assert replica.store.anchor().heads == kb.store.anchor().heads


def test_a_replica_is_complete_whenever_its_source_is_archived(
    file_kb: KnowledgeBase, file_url: str, target: str, tmp_path: Path
) -> None:
    count(file_kb, 6)
    file_kb.propositions.save(robot_at(place=WP2))
    file_kb.objects.delete(WP2)
    file_kb.store.push(target)
    whole = rows_of(file_url)["proposition_version"]
    file_kb.store.archive(8, to=target_url(tmp_path))
    file_kb.store.push(target)
    # An atom that comes back has a new id here, and its old one there.
    file_kb.propositions.save(robot_at(place=WP2))
    count(file_kb, 13)
    assert file_kb.store.push(target).revision == 13
    there = rows_of(target)["proposition_version"]
    ended = [row for row in whole if row[2] is not None]
    assert ended
    assert all(there[row] == 1 for row in ended)
    intact(target)
    with kant_sql.connect(target, knowledge_base="tiago") as replica:
        assert counter.read(replica.at(3)) == 2
        assert replica.problem_pddl() == file_kb.problem_pddl()


def test_an_archive_can_become_a_whole_replica(
    file_kb: KnowledgeBase, file_url: str, tmp_path: Path
) -> None:
    count(file_kb, 9)
    there = target_url(tmp_path)
    file_kb.store.archive(5, to=there)
    count(file_kb, 12)
    assert file_kb.store.push(there).revision == 12
    intact(there)
    # And the other way round: a whole replica can take what is archived.
    assert file_kb.store.archive(9, to=there).upto == 8
    file_kb.store.push(there)
    for url in (there, file_url):
        intact(url)
    with kant_sql.connect(there, knowledge_base="tiago") as replica:
        assert [counter.read(replica.at(number)) for number in (2, 6, 10)] == [1, 5, 8]


def test_an_archive_that_is_elsewhere_is_named_and_can_be_given(
    file_kb: KnowledgeBase, target: str, tmp_path: Path
) -> None:
    count(file_kb, 9)
    file_kb.store.archive(5, to=target_url(tmp_path))
    moved = tmp_path / "moved.db"
    (tmp_path / "archive.db").rename(moved)
    with pytest.raises(ArchivedError, match=r"revisions 1 to 4 .*archive\.db.*--archive URL"):
        file_kb.store.push(target)
    with kant_sql.connect(target, knowledge_base="tiago") as replica:
        assert replica.revision == 0
    assert file_kb.store.push(target, archive=f"sqlite:///{moved}").revision == 10
    intact(target)


def test_no_server_that_only_the_source_names_is_connected_to(
    file_kb: KnowledgeBase, file_url: str, target: str, tmp_path: Path, server: Server
) -> None:
    count(file_kb, 9)
    there = server.new_store()
    file_kb.store.archive(5, to=there)
    with socket.create_server(("127.0.0.1", 0)) as collector:
        port = collector.getsockname()[1]
        for named in (there, f"postgresql://robots@127.0.0.1:{port}/fleet"):
            damage(file_url, f"UPDATE archive SET target = '{named}'")
            with pytest.raises(ArchivedError, match=r"a server.*--archive URL"):
                file_kb.store.push(target)
        collector.settimeout(0)
        with pytest.raises(BlockingIOError):
            collector.accept()
    assert file_kb.store.push(target, archive=there).revision == 10


def test_a_target_that_needs_nothing_of_it_needs_no_archive(
    file_kb: KnowledgeBase, target: str, tmp_path: Path
) -> None:
    count(file_kb, 6)
    file_kb.store.push(target)
    file_kb.store.archive(5, to=target_url(tmp_path))
    (tmp_path / "archive.db").unlink()
    assert file_kb.store.push(target).revisions == 1


def test_another_archive_is_refused(
    file_kb: KnowledgeBase, target: str, tmp_path: Path, connect: Connect
) -> None:
    count(file_kb, 9)
    old = target_url(tmp_path, "old.db")
    file_kb.store.push(old)
    file_kb.store.archive(5, to=target_url(tmp_path))
    foreign, empty = (new_file_store(tmp_path / f"{name}.db") for name in ("foreign", "empty"))
    with connect(foreign, knowledge_base="tiago") as other:
        count(other, 12)
    for url in (foreign, empty):
        with pytest.raises(ArchivedError, match="does not have them"):
            file_kb.store.push(target, archive=url)
    # Whatever has them will do.
    assert file_kb.store.push(target, archive=old).revision == 10
