"""The requirements that are really used, construct by construct."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest

from kant_sql.dto.formulas import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Exists,
    Expression,
    Fluent,
    Forall,
    Formula,
    Imply,
    IsViolated,
    Metric,
    Modal,
    Not,
    Number,
    Or,
    Preference,
    Term,
    Timed,
    TimedLiteral,
    TypedName,
    Variable,
    When,
)
from kant_sql.pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from kant_sql.pddl.requirements import REQUIREMENTS, used_requirements

X, A = Variable("x"), Constant("a")
P, Q = Atom("p"), Atom("q")
ALL = (TypedName("x"),)
COST, TIME, FUEL = Fluent("total-cost"), Fluent("total-time"), Fluent("fuel")
DURATION = Variable("duration")
FUNCTIONS = (Function("total-cost"), Function("fuel"), Function("dist", ALL))


def number(value: str | int) -> Number:
    return Number(Decimal(value))


def acting(
    condition: tuple[Formula, ...] = (),
    effect: tuple[Formula, ...] = (),
    kind: str = "action",
    duration: tuple[Formula, ...] = (),
    functions: tuple[Function, ...] = (),
) -> Domain:
    action = Action(kind, "a", (), duration, condition, effect)
    return Domain("d", functions=functions, actions=(action,))


def durative(*duration: Formula, effect: tuple[Formula, ...] = ()) -> Domain:
    return acting((), effect, "durative-action", duration)


def fixed(value: Expression) -> Formula:
    return Comparison("=", DURATION, value)


CONDITIONS: list[tuple[Formula, str]] = [
    (And((P, Q)), ""),
    (Not(P), ":negative-preconditions"),
    (Not(Equal(X, A)), ":negative-preconditions :equality"),
    (Not(And((P, Q))), ":disjunctive-preconditions"),
    (Not(Not(P)), ":negative-preconditions :disjunctive-preconditions"),
    (Or((P,)), ":disjunctive-preconditions"),
    (Imply(P, Q), ":disjunctive-preconditions"),
    (Equal(X, A), ":equality"),
    (Exists(ALL, P), ":existential-preconditions"),
    (Forall(ALL, P), ":universal-preconditions"),
    (Forall((TypedName("x", ("t",)),), P), ":typing :universal-preconditions"),
    (Comparison("<", FUEL, number(1)), ":numeric-fluents"),
    (Equal(Fluent("place", (X,)), A), ":equality :object-fluents"),
    (Atom("p", (Fluent("place", (X,)),)), ":object-fluents"),
    (Preference(None, Not(P)), ":negative-preconditions :preferences"),
]


@pytest.mark.parametrize(("condition", "used"), CONDITIONS)
def test_conditions_goals_and_rules(condition: Formula, used: str) -> None:
    expected = (":strips", *used.split())
    assert used_requirements(acting((condition,))) == expected
    assert used_requirements(acting(effect=(When(condition, P),))) == tuple(
        r for r in REQUIREMENTS if r in {*expected, ":conditional-effects"}
    )
    assert used_requirements(Domain("d"), problem=Problem("p", "d", goal=(condition,))) == expected
    assert used_requirements(Domain("d", derived=(Derived("p", (), condition),))) == tuple(
        r for r in REQUIREMENTS if r in {*expected, ":derived-predicates"}
    )


@pytest.mark.parametrize(
    ("domain", "used"),
    [
        (acting(effect=(P, Not(Q), And((P,)))), ""),
        (acting(effect=(Forall(ALL, Not(P)),)), ":conditional-effects"),
        (acting(effect=(When(P, Not(Q)),)), ":conditional-effects"),
        (acting(effect=(Assign("assign", FUEL, number(1)),)), ":numeric-fluents"),
        (
            acting(
                effect=(Assign("assign", Fluent("place"), A),),
                functions=(Function("place", (), ("object",)),),
            ),
            ":object-fluents",
        ),
        (durative(fixed(number(5))), ":durative-actions"),
        (durative(Timed("at start", fixed(number(5)))), ":durative-actions"),
        (durative(fixed(FUEL)), ":numeric-fluents :durative-actions"),
        (durative(fixed(Variable("x"))), ":numeric-fluents :durative-actions"),
        (
            durative(Comparison("<=", DURATION, number(5))),
            ":durative-actions :duration-inequalities",
        ),
        (durative(fixed(number(5)), fixed(number(5))), ":durative-actions :duration-inequalities"),
        (
            durative(effect=(Timed("at end", Assign("increase", FUEL, DURATION)),)),
            ":numeric-fluents :durative-actions :duration-inequalities",
        ),
        (
            durative(effect=(Assign("increase", FUEL, ContinuousTime()),)),
            ":numeric-fluents :durative-actions :continuous-effects",
        ),
        (
            acting((), (Assign("increase", FUEL, ContinuousTime()),), "process"),
            ":numeric-fluents :time",
        ),
        (acting((P,), (Q,), "event"), ":time"),
        (Domain("d", types=ALL), ":typing"),
        (Domain("d", constants=ALL, predicates=(Predicate("p", ALL),)), ""),
        (Domain("d", predicates=(Predicate("p", (TypedName("x", ("t",)),)),)), ":typing"),
        (Domain("d", functions=(Function("f"),)), ":numeric-fluents"),
        (Domain("d", functions=(Function("f", (), ("t",)),)), ":object-fluents"),
    ],
)
def test_domains(domain: Domain, used: str) -> None:
    assert used_requirements(domain) == (":strips", *used.split())


@pytest.mark.parametrize(
    ("constraint", "used"),
    [
        (Modal("always", (), (P,)), ":constraints"),
        (Modal("always", (), (Not(P),)), ":negative-preconditions :constraints"),
        (Forall(ALL, Modal("always", (), (P,))), ":constraints"),
        (Forall(ALL, Timed("at end", P)), ":constraints"),
        (Modal("always", (), (Forall(ALL, P),)), ":universal-preconditions :constraints"),
        (
            Forall(ALL, Preference("n", Modal("sometime", (), (P,)))),
            ":universal-preconditions :preferences :constraints",
        ),
    ],
)
def test_constraints(constraint: Formula, used: str) -> None:
    expected = (":strips", *used.split())
    assert used_requirements(Domain("d", constraints=(constraint,))) == expected
    problem = Problem("p", "d", constraints=(constraint,))
    assert used_requirements(Domain("d"), problem=problem) == expected


@pytest.mark.parametrize(
    ("problem", "used"),
    [
        (Problem("p", "d", facts=(P,), literals=(Not(Q),)), ""),
        (Problem("p", "d", literals=(Equal(A, A),)), ":equality"),
        (Problem("p", "d", objects=(TypedName("a", ("t",)),)), ":typing"),
        (Problem("p", "d", values=(FunctionValue(FUEL, number(1)),)), ":numeric-fluents"),
        (Problem("p", "d", values=(FunctionValue(Fluent("place"), A),)), ":object-fluents"),
        (Problem("p", "d", timed=(TimedLiteral(number(1), Not(P)),)), ":timed-initial-literals"),
        (
            Problem("p", "d", timed=(TimedLiteral(number(1), Assign("assign", FUEL, number(2))),)),
            ":numeric-fluents :timed-initial-literals",
        ),
        (
            Problem("p", "d", timed=(TimedLiteral(number(1), Assign("assign", FUEL, A)),)),
            ":object-fluents :timed-initial-literals",
        ),
        (Problem("p", "d", metric=Metric("minimize", TIME)), ""),
        (Problem("p", "d", metric=Metric("minimize", IsViolated("n"))), ":preferences"),
        (Problem("p", "d", metric=Metric("minimize", FUEL)), ":numeric-fluents"),
    ],
)
def test_problems(problem: Problem, used: str) -> None:
    assert used_requirements(Domain("d"), problem=problem) == (":strips", *used.split())


def costs(value: Expression | Term, fluent: Fluent = COST, operator: str = "increase") -> Domain:
    return acting(effect=(Assign(operator, fluent, value),), functions=FUNCTIONS)


DIST = Fluent("dist", (X,))
START = FunctionValue(COST, number(0))
PRICED = Problem("p", "d", values=(START,), metric=Metric("minimize", COST))
LONG = replace(
    costs(DIST),
    actions=(*costs(DIST).actions, Action("durative-action", "b", (), (fixed(number(5)),))),
)


@pytest.mark.parametrize(
    "domain", [costs(number(0)), costs(number("1.5")), costs(DIST), costs(FUEL), LONG]
)
def test_costs_need_no_numeric_fluents(domain: Domain) -> None:
    assert ":action-costs" in used_requirements(domain)
    assert ":action-costs" in used_requirements(domain, problem=PRICED)
    assert ":numeric-fluents" not in used_requirements(domain, problem=PRICED)
    # Files of the competition leave the beginning out, and planners take 0.
    assert ":action-costs" in used_requirements(domain, problem=replace(PRICED, values=()))


SUM = Arithmetic("+", (COST, Arithmetic("*", (number(2), TIME))))


def test_time_counts_as_a_cost_where_actions_last() -> None:
    both = replace(PRICED, metric=Metric("minimize", SUM))
    assert ":action-costs" in used_requirements(LONG, problem=both)
    assert ":numeric-fluents" in used_requirements(costs(DIST), problem=both)


# What breaks each rule of https://ipc08.icaps-conference.org/deterministic/PddlActionCosts.html.
@pytest.mark.parametrize(
    ("domain", "problem"),
    [
        (replace(costs(DIST), derived=(Derived("p", (), Comparison("<", COST, FUEL)),)), PRICED),
        (costs(DIST), replace(PRICED, goal=(Comparison("<", COST, number(9)),))),
        (costs(DIST, FUEL), PRICED),
        (costs(DIST, Fluent("total-cost", (X,))), PRICED),
        (costs(DIST), replace(PRICED, values=(FunctionValue(COST, number(1)),))),
        (costs(DIST, operator="decrease"), PRICED),
        (costs(DIST, operator="assign"), PRICED),
        (costs(number(-1)), PRICED),
        (costs(COST), PRICED),
        (costs(Arithmetic("+", (DIST, number(1)))), PRICED),
        (costs(Fluent("dist", (Fluent("place"),))), PRICED),
        (costs(DIST), replace(PRICED, values=(START, FunctionValue(FUEL, number(-1))))),
        (costs(DIST), replace(PRICED, metric=Metric("maximize", COST))),
        (costs(DIST), replace(PRICED, metric=Metric("minimize", FUEL))),
        (LONG, replace(PRICED, metric=Metric("minimize", Arithmetic("-", (COST, TIME))))),
        (LONG, replace(PRICED, metric=Metric("minimize", Arithmetic("*", (COST, TIME))))),
        (LONG, replace(PRICED, metric=Metric("minimize", Arithmetic("*", (number(-1), TIME))))),
        (replace(costs(DIST), functions=FUNCTIONS[1:]), PRICED),
    ],
)
def test_other_uses_of_numbers_need_numeric_fluents(domain: Domain, problem: Problem) -> None:
    used = used_requirements(domain, problem=problem)
    assert ":numeric-fluents" in used
    assert ":action-costs" not in used


def test_names_count_in_any_case() -> None:
    domain = costs(DIST, Fluent("TOTAL-COST"))
    assert ":action-costs" in used_requirements(domain, problem=PRICED)
