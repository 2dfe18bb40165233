"""What is pushed is the same history, whatever the two stores are."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import ClosedError, ReplicaError, StoreIntegrityError
from kant_sql.history.replication import batch
from kant_sql.history.replication.calls import _TARGETS
from kant_sql.history.replication.push import Terms, send
from kant_sql.history.replication.target import ReplicationSide, open_target
from kant_sql.sql.dialects.base import Backend
from tests.support.archives import count, damage, equal_histories, intact, rows_of
from tests.support.servers import Server
from tests.support.statements import recorded
from tests.support.stores import Connect
from tests.support.worlds.robots import RB1, robot_at, waypoint
from tests.support.worlds.story import write_whole_story


def backend_of(kb: KnowledgeBase) -> Backend:
    return kb.store.factory._store.backend  # type: ignore[attr-defined, no-any-return]


def test_a_replica_has_every_row_of_its_source(
    shared_url: str, target: str, connect: Connect
) -> None:
    write_whole_story(shared_url)
    kb = connect(shared_url, knowledge_base="tiago")
    sent = kb.store.push(target)
    assert (sent.before, sent.revision, sent.source_revision) == (0, kb.revision, kb.revision)
    equal_histories(shared_url, target)
    intact(target)
    with kant_sql.connect(target, knowledge_base="tiago") as replica:
        assert replica.store.verify(kb.store.anchor()).is_intact
        assert replica.store.anchor().heads == kb.store.anchor().heads
        assert replica.problem_pddl() == kb.problem_pddl()


def test_it_goes_on_where_it_was(shared_url: str, target: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    for upto in (3, 4, 9):
        count(kb, upto)
        sent = kb.store.push(target)
        assert sent.revision == sent.before + sent.revisions == upto
        equal_histories(shared_url, target)
    assert kb.store.push(target).revisions == 0
    intact(target)


def test_a_store_in_memory_can_be_pushed(kb: KnowledgeBase, target: str) -> None:
    count(kb, 5)
    assert kb.store.push(target).revision == 5
    intact(target)


def test_with_nothing_new_it_takes_one_statement_on_each_side(
    shared_url: str, target: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    count(kb, 6)
    kb.store.push(target)
    for _ in range(2):
        with recorded() as statements:
            assert kb.store.push(target).revisions == 0
        # The same one on each side.
        assert len(statements) == 2
        assert len({sql.split("WHERE")[0] for sql in statements}) == 1


def test_a_revision_takes_the_same_few_statements_however_long_the_history(
    file_kb: KnowledgeBase, target: str
) -> None:
    counts = []
    file_kb.propositions.save(robot_at())
    for upto in (11, 41, 161):
        for _ in range(file_kb.revision, upto, 2):
            file_kb.propositions.delete(robot_at())
            file_kb.propositions.save(robot_at())
        file_kb.store.push(target)
        file_kb.propositions.delete(robot_at())
        with recorded() as statements:
            assert file_kb.store.push(target).revisions == 1
        counts.append(len(statements))
        file_kb.propositions.save(robot_at())
    assert len({*counts}) == 1
    # Five of them read confirmations, sayings of facts and of values, erasures and commitments.
    assert counts[0] <= 29, statements


@pytest.mark.more
def test_a_revision_of_many_changes_arrives(
    file_kb: KnowledgeBase, file_url: str, target: str
) -> None:
    file_kb.propositions.save_all(robot_at(RB1, waypoint(number)) for number in range(12_000))
    file_kb.propositions.delete_all()
    assert file_kb.store.push(target).versions == 24_004
    equal_histories(file_url, target)


def test_small_batches_and_large_ones_make_the_same(
    file_url: str, replica_url: str, monkeypatch: pytest.MonkeyPatch, connect: Connect
) -> None:
    monkeypatch.setattr(batch, "FIRST_REVISIONS", 1)
    monkeypatch.setattr(batch, "ROWS", 3)
    write_whole_story(file_url)
    told: list[tuple[int, int]] = []
    kb = connect(file_url, knowledge_base="tiago")
    kb.store.push(replica_url, progress=lambda done, all_: told.append((done, all_)))
    equal_histories(file_url, replica_url)
    assert len(told) > kb.revision // 3
    assert told[-1] == (kb.revision, kb.revision)
    assert told == sorted(told)


def test_a_push_that_is_stopped_ends_after_its_batch(
    file_kb: KnowledgeBase, file_url: str, replica_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch, "FIRST_REVISIONS", 2)
    count(file_kb, 20)
    source = file_kb.store.factory._store.backend  # type: ignore[attr-defined]
    batches = 0

    def is_stopped() -> bool:
        nonlocal batches
        batches += 1
        return batches > 2

    with open_target(replica_url, "tiago", source, "a replica") as to:
        sent = send(ReplicationSide(source, "tiago"), to, Terms(), is_stopped=is_stopped)
    assert (sent.revision, sent.source_revision) == (2 + 4, 20)
    intact(replica_url)
    assert file_kb.store.push(replica_url).before == 6
    equal_histories(file_url, replica_url)


def test_two_pushes_at_once_are_one(
    shared_url: str, target: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch, "FIRST_REVISIONS", 2)
    write_whole_story(shared_url)
    kbs = [connect(shared_url, knowledge_base="tiago") for _ in range(3)]
    with ThreadPoolExecutor(3) as pool:
        sent = list(pool.map(lambda kb: kb.store.push(target), kbs))
    assert {each.revision for each in sent} == {kbs[0].revision}
    equal_histories(shared_url, target)
    intact(target)


def test_the_head_says_where_it_comes_from(shared_url: str, target: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    count(kb, 3)
    kb.store.push(target)
    (row,) = rows_of(target)["head"]
    *_, origin, revision, committed_at, heard_at = row
    last = kb.store.revisions()[-1]
    label = make_url(shared_url).render_as_string(hide_password=True)
    assert (origin, revision, committed_at) == (label, 3, last.committed_at)
    assert heard_at >= last.committed_at


def test_no_password_is_kept(server: Server, replica_url: str, connect: Connect) -> None:
    url = make_url(server.new_store()).set(password="geheim", username="postgres")
    kb = connect(url.render_as_string(hide_password=False), knowledge_base="tiago")
    count(kb, 2)
    kb.store.push(replica_url)
    assert "geheim" not in str(rows_of(replica_url)["head"])
    with (
        connect(replica_url, knowledge_base="tiago") as replica,
        pytest.raises(ReplicaError) as caught,
    ):
        replica.propositions.delete_all()
    assert "***" in str(caught.value)
    assert "geheim" not in str(caught.value)


def test_a_replaced_target_is_opened_again(
    file_kb: KnowledgeBase, file_url: str, tmp_path: Path
) -> None:
    path = tmp_path / "replica.db"
    count(file_kb, 3)
    file_kb.store.push(f"sqlite:///{path}")
    path.unlink()
    assert file_kb.store.push(f"sqlite:///{path}").revisions == 3
    equal_histories(file_url, f"sqlite:///{path}")


def test_a_target_whose_tables_are_gone_is_looked_at_again(
    file_kb: KnowledgeBase, file_url: str, replica_url: str
) -> None:
    count(file_kb, 3)
    file_kb.store.push(replica_url)
    kant_sql.operations.downgrade(replica_url, revision="base")
    count(file_kb, 4)
    assert file_kb.store.push(replica_url).revisions == 4
    equal_histories(file_url, replica_url)


def test_one_that_fails_leaves_the_others_their_connection(
    file_url: str, replica_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch, "FIRST_REVISIONS", 4)
    with kant_sql.open_store(file_url) as store:
        bad, good = store.knowledge_base("bad"), store.knowledge_base("good")
        for kb in (bad, good):
            count(kb, 30)
        damage(file_url, "UPDATE revision SET actor = 'x' WHERE kb_id = 1 AND number = 3")
        failed: list[Exception] = []

        def meanwhile(at: int, upto: int) -> None:
            if not failed:
                with pytest.raises(StoreIntegrityError) as caught:
                    bad.store.push(replica_url)
                failed.append(caught.value)

        assert good.store.push(replica_url, progress=meanwhile).revisions == 30
        assert failed
        (opened,) = _TARGETS[backend_of(good)]._open.values()
        assert not opened.backend.is_closed
    equal_histories(file_url, replica_url, "good")


def test_a_forgotten_target_is_closed_after_its_last_push(
    file_kb: KnowledgeBase, replica_url: str
) -> None:
    count(file_kb, 3)
    file_kb.store.push(replica_url)
    count(file_kb, 4)
    targets = _TARGETS[backend_of(file_kb)]
    (opened,) = targets._open.values()

    def forget(at: int, upto: int) -> None:
        targets.forget(replica_url, opened)
        targets.forget(replica_url, opened)
        assert not opened.backend.is_closed

    file_kb.store.push(replica_url, progress=forget)
    assert opened.backend.is_closed
    count(file_kb, 5)
    file_kb.store.push(replica_url)
    targets.forget(replica_url, opened)
    assert targets.is_open(replica_url)


def test_knowledge_bases_of_one_store_share_the_connection(file_url: str, replica_url: str) -> None:
    with kant_sql.open_store(file_url) as store:
        for name in ("a", "b"):
            with store.knowledge_base(name) as kb:
                count(kb, 3)
                kb.store.push(replica_url)
                count(kb, 4)
                assert kb.store.push(replica_url).revisions == 1
    for name in ("a", "b"):
        equal_histories(file_url, replica_url, name)


def test_closing_closes_the_targets(file_kb: KnowledgeBase, replica_url: str) -> None:
    count(file_kb, 3)
    file_kb.store.push(replica_url)
    (target,) = _TARGETS[backend_of(file_kb)]._open.values()
    file_kb.close()
    assert target.backend.is_closed
    with pytest.raises(ClosedError):
        file_kb.store.push(replica_url)
