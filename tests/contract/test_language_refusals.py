"""What is not well formed is refused, says why, and leaves nothing, on every backend."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from kant_sql import KnowledgeBase, PddlActionDto, PddlObjectDto, PddlTypeDto
from kant_sql.dao.formula import FormulaChecker
from kant_sql.dto import formulas as f
from kant_sql.errors import ArityError, InvalidKnowledgeError, InvalidNameError, TypeMismatchError
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
    load,
    number,
)

ALWAYS = f.Modal("always", (), (IDLE,))
ZERO = number("0")


def less(number: f.Expression) -> f.Comparison:
    """A formula in which a number stands."""
    return f.Comparison("<", number, ZERO)


# What is not a goal, and so no precondition either.
NO_GOALS: dict[str, tuple[Any, str]] = {
    "unknown predicate": (f.Atom("near", (T1,)), "predicate 'near'"),
    "unknown function": (less(f.Fluent("speed")), "function 'speed', which is not known"),
    "unknown object": (f.Not(at(f.Constant("t9"))), "object 't9' is not known"),
    "unknown type": (
        f.Exists((f.TypedName("x", ("ship",)),), IDLE),
        "?x is of type 'ship', which is not known",
    ),
    "unknown variable": (f.Not(at(f.Variable("u"))), "?u is neither"),
    "a variable out of its scope": (
        f.And((f.Not(IDLE), f.Or((f.Exists((TRUCK,), IDLE), at(T))))),
        "?t is neither a parameter nor bound",
    ),
    "too few terms": (f.Not(f.Atom("at", (T1,))), "has 1 terms, expected 2"),
    "too many terms": (less(f.Fluent("fuel", (T1, T1))), "has 2 terms, expected 1"),
    "another type": (f.Not(at(C1)), "term 1 of (at c1 p1) does not fit"),
    "a variable of another type": (f.Exists((PLACE,), at(P)), "term 1 of (at ?p p1) does not fit"),
    "a fluent of another type": (f.Not(at(home())), "term 1 of"),
    "a number as a term": (f.Not(at(T1, fuel())), "is a number, not an object"),
    "an object as a number": (less(home()), "is an object, not a number"),
    "a duration": (less(DURATION), "?duration is not a number"),
    "continuous time": (less(f.ContinuousTime()), "#t is not a number here"),
    "a violated preference": (f.Comparison("=", f.IsViolated("p1"), ZERO), "is not a number here"),
    "a function that is not declared": (
        less(f.Fluent("total-time")),
        "'total-time', which is not known",
    ),
    "no comparison": (f.Comparison("!=", fuel(), ZERO), "'!=' is not a comparison"),
    "no operation": (less(f.Arithmetic("^", (ZERO, ZERO))), "'^' is not an operation"),
    "too few operands": (less(calculated("+", ZERO)), "(+ 0) has 1 operands"),
    "too many operands": (less(calculated("-", ZERO, ZERO, ZERO)), "(- 0 0 0) has 3 operands"),
    "a variable bound twice": (
        f.Forall((TRUCK, f.TypedName("T", ("place",))), IDLE),
        "binds a variable twice",
    ),
    "a variable that is not a name": (
        f.Forall((f.TypedName("a b", ("place",)),), IDLE),
        "'a b' cannot name a variable",
    ),
    "an assignment": (
        f.Assign("increase", fuel(), ZERO),
        "(increase (fuel t1) 0) has no place in a condition or a goal",
    ),
    "a conditional effect": (f.When(IDLE, IDLE), "has no place in a condition"),
    "a constraint": (ALWAYS, "(always (idle)) has no place in a condition"),
    "a time": (f.Timed("at end", IDLE), "has a time that has no place"),
    "a rule": (f.Derived("idle", (), IDLE), "has no place in a condition"),
    "a metric": (f.Metric("minimize", ZERO), "has no place in a condition"),
    "a timed literal": (f.TimedLiteral(ZERO, IDLE), "has no place in a condition"),
    "a term": (T1, "t1 is not a formula but Constant"),
    "a preference within or": (
        f.Or((f.Preference("p", IDLE),)),
        "a preference stands at the top of",
    ),
    "a preference within a preference": (
        f.Preference("p", f.Preference("q", IDLE)),
        "a preference stands at the top of",
    ),
    "a preference that is not a name": (f.Preference("(", IDLE), "'(' cannot name a preference"),
}
# Their error is InvalidKnowledgeError, but of these it is a narrower one.
NARROWER: dict[str, type[Exception]] = {
    "too few terms": ArityError,
    "too many terms": ArityError,
    "another type": TypeMismatchError,
    "a variable of another type": TypeMismatchError,
    "a fluent of another type": TypeMismatchError,
    "a variable that is not a name": InvalidNameError,
    "a preference that is not a name": InvalidNameError,
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
        for name, (wrong, message) in NO_GOALS.items():
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
                caught = refused(depot_kb, name, dao.save_all, given)
                assert type(caught) is NARROWER.get(name, InvalidKnowledgeError), name
                assert message in str(caught), name
            assert depot_kb.goals.delete(wrong) is False, name
    counted = "SELECT count(*) FROM formula WHERE kb_id = :kb"
    assert rows(depot_kb, counted) == [(0,)]
    assert rows(depot_kb, counted.replace("formula", "action")) == [(0,)]


PLAIN, TIMED = False, True
# Effects of an action, durative or not, that are none.
NO_EFFECTS: dict[str, tuple[bool, Any, str]] = {
    "or": (PLAIN, f.Or((IDLE,)), "has no place in an effect"),
    "exists": (PLAIN, f.Exists((TRUCK,), at(T)), "has no place in an effect"),
    "a comparison": (PLAIN, f.Comparison("<", ZERO, ZERO), "has no place in an effect"),
    "an equality": (PLAIN, f.Equal(T1, T1), "has no place in an effect"),
    "a preference": (PLAIN, f.Preference("p", IDLE), "a preference stands at the top"),
    "a constraint": (PLAIN, ALWAYS, "has no place in an effect"),
    "not of a conjunction": (PLAIN, f.Not(f.And((IDLE,))), "deletes what is not an atom"),
    "a time": (PLAIN, f.Timed("at end", IDLE), "has a time that has no place in an effect"),
    "continuous time": (
        PLAIN,
        f.Assign("increase", fuel(), f.ContinuousTime()),
        "#t is not a number",
    ),
    "a duration": (PLAIN, f.Assign("increase", fuel(), DURATION), "?duration is not a number"),
    "no assignment": (PLAIN, f.Assign("double", fuel(), ZERO), "'double' is not an assignment"),
    "an object that is increased": (PLAIN, f.Assign("increase", home(), HUB), "counts with"),
    "an object of another type": (PLAIN, f.Assign("assign", home(), T1), "does not fit"),
    "a number as an object": (PLAIN, f.Assign("assign", home(), ZERO), "is not a term"),
    "an object as a number": (PLAIN, f.Assign("assign", fuel(), T1), "t1 is not a number"),
    "a preference in a condition": (PLAIN, f.When(f.Preference("p", IDLE), IDLE), "a preference"),
    "no time": (TIMED, IDLE, "has no place in an effect of a durative action"),
    "no time below forall": (TIMED, f.Forall((TRUCK,), at(T)), "has no place in an effect of a"),
    "no time in a condition": (TIMED, f.When(IDLE, f.Timed("at end", IDLE)), "in a condition of a"),
    "an assignment without a time": (TIMED, f.Assign("increase", fuel(), ZERO), "has no place in"),
    "a time that is none": (TIMED, f.Timed("at noon", IDLE), "has the time 'at noon'"),
    "a time within a time": (TIMED, f.Timed("at end", f.Timed("at end", IDLE)), "has a time that"),
}


def test_what_is_no_effect_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, (durative, wrong, message) in NO_EFFECTS.items():
            right = f.Timed("at start", IDLE) if durative else IDLE
            action = PddlActionDto("act", [], [], [right, wrong], durative)
            caught = refused(depot_kb, name, depot_kb.actions.save, action)
            assert message in str(caught), name
            assert "the effect of action 'act': " in str(caught), name
    assert depot_kb.pddl.domain().actions == ()


DURATIVE: dict[str, tuple[dict[str, Any], str]] = {
    "a condition without a time": ({"conditions": [IDLE]}, "(idle) has no place in a condition of"),
    "a constraint": ({"conditions": [ALWAYS]}, "(always (idle)) has no place in"),
    "a duration of something else": (
        {"duration": [f.Comparison("=", fuel(), ZERO)]},
        "(= (fuel t1) 0) is not a constraint on ?duration",
    ),
    "a duration over all": (
        {"duration": [f.Timed("over all", f.Comparison("=", DURATION, ZERO))]},
        "has a time that has no place in a duration",
    ),
    "an atom as a duration": ({"duration": [IDLE]}, "(idle) has no place in a duration"),
    "a disjunction of durations": (
        {"duration": [f.Or((f.Comparison("=", DURATION, ZERO),))]},
        "has no place in a duration",
    ),
}


def test_what_is_no_part_of_a_durative_action_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, (parts, message) in DURATIVE.items():
            action = PddlActionDto("act", **parts)
            assert message in str(refused(depot_kb, name, depot_kb.actions.save, action)), name


MISPLACED: dict[str, tuple[str, Any, str]] = {
    "a constraint that is an atom": ("constraints", IDLE, "(idle) has no place in a constraint"),
    "a preference for an atom": ("constraints", f.Preference("p", IDLE), "(idle) has no place in"),
    "a constraint at start": ("constraints", f.Timed("at start", IDLE), "has a time that"),
    "no operator": (
        "constraints",
        f.Modal("never", (), (IDLE,)),
        "is not a constraint of PDDL 3.0",
    ),
    "no time span": (
        "constraints",
        f.Modal("within", (), (IDLE,)),
        "is not a constraint of PDDL 3.0",
    ),
    "an effect": ("domain_constraints", f.Assign("assign", fuel(), ZERO), "has no place in"),
    "a rule that is a goal": ("derived_predicates", IDLE, "is a node Derived of kant_sql.pddl"),
    "a rule for nothing": (
        "derived_predicates",
        f.Derived("near", (), IDLE),
        "predicate 'near', which is not known",
    ),
    "a rule of other parameters": (
        "derived_predicates",
        f.Derived("reachable", (TRUCK,), IDLE),
        "term 1 of (reachable ?t) does not fit",
    ),
    "a rule with a preference": (
        "derived_predicates",
        f.Derived("reachable", (PLACE,), f.Preference("p", IDLE)),
        "a preference stands at the top",
    ),
    "a negative conjunction": ("initial_literals", f.Not(f.And((IDLE,))), "is not a literal"),
    "a fluent in a literal": ("initial_literals", f.Not(at(T1, home())), "as the initial state"),
    "a variable in a literal": ("initial_literals", f.Not(at(T)), "?t is neither a parameter"),
    "a positive literal": ("initial_literals", IDLE, "is a node Not or Equal of kant_sql.pddl"),
    "a timed increase": (
        "timed_initial_literals",
        f.TimedLiteral(ZERO, f.Assign("increase", fuel(), ZERO)),
        "assigns no number",
    ),
    "a timed calculation": (
        "timed_initial_literals",
        f.TimedLiteral(ZERO, f.Assign("assign", fuel(), fuel())),
        "assigns no number",
    ),
    "a timed equality": (
        "timed_initial_literals",
        f.TimedLiteral(ZERO, f.Not(f.Equal(T1, T1))),
        "is not a timed literal",
    ),
}


def test_a_formula_of_another_sort_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for name, (dao, wrong, message) in MISPLACED.items():
            caught = refused(depot_kb, name, dao_of(depot_kb, dao).save, wrong)
            assert message in str(caught), name
            assert dao_of(depot_kb, dao).get_all() == [], name


NO_METRICS: list[tuple[Any, str]] = [
    (IDLE, "the metric is PDDL text, a node Metric of kant_sql.pddl, or None, not Atom"),
    (f.Metric("optimise", ZERO), "'optimise' is neither minimize nor maximize"),
    (f.Metric("minimize", f.Fluent("speed")), "function 'speed'"),
    (f.Metric("minimize", DURATION), "?duration is not a number here"),
    (f.Metric("minimize", f.IsViolated("a b")), "'a b' cannot name a preference"),
]


def test_what_is_no_metric_is_refused(depot_kb: KnowledgeBase) -> None:
    with nothing_changes(depot_kb):
        for wrong, message in NO_METRICS:
            assert message in str(refused(depot_kb, message, depot_kb.pddl.metric.set, wrong))
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


def test_formulas_of_texts_are_checked_by_the_reader_only(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(*given: object) -> None:
        raise AssertionError(given)

    monkeypatch.setattr(FormulaChecker, "check", check)
    load(fresh_kb)
    fresh_kb.goals.save("(forall (?t - truck) (at ?t p1))")
    with pytest.raises(AssertionError):
        fresh_kb.goals.save(IDLE)
