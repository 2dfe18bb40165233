"""What a fact led to, and what it goes back to, on every backend."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from kant_sql import KnowledgeBase, Plan, PlanStep
from kant_sql.errors import InvalidArgumentError, InvalidKnowledgeError, UnknownNameError
from kant_sql.sql import causes
from tests.support.reading import loaded, present, store_of
from tests.support.statements import count

DOMAIN = """
(define (domain ward)
  (:requirements :typing :durative-actions :derived-predicates :fluents :adl)
  (:types robot place)
  (:predicates (at ?r - robot ?p - place) (door ?a ?b - place) (way ?a ?b - place)
    (alarm ?p - place) (docking ?r - robot) (seen ?p - place) (lit ?p - place))
  (:functions (battery ?r - robot) (rate) (length ?a ?b - place))
  (:derived (way ?a ?b - place)
    (or (door ?a ?b) (exists (?c - place) (and (door ?a ?c) (way ?c ?b)))))
  (:action move :parameters (?r - robot ?a ?b - place)
    :precondition (and (at ?r ?a) (way ?a ?b) (forall (?p - place) (not (alarm ?p)))
      (> (battery ?r) 10))
    :effect (and (not (at ?r ?a)) (at ?r ?b)))
  (:action look :parameters (?r - robot ?p - place) :precondition (at ?r ?p)
    :effect (when (lit ?p) (seen ?p)))
  (:durative-action dock :parameters (?r - robot) :duration (= ?duration 5)
    :condition (over all (exists (?p - place) (at ?r ?p)))
    :effect (and (at start (docking ?r)) (at end (not (docking ?r)))))
  (:durative-action charge :parameters (?r - robot) :duration (= ?duration 5)
    :effect (increase (battery ?r) (* #t (rate))))
  (:action tally :parameters (?p - place)
    :effect (when (and (lit ?p) (alarm ?p)) (increase (rate) (length ?p ?p))))
  (:durative-action watch :parameters (?r - robot) :duration (= ?duration 5)
    :effect (forall (?p - place)
      (when (and (at start (alarm ?p)) (at end (at ?r ?p))) (at end (seen ?p)))))
  (:durative-action boil :parameters () :duration (= ?duration 5)
    :effect (assign (rate) (* #t 2))))
"""
PROBLEM = """
(define (problem night) (:domain ward) (:objects rb1 rb2 - robot hall room lab - place)
  (:init (at rb1 hall) (door hall room) (lit lab) (= (battery rb1) 90) (= (battery rb2) 1))
  (:goal (seen lab)))
"""


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A ward in which a camera saw a door that the robot then used."""
    loaded(fresh_kb, DOMAIN, PROBLEM)
    with fresh_kb.transaction(actor="camera", reason="saw it"):
        fresh_kb.propositions.save_all(["(door room lab)"])
    fresh_kb.apply("(move rb1 hall lab)")
    fresh_kb.apply("(look rb1 lab)")
    fresh_kb.end(fresh_kb.start("(dock rb1)"))
    return fresh_kb


def acts(kb: KnowledgeBase, element: str, **how: Any) -> list[tuple[int, str]]:
    found = kb.consequences(element, **how)
    return [(one.depth, one.text) for one in found if one.kind == "execution"]


def test_an_act_used_what_its_condition_rested_on(kb: KnowledgeBase) -> None:
    moved = [(1, "(move rb1 hall lab)")]
    # By a rule, by a comparison, by an absence within a quantifier.
    assert acts(kb, "(door room lab)") == acts(kb, "(door hall room)") == moved
    assert acts(kb, "(battery rb1)") == acts(kb, "(at rb1 hall)") == moved
    assert acts(kb, "(not (alarm room))") == moved
    assert acts(kb, "(way hall lab)") == moved
    # By a condition of an effect, and by the invariant of a durative action.
    assert acts(kb, "(lit lab)") == [(1, "(look rb1 lab)")]
    assert acts(kb, "(at rb1 lab)") == [(1, "(dock rb1)"), (1, "(look rb1 lab)")]
    for unused in ("(battery rb2)", "(not (door hall lab))", "(alarm room)", "(seen lab)"):
        assert acts(kb, unused) == []


def test_the_absence_of_a_derived_fact_rests_on_that_of_others(kb: KnowledgeBase) -> None:
    # No rule negates `way`; the condition does.
    action = "(:action wait :parameters (?a ?b - place) {} :effect (lit ?a))"
    kb.actions.save(action.format(":precondition (not (way ?a ?b))"))
    kb.apply("(wait lab hall)")
    waited = [(1, "(wait lab hall)")]
    assert acts(kb, "(not (way lab hall))") == acts(kb, "(not (door lab hall))") == waited
    assert acts(kb, "(not (door lab room))") == waited
    assert acts(kb, "(not (seen hall))") == []
    assert acts(kb, "(door room lab)") == [(1, "(move rb1 hall lab)")]


def test_a_value_stands_for_the_times_when_it_was_so(kb: KnowledgeBase) -> None:
    loaded_in = kb.revision
    kb.function_values.save("(= (battery rb1) 20.50)")
    kb.propositions.save("(door lab hall)")
    kb.apply("(move rb1 lab hall)")
    assert acts(kb, "(= (battery rb1) 90.0)") == [(1, "(move rb1 hall lab)")]
    assert acts(kb, "(= (BATTERY rb1) 20.5)") == [(1, "(move rb1 lab hall)")]
    assert len(acts(kb, "(battery rb1)")) == 2
    for find in (kb.consequences, kb.origins):
        assert find("(= (battery rb1) 99)").links == ()
    [was], [now] = kb.origins("(= (battery rb1) 90)"), kb.origins("(= (battery rb1) 20.5)")
    assert present(was.revision).number < loaded_in < present(now.revision).number


def test_a_continuous_effect_used_its_rate(kb: KnowledgeBase) -> None:
    kb.function_values.set("rate", objects=[], value=2)
    kb.end(kb.start("(charge rb1)"))
    # What cannot be executed can be reported, and used nothing.
    kb.executions.report("boil", outcome="succeeded")
    assert acts(kb, "(rate)") == [(1, "(charge rb1)")]


def test_an_effect_at_the_end_used_its_condition_at_the_start(kb: KnowledgeBase) -> None:
    kb.propositions.delete("(seen lab)")
    kb.propositions.save_all(["(alarm lab)", "(alarm hall)"])
    step = kb.start("(watch rb1)")
    kb.propositions.delete("(alarm lab)")
    kb.end(step)
    assert acts(kb, "(alarm lab)") == acts(kb, "(alarm hall)") == [(1, "(watch rb1)")]
    link, *_ = kb.origins("(seen lab)")
    assert link.used == ("(alarm hall)", "(alarm lab)", "(at rb1 lab)")


def test_an_effect_that_does_not_take_place_used_nothing(kb: KnowledgeBase) -> None:
    kb.function_values.save_all(["(= (length lab lab) 1)", "(= (rate) 0)"])
    kb.apply("(tally lab)")
    assert acts(kb, "(length lab lab)") == []
    assert (1, "(tally lab)") not in acts(kb, "(lit lab)")
    kb.propositions.save("(alarm lab)")
    kb.apply("(tally lab)")
    for used in ("(length lab lab)", "(lit lab)", "(alarm lab)"):
        assert acts(kb, used).count((1, "(tally lab)")) == 1


def test_consequences_are_followed(kb: KnowledgeBase) -> None:
    assert acts(kb, "(door room lab)", depth=9) == [
        (1, "(move rb1 hall lab)"),
        (2, "(dock rb1)"),
        (2, "(look rb1 lab)"),
    ]
    moved, *derived, dock, look = kb.consequences("(door room lab)", depth=2)
    assert present(moved.revision).number == 4
    assert moved.used == ("(door room lab)",)
    assert {*moved.made} == {"(at rb1 lab)", "(not (at rb1 hall))"}
    assert {one.text for one in derived} == {"(way hall lab)", "(way room lab)"}
    assert dock.used == look.used == ("(at rb1 lab)",)
    found = kb.consequences("(door room lab)", depth=2, limit=2)
    assert (len(found), found.has_more, found.searched) == (2, True, None)
    assert kb.executions.get(look.id or "") is not None


def test_only_while_it_held_it_was_used(kb: KnowledgeBase) -> None:
    [(_, looked)] = acts(kb, "(lit lab)")
    kb.propositions.delete("(lit lab)")
    kb.apply("(look rb1 lab)")
    assert acts(kb, "(lit lab)") == [(1, looked)]
    # The condition of the effect did not hold, so that it used nothing.
    assert acts(kb, "(not (lit lab))") == []
    kb.propositions.save_all(["(lit lab)"])
    kb.apply("(look rb1 lab)")
    first, second = kb.consequences("(lit lab)")
    assert first.id != second.id
    assert acts(kb.at(kb.revision - 1), "(lit lab)") == [(1, looked)]
    assert acts(kb.at(4), "(lit lab)") == []


def test_a_plan_used_the_state_that_it_was_made_from(kb: KnowledgeBase) -> None:
    kb.propositions.save_all(["(door lab hall)"])
    recorded = kb.plans.record(
        Plan((PlanStep(None, "move", ("rb1", "lab", "hall")),), "by hand", "found")
    )
    [plan] = [one for one in kb.consequences("(door lab hall)") if one.kind == "plan"]
    # It was made from the state before, in which nobody knew of it.
    before = kb.at(recorded.recorded_in - 1).consequences("(door lab hall)")
    assert {one.kind for one in before} == {"derived fact"}
    assert (plan.id, plan.text) == (str(recorded.id), "(move rb1 lab hall)")
    kb.apply(recorded.steps[0])
    kinds = [one.kind for one in kb.consequences("(door lab hall)")]
    assert kinds.count("execution") == kinds.count("plan") == 1


def test_origins_lead_to_observations_and_documents(kb: KnowledgeBase) -> None:
    found = kb.origins("(seen lab)")
    first, second, *rest = found
    assert (first.text, first.used) == ("(look rb1 lab)", ("(at rb1 lab)", "(lit lab)"))
    assert (second.depth, second.text, second.made) == (2, "(move rb1 hall lab)", ("(at rb1 lab)",))
    [camera] = [one for one in rest if one.kind == "observation"]
    assert present(camera.revision).actor == "camera"
    assert (camera.depth, camera.made) == (3, ("(door room lab)",))
    documents = [one for one in found if one.kind == "document"]
    assert {text for one in documents for text in one.made} >= {"(at rb1 hall)", "(lit lab)"}
    assert all("night" in one.text for one in documents)
    assert [one.depth for one in kb.origins("(seen lab)", depth=1)] == [1]
    [derived, *_] = kb.origins("(way hall lab)")
    assert derived.kind == "derived fact"
    assert "(door room lab)" in derived.used
    # What held last.
    [gone] = kb.origins("(at rb1 hall)", depth=1)
    assert gone.kind == "document"
    [left] = kb.origins("(not (at rb1 hall))", depth=1)
    assert left.text == "(move rb1 hall lab)"


def test_what_a_branch_began_with_goes_back_to_its_parent(kb: KnowledgeBase) -> None:
    with kb.branch() as branch:
        [begun] = branch.origins("(door room lab)")
    assert (begun.kind, begun.made) == ("branch", ("(door room lab)",))
    assert begun.text == f"branch of {store_of(kb).name} at revision {kb.revision}"


def test_a_transaction_of_an_act_is_an_origin(kb: KnowledgeBase) -> None:
    act = kb.executions.report("move", arguments=["rb1", "lab", "room"], outcome="running")
    with kb.transaction(execution=act):
        kb.propositions.save_all(["(at rb1 room)"])
    kb.executions.report(act, outcome="succeeded")
    moved, *_ = kb.origins("(at rb1 room)")
    assert (moved.kind, moved.id, moved.made) == ("execution", act.id, ("(at rb1 room)",))
    assert "(at rb1 lab)" in moved.used
    # An act that is applied in its transaction is named beside it.
    with kb.transaction(execution=act):
        kb.apply("(move rb1 room lab)")
    assert {one.text for one in kb.origins("(not (at rb1 room))", depth=1)} == {
        "(move rb1 lab room)",
        "(move rb1 room lab)",
    }


def test_definitions_are_those_of_the_time(kb: KnowledgeBase) -> None:
    kb.load_domain(DOMAIN.replace("(at ?r ?a) (way ?a ?b)", "(at ?r ?a)"))
    assert acts(kb, "(at rb1 hall)") == [(1, "(move rb1 hall lab)")]
    kb.objects.delete("room")
    assert acts(kb.at(5), "(door room lab)") == [(1, "(move rb1 hall lab)")]


def test_statements_do_not_grow_with_acts(kb: KnowledgeBase) -> None:
    few = count(lambda: kb.consequences("(lit lab)"))
    for _ in range(30):
        kb.apply("(look rb1 lab)")
    assert count(lambda: kb.consequences("(lit lab)")) <= few <= 25
    assert len(kb.consequences("(lit lab)")) == 31


def test_of_many_acts_the_newest_are_searched(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(causes, "FEW", 3)
    for _ in range(8):
        kb.apply("(look rb1 lab)")
    found = kb.consequences("(lit lab)")
    assert found.searched is not None
    assert 0 < len(found) < 9
    assert acts(kb.at(found.searched), "(lit lab)")


def test_an_archive_has_what_was_used_before(kb: KnowledgeBase, tmp_path: Path) -> None:
    assert acts(kb, "(at rb1 hall)") == [(1, "(move rb1 hall lab)")]
    upto = kb.store.archive(kb.revision, to=f"sqlite:///{tmp_path / 'archive.db'}").upto
    for found in (kb.consequences("(at rb1 hall)"), kb.origins("(seen lab)")):
        assert found.searched == upto + 1


def test_acts_of_other_objects_do_not_hide_those_that_used_a_fact(kb: KnowledgeBase) -> None:
    kb.propositions.save_all(["(door lab lab)"])
    for _ in range(3):
        kb.apply("(move rb1 lab lab)")
    # By rules, a door may be used on the way from anywhere: only some of the acts are looked at.
    found = kb.consequences("(door hall room)", limit=1)
    assert (found.searched, found.has_more) == (kb.revision - 1, True)
    assert acts(kb.at(4), "(door hall room)", limit=1) == [(1, "(move rb1 hall lab)")]
    # A rule that is not recursive leads from the fact to the objects of an act.
    kb.load_domain(DOMAIN.replace("(way ?c ?b)", "(door ?c ?b)"))
    assert acts(kb, "(door hall room)", limit=1) == [(1, "(move rb1 hall lab)")]


def test_facts_of_another_arity_than_the_predicate_s_led_to_nothing(kb: KnowledgeBase) -> None:
    for element in ("(at rb1)", "(way hall)", "(battery)", "(not (at rb1))"):
        assert kb.consequences(element, depth=2).links == kb.origins(element).links == ()


def test_links_without_a_limit(kb: KnowledgeBase) -> None:
    for limit in (None, 10**30):
        found = kb.consequences("(at rb1 lab)", limit=limit)
        assert len(found) == 2
        assert not found.has_more
        assert len(kb.origins("(seen lab)", limit=limit)) == len(kb.origins("(seen lab)"))


def test_what_is_no_fact_is_refused(kb: KnowledgeBase) -> None:
    for wrong in ("rb1", "(and (at rb1 hall) (at rb1 lab))", "(or (at rb1 hall))"):
        with pytest.raises(InvalidKnowledgeError, match="is not a fact or a fluent"):
            kb.consequences(wrong)
    with pytest.raises(UnknownNameError):
        kb.origins("(at rb1 cellar)")
    with pytest.raises(InvalidArgumentError, match="depth"):
        kb.origins("(at rb1 hall)", depth=0)
