"""Plans validated from states of a store: present, past, in a transaction, recorded."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any

import pytest

from kant_sql import (
    InvalidKnowledgeError,
    KnowledgeBase,
    Plan,
    PlanStep,
    UnknownRevisionError,
    UnsupportedConstructError,
)
from kant_sql.errors import PddlError, PlanError
from tests.support.reading import loaded, nothing_changes, present
from tests.support.statements import count

DOMAIN = """(define (domain rounds) (:requirements :adl :fluents)
  (:types robot place) (:constants home - place)
  (:predicates (At ?r - robot ?p - place) (road ?from ?to - place) (checked ?p - place)
    (linked ?from ?to - place))
  (:functions (battery ?r - robot) (total-cost))
  (:derived (linked ?from ?to) (or (road ?from ?to)
    (exists (?via - place) (and (road ?from ?via) (linked ?via ?to)))))
  (:action Move :parameters (?r - robot ?from ?to - place)
    :precondition (and (At ?r ?from) (linked ?from ?to) (> (battery ?r) 1))
    :effect (and (not (At ?r ?from)) (At ?r ?to) (decrease (battery ?r) 1.5)
      (increase (total-cost) 2)))
  (:action check :parameters (?r - robot ?p - place) :precondition (At ?r ?p)
    :effect (checked ?p)))"""
PROBLEM = """(define (problem night) (:domain rounds)
  (:objects rb1 - robot hall lab - place)
  (:init (At rb1 home) (road home hall) (road hall lab) (road lab home)
    (= (battery rb1) 4) (= (total-cost) 0))
  (:goal (and (checked lab) (preference back (At rb1 home)))) (:constraints (always (exists
    (?p - place) (At rb1 ?p))))
  (:metric minimize (+ (total-cost) (* 5 (is-violated back)))))"""
PLAN = Plan.read("(move RB1 home LAB)\n(check rb1 lab)\n")


@pytest.fixture
def rounds(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with a robot at home."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def leave(kb: KnowledgeBase) -> None:
    """Have the robot leave home for the hall."""
    kb.propositions.save("(At rb1 hall)")
    kb.propositions.delete("(At rb1 home)")


def test_a_plan_is_executed_and_nothing_is_written(rounds: KnowledgeBase) -> None:
    with nothing_changes(rounds):
        found = rounds.validate(PLAN)
    assert found.valid
    assert found.is_goal_reached
    assert found.failed_step is None
    assert (found.makespan, found.metric_value) == (Decimal(2), Decimal(7))
    assert found.violated_preferences == {"back": 1}
    assert found.violated_constraints == ()


def test_the_state_is_that_of_the_store(rounds: KnowledgeBase) -> None:
    leave(rounds)
    failed = present(rounds.validate(PLAN).failed_step)
    assert failed.position == 0
    assert failed.step == PLAN.steps[0]
    assert [str(one) for one in failed.unsatisfied] == ["(At rb1 home): does not hold"]
    again = Plan.read("(move rb1 hall lab)\n(check rb1 lab)\n")
    assert rounds.validate(again).valid


def test_a_past_state_is_chosen_by_revision_or_time(rounds: KnowledgeBase) -> None:
    before = rounds.revision
    leave(rounds)
    after = rounds.revision
    moment = rounds.store.revisions(before - 1, limit=1)[0].committed_at
    assert not rounds.validate(PLAN).valid
    assert rounds.validate(PLAN, at=before).valid
    assert rounds.validate(PLAN, at=moment).valid
    assert rounds.at(before).validate(PLAN).valid
    assert not rounds.validate(PLAN, at=after).valid
    # Before the domain was loaded, there was nothing to execute.
    failed = present(rounds.validate(PLAN, at=0).failed_step)
    assert "there is no action move" in str(failed)


def test_a_view_of_the_past_knows_nothing_later(rounds: KnowledgeBase) -> None:
    before = rounds.revision
    leave(rounds)
    past = rounds.at(before)
    assert past.validate(PLAN, at=before).valid
    with pytest.raises(UnknownRevisionError):
        past.validate(PLAN, at=before + 1)
    with pytest.raises(UnknownRevisionError, match="future"):
        rounds.validate(PLAN, at=datetime.now(UTC) + timedelta(days=1))


def test_a_transaction_is_executed_with_what_is_pending(rounds: KnowledgeBase) -> None:
    with rounds.transaction():
        leave(rounds)
        assert not rounds.validate(PLAN).valid
        assert rounds.validate(PLAN, at=rounds.revision).valid
        assert rounds.validate(Plan.read("(move rb1 hall lab)\n(check rb1 lab)\n")).valid


def test_recorded_plans_are_executed_from_any_state(rounds: KnowledgeBase) -> None:
    recorded = rounds.plans.record(PLAN)
    assert rounds.validate(recorded).valid
    leave(rounds)
    found = rounds.validate(recorded)
    assert present(found.failed_step).step == recorded.steps[0]
    assert str(found).startswith("the plan is not valid\nstep 0, (Move rb1 home lab), fails at 1:")
    assert rounds.validate(recorded, at=recorded.revision).valid
    # A view of a state before the plan was recorded does not list it, and executes it.
    before = rounds.at(recorded.revision)
    assert (before.plans.get_all(), before.validate(recorded.id).valid) == ([], True)
    assert before.pddl.causal_links(recorded.id) == rounds.pddl.causal_links(recorded)


def test_goals_constraints_and_numbers_are_judged(rounds: KnowledgeBase) -> None:
    found = rounds.validate(Plan.read("(move rb1 home lab)\n(move rb1 lab home)\n"))
    assert [str(goal) for goal in found.unsatisfied_goals] == ["(checked lab): does not hold"]
    assert (found.valid, found.violated_preferences) == (False, {})
    tired = Plan.read("(move rb1 home lab)\n(move rb1 lab home)\n(move rb1 home lab)\n")
    failed = present(rounds.validate(tired).failed_step)
    (unsatisfied,) = failed.unsatisfied
    assert (failed.position, str(unsatisfied)) == (2, "(> (battery rb1) 1): the sides are 1 and 1")
    assert (unsatisfied.left, unsatisfied.right) == (Decimal(1), Decimal(1))


def test_what_is_no_plan_is_refused(rounds: KnowledgeBase) -> None:
    with pytest.raises(InvalidKnowledgeError, match="the plan is a Plan, its id, its text, its"):
        rounds.validate(None)  # type: ignore[arg-type]
    junk: Any
    for junk, problem in (([3], "3 is not a step"), (["(a) (b)"], "line"), (7, "has no plan 7")):
        with pytest.raises((PlanError, PddlError), match=problem):
            rounds.validate(junk)


def test_a_plan_is_its_text_its_steps_or_its_id(rounds: KnowledgeBase) -> None:
    plan = Plan.read("(move rb1 home lab)\n(move rb1 lab home)\n")
    recorded = rounds.plans.record(plan)
    given: Any
    for given in (
        str(plan),
        recorded.id,
        ["move rb1 home lab", plan.steps[1]],
        (each for each in recorded.steps),
    ):
        assert rounds.validate(given) == rounds.validate(plan)


def test_processes_are_refused_by_name(rounds: KnowledgeBase) -> None:
    rounds.load_domain(
        """(define (domain leaks) (:predicates (p)) (:functions (f))
          (:process leak :parameters () :precondition (p) :effect (increase (f) (* #t 1))))"""
    )
    with pytest.raises(UnsupportedConstructError, match="the process leak"):
        rounds.validate(PLAN)


def test_statements_do_not_grow_with_the_plan(rounds: KnowledgeBase) -> None:
    long = Plan(tuple([PlanStep(None, "check", ("rb1", "home"))] * 200), "by hand", "unknown")
    rounds.validate(PLAN)
    few = count(lambda: rounds.validate(PLAN))
    assert count(lambda: rounds.validate(long)) == few < 30
