"""A plan that fails: a door is shut, and somebody plans again by hand."""

from __future__ import annotations

from collections.abc import Sequence

from kant_sql import Execution, KnowledgeBase
from kant_sql.planning import Plan, PlanStep

from .stories import Connect, Step, World

DOMAIN = """
(define (domain rounds)
  (:requirements :strips :typing)
  (:types robot place)
  (:predicates (at ?r - robot ?p - place) (open ?p - place) (checked ?p - place))
  (:action move
    :parameters (?r - robot ?from ?to - place)
    :precondition (and (at ?r ?from) (open ?to))
    :effect (and (not (at ?r ?from)) (at ?r ?to)))
  (:action check
    :parameters (?r - robot ?p - place)
    :precondition (at ?r ?p)
    :effect (checked ?p)))
"""
PROBLEM = """
(define (problem night)
  (:domain rounds)
  (:objects rb1 - robot hall kitchen lab - place)
  (:init (at rb1 hall) (open hall) (open kitchen) (open lab))
  (:goal (and (checked kitchen) (checked lab))))
"""
STEPS = (
    PlanStep(None, "move", ("rb1", "hall", "kitchen")),
    PlanStep(None, "check", ("rb1", "kitchen")),
    PlanStep(None, "move", ("rb1", "kitchen", "lab")),
    PlanStep(None, "check", ("rb1", "lab")),
)
MOVE, OPEN = "(move rb1 kitchen lab)", "(open lab)"


class ShutError(Exception):
    """The door is shut."""

    code = "DOOR_SHUT"


def fill(connect: Connect) -> None:
    """Write the story of a night."""
    operator, executive, camera = connect("operator"), connect("executive"), connect("camera")
    with operator.transaction(reason="the night's rounds"):
        operator.load_domain(DOMAIN)
        operator.load_problem(PROBLEM)

    def find_it_shut(step: Execution) -> None:
        if str(step) == MOVE:
            with camera.transaction(reason="the lock is closed", source={"image": 4711}):
                camera.propositions.delete(OPEN)
            raise ShutError("the door of the lab is shut")

    first = operator.plans.record(Plan(STEPS, "the night planner", "solved_satisficing"))
    executive.execute(first.id, find_it_shut, reason="the first plan")
    porter = connect("porter")
    with porter.transaction(reason="unlocked it for the robot"):
        porter.propositions.save(OPEN)
    rest = operator.plans.record(Plan(STEPS[2:], "by hand", "solved_satisficing"))
    executive.execute(rest.id, lambda step: None, reason="the second plan")


def steps(kb: KnowledgeBase) -> Sequence[Step]:
    """Make the steps of the page."""
    first, rest = kb.plans.get_all()
    words = [str(step) for step in rest.steps]
    shut = next(one.until.number for one in kb.history(OPEN) if one.until is not None)
    return (
        Step(
            "How did the night go?",
            "Two plans are on record: one failed at its third step, the other one did the rest.",
            *("/plans", {}, "plans"),
            "[(one.planner, [step.outcome for step in one.steps]) for one in kb.plans.get_all()]",
        ),
        Step(
            "Where did the first plan fail?",
            "The page has each step with its outcome and its time, and below the step what anybody "
            "wrote meanwhile: the camera saw that the door of the lab is shut.",
            *("/plan", {"id": first.id}, f"plans {first.id}"),
            f"[(str(step), step.outcome, step.code) for step in kb.plans.get({first.id}).steps]",
        ),
        Step(
            "Who had opened and shut that door?",
            "It was open for the planner, by the operator's problem; then the camera saw it shut, "
            "and then the porter unlocked it.",
            *("/fact", {"text": OPEN}, f"history '{OPEN}'"),
            f'[(one.since.actor, one.since.reason) for one in kb.history("{OPEN}")]',
        ),
        Step(
            "Why could the step not be done?",
            f"Ask the condition of the step in the state after revision {shut}: the page says "
            "which part fails, and who retracted the fact.",
            *("/ask", {"condition": f"(and (at rb1 kitchen) {OPEN})", "at": shut}),
            f"why-not '{MOVE}' --at {shut}",
            f'[str(part) for part in kb.at({shut}).why_not("{MOVE}")]',
        ),
        Step(
            "What was left to do?",
            "One of the two goals was not reached when the plan failed. Somebody planned the rest "
            "by hand, from that state; with the extra 'planning', a planner does.",
            *("/ask", {"condition": "(and (checked kitchen) (checked lab))", "at": shut}),
            f"goals --at {shut}",
            f"[part.condition for part in kb.at({shut}).unsatisfied()]",
        ),
        Step(
            "Would the second plan have worked before?",
            "A plan can be tried in any state, without doing anything: not while the door was "
            "shut, but after it was unlocked. It then succeeded.",
            *("/plan", {"id": rest.id}, f"plans {rest.id} --links"),
            f"[kb.at(at).validate({words}).valid for at in ({shut}, {rest.revision})]",
        ),
        Step(
            "What was the planner's input?",
            "The exact input of a plan is kept with it: the same problem can be given to any "
            "planner again.",
            *("/given", {"id": first.id}, f"dump --at {first.revision}"),
            f"kb.plans.get({first.id}).problem_pddl()",
        ),
    )


WORLD = World(
    "failed-plan",
    "a plan that fails: which step, why, and what was done about it",
    "A robot checks two rooms at night. On its way to the second one, its plan fails. See why, and "
    "how the rest was planned again.",
    fill,
    steps,
)
