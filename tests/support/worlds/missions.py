"""A mission that tests share: a robot drives from place to place by a plan."""

from __future__ import annotations

from decimal import Decimal

from kant_sql import KnowledgeBase
from kant_sql.planning import Plan, PlanStep
from kant_sql.plans import RecordedPlan
from tests.support.reading import beside

DOMAIN = """
(define (domain tour)
  (:requirements :typing :durative-actions :numeric-fluents :time)
  (:types place robot - object dock - place)
  (:constants Home - dock)
  (:predicates (at ?r - robot ?p - place) (idle) (dirty ?p - place))
  (:functions (total-cost) - number)
  (:durative-action Move
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration 5)
    :condition (at start (at ?r ?from))
    :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))))
  (:action rest :parameters () :precondition () :effect (idle))
  (:action charge :parameters (?r - robot ?d - dock) :precondition (at ?r ?d) :effect (idle))
  (:event spill :parameters (?p - place) :precondition (idle) :effect (dirty ?p)))
"""
PROBLEM = """
(define (problem monday)
  (:domain tour)
  (:objects rb1 - robot Wp1 wp2 - place)
  (:init (at rb1 wp1) (= (total-cost) 0))
  (:goal (and (at rb1 wp2) (idle)))
  (:metric minimize (total-cost)))
"""


def step(
    action: str, *arguments: str, start: str = "0.000", duration: str | None = None
) -> PlanStep:
    return PlanStep(
        Decimal(start), action, arguments, None if duration is None else Decimal(duration)
    )


STEPS = (
    step("MOVE", "RB1", "wp1", "WP2", duration="5.000"),
    step("move", "rb1", "wp2", "home", start="5.010", duration="5.000"),
    step("charge", "rb1", "Home", start="10.1"),
    step("rest", start="11"),
)
TOUR = Plan(STEPS, "hand", "solved_satisficing")


def plan_of(*steps: PlanStep, revision: int | None = None) -> Plan:
    return Plan(steps, "hand", "solved_satisficing", revision)


def begin(kb: KnowledgeBase) -> None:
    """Save the mission in a knowledge base, in one revision."""
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)


def recorded(kb: KnowledgeBase) -> RecordedPlan:
    """Begin the mission, and record its plan, in two revisions."""
    begin(kb)
    return kb.plans.record(TOUR)


def arrive(kb: KnowledgeBase, place: str) -> None:
    """Save that the robot is at one more place."""
    assert kb.propositions.insert(f"(at rb1 {place})")


def beside_of(kb: KnowledgeBase) -> KnowledgeBase:
    """Return a knowledge base in the same store that was never written to."""
    return beside(kb, f"beside {kb.store.factory._store.name}")  # type: ignore[attr-defined]
