"""A robot's day in a restaurant, with fixed times: what the audit's questions are asked of."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from decimal import Decimal
from types import SimpleNamespace
from unittest import mock

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.planning import Plan, PlanStep
from kant_sql.sql.dialects.base import Session

DOMAIN = """
(define (domain restaurant)
  (:requirements :typing :durative-actions :fluents)
  (:types place robot cup door - object table - place)
  (:predicates
    (robot_at ?r - robot ?p - place)
    (waiting ?t - table)
    (served ?t - table)
    (carrying ?r - robot ?c - cup)
    (open ?d - door))
  (:functions (battery ?r - robot))
  (:durative-action move
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration 60)
    :condition (at start (robot_at ?r ?from))
    :effect (and (at start (not (robot_at ?r ?from))) (at end (robot_at ?r ?to))))
  (:durative-action serve
    :parameters (?r - robot ?c - cup ?t - table)
    :duration (= ?duration 30)
    :condition (and (over all (robot_at ?r ?t)) (at start (carrying ?r ?c))
      (at start (waiting ?t)))
    :effect (and (at end (not (carrying ?r ?c))) (at end (not (waiting ?t)))
      (at end (served ?t)))))
"""
SLOWER = DOMAIN.replace("(= ?duration 60)", "(= ?duration 90)")

OBJECTS = (
    *("rb1 - robot", "rb2 - robot", "dock - place", "kitchen - place"),
    *(f"t{number} - table" for number in range(1, 5)),
    *("cup1 - cup", "cup2 - cup", "cup3 - cup", "front - door"),
)


def at(time: str, day: int = 2) -> datetime:
    """The moment of a time of the day, `09:05` or `11:00:00.4`, in March 2026, UTC."""
    hours, minutes, seconds = (time if time.count(":") == 2 else f"{time}:00").split(":")
    whole, _, fraction = seconds.partition(".")
    microseconds = int(fraction.ljust(6, "0"))
    return datetime(2026, 3, day, int(hours), int(minutes), int(whole), microseconds, UTC)


class Clock:
    """What the store takes for the time."""

    def __init__(self) -> None:
        self.moment = at("00:00")

    @contextmanager
    def ruling(self) -> Iterator[Clock]:
        """Let it be the store's clock."""

        def now(*_: object) -> datetime:
            return self.moment

        frozen = SimpleNamespace(monotonic=lambda: 0.0)
        with (
            mock.patch.object(Session, "now", now),
            mock.patch("kant_sql.store.transaction.time", frozen),
        ):
            yield self


class Teller:
    """Tells a story to a knowledge base."""

    def __init__(self, kb: KnowledgeBase, clock: Clock) -> None:
        self.kb = kb
        self._clock = clock

    @contextmanager
    def at(
        self,
        time: str | datetime,
        actor: str,
        reason: str | None = None,
        source: object | None = None,
        observed: str | None = None,
        step: int | None = None,
    ) -> Iterator[None]:
        """Make one revision at a time of the day."""
        self._clock.moment = at(time) if isinstance(time, str) else time
        steps = () if step is None else self.kb.plans.get_all()[0].steps
        with self.kb.transaction(
            actor=actor,
            reason=reason,
            source=source,
            observed_at=None if observed is None else at(observed),
            execution=None if step is None else steps[step],
        ):
            yield

    def say(self, *changes: str) -> None:
        """Assert `robot_at rb1 t1`, retract `- robot_at rb1 t1`, set the goal `! served t1`."""
        for change in changes:
            sign = change[0] if change[0] in "-!" else "+"
            fact = f"({change.lstrip('-! ')})"
            done = self.kb.propositions.delete(fact) if sign == "-" else None
            assert done is not False, change
            if sign == "!":
                self.kb.goals.save(fact)
            elif sign == "+":
                self.kb.propositions.save(fact)

    def set_battery(self, robot: str, value: str) -> None:
        self.kb.function_values.set("battery", objects=[robot], value=Decimal(value))

    def set_status(self, step: int, status: str) -> None:
        """Say what becomes of a step of the plan."""
        self.kb.plans.set_status(self.kb.plans.get_all()[0].steps[step], status=status)  # type: ignore[arg-type]


def record(kb: KnowledgeBase) -> None:
    """Record the day of 2 March 2026, and the next morning, in an empty knowledge base."""
    with Clock().ruling() as clock:
        story = Teller(kb, clock)
        _morning(story)
        _mission(story)
        _midday(story)
        _afternoon(story)


def _morning(story: Teller) -> None:
    with story.at("08:00", "operator", "opening"):  # 1
        story.kb.load_domain(DOMAIN)
    with story.at("08:05", "operator", "opening"):  # 2
        story.kb.objects.save_all(OBJECTS)
        story.say("robot_at rb1 dock", "robot_at rb2 kitchen")
        story.say("carrying rb1 cup1", "carrying rb1 cup2")
    with story.at("08:05:01", "battery_monitor"):  # 3
        story.set_battery("rb1", "100")
        story.set_battery("rb2", "80")
    with story.at("09:00", "perception", "guest sat down", {"camera": 1}, "08:59:59"):  # 4
        story.say("waiting t1")
    with story.at("09:02:30", "perception", "guest sat down", {"camera": 2}, "09:02:29"):  # 5
        story.say("waiting t2")
    with story.at("09:05", "operator", "orders taken"):  # 6
        story.say("! served t1", "! served t2")


def _mission(story: Teller) -> None:
    steps = ("move rb1 dock t1", "serve rb1 cup1 t1", "move rb1 t1 t2", "serve rb1 cup2 t2")
    plan, start = [], Decimal(0)
    for step in steps:
        action, *arguments = step.split()
        duration = Decimal(60 if action == "move" else 30)
        plan.append(PlanStep(start, action, tuple(arguments), duration))
        start += duration
    with story.at("09:05:10", "planner", "goals changed"):  # 7
        story.kb.plans.record(
            Plan(tuple(plan), "aries", "solved_satisficing", revision=6),
            planner_version="0.5",
            objective="minimize (total-time)",
            value=start,
        )
    with story.at("09:05:20", "executive", "mission", step=0):  # 8
        story.set_status(0, "running")
        story.say("- robot_at rb1 dock")
    with story.at("09:06:25", "executive", "arrived", step=0):  # 9
        story.say("robot_at rb1 t1")
        story.set_status(0, "succeeded")
    with story.at("09:06:30", "executive", "mission", step=1):  # 10
        story.set_status(1, "running")
    with story.at("09:07:10", "executive", "cup taken", step=1):  # 11
        story.say("- carrying rb1 cup1", "- waiting t1", "served t1")
        story.set_status(1, "succeeded")
    with story.at("09:07:15", "executive", "mission", step=2):  # 12
        story.set_status(2, "running")
        story.say("- robot_at rb1 t1")
    with story.at("09:09", "executive", "blocked by a chair", step=2):  # 13
        story.say("robot_at rb1 t1")
        story.set_status(2, "failed")
    with story.at("09:09:01", "executive", "mission given up"):  # 14
        story.set_status(3, "aborted")


def _midday(story: Teller) -> None:
    with story.at("09:40", "perception", "guest left", observed="09:39:55"):  # 15
        story.say("- waiting t2")
    with story.at("10:00", "operator", "guest left"):  # 16
        story.kb.goals.delete("(served t2)")
    for number, time in enumerate(("00", "00.4", "00.9", "01.5", "02")):  # 17 to 21
        with story.at(f"11:00:{time}", "door_sensor"):
            story.say("- open front" if number % 2 else "open front")
    with story.at("12:00", "battery_monitor"):  # 22
        story.set_battery("rb1", "75.5")
    with story.at("12:10", "operator", "slower after lunch"):  # 23
        story.kb.load_domain(SLOWER)
    with story.at("12:30", "executive", "idle"):  # 24
        story.say("- robot_at rb1 t1")
    with story.at("12:31", "executive", "arrived"):  # 25
        story.say("robot_at rb1 dock")
    with story.at("13:00", "operator", "closing early"):  # 26
        story.say("! robot_at rb2 dock")
    with story.at("13:30", "battery_monitor"):  # 27
        story.set_battery("rb1", "40")


def _afternoon(story: Teller) -> None:
    with story.at("13:58", "executive", "call from t3"):  # 28
        story.say("- robot_at rb1 dock")
    with story.at("14:00", "perception", "seen by camera 4", {"camera": 4}, "13:59:58"):  # 29
        story.say("robot_at rb2 t4")
    with story.at("14:01", "executive", "arrived"):  # 30
        story.say("robot_at rb1 t3")
    with story.at("14:10", "executive", "stale"):  # 31
        story.say("- robot_at rb2 kitchen")
    with story.at("14:20", "executive", "empty"):  # 32
        story.say("- robot_at rb1 t3", "robot_at rb1 kitchen")
    with story.at("15:00", "battery_monitor"):  # 33
        story.set_battery("rb1", "100")
    with story.at("16:00", "perception", "log read late", None, "15:30"):  # 34
        story.say("waiting t4")
    with story.at("17:00", "maintenance", "door taken out"):  # 35
        story.kb.objects.delete("front")
    with story.at(at("08:00", day=3), "operator", "opening"):  # 36
        story.say("robot_at rb1 dock", "- robot_at rb1 kitchen")


def record_store(url: str) -> str:
    """Record the story in a store; another robot in it has the same names for other things."""
    # The same seeds everywhere make the same hashes.
    with mock.patch("kant_sql.store.transaction.os.urandom", bytes):
        return _record_store(url)


def _record_store(url: str) -> str:
    with kant_sql.connect(url, knowledge_base="other", actor="nobody") as other:
        with other.transaction():
            other.objects.save_all(["rb1 - robot", "t2 - place"])
            other.predicates.save("(robot_at ?r0 - robot ?p1 - place)")
            other.propositions.save("(robot_at rb1 t2)")
        other.goals.save("(robot_at rb1 t2)")
    with kant_sql.connect(url, knowledge_base="courier") as kb:
        record(kb)
    return url
