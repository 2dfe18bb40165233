"""Reading problems: with their domain, and without."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql.dto import formulas as f
from kant_sql.errors import PddlError
from kant_sql.pddl import Domain, FunctionValue, Problem, read, read_domain, read_problem

DOMAIN = """(define (domain Depot)
  (:requirements :adl :fluents :object-fluents :preferences :timed-initial-literals)
  (:types truck crate - thing thing place - object)
  (:constants Hub - place)
  (:predicates (at ?x - thing ?p - place) (free))
  (:functions (load ?t - truck) (fuel) - number (home ?t - truck) - place)
  (:action a :parameters (?t - truck) :precondition (preference Tidy (at ?t hub))))"""
PROBLEM = """(define (problem P1)
  (:domain DEPOT)
  (:requirements :adl)
  (:objects t1 T2 - truck c - crate quay - place)
  (:init (at t1 quay) (AT t2 HUB) (free)
         (= (load t1) 2.50) (= (fuel) -3) (= (HOME t2) hub)
         (not (at c quay)) (= t1 t2) (not (= t1 c))
         (at 10 (at c quay)) (at 2.5 (not (free))) (at 3 (= (fuel) 7)))
  (:goal (and (at c hub) (preference Late (forall (?x - crate) (at ?x (home t1))))))
  (:constraints (and (preference late (sometime (free))) (at end (free))))
  (:metric MINIMIZE (+ (* 2 (is-violated LATE)) (is-violated tidy) (total-time) (fuel))))"""
T1, T2, C, QUAY, HUB = (f.Constant(name) for name in ("t1", "T2", "c", "quay", "Hub"))
FREE = f.Atom("free")


def number(text: str) -> f.Number:
    return f.Number(Decimal(text))


@pytest.fixture(scope="module")
def domain() -> Domain:
    return read_domain(DOMAIN, strict=True)


def problem(init: str, goal: str = "(and)", more: str = "", objects: str = "") -> str:
    return f"(define (problem p) (:domain depot) {objects} (:init {init}) (:goal {goal}) {more})"


def test_everything(domain: Domain) -> None:
    assert read_problem(PROBLEM, domain=domain, strict=True) == Problem(
        name="P1",
        domain="Depot",
        requirements=(":adl",),
        objects=(
            f.TypedName("t1", ("truck",)),
            f.TypedName("T2", ("truck",)),
            f.TypedName("c", ("crate",)),
            f.TypedName("quay", ("place",)),
        ),
        facts=(f.Atom("at", (T1, QUAY)), f.Atom("at", (T2, HUB)), FREE),
        values=(
            FunctionValue(f.Fluent("load", (T1,)), number("2.50")),
            FunctionValue(f.Fluent("fuel"), number("-3")),
            FunctionValue(f.Fluent("home", (T2,)), HUB),
        ),
        literals=(f.Not(f.Atom("at", (C, QUAY))), f.Equal(T1, T2), f.Not(f.Equal(T1, C))),
        timed=(
            f.TimedLiteral(number("10"), f.Atom("at", (C, QUAY))),
            f.TimedLiteral(number("2.5"), f.Not(FREE)),
            f.TimedLiteral(number("3"), f.Assign("assign", f.Fluent("fuel"), number("7"))),
        ),
        goal=(
            f.Atom("at", (C, HUB)),
            f.Preference(
                "Late",
                f.Forall(
                    (f.TypedName("x", ("crate",)),),
                    f.Atom("at", (f.Variable("x"), f.Fluent("home", (T1,)))),
                ),
            ),
        ),
        constraints=(
            f.Preference("late", f.Modal("sometime", (), (FREE,))),
            f.Timed("at end", FREE),
        ),
        metric=f.Metric(
            "minimize",
            f.Arithmetic(
                "+",
                (
                    f.Arithmetic("*", (number("2"), f.IsViolated("Late"))),
                    f.IsViolated("Tidy"),
                    f.Fluent("total-time"),
                    f.Fluent("fuel"),
                ),
            ),
        ),
    )


def test_without_the_domain_names_are_guessed_by_their_place() -> None:
    found = read_problem(PROBLEM, strict=True)
    assert found.domain == "DEPOT"
    hub = f.Constant("HUB")
    assert found.facts == (f.Atom("at", (T1, QUAY)), f.Atom("at", (T2, hub)), FREE)
    assert found.values == (
        FunctionValue(f.Fluent("load", (T1,)), number("2.50")),
        FunctionValue(f.Fluent("fuel"), number("-3")),
        FunctionValue(f.Fluent("HOME", (T2,)), hub),
    )
    assert found.literals == (
        f.Not(f.Atom("at", (C, QUAY))),
        f.Equal(T1, T2),
        f.Not(f.Equal(T1, C)),
    )
    assert len(found.timed) == 3
    assert found.metric is not None


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ("(= (f) 3)", f.Comparison("=", f.Fluent("f"), number("3"))),
        ("(= (f) a)", f.Equal(f.Fluent("f"), f.Constant("a"))),
        ("(= a (f))", f.Equal(f.Constant("a"), f.Fluent("f"))),
        (
            "(= (f) (+ (g) 1))",
            f.Comparison("=", f.Fluent("f"), f.Arithmetic("+", (f.Fluent("g"), number("1")))),
        ),
        ("(p (f a) b)", f.Atom("p", (f.Fluent("f", (f.Constant("a"),)), f.Constant("b")))),
        ("(preference a b)", f.Atom("preference", (f.Constant("a"), f.Constant("b")))),
        ("(preference a (p))", f.Preference("a", f.Atom("p"))),
        ("(within a)", f.Atom("within", (f.Constant("a"),))),
    ],
)
def test_without_the_domain_equations_are_guessed(goal: str, expected: object) -> None:
    assert read_problem(problem("", goal)).goal == (expected,)


def test_predicates_of_changing_arity_without_the_domain() -> None:
    found = read_problem(problem("(p a b) (p b a) (p) (p a) (p a b c) (p b b)"))
    assert [len(fact.terms) for fact in found.facts] == [2, 2, 0, 1, 3, 2]


def test_values_without_the_domain() -> None:
    found = read_problem(problem("(= (f a) 1) (= (f b) 2) (= (f) 3) (= (f a b) 4) (= (g a) b)"))
    assert [str(one.value) for one in found.values] == ["1", "2", "3", "4", "b"]


@pytest.mark.parametrize("bare", ["total-time", "(total-time)", "Total-Time"])
def test_total_time(domain: Domain, bare: str) -> None:
    found = read_problem(problem("", more=f"(:metric maximize {bare})"), domain=domain, strict=True)
    assert found.metric == f.Metric("maximize", f.Fluent("total-time"))


@pytest.mark.parametrize("name", ["10", "-1", "+1.5", "1e3", ".5", "#t", "#T", "-a", "--"])
def test_numbers_and_what_begins_with_a_dash_name_no_objects(domain: Domain, name: str) -> None:
    with pytest.raises(PddlError):
        read_problem(problem("", objects=f"(:objects {name} - crate)"), domain=domain)
    with pytest.raises(PddlError):
        read_domain(f"(define (domain d) (:types {name} - object))")
    with pytest.raises(PddlError):
        read_domain(f"(define (domain d) (:constants a - {name}))")


def test_names_may_begin_with_digits(domain: Domain) -> None:
    text = problem("(at 10-1 2b)", objects="(:objects 10-1 - crate 2b - place)")
    found = read_problem(text, domain=domain)
    assert found.facts == (f.Atom("at", (f.Constant("10-1"), f.Constant("2b"))),)


def test_at_is_a_time_before_a_parenthesis(domain: Domain) -> None:
    found = read_problem(
        problem("(at 10 (free)) (at 10.5 (at c hub))", objects="(:objects c - crate)"),
        domain=domain,
    )
    assert len(found.timed) == 2
    assert found.facts == ()


def test_many_facts_in_several_blocks(domain: Domain) -> None:
    objects = "(:objects " + " ".join(f"t{n}" for n in range(500)) + " - truck q - place)"
    facts = [f"(at t{n} {'q' if m else 'HUB'})" for n in range(500) for m in (0, 1)]
    values = [f"(= (load t{n}) {n}.5)" for n in range(500)]
    both = [*facts, *values]
    init = "\n ; a comment (\n".join(both * 2)
    found = read_problem(problem(init, objects=objects), domain=domain)
    assert [str(fact) for fact in found.facts] == [fact.replace("HUB", "Hub") for fact in facts]
    assert [f"(= {one.fluent} {one.value})" for one in found.values] == values
    assert len(found.warnings) == 1500
    lines = [warning.line for warning in found.warnings]
    assert lines == [2 * (1500 + n) + 1 for n in range(1500)]


def test_a_fault_in_a_late_block_has_its_place(domain: Domain) -> None:
    init = "\n".join(["(free)", *(f"(= (load t{n}) {n})" for n in range(9000)), "(at t1  nowhere)"])
    objects = "(:objects " + " ".join(f"t{n}" for n in range(9000)) + " - truck)"
    with pytest.raises(PddlError) as refused:
        read_problem(problem(init, objects=objects), domain=domain)
    assert (refused.value.line, refused.value.column) == (9002, 9)


def test_several_initial_states_are_one(domain: Domain) -> None:
    text = problem("(free)").replace("(:goal", "(:init (free) (at 3 (free))) (:goal")
    found = read_problem(text, domain=domain)
    assert found.facts == (FREE,)
    assert len(found.timed) == 1
    assert ["once" in warning.message for warning in found.warnings] == [True, True]


def test_read_gives_all_of_a_source() -> None:
    found = read(f"{PROBLEM}\n{DOMAIN}\n{PROBLEM}".replace("(problem P1)", "(problem p2)", 1))
    assert [type(document) for document in found] == [Problem, Domain, Problem]
    assert [document.name for document in found] == ["p2", "Depot", "P1"]
    assert found[2] == read_problem(PROBLEM, domain=read_domain(DOMAIN))
    assert [document.warnings for document in found] == [(), (), ()]


def test_read_checks_a_problem_against_the_domain_beside_it() -> None:
    with pytest.raises(PddlError, match="the predicate 'nope'"):
        read(f"{DOMAIN}{problem('(nope)')}")
    with pytest.raises(PddlError, match="each domain once"):
        read(f"{DOMAIN}{DOMAIN}")


def test_a_source_with_both_serves_both_readers() -> None:
    both = f"{DOMAIN}\n{PROBLEM}"
    domain = read_domain(both)
    assert domain == read_domain(DOMAIN)
    assert [warning.line for warning in domain.warnings] == [8]
    assert read_problem(both, domain=domain) == read_problem(PROBLEM, domain=domain)
    with pytest.raises(PddlError, match="expected a problem alone"):
        read_problem(both, domain=domain, strict=True)
