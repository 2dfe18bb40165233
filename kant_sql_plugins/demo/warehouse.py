"""A warehouse whose robots learn which doors to avoid; `examples/learn_doors.py` plans in it."""

from __future__ import annotations

import random
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from kant_sql import KnowledgeBase
from kant_sql.planning import Plan, PlanStep

from .stories import Connect, Step, World

DOMAIN = """
(define (domain warehouse)
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
  (:domain warehouse)
  (:objects dock hall yard garden store - room front fire_door gate arch side - door)
  (:init (in dock) (joins front dock hall) (joins fire_door hall store)
    (joins gate dock yard) (joins arch yard garden) (joins side garden store))
  (:goal (in store)))
"""


class Door(NamedTuple):
    """A door: seconds to pass, how often it opens, and how long the robot waits if it does not."""

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
# Attempts to open a door before the robot gives up.
TRIES = 2


class Building:
    """The robots among its doors, one at a time, and the time."""

    def __init__(self, kb: KnowledgeBase, begin: datetime) -> None:
        self._kb, self._dice, self.now = kb, random.Random(7), begin

    def mission(self, plan: Plan, robot: str = "executive") -> bool:
        """Execute a plan from the dock; return whether it reached the store."""
        done = all(any(self._pass(step, robot) for _ in range(TRIES)) for step in plan.steps)
        # Somebody brings the robot back.
        with self._kb.transaction(actor="porter", reason="the mission is over"):
            self._kb.propositions.delete_all(self._kb.propositions.get_by_predicate("in"))
            self._kb.propositions.save("(in dock)")
        return done

    def _pass(self, step: PlanStep, robot: str) -> bool:
        """Try a door, and record the outcome."""
        name, start, end = step.arguments
        door, began = DOORS[name], self.now
        opens = self._dice.random() < door.opens
        mean = door.seconds if opens else door.patience
        self.now += timedelta(seconds=round(mean * self._dice.uniform(0.9, 1.2), 1))
        with self._kb.transaction(actor=robot):
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


def way(*doors: str) -> Plan:
    """Make a plan through some doors, from the dock to the store."""
    rooms = {"front": "hall", "gate": "yard", "arch": "garden"}
    here, steps = "dock", []
    for door in doors:
        there = rooms.get(door, "store")
        steps.append(PlanStep(None, "pass", (door, here, there)))
        here = there
    return Plan(tuple(steps), "by hand", "solved_satisficing")


ROBOTS = ("amber", "blue", "coral")
SHORT, LONG = way("front", "fire_door"), way("gate", "arch", "side")
MISSIONS = 18


def fill(connect: Connect) -> None:
    """Write the story of a shift: first by the short way, then by the long one."""
    operator = connect("operator")
    operator.load_domain(DOMAIN)
    operator.load_problem(PROBLEM)
    (first,) = operator.store.revisions(after=0, limit=1)
    building = Building(operator, first.committed_at - timedelta(hours=2))
    for plan, reason in ((SHORT, "the shortest way"), (LONG, "the fire door fails too often")):
        with operator.transaction(reason=reason):
            operator.plans.record(plan)
        for mission in range(MISSIONS):
            building.mission(plan, ROBOTS[mission % len(ROBOTS)])


def steps(kb: KnowledgeBase) -> Sequence[Step]:
    """Make the steps of the page."""
    _, second = kb.plans.get_all()
    failed = next(iter(kb.executions.get_all(object="fire_door", outcome="failed")))
    last = failed.revisions[-1]
    return (
        Step(
            "How often do the robots get through a door?",
            "All executions are counted: how many succeeded, with the interval in which the true "
            "rate lies, how long they took, and the codes of failures.",
            *("/statistics", {}, "statistics"),
            "[(one.count, one.failed, one.codes) for one in kb.statistics()]",
        ),
        Step(
            "Which door is it?",
            "Grouped by argument, one door stands out: the fire door.",
            *("/statistics", {"by": "arguments"}, "statistics --by arguments"),
            '[(str(one), one.success_rate) for one in kb.statistics(by=["arguments"])]',
        ),
        Step(
            "Or is it one of the robots?",
            "Grouped by actor, the three robots are alike: their intervals overlap.",
            *("/statistics", {"by": "actor"}, "statistics --by actor"),
            '[(one.actor, one.interval) for one in kb.statistics(by=["actor"])]',
        ),
        Step(
            "What happened at that door?",
            "Each failure is an act with its time, its robot and its code.",
            "/acts",
            {"object": "fire_door", "outcome": "failed"},
            "acts --object fire_door --outcome failed",
            '[act.actor for act in kb.executions.get_all(object="fire_door", outcome="failed")]',
        ),
        Step(
            "What did a robot write then?",
            "A failed act changes only the record; it is one revision, with its hash.",
            *("/revision", {"number": last}, f"log --since {last} --until {last}"),
            f"[entry.revision.actor for entry in kb.log(since={last}, until={last})]",
        ),
        Step(
            "What was done about it?",
            "The operator recorded another plan, around that door, and said why.",
            *("/plan", {"id": second.id}, f"plans {second.id}"),
            f"[str(step) for step in kb.plans.get({second.id}).steps]",
        ),
        Step(
            "Did it help?",
            "Since then nearly all passages succeed. With the extra 'planning', a planner finds "
            "this way by itself: kant-sql plan --costs history.",
            *("/statistics", {"by": "arguments", "since": second.recorded_in}),
            f"statistics --by arguments --since {second.recorded_in}",
            f"[one.success_rate for one in kb.statistics(since={second.recorded_in})]",
        ),
    )


WORLD = World(
    "warehouse",
    "a fleet to learn from: which action fails, where, and what helped",
    "Three robots bring boxes from the dock to the store of a warehouse, all day. Too many of "
    "their missions fail. Find the reason in what they did.",
    fill,
    steps,
)
