"""Plan with fuel, act, find less fuel than planned, and replan by way of the pump.

python examples/plan_and_act_numeric.py [URL]

By default, the store is in memory. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import kant_sql
from kant_sql import KnowledgeBase, NotApplicableError
from kant_sql.planning import Plan, PlanStep

DOMAIN = """
(define (domain courier)
  (:requirements :typing :numeric-fluents)
  (:types van place)
  (:predicates (at ?v - van ?p - place) (road ?from ?to - place) (pump ?p - place)
    (visited ?p - place))
  (:functions (fuel ?v - van) (tank ?v - van) (length ?from ?to - place))
  (:action drive
    :parameters (?v - van ?from ?to - place)
    :precondition (and (at ?v ?from) (road ?from ?to) (>= (fuel ?v) (length ?from ?to)))
    :effect (and (not (at ?v ?from)) (at ?v ?to) (visited ?to)
      (decrease (fuel ?v) (length ?from ?to))))
  (:action refuel
    :parameters (?v - van ?p - place)
    :precondition (and (at ?v ?p) (pump ?p))
    :effect (assign (fuel ?v) (tank ?v))))
"""
PROBLEM = """
(define (problem tour)
  (:domain courier)
  (:objects blue - van depot village farm garage - place)
  (:init (at blue depot) (= (fuel blue) 20) (= (tank blue) 20) (pump garage)
    (road depot village) (= (length depot village) 6.5)
    (road village farm) (= (length village farm) 8)
    (road village garage) (= (length village garage) 1.5)
    (road garage village) (= (length garage village) 1.5))
  (:goal (visited farm)))
"""


def act(kb: KnowledgeBase, steps: Sequence[PlanStep]) -> bool:
    """Execute steps, each as one revision, until one is not applicable."""
    for step in steps:
        try:
            kb.apply(step, reason=f"{step} succeeded")
        except NotApplicableError as error:
            for part in error.unsatisfied:
                print(f"{step} needs {part.condition}, which is {part.left} and {part.right}.")
            return False
        print(f"{step} leaves fuel for {fuel(kb)}.")
    return True


def fuel(kb: KnowledgeBase) -> str:
    """Return how far the van can drive."""
    return str(kb.function_values.get("fuel", objects=["blue"]))


def surprise(kb: KnowledgeBase) -> None:
    """Save the gauge's value: there is less fuel than planned."""
    with kb.transaction(actor="gauge", reason="the tank leaks"):
        kb.function_values.set("fuel", objects=["blue"], value=3.5)


def show(plan: Plan) -> None:
    """Print a plan and its revision."""
    print(f"Plan of revision {plan.revision}, by {plan.engine}:", *plan.steps, sep="\n  ")


def main(url: str) -> None:
    """Visit the farm."""
    with kant_sql.connect(url, knowledge_base="courier", actor="executive") as kb:
        with kb.transaction(actor="operator", reason="the tour"):
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
        print("What became of the fuel:")
        for version in kb.history("(fuel blue)"):
            since = version.since
            print(f"  {since.number} {since.actor}, {since.reason}: {version.text}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")
