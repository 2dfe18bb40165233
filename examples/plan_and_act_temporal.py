"""Plan with durations, execute steps in halves, lose an invariant on the way, and replan.

python examples/plan_and_act_temporal.py [URL]

By default, the store is in memory. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from decimal import Decimal

import kant_sql
from kant_sql import Execution, KnowledgeBase
from kant_sql.plans import RecordedPlan

DOMAIN = """
(define (domain ward)
  (:requirements :typing :durative-actions :numeric-fluents)
  (:types robot place)
  (:predicates (at ?r - robot ?p - place) (door ?from ?to - place) (open ?from ?to - place)
    (disinfected ?p - place))
  (:functions (seconds ?from ?to - place))
  (:durative-action hold_door
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration 40)
    :condition (and (over all (at ?r ?from)) (at start (door ?from ?to)))
    :effect (and (at start (open ?from ?to)) (at end (not (open ?from ?to)))))
  (:durative-action drive
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration (seconds ?from ?to))
    :condition (and (at start (at ?r ?from)) (over all (open ?from ?to)))
    :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))))
  (:durative-action disinfect
    :parameters (?r - robot ?p - place)
    :duration (= ?duration 60)
    :condition (over all (at ?r ?p))
    :effect (at end (disinfected ?p))))
"""
PROBLEM = """
(define (problem round)
  (:domain ward)
  (:objects rb1 rb2 - robot hall room - place)
  (:init (at rb1 hall) (at rb2 hall) (door hall room) (= (seconds hall room) 25))
  (:goal (and (disinfected room) (at rb2 hall))))
"""
# When the door slips out of the gripper, in seconds from the start.
SLIP = Decimal(9)


def halves(plan: RecordedPlan) -> Iterator[tuple[Decimal, bool, Execution]]:
    """Yield the starts and the ends of a plan's steps, by time; ends come first."""
    found = []
    for step in plan.steps:
        assert step.start is not None
        assert step.duration is not None
        found += [(step.start, True, step), (step.start + step.duration, False, step)]
    yield from sorted(found, key=lambda half: half[:2])


def act(kb: KnowledgeBase, plan: RecordedPlan, slip: Decimal | None = None) -> None:
    """Execute a plan; when an invariant breaks, start nothing more, and let the rest end."""
    lost: set[str] = set()
    for time, is_start, step in halves(plan):
        if slip is not None and time > slip:
            lost |= surprise(kb, slip)
            slip = None
        if is_start and not lost:
            kb.start(step, reason=f"at {time:f} s")
        elif not is_start and step.id not in lost and is_running(kb, step):
            kb.end(step, reason=f"at {time:f} s")


def is_running(kb: KnowledgeBase, step: Execution) -> bool:
    """Return whether a step was started and has not ended."""
    now = kb.executions.get(step.id)
    return now is not None and now.outcome == "running"


def surprise(kb: KnowledgeBase, time: Decimal) -> set[str]:
    """Save that the door has shut, and abort the steps that need it; return their ids."""
    with kb.transaction(actor="camera", reason=f"the door slipped at {time} s"):
        kb.propositions.delete("(open hall room)")
    broken = kb.pddl.broken_invariants()
    for each in broken:
        print(each)
        robot, start, _ = each.step.arguments
        with kb.transaction(reason=f"{robot} drove back"):
            kb.abort(each.step)
            kb.propositions.save(f"(at {robot} {start})")
    return {each.step.id for each in broken}


def plan_anew(kb: KnowledgeBase) -> RecordedPlan:
    """Plan from the present state, record the plan, and print it."""
    found = kb.plan(engine="aries", timeout=60)
    print(f"Plan of revision {found.revision}:", *found.steps, sep="\n  ")
    return kb.plans.record(found)


def main(url: str) -> None:
    """Disinfect the room behind the door."""
    with kant_sql.connect(url, knowledge_base="ward", actor="executive") as kb:
        with kb.transaction(actor="operator", reason="the evening round"):
            kb.load_domain(DOMAIN)
            kb.load_problem(PROBLEM)
        act(kb, plan_anew(kb), SLIP)
        if kb.unsatisfied():
            act(kb, plan_anew(kb))
        print("The goals are reached." if not kb.unsatisfied() else "The goals are not reached.")
        print("What became of the steps:")
        for number, plan in enumerate(kb.plans.get_all(), start=1):
            for step in plan.steps:
                print(f"  plan {number} {step}: {step.outcome or 'not started'}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")
