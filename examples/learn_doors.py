"""A robot learns which doors to avoid: it plans by what became of its steps.

python examples/learn_doors.py [URL] [MISSIONS]

The building is simulated. The store is in memory when no other is named, and there are 200 missions
each way. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import random
import sys
from datetime import UTC, datetime, timedelta
from typing import Literal, NamedTuple

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.planning import Plan, PlanStep

DOMAIN = """
(define (domain building)
  (:requirements :strips :typing)
  (:types room door)
  (:predicates (in ?r - room) (joins ?d - door ?a ?b - room))
  (:action pass
    :parameters (?d - door ?a ?b - room)
    :precondition (and (in ?a) (joins ?d ?a ?b))
    :effect (and (not (in ?a)) (in ?b))))
"""
PROBLEM = """
(define (problem rounds)
  (:domain building)
  (:objects dock hall yard garden ward - room front fire_door gate arch side - door)
  (:init (in dock) (joins front dock hall) (joins fire_door hall ward)
    (joins gate dock yard) (joins arch yard garden) (joins side garden ward))
  (:goal (in ward)))
"""


class Door(NamedTuple):
    """How long a door takes, how often it opens, and how long the robot waits if it does not."""

    seconds: float
    opens: float
    patience: float = 60


DOORS = {
    "front": Door(12, 0.99),
    "fire_door": Door(10, 0.67),
    "gate": Door(14, 0.98),
    "arch": Door(9, 1),
    "side": Door(15, 0.97),
}
# How often the robot tries a door before it gives up.
TRIES = 2
BEGIN = datetime(2026, 3, 2, 8, tzinfo=UTC)


class Building:
    """The robot among its doors, and the time."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb, self._dice, self.now = kb, random.Random(7), BEGIN

    def mission(self, plan: Plan) -> bool:
        """Execute a plan from the dock; return whether it reached the ward."""
        done = all(any(self._pass(step) for _ in range(TRIES)) for step in plan.steps)
        # Somebody brings the robot back.
        with self._kb.transaction(actor="porter", reason="the mission is over"):
            self._kb.propositions.delete_all(self._kb.propositions.get_by_predicate("in"))
            self._kb.propositions.save("(in dock)")
        return done

    def _pass(self, step: PlanStep) -> bool:
        """Try a door, and record what became of it."""
        name, start, end = step.arguments
        door, began = DOORS[name], self.now
        opens = self._dice.random() < door.opens
        mean = door.seconds if opens else door.patience
        self.now += timedelta(seconds=round(mean * self._dice.uniform(0.9, 1.2), 1))
        with self._kb.transaction(actor="executive"):
            self._kb.executions.report(
                step.action,
                arguments=step.arguments,
                outcome="succeeded" if opens else "failed",
                code=None if opens else "BLOCKED",
                started_at=began,
                ended_at=self.now,
            )
            if opens:
                self._kb.propositions.delete(f"(in {start})")
                self._kb.propositions.save(f"(in {end})")
        return opens


def missions(
    building: Building, kb: KnowledgeBase, count: int, costs: Literal["history"] | None
) -> float:
    """Plan and execute missions, and say how they went; return the share of success."""
    began = building.now
    plan = kb.plan("fast-downward-opt", costs=costs, timeout=120)
    kb.plans.record(plan)
    reached = sum(building.mission(plan) for _ in range(count))
    seconds = (building.now - began).total_seconds() / count
    way = " ".join(step.arguments[0] for step in plan.steps)
    print(f"{count} missions by {way}: {reached / count:.1%} succeeded, {seconds:.1f} s each")
    return reached / count


def main(url: str, count: int) -> None:
    """Carry out missions by the shortest way, then by what was learned."""
    with kant_sql.connect(url, knowledge_base="building", actor="operator") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        building = Building(kb)
        # A new robot is shown each door a few times.
        round_trip = [
            ("gate", "dock", "yard"),
            ("arch", "yard", "garden"),
            ("side", "garden", "ward"),
        ]
        shown = Plan(tuple(PlanStep(None, "pass", step) for step in round_trip), "by hand", "")
        for _ in range(5):
            building.mission(shown)
        before = missions(building, kb, count, None)
        after = missions(building, kb, count, "history")
        for door in kb.statistics(by=["arguments"]):
            low, high = door.interval or (0, 1)
            print(f"{door} {door.count} times, {low:.0%} to {high:.0%} succeed, {door.median:g} s")
        print("Learning helped." if after > before else "Learning did not help.")


if __name__ == "__main__":
    words = sys.argv[1:]
    main(words[0] if words else "sqlite://", int(words[1]) if len(words) > 1 else 200)
