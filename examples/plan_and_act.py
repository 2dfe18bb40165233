"""Plan from the store, act, record what happened, and replan after a surprise.

python examples/plan_and_act.py [URL]

The store is in memory when no other is named. It needs planners: pip install 'kant-sql[planning]'.
"""

from __future__ import annotations

import sys

import kant_sql
from kant_sql import (
    KnowledgeBase,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPropositionDto,
)
from kant_sql.planning import Plan, PlanStep

DOMAIN = """
(define (domain delivery)
  (:requirements :strips :typing)
  (:types place parcel)
  (:constants dock - place)
  (:predicates (robot_at ?p - place) (parcel_at ?b - parcel ?p - place)
    (holding ?b - parcel) (gripper_free) (connected ?from ?to - place))
  (:action move
    :parameters (?from ?to - place)
    :precondition (and (robot_at ?from) (connected ?from ?to))
    :effect (and (not (robot_at ?from)) (robot_at ?to)))
  (:action pick
    :parameters (?b - parcel ?p - place)
    :precondition (and (robot_at ?p) (parcel_at ?b ?p) (gripper_free))
    :effect (and (holding ?b) (not (parcel_at ?b ?p)) (not (gripper_free))))
  (:action put
    :parameters (?b - parcel ?p - place)
    :precondition (and (robot_at ?p) (holding ?b))
    :effect (and (parcel_at ?b ?p) (not (holding ?b)) (gripper_free))))
"""
PROBLEM = """
(define (problem monday)
  (:domain delivery)
  (:objects hall office - place letter - parcel)
  (:init (robot_at dock) (gripper_free) (parcel_at letter hall)
    (connected dock hall) (connected hall dock) (connected hall office) (connected office hall))
  (:goal (and (parcel_at letter office) (robot_at dock))))
"""


def ground(literal: PddlConditionEffectDto, bound: dict[str, PddlObjectDto]) -> PddlPropositionDto:
    """Bind the objects of a step to the action's parameters."""
    objects = [bound.get(term.name, term) for term in literal.objects]
    return PddlPropositionDto(literal.predicate, objects)


def find(kb: KnowledgeBase, name: str) -> PddlObjectDto:
    """Return a known object."""
    dto = kb.objects.get(name)
    assert dto is not None
    return dto


def act(kb: KnowledgeBase, step: PlanStep) -> None:
    """Save the effects of a step, as one revision."""
    action = kb.actions.get(step.action)
    assert action is not None
    parameters = [parameter.name for parameter in action.parameters]
    bound = dict(zip(parameters, (find(kb, name) for name in step.arguments), strict=True))
    literals = [part for part in action.effects if isinstance(part, PddlConditionEffectDto)]
    with kb.transaction(actor="executive", reason=f"{step} succeeded", source={"step": str(step)}):
        for negative in (True, False):
            for literal in literals:
                if literal.is_negative == negative:
                    dao = kb.propositions
                    (dao.delete if negative else dao.save)(ground(literal, bound))


def surprise(kb: KnowledgeBase) -> None:
    """Save what perception sees: the letter is elsewhere than the robot believes."""
    letter = find(kb, "letter")
    parcel_at = kb.predicates.get("parcel_at")
    assert parcel_at is not None
    with kb.transaction(actor="perception", reason="the letter was seen at the dock"):
        kb.propositions.delete(PddlPropositionDto(parcel_at, [letter, find(kb, "hall")]))
        kb.propositions.save(PddlPropositionDto(parcel_at, [letter, find(kb, "dock")]))


def show(plan: Plan) -> None:
    """Print a plan and its revision."""
    print(f"Plan of revision {plan.revision}, by {plan.engine}:", *plan.steps, sep="\n  ")


def main(url: str) -> None:
    """Deliver the letter."""
    with kant_sql.connect(url, knowledge_base="delivery") as kb:
        with kb.transaction(actor="operator", reason="Monday's mission"):
            kb.load_domain(DOMAIN)
            kb.load_problem(PROBLEM)
        plan = kb.plan(timeout=60)
        show(plan)
        act(kb, plan.steps[0])
        surprise(kb)
        plan = kb.plan(timeout=60)
        show(plan)
        for step in plan.steps:
            act(kb, step)
        goals, facts = kb.propositions.get_goals(), kb.propositions.get_no_goals()
        reached = {str(goal) for goal in goals} <= {str(fact) for fact in facts}
        print("The goals are reached." if reached else "The goals are not reached.")
        print("What happened:")
        for revision in kb.revisions():
            print(f"  {revision.number} {revision.actor}: {revision.reason}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "sqlite://")
