"""A transaction that loads several problems: what one of them wrote is known to the next."""

from __future__ import annotations

import pytest

from kant_sql import KnowledgeBase
from kant_sql.store import transaction as propositions
from tests.support.stores import Connect

DOMAIN = """(define (domain d) (:predicates (p ?x ?y) (q ?x)) (:functions (f ?x))
  (:action a :parameters (?x) :precondition (q ?x) :effect (not (q ?x))))"""
FIRST = """(define (problem one) (:domain d) (:objects a b c)
  (:init (p a b) (p b c) (q a) (= (f a) 1) (= (f b) 2)) (:goal (q c)))"""
SECOND = """(define (problem one) (:domain d) (:objects a b c e)
  (:init (p a b) (p b c) (p c e) (q b) (= (f a) 1) (= (f b) 3)) (:goal (and (q c) (q c) (q e))))"""


def _load_in_vain(kb: KnowledgeBase) -> None:
    with kb.transaction():
        kb.load_problem(FIRST)
        raise ZeroDivisionError


@pytest.mark.parametrize("spill_at", [1, 3, 10_000])
@pytest.mark.parametrize("mode", ["replace", "merge"])
def test_a_problem_that_was_just_loaded_is_loaded_again(
    connect: Connect, url: str, monkeypatch: pytest.MonkeyPatch, spill_at: int, mode: str
) -> None:
    monkeypatch.setattr(propositions, "SPILL_AT", spill_at)
    second = SECOND if mode == "replace" else SECOND.replace("(= (f b) 3)", "(= (f b) 2)")
    kb = connect(url)
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(FIRST)
        kb.load_problem(second, mode=mode)  # type: ignore[arg-type]
    facts = {str(fact) for fact in kb.propositions.get_all()}
    merged = {"(q a)"} if mode == "merge" else set()
    assert facts == {"(p a b)", "(p b c)", "(p c e)", "(q b)"} | merged
    assert {str(goal) for goal in kb.goals.get_propositions()} == {"(q c)", "(q e)"}
    values = {str(value) for value in kb.function_values.get_all()}
    assert values == {"(= (f a) 1)", "(= (f b) 3)" if mode == "replace" else "(= (f b) 2)"}


def test_a_load_that_fails_leaves_nothing_for_the_next(connect: Connect, url: str) -> None:
    kb = connect(url)
    kb.load_domain(DOMAIN)
    with kb.transaction():
        with pytest.raises(ZeroDivisionError):
            _load_in_vain(kb)
        kb.load_problem(SECOND)
    assert {str(fact) for fact in kb.propositions.get_all()} == {
        "(p a b)",
        "(p b c)",
        "(p c e)",
        "(q b)",
    }
