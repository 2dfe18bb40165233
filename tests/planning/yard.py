"""A small domain, in which tests put what they are about."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kant_sql.pddl import read_domain, read_problem
from kant_sql.planning import to_unified_planning

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Problem as UpProblem

DOMAIN = """
(define (domain yard)
  (:types vehicle place - object truck van - vehicle)
  (:predicates (at ?v - vehicle ?p - place) (road ?a ?b - place) (clean ?v - vehicle) (move))
  (:functions (fuel ?v - vehicle) (length ?a ?b - place) (total-cost) (rate))
  {more}
  (:action move
    :parameters (?v - vehicle ?a ?b - place)
    :precondition {precondition}
    :effect {effect}))
"""
PROBLEM = """
(define (problem morning) (:domain yard)
  (:objects t1 t2 - truck v1 - van p q - place)
  (:init (at t1 p) (road p q) (= (fuel t1) 4.5) (= (total-cost) 0) {init})
  (:goal {goal}) {more})
"""
DURATIVE = """
(:durative-action wash
  :parameters (?v - vehicle ?p - place)
  :duration {duration}
  :condition {condition}
  :effect {effect})
"""
FREE = "(and (at ?v ?a) (road ?a ?b))"
DRIVEN = "(and (not (at ?v ?a)) (at ?v ?b))"


def convert(
    *,
    precondition: str = FREE,
    effect: str = DRIVEN,
    domain: str = "",
    init: str = "",
    goal: str = "(at t1 q)",
    problem: str = "",
    environment: Environment | None = None,
) -> UpProblem:
    read = read_domain(DOMAIN.format(more=domain, precondition=precondition, effect=effect))
    asked = read_problem(PROBLEM.format(init=init, goal=goal, more=problem), domain=read)
    return to_unified_planning(read, problem=asked, environment=environment)


def durative(
    duration: str = "(= ?duration 5)",
    condition: str = "(at start (at ?v ?p))",
    effect: str = "(at end (clean ?v))",
    problem: str = "",
    init: str = "",
) -> UpProblem:
    action = DURATIVE.format(duration=duration, condition=condition, effect=effect)
    return convert(domain=action, problem=problem, init=init)
