"""Problems of unified-planning become documents that mean the same, or are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction

import pytest

from kant_sql import UnsupportedConstructError
from kant_sql.dto.formulas import And, Arithmetic, Assign, Atom, Fluent, Number
from kant_sql.errors import InvalidNameError, PlannerMissingError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.writer import write
from kant_sql.planning import from_unified_planning, to_unified_planning
from tests.planning.normal_form import normal_form, spelled
from tests.support.corpus import PAIRS, needs_corpus, small_pairs
from tests.support.profile import PROFILE

unified_planning = pytest.importorskip("unified_planning")
from unified_planning import model, shortcuts  # noqa: E402

NUMBER = shortcuts.RealType()


@pytest.fixture
def problem() -> model.Problem:
    """A robot that moves, on a battery."""
    place = shortcuts.UserType("Place")
    made = model.Problem("patrol 1")
    at = made.add_fluent("robot at", shortcuts.BoolType(), default_initial_value=False, place=place)
    battery = made.add_fluent("battery", NUMBER)
    move = model.InstantaneousAction("move", to=place)
    move.add_precondition(shortcuts.GE(battery(), 1))
    move.add_effect(at(move.parameter("to")), True)
    move.add_decrease_effect(battery, Fraction(5, 2))
    made.add_action(move)
    made.add_object("wp1", place)
    made.add_object("wp2", place)
    made.set_initial_value(battery, 10)
    made.set_initial_value(at(made.object("wp1")), True)
    made.add_goal(at(made.object("wp2")))
    return made


def test_a_whole_problem(problem: model.Problem) -> None:
    domain, asked = from_unified_planning(problem)
    assert (domain.name, asked.name, asked.domain) == (
        "patrol_1-domain",
        "patrol_1",
        "patrol_1-domain",
    )
    assert domain.requirements == (":strips", ":typing", ":numeric-fluents")
    assert [str(atom) for atom in asked.facts] == ["(robot_at wp1)"]
    assert [(str(fluent), str(value)) for fluent, value in asked.values] == [("(battery)", "10")]
    (action,) = domain.actions
    assert [str(node) for node in action.condition] == ["(<= 1 (battery))"]
    assert [str(node) for node in action.effect] == ["(robot_at ?to)", "(decrease (battery) 2.5)"]


def test_what_is_written_is_read_strictly(problem: model.Problem) -> None:
    domain, asked = from_unified_planning(problem)
    read = read_domain(write(domain), strict=True)
    assert read == domain
    assert read_problem(write(asked), domain=read, strict=True) == asked


def test_names_that_pddl_cannot_carry() -> None:
    made = model.Problem("2 robots")
    thing = shortcuts.UserType("Thing")
    made.add_fluent("and", default_initial_value=False)
    made.add_fluent("thing", default_initial_value=False)
    made.add_object("5th", thing)
    made.add_object("größe 5", thing)
    made.add_object("Ä", thing)
    made.add_object("O\N{COMBINING DIAERESIS}", thing)
    domain, asked = from_unified_planning(made)
    assert asked.name == "p_2_robots"
    assert [predicate.name for predicate in domain.predicates] == ["and_", "thing"]
    assert [type_.name for type_ in domain.types] == ["Thing_type"]
    assert [item.name for item in asked.objects] == ["o_5th", "größe_5", "Ä", "Ö"]


def test_names_that_letters_case_alone_tells_apart_are_refused() -> None:
    made = model.Problem("p")
    made.add_object("left", shortcuts.UserType("arm"))
    made.add_object("Left", shortcuts.UserType("arm"))
    with pytest.raises(InvalidNameError, match="object Left and object left would both be named"):
        from_unified_planning(made)


def test_numbers_are_exact(problem: model.Problem) -> None:
    battery = problem.fluent("battery")
    problem.action("move").add_effect(
        problem.add_fluent("third", NUMBER), shortcuts.Times(battery(), Fraction(1, 3))
    )
    domain, _ = from_unified_planning(problem)
    third = Arithmetic("/", (Number(Decimal(1)), Number(Decimal(3))))
    product = Arithmetic("*", (Fluent("battery"), third))
    assert domain.actions[0].effect[-1] == Assign("assign", Fluent("third"), product)


def test_objects_that_an_action_names_are_constants(problem: model.Problem) -> None:
    at = problem.fluent("robot at")
    problem.action("move").add_effect(at(problem.object("wp2")), False)
    domain, asked = from_unified_planning(problem)
    assert [item.name for item in domain.constants] == ["wp2"]
    assert [item.name for item in asked.objects] == ["wp1"]


def test_a_truth_value_that_a_condition_decides(problem: model.Problem) -> None:
    low = problem.add_fluent("low", default_initial_value=False)
    battery = problem.fluent("battery")
    problem.action("move").add_effect(low, shortcuts.LT(battery(), 3))
    domain, _ = from_unified_planning(problem)
    assert [str(effect) for effect in domain.actions[0].effect[-2:]] == [
        "(when (< (battery) 3) (low))",
        "(when (not (< (battery) 3)) (not (low)))",
    ]


def test_intervals_of_a_durative_action(problem: model.Problem) -> None:
    on = problem.add_fluent("on", default_initial_value=True)
    action = model.DurativeAction("guard")
    start, end = model.StartTiming(), model.EndTiming()
    action.set_left_open_duration_interval(1, 4)
    action.add_condition(model.ClosedTimeInterval(start, end), on)
    action.add_effect(end, on, False, on)
    problem.add_action(action)
    made = from_unified_planning(problem)[0].actions[-1]
    assert list(map(str, made.duration)) == ["(> ?duration 1)", "(<= ?duration 4)"]
    assert list(map(str, made.condition)) == ["(at start (on))", "(over all (on))", "(at end (on))"]
    assert list(map(str, made.effect)) == ["(when (at end (on)) (at end (not (on))))"]


def test_default_values_are_written_out(problem: model.Problem) -> None:
    problem.add_fluent(
        "free", shortcuts.BoolType(), default_initial_value=True, place=shortcuts.UserType("Place")
    )
    problem.add_fluent("load", NUMBER, default_initial_value=7)
    _, asked = from_unified_planning(problem)
    assert {"(free wp1)", "(free wp2)"} < set(map(str, asked.facts))
    assert [str(value.fluent) for value in asked.values] == ["(battery)", "(load)"]


def test_metrics(problem: model.Problem) -> None:
    move = problem.action("move")
    problem.add_quality_metric(model.MinimizeActionCosts({move: 3}))
    domain, asked = from_unified_planning(problem)
    assert str(domain.actions[0].effect[-1]) == "(increase (total-cost) 3)"
    assert str(asked.metric) == "(:metric minimize (total-cost))"
    problem.clear_quality_metrics()
    at = problem.fluent("robot at")
    gains = {at(problem.object("wp1")): 2, at(problem.object("wp2")): Fraction(1, 2)}
    problem.add_quality_metric(model.Oversubscription(gains))
    _, asked = from_unified_planning(problem)
    assert list(map(str, asked.goal[1:])) == [
        "(preference goal-1 (robot_at wp1))",
        "(preference goal-2 (robot_at wp2))",
    ]
    assert str(asked.metric) == (
        "(:metric minimize (+ (* 2 (is-violated goal-1)) (* 0.5 (is-violated goal-2))))"
    )


def _delayed(problem: model.Problem) -> None:
    action = model.DurativeAction("late")
    action.add_effect(model.StartTiming(2), problem.fluent("battery"), 3)
    problem.add_action(action)


def _timed_goal(problem: model.Problem) -> None:
    at = problem.fluent("robot at")(problem.object("wp1"))
    problem.add_timed_goal(model.GlobalStartTiming(5), at)


def _simulated(problem: model.Problem) -> None:
    effect = model.SimulatedEffect([problem.fluent("battery")()], lambda *_: [])
    action = model.InstantaneousAction("simulate")
    action.set_simulated_effect(effect)
    problem.add_action(action)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda made: made.add_fluent("level", shortcuts.IntType(0, 3)),
            r"integer\[0, 3\] level in fluent level: a number has no bounds",
        ),
        (
            lambda made: made.add_fluent("level", floor=shortcuts.IntType(0, 3)),
            "a parameter of type integer.* in fluent level: parameters are objects",
        ),
        (lambda made: made.add_fluent("open"), "unknown values of open in the initial state"),
        (_delayed, r"time start \+ 2 in action late"),
        (_timed_goal, r"a goal in \[start \+ 5\] in the goals"),
        (_simulated, "a simulated effect in action simulate"),
        (lambda made: made.add_action(model.SensingAction("look")), "SensingAction in action look"),
    ],
)
def test_what_pddl_cannot_express_is_named_with_its_place(
    problem: model.Problem, spoil: Callable[[model.Problem], object], message: str
) -> None:
    spoil(problem)
    with pytest.raises(UnsupportedConstructError, match=f"PDDL cannot express {message}"):
        from_unified_planning(problem)


def test_other_kinds_of_problems_are_refused() -> None:
    with pytest.raises(UnsupportedConstructError, match="a ContingentProblem"):
        from_unified_planning(model.ContingentProblem("p"))


def test_true_and_false() -> None:
    made = model.Problem("p")
    x = made.add_fluent("x", default_initial_value=False)
    made.add_goal(shortcuts.Or(x, True))
    _, asked = from_unified_planning(made)
    assert [str(goal) for goal in asked.goal] == ["(or (x) (and))"]
    assert And() in [part for goal in asked.goal for part in getattr(goal, "formulas", ())]
    assert Atom("x") in [part for goal in asked.goal for part in getattr(goal, "formulas", ())]


def test_the_examples_of_unified_planning_go_there_and_back() -> None:
    examples = pytest.importorskip("unified_planning.test.examples").get_example_problems()
    same = 0
    for name, example in examples.items():
        try:
            domain, asked = from_unified_planning(example.problem)
        except UnsupportedConstructError:
            continue
        made = to_unified_planning(domain, problem=asked)
        assert made.kind == example.problem.kind or name in DIFFERENT_KIND, name
        text = write(domain), write(asked)
        read = read_domain(text[0])
        assert (read, read_problem(text[1], domain=read)) == (domain, asked), name
        same += 1
    assert same >= 30


# Integers and defaults of numbers, which PDDL does not tell from reals and values.
DIFFERENT_KIND = {
    "basic_numeric",
    "basic_numeric_with_timed_effect",
    "basic_undef_numeric",
    "locations_connected_cost_minimize",
}


@pytest.mark.more
@pytest.mark.filterwarnings("ignore")  # its reader warns of what it reads
@needs_corpus
def test_what_unified_planning_reads_goes_there_and_back() -> None:
    """All of the competitions' files in the profile `long`, else a handful."""
    from unified_planning.io import PDDLReader

    compared = 0
    environment = shortcuts.get_environment()
    for pair in PAIRS if PROFILE.is_whole else small_pairs(6_000)[:8]:
        try:
            theirs = PDDLReader(environment).parse_problem(str(pair.domain), str(pair.problem))
        except Exception:
            continue
        domain, problem = from_unified_planning(theirs)
        ours = to_unified_planning(domain, problem=problem, environment=environment)
        compared += 1
        assert spelled(normal_form(ours)) == spelled(normal_form(theirs)), pair.name
    assert compared >= (50 if PROFILE.is_whole else 3)


def test_without_the_extra(problem: model.Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(PlannerMissingError, match="pip install"):
        from_unified_planning(problem)
