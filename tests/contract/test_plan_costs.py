"""Costs of actions by what became of executions: the formula, what planners get, what is kept."""

from __future__ import annotations

import math
from typing import Any

import pytest

from kant_sql import KnowledgeBase, Plan, PlanStep
from kant_sql.documents.exchange import read_task
from kant_sql.errors import InvalidArgumentError, UnsupportedConstructError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.reasoning import search
from tests.support.reading import as_actor, loaded

DOMAIN = """
(define (domain floor) (:requirements :typing :durative-actions :fluents)
  (:types room door - object fire-door - door)
  (:predicates (in ?p - room) (between ?d - door ?a ?b - room) (free ?d - door))
  (:functions (total-cost) (passed))
  (:action Pass :parameters (?d - door ?a ?b - room)
    :precondition (and (in ?a) (between ?d ?a ?b))
    :effect (and (not (in ?a)) (in ?b) (increase (total-cost) 7) (increase (passed) 1)))
  (:action wait :parameters ())
  (:durative-action free-it :parameters (?d - door) :duration (= ?duration 60)
    :effect (at end (free ?d))))
"""
PROBLEM = """
(define (problem day) (:domain floor) (:objects hall office - room glass - fire-door steel - door)
  (:init (in hall) (between glass hall office) (= (total-cost) 0) (= (passed) 0))
  (:goal (in office)){})
"""
STEP = PlanStep(None, "pass", ("glass", "hall", "office"))


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What a planner is given that takes no time and knows one plan."""
    calls: list[Any] = []

    def solve(domain: Any, **rest: Any) -> Plan:
        calls.append((domain, rest["problem"], rest["is_costed"]))
        return Plan((STEP,), "one", "solved_satisficing")

    monkeypatch.setattr("kant_sql.planning.solve", solve)
    return calls


def report(kb: KnowledgeBase, *arguments: str, worked: int = 0, failed: int = 0) -> None:
    """Pass a door some times, in ten seconds each, without times of its own."""
    for outcome, count in (("succeeded", worked), ("failed", failed)):
        for _ in range(count):
            kb.executions.report(
                "pass",
                arguments=arguments,
                outcome=outcome,  # type: ignore[arg-type]
                started_at="2026-01-01T00:00:00Z",
                ended_at="2026-01-01T00:00:10Z",
            )


def begin(kb: KnowledgeBase, metric: str = "") -> None:
    loaded(kb, DOMAIN, PROBLEM.format(metric))


def costs(plan: Plan) -> dict[str, int]:
    """The costs in the problem that a planner was given, as hundredths of a second."""
    assert plan.problem_pddl is not None
    assert plan.domain_pddl is not None
    domain = read_domain(plan.domain_pddl)
    values = read_problem(plan.problem_pddl, domain=domain).values
    return {str(one.fluent): int(str(one.value)) for one in values}


def test_costs_are_those_of_the_formula(fresh_kb: KnowledgeBase, given: list[Any]) -> None:
    begin(fresh_kb)
    report(fresh_kb, "glass", "hall", "office", worked=4, failed=3)
    report(fresh_kb, "STEEL", "hall", "office", worked=9)
    plan = fresh_kb.plan(costs="history")
    of_action = 14 / 18
    expected = {
        "(cost-of-Pass glass hall office)": 10 / ((4 + 2 * of_action) / 9),
        "(cost-of-Pass steel hall office)": 10 / ((9 + 2 * of_action) / 11),
        "(cost-of-Pass steel office hall)": 10 / of_action,
    }
    found = costs(plan)
    assert {key: found[key] for key in expected} == {
        key: math.ceil(100 * seconds) for key, seconds in expected.items()
    }
    assert len(found) == 2 * 2 * 2 + 1
    domain, problem, is_costed = given[0]
    text = str(plan.domain_pddl)
    assert (domain, problem) == (read_domain(text), read_problem(str(plan.problem_pddl)))
    assert is_costed
    # What was never done takes as long as all that was, and succeeds half of the time.
    assert "(increase (total-cost) 2000)" in text
    assert "(at end (increase (total-cost) 2000))" in text
    assert "passed" not in text


def test_without_executions_each_step_costs_the_same(
    fresh_kb: KnowledgeBase, given: list[Any]
) -> None:
    begin(fresh_kb)
    plan = fresh_kb.plan(costs="history")
    assert costs(plan) == {"(total-cost)": 0}
    assert str(plan.domain_pddl).count("(increase (total-cost) 1)") == 3
    assert fresh_kb.plan().domain_pddl is None
    assert [is_costed for _, _, is_costed in given] == [True, False]


def test_an_object_whose_name_is_erased_keeps_its_costs(
    fresh_kb: KnowledgeBase, given: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(fresh_kb)
    report(fresh_kb, "glass", "hall", "office", worked=4, failed=3)
    expected = costs(fresh_kb.plan(costs="history"))["(cost-of-Pass glass hall office)"]

    def reading(state: Any) -> Any:
        found = read_task(state)
        monkeypatch.setattr(search, "read_task", read_task)
        as_actor(fresh_kb, "eraser").erase("steel", reason="asked")
        as_actor(fresh_kb, "eraser").erase("glass", reason="asked")
        return found

    monkeypatch.setattr(search, "read_task", reading)
    found = costs(fresh_kb.plan(costs="history"))
    assert found["(cost-of-Pass erased-2 hall office)"] == expected


@pytest.mark.more
def test_a_plan_keeps_its_costs(fresh_kb: KnowledgeBase, given: list[Any]) -> None:
    begin(fresh_kb)
    report(fresh_kb, "glass", "hall", "office", worked=1)
    known = fresh_kb.revision
    plan = fresh_kb.plan(costs="history")
    report(fresh_kb, "glass", "hall", "office", failed=5)
    assert fresh_kb.at(known).plan(costs="history") == plan
    assert fresh_kb.plan(costs="history").problem_hash != plan.problem_hash
    made = fresh_kb.plans.record(plan)
    assert (made.problem_pddl(), made.domain_pddl()) == (plan.problem_pddl, plan.domain_pddl)
    assert made.objective == "minimize (total-cost)"
    assert fresh_kb.validate(made).valid
    assert fresh_kb.store.verify().is_intact


def test_the_metric_gives_way_and_is_named(fresh_kb: KnowledgeBase, given: list[Any]) -> None:
    begin(fresh_kb, "(:metric minimize (total-cost))")
    plan = fresh_kb.plan(costs="history")
    assert plan.ignored == ("the metric (minimize (total-cost)): costs of history",)
    assert "(increase (total-cost) 7)" not in str(plan.domain_pddl)
    fresh_kb.pddl.metric.set("(:metric maximize (passed))")
    plan = fresh_kb.plan(costs="history")
    assert plan.ignored == ("the metric (maximize (passed)): costs of history",)
    with pytest.raises(UnsupportedConstructError, match="costs of history"):
        fresh_kb.plan(costs="history", strict=True)
    with pytest.raises(InvalidArgumentError, match="history"):
        fresh_kb.plan(costs="time")  # type: ignore[arg-type]


def test_many_objects_share_the_costs_of_the_action(
    fresh_kb: KnowledgeBase, given: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kant_sql.reasoning.search.MOST_COSTS", 7)
    begin(fresh_kb)
    report(fresh_kb, "glass", "hall", "office", worked=1)
    plan = fresh_kb.plan(costs="history")
    assert plan.ignored == ("what became of Pass with its objects: more than 7",)
    assert costs(plan) == {"(total-cost)": 0}
    assert given


@pytest.mark.more
@pytest.mark.parametrize(("engine", "duration"), [("aries", True), (None, False)])
def test_planners_go_around_what_fails(
    fresh_kb: KnowledgeBase, engine: str | None, duration: bool
) -> None:
    fresh_kb.load_domain(
        """
        (define (domain ways) (:requirements :typing :durative-actions) (:types room)
          (:predicates (in ?p - room) (way ?a ?b - room))
          (:durative-action pass :parameters (?a ?b - room) :duration (= ?duration 5)
            :condition (and (at start (in ?a)) (over all (way ?a ?b)))
            :effect (and (at start (not (in ?a))) (at end (in ?b)))))
        """
        if duration
        else """
        (define (domain ways) (:requirements :typing) (:types room)
          (:predicates (in ?p - room) (way ?a ?b - room))
          (:action pass :parameters (?a ?b - room) :precondition (and (in ?a) (way ?a ?b))
            :effect (and (not (in ?a)) (in ?b))))
        """
    )
    fresh_kb.load_problem("""
        (define (problem day) (:domain ways) (:objects a b c - room)
          (:init (in a) (way a c) (way a b) (way b c)) (:goal (in c)))
    """)
    report(fresh_kb, "a", "c", worked=2, failed=8)
    report(fresh_kb, "a", "b", worked=9)
    report(fresh_kb, "b", "c", worked=9)
    plan = fresh_kb.plan(engine, costs="history", timeout=200)
    assert [step.arguments for step in plan.steps] == [("a", "b"), ("b", "c")]
    assert fresh_kb.validate(plan).valid
