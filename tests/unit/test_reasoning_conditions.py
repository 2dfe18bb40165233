"""Conditions evaluated in memory; `test_reasoning_oracle` has them beside a plain evaluator."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.evaluate import Conditions
from kant_sql.reasoning.failures import failed_parts
from kant_sql.reasoning.world import World

DOMAIN = """(define (domain d)
  (:types place thing - object box - thing)
  (:constants home a - place u - thing)
  (:predicates (road ?x - place ?y - place) (at ?x - thing ?y - place) (open ?x) (done)
    (reach ?x - place ?y - place) (far ?x - place ?y - place) (busy ?x))
  (:functions (size ?x - thing) - number (where ?x - thing) - place)
  (:derived (reach ?x ?y) (or (road ?x ?y) (exists (?z - place) (and (road ?x ?z) (reach ?z ?y)))))
  (:derived (far ?x ?y) (and (not (reach ?x ?y)) (not (= ?x ?y))))
  (:derived (busy ?x) (exists (?t - thing) (and (at ?t ?x) (imply (open ?x) (> (size ?t) 1))))))"""


def fact(world: World, name: str, *objects: str) -> tuple[int, tuple[int, ...]]:
    predicate = world.definitions.predicates.named(name)
    assert predicate is not None
    return predicate.id, tuple([world.ids[one] for one in objects])


def holds(world: World, name: str, *objects: str) -> bool:
    """Return whether a fact holds, derived ones included."""
    return Conditions(world).holds(f.Atom(name, tuple(map(f.Constant, objects))))


def _world(init: str = "", domain: str = DOMAIN) -> World:
    read = read_domain(domain)
    text = f"""(define (problem p) (:domain d)
      (:objects b c - place t - thing v w - box) (:init {init}) (:goal (and)))"""
    return read_world(read, read_problem(text, domain=read))


def test_formulas_as_deep_as_they_may_be() -> None:
    world = _world("(done) (= (size t) 1)")
    formula: f.Formula = f.Atom("done")
    number: f.Expression = f.Number(1)
    depth = (f.MAX_NESTING - 2) // 4
    for _ in range(depth):
        formula = f.Not(f.Or((f.And((formula, f.Atom("done"))), f.Not(f.Atom("done")))))
        number = f.Arithmetic("+", (number, f.Number(1)))
    assert Conditions(world).holds(formula) is True
    assert Conditions(world).holds(f.Comparison("=", number, f.Number(depth + 1)))
    assert [*failed_parts(world, f.Not(formula), {})]


def test_rules_that_depend_on_their_own_negation_are_refused() -> None:
    domain = """(define (domain d) (:predicates (p) (q) (r))
      (:derived (p) (not (q))) (:derived (q) (or (r) (p))))"""
    with pytest.raises(InvalidKnowledgeError, match="not stratified: a rule of 'p' negates 'q'"):
        _world(domain=domain.replace("(:predicates", "(:types place thing box)(:predicates"))


def test_failing_parts_are_named_with_values() -> None:
    world = _world("(= (size t) 1) (at t a) (at u a)")
    condition = (
        read_domain(
            DOMAIN[:-1]
            + """(:action look :parameters (?x - thing) :precondition (and
          (at ?x home) (not (at ?x a)) (> (+ (size ?x) 1) (size u))
          (forall (?y - thing) (imply (at ?y a) (>= (size ?y) 1)))) :effect (done)))"""
        )
        .actions[0]
        .condition
    )
    found = [part for one in condition for part in failed_parts(world, one, {"x": "t"})]
    assert [str(part) for part in found] == [
        "(at t home): does not hold",
        "(not (at t a)): does not hold",
        "(> (+ (size t) 1) (size u)): the sides are 2 and no value",
        "(imply (at u a) (>= (size u) 1)): does not hold",
    ]
    assert (found[2].left, found[2].right) == (Decimal(2), None)


def test_stored_facts_of_derived_predicates_hold_beside_the_rules() -> None:
    world = _world("(road home a) (reach b c)")
    assert holds(world, "reach", "home", "a")
    assert holds(world, "reach", "b", "c")
    world.add(*fact(world, "road", "a", "b"))
    # A stored fact is used by the rules.
    assert holds(world, "reach", "home", "c")
    assert not holds(world, "far", "home", "c")
    world.remove(*fact(world, "reach", "b", "c"))
    assert holds(world, "reach", "home", "b")
    assert not holds(world, "reach", "home", "c")
    assert holds(world, "far", "home", "c")


def test_what_rules_derive_fits_the_parameters_of_the_predicate() -> None:
    world = _world("(road home a)")
    assert holds(world, "far", "home", "b")
    assert not holds(world, "far", "home", "a")
    assert not holds(world, "far", "home", "t")


def test_recursion_inside_of_a_disjunction_is_followed_to_its_end() -> None:
    domain = """(define (domain d) (:types place thing box)
      (:predicates (road ?x ?y - place) (done) (lit ?x - place))
      (:constants home a - place)
      (:derived (lit ?x - place) (or (= ?x home)
        (exists (?z - place) (and (road ?z ?x) (or (done) (lit ?z)))))))"""
    world = _world("(road home a) (road a b) (road b c)", domain)
    assert holds(world, "lit", "c")
    world.remove(*fact(world, "road", "a", "b"))
    assert not holds(world, "lit", "c")
    assert holds(world, "lit", "a")
