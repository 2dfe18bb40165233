"""Documents are written in one layout, and what text cannot carry is refused."""

from __future__ import annotations

import sys
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import HealthCheck, given, settings

from kant_sql.dto.formula import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Fluent,
    Forall,
    Formula,
    IsViolated,
    Metric,
    Modal,
    Not,
    Number,
    Preference,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
)
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from kant_sql.pddl.node_text import MAX_DEPTH, node_text
from kant_sql.pddl.walk import depth, walk
from kant_sql.pddl.writer import write, write_problem
from tests.documents import domains_and_problems

ROBOT, WP = ("robot",), ("wp",)
R, FROM, TO = TypedName("r", ROBOT), TypedName("from", WP), TypedName("to", WP)
FREE = Atom("free")
BATTERY = Fluent("battery", (Variable("r"),))
GROWS = Assign("increase", BATTERY, Number(Decimal(1)))
HOLDS = Preference("p1", Atom("robot_at", (Constant("rb1"), Constant("wp2"))))


def number(text: str) -> Number:
    return Number(Decimal(text))


def domain() -> Domain:
    move = Action(
        "durative-action",
        "move",
        (R, FROM, TO),
        (Comparison("=", Variable("duration"), number("10")),),
        (Timed("at start", Atom("robot_at", (Variable("r"), Variable("from")))),),
        (
            Timed("at end", Not(FREE)),
            Assign("decrease", BATTERY, Arithmetic("*", (ContinuousTime(), number("0.50")))),
        ),
    )
    wait = Action("action", "wait", effect=(When(FREE, Not(FREE)),))
    return Domain(
        "Tiago",
        (":typing", ":fluents"),
        (TypedName("robot"), TypedName("door", WP), TypedName("window", WP), TypedName("wp")),
        (TypedName("d1", ("door",)), TypedName("d2", ("door",)), TypedName("w", ("robot", "wp"))),
        (Predicate("robot_at", (R, TypedName("r", WP))), Predicate("free")),
        (
            Function("battery", (R,)),
            Function("home", (R,), WP),
            Function("total-cost"),
        ),
        (Modal("always", (), (FREE,)),),
        (Derived("free", (), And()),),
        (move, wait),
    )


def problem() -> Problem:
    rb1, wp2 = Constant("rb1"), Constant("wp2")
    battery = Fluent("battery", (rb1,))
    return Problem(
        "P",
        "Tiago",
        (),
        (TypedName("rb1", ROBOT), TypedName("wp2", WP), TypedName("thing")),
        (Atom("robot_at", (rb1, wp2)), FREE),
        (Not(FREE), Equal(rb1, rb1)),
        (FunctionValue(battery, number("-1.50")), FunctionValue(Fluent("home", (rb1,)), wp2)),
        (
            TimedLiteral(number("5"), Not(FREE)),
            TimedLiteral(number("6"), Assign("assign", battery, number("1E+2"))),
        ),
        (FREE, HOLDS),
        (Timed("at end", FREE),),
        Metric("minimize", IsViolated("p1")),
    )


def test_the_layout_of_a_domain() -> None:
    assert (
        write(domain())
        == """\
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
    )


def test_the_layout_of_a_problem() -> None:
    assert (
        write(problem())
        == """\
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
    (not (free))
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
    )


def test_an_empty_document_has_what_the_standard_requires() -> None:
    assert write(Domain("d")) == "(define (domain d)\n)\n"
    assert write(Problem("p", "d")) == (
        "(define (problem p)\n  (:domain d)\n  (:init\n  )\n  (:goal (and))\n)\n"
    )


@pytest.mark.parametrize(
    ("constraints", "text"),
    [
        ((), ":duration (and)"),
        ((And(),), ":duration (and\n      (and)\n    )"),
        ((Comparison("<=", Variable("duration"), number("5")),), ":duration (<= ?duration 5)"),
    ],
)
def test_a_duration_reads_back_with_as_many_conjuncts(
    constraints: tuple[Formula, ...], text: str
) -> None:
    action = Action("durative-action", "a", duration=constraints)
    assert f"    {text}\n" in write(Domain("d", actions=(action,)))


def test_processes_and_events_have_preconditions() -> None:
    for kind in ("process", "event"):
        text = write(Domain("d", actions=(Action(kind, "a"),)))
        assert f"  (:{kind} a\n    :parameters ()\n    :precondition (and)\n" in text


def test_long_lists_are_broken_into_lines() -> None:
    objects = tuple(TypedName(f"object-number-{i}", ROBOT) for i in range(200))
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
    given_ = write_problem(replace(problem(), facts=()), facts)
    assert given_ == write(replace(problem(), facts=(FREE, problem().facts[0])))


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
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


def nested(levels: int) -> Formula:
    formula: Formula = FREE
    for _ in range(levels):
        formula = Not(formula)
    return formula


def test_nesting_is_bounded_by_the_reader_and_not_by_the_interpreter() -> None:
    assert depth(nested(5000)) == 5001
    assert sum(1 for _ in walk(nested(5000))) == 5001
    deepest = Problem("p", "d", goal=(nested(MAX_DEPTH - 1),))
    limit = sys.getrecursionlimit()
    frames = 0
    frame = sys._getframe()
    while frame.f_back is not None:
        frame, frames = frame.f_back, frames + 1
    try:
        sys.setrecursionlimit(frames + 60)
        text = write(deepest)
    finally:
        sys.setrecursionlimit(limit)
    assert text.count("(not ") == MAX_DEPTH - 1
    with pytest.raises(InvalidKnowledgeError, match=r"in :goal: nested more than 250 deep"):
        write(Problem("p", "d", goal=(nested(MAX_DEPTH),)))
    with pytest.raises(InvalidKnowledgeError, match=r"nested more than 250 deep"):
        write(Problem("p", "d", goal=(nested(100_000),)))


def goal(formula: Formula) -> Problem:
    return Problem("p", "d", goal=(formula,))


def effect(formula: Formula) -> Domain:
    return Domain("d", actions=(Action("action", "a", effect=(formula,)),))


BAD = [
    (goal(Timed("at noon", FREE)), r"in :goal: 'at noon' is no time .* at start, over all, at end"),
    (goal(Comparison("!=", number("1"), number("2"))), r"'!=' is no comparison"),
    (goal(Comparison("<", Arithmetic("^", ()), number("2"))), r"'\^' is no arithmetic operator"),
    (goal(Comparison("<", Arithmetic("+", (number("1"),)), number("2"))), r"'\+' of 1 operands"),
    (goal(Comparison("<", number("NaN"), number("2"))), r"NaN is no number that PDDL"),
    (goal(Comparison("<", number("-Infinity"), number("2"))), r"-Infinity is no number"),
    (goal(Comparison("<", number("1E+999999999"), number("2"))), r"at most 400 digits"),
    (goal(Comparison("<", number("1E-999999999"), number("2"))), r"at most 400 digits"),
    (goal(Modal("never", (), (FREE,))), r"'never' is no modal operator"),
    (goal(Modal("within", (), (FREE,))), r"'within' takes 1 numbers and 1 formulas, not 0 and 1"),
    (goal(Atom("AND")), r"'AND' cannot name a predicate: the word is reserved"),
    (goal(Atom("at", (Constant("END"), Fluent("f")))), r"is read as a time"),
    (goal(Atom("Increase", (Fluent("f"),))), r"'Increase' of a function's value is read as the"),
    (goal(Atom("<=", (Constant("a"),))), r"'<=' cannot name a predicate"),
    (goal(Forall((TypedName("x", ()),), FREE)), r"'x' has no type"),
    (goal(Derived("p", (), FREE)), r"a Derived is no part of a formula"),  # type: ignore[arg-type]
    (effect(Assign("set", BATTERY, number("1"))), r"in action a: 'set' is no effect on a fluent"),
    (Domain("d", types=(TypedName("t", ("Either",)),)), r"'t' is of a type called 'either'"),
    (Domain("d", predicates=(Predicate("exists"),)), r"'exists' cannot name a predicate"),
    (Domain("d", derived=(Derived("or", (), FREE),)), r"in :derived or: 'or' cannot name"),
    (Domain("d", functions=(Function("f", (), ("Number",)),)), r"a type called 'number'"),
    (Domain("d", actions=(Action("method", "a"),)), r"'method' is no kind of action"),
    (Domain("d", actions=(Action("action", "a", duration=(FREE,)),)), r"only a durative action"),
    (Domain("d", requirements=("typing",)), r"'typing' is no requirement; write it ':typing'"),
    (Problem("p", "d", facts=(Atom("=", ()),)), r"'=' cannot name a predicate"),
    (Problem("p", "d", facts=(Atom("q", (Variable("x"),)),)), r"\(q \?x\) is not ground"),
    (Problem("p", "d", timed=(TimedLiteral(number("1"), GROWS),)), r"'increase' is no timed"),
    (Problem("p", "d", metric=Metric("optimize", number("1"))), r"'optimize' is no optimization"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "message"), BAD)
def test_what_could_not_be_read_back_is_refused(document: Domain | Problem, message: str) -> None:
    with pytest.raises(InvalidKnowledgeError, match=message):
        write(document)


def test_only_documents_are_written() -> None:
    with pytest.raises(InvalidKnowledgeError, match="a Domain or a Problem, not Atom"):
        write(FREE)  # type: ignore[arg-type]
