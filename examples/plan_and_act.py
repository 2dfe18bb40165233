"""Plan from the store, act, record what happened, and replan after a surprise.

python examples/plan_and_act.py [URL]

By default, the store is in memory. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import kant_sql
from kant_sql import KnowledgeBase, NotApplicableError
from kant_sql.planning import Plan, PlanStep

DOMAIN = """
(define (domain delivery)
  (:requirements :strips :typing)
  (:types place parcel)
  (:constants dock - place)
  (:predicates (robot_at ?p - place) (parcel_at ?b - parcel ?p - place)
    (holding ?b - parcel) (gripper_free) (connected ?from ?to - place))
  (:action move
    :parameters (?from ?to - place)
    :precondition (and (robot_at ?from) (connected ?from ?to))
    :effect (and (not (robot_at ?from)) (robot_at ?to)))
  (:action pick
    :parameters (?b - parcel ?p - place)
    :precondition (and (robot_at ?p) (parcel_at ?b ?p) (gripper_free))
    :effect (and (holding ?b) (not (parcel_at ?b ?p)) (not (gripper_free))))
  (:action put
    :parameters (?b - parcel ?p - place)
    :precondition (and (robot_at ?p) (holding ?b))
    :effect (and (parcel_at ?b ?p) (not (holding ?b)) (gripper_free))))
"""
PROBLEM = """
(define (problem monday)
  (:domain delivery)
  (:objects hall office - place letter - parcel)
  (:init (robot_at dock) (gripper_free) (parcel_at letter hall)
    (connected dock hall) (connected hall dock) (connected hall office) (connected office hall))
  (:goal (and (parcel_at letter office) (robot_at dock))))
"""


def act(kb: KnowledgeBase, steps: Sequence[PlanStep]) -> bool:
    """Execute steps, each as one revision, until one is not applicable."""
    for step in steps:
        try:
            kb.apply(step, reason=f"{step} succeeded")
        except NotApplicableError as error:
            print(error)
            return False
    return True


def surprise(kb: KnowledgeBase) -> None:
    """Save an observation: the letter is not where the robot believes."""
    with kb.transaction(actor="perception", reason="the letter was seen at the dock"):
        kb.propositions.delete("(parcel_at letter hall)")
        kb.propositions.save("(parcel_at letter dock)")


def show(plan: Plan) -> None:
    """Print a plan and its revision."""
    print(f"Plan of revision {plan.revision}, by {plan.engine}:", *plan.steps, sep="\n  ")


def main(url: str) -> None:
    """Deliver the letter."""
    with kant_sql.connect(url, knowledge_base="delivery", actor="executive") as kb:
        with kb.transaction(actor="operator", reason="Monday's mission"):
            kb.load_domain(DOMAIN)
            kb.load_problem(PROBLEM)
        plan = kb.plan(timeout=60)
        show(plan)
        act(kb, plan.steps[:1])
        surprise(kb)
        if not act(kb, plan.steps[1:]):
            plan = kb.plan(timeout=60)
            show(plan)
            act(kb, plan.steps)
        print("The goals are reached." if not kb.unsatisfied() else "The goals are not reached.")
        print("What happened:")
        for revision in kb.store.revisions():
            print(f"  {revision.number} {revision.actor}: {revision.reason}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")
