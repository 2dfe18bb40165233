"""What violates the standard and is read all the same: with a warning, unless reading is strict."""

from __future__ import annotations

from pathlib import Path

import pytest

from kant_sql.errors import PddlError
from kant_sql.pddl import Domain, Problem, read, read_domain, read_problem

HEAD = """(define (domain d) (:requirements :adl :fluents :durative-actions)
(:types a b - t t) (:constants k - a)
(:predicates (p ?x - a) (q ?x ?y) (r))
(:functions (f ?x - a) (g) - number)
"""
DOMAIN = read_domain(f"{HEAD})", strict=True)


ODD = "(:action e :parameters (?z -a))"


def domain(text: str) -> Domain:
    return read_domain(text)


def problem(text: str) -> Problem:
    return read_problem(text, domain=DOMAIN)


@pytest.mark.parametrize(
    ("body", "column", "message", "standard"),
    [
        ("(:constants z -a)", 15, "found '-a', expected '- a'", "(:constants z - a)"),
        ("(:constants - b z - a)", 13, "expected a name before the type", "(:constants z - a)"),
        ("(:constants z - (a))", 17, "expected a type or (either ...)", "(:constants z - a)"),
        (
            "(:constants z - (either a (either b)))",
            27,
            "found '(either', expected a type",
            "(:constants z - (either a b))",
        ),
        ("(:constants z z - a)", 15, "found the constant 'z' again", "(:constants z - a)"),
        (
            "(:constants z - a z - b)",
            19,
            "expected each constant once; read as (either a b)",
            "(:constants z - (either a b))",
        ),
        ("(:constants z - e)", 17, "found the type 'e'", "(:types e) (:constants z - e)"),
        ("(:types e - t e)", 15, "found the type 'e' again", "(:types e - t)"),
        ("(:types e - t e - t)", 15, "found the type 'e' again", "(:types e - t)"),
        ("(:types e - t object)", 15, "no declaration of object", "(:types e - t)"),
        ("(:objects z - a)", 1, "found '(:objects', expected '(:constants'", "(:constants z - a)"),
        ("(:predicates (= ?x ?y))", 14, "expected no declaration of =", ""),
        ("(:predicates (p ?y - a))", 15, "found 'p' again, expected each predicate once", ""),
        ("(:functions (g))", 14, "found 'g' again, expected each function once", ""),
        ("(:requirements typing)", 16, "found 'typing', expected ':typing'", None),
        ("(:requirements :adl)", 1, "expected (:requirements ...) once", ""),
        ("(:requirements :typng)", 16, "':typng', expected a known requirement; kept (did", None),
        (
            "(:action e :precondition (r))",
            10,
            "found action e without parameters",
            "(:action e :parameters () :precondition (r))",
        ),
        (
            "(:action e :parameters () :condition (r))",
            27,
            "found ':condition', expected :precondition",
            "(:action e :parameters () :precondition (r))",
        ),
        (
            "(:durative-action e :parameters () :duration (= ?duration 2) :condition (and) "
            ":effect (at end (when (r) (p k))))",
            95,
            "found '(when', expected (when ...) around (at start ...) or (at end ...)",
            None,
        ),
        (
            "(:action e :parameters () :precondition (r) (r))",
            45,
            "expected one formula: (and ...)",
            "(:action e :parameters () :precondition (and (r) (r)))",
        ),
        (
            "(:action e :parameters (?x - a) :vars (?z) :precondition (q ?x ?z))",
            33,
            "found ':vars', expected variables in :parameters",
            "(:action e :parameters (?x - a ?z) :precondition (q ?x ?z))",
        ),
        (
            "(:action e :parameters () :precondition (and ()))",
            46,
            "found '()', expected a formula",
            None,
        ),
        (
            "(:action e :parameters (?z) :precondition (p ?z))",
            46,
            "found ?z of type object, expected a as argument 1 of p; it may be one",
            None,
        ),
        (
            "(:action e :parameters () :effect (increase g .5))",
            45,
            "found 'g', expected '(g)'",
            "(:action e :parameters () :effect (increase (g) 0.5))",
        ),
        (
            "(:action e :parameters () :effect (increase (g) .5))",
            49,
            "found '.5', expected '0.5'",
            "(:action e :parameters () :effect (increase (g) 0.5))",
        ),
        (
            "(:action e :parameters () :effect (increase (g) 12e-1))",
            49,
            "found '12e-1', expected '1.2'",
            "(:action e :parameters () :effect (increase (g) 1.2))",
        ),
        (
            "(:action e :parameters () :effect (increase (g) (- 1 2 3)))",
            49,
            "expected two operands of -; read from the left",
            "(:action e :parameters () :effect (increase (g) (- (- 1 2) 3)))",
        ),
        (
            "(:action e :parameters () :effect (increase (total-cost) 3))",
            46,
            "expected the declaration of total-cost",
            "(:functions (total-cost)) "
            "(:action e :parameters () :effect (increase (total-cost) 3))",
        ),
        (
            "(:action e :parameters ()) (:action E :parameters ())",
            37,
            "found 'E' again, expected each action once",
            "(:action e :parameters ())",
        ),
        ("(:action p :parameters ())", 10, "found the action p, which is named like a predi", None),
        ("(:constants t - a)", 13, "found the constant t, which is named like a type", None),
        ("(:predicates (t))", 15, "found the predicate t, which is named like a type", None),
        ("(:functions (p))", 14, "found the function p, which is named like a predicate", None),
        ("(:predicates (s ?x ?X))", 20, "found the parameter '?X' again", None),
        ("(:predicates (1st))", 15, "found '1st', expected a predicate of a letter", None),
        ("(:predicates (s ?1))", 17, "found '?1', expected a variable of a letter", None),
        (
            "(:durative-action e :parameters () :effect (at end (r)))",
            19,
            "expected a :duration",
            "(:durative-action e :parameters () :duration () :effect (at end (r)))",
        ),
        (
            "(:durative-action e :parameters () :duration (< ?duration 3))",
            46,
            "expected (<= ?duration ...)",
            None,
        ),
        (
            "(:durative-action e :parameters () :duration () :condition (not (at end (r))))",
            60,
            "instead of (not ...)",
            None,
        ),
        (
            "(:derived (s ?x - a) (p ?x))",
            12,
            "expected its declaration in :predicates",
            "(:predicates (s ?x - a)) (:derived (s ?x - a) (p ?x))",
        ),
        (
            "(:derived (r) (q k k)) (:derived (R) (q k  k))",
            35,
            "again, expected each rule once",
            "(:derived (r) (q k k))",
        ),
        ("(:constraints (or (always (r))))", 15, "instead of (or ...)", None),
    ],
)
def test_domains(body: str, column: int, message: str, standard: str | None) -> None:
    text = f"{HEAD}{body})"
    found = domain(text)
    places = [(one.line, one.column) for one in found.warnings if message in one.message]
    assert places == [(5, column)], found.warnings
    assert {one.source for one in found.warnings} == {"<string>"}
    with pytest.raises(PddlError):
        read_domain(text, strict=True)
    if standard is not None:
        assert found == read_domain(f"{HEAD}{standard})")


@pytest.mark.parametrize(
    ("body", "column", "message", "standard"),
    [
        ("(:init (r) (R))", 12, "found (r) again, expected each fact once", "(:init (r))"),
        ("(:init (p k) (p K))", 14, "found (p k) again", "(:init (p k))"),
        ("(:init (= (g) 1) (= (g) 1.0))", 18, "expected each value once", "(:init (= (g) 1))"),
        ("(:init (at 1 (r)) (at 1 (r)))", 19, "timed literal once", "(:init (at 1 (r)))"),
        ("(:init (at 1 (r)) (at 1.0 (not (r))))", 19, "one of the two; (r) holds then", None),
        ("(:init (at 1 (not (r))) (at 1 (r)))", 25, "one of the two; (r) holds then", None),
        ("(:init (at 1 (= (g) 1)) (at 1 (= (g) 2)))", 25, "the last one holds", None),
        ("(:init (and (r) (p k)))", 8, "expected facts without (and ...)", "(:init (r) (p k))"),
        ("(:init (= g 1))", 11, "found 'g', expected '(g)'", "(:init (= (g) 1))"),
        ("(:init (= (total-cost) 0))", 12, "expected the declaration of total-cost", None),
        ("(:goal ())", 1, "found '(:goal)', expected '(and)'", "(:goal (and))"),
        ("(:goal)", 1, "found '(:goal)', expected '(and)'", "(:goal (and))"),
        ("(:goal (r) (p k))", 12, "expected one formula", "(:goal (and (r) (p k)))"),
        ("(:objects k - a)", 11, "found the constant 'k' again", ""),
        ("(:objects z z - a)", 13, "found the object 'z' again", "(:objects z - a)"),
        ("(:objects t - a)", 11, "found the object t, which is named like a type", None),
        ("(:constants z - a)", 1, "found '(:constants', expected '(:objects'", "(:objects z - a)"),
        ("(:length (:serial 3) (:parallel 4))", 1, "expected no (:length ...)", ""),
        ("(:metric minimize g)", 19, "found 'g', expected '(g)'", "(:metric minimize (g))"),
        ("(:metric minimize (is-violated n))", 32, "found the preference 'n'", None),
        ("(:metric minimize (g)) (:goal (r))", 24, "expected it before (:metric", None),
    ],
)
def test_problems(body: str, column: int, message: str, standard: str | None) -> None:
    head = "(define (problem s) (:domain d)\n"
    found = problem(f"{head}{body})")
    places = [(one.line, one.column) for one in found.warnings if message in one.message]
    assert places == [(2, column)], found.warnings
    with pytest.raises(PddlError):
        read_problem(f"{head}{body})", domain=DOMAIN, strict=True)
    if standard is not None:
        assert found == problem(f"{head}{standard})")


def test_what_is_missing() -> None:
    found = problem("(define (problem s) (:domain d))")
    assert [str(warning) for warning in found.warnings] == [
        "<string>:1:1: warning: in problem s: found no initial state, expected (:init ...); "
        "read as (:init)",
        "<string>:1:1: warning: in problem s: found no goal, expected (:goal ...); "
        "read as (:goal (and))",
    ]


def test_requirements_are_missed_once_and_only_when_something_needs_them() -> None:
    strips = "(define (domain d) (:predicates (p ?x)) (:action a :parameters (?x) :effect (p ?x)))"
    assert read_domain(strips, strict=True).warnings == ()
    typed = strips.replace("(?x)", "(?x - t)").replace("(domain d)", "(domain d) (:types t)")
    [warning] = read_domain(typed).warnings
    assert warning[:3] == ("<string>", 1, 1)
    assert "found no requirements, expected (:requirements :typing)" in warning.message


def test_sections_in_any_order() -> None:
    text = """(define (domain d)
      (:action e :parameters (?x - a) :precondition (p ?x k))
      (:predicates (p ?x ?y - t))
      (:constants k - a)
      (:types a - t t)
      (:requirements :typing))"""
    found = domain(text)
    assert [warning.line for warning in found.warnings] == [3, 4, 5, 6]
    first, *others, last = text.splitlines()
    ordered = "\n".join([first, last[:-1], *reversed(others), ")"])
    assert found == read_domain(ordered, strict=True)


def test_forms_that_are_no_definitions_are_left_out() -> None:
    text = f'(in-package "PDDL") {HEAD}) (load "x" (y))\n)'
    found = domain(text)
    assert found == DOMAIN
    assert [(one.line, one.column) for one in found.warnings] == [(1, 1), (5, 3), (6, 1)]
    with pytest.raises(PddlError, match=r"1:1: found '\(in-package', expected \(define"):
        read_domain(text, strict=True)


def test_a_comment_in_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "d.pddl"
    path.write_bytes(f"{HEAD}); caf".encode() + b"\xe9")
    [warning] = read_domain(path).warnings
    assert warning[:3] == (str(path), 5, 7)
    with pytest.raises(PddlError):
        read_domain(path, strict=True)


def test_warnings_of_several_sources_are_in_their_order(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("z.pddl", "a.pddl")]
    for path in paths:
        path.write_text(f"{HEAD}{ODD}\n{ODD})")
    found = read_domain(*paths).warnings
    places = [(Path(one.source).name, one.line) for one in found]
    assert places == [("z.pddl", 5), ("z.pddl", 6), ("z.pddl", 6), ("a.pddl", 5), ("a.pddl", 6)]


def test_warnings_belong_to_their_document() -> None:
    state = "(define (problem s) (:domain d) (:init (r) (r)) (:goal (and)))"
    first, second = read(f"(x) {HEAD}{ODD})\n{state}")
    assert [one.line for one in first.warnings] == [1, 5]
    assert [one.line for one in second.warnings] == [6]


def test_warnings_do_not_count_in_a_comparison() -> None:
    assert domain(f"{HEAD}(:constants z -a))") == domain(f"{HEAD}(:constants z - a))")


def test_a_name_is_noted_once() -> None:
    text = f"{HEAD}(:action e :parameters (?1) :precondition (and (q ?1 ?1) (exists (?1) (r)))))"
    assert len(domain(text).warnings) == 1
