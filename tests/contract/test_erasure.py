"""A name is erased: it is nowhere any more, and the history is verified as before."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import KnowledgeBase, Plan

NAME = "maria_sklodowska"
DOMAIN = f"""
(define (domain care) (:requirements :typing :fluents :constraints) (:types person room)
  (:constants {NAME} - person)
  (:predicates (at ?p - person ?r - room) (clean ?r - room))
  (:functions (age ?p - person) - number (guest ?r - room) - person)
  (:derived (free ?r - room) (not (at {NAME} ?r)))
  (:action move :parameters (?a ?b - room) :precondition (at {NAME} ?a)
    :effect (and (not (at {NAME} ?a)) (at {NAME} ?b))))
""".replace("(clean ?r - room)", "(clean ?r - room) (free ?r - room)")
PROBLEM = f"""
(define (problem day) (:domain care) (:objects bob - person hall bath - room)
  (:init (at {NAME} hall) (at bob bath) (= (age {NAME}) 80) (= (guest hall) {NAME}))
  (:goal (and (at {NAME} bath) (or (at {NAME} hall) (at bob hall)))))
"""


def fill(kb: KnowledgeBase) -> KnowledgeBase:
    """A history that mentions the name in each table that can."""
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM)
    kb.rules.save("watch", f"(always (not (at {NAME} bath)))")
    with kb.transaction(actor="camera", reason=f"saw {NAME}", source={"who": NAME, "at": 3}):
        kb.propositions.delete(f"(at {NAME} hall)")
        kb.propositions.save(f"(at {NAME} bath)")
    with kb.transaction(actor="camera"):
        kb.propositions.confirm([f"(at {NAME} bath)"])
    kb.plans.record(Plan.read("(move bath hall)"))
    kb.plans.record(
        Plan.read("(move bath hall)"),
        domain_pddl="(define (domain d))",
        problem_pddl=f"(define (problem p) (:objects {NAME} {NAME}2))",
    )
    kb.executions.report(
        "call",
        arguments=[NAME.upper(), "bob"],
        outcome="failed",
        code="E1",
        text=f"no {NAME} there",
    )
    kb.function_values.save(f"(= (age {NAME}) 81)")
    return kb


@pytest.fixture
def filled(kb: KnowledgeBase) -> KnowledgeBase:
    return fill(kb)


def everything(kb: KnowledgeBase) -> str:
    """All that a knowledge base answers, of all revisions."""
    said: list[Any] = [kb.log(), kb.domain_pddl(), kb.problem_pddl(), kb.plans.get_all()]
    said += [kb.executions.get_all(), kb.rules.get_all(), kb.diff(0, kb.revision)]
    for number in range(1, kb.revision + 1):
        then = kb.at(number)
        said += [then.propositions.get_all(), then.function_values.get_all()]
        said += [then.objects.get_all(), then.actions.get_all()]
    for plan in kb.plans.get_all():
        said += [plan.domain_pddl(), plan.problem_pddl()]
    return repr([*map(str, said), said]).lower()


def test_an_erased_name_is_in_no_answer_and_the_chain_is_intact(filled: KnowledgeBase) -> None:
    kb = filled
    anchor, revision = kb.store.anchor(), kb.revision
    assert kb.store.verify().findings == ()
    assert NAME in everything(kb)
    erased = kb.erase(NAME, reason="she asked for it", also=["reason", "source"])
    assert (erased.revision, erased.pseudonym, erased.form_1) == (revision + 1, "erased-1", 0)
    assert erased.parts > 15
    assert erased.revisions > 7
    said = everything(kb)
    assert f"{NAME}2" in said
    assert NAME not in said.replace(f"{NAME}2", "")
    found = kb.store.verify(anchor=anchor)
    assert (found.findings, len(found.erasures)) == ((), 1)
    assert kb.holds("(at erased-1 bath)")
    assert [*kb.when("(at erased-1 hall)")]
    assert kb.at(2).holds("(at erased-1 hall)")
    assert kb.history("(at erased-1 hall)")


def test_a_second_name_in_the_same_texts_is_erased_too(filled: KnowledgeBase) -> None:
    kb = filled
    kb.erase(NAME, reason="she asked for it")
    kb.propositions.save("(at erased-1 hall)")
    assert kb.erase("bath", reason="rebuilt").pseudonym == "erased-2"
    assert kb.erase("bob", reason="left").pseudonym == "erased-3"
    kb.propositions.delete("(at erased-1 hall)")
    assert "bob" not in everything(kb).replace('"bob"', "")
    found = kb.store.verify()
    assert (found.findings, len(found.erasures)) == ((), 3)
