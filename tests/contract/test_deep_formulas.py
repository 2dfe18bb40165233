"""Formulas as deep as the limit come back equal from the store; deeper ones are refused."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

from kant_sql import InvalidKnowledgeError, KnowledgeBase, PddlActionDto
from kant_sql.dto import formulas as f
from kant_sql.pddl import read_domain, read_problem, write

DOMAIN = """
(define (domain deep) (:requirements :adl :fluents :derived-predicates :constraints)
  (:types t) (:constants k - t)
  (:predicates (p) (q ?x - t) (d)) (:functions (f) - number (next ?x - t) - t)
  (:constraints {precondition})
  (:derived (d) {precondition})
  (:action a :parameters () :precondition {precondition} :effect (increase (f) {value})))
"""
PROBLEM = """
(define (problem deeper) (:domain deep) (:init (= (f) 0)) (:goal {goal})
  (:metric minimize {value}))
"""
# With the atom within, and what is around some of these formulas.
LEVELS = f.MAX_NESTING - 2


def load(kb: KnowledgeBase, opening: str, levels: int) -> tuple[Any, Any]:
    """Load documents whose formulas are all deep; a sum that is deep on the left is the metric."""
    formula = f"{opening * levels}(p){')' * levels}"
    terms = f"(q {'(next ' * levels}k{')' * levels})"
    value = f"{'(+ 1 ' * levels}(f){')' * levels}"
    text = DOMAIN.format(precondition=formula, value=value)
    domain = read_domain(text.replace(f"(:constraints {formula})", ""))
    left = f"{'(+ ' * levels}(f){' (f))' * levels}"
    goal = f"(and {formula} {terms})"
    problem = read_problem(PROBLEM.format(goal=goal, value=left), domain=domain)
    kb.load_domain(write(domain))
    kb.load_problem(write(problem))
    return domain, problem


@pytest.mark.more
@pytest.mark.parametrize("opening", ["(or (p) ", "(exists (?x) "])
def test_what_is_deep_comes_back_equal(fresh_kb: KnowledgeBase, opening: str) -> None:
    domain, problem = load(fresh_kb, opening, LEVELS)
    assert fresh_kb.pddl.domain() == domain
    assert fresh_kb.pddl.problem() == problem
    assert fresh_kb.at(fresh_kb.revision).problem_pddl() == write(problem)
    assert fresh_kb.at(1).domain_pddl() == write(domain)
    assert fresh_kb.store.verify().is_intact
    action = fresh_kb.actions.get("a")
    assert pickle.loads(pickle.dumps(action)).conditions == action.conditions  # type: ignore[union-attr]
    fresh_kb.restore(1)
    fresh_kb.restore(2)
    assert fresh_kb.pddl.problem() == problem
    fresh_kb.load_domain(write(domain), mode="replace")
    assert fresh_kb.pddl.domain() == domain


def nested(leaf: Any, levels: int) -> Any:
    for _ in range(levels):
        leaf = f.Not(leaf)
    return leaf


def test_daos_take_and_give_what_is_deep(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        DOMAIN.format(precondition="(always (p))", value="1")
        .replace("(:derived (d) (always (p)))", "(:derived (d) (p))")
        .replace(":precondition (always (p))", ":precondition (p)")
    )
    term: Any = f.Variable("x")
    total: Any = f.Number(1)
    for _ in range(LEVELS // 2):
        term, total = f.Fluent("next", (term,)), f.Arithmetic("-", (total,))
    goal = f.Exists((f.TypedName("x", ("t",)),), nested(f.Atom("q", (term,)), LEVELS // 2))
    fresh_kb.goals.save(goal)
    fresh_kb.goals.save(f.Comparison("<", total, f.Fluent("f")))
    fresh_kb.pddl.metric.set(f.Metric("minimize", total))
    fresh_kb.pddl.derived_predicates.save(f.Derived("d", (), nested(f.Atom("p"), LEVELS)))
    assert fresh_kb.goals.get_all() == [goal, f.Comparison("<", total, f.Fluent("f"))]
    assert fresh_kb.pddl.metric.get() == f.Metric("minimize", total)
    assert fresh_kb.store.verify().is_intact
    assert fresh_kb.goals.insert(goal) is False
    assert fresh_kb.goals.delete(goal) is True
    assert fresh_kb.goals.delete(goal) is False
    # Deleting a type takes all that mentions it along.
    assert fresh_kb.functions.delete(fresh_kb.functions.get("f")) is True  # type: ignore[arg-type]
    assert fresh_kb.goals.get_all() == []


TOO_DEEP = "levels deep, expected at most 50 levels; name a part by a derived predicate"


@pytest.mark.more
def test_what_is_deeper_is_refused_wherever_it_comes_from(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(
        "(define (domain d) (:requirements :adl :fluents) (:predicates (p)) (:functions (f)))"
    )
    for deepest in (nested(f.Atom("p"), f.MAX_NESTING - 1), numbered(f.MAX_NESTING)):
        fresh_kb.goals.save(deepest)
        assert fresh_kb.goals.get_all() == [deepest]
        assert fresh_kb.holds(str(deepest)) in (True, False)
        assert fresh_kb.goals.delete(deepest)
    fresh_kb.goals.save(nested(f.Atom("p"), f.MAX_NESTING - 1))
    before = fresh_kb.revision
    for levels in (f.MAX_NESTING + 1, 50_000):
        for wrong in (nested(f.Atom("p"), levels - 1), numbered(levels)):
            for save in (
                lambda wrong=wrong: fresh_kb.goals.save(wrong),
                lambda wrong=wrong: fresh_kb.goals.save(str(wrong)),
                lambda wrong=wrong: fresh_kb.pddl.derived_predicates.save(
                    f.Derived("p", (), wrong)
                ),
                lambda wrong=wrong: fresh_kb.actions.save(
                    PddlActionDto("a", [], [wrong], [], durative=False)
                ),
                lambda wrong=wrong: fresh_kb.holds(str(wrong)),
                lambda wrong=wrong: fresh_kb.query(str(wrong)),
            ):
                with pytest.raises(InvalidKnowledgeError, match=TOO_DEEP):
                    save()
    assert fresh_kb.revision == before


def numbered(levels: int) -> f.Comparison:
    total: Any = f.Fluent("f")
    for _ in range(levels - 2):
        total = f.Arithmetic("-", (total,))
    return f.Comparison("<", total, f.Number(1))
