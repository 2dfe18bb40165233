"""A replica refuses local writes until it is promoted; whatever reads goes on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto, aio
from kant_sql.errors import DivergedError, ReplicaError, StoreIntegrityError
from tests.support.archives import count, equal_histories, intact, rows_of, target_url
from tests.support.faults import change
from tests.support.statements import READS, recorded
from tests.support.stores import Connect
from tests.support.worlds import counter
from tests.support.worlds.robots import RB1, robot_at

Write = Callable[[KnowledgeBase], Any]

DOMAIN = "(define (domain d) (:predicates (p)))"


def _block(kb: KnowledgeBase) -> None:
    with kb.transaction(reason="why"):
        kb.propositions.save(robot_at())


WRITES: dict[str, Write] = {
    "a save": lambda kb: kb.propositions.save(robot_at()),
    "an insert": lambda kb: kb.objects.insert(PddlObjectDto(RB1.type, "rb9")),
    "a delete": lambda kb: kb.propositions.delete_all(),
    "bulk": lambda kb: kb.propositions.save_all([robot_at()]),
    "a block": _block,
    "a type": lambda kb: kb.types.save(PddlTypeDto("tool")),
    "a domain": lambda kb: kb.load_domain(DOMAIN),
    "a problem": lambda kb: kb.load_problem("(define (problem p) (:domain d) (:init))"),
    "a restore": lambda kb: kb.restore(1),
    "a plan": lambda kb: kb.plans.record(kant_sql.Plan((), "engine", "solved")),
    "an archive": lambda kb: kb.store.archive(4, to=f"{kb.url}.archive"),  # type: ignore[attr-defined]
}


@pytest.fixture
def replica(
    shared_url: str, replica_url: str, connect: Connect, request: pytest.FixtureRequest
) -> KnowledgeBase:
    """A replica with five revisions, on each backend."""
    with connect(replica_url, knowledge_base="tiago", actor="robot") as origin:
        count(origin, 4)
        origin.propositions.save(robot_at())
        origin.store.push(shared_url)
    kb = connect(shared_url, knowledge_base="tiago", actor="server")
    kb.url = target_url(Path(replica_url.removeprefix("sqlite:///")).parent, "x")  # type: ignore[attr-defined]
    return kb


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES)
def test_every_local_write_is_refused(
    replica: KnowledgeBase, shared_url: str, replica_url: str, write: Write
) -> None:
    before = rows_of(shared_url)
    with pytest.raises(ReplicaError, match=r"replica of the one in .*promote") as caught:
        write(replica)
    assert replica_url in str(caught.value)
    assert rows_of(shared_url) == before


def test_reads_go_on(replica: KnowledgeBase, shared_url: str, replica_url: str) -> None:
    for read in READS.values():
        read(replica)
    assert counter.read(replica.at(3)) == 2
    assert replica.store.verify().is_intact
    with kant_sql.connect(shared_url, knowledge_base="tiago", read_only=True) as reader:
        assert reader.problem_pddl() == replica.problem_pddl()
    with kant_sql.connect(replica_url, knowledge_base="tiago") as origin:
        assert replica.problem_pddl() == origin.problem_pddl()


def test_a_reader_sees_what_is_pushed_meanwhile(
    replica: KnowledgeBase, shared_url: str, replica_url: str
) -> None:
    assert counter.read(replica) == 3
    assert replica.objects.get("rb7") is None
    with kant_sql.connect(replica_url, knowledge_base="tiago") as origin:
        origin.objects.save(PddlObjectDto(RB1.type, "rb7"))
        counter.increment(origin, 2)
        origin.store.push(shared_url)
    assert counter.read(replica) == 5
    assert replica.objects.get("rb7") is not None


def test_watching_a_replica(replica: KnowledgeBase, shared_url: str, replica_url: str) -> None:
    with kant_sql.connect(replica_url, knowledge_base="tiago") as origin:
        counter.increment(origin, 1)
        origin.store.push(shared_url)
    assert replica.watch(5, timeout=10) == 6


def test_a_promoted_replica_goes_on_by_itself(
    replica: KnowledgeBase, shared_url: str, replica_url: str
) -> None:
    assert replica.store.promote(reason="the robot is lost", actor="operator") == 6
    entry = next(replica.log())
    (change,) = entry.changes
    assert (entry.revision.actor, entry.revision.reason) == ("operator", "the robot is lost")
    assert (change.sign, change.kind) == ("+", "promotion")
    assert f':upto 5 :from "{replica_url}"' in change.text
    counter.increment(replica, 1)
    assert replica.revision == 7
    assert replica.store.promote() is None
    intact(shared_url)
    with kant_sql.connect(replica_url, knowledge_base="tiago") as origin:
        with pytest.raises(ReplicaError, match="ahead of 5"):
            origin.store.push(shared_url)
        counter.increment(origin, 1)
        with pytest.raises(DivergedError, match="differs is 6"):
            origin.store.push(shared_url, adopt=True)


def test_a_promoted_one_is_pushed_like_any_other(
    replica: KnowledgeBase, shared_url: str, tmp_path: Path
) -> None:
    replica.store.promote()
    counter.increment(replica, 1)
    other = target_url(tmp_path, "other.db")
    replica.store.push(other)
    equal_histories(shared_url, other)
    intact(other)


def test_only_a_replica_can_be_promoted(kb: KnowledgeBase) -> None:
    assert kb.store.promote() is None
    counter.start(kb)
    assert kb.store.promote() is None
    assert kb.revision == 1


def test_a_write_costs_no_statement_more(file_kb: KnowledgeBase) -> None:
    file_kb.propositions.save(robot_at())
    file_kb.propositions.delete(robot_at())
    with recorded() as statements:
        file_kb.propositions.save(robot_at())
    assert len(statements) == 4


async def test_tasks_push_and_promote(file_url: str, replica_url: str) -> None:
    async with aio.connect(file_url, knowledge_base="tiago") as kb:
        await kb.propositions.save(robot_at())
        assert (await kb.store.push(replica_url)).revisions == 1
    async with aio.connect(replica_url, knowledge_base="tiago") as replica:
        with pytest.raises(ReplicaError):
            await replica.propositions.delete_all()
        assert await replica.store.promote() == 2


def test_an_altered_head_is_not_promoted(replica: KnowledgeBase, shared_url: str) -> None:
    change(shared_url, "UPDATE head SET revision = 999")
    with pytest.raises(StoreIntegrityError, match="'tiago' has revision 999, which is missing"):
        replica.store.promote()
    change(shared_url, "UPDATE head SET revision = 5")
    assert replica.store.promote() == 6
