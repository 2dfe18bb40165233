"""What is not well formed is refused, says why, and leaves nothing, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from kant_sql import KnowledgeBase, PddlActionDto, PddlObjectDto, PddlTypeDto
from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidKnowledgeError
from tests.support.parts import dao_of
from tests.support.reading import nothing_changes, rows
from tests.support.worlds.depot import (
    C1,
    DURATION,
    HUB,
    IDLE,
    P1,
    PLACE,
    T1,
    TRUCK,
    P,
    T,
    at,
    calculated,
    check_text,
    fuel,
    home,
    number,
)

ALWAYS = f.Modal("always", (), (IDLE,))
ZERO = number("0")


def less(number: f.Expression) -> f.Comparison:
    """A formula in which a number stands."""
    return f.Comparison("<", number, ZERO)


# What is not a goal, and so no precondition either.
NO_GOALS: dict[str, Any] = {
    "unknown predicate": f.Atom("near", (T1,)),
    "unknown function": less(f.Fluent("speed")),
    "unknown object": f.Not(at(f.Constant("t9"))),
    "unknown type": f.Exists((f.TypedName("x", ("ship",)),), IDLE),
    "unknown variable": f.Not(at(f.Variable("u"))),
    "a variable out of its scope": f.And((f.Not(IDLE), f.Or((f.Exists((TRUCK,), IDLE), at(T))))),
    "too few terms": f.Not(f.Atom("at", (T1,))),
    "too many terms": less(f.Fluent("fuel", (T1, T1))),
    "another type": f.Not(at(C1)),
    "a variable of another type": f.Exists((PLACE,), at(P)),
    "a fluent of another type": f.Not(at(home())),
    "a number as a term": f.Not(at(T1, fuel())),
    "an object as a number": less(home()),
    "a duration": less(DURATION),
    "continuous time": less(f.ContinuousTime()),
    "a violated preference": f.Comparison("=", f.IsViolated("p1"), ZERO),
    "a function that is not declared": less(f.Fluent("total-time")),
    "no comparison": f.Comparison("!=", fuel(), ZERO),
    "no operation": less(f.Arithmetic("^", (ZERO, ZERO))),
    "too few operands": less(calculated("+", ZERO)),
    "too many operands": less(calculated("-", ZERO, ZERO, ZERO)),
    "a variable bound twice": f.Forall((TRUCK, f.TypedName("T", ("place",))), IDLE),
    "a variable that is not a name": f.Forall((f.TypedName("a b", ("place",)),), IDLE),
    "an assignment": f.Assign("increase", fuel(), ZERO),
    "a conditional effect": f.When(IDLE, IDLE),
    "a constraint": ALWAYS,
    "a time": f.Timed("at end", IDLE),
    "a rule": f.Derived("idle", (), IDLE),
    "a metric": f.Metric("minimize", ZERO),
    "a timed literal": f.TimedLiteral(ZERO, IDLE),
    "a term": T1,
    "a preference within or": f.Or((f.Preference("p", IDLE),)),
    "a preference within a preference": f.Preference("p", f.Preference("q", IDLE)),
    "a preference that is not a name": f.Preference("(", IDLE),
}


def refused(
    kb: KnowledgeBase, name: str, call: Callable[..., object], given: object
) -> InvalidKnowledgeError:
    """Check that a call is refused and changes nothing; give the error."""
    revision = kb.revision
    with pytest.raises(InvalidKnowledgeError) as caught:
        call(given)
    assert kb.revision == revision, name
    assert "\n" not in str(caught.value), name
    return caught.value


def test_what_is_no_goal_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, wrong in NO_GOALS.items():
            action = PddlActionDto("act", [], [wrong], [], durative=False)
            calls: list[tuple[Any, list[Any]]] = [
                (depot_kb.goals, [wrong]),
                (depot_kb.actions, [action]),
            ]
            if isinstance(wrong, f.FormulaNode):
                calls.append((depot_kb.goals, [IDLE, f.And((IDLE, wrong))]))  # type: ignore[arg-type]
            else:
                with pytest.raises(InvalidKnowledgeError, match="each item of the formulas of"):
                    f.And((IDLE, wrong))
            for dao, given in calls:
                refused(depot_kb, name, dao.save_all, given)
            assert depot_kb.goals.delete(wrong) is False, name
    counted = "SELECT count(*) FROM formula WHERE kb_id = :kb"
    assert rows(depot_kb, counted) == [(0,)]
    assert rows(depot_kb, counted.replace("formula", "action")) == [(0,)]


PLAIN, TIMED = False, True
# Effects of an action, durative or not, that are none.
NO_EFFECTS: dict[str, tuple[bool, Any]] = {
    "or": (PLAIN, f.Or((IDLE,))),
    "exists": (PLAIN, f.Exists((TRUCK,), at(T))),
    "a comparison": (PLAIN, f.Comparison("<", ZERO, ZERO)),
    "an equality": (PLAIN, f.Equal(T1, T1)),
    "a preference": (PLAIN, f.Preference("p", IDLE)),
    "a constraint": (PLAIN, ALWAYS),
    "not of a conjunction": (PLAIN, f.Not(f.And((IDLE,)))),
    "a time": (PLAIN, f.Timed("at end", IDLE)),
    "continuous time": (PLAIN, f.Assign("increase", fuel(), f.ContinuousTime())),
    "a duration": (PLAIN, f.Assign("increase", fuel(), DURATION)),
    "no assignment": (PLAIN, f.Assign("double", fuel(), ZERO)),
    "an object that is increased": (PLAIN, f.Assign("increase", home(), HUB)),
    "an object of another type": (PLAIN, f.Assign("assign", home(), T1)),
    "a number as an object": (PLAIN, f.Assign("assign", home(), ZERO)),
    "an object as a number": (PLAIN, f.Assign("assign", fuel(), T1)),
    "a preference in a condition": (PLAIN, f.When(f.Preference("p", IDLE), IDLE)),
    "no time": (TIMED, IDLE),
    "no time below forall": (TIMED, f.Forall((TRUCK,), at(T))),
    "no time in a condition": (TIMED, f.When(IDLE, f.Timed("at end", IDLE))),
    "an assignment without a time": (TIMED, f.Assign("increase", fuel(), ZERO)),
    "a time that is none": (TIMED, f.Timed("at noon", IDLE)),
    "a period": (TIMED, f.Timed("over all", IDLE)),
    "a time within a time": (TIMED, f.Timed("at end", f.Timed("at end", IDLE))),
}


def test_what_is_no_effect_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, (durative, wrong) in NO_EFFECTS.items():
            right = f.Timed("at start", IDLE) if durative else IDLE
            action = PddlActionDto("act", [], [], [right, wrong], durative)
            caught = refused(depot_kb, name, depot_kb.actions.save, action)
            assert "action act, :effect: " in str(caught), name
    assert depot_kb.pddl.domain().actions == ()


DURATIVE: dict[str, dict[str, Any]] = {
    "a condition without a time": {"conditions": [IDLE]},
    "a constraint": {"conditions": [ALWAYS]},
    "a duration of something else": {"duration": [f.Comparison("=", fuel(), ZERO)]},
    "a duration over all": {"duration": [f.Timed("over all", f.Comparison("=", DURATION, ZERO))]},
    "an atom as a duration": {"duration": [IDLE]},
    "a disjunction of durations": {"duration": [f.Or((f.Comparison("=", DURATION, ZERO),))]},
}


def test_what_is_no_part_of_a_durative_action_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, parts in DURATIVE.items():
            action = PddlActionDto("act", **parts)
            refused(depot_kb, name, depot_kb.actions.save, action)


MISPLACED: dict[str, tuple[str, Any]] = {
    "a constraint that is an atom": ("constraints", IDLE),
    "a preference for an atom": ("constraints", f.Preference("p", IDLE)),
    "a constraint at start": ("constraints", f.Timed("at start", IDLE)),
    "no operator": ("constraints", f.Modal("never", (), (IDLE,))),
    "no time span": ("constraints", f.Modal("within", (), (IDLE,))),
    "an effect": ("domain_constraints", f.Assign("assign", fuel(), ZERO)),
    "a rule that is a goal": ("derived_predicates", IDLE),
    "a rule for nothing": ("derived_predicates", f.Derived("near", (), IDLE)),
    "a rule of other parameters": ("derived_predicates", f.Derived("reachable", (TRUCK,), IDLE)),
    "a rule with a preference": (
        "derived_predicates",
        f.Derived("reachable", (PLACE,), f.Preference("p", IDLE)),
    ),
    "a negative conjunction": ("initial_literals", f.Not(f.And((IDLE,)))),
    "a fluent in a literal": ("initial_literals", f.Not(at(T1, home()))),
    "a variable in a literal": ("initial_literals", f.Not(at(T))),
    "a positive literal": ("initial_literals", IDLE),
    "a timed increase": (
        "timed_initial_literals",
        f.TimedLiteral(ZERO, f.Assign("increase", fuel(), ZERO)),
    ),
    "a timed calculation": (
        "timed_initial_literals",
        f.TimedLiteral(ZERO, f.Assign("assign", fuel(), fuel())),
    ),
    "a timed equality": ("timed_initial_literals", f.TimedLiteral(ZERO, f.Not(f.Equal(T1, T1)))),
}


def test_a_formula_of_another_sort_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, (dao, wrong) in MISPLACED.items():
            refused(depot_kb, name, dao_of(depot_kb, dao).save, wrong)
            assert dao_of(depot_kb, dao).get_all() == [], name


def test_a_node_of_another_class_with_the_same_text_is_named(depot_kb: KnowledgeBase) -> None:
    with pytest.raises(InvalidKnowledgeError, match=r"another formula, Timed\(time='at end'"):
        depot_kb.pddl.constraints.save(f.Modal("at end", (), (IDLE,)))


NO_METRICS: list[Any] = [
    IDLE,
    f.Metric("optimise", ZERO),
    f.Metric("minimize", f.Fluent("speed")),
    f.Metric("minimize", DURATION),
    f.Metric("minimize", f.IsViolated("a b")),
]


def test_what_is_no_metric_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for wrong in NO_METRICS:
            refused(depot_kb, str(wrong), depot_kb.pddl.metric.set, wrong)
    assert depot_kb.pddl.metric.get() is None


def test_an_action_that_is_not_durative_has_no_duration(depot_kb: KnowledgeBase) -> None:
    # The paper's DTO has one whether it is used or not.
    dto = PddlActionDto("act", [], [], [IDLE], durative=False, duration=[IDLE])
    depot_kb.actions.save(dto)
    assert depot_kb.pddl.domain().actions[0].duration == ()


def test_a_parameter_hides_no_object_of_its_name(depot_kb: KnowledgeBase) -> None:
    dto = PddlActionDto(
        "act",
        [PddlObjectDto(PddlTypeDto("truck"), "t1")],
        [],
        [at(T1), at(f.Variable("T1"))],
        False,
    )
    depot_kb.actions.save(dto)
    assert depot_kb.pddl.domain().actions[0].effect == (at(T1), at(f.Variable("t1")))
    check_text(depot_kb)


def test_what_is_wrong_deep_within_is_said_briefly(depot_kb: KnowledgeBase) -> None:
    sums: Any = f.IsViolated("p")
    fluent: Any = f.Constant("nobody")
    formula: Any = f.Atom("unknown")
    for _ in range(f.MAX_NESTING - 4):
        sums = f.Arithmetic("-", (sums,))
        fluent = f.Fluent("home", (fluent,))
        formula = f.Not(formula)
    deep = [
        formula,
        less(sums),
        f.Forall((TRUCK,), f.Preference(None, formula)),
        f.Exists((TRUCK,), f.Equal(fluent, P1)),
    ]
    for wrong in deep:
        saves: list[tuple[Any, Any]] = [
            (depot_kb.goals, wrong),
            (depot_kb.actions, PddlActionDto("act", [], [wrong], [], False)),
            (depot_kb.pddl.derived_predicates, wrong),
            (depot_kb.pddl.derived_predicates, f.Derived("idle", (), wrong)),
        ]
        for dao, given in saves:
            with nothing_changes(depot_kb), pytest.raises(InvalidKnowledgeError) as caught:
                dao.save(given)
            assert len(str(caught.value)) < 500
    ands: Any = IDLE
    for _ in range(100_000):
        ands = f.And((ands,))
    # However deep, that is a conjunction of one.
    depot_kb.goals.save(ands)
    assert depot_kb.goals.get_all() == [IDLE]
