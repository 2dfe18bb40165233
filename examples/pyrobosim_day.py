"""A day of a robot in pyrobosim: 60 navigations, some of which the simulator lets fail.

It executes each navigation, confirms it by a localization with its own actor, and evaluates the
outcomes. It runs without a window. pyrobosim is not a part of kant_sql:

$ pip install pyrobosim
$ python examples/pyrobosim_day.py [URL]
"""

from __future__ import annotations

import logging
import random
import sys
from pathlib import Path

from pyrobosim.core.robot import Robot
from pyrobosim.core.yaml_utils import WorldYamlLoader
from pyrobosim.planning.actions import ExecutionOptions
from pyrobosim.utils.general import get_data_folder
from shapely.geometry import Point

import kant_sql
from kant_sql import Execution, KnowledgeBase

DOMAIN = """
(define (domain building) (:requirements :typing) (:types robot room)
  (:predicates (in ?r - robot ?a - room) (visited ?a - room))
  (:action go :parameters (?r - robot ?a ?b - room)
    :precondition (in ?r ?a)
    :effect (and (not (in ?r ?a)) (in ?r ?b) (visited ?b))))
"""
NAVIGATIONS, CORRECTED = 60, "the pose says so"


class NavigationError(Exception):
    """The simulator's error of a failed navigation."""

    def __init__(self, code: str, text: str | None) -> None:
        super().__init__(text or "")
        self.code = code


class Day:
    """The robot, its executive and its localization, which share a knowledge base."""

    def __init__(self, executive: KnowledgeBase, localization: KnowledgeBase) -> None:
        self.executive, self.localization = executive, localization
        world = WorldYamlLoader().from_file(Path(get_data_folder(), "test_world.yaml"))
        self.world, self.chance = world, random.Random(7)
        self.robot: Robot = world.robots[0]
        # The simulator's own failures; closing doors cause others.
        options = ExecutionOptions(success_probability=0.9, rng_seed=7, battery_usage=0.5)
        self.robot.action_execution_options["navigate"] = options
        rooms = " ".join(room.name for room in world.rooms)
        executive.load_domain(DOMAIN)
        executive.load_problem(
            f"(define (problem day) (:domain building) (:objects {self.robot.name} - robot "
            f"{rooms} - room) (:init (in {self.robot.name} {self.sensed()})) "
            "(:goal (forall (?a - room) (visited ?a))))"
        )

    def sensed(self) -> str | None:
        """Return the room of the robot's actual pose."""
        pose = self.robot.get_pose()
        inside = (room for room in self.world.rooms if room.polygon.contains(Point(pose.x, pose.y)))
        return next((room.name for room in inside), None)

    def navigate(self, step: Execution) -> None:
        """Drive, in the simulator."""
        result = self.robot.navigate(goal=step.arguments[2], realtime_factor=-1)
        if not result.is_success():
            raise NavigationError(result.status.name, result.message)

    def localize(self) -> None:
        """Confirm where the robot is, or correct it."""
        room, robot = self.sensed(), self.robot.name
        facts = self.localization.propositions.get_by_predicate("in")
        believed = [fact.objects[1].name for fact in facts]
        if room is not None and believed == [room]:
            self.localization.propositions.confirm(f"(in {robot} {room})")
        elif room is not None:
            with self.localization.transaction(reason=CORRECTED):
                self.localization.propositions.delete_all(facts)
                self.localization.propositions.save(f"(in {robot} {room})")

    def live(self) -> None:
        """Go from room to room, through doors that somebody closes and opens."""
        for number in range(NAVIGATIONS):
            here = self.sensed() or self.world.rooms[0].name
            there = self.chance.choice([r.name for r in self.world.rooms if r.name != here])
            closed = self.chance.sample(self.world.hallways, self.chance.choice((0, 0, 1, 2)))
            for door in closed:
                self.world.close_location(door)
            self.executive.execute(
                [f"(go {self.robot.name} {here} {there})"],
                self.navigate,
                reason=f"errand {number + 1}",
            )
            for door in closed:
                self.world.open_location(door)
            self.localize()
            if self.robot.battery_level < 10:
                self.robot.battery_level = 100.0


def report(kb: KnowledgeBase, robot: str) -> None:
    """Print acts, outcomes and causes."""
    print("executions", sum(1 for _ in kb.executions.get_all()))
    [whole] = kb.statistics()
    print(f"went {whole.succeeded}, failed {whole.failed}")
    if whole.interval is not None:
        print("success rate {:.2f} to {:.2f}".format(*whole.interval))
    for code, count in sorted(whole.codes.items()):
        print(f"  {code} {count}")
    for way in kb.statistics(by=["arguments"]):
        print(f"  {way}: {way.succeeded} of {way.count}")
    changes = [change for entry in kb.changes() for change in entry.changes]
    print("confirmed", sum(change.kind == "confirmation" for change in changes))
    corrected = [one for one in kb.store.revisions() if one.reason == CORRECTED]
    print("corrected", len(corrected))
    print("not seen", *(fact.text for fact in kb.unconfirmed()))
    fact = f"(in {robot} kitchen)"
    links = kb.consequences(fact).links
    print(f"{fact} led to {sum(link.kind == 'execution' for link in links)} acts")
    print("intact", kb.store.verify().is_intact)


def main(url: str) -> None:
    """Live a day, and look back."""
    logging.disable(logging.CRITICAL)
    with (
        kant_sql.connect(url, knowledge_base="building", actor="executive") as executive,
        kant_sql.connect(url, knowledge_base="building", actor="localization") as localization,
    ):
        day = Day(executive, localization)
        day.live()
        report(executive, day.robot.name)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite:///building.db")
