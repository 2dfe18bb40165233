"""Trajectory constraints, beside the definitions of PDDL 3.0 over whole trajectories."""

from __future__ import annotations

import random
from decimal import Decimal

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kant_sql.dto import formulas as f
from kant_sql.errors import UnsupportedConstructError
from kant_sql.knowledge.grounding import Binding
from kant_sql.reasoning.trajectory import Moment, Trajectory
from tests.support.profile import PROFILE, hunting

A, B = f.Atom("a"), f.Atom("b")
X = f.TypedName("x", ("thing",))
# The times of states, and the atoms that hold in them.
States = list[tuple[Decimal, set[str]]]


def judge(constraints: list[f.Formula], states: States) -> Trajectory:
    trajectory = Trajectory(constraints, lambda variable: ("one", "two"))
    now: set[str] = set()

    def holds(formula: f.Formula, binding: Binding) -> bool:
        assert isinstance(formula, f.Atom)
        return " ".join([formula.predicate, *binding.values()]) in now

    for time, facts in states:
        now = facts
        trajectory.observe(time, holds)
    trajectory.conclude()
    return trajectory


def satisfied(modal: f.Modal, states: States) -> bool:
    """The definitions, as they are written."""
    a = ["a" in facts for _, facts in states]
    b = ["b" in facts for _, facts in states]
    t = [time for time, _ in states]
    n = len(states)
    u = [number.value for number in modal.numbers]
    all_ = range(n)

    def hold_during(begin: Decimal, end: Decimal) -> bool:
        inside = all(a[i] for i in all_ if begin <= t[i] < end)
        return inside and all(
            a[i] for i in range(n - 1) if t[i] <= begin < t[i + 1] and begin < end
        )

    return {
        "always": lambda: all(a),
        "sometime": lambda: any(a),
        "within": lambda: any(a[i] and t[i] <= u[0] for i in all_),
        "at-most-once": lambda: all(
            any(
                all(a[k] for k in range(i, j + 1)) and not any(a[k] for k in range(j + 1, n))
                for j in range(i, n)
            )
            for i in all_
            if a[i]
        ),
        "sometime-after": lambda: all(any(b[i:]) for i in all_ if a[i]),
        "sometime-before": lambda: all(any(b[:i]) for i in all_ if a[i]),
        "always-within": lambda: all(
            any(b[j] and t[j] - t[i] <= u[0] for j in range(i, n)) for i in all_ if a[i]
        ),
        "hold-during": lambda: hold_during(u[0], u[-1]),
        "hold-after": lambda: hold_during(u[0], Decimal("Infinity")),
    }[modal.operator]()


@pytest.mark.parametrize("operator", sorted(f.MODALS))
@hunting(PROFILE.names)
@given(seed=st.integers(0, 2**32))
@example(seed=250000)  # a window that ends where it begins
def test_monitors_judge_as_defined(operator: str, seed: int) -> None:
    chance = random.Random(seed)
    states: States = []
    time = Decimal(0)
    for _ in range(chance.randint(1, 9)):
        facts = {name for name in ("a", "b") if chance.random() < 0.5}
        states.append((time, facts))
        time += chance.choice((0, 1, 1, 2, Decimal("0.5")))
    numbers, formulas = f.MODALS[operator]
    times = sorted(chance.randint(0, 8) for _ in range(numbers))
    modal = f.Modal(operator, tuple(map(f.Number, times)), (A, B)[:formulas])
    found = judge([modal], states)
    assert (found.violated() == []) == satisfied(modal, states), (modal, states)
    for rule in found.violated():
        assert rule.violation is not None
        assert rule.violation.index < len(states)
        assert rule.violation.time == states[rule.violation.index][0]


def states(*facts: str) -> States:
    """Make states at 0, 1, 2 ... from the atoms that hold."""
    return [(Decimal(time), set(filter(None, each.split(",")))) for time, each in enumerate(facts)]


@pytest.mark.parametrize(
    ("constraint", "facts", "index"),
    [
        (f.Modal("always", (), (A,)), ("a", "a", "", "a", ""), 2),
        (f.Modal("sometime", (), (A,)), ("", "", ""), 2),
        (f.Modal("within", (f.Number(1),), (A,)), ("", "", "", "a"), 2),
        (f.Modal("at-most-once", (), (A,)), ("a", "", "a", "a"), 2),
        (f.Modal("sometime-after", (), (A, B)), ("", "a", "b", "a", "a"), 3),
        (f.Modal("sometime-before", (), (A, B)), ("", "a,b", "a"), 1),
        (f.Modal("always-within", (f.Number(1),), (A, B)), ("a", "b", "a", "", "", "b"), 2),
        (f.Modal("hold-during", (f.Number(Decimal("1.5")), f.Number(3)), (A,)), ("a", "", "a"), 1),
        (f.Modal("hold-after", (f.Number(2),), (A,)), ("", "", "a", ""), 3),
        (f.Timed(f.AT_END, A), ("a", "a", ""), 2),
    ],
    ids=str,
)
def test_the_first_violating_state_is_named(
    constraint: f.Formula, facts: tuple[str, ...], index: int
) -> None:
    (rule,) = judge([constraint], states(*facts)).violated()
    assert rule.violation == Moment(index, Decimal(index))
    assert str(rule) == str(constraint)


def test_preferences_are_counted_by_instance() -> None:
    always = f.Modal("always", (), (f.Atom("p", (f.Variable("x"),)),))
    outside = f.Forall((X,), f.Preference("each", always))
    inside = f.Preference("all", f.Forall((X,), f.And((always, f.Modal("sometime", (), (A,))))))
    found = judge([f.And((outside, inside))], states("p one", "p one", ""))
    assert [(rule.preference, rule.is_soft) for rule in found.rules] == [
        ("each", True),
        ("each", True),
        ("all", True),
    ]
    assert [rule.violation and rule.violation.index for rule in found.rules] == [2, 0, 0]
    assert str(found.rules[1]) == "(preference each (always (p two)))"
    assert len(found.rules[2].violated) == 4


def test_a_trajectory_without_states_violates_nothing() -> None:
    assert judge([f.Modal("sometime", (), (A,))], []).violated() == []


@pytest.mark.parametrize(
    "constraint",
    [
        A,
        f.Not(f.Modal("always", (), (A,))),
        f.Exists((X,), f.Modal("always", (), (A,))),
        f.Modal("always", (), (f.Modal("sometime", (), (A,)),)),
        f.Modal("always", (), (f.Preference(None, A),)),
        f.Timed(f.AT_START, A),
    ],
    ids=str,
)
def test_constraints_without_a_semantics_are_refused(constraint: f.Formula) -> None:
    with pytest.raises(UnsupportedConstructError, match="no semantics"):
        Trajectory([constraint], lambda variable: ())
