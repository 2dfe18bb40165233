"""What an initial state says twice, in two ways: one meaning, in the document and in the store."""

from __future__ import annotations

import pytest

from kant_sql import InvalidKnowledgeError, KnowledgeBase, PddlError
from kant_sql.dto.formulas import Atom, Constant, Fluent, Not, Number
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import FunctionValue, Problem

DOMAIN = """
(define (domain d) (:requirements :adl :fluents :object-fluents)
  (:types place) (:constants hub dock - place)
  (:predicates (free) (open ?p - place))
  (:functions (cost) (fuel ?p - place) - number (next ?p - place) - place))
"""
KNOWN = read_domain(DOMAIN)
HUB, DOCK = Constant("hub"), Constant("dock")


def text(init: str) -> str:
    return f"(define (problem p) (:domain d)\n(:init {init})\n(:goal (and)))"


def agree(kb: KnowledgeBase, init: str) -> Problem:
    """Load an initial state; give the problem that all agree on, with its warnings."""
    problem = read_problem(text(init), domain=KNOWN)
    with kb.transaction():
        kb.load_domain(DOMAIN)
        assert kb.load_problem(text(init)).warnings == problem.warnings
    assert kb.pddl.problem() == problem
    assert read_problem(kb.problem_pddl(), domain=KNOWN) == problem
    assert read_problem(write(problem), domain=KNOWN, strict=True) == problem
    assert kb.store.verify().findings == ()
    return problem


def places(problem: Problem) -> list[tuple[int, int]]:
    return [(warning.line, warning.column) for warning in problem.warnings]


@pytest.mark.parametrize(
    ("init", "fluent", "value", "columns"),
    [
        ("(= (cost) 1) (= (cost) 2)", Fluent("cost"), Number(2), [8, 21]),
        ("(= cost 1) (= (COST) 2.5)", Fluent("cost"), Number(2.5), [8, 11, 19]),
        ("(and (= (fuel hub) 1)) (= (fuel hub) 2)", Fluent("fuel", (HUB,)), Number(2), [8, 13, 31]),
        ("(= (fuel hub) 1) (= (fuel Hub) -1)", Fluent("fuel", (HUB,)), Number(-1), [8, 25]),
        ("(= (next hub) hub) (= (next hub) dock)", Fluent("next", (HUB,)), DOCK, [8, 27]),
    ],
)
def test_of_two_values_the_last_one_holds(
    fresh_kb: KnowledgeBase, init: str, fluent: Fluent, value: Number | Constant, columns: list[int]
) -> None:
    problem = agree(fresh_kb, init)
    assert problem.values == (FunctionValue(fluent, value),)
    assert sorted(column for _, column in places(problem)) == columns
    assert sum("the last one holds" in each.message for each in problem.warnings) == 2


def test_of_three_values_each_place_is_warned_of(fresh_kb: KnowledgeBase) -> None:
    problem = agree(fresh_kb, "(= (cost) 1)\n(= (cost) 2) (= (cost) 2))\n(:init (= (cost) 3)")
    assert problem.values == (FunctionValue(Fluent("cost"), Number(3)),)
    assert places(problem) == [(2, 8), (3, 1), (3, 1), (3, 14), (4, 1), (4, 8)]


def test_many_values_of_which_one_is_given_twice(fresh_kb: KnowledgeBase) -> None:
    lines = [f"(= (fuel p{number}) {number})" for number in range(3000)]
    again = "\n".join([*lines, "(= (fuel p1) 7)"])
    objects = " ".join(f"p{number}" for number in range(3000))
    whole = f"(define (problem p) (:domain d) (:objects {objects} - place)\n(:init\n{again}))"
    fresh_kb.load_domain(DOMAIN)
    loaded = fresh_kb.load_problem(whole)
    found = [(each.line, each.column) for each in loaded.warnings if "value" in each.message]
    assert found == [(4, 1), (3003, 1)]
    assert fresh_kb.function_values.get("fuel", objects=["p1"]) == 7


def test_another_value_is_refused_under_strict() -> None:
    with pytest.raises(PddlError) as refused:
        read_problem(text("(= (cost) 1) (= (cost) 2)"), domain=KNOWN, strict=True)
    error = refused.value
    assert (error.line, error.column) == (2, 21)
    assert (error.found, error.expected) == ("2 as the value of (cost)", "one value, which was 1")


@pytest.mark.parametrize(
    ("init", "fact", "column"),
    [
        ("(free) (not (free))", Atom("free"), 15),
        ("(not (free)) (free)", Atom("free"), 8),
        ("(not (open hub)) (not (open dock)) (OPEN Hub)", Atom("open", (HUB,)), 8),
    ],
)
def test_of_a_fact_and_its_negation_the_fact_holds(
    fresh_kb: KnowledgeBase, init: str, fact: Atom, column: int
) -> None:
    problem = agree(fresh_kb, init)
    assert problem.facts == (fact,)
    assert Not(fact) not in problem.literals
    [place] = [(one.line, one.column) for one in problem.warnings if "left out" in one.message]
    assert place == (2, column)
    with pytest.raises(PddlError, match=r"expected one of the two") as refused:
        read_problem(text(init), domain=KNOWN, strict=True)
    assert refused.value.column == column


def test_a_document_that_contradicts_itself_is_not_written() -> None:
    free = Atom("free")
    with pytest.raises(InvalidKnowledgeError, match=r"\(not \(free\)\) denies a fact that holds"):
        write(Problem("p", "d", facts=(free,), literals=(Not(free),)))
    cost = [FunctionValue(Fluent("cost"), Number(number)) for number in (1, 1, 2)]
    with pytest.raises(InvalidKnowledgeError, match=r"\(cost\) has two values"):
        write(Problem("p", "d", values=tuple(cost)))
    assert write(Problem("p", "d", values=tuple(cost[:2])))
