"""Documents are written in one layout; what text could not carry is refused, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given

from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.document import Action, Domain, Function, Predicate, Problem
from kant_sql.pddl.writer import node_text, write, write_problem
from tests.support.generators.documents import domains_and_problems
from tests.support.profile import PROFILE, hunting

ROBOT = ("robot",)
R = f.TypedName("r", ROBOT)
FREE = f.Atom("free")
BATTERY = f.Fluent("battery", (f.Variable("r"),))
GROWS = f.Assign("increase", BATTERY, f.Number(Decimal(1)))


def number(text: str) -> f.Number:
    return f.Number(Decimal(text))


LAYOUT = """\
(define (domain Tiago)
  (:requirements :typing :fluents)
  (:types
    robot - object
    door window - wp
    wp - object
  )
  (:constants
    d1 d2 - door
    w - (either robot wp)
  )
  (:predicates
    (robot_at ?r - robot ?r - wp)
    (free)
  )
  (:functions
    (battery ?r - robot) - number
    (home ?r - robot) - wp
    (total-cost)
  )
  (:constraints (and
    (always (free))
  ))
  (:derived (free) (and))
  (:durative-action move
    :parameters (?r - robot ?from ?to - wp)
    :duration (= ?duration 10)
    :condition (and
      (at start (robot_at ?r ?from))
    )
    :effect (and
      (at end (not (free)))
      (decrease (battery ?r) (* #t 0.50))
    )
  )
  (:action wait
    :parameters ()
    :precondition (and)
    :effect (and
      (when (free) (not (free)))
    )
  )
)
"""
OF_PROBLEM = """\
(define (problem P)
  (:domain Tiago)
  (:objects
    rb1 - robot
    wp2 - wp
    thing - object
  )
  (:init
    (robot_at rb1 wp2)
    (free)
    (not (robot_at rb1 rb1))
    (= rb1 rb1)
    (= (battery rb1) -1.50)
    (= (home rb1) wp2)
    (at 5 (not (free)))
    (at 6 (= (battery rb1) 100))
  )
  (:goal (and
    (free)
    (preference p1 (robot_at rb1 wp2))
  ))
  (:constraints (and
    (at end (free))
  ))
  (:metric minimize (is-violated p1))
)
"""
# An exponent is written out.
PROBLEM = read_problem(OF_PROBLEM.replace("100", "1e2"))


def test_the_layout_of_a_document() -> None:
    assert write(read_domain(LAYOUT)) == LAYOUT
    assert write(PROBLEM) == OF_PROBLEM


def test_an_empty_document_has_what_the_standard_requires() -> None:
    assert write(Domain("d")) == "(define (domain d)\n)\n"
    assert write(Problem("p", "d")) == (
        "(define (problem p)\n  (:domain d)\n  (:init\n  )\n  (:goal (and))\n)\n"
    )


@pytest.mark.parametrize(
    ("constraints", "text"),
    [
        ((), ":duration (and)"),
        ((f.And(),), ":duration (and\n      (and)\n    )"),
        ((f.Comparison("<=", f.Variable("duration"), number("5")),), ":duration (<= ?duration 5)"),
    ],
)
def test_a_duration_reads_back_with_as_many_conjuncts(
    constraints: tuple[f.Formula, ...], text: str
) -> None:
    action = Action("durative-action", "a", duration=constraints)
    assert f"    {text}\n" in write(Domain("d", actions=(action,)))


def test_processes_and_events_have_preconditions() -> None:
    for kind in ("process", "event"):
        text = write(Domain("d", actions=(Action(kind, "a"),)))
        assert f"  (:{kind} a\n    :parameters ()\n    :precondition (and)\n" in text


def test_long_lists_are_broken_into_lines() -> None:
    objects = tuple(f.TypedName(f"object-number-{i}", ROBOT) for i in range(200))
    lines = write(Problem("p", "d", objects=objects)).splitlines()
    listed = lines[lines.index("  (:objects") + 1 : lines.index("  )")]
    assert max(map(len, lines)) <= 100
    assert " ".join(line.strip() for line in listed).split() == [
        *(name.name for name in objects), "-", "robot"
    ]  # fmt: skip


def test_numeric_functions_alone_need_no_type() -> None:
    text = write(Domain("d", functions=(Function("f"), Function("g", (R,)))))
    assert "  (:functions\n    (f)\n    (g ?r - robot)\n  )\n" in text


def test_facts_may_be_given_as_text() -> None:
    facts = (fact for fact in ["(free)", "(robot_at rb1 wp2)"])
    given_ = write_problem(replace(PROBLEM, facts=()), facts)
    assert given_ == write(replace(PROBLEM, facts=(FREE, PROBLEM.facts[0])))


@hunting(PROFILE.texts)
@given(domains_and_problems())
def test_a_node_is_written_as_its_str(documents: tuple[Domain, Problem]) -> None:
    for document in documents:
        formulas = list(document.constraints)
        if isinstance(document, Domain):
            for action in document.actions:
                formulas += [*action.duration, *action.condition, *action.effect]
        else:
            formulas += document.goal
        for formula in formulas:
            assert node_text(formula) == str(formula)


def nested(levels: int) -> f.Formula:
    formula: f.Formula = FREE
    for _ in range(levels):
        formula = f.Not(formula)
    return formula


ONE, TWO, VALUE = number("1"), number("2"), f.Fluent("f")
KNOWN = Domain("d", (":adl",), predicates=(Predicate("free"),), functions=(Function("f"),))


def deep_sum(levels: int) -> f.Formula:
    value: f.Arithmetic = f.Arithmetic("-", (VALUE,))
    for _ in range(levels - 1):
        value = f.Arithmetic("-", (value,))
    return f.Comparison("<", value, ONE)


def test_what_is_nested_deeply_is_written_and_read() -> None:
    deepest = nested(f.MAX_NESTING - 3)
    assert sum(1 for _ in f.walk(deepest)) == f.MAX_NESTING - 2
    for goal_ in (deepest, deep_sum(f.MAX_NESTING - 2)):
        problem = Problem("p", "d", goal=(goal_,))
        assert read_problem(write(problem), domain=KNOWN) == problem
    for action in (
        Action("action", "a", condition=(deepest,)),
        Action("action", "a", effect=(f.When(deepest, FREE),)),
        Action("durative-action", "a", condition=(f.Timed("at end", deepest),)),
    ):
        domain = replace(KNOWN, actions=(action,))
        assert read_domain(write(domain)) == domain


def goal(formula: f.Formula) -> Problem:
    return Problem("p", "d", goal=(formula,))


def effect(formula: f.Formula) -> Domain:
    return Domain("d", actions=(Action("action", "a", effect=(formula,)),))


BAD = [
    (goal(f.Timed("at noon", FREE)), r"in :goal: 'at noon' is not a time .* over all, at end"),
    (goal(f.Comparison("!=", ONE, TWO)), r"'!=' is not a comparison"),
    (goal(f.Comparison("<", f.Arithmetic("^", ()), TWO)), r"'\^' is not an arithmetic op"),
    (goal(f.Comparison("<", f.Arithmetic("+", (ONE,)), TWO)), r"'\+' of 1 operands"),
    (goal(f.Modal("never", (), (FREE,))), r"'never' is not a modal operator"),
    (goal(f.Modal("within", (), (FREE,))), r"'within' takes 1 numbers and 1 formulas, not 0 and 1"),
    (goal(f.Atom("AND")), r"'AND' cannot name a predicate: the word is reserved"),
    (goal(f.Atom("at", (f.Constant("END"), VALUE))), r"is read as a time"),
    (goal(f.Atom("Increase", (VALUE,))), r"'Increase' of a function's value is read as the"),
    (goal(f.Atom("<=", (f.Constant("a"),))), r"'<=' cannot name a predicate"),
    (goal(f.Forall((f.TypedName("x", ()),), FREE)), r"'x' has no type"),
    (goal(f.Derived("p", (), FREE)), r"a Derived is not part of a formula"),  # type: ignore[arg-type]
    (effect(f.Assign("set", BATTERY, ONE)), r"in action a: 'set' is not an effect on"),
    (Domain("d", types=(f.TypedName("t", ("Either",)),)), r"'t' is of a type called 'either'"),
    (Domain("d", predicates=(Predicate("exists"),)), r"'exists' cannot name a predicate"),
    (Domain("d", derived=(f.Derived("or", (), FREE),)), r"in :derived or: 'or' cannot name"),
    (Domain("d", functions=(Function("f", (), ("Number",)),)), r"a type called 'number'"),
    (Domain("d", actions=(Action("method", "a"),)), r"'method' is not a kind of action"),
    (Domain("d", actions=(Action("action", "a", duration=(FREE,)),)), r"only a durative action"),
    (Domain("d", requirements=("typing",)), r"'typing' is not a requirement; write it ':typing'"),
    (Problem("p", "d", facts=(f.Atom("=", ()),)), r"'=' cannot name a predicate"),
    (Problem("p", "d", facts=(f.Atom("q", (f.Variable("x"),)),)), r"\(q \?x\) is not ground"),
    (Problem("p", "d", timed=(f.TimedLiteral(ONE, GROWS),)), r"'increase' is not a timed"),
    (Problem("p", "d", metric=f.Metric("optimize", ONE)), r"'optimize' is not an optim"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "message"), BAD)
def test_what_could_not_be_read_back_is_refused(document: Domain | Problem, message: str) -> None:
    with pytest.raises(InvalidKnowledgeError, match=message):
        write(document)


def test_only_documents_are_written() -> None:
    with pytest.raises(InvalidKnowledgeError, match="a Domain or Problem, not Atom"):
        write(FREE)  # type: ignore[arg-type]
