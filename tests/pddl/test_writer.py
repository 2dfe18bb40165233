"""Documents are written in one layout, and what text cannot carry is refused."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given

from kant_sql.dto import formulas as f
from kant_sql.pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from kant_sql.pddl.writer import node_text, write, write_problem
from tests.support.generators.documents import domains_and_problems
from tests.support.profile import PROFILE, hunting

ROBOT, WP = ("robot",), ("wp",)
R, FROM, TO = f.TypedName("r", ROBOT), f.TypedName("from", WP), f.TypedName("to", WP)
FREE = f.Atom("free")
BATTERY = f.Fluent("battery", (f.Variable("r"),))
GROWS = f.Assign("increase", BATTERY, f.Number(Decimal(1)))
HOLDS = f.Preference("p1", f.Atom("robot_at", (f.Constant("rb1"), f.Constant("wp2"))))


def number(text: str) -> f.Number:
    return f.Number(Decimal(text))


def domain() -> Domain:
    move = Action(
        "durative-action",
        "move",
        (R, FROM, TO),
        (f.Comparison("=", f.Variable("duration"), number("10")),),
        (f.Timed("at start", f.Atom("robot_at", (f.Variable("r"), f.Variable("from")))),),
        (
            f.Timed("at end", f.Not(FREE)),
            f.Assign("decrease", BATTERY, f.Arithmetic("*", (f.ContinuousTime(), number("0.50")))),
        ),
    )
    wait = Action("action", "wait", effect=(f.When(FREE, f.Not(FREE)),))
    return Domain(
        "Tiago",
        (":typing", ":fluents"),
        (
            f.TypedName("robot"),
            f.TypedName("door", WP),
            f.TypedName("window", WP),
            f.TypedName("wp"),
        ),
        (
            f.TypedName("d1", ("door",)),
            f.TypedName("d2", ("door",)),
            f.TypedName("w", ("robot", "wp")),
        ),
        (Predicate("robot_at", (R, f.TypedName("r", WP))), Predicate("free")),
        (
            Function("battery", (R,)),
            Function("home", (R,), WP),
            Function("total-cost"),
        ),
        (f.Modal("always", (), (FREE,)),),
        (f.Derived("free", (), f.And()),),
        (move, wait),
    )


def problem() -> Problem:
    rb1, wp2 = f.Constant("rb1"), f.Constant("wp2")
    battery = f.Fluent("battery", (rb1,))
    return Problem(
        "P",
        "Tiago",
        (),
        (f.TypedName("rb1", ROBOT), f.TypedName("wp2", WP), f.TypedName("thing")),
        (f.Atom("robot_at", (rb1, wp2)), FREE),
        (f.Not(f.Atom("robot_at", (rb1, rb1))), f.Equal(rb1, rb1)),
        (FunctionValue(battery, number("-1.50")), FunctionValue(f.Fluent("home", (rb1,)), wp2)),
        (
            f.TimedLiteral(number("5"), f.Not(FREE)),
            f.TimedLiteral(number("6"), f.Assign("assign", battery, number("1E+2"))),
        ),
        (FREE, HOLDS),
        (f.Timed("at end", FREE),),
        f.Metric("minimize", f.IsViolated("p1")),
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
    given_ = write_problem(replace(problem(), facts=()), facts)
    assert given_ == write(replace(problem(), facts=(FREE, problem().facts[0])))


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
