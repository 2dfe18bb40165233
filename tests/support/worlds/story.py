"""A store with rows in every table, of many kinds."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal

import kant_sql
from kant_sql import KnowledgeBase, PddlActionDto, Plan, PlanStep
from kant_sql.dto.formulas import Or
from kant_sql.plans import RecordedPlan
from tests.support.worlds.depot import CONDITIONS, CONSTRAINTS

NAME = "depot"
SEEN = datetime(2026, 1, 31, 9, 29, 58, tzinfo=UTC)

DOMAIN = """
(define (domain depot)
  (:requirements :strips :typing :durative-actions :derived-predicates)
  (:types hybrid - (either truck crane) truck crane - machine machine place)
  (:constants hub - place)
  (:predicates (at ?t - truck ?p - place) (ready ?m - machine) (linked ?x ?y - place)
               (open ?w - (either place crane)) (idle) (reachable ?p - place))
  (:functions (fuel ?t - truck) (distance ?a ?b - place) - number (home ?t - truck) - place
              (owner ?w - (either place crane)) - (either truck crane) (total-cost))
  (:derived (reachable ?p - place) (or (linked hub ?p) (exists (?q - place)
    (and (reachable ?q) (linked ?q ?p)))))
  (:constraints (always (not (idle))))
  (:action load :parameters (?t - truck ?w - (either place crane)) :precondition (open ?w)
    :effect (and (ready ?t) (assign (home ?t) hub) (increase (total-cost) 1.50)
      (forall (?q - place) (when (linked hub ?q) (not (at ?t ?q))))))
  (:durative-action drive :parameters (?t - truck ?p ?q - place)
    :duration (= ?duration (/ (distance ?p (home ?t)) 2))
    :condition (and (at start (at ?t ?p)) (over all (ready ?t)))
    :effect (and (at start (not (at ?t ?p))) (at end (at ?t ?q))
      (decrease (fuel ?t) (* #t 0.5)))))
"""
PROBLEM = """
(define (problem monday) (:domain depot)
  (:objects t1 t2 - truck c1 - crane p1 p2 - place x - (either truck crane))
  (:init (at t1 p1) (ready c1) (linked hub p1) (idle) (= (fuel t1) 7.50) (= (home t1) hub)
         (= (distance p1 p2) 3) (at 10 (at t2 p2)) (at 20 (= (fuel t1) 3)) (not (at t2 p1)))
  (:goal (and (at t1 p2) (or (idle) (ready c1))))
  (:constraints (and (preference calm (always (idle)))))
  (:metric minimize (+ (total-cost) (total-time) (* 2 (is-violated calm)))))
"""
STEPS = (
    PlanStep(Decimal(0), "load", ("t1", "c1"), None),
    PlanStep(Decimal("0.5"), "drive", ("t1", "p1", "p2"), Decimal("1.5")),
)


def write_story(url: str, archive_url: str) -> None:
    """Fill an empty store, and move a part of it to an archive."""
    with kant_sql.connect(url, knowledge_base=NAME, actor="loader") as kb:
        kb.load_domain(DOMAIN)
        with kb.transaction(reason="monday", source={"file": "monday.pddl"}, observed_at=SEEN):
            kb.load_problem(PROBLEM)
        _change(kb)
        _plan(kb)
        kb.store.archive(9, to=archive_url)


def _change(kb: KnowledgeBase) -> None:
    """Redefine and retract, so some versions have ended."""
    kb.goals.save(CONDITIONS["shadowed"])
    kb.goals.save(CONDITIONS["fluent as a term"])
    kb.goals.save(Or((CONDITIONS["object fluent"], CONDITIONS["arithmetic"])))
    kb.goals.delete(CONDITIONS["shadowed"])
    kb.pddl.constraints.save(CONSTRAINTS["hold-during"])
    with kb.transaction():
        kb.propositions.delete("(at t1 p1)")
        # Its whole history goes into the archive.
        kb.propositions.delete("(linked hub p1)")
    kb.propositions.save("(at t1 p1)")
    kb.function_values.set("fuel", objects=["t1"], value=Decimal("5.25"))
    kb.objects.save("p3 - place")
    kb.objects.save("p3 - truck")
    kb.objects.delete("p3")
    _define_again(kb)


def _define_again(kb: KnowledgeBase) -> None:
    kb.types.save("crate")
    kb.types.save("crate - machine")
    kb.actions.save(PddlActionDto("rest", durative=False))
    kb.actions.save(PddlActionDto("rest", duration=2.5))


def _plan(kb: KnowledgeBase) -> None:
    plan = kb.plans.record(
        Plan(STEPS, "test", "solved"), planner="tamer", planner_version="1", value=3
    )
    kb.plans.record(Plan((PlanStep(None, "rest", (), None),), "", ""))
    _carry_out(kb, plan)


def _carry_out(kb: KnowledgeBase, plan: RecordedPlan) -> None:
    first, second = plan.steps
    kb.plans.set_status(first, status="running")
    with kb.transaction(execution=first, actor="executive"):
        kb.propositions.delete_all()
    kb.plans.set_status(first, status="succeeded")
    kb.plans.set_status(second, status="aborted")


def write_whole_story(url: str) -> None:
    """Fill an empty store without an archive: each table but one has rows, also ended ones."""
    with kant_sql.connect(url, knowledge_base="tiago", actor="loader") as kb:
        kb.load_domain(DOMAIN)
        with kb.transaction(reason="monday", source={"file": "monday.pddl"}):
            kb.load_problem(PROBLEM)
        _follow_a_plan(kb)
        _redefine(kb)
        _come_and_go(kb)
        _follow_a_plan(kb)


def _redefine(kb: KnowledgeBase) -> None:
    for formula in (
        CONDITIONS["shadowed"],
        Or((CONDITIONS["object fluent"], CONDITIONS["arithmetic"])),
    ):
        kb.goals.save(formula)
        kb.goals.delete(formula)
    kb.pddl.constraints.save(CONSTRAINTS["hold-during"])
    _define_again(kb)
    assert kb.actions.delete("load")
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM, mode="replace")


def _come_and_go(kb: KnowledgeBase) -> None:
    """Let facts and values come and go: of objects that stay, and of one that does not."""
    kb.objects.save("t9 - truck")
    for truck, dao in (("t1", kb.propositions), ("t9", kb.goals), ("t1", kb.propositions)):
        dao.save(f"(at {truck} p1)")
        kb.function_values.set("fuel", objects=[truck], value=Decimal("5.25"))
        kb.function_values.set("fuel", objects=[truck], value=3)
        dao.delete(f"(at {truck} p1)")
    kb.objects.delete("t9")


def _follow_a_plan(kb: KnowledgeBase) -> None:
    _carry_out(kb, kb.plans.record(Plan(STEPS, "test", "solved"), value=3))
