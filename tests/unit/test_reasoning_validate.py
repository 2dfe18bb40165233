"""Plans executed in memory: steps, times, invariants, continuous change, preferences, rules."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql import FailedCondition, Plan, PlanStep, Validation
from kant_sql.errors import UnsupportedConstructError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.reasoning.validate import validate_plan


def step(text: str) -> PlanStep:
    """Make a step of `start action arguments / duration`, as in `0.5 move a b / 3`."""
    words, _, duration = text.partition("/")
    first, *rest = words.split()
    start = Decimal(first) if first[0].isdigit() else None
    action, *arguments = rest if start is not None else [first, *rest]
    return PlanStep(start, action, tuple(arguments), Decimal(duration) if duration else None)


def run(domain: str, problem: str, *steps: str) -> Validation:
    """Validate a plan; the problem is what follows its `:domain`."""
    read = read_domain(f"(define (domain d) {domain})")
    text = f"(define (problem p) (:domain d) {problem})"
    plan = Plan(tuple(map(step, steps)), "by hand", "unknown")
    return validate_plan(read, read_problem(text, domain=read), plan)


def failure(found: Validation) -> tuple[int, str, str | None, list[str]]:
    """The failing step: position, time, phase and reasons."""
    failed = found.failed_step
    assert failed is not None
    assert not found.valid
    return failed.position, str(failed.time), failed.phase, [str(one) for one in failed.unsatisfied]


# Sequential plans.

ROOMS = """(:types room) (:predicates (in ?r - room) (door ?a ?b - room) (lit ?r - room))
  (:functions (battery) (visits ?r - room) (total-cost))
  (:action go :parameters (?a ?b - room)
    :precondition (and (in ?a) (door ?a ?b) (>= (battery) 2))
    :effect (and (not (in ?a)) (in ?b) (decrease (battery) 2) (increase (visits ?b) 1)
      (increase (total-cost) (visits ?b))))
  (:action stay :parameters (?a - room) :precondition (in ?a)
    :effect (and (in ?a) (not (in ?a)) (scale-up (battery) 1.5)))
  (:action clean :parameters () :effect (forall (?r - room) (when (not (lit ?r)) (and (lit ?r)
      (assign (visits ?r) (battery))))))
  (:action dim :parameters () :effect (forall (?r - room) (when (lit ?r) (not (lit ?r)))))"""
HALL = """(:objects hall kitchen attic - room)
  (:init (in hall) (door hall kitchen) (door kitchen hall) (= (battery) 4)
    (= (visits hall) 0) (= (visits kitchen) 0) (lit attic))
  (:goal (and (in hall) (not (lit attic)))) (:metric minimize (total-cost))"""


def test_a_sequential_plan_is_executed() -> None:
    found = run(ROOMS, HALL, "GO Hall kitchen", "go kitchen hall", "dim")
    assert found.valid
    assert found.is_goal_reached
    assert (found.makespan, found.metric_value) == (Decimal(3), Decimal(0))
    assert str(found) == "the plan is valid\nmakespan 3\nmetric 0"


def test_the_first_failing_step_is_named_with_values() -> None:
    found = run(ROOMS, HALL, "go hall kitchen", "go kitchen hall", "go hall attic", "dim")
    assert failure(found) == (
        2,
        "3",
        None,
        ["(door hall attic): does not hold", "(>= (battery) 2): the sides are 0 and 2"],
    )
    assert (found.metric_value, found.unsatisfied_goals) == (None, ())
    assert "step 2, (go hall attic), fails at 3:\n  (door hall attic): does" in str(found)


def test_unsatisfied_goals_are_named() -> None:
    found = run(ROOMS, HALL, "go hall kitchen")
    assert found.failed_step is None
    assert found.unsatisfied_goals == (
        FailedCondition("(in hall)", "does not hold"),
        FailedCondition("(not (lit attic))", "does not hold"),
    )
    assert "the goal (not (lit attic)): does not hold" in str(found)


def test_deletes_come_before_adds_and_numbers_are_exact() -> None:
    found = run(ROOMS, HALL.replace("4)", "0.1)"), *["stay hall"] * 3, "dim", "go hall kitchen")
    assert failure(found)[3] == ["(>= (battery) 2): the sides are 0.3375 and 2"]


def test_right_hand_sides_and_conditions_are_of_the_state_before() -> None:
    found = run(ROOMS, HALL, "clean", "dim", "go hall kitchen", "go kitchen hall", "go hall hall")
    assert found.failed_step is not None
    assert found.failed_step.position == 4
    # Both rooms had 4 visits from the battery; each step costs the visits before it.
    found = run(ROOMS, HALL, "clean", "dim", "go hall kitchen", "go kitchen hall")
    assert found.valid
    assert found.metric_value == Decimal(8)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("fly hall", "there is no action fly"),
        ("sty hall", "there is no action sty (did you mean stay?)"),
        ("stay cellar", "there is no object cellar"),
        ("stay kitchn", "there is no object kitchn (did you mean kitchen?)"),
        ("stay", "stay has 1 parameters, and 0 arguments are given"),
        ("stay hall hall", "stay has 1 parameters, and 2 arguments are given"),
    ],
)
def test_steps_that_are_none_fail(wrong: str, reason: str) -> None:
    position, _, _, reasons = failure(run(ROOMS, HALL, "dim", wrong))
    assert position == 1
    assert reasons[0].endswith(reason)


def test_arguments_must_fit_their_types() -> None:
    domain = "(:types room box) (:predicates (p)) (:action a :parameters (?b - box) :effect (p))"
    found = run(domain, "(:objects hall - room) (:init) (:goal (p))", "a hall")
    assert failure(found)[3] == ["(a hall): hall does not fit: ?b is of type box"]


def test_effects_without_a_defined_result_fail() -> None:
    domain = """(:predicates (p)) (:functions (f) (g))
      (:action a :parameters () :effect (increase (f) 1))
      (:action b :parameters () :effect (assign (f) (g)))
      (:action c :parameters () :effect (assign (f) 0))
      (:action d :parameters () :effect (and (assign (f) 1) (increase (f) 2)))
      (:action e :parameters () :effect (assign (g) (/ 1 (f))))"""
    problem = "(:init) (:goal (and (>= (f) 1)))"
    assert "(f): has no value that could be changed" in failure(run(domain, problem, "a"))[3][0]
    assert "its value is undefined" in failure(run(domain, problem, "b"))[3][0]
    assert "two effects of the action change" in failure(run(domain, problem, "c", "d"))[3][0]
    assert "its value is undefined" in failure(run(domain, problem, "c", "e"))[3][0]
    assert run(domain, problem, "c", "a").valid


def test_action_costs_count_from_zero() -> None:
    domain = """(:predicates (p)) (:functions (total-cost) - number)
      (:action a :parameters () :effect (and (p) (increase (total-cost) 3)))"""
    found = run(domain, "(:init) (:goal (p)) (:metric minimize (total-cost))", "a", "a")
    assert (found.valid, found.metric_value) == (True, Decimal(6))
    found = run(domain, "(:init (p)) (:goal (p)) (:metric minimize (total-cost))")
    assert (found.valid, found.metric_value) == (True, Decimal(0))


def test_object_fluents_are_executed() -> None:
    domain = """(:types place box) (:predicates (free ?p - place))
      (:functions (at ?b - box) (home) - place)
      (:action put :parameters (?b - box ?p - place)
        :precondition (and (not (= (at ?b) ?p)) (free ?p))
        :effect (and (free (at ?b)) (not (free ?p)) (assign (at ?b) ?p)))
      (:action back :parameters (?b - box) :effect (assign (at ?b) (home)))"""
    problem = """(:objects a b - place x - box) (:init (free b) (= (at x) a))
      (:goal (and (= (at x) a) (free b)))"""
    assert run(domain, problem, "put x b", "put x a").valid
    assert failure(run(domain, problem, "put x a"))[3][0] == "(not (= (at x) a)): does not hold"
    assert "an object fluent in it has no value" in failure(run(domain, problem, "back x"))[3][0]
    assert (
        run(domain, problem.replace("(:init", "(:init (= (home) a)"), "put x b", "back x").valid
        is False
    )


def test_processes_and_events_are_refused_by_name() -> None:
    for kind in ("process", "event"):
        domain = f"(:predicates (p)) (:{kind} leak :parameters () :precondition (p) :effect (p))"
        domain = domain.replace(":effect (p)", ":effect (and)") if kind == "process" else domain
        with pytest.raises(UnsupportedConstructError, match=f"the {kind} leak"):
            run(domain, "(:init) (:goal (and))")


# Temporal plans.

OVEN = """(:requirements :typing :durative-actions :fluents) (:types cake)
  (:predicates (power) (hot) (baked ?c - cake) (free) (shut))
  (:functions (time ?c - cake) (heat))
  (:durative-action bake :parameters (?c - cake) :duration (= ?duration (time ?c))
    :condition (and (at start (free)) (over all (power)) (over all (shut)) (at end (shut)))
    :effect (and (at start (not (free))) (at end (free)) (at end (baked ?c))))
  (:durative-action preheat :parameters ()
    :duration (and (>= ?duration 2) (<= ?duration 5))
    :condition (at start (not (hot)))
    :effect (and (at end (hot)) (at end (increase (heat) (* 10 ?duration)))))
  (:action open :parameters () :precondition (shut) :effect (not (shut)))
  (:action close :parameters () :precondition (not (shut)) :effect (shut))"""
CAKES = """(:objects a b - cake)
  (:init (power) (free) (shut) (= (time a) 10) (= (time b) 5) (= (heat) 0))
  (:goal (and (baked a) (baked b))) (:metric minimize (+ (total-time) (heat)))"""


def test_a_temporal_plan_is_executed() -> None:
    found = run(OVEN, CAKES, "0 bake a / 10", "1 preheat / 3", "10.01 bake b / 5")
    assert found.valid, found
    assert found.makespan == Decimal("15.01")
    assert found.metric_value == Decimal("45.01")


def test_invariants_hold_between_start_and_end() -> None:
    found = run(OVEN, CAKES, "0 bake a / 10", "4 open", "6 close", "10.01 bake b / 5")
    assert failure(found) == (0, "6", "over all", ["(shut): does not hold"])
    found = run(OVEN, CAKES, "0 bake a / 10", "4 open")
    assert failure(found) == (0, "10", "over all", ["(shut): does not hold"])
    # An invariant need not hold at the start and the end themselves.
    found = run(
        OVEN, CAKES.replace("(shut)", ""), "0.5 close", "0.6 bake a / 10", "10.7 bake b / 5"
    )
    assert found.valid, found


def test_conditions_at_the_end_are_checked_there() -> None:
    found = run(OVEN, CAKES, "0 bake a / 10", "10.01 bake b / 5", "12 open")
    assert failure(found)[:3] == (1, "15.01", "over all")
    assert failure(run(OVEN, CAKES, "0 bake a / 10", "1 bake b / 5"))[:3] == (1, "1", "at start")


@pytest.mark.parametrize(
    ("duration", "valid"),
    [("2", True), ("5", True), ("1.995", True), ("5.01", True), ("1.98", False), ("5.02", False)],
)
def test_durations_meet_their_constraints_within_the_tolerance(duration: str, valid: bool) -> None:
    goal = CAKES.replace("(baked a) (baked b)", "(hot)")
    found = run(OVEN, goal, f"0 preheat / {duration}")
    assert found.valid is valid
    if not valid:
        assert failure(found)[:3] == (0, "0", "at start")
        assert f"sides are {duration} and" in failure(found)[3][0]


def test_a_step_needs_its_times() -> None:
    assert "a duration from 0 on" in failure(run(OVEN, CAKES, "0 bake a"))[3][0]
    early = PlanStep(Decimal(-1), "bake", ("a",), Decimal(10))
    domain = read_domain(f"(define (domain d) {OVEN})")
    problem = read_problem(f"(define (problem p) (:domain d) {CAKES})", domain=domain)
    found = validate_plan(domain, problem, Plan((early,), "by hand", "unknown"))
    assert "starts before the plan does" in failure(found)[3][0]


def test_steps_at_one_time_may_not_interfere() -> None:
    # The start of one needs what the end of the other makes true.
    found = run(OVEN, CAKES, "0 bake a / 10", "10 bake b / 5")
    assert failure(found) == (1, "10", "at start", ["(free): does not hold"])
    twice = CAKES.replace("(free)", "(free) (hot)")
    found = run(OVEN, twice, "0 open", "0.0005 bake a / 10")
    assert (
        failure(found)[3] == ["(shut): an action reads it at the same time as another changes it"]
        or failure(found)[2] == "over all"
    )


MUTEX = """(:predicates (p) (q) (r)) (:functions (f) (g))
  (:action add :parameters () :effect (p))
  (:action add2 :parameters () :effect (and (p) (q)))
  (:action delete :parameters () :effect (not (p)))
  (:action needs :parameters () :precondition (not (p)) :effect (q))
  (:action either :parameters () :precondition (or (r) (exists (?x) (p))) :effect (q))
  (:action up :parameters () :effect (increase (f) 1))
  (:action down :parameters () :effect (decrease (f) 2))
  (:action double :parameters () :effect (scale-up (f) 2))
  (:action copy :parameters () :effect (increase (g) (f)))
  (:action maybe :parameters () :effect (when (q) (p)))
  (:derived (derived) (p))
  (:action follows :parameters () :precondition (or (r) (derived)) :effect (q))"""


@pytest.mark.parametrize(
    ("one", "other", "reason"),
    [
        ("add", "add2", None),
        ("add", "delete", "(p): of two actions"),
        ("add", "needs", "(p): an action reads it"),
        ("add", "either", "(p): an action reads it"),
        ("add", "follows", "(p): an action reads it"),
        ("up", "down", None),
        ("up", "up", None),
        ("up", "double", "(f): two actions"),
        ("double", "double", "(f): two actions"),
        ("up", "copy", "(f): an action reads it"),
        ("copy", "copy", None),
        ("delete", "maybe", None),
        ("add2", "maybe", "(q): an action reads it"),
    ],
)
def test_interference(one: str, other: str, reason: str | None) -> None:
    problem = "(:objects o) (:init (r) (= (f) 1) (= (g) 0)) (:goal (and))"
    for steps in ((one, other), (other, one)):
        found = run(MUTEX, problem, *(f"1 {name}" for name in steps))
        assert found.valid == (reason is None), found
        if reason is not None:
            assert failure(found)[3][0].startswith(reason)
        one_by_one = run(MUTEX, problem, *(f"1.0{n} {name}" for n, name in enumerate(steps)))
        assert one_by_one.valid or steps == ("add", "needs")


def test_what_an_effect_at_the_end_depends_on_is_read_at_the_start() -> None:
    late = """(:durative-action late :parameters () :duration (= ?duration 2)
      :condition (and) :effect (when (at start (p)) (at end (q))))"""
    problem = "(:objects o) (:init (p)) (:goal (and))"
    for steps, is_valid in (
        (("1 late / 2", "1 delete"), False),
        (("1 delete", "1 late / 2"), False),
        (("1 late / 2", "2 delete"), True),
        (("1 late / 2", "3 delete"), True),
    ):
        found = run(MUTEX + late, problem, *steps)
        assert found.valid is is_valid, steps
        if not is_valid:
            assert failure(found)[2:] == (
                "at start",
                ["(p): an action reads it at the same time as another changes it"],
            )


def test_increases_at_one_time_add_up() -> None:
    problem = "(:init (= (f) 1)) (:goal (= (f) 1)) (:metric minimize (f))"
    found = run(MUTEX, problem, "1 up", "1 down", "1 up")
    assert (found.valid, found.metric_value) == (True, Decimal(1))


def test_timed_initial_literals_take_place() -> None:
    timed = CAKES.replace("(power)", "(at 3 (power)) (at 20 (not (power))) (at 4 (= (time b) 6))")
    assert failure(run(OVEN, timed, "2.99 bake a / 10"))[:3] == (0, "3", "over all")
    assert failure(run(OVEN, timed, "3.01 bake a / 10", "14 bake b / 6.5"))[3] == [
        "(= ?duration (time b)): the sides are 6.5 and 6; a duration may deviate by 0.01"
    ]
    assert failure(run(OVEN, timed, "3.01 bake a / 10", "15 bake b / 6"))[:2] == (1, "21")
    found = run(OVEN, timed, "3.01 bake a / 10", "13.02 bake b / 6")
    assert (found.valid, found.makespan) == (True, Decimal("19.02"))


@pytest.mark.parametrize("operator", ["=", "<=", ">=", "<", ">"])
def test_durations_have_one_tolerance(operator: str) -> None:
    domain = f"""(:durative-action wait :parameters () :duration ({operator} ?duration 2)
      :condition (and) :effect (and))"""
    for duration in ("1.989", "1.99", "1.995", "2", "2.005", "2.01", "2.011"):
        difference = Decimal(duration) - 2
        allowed = abs(difference) if operator == "=" else difference * (-1) ** (operator[0] == ">")
        is_valid = allowed < Decimal("0.01") or ("=" in operator and allowed == Decimal("0.01"))
        assert run(domain, "(:init) (:goal (and))", f"0 wait / {duration}").valid is is_valid


def test_what_happens_after_the_last_step_counts_for_the_goal() -> None:
    domain = "(:predicates (p) (q)) (:action a :parameters () :effect (p))"
    found = run(domain, "(:init (q) (at 9 (not (q)))) (:goal (and (p) (q)))", "1 a")
    assert [goal.condition for goal in found.unsatisfied_goals] == ["(q)"]


def test_conditional_effects_remember_their_start() -> None:
    domain = """(:requirements :durative-actions) (:types box)
      (:predicates (full ?b - box) (sent ?b - box) (checked ?b - box))
      (:durative-action send :parameters () :duration (= ?duration 5)
        :effect (forall (?b - box) (when (and (at start (full ?b)) (at end (checked ?b)))
          (at end (sent ?b)))))
      (:action check :parameters (?b - box) :effect (and (checked ?b) (not (full ?b))))"""
    problem = "(:objects a b c - box) (:init (full a) (full b)) (:goal (and (sent a) (sent {})))"
    found = run(domain, problem.format("b"), "0 send / 5", "1 check a", "2 check c")
    assert [goal.condition for goal in found.unsatisfied_goals] == ["(sent b)"]
    found = run(domain, problem.format("a"), "0 send / 5", "1 check a", "2 check c")
    assert found.valid


def test_effects_with_conditions_at_other_times_are_refused() -> None:
    domain = """(:requirements :durative-actions) (:predicates (p) (q))
      (:durative-action a :parameters () :duration (= ?duration 5)
        :effect (when (over all (p)) (at end (q))))"""
    with pytest.raises(UnsupportedConstructError, match="the action a has an effect at end"):
        run(domain, "(:init) (:goal (q))", "0 a / 5")


# Continuous change.

TANK = """(:requirements :durative-actions :fluents :duration-inequalities)
  (:predicates (running) (ready)) (:functions (level) (flow) (limit))
  (:durative-action fill :parameters () :duration (>= ?duration 0)
    :condition (over all (<= (level) (limit)))
    :effect (and (increase (level) (* #t (flow))) (at end (ready))))
  (:durative-action drain :parameters () :duration (>= ?duration 0)
    :condition (and (at start (> (level) 0)) (over all (>= (level) 0)))
    :effect (decrease (level) (* 2 #t)))
  (:durative-action watch :parameters () :duration (>= ?duration 0)
    :condition (over all (or (< (level) 3) (> (level) 4)))
    :effect (at end (running)))
  (:action faster :parameters () :effect (increase (flow) 1))
  (:action peek :parameters () :precondition (= (level) 2.5) :effect (running))"""
WATER = "(:init (= (level) 0) (= (flow) 1) (= (limit) 5)) (:goal (and)) (:metric minimize (level))"


def test_fluents_change_while_steps_run() -> None:
    found = run(TANK, WATER, "0 fill / 5", "2.5 peek")
    assert (found.valid, found.metric_value) == (True, Decimal(5)), found
    found = run(TANK, WATER, "0 fill / 5", "1 drain / 1")
    assert (found.valid, found.metric_value) == (True, Decimal(3)), found


def test_rates_change_with_what_they_depend_on() -> None:
    found = run(TANK, WATER, "0 fill / 3", "1 faster")
    assert (found.valid, found.metric_value) == (True, Decimal(5)), found


def test_invariants_are_checked_while_fluents_change() -> None:
    # The level reaches 5 at 5, beyond the open interval, and 5.5 at 5.5.
    assert failure(run(TANK, WATER, "0 fill / 5.5"))[:3] == (0, "5.5", "over all")
    assert failure(run(TANK, WATER, "0 fill / 2", "1 drain / 2"))[:3] == (1, "3", "over all")
    assert run(TANK, WATER, "0 fill / 3", "0.01 watch / 2.99").valid
    # Below 3 first, above 4 at the end, and neither in between.
    found = run(TANK, WATER, "0 fill / 5", "1 watch / 4")
    assert failure(found)[:3] == (1, "5", "over all")
    # 3 is reached at a single time, which the end of the first step is.
    assert failure(run(TANK, WATER, "0 fill / 4.5", "0.01 watch / 4"))[:3] == (
        1,
        "4.01",
        "over all",
    )


def test_derived_predicates_follow_what_changes_continuously() -> None:
    domain = (
        TANK.replace("(<= (level) (limit))", "(safe)").replace(
            "(running) (ready)", "(running) (ready) (safe)"
        )
        + " (:derived (safe) (and (<= (level) (limit)) (not (= (level) 2))))"
    )
    found = run(domain, WATER, "0 fill / 3")
    assert failure(found) == (0, "3", "over all", ["(safe): does not hold"])
    assert run(domain, WATER, "0 fill / 2").valid


def test_change_that_is_not_linear_is_refused() -> None:
    for effect in ("(* #t #t)", "(* #t (level))", "(+ #t 1)"):
        domain = TANK.replace("(* #t (flow))", effect)
        with pytest.raises(UnsupportedConstructError, match=r"linear|multiple of #t"):
            run(domain, WATER.replace("(level) 0", "(level) 1"), "0 fill / 2")
    domain = TANK.replace("(<= (level) (limit))", "(<= (* (level) (level)) (limit))")
    with pytest.raises(UnsupportedConstructError, match="product of two numbers that change"):
        run(domain, WATER, "0 fill / 2")


# Preferences and constraints.


def test_preferences_are_counted_wherever_they_stand() -> None:
    domain = """(:requirements :preferences :constraints) (:types t) (:predicates (p ?x - t) (q))
      (:action a :parameters (?x - t) :precondition (preference pre (p ?x)) :effect (q))
      (:action b :parameters (?x - t) :effect (p ?x))"""
    problem = """(:objects x y z - t) (:init)
      (:goal (and (q) (preference Soft (q)) (forall (?x - t) (preference each (p ?x)))
        (preference (forall (?x - t) (p ?x)))))
      (:constraints (and (preference once (at-most-once (q)))
        (forall (?x - t) (preference never (always (not (p ?x)))))))
      (:metric minimize (+ (* 10 (is-violated pre)) (is-violated EACH) (is-violated never)))"""
    found = run(domain, problem, "a x", "b x", "a x", "a y")
    assert found.valid
    assert dict(found.violated_preferences) == {"anonymous": 1, "each": 2, "never": 1, "pre": 2}
    assert found.metric_value == Decimal(23)
    assert "preference pre violated 2 times" in str(found)


def test_violated_constraints_are_named_with_their_time_and_step() -> None:
    domain = """(:requirements :constraints) (:types t) (:predicates (p ?x - t))
      (:action a :parameters (?x - t) :effect (p ?x))"""
    problem = """(:objects x y - t) (:init) (:goal (and))
      (:constraints (and (forall (?x - t) (sometime (p ?x))) (always (not (p y)))))"""
    found = run(domain, problem, "a x", "a y")
    assert not found.valid
    assert found.is_goal_reached
    assert [(one.constraint, one.time, one.position) for one in found.violated_constraints] == [
        ("(always (not (p y)))", Decimal(2), 1)
    ]
    assert "(always (not (p y))) is violated at 2" in str(found)


def test_an_empty_plan_is_judged_by_the_initial_state() -> None:
    found = run(ROOMS, HALL)
    assert (found.failed_step, found.makespan) == (None, Decimal(0))
    assert [goal.condition for goal in found.unsatisfied_goals] == ["(not (lit attic))"]
