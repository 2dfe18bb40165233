"""Another writer changes the store between two reads of one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from kant_sql import KnowledgeBase, Plan
from kant_sql.errors import PlanError
from kant_sql.plans import dao
from kant_sql.reasoning import durative
from tests.support.reading import beside, loaded, store_of

DOMAIN = """
(define (domain ward) (:requirements :typing :durative-actions) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (lit ?p - place) (seen ?p - place))
  (:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)
    :effect (and (at start (at ?r ?p)) (when (at start (lit ?p)) (at end (seen ?p)))
      (forall (?q - place) (when (at start (lit ?q)) (at start (seen ?q)))))))
"""
PROBLEM = """
(define (problem night) (:domain ward) (:objects r1 - robot hall room - place)
  (:init (lit room)) (:goal (seen room)))
"""
Change = Callable[[KnowledgeBase], object]


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A ward with a robot."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def camera(kb: KnowledgeBase) -> KnowledgeBase:
    """Another writer of the same knowledge base."""
    return beside(kb, store_of(kb).name, "camera")


@pytest.fixture
def after(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let another writer change the store once, right after a function has returned."""

    def interfere(module: object, function: str, change: Change) -> None:
        call, changes = getattr(module, function), [change]

        def called(*given: Any, **named: Any) -> Any:
            found = call(*given, **named)
            if changes:
                changes.pop()(camera(kb))
            return found

        monkeypatch.setattr(module, function, called)

    return interfere


@pytest.mark.parametrize(
    "change",
    [
        lambda other: other.objects.save("bath - place"),
        lambda other: other.predicates.save("(warm ?p - place)"),
        lambda other: other.erase("hall", reason="asked"),
    ],
    ids=["object", "predicate", "erasure"],
)
def test_a_definition_that_changes_leaves_the_effects_at_the_end(
    change: Change, kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    kb.propositions.delete("(seen room)")
    step = kb.start("(visit r1 room)")
    kb.propositions.delete_all(["(seen room)", "(lit room)"])
    after(durative, "_running", change)
    assert kb.end(step).outcome == "succeeded"
    assert kb.holds("(seen room)")


def test_an_action_that_was_redefined_while_it_ran_cannot_end(kb: KnowledgeBase) -> None:
    step = kb.start("(visit r1 room)")
    kb.actions.save(
        "(:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)"
        " :effect (when (at start (lit ?p)) (at end (seen ?p))))"
    )
    assert kb.end(step).outcome == "succeeded"
    step = kb.start("(visit r1 room)")
    kb.actions.save(
        "(:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)"
        " :effect (and (at end (at ?r ?p)) (when (at start (lit ?p)) (at end (seen ?p)))))"
    )
    with pytest.raises(PlanError, match="its action was redefined since it began"):
        kb.end(step)
    assert kb.abort(step).left == ()


def test_a_name_that_is_erased_stays_among_what_an_abort_takes_back(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    kb.propositions.save("(lit hall)")
    step = kb.start("(visit r1 room)")
    after(durative, "_running", lambda other: other.erase("hall", reason="asked"))
    found = kb.abort(step, undo=True)
    assert {str(each.text) for each in found.undone} == {
        "(at r1 room)",
        "(seen erased-1)",
        "(seen room)",
    }
    assert not kb.holds("(exists (?p - place) (seen ?p))")


def test_an_erased_name_does_not_come_back_with_a_plan(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    after(dao, "check_steps", lambda other: other.erase("hall", reason="asked"))
    made = kb.plans.record(Plan.read("(visit r1 room)\n"))
    assert (made.revision, made.recorded_in) == (kb.revision - 1, kb.revision)
    after(dao, "check_steps", lambda other: other.erase("room", reason="asked"))
    with pytest.raises(PlanError, match="object 'room' is not known"):
        kb.plans.record(Plan.read("(visit r1 room)\n"))
    assert kb.store.verify().is_intact
