"""Audit a day by a safety rule: which revision violated it, who wrote it, and for how long.

python examples/safety_audit.py [URL [REPORT]]

By default, the store is in memory. With the name of a file, it also writes a report for a browser.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

import kant_sql
from kant_sql import KnowledgeBase

DOMAIN = """
(define (domain house)
  (:requirements :strips :typing)
  (:types robot room)
  (:predicates (robot_at ?r - robot ?w - room) (child_in ?w - room) (stove_on)))
"""
PROBLEM = """
(define (problem today)
  (:domain house)
  (:objects rb1 - robot hall kitchen - room)
  (:init (robot_at rb1 hall)))
"""
SAFETY = "(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))"
RULES = f"""
; The robot is never in the kitchen together with a child.
{SAFETY}
; Whenever the stove is on, it is off again.
(sometime-after (stove_on) (not (stove_on)))
; A child who is in the kitchen while the stove is on is never alone for more than five minutes.
(always-within 300 (and (stove_on) (child_in kitchen)) (not (child_in kitchen)))
"""
MORNING = datetime(2026, 3, 2, 8, tzinfo=UTC)
# Minutes from the start: who saw or did what, and why.
DAY: tuple[tuple[int, str, str, str], ...] = (
    (5, "executive", "breakfast", "-(robot_at rb1 hall) +(robot_at rb1 kitchen)"),
    (6, "executive", "breakfast", "+(stove_on)"),
    (20, "executive", "breakfast is ready", "-(stove_on)"),
    (22, "executive", "tidying the hall", "-(robot_at rb1 kitchen) +(robot_at rb1 hall)"),
    (31, "camera", "seen in the kitchen", "+(child_in kitchen)"),
    (40, "camera", "seen in the hall", "-(child_in kitchen) +(child_in hall)"),
    (55, "executive", "fetching a cup", "-(robot_at rb1 hall) +(robot_at rb1 kitchen)"),
    (57, "camera", "seen at the kitchen door", "-(child_in hall) +(child_in kitchen)"),
    (59, "executive", "leaving to the child", "-(robot_at rb1 kitchen) +(robot_at rb1 hall)"),
    (70, "camera", "seen in the hall", "-(child_in kitchen) +(child_in hall)"),
)


def changes(text: str) -> Iterable[tuple[str, str]]:
    """Split `-(a) +(b c)` into signs and facts."""
    for part in text.split(")"):
        if part.strip():
            yield part.strip()[0], f"{part.strip()[1:]})"


def live(kb: KnowledgeBase) -> None:
    """Record a day, with the times of observations."""
    with kb.transaction(actor="installer", observed_at=MORNING):
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
    for minute, actor, reason, said in DAY:
        seen = MORNING + timedelta(minutes=minute)
        with kb.transaction(actor=actor, reason=reason, observed_at=seen):
            for sign, text in changes(said):
                act = kb.propositions.save if sign == "+" else kb.propositions.delete
                act(text)


def audit(kb: KnowledgeBase) -> None:
    """Judge the day by the rules, and show the changes before each violation."""
    verdicts = kb.pddl.check_rules(RULES, clock="observed")
    for verdict in verdicts:
        print("kept    " if verdict.is_satisfied else "violated", verdict.rule)
    for verdict in verdicts.violated:
        revision = verdict.revision
        assert revision is not None
        assert verdict.time is not None
        print(f"\n{verdict.rule}")
        print(f"  is violated by revision {revision.number}, {verdict.time / 60:.0f} minutes on")
        print(f"  {revision.actor}: {revision.reason}")

    print("\nThe robot and a child were in the same room:")
    for held in kb.when("(and (robot_at rb1 ?w) (child_in ?w))"):
        began, ended = held.since, held.until
        assert began is not None
        assert began.observed_at is not None
        print(f"  in the {held.binding['w']} since {began.observed_at:%H:%M}, by {began.actor}")
        if ended is not None and ended.observed_at is not None:
            print(f"    until {ended.observed_at:%H:%M}, by {ended.actor}: {ended.reason}")


if __name__ == "__main__":
    url = sys.argv[1] if len(sys.argv) > 1 else "sqlite://"
    with kant_sql.connect(url, knowledge_base="house") as house:
        if house.revision == 0:
            live(house)
        audit(house)
        if len(sys.argv) > 2:
            from kant_sql.web.report import write_report  # of the extra `web`

            print(f"\nThe report is in {write_report(house, sys.argv[2], rules=RULES)}")
