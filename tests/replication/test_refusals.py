"""What is not pushed: another history, a wrong revision, into what others write to."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto
from kant_sql.errors import (
    ConflictError,
    DivergedError,
    InvalidUrlError,
    ReadOnlyError,
    ReadOnlyStoreError,
    ReplicaError,
    SchemaMissingError,
    StoreIntegrityError,
)
from kant_sql.history.replication import batch
from tests.support.archives import count, damage, equal_histories, intact, rows_of, target_url
from tests.support.faults import change
from tests.support.roles import members
from tests.support.servers import Server
from tests.support.statements import recorded
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1


@pytest.fixture
def pushed(file_kb: KnowledgeBase, replica_url: str) -> KnowledgeBase:
    """A knowledge base of four revisions, which a replica has."""
    count(file_kb, 4)
    file_kb.store.push(replica_url)
    return file_kb


def test_another_history_is_refused_with_the_first_difference(
    shared_url: str, target: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    count(kb, 7)
    kb.store.push(target)
    with connect(target, knowledge_base="tiago") as replica:
        replica.store.promote()
        count(replica, 40)
        there = replica.store.revisions()
    count(kb, 60)
    before = rows_of(target)
    with pytest.raises(DivergedError, match="first revision that differs is 8") as caught:
        kb.store.push(target)
    assert rows_of(target) == before
    error = caught.value
    assert (error.revision, error.source_hash) == (8, kb.store.revisions()[7].hash)
    assert error.target_hash == there[7].hash
    for digest in (error.source_hash, error.target_hash):
        assert f"{digest}" in str(error)


@pytest.mark.parametrize("first", [1, 2, 9, 16])
def test_the_first_difference_is_found_by_few_statements(
    file_kb: KnowledgeBase, tmp_path: Path, connect: Connect, first: int
) -> None:
    copy = target_url(tmp_path, "copy.db")
    count(file_kb, first - 1) if first > 1 else None
    if first > 1:
        file_kb.store.push(copy)
    with connect(copy, knowledge_base="tiago") as other:
        other.store.promote()
        count(other, 16)
    count(file_kb, 18)
    with pytest.raises(DivergedError) as caught, recorded() as statements:
        file_kb.store.push(copy)
    assert caught.value.revision == first
    assert len(statements) < 30


def test_one_altered_revision_is_named_and_nothing_of_its_batch_is_written(
    file_kb: KnowledgeBase, file_url: str, target: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch, "FIRST_REVISIONS", 4)
    count(file_kb, 12)
    damage(file_url, "UPDATE proposition SET text = '(value c n99)' WHERE text = '(value c n8)'")
    with pytest.raises(StoreIntegrityError, match=r"revision 9 .* nothing of revisions 5 to 12"):
        file_kb.store.push(target)
    with kant_sql.connect(target, knowledge_base="tiago") as replica:
        assert replica.revision == 4
        assert counter.read(replica) == 3
    intact(target)


ALTERED = {
    "an actor": "UPDATE revision SET actor = 'somebody' WHERE number = 3",
    "a reason": "UPDATE revision SET reason = 'because' WHERE number = 3",
    "a source": "UPDATE revision SET source = '1' WHERE number = 3",
    "a hash": "UPDATE revision SET hash = lower(hex(randomblob(32))) WHERE number = 3",
    "a time that goes back": "UPDATE revision SET committed_at = '2001-01-01T00:00:00.000000Z'"
    " WHERE number = 3",
    "no time": "UPDATE revision SET committed_at = 'now' WHERE number = 3",
    "another form": "UPDATE revision SET form = 1 WHERE number = 3",
    "a fact more": "UPDATE proposition_version SET since = 3 WHERE since = 4",
    "a revision less": "DELETE FROM revision WHERE number = 3",
    "a fact less": "UPDATE proposition_version SET until = 4 WHERE until = 3",
}


@pytest.mark.parametrize("statement", ALTERED.values(), ids=ALTERED)
def test_whatever_was_altered_is_noticed(
    file_kb: KnowledgeBase, file_url: str, replica_url: str, statement: str
) -> None:
    count(file_kb, 6)
    damage(file_url, statement)
    with pytest.raises(StoreIntegrityError, match=r"(revision|number) [34]\b"):
        file_kb.store.push(replica_url)
    with kant_sql.connect(replica_url, knowledge_base="tiago") as replica:
        assert replica.revision == 0


@pytest.mark.parametrize("is_source", [True, False])
def test_a_head_without_the_hash_of_its_revision_is_no_other_history(
    pushed: KnowledgeBase, file_url: str, replica_url: str, is_source: bool
) -> None:
    damage(file_url if is_source else replica_url, f"UPDATE head SET hash = '{64 * '0'}'")
    with pytest.raises(StoreIntegrityError, match=r"heads .* differ at revision 4"):
        pushed.store.push(replica_url)


def alter(url: str, statement: str) -> None:
    """Change a file by hand, past its constraints."""
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as bare:
        bare.execute("PRAGMA ignore_check_constraints = ON")
        assert bare.execute(statement).rowcount > 0
        bare.commit()


MORE = (
    "INSERT INTO revision (kb_id, number, committed_at, form, hash)"
    " SELECT kb_id, 5, committed_at, form, hash FROM revision WHERE number = 4"
)
CONTRADICTIONS = {
    "a revision that the target has already": (False, MORE, "UNIQUE"),
    "a version that ends before it begins": (
        True,
        "UPDATE proposition_version SET since = 6, until = 5 WHERE since = 5 AND until = 6",
        "since_before_until",
    ),
}


@pytest.mark.parametrize(("is_source", "sql", "said"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_rows_that_a_constraint_refuses_are_told_of_both_stores(
    pushed: KnowledgeBase, file_url: str, replica_url: str, is_source: bool, sql: str, said: str
) -> None:
    count(pushed, 6)
    alter(file_url if is_source else replica_url, sql)
    before = rows_of(replica_url)
    with pytest.raises(StoreIntegrityError, match=said) as caught:
        pushed.store.push(replica_url)
    assert rows_of(replica_url) == before
    assert isinstance(caught.value.__cause__, StoreIntegrityError)
    for part in (
        "revisions 5 to 6 of knowledge base 'tiago'",
        f"'kant-sql verify {file_url} --kb tiago'",
        f"'kant-sql verify {replica_url} --kb tiago'",
    ):
        assert part in str(caught.value)


@pytest.mark.parametrize("is_source", [True, False])
def test_a_head_that_cannot_be_read_is_named_with_its_store(
    pushed: KnowledgeBase, file_url: str, replica_url: str, connect: Connect, is_source: bool
) -> None:
    url = file_url if is_source else replica_url
    for sql in ("committed_at = 'x'", "next_id = 'x'"):
        damage(url, f"UPDATE head SET {sql}")
        with pytest.raises(StoreIntegrityError, match="knowledge base 'tiago'") as caught:
            connect(file_url, knowledge_base="tiago").store.push(replica_url)
        assert url in str(caught.value)


@pytest.mark.parametrize("upto", [4, 6])
def test_a_revision_that_the_target_lacks_is_no_other_history_and_nothing_is_added(
    pushed: KnowledgeBase, replica_url: str, upto: int
) -> None:
    damage(replica_url, "UPDATE revision SET number = 999 WHERE number = 4")
    if upto == 4:
        damage(replica_url, f"UPDATE head SET hash = '{64 * '0'}'")
    count(pushed, upto)
    said = f"{replica_url}: .*'tiago' has revision 4, which is missing"
    with pytest.raises(StoreIntegrityError, match=said):
        pushed.store.push(replica_url)


def test_a_source_that_is_behind_its_archive_lacks_no_revision(
    file_kb: KnowledgeBase, tmp_path: Path, connect: Connect
) -> None:
    count(file_kb, 4)
    behind, archive = (target_url(tmp_path, f"{name}.db") for name in ("behind", "archive"))
    file_kb.store.push(behind)
    count(file_kb, 6)
    file_kb.store.push(archive)
    with connect(behind, knowledge_base="tiago") as old:
        old.store.promote()
        count(old, 6)
        with pytest.raises(DivergedError, match="revision that differs is 5"):
            old.store.archive(3, to=archive)


@pytest.mark.parametrize("id_", ["'x'", "9e999", "1.5"])
def test_an_id_that_is_none_is_an_error_of_the_store(
    pushed: KnowledgeBase, file_url: str, replica_url: str, connect: Connect, id_: str
) -> None:
    damage(replica_url, f"UPDATE knowledge_base SET id = {id_}")
    with pytest.raises(StoreIntegrityError, match=f"'tiago' of {replica_url}.* not an integer"):
        connect(file_url, knowledge_base="tiago").store.push(replica_url)
    with (
        connect(replica_url, knowledge_base="newer") as other,
        pytest.raises(StoreIntegrityError, match=r"the largest id .* not an integer"),
    ):
        other.objects.save(PddlObjectDto(RB1.type, "rb7"))


def test_a_writer_s_role_is_not_enough(
    server: Server, file_kb: KnowledgeBase, connect: Connect
) -> None:
    count(file_kb, 3)
    url = server.new_store()
    with connect(url, knowledge_base="other") as other:
        count(other, 3)
    before = rows_of(url, "other")
    with members(url, kant_sql.operations.create_roles(url)) as own:
        with pytest.raises(ReadOnlyStoreError):
            file_kb.store.push(own.writer)
        assert connect(url, knowledge_base="tiago").revision == 0
        assert rows_of(url, "other") == before


def test_a_knowledge_base_that_is_no_replica_is_adopted_on_request_only(
    file_kb: KnowledgeBase, file_url: str, target: str, connect: Connect
) -> None:
    count(file_kb, 4)
    file_kb.store.push(target)
    damage_head = "UPDATE head SET origin = NULL"
    change(target, damage_head)
    for upto in (4, 6):
        count(file_kb, upto)
        with pytest.raises(ReplicaError, match="adopt=True"):
            file_kb.store.push(target)
    assert file_kb.store.push(target, adopt=True).revisions == 2
    equal_histories(file_url, target)
    change(target, damage_head)
    assert file_kb.store.push(target, adopt=True).revisions == 0
    with connect(target, knowledge_base="tiago") as replica, pytest.raises(ReplicaError):
        counter.increment(replica, 1)


def test_what_is_ahead_and_no_replica_is_refused_and_a_replica_that_is_ahead_is_not(
    file_kb: KnowledgeBase, file_url: str, replica_url: str, tmp_path: Path, connect: Connect
) -> None:
    count(file_kb, 4)
    behind = target_url(tmp_path, "behind.db")
    file_kb.store.push(behind)
    count(file_kb, 6)
    file_kb.store.push(replica_url)
    with connect(behind, knowledge_base="tiago") as old:
        sent = old.store.push(replica_url)
        assert (sent.before, sent.revision, sent.source_revision) == (6, 6, 4)
        with pytest.raises(ReplicaError, match="ahead of 4"):
            old.store.push(file_url, adopt=True)
    with connect(target_url(tmp_path, "new.db"), knowledge_base="tiago") as empty:
        assert empty.store.push(replica_url).revisions == 0
        with pytest.raises(ReplicaError, match="ahead of 0"):
            empty.store.push(file_url)


def test_a_replica_of_a_replica(file_kb: KnowledgeBase, file_url: str, tmp_path: Path) -> None:
    count(file_kb, 4)
    urls = [target_url(tmp_path, f"{number}.db") for number in range(2)]
    file_kb.store.push(urls[0])
    with kant_sql.connect(urls[0], knowledge_base="tiago", read_only=True) as first:
        assert first.store.push(urls[1]).revisions == 4
    equal_histories(file_url, urls[1])


def test_stores_that_cannot_be_targets(
    file_kb: KnowledgeBase, file_url: str, server: Server
) -> None:
    count(file_kb, 2)
    for url in (file_url, file_url.replace("sqlite:///", "sqlite:////.")):
        with pytest.raises(ConflictError, match="name another"):
            file_kb.store.push(url)
    with pytest.raises(ConflictError, match="name a file"):
        file_kb.store.push("sqlite://")
    with pytest.raises(SchemaMissingError, match="kant-sql db upgrade"):
        file_kb.store.push(server.new_database())
    with pytest.raises(InvalidUrlError):
        file_kb.store.push("server")


def test_another_name_of_the_source_s_file_is_no_target(
    file_kb: KnowledgeBase, file_url: str, replica_url: str
) -> None:
    count(file_kb, 2)
    os.link(*(url.removeprefix("sqlite:///") for url in (file_url, replica_url)))
    with pytest.raises(ConflictError, match="name another"):
        file_kb.store.push(replica_url)


def test_nothing_is_left_of_a_file_that_gets_no_revision(
    file_kb: KnowledgeBase, file_url: str, replica_url: str, connect: Connect
) -> None:
    path = Path(replica_url.removeprefix("sqlite:///"))
    assert connect(file_url, knowledge_base="nobody").store.push(replica_url).revision == 0
    assert not path.exists()
    count(file_kb, 4)
    damage(file_url, "UPDATE revision SET actor = 'somebody' WHERE number = 3")
    with pytest.raises(StoreIntegrityError):
        file_kb.store.push(replica_url)
    assert not path.exists()
    kant_sql.upgrade(replica_url)
    with pytest.raises(StoreIntegrityError):
        file_kb.store.push(replica_url)
    assert path.exists()


def test_tables_of_another_version_are_refused(file_kb: KnowledgeBase, replica_url: str) -> None:
    count(file_kb, 2)
    kant_sql.upgrade(replica_url)
    damage(replica_url, "UPDATE kant_sql_version SET version_num = '9999'")
    with pytest.raises(kant_sql.errors.SchemaTooNewError, match="9999"):
        file_kb.store.push(replica_url)


def test_pasts_and_open_transactions_are_not_pushed(file_kb: KnowledgeBase, tmp_path: Path) -> None:
    count(file_kb, 3)
    url = target_url(tmp_path)
    with pytest.raises(ReadOnlyError):
        file_kb.at(2).store.push(url)
    with pytest.raises(ReadOnlyError):
        file_kb.at(2).store.promote()
    with file_kb.transaction(), pytest.raises(ReadOnlyError, match="transaction open"):
        file_kb.store.push(url)
    assert not (tmp_path / "archive.db").exists()


def test_two_stores_never_become_replicas_of_each_other(
    pushed: KnowledgeBase, file_url: str, replica_url: str, connect: Connect
) -> None:
    replica = connect(replica_url, knowledge_base="tiago")
    with pytest.raises(ReplicaError, match=r"is itself a replica.*push from the original"):
        replica.store.push(file_url, adopt=True)
    count(pushed, 5)
    assert pushed.store.push(replica_url).revisions == 1
    replica.store.promote()
    counter.increment(replica, 1)
    assert replica.store.push(file_url, adopt=True).revisions == 2


def test_names_are_pushed_one_by_one(
    file_kb: KnowledgeBase, file_url: str, replica_url: str, connect: Connect
) -> None:
    count(file_kb, 3)
    with connect(file_url, knowledge_base="other") as other:
        other.objects.save(PddlObjectDto(RB1.type, "rb7"))
    file_kb.store.push(replica_url)
    assert connect(replica_url, knowledge_base="other").revision == 0
    connect(file_url, knowledge_base="other").store.push(replica_url)
    for name in ("tiago", "other"):
        equal_histories(file_url, replica_url, name)
