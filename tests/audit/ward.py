"""A night of two robots on a ward, with fixed times: what the questions on acts are asked of."""

from __future__ import annotations

from contextlib import suppress
from datetime import timedelta

import kant_sql
from kant_sql import KnowledgeBase, NotApplicableError
from kant_sql.acts import Execution
from tests.audit.story import Clock, at

DOMAIN = """
(define (domain ward)
  (:requirements :typing :durative-actions :negative-preconditions)
  (:types robot place item)
  (:predicates (at ?r - robot ?p - place) (holding ?r - robot ?i - item)
    (delivered ?i - item ?p - place) (locked ?p - place))
  (:durative-action move
    :parameters (?r - robot ?from ?to - place)
    :duration (= ?duration 60)
    :condition (and (at start (at ?r ?from)) (at start (not (locked ?to))))
    :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))))
  (:action hand_over
    :parameters (?r - robot ?i - item ?p - place)
    :precondition (and (at ?r ?p) (holding ?r ?i))
    :effect (and (not (holding ?r ?i)) (delivered ?i ?p))))
"""
OBJECTS = (
    *("r1 - robot", "r2 - robot", "store - place", "room1 - place", "room2 - place"),
    *("insulin - item", "blanket - item"),
)


class Night:
    """Lets a night pass in a knowledge base."""

    def __init__(self, kb: KnowledgeBase, clock: Clock) -> None:
        self.kb = kb
        self._clock = clock

    def at(self, time: str) -> KnowledgeBase:
        """The knowledge base at a time."""
        self._clock.moment = at(time)
        return self.kb

    def move(self, begin: str, end: str, step: str, reason: str) -> None:
        """Begin a move, and arrive."""
        running = self.at(begin).start(step, reason=reason)
        self.at(end).end(running, reason="arrived")

    def start(self, begin: str, step: str, reason: str) -> Execution:
        """Begin a move."""
        return self.at(begin).start(step, reason=reason)


def record(kb: KnowledgeBase) -> None:
    """Record the night of 2 March 2026 in an empty knowledge base."""
    with Clock().ruling() as clock:
        night = Night(kb, clock)
        with night.at("22:00").transaction(actor="operator", reason="night begins"):
            kb.load_domain(DOMAIN)
            kb.objects.save_all(OBJECTS)
            facts = "(at r1 store)", "(at r2 store)", "(holding r1 insulin)"
            kb.propositions.save_all([*facts, "(holding r2 blanket)"])
        night.move("22:05", "22:06:10", "(move r1 store room1)", "the nurse called")
        night.at("22:07").apply("(hand_over r1 insulin room1)", reason="the nurse called")
        with night.at("22:08").transaction(actor="perception", source={"camera": 1}):
            kb.propositions.confirm(["(delivered insulin room1)"])
        back = night.start("22:10", "(move r1 room1 room2)", "rounds")
        night.at("22:12:30").fail(back, code="E7", text="the door is locked")
        with night.at("22:12:31").transaction(actor="perception", execution=back):
            kb.propositions.save("(locked room2)")
            kb.propositions.save("(at r1 room1)")
        with suppress(NotApplicableError):
            night.at("22:13").apply("(hand_over r2 blanket room2)", record_refusal=True)
        night.at("22:15").apply("(hand_over r2 blanket store)", reason="rounds")
        slow = night.start("22:20", "(move r2 store room1)", "rounds")
        night.at("22:25").abort(slow, reason="battery low")
        with night.at("23:00").transaction(actor="charger", reason="r2 called"):
            early = clock.moment - timedelta(minutes=2)
            kb.executions.report(
                "charge", arguments=["r2", "bay 4"], outcome="succeeded", started_at=early
            )
        night.start("23:30", "(move r1 room1 store)", "rounds")
        with night.at("23:40").transaction(actor="operator", reason="night ends"):
            kb.propositions.delete("(locked room2)")


def record_ward(url: str) -> str:
    """Record the night in a store, once."""
    with kant_sql.connect(url, knowledge_base="ward", actor="executive") as kb:
        if not kb.revision:
            record(kb)
    return url
