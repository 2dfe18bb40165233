"""Merging a branch: what it takes over, what it refuses, and what the revision says of it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

import kant_sql
from kant_sql import (
    ConflictError,
    InvalidArgumentError,
    KnowledgeBase,
    Merge,
    ReadOnlyError,
    StaleRevisionError,
)
from kant_sql.errors import MergeConflictError, ReplicaError, RuleViolatedError, TypeCycleError
from kant_sql.history.merge import _Merging
from kant_sql.history.merged import Decision
from kant_sql.knowledge_base import state_of
from tests.contract.test_reasoning_branch import Branch, branch_of, everything
from tests.support.parts import dao_of
from tests.support.reading import documents, facts, loaded, present, store_of
from tests.support.statements import count
from tests.support.stores import Connect

__all__ = ["branch_of"]

DOMAIN = """(define (domain rooms)
  (:types robot place - object hall - place)
  (:predicates (at ?r - robot ?p - place) (open ?p - place) (idle))
  (:functions (battery ?r - robot) - number (home ?r - robot) - place))"""
PROBLEM = """(define (problem monday) (:domain rooms)
  (:objects rb1 rb2 - robot p1 p2 p3 - place)
  (:init (at rb1 p1) (open p2) (= (battery rb1) 50) (= (home rb1) p1)) (:goal (open p1)))"""


@pytest.fixture
def rooms(kb: KnowledgeBase) -> KnowledgeBase:
    return loaded(kb, DOMAIN, PROBLEM)


def elements(found: Merge) -> list[str]:
    return [each.element for each in found.conflicts]


def lines(found: Merge) -> list[str]:
    return [" ".join(change) for change in found.changes]


def refused(kb: KnowledgeBase, branch: KnowledgeBase, **options: Any) -> MergeConflictError:
    """Merge, and expect that conflicts refuse it and leave nothing."""
    before = kb.revision
    with pytest.raises(MergeConflictError) as caught:
        kb.merge(branch, **options)
    assert kb.revision == before
    return caught.value


def test_of_an_unchanged_original_it_makes_the_branch(kb: KnowledgeBase, branch_of: Branch) -> None:
    everything(kb)
    trial = branch_of(kb)
    trial.load_domain("""(define (domain Yard) (:requirements :adl :fluents :durative-actions)
      (:types truck place - object van - truck)
      (:constants base - place)
      (:predicates (at ?t - truck ?p - place) (far ?p - place) (loaded ?t - van))
      (:functions (fuel ?t - truck) - number (base ?t - truck) - place)
      (:derived (far ?p - place) (forall (?t - truck) (not (at ?t ?p))))
      (:action load :parameters (?v - van) :precondition (at ?v base) :effect (loaded ?v))
      (:event stop :parameters (?t - truck) :precondition (= (fuel ?t) 1)
        :effect (assign (base ?t) base)))""")
    trial.load_problem("""(define (problem Friday) (:domain Yard)
      (:objects v1 - van t1 - truck p9 p1 - place)
      (:init (at v1 p9) (not (loaded v1)) (= (fuel t1) 2.50) (= (base v1) p1) (at 3 (loaded v1)))
      (:goal (and (loaded v1) (exists (?t - truck) (at ?t p9))))
      (:constraints (sometime (at v1 p1))) (:metric maximize (fuel t1)))""")
    trial.rules.save("one", "(forall (?t - truck) (at-most-one (?p - place) (at ?t ?p)))")
    found = kb.merge_preview(trial)
    assert found.conflicts == ()
    assert found.refused is None
    assert kb.merge(trial).changes == found.changes
    assert kb.diff(kb, trial) == []
    assert documents(kb) == documents(trial)
    assert kb.store.verify().is_intact


def test_an_unchanged_branch_makes_no_revision(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    rooms.propositions.save("(open p3)")
    found = rooms.merge(trial)
    assert (found.revision, found.changes, found.conflicts) == (None, (), ())
    assert rooms.revision == 3


def test_the_revision_names_both_parents(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms, "trial", url="sqlite://")
    trial.propositions.save("(open p1)")
    rooms.propositions.save("(open p3)")
    last = trial.store.revisions()[-1]
    made = rooms.merge(trial, actor="planner")
    assert (made.base, made.head, made.revision) == (2, 3, 4)
    revision = rooms.store.revisions()[-1]
    assert (revision.actor, revision.reason) == ("planner", "merged trial at revision 2")
    assert revision.source == {"base": 2, "branch": "trial", "revision": 2, "hash": last.hash}
    assert facts(rooms) == ["(at rb1 p1)", "(open p1)", "(open p2)", "(open p3)"]


def test_a_second_merge_brings_only_what_is_newer(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    trial.function_values.set("battery", objects=["rb1"], value=40)
    trial.propositions.save("(open p1)")
    first = rooms.merge(trial)
    assert rooms.merge(trial).revision is None
    # What was merged may change here without a conflict.
    rooms.propositions.delete("(open p1)")
    trial.function_values.set("battery", objects=["rb1"], value=30)
    second = rooms.merge(trial, reason="again")
    assert second.base == first.revision
    assert lines(second) == ["+ value (= (battery rb1) 30)", "- value (= (battery rb1) 40)"]
    assert "(open p1)" not in facts(rooms)


def test_conflicts_say_who_when_and_why_on_both_sides(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    with trial.transaction(actor="planner", reason="shorter"):
        trial.function_values.set("battery", objects=["rb1"], value=30)
        trial.propositions.delete("(open p2)")
        trial.propositions.save("(open p1)")
    with rooms.transaction(actor="driver", reason="drove"):
        rooms.function_values.set("battery", objects=["rb1"], value=40)
    rooms.propositions.delete("(open p2)")
    rooms.propositions.save("(open p2)")
    error = refused(rooms, trial)
    assert [each.element for each in error.conflicts] == ["fact (open p2)", "value (battery rb1)"]
    fact, value = error.conflicts
    found = value.base, value.ours.text, value.theirs.text
    assert found == tuple(f"(= (battery rb1) {number})" for number in (50, 40, 30))
    assert value.ours.revision.said() == ["driver", "drove"]
    assert value.theirs.revision.said() == ["planner", "shorter"]
    assert (fact.ours.text, fact.theirs.text) == ("(open p2)", None)
    assert fact.ours.revision.number == 5
    assert "here (= (battery rb1) 40) (revision 3, driver, drove)" in str(error)
    assert elements(rooms.merge_preview(trial)) == elements(error)  # type: ignore[arg-type]
    made = rooms.merge(trial, decide={"(BATTERY rb1)": "theirs", "fact (open p2)": "ours"})
    assert [each.decided for each in made.conflicts] == ["ours", "theirs"]
    assert facts(rooms) == ["(at rb1 p1)", "(open p1)", "(open p2)"]
    assert rooms.function_values.get("battery", objects=["rb1"]) == 30


def test_what_both_changed_alike_is_no_conflict(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    for kb, value in ((rooms, "7.0"), (trial, "7")):
        kb.load_problem(
            PROBLEM.replace(") 50)", f") {value})").replace("p3 -", "p3 p4 -"), mode="replace"
        )
        kb.goals.save("(or (open p1) (open p4))")
        kb.pddl.metric.set("(:metric minimize (battery rb1))")
    found = rooms.merge(trial)
    assert (found.revision, found.changes, found.conflicts) == (None, (), ())


Change = Callable[[KnowledgeBase], object]


def saves(name: str, ours: str, theirs: str, element: str) -> tuple[Change, Change, str]:
    """Save one text with the DAO of a name here, and another one there."""
    return lambda kb: dao_of(kb, name).save(ours), lambda kb: dao_of(kb, name).save(theirs), element


GO = "(:action go :parameters (?r - robot) :effect (at ?r {}))"
BOTH: dict[str, tuple[Change, Change, str]] = {
    "metric": (
        lambda kb: kb.pddl.metric.set("(:metric minimize (battery rb1))"),
        lambda kb: kb.pddl.metric.set("(:metric maximize (battery rb1))"),
        "metric",
    ),
    "action": saves("actions", GO.format("p1"), GO.format("p2"), "action go"),
    "predicate": saves(
        "predicates", "(new ?r - robot)", "(new ?r - robot ?p - place)", "predicate new"
    ),
    "type": saves("types", "dock - place", "dock - robot", "type dock"),
    "object": saves("objects", "x - robot", "x - hall", "object x"),
    "rule": (
        lambda kb: kb.rules.save("calm", "(always (not (idle)))"),
        lambda kb: kb.rules.save("calm", "(sometime (idle))"),
        "rule calm",
    ),
    "document": (
        lambda kb: kb.load_problem(PROBLEM.replace("monday", "tuesday")),
        lambda kb: kb.load_problem(PROBLEM.replace("monday", "friday")),
        "document problem",
    ),
    "goal": (
        lambda kb: (kb.goals.delete_all(), kb.goals.save("(open p1)")),
        lambda kb: kb.goals.delete_all(),
        "goal (open p1)",
    ),
    "object value": (
        lambda kb: kb.function_values.set("home", objects=["rb1"], value="p2"),
        lambda kb: kb.function_values.set("home", objects=["rb1"], value="p3"),
        "value (home rb1)",
    ),
    "timed": (
        lambda kb: _twice(kb, "(at 5 (idle))"),
        lambda kb: kb.pddl.timed_initial_literals.delete_all(),
        "timed (at 5 (idle))",
    ),
}


def _twice(kb: KnowledgeBase, text: str) -> None:
    kb.pddl.timed_initial_literals.delete_all()
    kb.pddl.timed_initial_literals.save(text)


@pytest.mark.parametrize("kind", BOTH)
def test_an_element_that_both_redefine_is_decided(
    rooms: KnowledgeBase, branch_of: Branch, kind: str
) -> None:
    here, there, element = BOTH[kind]
    rooms.pddl.timed_initial_literals.save("(at 5 (idle))")
    trial = branch_of(rooms)
    here(rooms)
    there(trial)
    assert elements(rooms.merge_preview(trial)) == [element]
    other = branch_of(rooms)
    assert rooms.merge(trial, decide={element: "ours"}).revision is None
    assert rooms.diff(rooms, other) == []
    assert rooms.merge(trial, decide={element: "theirs"}).revision == rooms.revision
    assert rooms.diff(rooms, trial) == []
    assert documents(rooms) == documents(trial)
    assert rooms.store.verify().is_intact


def test_what_one_deletes_and_the_other_uses(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    trial.objects.delete("p3")
    with rooms.transaction(actor="mapper"):
        rooms.propositions.save("(open p3)")
        rooms.function_values.set("home", objects=["rb2"], value="p3")
    (conflict,) = refused(rooms, trial).conflicts
    assert (conflict.element, conflict.theirs.text) == ("object p3", None)
    assert conflict.ours.used_by == ("fact (open p3)", "value (home rb2)")
    assert conflict.theirs.revision is not None
    assert conflict.ours.revision is None
    kept = rooms.merge_preview(trial, decide={"object p3": "ours"})
    assert (kept.changes, kept.refused) == ((), None)
    gone = rooms.merge(trial, decide={"object p3": "theirs"})
    assert lines(gone) == ["- fact (open p3)", "- object p3 - place", "- value (= (home rb2) p3)"]
    assert rooms.diff(rooms, trial) == []
    assert rooms.store.verify().is_intact


def test_what_is_deleted_here_and_used_there_goes_with_what_uses_it(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    trial.objects.save("h1 - hall")
    trial.propositions.save("(open h1)")
    trial.propositions.save("(idle)")
    rooms.types.delete("hall")
    (conflict,) = refused(rooms, trial).conflicts
    assert (conflict.element, conflict.theirs.used_by) == ("type hall", ("object h1",))
    assert lines(rooms.merge_preview(trial, decide={"type hall": "ours"})) == ["+ fact (idle)"]
    made = rooms.merge(trial, decide={"type hall": "theirs"})
    assert "+ type hall - place" in lines(made)
    assert "(open h1)" in facts(rooms)
    assert rooms.store.verify().is_intact


def test_decisions_must_fit(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    trial.propositions.delete("(open p2)")
    trial.goals.delete_all()
    trial.objects.delete("p2")
    rooms.propositions.delete("(open p2)")
    rooms.propositions.save("(open p2)")
    wrong: list[tuple[Any, str]] = [
        (
            {"fact (open p9)": "ours"},
            "is not a conflict of this merge; the conflicts are: 'fact (open p2)'",
        ),
        ({"fact (open p2)": "mine"}, "is decided as 'mine'"),
        (["fact (open p2)"], "decide is a mapping"),
        ({"fact (open p2)": "ours", "object p2": "theirs"}, "decide both alike"),
    ]
    for decide, message in wrong:
        with pytest.raises(InvalidArgumentError, match=re.escape(message)):
            rooms.merge(trial, decide=decide)
    error = refused(rooms, trial, decide={"fact (open p2)": "ours"})
    assert [each.decided for each in error.conflicts] == ["ours", None]
    assert "1 open conflict: " in str(error)
    assert "object p2" in str(error)
    # One name, two conflicts: which is meant has to be said.
    for of_kind in (rooms.goals, rooms.propositions):
        of_kind.delete_all()
        of_kind.save("(open p1)")
    rooms.propositions.delete("(open p1)")
    trial.propositions.save("(open p1)")
    with pytest.raises(InvalidArgumentError, match="is in several conflicts"):
        rooms.merge(trial, decide={"(open p1)": "ours"})


def test_what_no_longer_fits_is_refused_by_name(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    rooms.objects.save("h1 - hall")
    rooms.propositions.save("(open h1)")
    rooms.actions.save("(:action air :parameters (?h - hall) :effect (open ?h))")
    rooms.rules.save("aired", "(forall (?h - hall) (always (open ?h)))")
    rooms.goals.save("(exists (?h - hall) (open ?h))")
    trial.types.save("hall - robot", cascade=True)
    found = rooms.merge_preview(trial)
    assert found.conflicts == ()
    assert found.refused is not None
    for what in ("fact (open h1)", "action air", "rule aired", "goal (exists"):
        assert what in found.refused
    with pytest.raises(ConflictError, match="do not fit"):
        rooms.merge(trial)
    rooms.types.save("hut - hall")
    other = branch_of(rooms)
    rooms.types.save("shed - hut")
    other.types.save("house - object")
    other.types.save("hall - house", cascade=True)
    rooms.types.save("house - shed")
    assert elements(rooms.merge_preview(other)) == ["type house"]
    with pytest.raises(TypeCycleError, match="its own ancestor"):
        rooms.merge(other, decide={"type house": "ours"})


def test_two_who_were_erased_are_not_taken_for_one(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    erased = rooms.erase("rb1", reason="sold"), trial.erase("p3", reason="private")
    assert erased[0].pseudonym == erased[1].pseudonym == "erased-1"
    trial.propositions.save("(open p2)")
    trial.propositions.save("(open p1)")
    assert lines(rooms.merge(trial)) == ["+ fact (open p1)"]
    trial.propositions.save("(open erased-1)")
    said = present(rooms.merge_preview(trial).refused)
    with pytest.raises(
        ConflictError, match="names an object that was erased in the branch"
    ) as caught:
        rooms.merge(trial)
    assert str(caught.value) == said
    trial.propositions.delete("(open erased-1)")
    assert rooms.merge(trial).revision is None


ONE_PLACE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"


def move(kb: KnowledgeBase, robot: str, place: str, reason: str) -> None:
    """Have a robot at one place."""
    with kb.transaction(actor=f"of {robot}", reason=reason):
        for fact in facts(kb):
            if fact.startswith(f"(at {robot} "):
                kb.propositions.delete(fact)
        kb.propositions.save(f"(at {robot} {place})")


def test_a_rule_that_both_break_together_is_a_conflict(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    rooms.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    trial = branch_of(rooms)
    for robot in ("rb1", "rb2"):
        move(rooms, robot, "p2", "seen")
        move(trial, robot, "p3", "planned")
    trial.propositions.save("(idle)")
    found = rooms.merge_preview(trial)
    names = [f"rule one-place (at-most-one (?p - place) (at {each} ?p))" for each in ("rb1", "rb2")]
    assert elements(found) == names
    assert (lines(found), found.refused) == (["+ fact (idle)"], None)
    [one, _] = found.conflicts
    assert (one.ours.text, one.theirs.text) == ("(at rb1 p2)", "(at rb1 p3)")
    ours, theirs = one.ours.revision, one.theirs.revision
    assert ours is not None
    assert theirs is not None
    assert (ours.actor, ours.reason, theirs.reason) == ("of rb1", "seen", "planned")
    assert refused(rooms, trial).conflicts == found.conflicts
    error = refused(rooms, trial, decide={names[0]: "theirs"})
    assert [one.decided for one in error.conflicts] == ["theirs", None]
    assert rooms.merge(trial, decide={names[0]: "theirs", names[1]: "ours"}).revision
    assert facts(rooms) == ["(at rb1 p3)", "(at rb2 p2)", "(idle)", "(open p2)"]
    assert elements(rooms.merge_preview(trial)) == []


@pytest.mark.parametrize("side", ["ours", "theirs"])
def test_a_rule_is_decided_with_other_conflicts(
    rooms: KnowledgeBase, branch_of: Branch, side: Decision
) -> None:
    rooms.rules.save("idle", "(always (imply (idle) (> (battery rb1) 20)))", on_violation="refuse")
    trial = branch_of(rooms)
    rooms.function_values.set("battery", objects=["rb1"], value=10)
    trial.propositions.save("(idle)")
    for kb, text in ((rooms, "rb1"), (trial, "rb2")):
        kb.pddl.metric.set(f"(:metric maximize (battery {text}))")
    name = "rule idle (always (imply (idle) (> (battery rb1) 20)))"
    assert elements(rooms.merge_preview(trial)) == ["metric", name]
    error = refused(rooms, trial, decide={name: side})
    assert error.conflicts == rooms.merge_preview(trial, decide={name: side}).conflicts
    rooms.merge(trial, decide={name: side, "metric": "theirs"})
    value = rooms.function_values.get("battery", objects=["rb1"])
    assert rooms.holds("(idle)") == (side == "theirs")
    assert value == (10 if side == "ours" else 50)


def test_a_rule_of_one_side_is_left_out_or_what_the_other_did_undone(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    rule = "(forall (?p - place) (always (imply (open ?p) (not (idle)))))"
    trial.rules.save("Closed", rule, on_violation="refuse")
    rooms.propositions.save("(idle)")
    [one] = rooms.merge_preview(trial).conflicts
    assert one.element == "rule Closed (always (imply (open p2) (not (idle))))"
    assert one.ours.text == "(idle)"
    assert "refuse" in str(one.theirs.text)
    made = rooms.merge_preview(trial, decide={one.element: "ours"})
    assert (made.changes, made.refused) == ((), None)
    rooms.merge(trial, decide={one.element: "theirs"})
    assert not rooms.holds("(idle)")
    assert [each.name for each in rooms.rules.get_all()] == ["Closed"]


def test_a_rule_stays_that_is_newer_than_the_branch(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    rooms.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    move(rooms, "rb1", "p2", "seen")
    move(trial, "rb1", "p3", "planned")
    [one] = rooms.merge_preview(trial).conflicts
    assert (one.ours.text, one.theirs.text) == ("(at rb1 p2)", "(at rb1 p3)")
    rooms.merge(trial, decide={one.element: "theirs"})
    assert facts(rooms) == ["(at rb1 p3)", "(open p2)"]
    assert [each.name for each in rooms.rules.get_all()] == ["one-place"]


def test_decisions_that_break_a_rule_are_refused(rooms: KnowledgeBase, branch_of: Branch) -> None:
    exactly = "(exactly-one (?p - place) (at rb1 ?p))"
    rooms.rules.save("at-one", exactly, on_violation="refuse")
    closed = "(always (imply (open p1) (at rb1 p2)))"
    rooms.rules.save("closed", closed, on_violation="refuse")
    trial = branch_of(rooms)
    move(rooms, "rb1", "p2", "seen")
    rooms.propositions.save("(open p1)")
    move(trial, "rb1", "p3", "planned")
    decide: dict[str, Decision] = {f"rule at-one {exactly}": "theirs"}
    found = rooms.merge_preview(trial, decide=decide)
    assert elements(found) == [*decide, f"rule closed {closed}"]
    decide[f"rule closed {closed}"] = "ours"
    said = present(rooms.merge_preview(trial, decide=decide).refused)
    with pytest.raises(RuleViolatedError, match="at-one") as caught:
        rooms.merge(trial, decide=decide)
    assert str(caught.value) == said
    with pytest.raises(InvalidArgumentError, match="is not a conflict of this merge"):
        rooms.merge(trial, decide={**decide, "rule other": "ours"})
    rooms.merge(trial, decide=dict.fromkeys(decide, "theirs"))
    assert facts(rooms) == ["(at rb1 p3)", "(open p2)"]


def test_only_a_branch_of_this_one_is_merged(
    rooms: KnowledgeBase, branch_of: Branch, connect: Connect
) -> None:
    trial = branch_of(rooms)
    stranger = connect("sqlite://", knowledge_base="tiago")
    for other in (stranger, rooms, branch_of(trial, "below", url="sqlite://")):
        if other is not rooms:
            with other.transaction(source={"file": "free.pddl"}):
                other.predicates.save("(free)")
        with pytest.raises(ConflictError, match=r"is not a branch of 'tiago': .*kb\.diff"):
            rooms.merge(other)
    with pytest.raises(ConflictError, match="names no knowledge base that it is of"):
        rooms.merge(stranger)
    # Of the same name and revision, with another history.
    with pytest.raises(ConflictError, match="is not in this history"):
        stranger.merge(trial)
    with rooms.transaction(), pytest.raises(ReadOnlyError, match="transaction open"):
        rooms.merge(trial)
    with pytest.raises(ReadOnlyError):
        rooms.at(1).merge(trial)


def test_a_past_state_of_a_branch_and_a_branch_of_a_past_state(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms, at=1)
    trial.objects.save("z - place")
    trial.propositions.save("(open z)")
    assert lines(rooms.merge(trial.at(2))) == ["+ object z - place"]
    made = rooms.merge(trial)
    assert (lines(made), made.branch_revision) == (["+ fact (open z)"], 3)


def test_another_writer_in_between(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    trial.function_values.set("battery", objects=["rb1"], value=30)
    found = rooms.merge_preview(trial)
    rooms.function_values.set("battery", objects=["rb1"], value=45)
    with pytest.raises(StaleRevisionError):
        rooms.merge(trial, expected_revision=found.head)
    with pytest.raises(InvalidArgumentError, match="expected_revision is a whole number"):
        rooms.merge(trial, expected_revision="4")  # type: ignore[arg-type]
    # It is compared where the head is locked.
    merging = _Merging(state_of(rooms), state_of(trial), {"(battery rb1)": "theirs"})
    rooms.propositions.save("(open p3)")
    with store_of(rooms).transaction() as transaction:
        assert merging.write(transaction).made.head == 4
    merging = _Merging(state_of(rooms), state_of(trial), {"(battery rb1)": "theirs"})
    assert rooms.merge(trial).revision is None
    other = branch_of(rooms)
    other.propositions.save("(open p1)")
    merging = _Merging(state_of(rooms), state_of(other), None)
    rooms.merge(other)
    with (
        pytest.raises(StaleRevisionError, match="merged just now"),
        store_of(rooms).transaction() as transaction,
    ):
        merging.write(transaction)


def test_the_statements_do_not_grow_with_rows(rooms: KnowledgeBase, branch_of: Branch) -> None:
    counts = []
    for size in (3, 40, 90):
        trial = branch_of(rooms)
        names = [f"s{size}x{number}" for number in range(size)]
        for kb in (rooms, trial):
            with kb.transaction():
                kb.objects.save([f"{name} - place" for name in names])
                kb.propositions.save([f"(at rb1 {name})" for name in names])
                for name in names:
                    kb.function_values.set("battery", objects=["rb1"], value=len(name))
        with trial.transaction():
            for name in names:
                trial.propositions.delete(f"(at rb1 {name})")
            trial.propositions.save([f"(open {name})" for name in names])
            trial.objects.save([f"t{name} - robot" for name in names])
            trial.function_values.set("home", objects=["rb1"], value=names[0])
            trial.actions.save("(:action go :parameters (?p - place) :effect (open ?p))")
        with trial.transaction(valid_from="2 minutes ago", valid_until="1 minute ago"):
            trial.propositions.delete_all([f"(at rb1 {name})" for name in names])
            trial.propositions.save([f"(open {name})" for name in names])
        with rooms.transaction():
            for name in names:
                rooms.propositions.delete(f"(at rb1 {name})")
        rooms.propositions.save([f"(at rb1 {name})" for name in names])
        decide: dict[str, Decision] = {f"fact (at rb1 {name})": "ours" for name in names}
        counts.append(count(partial(rooms.merge_preview, trial, decide=decide)))
        counts.append(count(partial(rooms.merge, trial, decide=decide)))
    # The first ones read what later ones know, and PostgreSQL copies from some rows on.
    assert counts[2:4] == counts[4:]
    assert max(counts) < 60


def test_a_replica_has_the_merge_and_takes_none(
    rooms: KnowledgeBase, branch_of: Branch, connect: Connect, tmp_path: Any
) -> None:
    trial = branch_of(rooms)
    trial.propositions.save("(open p1)")
    rooms.merge(trial)
    url = f"sqlite:///{tmp_path}/replica.db"
    rooms.store.push(url)
    replica = connect(url, knowledge_base="tiago")
    assert replica.diff(rooms, replica) == []
    assert replica.store.revisions()[-1].source == rooms.store.revisions()[-1].source
    trial.propositions.save("(open p3)")
    assert lines(replica.merge_preview(trial)) == ["+ fact (open p3)"]
    with pytest.raises(ReplicaError):
        replica.merge(trial)
    replica.store.promote()
    assert replica.merge(trial).revision == replica.revision
    assert replica.store.verify().is_intact


def test_read_only_it_previews_the_same(
    shared_url: str, connect: Connect, branch_of: Branch
) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    loaded(kb, DOMAIN, PROBLEM)
    exactly = "(exactly-one (?p - place) (at rb1 ?p))"
    kb.rules.save("at-one", exactly, on_violation="refuse")
    closed = "(always (imply (open p1) (at rb1 p2)))"
    kb.rules.save("closed", closed, on_violation="refuse")
    trial = branch_of(kb)
    move(kb, "rb1", "p2", "seen")
    kb.propositions.save("(open p1)")
    move(trial, "rb1", "p3", "planned")
    reader = kant_sql.connect(shared_url, knowledge_base="tiago", read_only=True)
    decide: dict[str, Decision] = {}
    for side in (f"rule at-one {exactly}", f"rule closed {closed}"):
        found = reader.merge_preview(trial, decide=decide)
        assert found == kb.merge_preview(trial, decide=decide)
        assert side in elements(found)
        decide[side] = "ours" if decide else "theirs"
    found = reader.merge_preview(trial, decide=decide)
    assert "at-one" in present(found.refused)
    assert found == kb.merge_preview(trial, decide=decide)
    with pytest.raises(InvalidArgumentError, match="nothing"):
        reader.merge_preview(trial, decide={"nothing": "ours"})
    with pytest.raises(ReadOnlyError):
        reader.merge(trial)
    reader.close()
