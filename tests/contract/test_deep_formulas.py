"""Formulas as deep as they may be go through the store, and come back equal."""

from __future__ import annotations

import pytest

from kant_sql import InvalidKnowledgeError, KnowledgeBase
from kant_sql.pddl import And, Atom, Not, Or, read_domain, read_problem, write
from kant_sql.pddl.tokens import MAX_DEPTH

DOMAIN = """
(define (domain deep) (:requirements :adl :numeric-fluents) (:predicates (p)) (:functions (f))
  (:action a :parameters () :precondition {precondition} :effect (increase (f) {value})))
"""
PROBLEM = "(define (problem deeper) (:domain deep) (:init (= (f) 0)) (:goal {goal}))"


@pytest.mark.parametrize("opening", ["(or (p) ", "(not ", "(exists (?x) ", "(imply (p) "])
def test_what_is_as_deep_as_may_be_comes_back_equal(fresh_kb: KnowledgeBase, opening: str) -> None:
    levels = MAX_DEPTH - 10
    formula = f"{opening * levels}(p){')' * levels}"
    value = f"{'(+ 1 ' * levels}(f){')' * levels}"
    domain = read_domain(DOMAIN.format(precondition=formula, value=value))
    problem = read_problem(PROBLEM.format(goal=formula), domain=domain)
    fresh_kb.load_domain(write(domain))
    fresh_kb.load_problem(write(problem))
    assert fresh_kb.domain() == domain
    assert fresh_kb.problem() == problem
    assert fresh_kb.at(fresh_kb.revision).problem_pddl() == write(problem)
    assert fresh_kb.actions.get("a") is not None


def test_what_is_deeper_is_refused(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(DOMAIN.format(precondition="(p)", value="1"))
    formula: And | Or | Not | Atom = Atom("p")
    for _ in range(5_000):
        formula = Not(formula)
    with pytest.raises(InvalidKnowledgeError, match=f"nested more than {MAX_DEPTH} deep"):
        fresh_kb.goals.save(formula)
    assert fresh_kb.revision == 1
    assert fresh_kb.goals.get_all() == []
