"""The requirements that are really used, construct by construct."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest

from kant_sql.dto import formulas as f
from kant_sql.pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from kant_sql.pddl.requirements import REQUIREMENTS, used_requirements

X, A = f.Variable("x"), f.Constant("a")
P, Q = f.Atom("p"), f.Atom("q")
ALL = (f.TypedName("x"),)
COST, TIME, FUEL = f.Fluent("total-cost"), f.Fluent("total-time"), f.Fluent("fuel")
DURATION = f.Variable("duration")
FUNCTIONS = (Function("total-cost"), Function("fuel"), Function("dist", ALL))


def number(value: str | int) -> f.Number:
    return f.Number(Decimal(value))


def acting(
    condition: tuple[f.Formula, ...] = (),
    effect: tuple[f.Formula, ...] = (),
    kind: str = "action",
    duration: tuple[f.Formula, ...] = (),
    functions: tuple[Function, ...] = (),
) -> Domain:
    action = Action(kind, "a", (), duration, condition, effect)
    return Domain("d", functions=functions, actions=(action,))


def durative(*duration: f.Formula, effect: tuple[f.Formula, ...] = ()) -> Domain:
    return acting((), effect, "durative-action", duration)


def fixed(value: f.Expression) -> f.Formula:
    return f.Comparison("=", DURATION, value)


CONDITIONS: list[tuple[f.Formula, str]] = [
    (f.And((P, Q)), ""),
    (f.Not(P), ":negative-preconditions"),
    (f.Not(f.Equal(X, A)), ":negative-preconditions :equality"),
    (f.Not(f.And((P, Q))), ":disjunctive-preconditions"),
    (f.Not(f.Not(P)), ":negative-preconditions :disjunctive-preconditions"),
    (f.Or((P,)), ":disjunctive-preconditions"),
    (f.Imply(P, Q), ":disjunctive-preconditions"),
    (f.Equal(X, A), ":equality"),
    (f.Exists(ALL, P), ":existential-preconditions"),
    (f.Forall(ALL, P), ":universal-preconditions"),
    (f.Forall((f.TypedName("x", ("t",)),), P), ":typing :universal-preconditions"),
    (f.Comparison("<", FUEL, number(1)), ":numeric-fluents"),
    (f.Equal(f.Fluent("place", (X,)), A), ":equality :object-fluents"),
    (f.Atom("p", (f.Fluent("place", (X,)),)), ":object-fluents"),
    (f.Preference(None, f.Not(P)), ":negative-preconditions :preferences"),
]


@pytest.mark.parametrize(("condition", "used"), CONDITIONS)
def test_conditions_goals_and_rules(condition: f.Formula, used: str) -> None:
    expected = (":strips", *used.split())
    assert used_requirements(acting((condition,))) == expected
    assert used_requirements(acting(effect=(f.When(condition, P),))) == tuple(
        r for r in REQUIREMENTS if r in {*expected, ":conditional-effects"}
    )
    assert used_requirements(Domain("d"), problem=Problem("p", "d", goal=(condition,))) == expected
    assert used_requirements(Domain("d", derived=(f.Derived("p", (), condition),))) == tuple(
        r for r in REQUIREMENTS if r in {*expected, ":derived-predicates"}
    )


@pytest.mark.parametrize(
    ("domain", "used"),
    [
        (acting(effect=(P, f.Not(Q), f.And((P,)))), ""),
        (acting(effect=(f.Forall(ALL, f.Not(P)),)), ":conditional-effects"),
        (acting(effect=(f.When(P, f.Not(Q)),)), ":conditional-effects"),
        (acting(effect=(f.Assign("assign", FUEL, number(1)),)), ":numeric-fluents"),
        (
            acting(
                effect=(f.Assign("assign", f.Fluent("place"), A),),
                functions=(Function("place", (), ("object",)),),
            ),
            ":object-fluents",
        ),
        (durative(fixed(number(5))), ":durative-actions"),
        (durative(f.Timed("at start", fixed(number(5)))), ":durative-actions"),
        (durative(fixed(FUEL)), ":numeric-fluents :durative-actions"),
        (durative(fixed(f.Variable("x"))), ":numeric-fluents :durative-actions"),
        (
            durative(f.Comparison("<=", DURATION, number(5))),
            ":durative-actions :duration-inequalities",
        ),
        (durative(fixed(number(5)), fixed(number(5))), ":durative-actions :duration-inequalities"),
        (
            durative(effect=(f.Timed("at end", f.Assign("increase", FUEL, DURATION)),)),
            ":numeric-fluents :durative-actions :duration-inequalities",
        ),
        (
            durative(effect=(f.Assign("increase", FUEL, f.ContinuousTime()),)),
            ":numeric-fluents :durative-actions :continuous-effects",
        ),
        (
            acting((), (f.Assign("increase", FUEL, f.ContinuousTime()),), "process"),
            ":numeric-fluents :time",
        ),
        (acting((P,), (Q,), "event"), ":time"),
        (Domain("d", types=ALL), ":typing"),
        (Domain("d", constants=ALL, predicates=(Predicate("p", ALL),)), ""),
        (Domain("d", predicates=(Predicate("p", (f.TypedName("x", ("t",)),)),)), ":typing"),
        (Domain("d", functions=(Function("f"),)), ":numeric-fluents"),
        (Domain("d", functions=(Function("f", (), ("t",)),)), ":object-fluents"),
    ],
)
def test_domains(domain: Domain, used: str) -> None:
    assert used_requirements(domain) == (":strips", *used.split())


@pytest.mark.parametrize(
    ("constraint", "used"),
    [
        (f.Modal("always", (), (P,)), ":constraints"),
        (f.Modal("always", (), (f.Not(P),)), ":negative-preconditions :constraints"),
        (f.Forall(ALL, f.Modal("always", (), (P,))), ":constraints"),
        (f.Forall(ALL, f.Timed("at end", P)), ":constraints"),
        (f.Modal("always", (), (f.Forall(ALL, P),)), ":universal-preconditions :constraints"),
        (
            f.Forall(ALL, f.Preference("n", f.Modal("sometime", (), (P,)))),
            ":universal-preconditions :preferences :constraints",
        ),
    ],
)
def test_constraints(constraint: f.Formula, used: str) -> None:
    expected = (":strips", *used.split())
    assert used_requirements(Domain("d", constraints=(constraint,))) == expected
    problem = Problem("p", "d", constraints=(constraint,))
    assert used_requirements(Domain("d"), problem=problem) == expected


@pytest.mark.parametrize(
    ("problem", "used"),
    [
        (Problem("p", "d", facts=(P,), literals=(f.Not(Q),)), ""),
        (Problem("p", "d", literals=(f.Equal(A, A),)), ":equality"),
        (Problem("p", "d", objects=(f.TypedName("a", ("t",)),)), ":typing"),
        (Problem("p", "d", values=(FunctionValue(FUEL, number(1)),)), ":numeric-fluents"),
        (Problem("p", "d", values=(FunctionValue(f.Fluent("place"), A),)), ":object-fluents"),
        (
            Problem("p", "d", timed=(f.TimedLiteral(number(1), f.Not(P)),)),
            ":timed-initial-literals",
        ),
        (
            Problem(
                "p", "d", timed=(f.TimedLiteral(number(1), f.Assign("assign", FUEL, number(2))),)
            ),
            ":numeric-fluents :timed-initial-literals",
        ),
        (
            Problem("p", "d", timed=(f.TimedLiteral(number(1), f.Assign("assign", FUEL, A)),)),
            ":object-fluents :timed-initial-literals",
        ),
        (Problem("p", "d", metric=f.Metric("minimize", TIME)), ""),
        (Problem("p", "d", metric=f.Metric("minimize", f.IsViolated("n"))), ":preferences"),
        (Problem("p", "d", metric=f.Metric("minimize", FUEL)), ":numeric-fluents"),
    ],
)
def test_problems(problem: Problem, used: str) -> None:
    assert used_requirements(Domain("d"), problem=problem) == (":strips", *used.split())


def costs(
    value: f.Expression | f.Term, fluent: f.Fluent = COST, operator: str = "increase"
) -> Domain:
    return acting(effect=(f.Assign(operator, fluent, value),), functions=FUNCTIONS)


DIST = f.Fluent("dist", (X,))
START = FunctionValue(COST, number(0))
PRICED = Problem("p", "d", values=(START,), metric=f.Metric("minimize", COST))
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


SUM = f.Arithmetic("+", (COST, f.Arithmetic("*", (number(2), TIME))))


def test_time_counts_as_a_cost_where_actions_last() -> None:
    both = replace(PRICED, metric=f.Metric("minimize", SUM))
    assert ":action-costs" in used_requirements(LONG, problem=both)
    assert ":numeric-fluents" in used_requirements(costs(DIST), problem=both)


# What breaks each rule of https://ipc08.icaps-conference.org/deterministic/PddlActionCosts.html.
@pytest.mark.parametrize(
    ("domain", "problem"),
    [
        (
            replace(costs(DIST), derived=(f.Derived("p", (), f.Comparison("<", COST, FUEL)),)),
            PRICED,
        ),
        (costs(DIST), replace(PRICED, goal=(f.Comparison("<", COST, number(9)),))),
        (costs(DIST, FUEL), PRICED),
        (costs(DIST, f.Fluent("total-cost", (X,))), PRICED),
        (costs(DIST), replace(PRICED, values=(FunctionValue(COST, number(1)),))),
        (costs(DIST, operator="decrease"), PRICED),
        (costs(DIST, operator="assign"), PRICED),
        (costs(number(-1)), PRICED),
        (costs(COST), PRICED),
        (costs(f.Arithmetic("+", (DIST, number(1)))), PRICED),
        (costs(f.Fluent("dist", (f.Fluent("place"),))), PRICED),
        (costs(DIST), replace(PRICED, values=(START, FunctionValue(FUEL, number(-1))))),
        (costs(DIST), replace(PRICED, metric=f.Metric("maximize", COST))),
        (costs(DIST), replace(PRICED, metric=f.Metric("minimize", FUEL))),
        (LONG, replace(PRICED, metric=f.Metric("minimize", f.Arithmetic("-", (COST, TIME))))),
        (LONG, replace(PRICED, metric=f.Metric("minimize", f.Arithmetic("*", (COST, TIME))))),
        (LONG, replace(PRICED, metric=f.Metric("minimize", f.Arithmetic("*", (number(-1), TIME))))),
        (replace(costs(DIST), functions=FUNCTIONS[1:]), PRICED),
    ],
)
def test_other_uses_of_numbers_need_numeric_fluents(domain: Domain, problem: Problem) -> None:
    used = used_requirements(domain, problem=problem)
    assert ":numeric-fluents" in used
    assert ":action-costs" not in used


def test_names_count_in_any_case() -> None:
    domain = costs(DIST, f.Fluent("TOTAL-COST"))
    assert ":action-costs" in used_requirements(domain, problem=PRICED)
