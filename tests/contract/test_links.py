"""What supports the conditions of a plan's steps, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import CausalLink, KnowledgeBase, Plan, PlanError
from tests.support.reading import loaded, present

DOMAIN = """(define (domain home)
  (:requirements :typing :adl :fluents :derived-predicates :durative-actions)
  (:types place) (:predicates (at ?p - place) (door ?a ?b - place) (lit) (near ?p - place))
  (:functions (battery))
  (:derived (near ?p - place) (or (at ?p) (exists (?q - place) (and (near ?q) (door ?q ?p)))))
  (:action move :parameters (?a ?b - place)
    :precondition (and (at ?a) (door ?a ?b) (>= (battery) 3))
    :effect (and (not (at ?a)) (at ?b) (decrease (battery) 3)))
  (:action light :parameters () :precondition (not (lit)) :effect (lit))
  (:action wave :parameters (?p - place) :precondition (near ?p) :effect (lit))
  (:durative-action charge :parameters (?p - place) :duration (= ?duration 2)
    :condition (over all (at ?p)) :effect (increase (battery) (* #t 1))))"""
PROBLEM = """(define (problem night) (:domain home) (:objects hall lab attic - place)
  (:init (at hall) (door hall lab) (door lab attic) (= (battery) 4))
  (:goal (and (at attic) (forall (?p - place) (imply (at ?p) (lit))))))"""
PLAN = Plan.read("""
1: (move hall lab) [0.01]
2: (charge lab) [2]
5: (wave attic) [0.01]
6: (wave lab) [0.01]
7: (move lab attic) [0.01]
""")


@pytest.fixture
def home(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    with fresh_kb.transaction():
        return loaded(fresh_kb, DOMAIN, PROBLEM)


def test_links_name_the_steps_that_made_conditions_true(home: KnowledgeBase) -> None:
    links = home.pddl.causal_links(PLAN)

    def of(position: int | None) -> set[tuple[int | None, str]]:
        return {(link.supporter, link.literal) for link in links if link.position == position}

    begun = {(None, "(at hall)"), (None, "(door hall lab)"), (None, "(battery)")}
    assert begun <= of(0)
    assert (0, "(at lab)") in of(1)
    # Through the rules of `near`, and back to what moved and to the map.
    assert {(0, "(at lab)"), (None, "(door lab attic)")} <= of(2)
    assert {(0, "(at lab)"), (1, "(battery)"), (None, "(door lab attic)")} <= of(4)
    # The second wave changed nothing.
    assert {(4, "(at attic)"), (2, "(lit)")} <= of(None)
    assert not [link for link in links if link.supporter == 3]
    assert str(links[-1]).startswith("the goal needs ")


def test_a_recorded_plan_is_linked_from_the_state_it_was_made_from(home: KnowledgeBase) -> None:
    recorded = present(home.plans.get(home.plans.record(PLAN).id))
    before = home.pddl.causal_links(PLAN)
    assert home.pddl.causal_links(recorded.id) == before == home.pddl.causal_links(PLAN.steps)
    for step in recorded.steps:
        home.apply(step)
    assert home.pddl.causal_links(recorded) == before
    with pytest.raises(PlanError, match=r"step 0, .*move hall lab.*fails"):
        home.pddl.causal_links(PLAN)
    assert home.pddl.causal_links(PLAN, at=1) == before
    assert CausalLink(None, "(at hall)", 0) in before


def test_a_step_may_need_that_a_fluent_has_no_value(home: KnowledgeBase) -> None:
    home.actions.save("(:action start :precondition (not (> (battery) 9)) :effect (lit))")
    assert CausalLink(None, "(battery)", 0) in home.pddl.causal_links(["(start)"])
    home.function_values.delete_all()
    [link] = [one for one in home.pddl.causal_links(["(start)"]) if one.position == 0]
    assert link == CausalLink(None, "(not (battery))", 0)
    home.apply("(start)")
    assert home.consequences(link.literal).links[0].used == (link.literal,)
