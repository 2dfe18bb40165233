"""Branches: a knowledge base that begins with a state of another, and the difference of two."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import (
    ConflictError,
    InvalidArgumentError,
    KnowledgeBase,
    ReadOnlyError,
    UnknownRevisionError,
    aio,
)
from kant_sql.errors import ArchivedError, InvalidUrlError, TransactionOpenError
from kant_sql.store import transaction as transactions
from tests.support.atoms import Atoms
from tests.support.corpus import Pair, needs_corpus, small_pairs
from tests.support.reading import beside, documents, facts, loaded, state, undone
from tests.support.statements import count, fill
from tests.support.stores import Connect
from tests.support.worlds.depot import load, number
from tests.support.worlds.robots import BATTERY, RB1, WP1, WP2, robot_at, waypoint


@pytest.fixture
def depot(kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with something of every kind, and a past."""
    everything(kb)
    return kb


def everything(kb: KnowledgeBase) -> None:
    load(kb)
    loaded(kb, DOMAIN, PROBLEM)
    with kb.transaction(actor="driver", reason="moved"):
        kb.propositions.delete_all()
        kb.objects.save("late - place")


DOMAIN = """
(define (domain Yard)
  (:requirements :adl :fluents :preferences :constraints :derived-predicates :timed-initial-literals
                 :durative-actions :time)
  (:types truck - machine place - object machine)
  (:constants hub - place)
  (:predicates (at ?t - truck ?p - (either place truck)) (idle) (far ?p - place))
  (:functions (fuel ?t - truck) - number (home ?t - truck) - place)
  (:constraints (always (not (idle))))
  (:derived (far ?p - place) (not (= ?p hub)))
  (:action drive :parameters (?t - truck ?a ?b - place)
    :precondition (and (at ?t ?a) (preference full (> (fuel ?t) 3)))
    :effect (and (not (at ?t ?a)) (at ?t ?b) (decrease (fuel ?t) 1.50)))
  (:durative-action wait :parameters (?t - truck) :duration (<= ?duration 5)
    :condition (over all (at ?t hub)) :effect (at end (idle)))
  (:process burn :parameters (?t - truck) :precondition (idle)
    :effect (decrease (fuel ?t) (* #t 0.5)))
  (:event stop :parameters (?t - truck) :precondition (= (fuel ?t) 0) :effect (not (idle))))
"""
PROBLEM = """
(define (problem Tuesday) (:domain Yard)
  (:objects t2 t1 - truck p2 p1 - place)
  (:init (at t1 p1) (at t2 hub) (not (idle)) (= (fuel t1) 7.50) (= (fuel t2) 0) (= (home t1) p2)
         (at 5 (idle)) (at 6.5 (= (fuel t1) 8)))
  (:goal (and (at t2 p1) (at t1 hub) (exists (?t - truck) (at ?t p2))
              (preference calm (not (idle)))))
  (:constraints (and (sometime (at t1 hub)) (preference late (within 5 (idle)))))
  (:metric minimize (+ (fuel t1) (* 2 (is-violated calm)))))
"""


def first(kb: KnowledgeBase) -> kant_sql.Revision:
    return kb.store.revisions(limit=1)[0]


@pytest.fixture
def branch_of() -> Iterator[Callable[..., KnowledgeBase]]:
    made: list[KnowledgeBase] = []

    def branch(kb: KnowledgeBase, *name: str, **options: Any) -> KnowledgeBase:
        made.append(kb.branch(*name, **options))
        return made[-1]

    yield branch
    for kb in made:
        kb.close()


Branch = Callable[..., KnowledgeBase]


def test_a_branch_is_the_state_whole_and_in_order(depot: KnowledgeBase, branch_of: Branch) -> None:
    for revision in range(1, depot.revision + 1):
        past = depot.at(revision)
        for made in (branch_of(depot, at=revision), branch_of(past)):
            assert documents(made) == documents(past)
            assert state(made) == state(past)
            assert made.diff(made, past) == past.diff(past, made) == []
            assert made.store.verify().findings == ()
    made = branch_of(depot)
    assert documents(made) == documents(depot)
    assert "late" in made.problem_pddl()


def test_its_first_revision_says_what_it_is_a_branch_of(
    depot: KnowledgeBase, branch_of: Branch
) -> None:
    for at in (2, None):
        made, number_ = branch_of(depot, at=at), at or depot.revision
        origin = depot.store.revisions(number_ - 1, limit=1)[0]
        assert made.revision == 1
        revision = first(made)
        assert revision.actor == "test"
        assert revision.reason == f"branch of tiago at revision {number_}"
        assert revision.source == {"parent": "tiago", "revision": number_, "hash": origin.hash}


def test_a_time_names_the_state(depot: KnowledgeBase, branch_of: Branch) -> None:
    first_at = depot.store.revisions(limit=1)[0].committed_at
    assert documents(branch_of(depot, at=first_at)) == documents(depot.at(first_at))
    assert branch_of(depot, at=datetime(2000, 1, 1, tzinfo=UTC)).revision == 0


def test_neither_is_changed_by_what_is_written_to_the_other(
    depot: KnowledgeBase, branch_of: Branch
) -> None:
    made = branch_of(depot)
    before, revision = documents(depot), depot.revision
    made.propositions.save(robot_at())
    made.function_values.set("fuel", objects=["t1"], value=number("1").value)
    made.types.delete_all()
    made.load_domain(DOMAIN)
    assert documents(depot) == before
    assert depot.revision == revision
    now = documents(made)
    depot.types.delete_all()
    assert documents(made) == now
    assert made.store.verify().is_intact


def test_new_elements_of_a_branch_come_after_those_it_began_with(
    depot: KnowledgeBase, branch_of: Branch
) -> None:
    made = branch_of(depot)
    for kb in (made, depot):
        kb.propositions.save_all([robot_at(RB1, WP2), robot_at()])
        kb.objects.save(waypoint(7))
    assert documents(made) == documents(depot)


def test_a_name_that_is_back_keeps_its_place(fresh_kb: KnowledgeBase, branch_of: Branch) -> None:
    kb = fresh_kb
    kb.propositions.save_all([robot_at(RB1, WP2), robot_at()])
    kb.propositions.delete_all()
    kb.objects.delete_all()
    kb.propositions.save_all([robot_at(), robot_at(RB1, WP2)])
    kb.function_values.set(BATTERY, objects=[RB1], value=number("7.50").value)
    made = branch_of(kb)
    assert documents(made) == documents(kb)
    assert str(made.function_values.get_all()[0]) == "(= (battery rb1) 7.50)"


def test_a_named_branch_is_in_the_same_store(
    shared_url: str, connect: Connect, branch_of: Branch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    everything(kb)
    made = branch_of(kb, "what if")
    made.propositions.save(robot_at())
    again = connect(shared_url, knowledge_base="what if")
    assert facts(again) == [*facts(kb), "(robot_at rb1 wp1)"]
    assert documents(connect(shared_url, knowledge_base="what if").at(1)) == documents(kb)
    for name in ("what if", "tiago"):
        with pytest.raises(ConflictError, match=f"{name}.*exists.*another name"):
            kb.branch(name)
    assert again.revision == 2


def test_closing_a_named_branch_keeps_it_and_its_parent_open(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    with kb.branch("trial") as trial:
        trial.propositions.save(robot_at(RB1, WP2))
    assert facts(kb) == ["(robot_at rb1 wp1)"]
    assert len(facts(connect(shared_url, knowledge_base="trial"))) == 2


def test_the_name_of_an_empty_knowledge_base_is_free(
    shared_url: str, connect: Connect, branch_of: Branch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    connect(shared_url, knowledge_base="trial")
    with undone(connect(shared_url, knowledge_base="trial")):
        pass
    assert facts(branch_of(kb, "trial")) == facts(kb)


def test_a_scratch_branch_is_in_memory_until_it_is_closed(
    shared_url: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    trial = kb.branch()
    assert trial.store.factory.has_one_connection
    trial.close()
    with pytest.raises(kant_sql.errors.ClosedError):
        trial.propositions.get_all()
    assert facts(kb) == ["(robot_at rb1 wp1)"]


def test_another_store_on_another_dialect(
    shared_url: str, file_url: str, connect: Connect, branch_of: Branch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    everything(kb)
    made = branch_of(kb, url=file_url)
    assert documents(made) == documents(kb)
    back = branch_of(connect(file_url, knowledge_base="tiago"), "back", url=shared_url)
    assert documents(back) == documents(kb)
    assert back.diff(back, kb) == []
    assert back.store.verify().findings == made.store.verify().findings == ()


def test_the_file_is_found_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, branch_of: Branch, connect: Connect
) -> None:
    monkeypatch.chdir(tmp_path)
    kb = connect("sqlite:///robot.db", knowledge_base="tiago")
    kb.propositions.save(robot_at())
    os.mkdir("elsewhere")
    monkeypatch.chdir("elsewhere")
    branch_of(kb, "trial")
    assert os.listdir() == []
    assert facts(connect("sqlite:///../robot.db", knowledge_base="trial")) == facts(kb)


def test_a_branch_of_a_store_in_memory_is_in_another(connect: Connect, branch_of: Branch) -> None:
    kb = connect("sqlite://", knowledge_base="tiago")
    kb.propositions.save(robot_at())
    made = branch_of(kb, "trial")
    made.propositions.delete_all()
    assert facts(branch_of(made, "trial")) == []
    assert facts(kb) == ["(robot_at rb1 wp1)"]


def test_a_branch_of_a_branch(depot: KnowledgeBase, branch_of: Branch) -> None:
    one = branch_of(depot)
    one.propositions.save(robot_at())
    two = branch_of(one, at=1)
    assert documents(two) == documents(depot)
    assert first(two).source == {"parent": "tiago", "revision": 1, "hash": first(one).hash}


def test_an_empty_state_makes_no_revision(fresh_kb: KnowledgeBase, branch_of: Branch) -> None:
    made = branch_of(fresh_kb)
    assert made.revision == 0
    assert documents(made) == documents(fresh_kb)
    made.propositions.save(robot_at())
    assert made.revision == 1


@pytest.mark.more
def test_many_facts_go_over_in_as_many_statements(
    fresh_kb: KnowledgeBase, branch_of: Branch, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(fresh_kb, 10)
    few = count(lambda: branch_of(fresh_kb))
    fresh_kb.propositions.save_all(robot_at(RB1, waypoint(n)) for n in range(3_000))
    assert count(lambda: branch_of(fresh_kb)) == few
    # Above this count they are written early.
    monkeypatch.setattr(transactions, "SPILL_AT", 1_000)
    monkeypatch.setattr("kant_sql.dao.base.BATCH", 700)
    made = branch_of(fresh_kb)
    assert documents(made) == documents(fresh_kb)
    assert made.store.verify().is_intact


def test_what_cannot_be_is_refused(depot: KnowledgeBase) -> None:
    with pytest.raises(UnknownRevisionError, match="99"):
        depot.branch(at=99)
    with pytest.raises(UnknownRevisionError):
        depot.at(1).branch(at=2)
    with pytest.raises(InvalidUrlError):
        depot.branch(url="nowhere")
    with pytest.raises(InvalidArgumentError):
        depot.branch("")
    anything: Any = depot
    with pytest.raises(UnknownRevisionError, match="a revision's number, or an aware time"):
        anything.diff(depot, None)


def test_a_pending_state_has_no_revision_to_name(depot: KnowledgeBase) -> None:
    with depot.transaction():
        for at in (None, 1):
            with pytest.raises((ReadOnlyError, TransactionOpenError), match="end it first"):
                depot.branch(at=at)
    depot.branch().close()


def test_an_archived_state_is_refused(shared_url: str, file_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    kb.propositions.delete(robot_at())
    kb.propositions.save(robot_at(RB1, WP2))
    kb.store.archive(3, to=file_url)
    with pytest.raises(ArchivedError):
        kb.branch(at=1)
    with kb.branch() as trial:
        assert facts(trial) == ["(robot_at rb1 wp2)"]


# The difference of two.


def test_the_difference_is_what_would_turn_one_into_the_other(
    fresh_kb: KnowledgeBase, branch_of: Branch
) -> None:
    kb = fresh_kb
    Atoms(kb).save_all([robot_at(), robot_at(is_goal=True)])
    kb.function_values.set(BATTERY, objects=[RB1], value=5)
    other = branch_of(kb)
    other.propositions.delete(robot_at())
    other.propositions.save(robot_at(RB1, WP2))
    other.function_values.set(BATTERY, objects=[RB1], value=6)
    assert [" ".join(change) for change in kb.diff(kb, other)] == [
        "+ fact (robot_at rb1 wp2)",
        "+ object wp2 - wp",
        "+ value (= (battery rb1) 6)",
        "- fact (robot_at rb1 wp1)",
        "- value (= (battery rb1) 5)",
    ]
    # The same as between two revisions of one, and the other way round.
    assert kb.diff(kb, other) == other.diff(1, other.revision)
    assert other.diff(other, kb) == other.diff(other.revision, 1)
    assert other.diff(other, other.at(1)) == other.diff(other.revision, 1)
    assert kb.diff(kb, kb.at(0)) == kb.diff(kb.revision, 0)
    assert kb.at(0).diff(kb.at(0), kb) == kb.diff(0, kb.revision)


def test_pending_changes_count(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    kb.propositions.save(robot_at())
    with kb.branch() as other, kb.transaction():
        kb.propositions.save(robot_at(RB1, WP2))
        with other.transaction():
            other.objects.save("wp9 - wp")
            assert [" ".join(change) for change in kb.diff(kb, other)] == [
                "+ object wp9 - wp",
                "- fact (robot_at rb1 wp2)",
                "- object wp2 - wp",
            ]


def test_of_two_stores_that_were_written_apart(
    shared_url: str, connect: Connect, depot: KnowledgeBase
) -> None:
    kb = connect(shared_url, knowledge_base="another")
    everything(kb)
    assert kb.diff(kb, depot) == []
    kb.propositions.save(robot_at(RB1, WP1))
    assert {change.sign for change in kb.diff(kb, depot)} == {"-"}
    assert kb.diff(beside(kb, "empty"), kb) == kb.diff(0, kb.revision)


def test_it_takes_one_statement_each(fresh_kb: KnowledgeBase) -> None:
    fill(fresh_kb, 50)
    other = beside(fresh_kb, f"{fresh_kb.store.factory._store.name} other")  # type: ignore[attr-defined]
    fill(other, 20)
    fresh_kb.diff(fresh_kb, other)
    assert count(lambda: fresh_kb.diff(fresh_kb, other)) <= 4


async def test_the_asynchronous_front_door_branches_compares_and_merges(url: str) -> None:
    async with aio.connect(url, knowledge_base="tiago", actor="test") as kb:
        await kb.propositions.save(robot_at())
        async with kb.branch() as trial:
            await trial.propositions.save(robot_at(RB1, WP2))
            changes = await kb.diff(kb, trial)
            assert [" ".join(change) for change in changes] == [
                "+ fact (robot_at rb1 wp2)",
                "+ object wp2 - wp",
            ]
            assert len((await kb.merge_preview(trial)).changes) == 2
            assert (await kb.merge(trial, expected_revision=1)).revision == 2
        assert await kb.holds("(robot_at rb1 wp2)")
        past = await kb.at(0)
        trial = await past.branch()
        assert await trial.revision() == 0
        assert len(await trial.diff(trial, kb)) == 8
        await trial.close()
        async with kb.transaction():
            with pytest.raises(ReadOnlyError, match="end it first"):
                await kb.branch()


@needs_corpus
@pytest.mark.parametrize("pair", small_pairs(8_000)[::12], ids=lambda pair: pair.name)
@pytest.mark.more
def test_competition_problems_go_over_whole(
    pair: Pair, connect: Connect, branch_of: Branch
) -> None:
    kb = connect("sqlite://")
    kb.load_domain(pair.domain)
    kb.load_problem(pair.problem)
    assert documents(branch_of(kb)) == documents(kb)
