"""A door closes in front of a robot, which goes around; it ignores irrelevant changes.

python examples/replan_door.py [URL]

By default, the store is in memory. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys

import kant_sql
from kant_sql import Execution, KnowledgeBase

DOMAIN = """
(define (domain house)
  (:requirements :typing)
  (:types room door)
  (:predicates (at ?r - room) (joins ?d - door ?a ?b - room) (open ?d - door) (lit ?r - room))
  (:action go
    :parameters (?a ?b - room ?d - door)
    :precondition (and (at ?a) (joins ?d ?a ?b) (open ?d))
    :effect (and (not (at ?a)) (at ?b))))
"""
PROBLEM = """
(define (problem tea)
  (:domain house)
  (:objects hall corridor kitchen garden terrace - room
    front near_door gate path back - door)
  (:init (at hall) (open front) (open near_door) (open gate) (open path) (open back)
    (joins front hall corridor) (joins front corridor hall) (joins near_door corridor kitchen)
    (joins gate hall garden) (joins path garden terrace) (joins back terrace kitchen))
  (:goal (at kitchen)))
"""


def drive(kb: KnowledgeBase, step: Execution) -> None:
    """Drive through a door, while perception reports."""
    print("driving:", step)
    if step.arguments[:2] == ("hall", "corridor"):
        with kb.transaction(actor="perception", reason="camera 2"):
            kb.propositions.save("(lit garden)")
            kb.propositions.delete("(open near_door)")


def main(url: str) -> None:
    """Fetch tea."""
    with kant_sql.connect(url, knowledge_base="house", actor="executive") as kb:
        with kb.transaction(actor="operator", reason="tea at five"):
            kb.load_domain(DOMAIN)
            kb.load_problem(PROBLEM)
        plan = kb.plans.record(kb.plan("pyperplan"))
        print(kb.replan(plan))
        kb.propositions.save("(lit hall)")
        print(kb.replan(plan))
        done = kb.execute(plan, lambda step: drive(kb, step), replan={"engine": "pyperplan"})
        print(done)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")
