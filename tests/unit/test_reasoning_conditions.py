"""Conditions evaluated in memory, beside an evaluator that tries all objects."""

from __future__ import annotations

import itertools
import random
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidKnowledgeError
from kant_sql.pddl import read_domain, read_problem
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.evaluate import Conditions
from kant_sql.reasoning.failures import failed_parts
from kant_sql.reasoning.world import World
from tests.support.profile import PROFILE, hunting

DOMAIN = """(define (domain d)
  (:types place thing - object box - thing)
  (:constants home a - place u - thing)
  (:predicates (road ?x - place ?y - place) (at ?x - thing ?y - place) (open ?x) (done)
    (reach ?x - place ?y - place) (far ?x - place ?y - place) (busy ?x))
  (:functions (size ?x - thing) - number (where ?x - thing) - place)
  (:derived (reach ?x ?y) (or (road ?x ?y) (exists (?z - place) (and (road ?x ?z) (reach ?z ?y)))))
  (:derived (far ?x ?y) (and (not (reach ?x ?y)) (not (= ?x ?y))))
  (:derived (busy ?x) (exists (?t - thing) (and (at ?t ?x) (imply (open ?x) (> (size ?t) 1))))))"""
PLACES, THINGS, BOXES = ["home", "a", "b", "c"], ["t", "u", "v", "w"], ["v", "w"]
RANGES = {"object": PLACES + THINGS, "place": PLACES, "thing": THINGS, "box": BOXES}
ARITIES = {
    "road": ("place", "place"),
    "at": ("thing", "place"),
    "open": ("object",),
    "done": (),
    "reach": ("place", "place"),
    "far": ("place", "place"),
    "busy": ("object",),
}
BASE = ("road", "at", "open", "done")


def random_world(chance: random.Random) -> World:
    """Make a world with some facts and values."""
    lines = []
    for name in BASE:
        for row in itertools.product(*(RANGES[kind] for kind in ARITIES[name])):
            if chance.random() < 0.3:
                lines.append(f"({' '.join((name, *row))})")
    for thing in THINGS:
        if chance.random() < 0.7:
            lines.append(f"(= (size {thing}) {chance.randint(0, 3)})")
        if chance.random() < 0.7:
            lines.append(f"(= (where {thing}) {chance.choice(PLACES)})")
    domain = read_domain(DOMAIN)
    text = f"""(define (problem p) (:domain d)
      (:objects b c - place t - thing v w - box) (:init {" ".join(lines)}) (:goal (and)))"""
    return read_world(domain, read_problem(text, domain=domain))


def fact(world: World, name: str, *objects: str) -> tuple[int, tuple[int, ...]]:
    """Find the ids of a fact."""
    predicate = world.definitions.predicates.named(name)
    assert predicate is not None
    return predicate.id, tuple([world.ids[one] for one in objects])


def random_formula(chance: random.Random, scope: dict[str, str], depth: int) -> f.Formula:
    """Make a formula whose free variables are in scope."""
    kind = chance.choice(("atom", "equal", "compare") if depth == 0 else KINDS)
    if kind in ("and", "or"):
        parts = [random_formula(chance, scope, depth - 1) for _ in range(chance.randint(0, 3))]
        return f.And(tuple(parts)) if kind == "and" else f.Or(tuple(parts))
    if kind == "not":
        return f.Not(random_formula(chance, scope, depth - 1))
    if kind == "imply":
        first, second = (random_formula(chance, scope, depth - 1) for _ in range(2))
        return f.Imply(first, second)
    if kind in ("forall", "exists"):
        names = chance.sample(["x", "Y", "z"], chance.randint(1, 2))
        types = [chance.choice([*RANGES, "place thing"]) for _ in names]
        variables = tuple(
            f.TypedName(n, tuple(t.split())) for n, t in zip(names, types, strict=True)
        )
        inner = {**scope, **dict(zip(names, types, strict=True))}
        body = random_formula(chance, inner, depth - 1)
        return f.Forall(variables, body) if kind == "forall" else f.Exists(variables, body)
    if kind == "equal":
        return f.Equal(random_term(chance, scope), random_term(chance, scope))
    if kind == "compare":
        left, right = (random_number(chance, scope, 2) for _ in range(2))
        return f.Comparison(chance.choice(f.COMPARISONS), left, right)
    name = chance.choice(list(ARITIES))
    return f.Atom(name, tuple(random_term(chance, scope) for _ in ARITIES[name]))


KINDS = ("atom", "atom", "and", "and", "or", "not", "imply", "forall", "exists", "equal", "compare")


def random_term(chance: random.Random, scope: dict[str, str], depth: int = 1) -> f.Term:
    """Make a term."""
    roll = chance.random()
    if scope and roll < 0.6:
        return f.Variable(
            chance.choice([*scope]).upper() if roll < 0.1 else chance.choice([*scope])
        )
    if depth and roll > 0.85:
        return f.Fluent("where", (random_term(chance, scope, depth - 1),))
    return f.Constant(chance.choice(RANGES["object"]))


def random_number(chance: random.Random, scope: dict[str, str], depth: int) -> f.Expression:
    """Make an expression."""
    roll = chance.random()
    if depth == 0 or roll < 0.5:
        if roll < 0.2:
            return f.Number(chance.randint(0, 3))
        return f.Fluent("size", (random_term(chance, scope),))
    operator = chance.choice("+-*/")
    count = 2 if operator in "/" else chance.randint(1 if operator == "-" else 2, 3)
    count = min(count, 2) if operator == "-" else count
    parts = tuple(random_number(chance, scope, depth - 1) for _ in range(count))
    return f.Arithmetic(operator, parts)


class Plain:
    """Evaluates as the definitions say, by trying all objects, with recursion."""

    def __init__(self, world: World) -> None:
        self.world = world
        predicates, functions = world.definitions.predicates, world.definitions.functions
        self.facts = {(predicates.live(one).name, world.names(row)) for one, row in world.facts()}
        self.values = {
            (functions.live(one).name, world.names(row)): (
                world.names([value])[0] if isinstance(value, int) else value
            )
            for (one, row), value in world.values().items()
        }
        for name in ("reach", "far", "busy"):
            self._derive(name)

    def _derive(self, name: str) -> None:
        rules = [rule for rule in read_domain(DOMAIN).derived if rule.predicate == name]
        size = -1
        while size != len(self.facts):
            size = len(self.facts)
            for rule in rules:
                for row in itertools.product(*(RANGES[kind] for kind in ARITIES[name])):
                    names = {
                        one.name.lower(): n for one, n in zip(rule.variables, row, strict=True)
                    }
                    if self.holds(rule.formula, names):
                        self.facts.add((name, row))

    @staticmethod
    def bind(
        names: dict[str, str], variables: tuple[f.TypedName, ...], row: tuple[str, ...]
    ) -> dict[str, str]:
        keys = [variable.name.lower() for variable in variables]
        return {**names, **dict(zip(keys, row, strict=True))}

    def range(self, variable: f.TypedName) -> list[str]:
        found = [name for kind in variable.types for name in RANGES[kind]]
        return [name for name in RANGES["object"] if name in found]

    def term(self, term: f.Term, names: dict[str, str]) -> str | None:
        if isinstance(term, f.Variable):
            return names[term.name.lower()]
        if isinstance(term, f.Constant):
            return term.name
        row = tuple(self.term(one, names) for one in term.terms)
        return self.values.get((term.function, row))  # type: ignore[arg-type, return-value]

    def number(self, part: f.Expression, names: dict[str, str]) -> float | None:
        if isinstance(part, f.Number):
            return float(part.value)
        if isinstance(part, f.Fluent):
            row = tuple(self.term(one, names) for one in part.terms)
            found = self.values.get((part.function, row))  # type: ignore[arg-type]
            return float(found) if isinstance(found, Decimal) else None
        assert isinstance(part, f.Arithmetic)
        values = [self.number(one, names) for one in part.operands]
        if None in values:
            return None
        first, *rest = [value for value in values if value is not None]
        if not rest:
            return -first
        for value in rest:
            if part.operator == "/" and value == 0:
                return None
            first = {
                "+": lambda a, b: a + b,
                "-": lambda a, b: a - b,
                "*": lambda a, b: a * b,
                "/": lambda a, b: a / b,
            }[part.operator](first, value)
        return first

    def holds(self, part: f.Formula, names: dict[str, str]) -> bool:
        if isinstance(part, f.Atom):
            return (
                part.predicate,
                tuple(self.term(one, names) for one in part.terms),
            ) in self.facts
        if isinstance(part, f.Equal):
            left, right = self.term(part.left, names), self.term(part.right, names)
            return left is not None and left == right
        if isinstance(part, f.Comparison):
            first, second = self.number(part.left, names), self.number(part.right, names)
            if first is None or second is None:
                return False
            return {
                "<": first < second,
                "<=": first <= second,
                "=": first == second,
                ">=": first >= second,
                ">": first > second,
            }[part.operator]
        if isinstance(part, f.Not):
            return not self.holds(part.formula, names)
        if isinstance(part, f.And):
            return all(self.holds(one, names) for one in part.formulas)
        if isinstance(part, f.Or):
            return any(self.holds(one, names) for one in part.formulas)
        if isinstance(part, f.Imply):
            return not self.holds(part.condition, names) or self.holds(part.formula, names)
        assert isinstance(part, f.Forall | f.Exists)
        found = (
            self.holds(part.formula, self.bind(names, part.variables, row))
            for row in itertools.product(*(self.range(one) for one in part.variables))
        )
        return all(found) if isinstance(part, f.Forall) else any(found)


@hunting(PROFILE.texts)
@given(st.integers(0, 2**32))
def test_conditions_hold_as_defined(seed: int) -> None:
    chance = random.Random(seed)
    world = random_world(chance)
    for _ in range(2):
        plain = Plain(world)
        for _ in range(8):
            formula = random_formula(chance, {"x": "object"}, chance.randint(0, 4))
            conditions = Conditions(world)
            for name in chance.sample(RANGES["object"], 3):
                wanted = plain.holds(formula, {"x": name})
                assert conditions.holds(formula, {"x": name}) == wanted, f"{formula} of {name}"
                failed = [*failed_parts(world, formula, {"x": name})]
                assert bool(failed) == (not wanted), f"{formula} of {name}: {failed}"
        # Facts that change are seen by what was derived from them.
        for name in BASE:
            row = tuple(chance.choice(RANGES[kind]) for kind in ARITIES[name])
            if not world.add(*fact(world, name, *row)):
                world.remove(*fact(world, name, *row))


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
    assert world.has(*fact(world, "reach", "home", "a"))
    assert world.has(*fact(world, "reach", "b", "c"))
    world.add(*fact(world, "road", "a", "b"))
    # A stored fact is used by the rules.
    assert world.has(*fact(world, "reach", "home", "c"))
    assert not world.has(*fact(world, "far", "home", "c"))
    world.remove(*fact(world, "reach", "b", "c"))
    assert world.has(*fact(world, "reach", "home", "b"))
    assert not world.has(*fact(world, "reach", "home", "c"))
    assert world.has(*fact(world, "far", "home", "c"))
