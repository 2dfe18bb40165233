"""A morning of a robot whose camera and door report late, with fixed times: two clocks."""

from __future__ import annotations

from datetime import datetime

import kant_sql
from kant_sql import KnowledgeBase
from tests.audit.story import Clock, at

DOMAIN = """
(define (domain porter)
  (:requirements :typing :numeric-fluents)
  (:types robot place door)
  (:predicates (at ?r - robot ?p - place) (open ?d - door))
  (:functions (battery ?r - robot)))
"""
OBJECTS = "r1 - robot", "hall - place", "lab - place", "d1 - door"


def record(kb: KnowledgeBase) -> None:
    """Record the morning of 3 March 2026 in an empty knowledge base."""
    with Clock().ruling() as clock:

        def now(time: str) -> None:
            clock.moment = moment(time)

        def moment(time: str) -> datetime:
            return at(time).replace(day=3)

        now("09:00")
        with kb.transaction(actor="operator", reason="the day begins"):
            kb.load_domain(DOMAIN)
            kb.objects.save_all(OBJECTS)
            kb.propositions.save("(at r1 hall)")
            kb.function_values.set("(battery r1)", value=90)
        now("09:30")
        with kb.transaction(actor="executive", reason="arrived"):
            kb.propositions.delete("(at r1 hall)")
            kb.propositions.save("(at r1 lab)")
        for time, begin, end, actor, reason, said in MORNING:
            now(time)
            with kb.transaction(
                actor=actor, reason=reason, valid_from=moment(begin), valid_until=moment(end)
            ):
                said(kb)
        now("11:10")
        with kb.transaction(actor="executive"):
            kb.function_values.set("(battery r1)", value=70)


def _was_in_the_lab(kb: KnowledgeBase) -> None:
    kb.propositions.delete("(at r1 hall)")
    kb.propositions.save("(at r1 lab)")


MORNING = (
    ("10:05", "09:20", "09:30", "camera", "the video of that time", _was_in_the_lab),
    (
        *("10:10", "09:40", "09:50", "door log", "the hourly log"),
        lambda kb: kb.propositions.save("(open d1)"),
    ),
    (
        *("10:40", "10:00", "10:20", "operator", "read from the display"),
        lambda kb: kb.function_values.set("(battery r1)", value=85),
    ),
    (
        *("11:00", "09:45", "09:50", "operator", "the log was of another door"),
        lambda kb: kb.propositions.delete("(open d1)"),
    ),
)


def record_porter(url: str) -> str:
    """Record the morning in a store, once."""
    with kant_sql.connect(url, knowledge_base="porter") as kb:
        if not kb.revision:
            record(kb)
    return url
