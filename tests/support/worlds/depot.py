"""A world in which the constructs of the language have something to speak of."""

from __future__ import annotations

from decimal import Decimal

from kant_sql import KnowledgeBase
from kant_sql.dto.formulas import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Equal,
    Exists,
    Expression,
    Fluent,
    Forall,
    Formula,
    Imply,
    Modal,
    Not,
    Number,
    Or,
    Preference,
    Term,
    Timed,
    TypedName,
    Variable,
    When,
)
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
TRUCK, PLACE = TypedName("t", ("truck",)), TypedName("p", ("place",))
T, P, DURATION = Variable("t"), Variable("p"), Variable("duration")
T1, T2, P1, P2, HUB = (Constant(name) for name in ("t1", "t2", "p1", "p2", "hub"))
C1 = Constant("c1")
IDLE = Atom("idle")


def load(kb: KnowledgeBase, problem: str = PROBLEM) -> int:
    """Put the world into an empty knowledge base; give its revision."""
    with kb.transaction():
        kb.load_domain(DOMAIN)
        kb.load_problem(problem)
    return kb.revision


def at(truck: Term = T1, place: Term = P1) -> Atom:
    return Atom("at", (truck, place))


def fuel(truck: Term = T1) -> Fluent:
    return Fluent("fuel", (truck,))


def home(truck: Term = T1) -> Fluent:
    return Fluent("home", (truck,))


def distance(start: Term = P1, end: Term = P2) -> Fluent:
    return Fluent("distance", (start, end))


def number(text: str) -> Number:
    return Number(Decimal(text))


def calculated(operator: str, *operands: Expression) -> Arithmetic:
    return Arithmetic(operator, operands)


def over(*formulas: Formula) -> tuple[Formula, ...]:
    return tuple(Timed("over all", formula) for formula in formulas)


def again(kb: KnowledgeBase) -> KnowledgeBase:
    """The same knowledge base, as a newcomer reads it from the tables."""
    return beside(kb, kb.store.factory._store.name)  # type: ignore[attr-defined]


def check_text(kb: KnowledgeBase) -> None:
    """Check that what is written of a knowledge base is what it holds."""
    domain = kb.pddl.domain()
    assert read_domain(kb.domain_pddl()) == domain
    assert read_problem(kb.problem_pddl(), domain=domain) == kb.pddl.problem()


# Formulas without free variables, by what they are.
CONDITIONS: dict[str, Formula] = {
    "a literal": Not(at()),
    "a constant": at(T1, HUB),
    "no arguments": IDLE,
    "or": Or((at(), Not(IDLE))),
    "empty or": Or(()),
    "imply": Imply(IDLE, at()),
    "not of a conjunction": Not(And((IDLE, at()))),
    "and within or": Or((And((IDLE, at())), And(()))),
    "forall": Forall((TRUCK, PLACE), at(T, P)),
    "exists": Exists((TRUCK,), at(T, P1)),
    "either": Exists((TypedName("w", ("place", "crane")),), Atom("open", (Variable("w"),))),
    "shadowed": Forall((TRUCK,), Or((at(T), Exists((TRUCK,), at(T, P2))))),
    "any object": Forall((TypedName("x"),), Equal(Variable("x"), T1)),
    "equality": Equal(T1, T2),
    "inequality": Forall((TRUCK,), Imply(Not(Equal(T, T1)), Not(at(T)))),
    "object fluent": Equal(home(), HUB),
    "fluent as a term": at(T1, home(T2)),
    "fluent of a bound variable": Exists((TRUCK,), at(T, home(T))),
    "numbers": Comparison(">=", fuel(), number("2.50")),
    "numbers the other way": Comparison("<", number("-0.5"), fuel()),
    "equal numbers": Comparison("=", fuel(), fuel(T2)),
    "arithmetic": Comparison(
        "<=",
        calculated("+", fuel(), calculated("*", number("2"), distance()), number("1")),
        calculated("-", calculated("/", fuel(T2), number("3"))),
    ),
    "distance from a fluent": Comparison(
        ">", distance(home(), P1), calculated("-", fuel(), fuel())
    ),
    "preference": Preference("p1", at()),
    "nameless preference": Preference(None, Or((IDLE,))),
    "preferences for all": Forall((TRUCK,), Preference("each", at(T))),
}

# What may be an effect of an action that is not durative, with ?t and ?p.
EFFECTS: dict[str, Formula] = {
    "add": at(T, P),
    "delete": Not(at(T, P)),
    "forall": Forall((TypedName("q", ("place",)),), Not(at(T, Variable("q")))),
    "when": When(Comparison(">", fuel(T), number("0")), And((at(T, P), Not(IDLE)))),
    "forall when": Forall(
        (TypedName("q", ("place",)),),
        When(Equal(Variable("q"), home(T)), Atom("linked", (P, Variable("q")))),
    ),
    "assign": Assign("assign", fuel(T), number("10.0")),
    "increase": Assign("increase", Fluent("total-cost"), distance(P, home(T))),
    "decrease": Assign("decrease", fuel(T), calculated("/", distance(HUB, P), number("2"))),
    "scale-up": Assign("scale-up", fuel(T), number("2")),
    "scale-down": Assign("scale-down", fuel(T), fuel(T1)),
    "object fluent": Assign("assign", home(T), P),
    "object fluent of another": Assign("assign", home(T), home(T1)),
}

# What may be an effect of a durative action.
TIMED_EFFECTS: dict[str, Formula] = {
    "at start": Timed("at start", Not(at(T, P))),
    "at end": Timed("at end", And((at(T, P), Assign("increase", fuel(T), DURATION)))),
    "forall": Forall((TypedName("q", ("place",)),), Timed("at end", at(T, Variable("q")))),
    "when": When(Timed("at start", IDLE), Timed("at end", at(T, P))),
    "when at end": Timed("at end", When(IDLE, Not(at(T, P)))),
    "continuous": Assign("decrease", fuel(T), ContinuousTime()),
    "at a rate": Assign("increase", fuel(T), calculated("*", ContinuousTime(), distance(P, HUB))),
}

DURATIONS: dict[str, tuple[Formula, ...]] = {
    "any": (),
    "fixed": (Comparison("=", DURATION, number("5.25")),),
    "of a function": (Comparison("=", DURATION, distance(P, HUB)),),
    "calculated": (
        Comparison(
            "=", DURATION, calculated("/", distance(P, home(T)), calculated("+", fuel(T), fuel(T1)))
        ),
    ),
    "at most": (Comparison("<=", DURATION, number("3")),),
    "between": (
        Comparison(">=", DURATION, number("1")),
        Comparison("<=", DURATION, fuel(T)),
    ),
    "at start and at end": (
        Timed("at start", Comparison(">=", DURATION, number("1"))),
        Timed("at end", Comparison("<=", DURATION, number("2"))),
    ),
}

CONSTRAINTS: dict[str, Formula] = {
    "always": Modal("always", (), (Not(IDLE),)),
    "sometime": Modal("sometime", (), (at(),)),
    "at-most-once": Modal("at-most-once", (), (at(T1, HUB),)),
    "sometime-before": Modal("sometime-before", (), (at(), at(T2))),
    "sometime-after": Modal("sometime-after", (), (at(), Or((at(T2), IDLE)))),
    "within": Modal("within", (number("7.5"),), (at(),)),
    "hold-during": Modal("hold-during", (number("1"), number("2")), (IDLE,)),
    "hold-after": Modal("hold-after", (number("20"),), (IDLE,)),
    "always-within": Modal("always-within", (number("5"),), (at(), at(T1, P2))),
    "at end": Timed("at end", Exists((TRUCK,), at(T))),
    "forall": Forall((TRUCK,), Modal("sometime", (), (at(T, HUB),))),
    "and within forall": Forall(
        (TRUCK,), And((Modal("always", (), (at(T),)), Timed("at end", at(T))))
    ),
    "nested": Modal("always", (), (Modal("sometime-after", (), (at(), IDLE)),)),
    "with numbers": Modal("always", (), (Comparison(">", fuel(), number("0")),)),
    "preference": Preference("calm", Modal("always", (), (IDLE,))),
    "preferences for all": Forall((TRUCK,), Preference("back", Modal("sometime", (), (at(T),)))),
}
