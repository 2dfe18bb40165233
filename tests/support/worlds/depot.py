"""A world with an element for each construct of the language."""

from __future__ import annotations

from decimal import Decimal

from kant_sql import KnowledgeBase
from kant_sql.dto import formulas as f
from kant_sql.pddl import read_domain, read_problem
from tests.support.reading import beside

DOMAIN = """
(define (domain depot)
  (:types truck crane - machine machine place)
  (:constants hub - place)
  (:predicates (at ?t - truck ?p - place) (ready ?m - machine) (linked ?x ?x - place)
               (open ?w - (either place crane)) (idle) (reachable ?p - place))
  (:functions (fuel ?t - truck) (distance ?a ?b - place) - number (home ?t - truck) - place
              (total-cost)))
"""
PROBLEM = """
(define (problem monday) (:domain depot)
  (:objects t1 t2 - truck c1 - crane p1 p2 - place)
  (:init (at t1 p1) (= (fuel t1) 7.50) (= (home t1) hub))
  (:goal (and)))
"""
TRUCK, PLACE = f.TypedName("t", ("truck",)), f.TypedName("p", ("place",))
T, P, DURATION = f.Variable("t"), f.Variable("p"), f.Variable("duration")
T1, T2, P1, P2, HUB = (f.Constant(name) for name in ("t1", "t2", "p1", "p2", "hub"))
C1 = f.Constant("c1")
IDLE = f.Atom("idle")


def load(kb: KnowledgeBase, problem: str = PROBLEM) -> int:
    """Load the world into an empty knowledge base; return its revision."""
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(problem)
    return kb.revision


def at(truck: f.Term = T1, place: f.Term = P1) -> f.Atom:
    return f.Atom("at", (truck, place))


def fuel(truck: f.Term = T1) -> f.Fluent:
    return f.Fluent("fuel", (truck,))


def home(truck: f.Term = T1) -> f.Fluent:
    return f.Fluent("home", (truck,))


def distance(start: f.Term = P1, end: f.Term = P2) -> f.Fluent:
    return f.Fluent("distance", (start, end))


def number(text: str) -> f.Number:
    return f.Number(Decimal(text))


def calculated(operator: str, *operands: f.Expression) -> f.Arithmetic:
    return f.Arithmetic(operator, operands)


def over(*formulas: f.Formula) -> tuple[f.Formula, ...]:
    return tuple(f.Timed("over all", formula) for formula in formulas)


def again(kb: KnowledgeBase) -> KnowledgeBase:
    """Return the same knowledge base, read from the tables by a new connection."""
    return beside(kb, kb.store.factory._store.name)  # type: ignore[attr-defined]


def check_text(kb: KnowledgeBase) -> None:
    """Check that the text of a knowledge base matches its content."""
    domain = kb.pddl.domain()
    assert read_domain(kb.domain_pddl()) == domain
    assert read_problem(kb.problem_pddl(), domain=domain) == kb.pddl.problem()


# Formulas without free variables, by description.
CONDITIONS: dict[str, f.Formula] = {
    "a literal": f.Not(at()),
    "a constant": at(T1, HUB),
    "no arguments": IDLE,
    "or": f.Or((at(), f.Not(IDLE))),
    "empty or": f.Or(()),
    "imply": f.Imply(IDLE, at()),
    "not of a conjunction": f.Not(f.And((IDLE, at()))),
    "and within or": f.Or((f.And((IDLE, at())), f.And(()))),
    "forall": f.Forall((TRUCK, PLACE), at(T, P)),
    "exists": f.Exists((TRUCK,), at(T, P1)),
    "either": f.Exists((f.TypedName("w", ("place", "crane")),), f.Atom("open", (f.Variable("w"),))),
    "shadowed": f.Forall((TRUCK,), f.Or((at(T), f.Exists((TRUCK,), at(T, P2))))),
    "any object": f.Forall((f.TypedName("x"),), f.Equal(f.Variable("x"), T1)),
    "equality": f.Equal(T1, T2),
    "inequality": f.Forall((TRUCK,), f.Imply(f.Not(f.Equal(T, T1)), f.Not(at(T)))),
    "object fluent": f.Equal(home(), HUB),
    "fluent as a term": at(T1, home(T2)),
    "fluent of a bound variable": f.Exists((TRUCK,), at(T, home(T))),
    "numbers": f.Comparison(">=", fuel(), number("2.50")),
    "numbers the other way": f.Comparison("<", number("-0.5"), fuel()),
    "equal numbers": f.Comparison("=", fuel(), fuel(T2)),
    "arithmetic": f.Comparison(
        "<=",
        calculated("+", fuel(), calculated("*", number("2"), distance()), number("1")),
        calculated("-", calculated("/", fuel(T2), number("3"))),
    ),
    "distance from a fluent": f.Comparison(
        ">", distance(home(), P1), calculated("-", fuel(), fuel())
    ),
    "preference": f.Preference("p1", at()),
    "nameless preference": f.Preference(None, f.Or((IDLE,))),
    "preferences for all": f.Forall((TRUCK,), f.Preference("each", at(T))),
}

# Effects of an instantaneous action with ?t and ?p.
EFFECTS: dict[str, f.Formula] = {
    "add": at(T, P),
    "delete": f.Not(at(T, P)),
    "forall": f.Forall((f.TypedName("q", ("place",)),), f.Not(at(T, f.Variable("q")))),
    "when": f.When(f.Comparison(">", fuel(T), number("0")), f.And((at(T, P), f.Not(IDLE)))),
    "forall when": f.Forall(
        (f.TypedName("q", ("place",)),),
        f.When(f.Equal(f.Variable("q"), home(T)), f.Atom("linked", (P, f.Variable("q")))),
    ),
    "assign": f.Assign("assign", fuel(T), number("10.0")),
    "increase": f.Assign("increase", f.Fluent("total-cost"), distance(P, home(T))),
    "decrease": f.Assign("decrease", fuel(T), calculated("/", distance(HUB, P), number("2"))),
    "scale-up": f.Assign("scale-up", fuel(T), number("2")),
    "scale-down": f.Assign("scale-down", fuel(T), fuel(T1)),
    "object fluent": f.Assign("assign", home(T), P),
    "object fluent of another": f.Assign("assign", home(T), home(T1)),
}

# Effects of a durative action.
TIMED_EFFECTS: dict[str, f.Formula] = {
    "at start": f.Timed("at start", f.Not(at(T, P))),
    "at end": f.Timed("at end", f.And((at(T, P), f.Assign("increase", fuel(T), DURATION)))),
    "forall": f.Forall((f.TypedName("q", ("place",)),), f.Timed("at end", at(T, f.Variable("q")))),
    "when": f.When(f.Timed("at start", IDLE), f.Timed("at end", at(T, P))),
    "when at end": f.Timed("at end", f.When(IDLE, f.Not(at(T, P)))),
    "continuous": f.Assign("decrease", fuel(T), f.ContinuousTime()),
    "at a rate": f.Assign(
        "increase", fuel(T), calculated("*", f.ContinuousTime(), distance(P, HUB))
    ),
}

DURATIONS: dict[str, tuple[f.Formula, ...]] = {
    "any": (),
    "fixed": (f.Comparison("=", DURATION, number("5.25")),),
    "of a function": (f.Comparison("=", DURATION, distance(P, HUB)),),
    "calculated": (
        f.Comparison(
            "=", DURATION, calculated("/", distance(P, home(T)), calculated("+", fuel(T), fuel(T1)))
        ),
    ),
    "at most": (f.Comparison("<=", DURATION, number("3")),),
    "between": (f.Comparison(">=", DURATION, number("1")), f.Comparison("<=", DURATION, fuel(T))),
    "at start and at end": (
        f.Timed("at start", f.Comparison(">=", DURATION, number("1"))),
        f.Timed("at end", f.Comparison("<=", DURATION, number("2"))),
    ),
}

CONSTRAINTS: dict[str, f.Formula] = {
    "always": f.Modal("always", (), (f.Not(IDLE),)),
    "sometime": f.Modal("sometime", (), (at(),)),
    "at-most-once": f.Modal("at-most-once", (), (at(T1, HUB),)),
    "sometime-before": f.Modal("sometime-before", (), (at(), at(T2))),
    "sometime-after": f.Modal("sometime-after", (), (at(), f.Or((at(T2), IDLE)))),
    "within": f.Modal("within", (number("7.5"),), (at(),)),
    "hold-during": f.Modal("hold-during", (number("1"), number("2")), (IDLE,)),
    "hold-after": f.Modal("hold-after", (number("20"),), (IDLE,)),
    "always-within": f.Modal("always-within", (number("5"),), (at(), at(T1, P2))),
    "at end": f.Timed("at end", f.Exists((TRUCK,), at(T))),
    "forall": f.Forall((TRUCK,), f.Modal("sometime", (), (at(T, HUB),))),
    "and within forall": f.Forall(
        (TRUCK,), f.And((f.Modal("always", (), (at(T),)), f.Timed("at end", at(T))))
    ),
    "nested": f.Modal("always", (), (f.Modal("sometime-after", (), (at(), IDLE)),)),
    "with numbers": f.Modal("always", (), (f.Comparison(">", fuel(), number("0")),)),
    "preference": f.Preference("calm", f.Modal("always", (), (IDLE,))),
    "preferences for all": f.Forall(
        (TRUCK,), f.Preference("back", f.Modal("sometime", (), (at(T),)))
    ),
}
