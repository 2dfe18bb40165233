"""Reading domains: each construct of the language becomes its nodes."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql.dto.formulas import (
    And,
    Arithmetic,
    Assign,
    Atom,
    Comparison,
    Constant,
    ContinuousTime,
    Derived,
    Equal,
    Exists,
    Fluent,
    Forall,
    Formula,
    Imply,
    Modal,
    Not,
    Number,
    Or,
    Preference,
    Timed,
    TypedName,
    Variable,
    When,
)
from kant_sql.errors import PddlError
from kant_sql.pddl import Action, Domain, Function, Predicate, read_domain

HEAD = """(define (domain Depot)
  (:requirements :ADL :fluents :durative-actions)
  (:types truck Crate - thing place thing - object)
  (:constants Hub - place)
  (:predicates (at ?x - thing ?p - place) (in ?c - crate ?t - truck) (free) (over ?x - thing))
  (:functions (load ?t - truck) (total-cost) - number (home ?t - truck) - place)
"""
X, P, T = Variable("x"), Variable("p"), Variable("t")


def number(text: str) -> Number:
    return Number(Decimal(text))


def read(body: str) -> Domain:
    return read_domain(f"{HEAD}{body})", strict=True)


def action(body: str, kind: str = "action") -> Action:
    parameters = "(?x - crate ?t - truck ?p - place)"
    [found] = read(f"(:{kind} Go :parameters {parameters} {body})").actions
    return found


def condition(formula: str) -> tuple[Formula, ...]:
    return action(f":precondition {formula}").condition


def effect(formula: str) -> tuple[Formula, ...]:
    return action(f":effect {formula}").effect


def timed(condition: str, effect: str = "()", duration: str = "()") -> Action:
    body = f":duration {duration} :condition {condition} :effect {effect}"
    return action(body, "durative-action")


AT = Atom("at", (X, P))
FREE = Atom("free")


def test_declarations() -> None:
    assert read("") == Domain(
        name="Depot",
        requirements=(":ADL", ":fluents", ":durative-actions"),
        types=(
            TypedName("truck", ("thing",)),
            TypedName("Crate", ("thing",)),
            TypedName("place"),
            TypedName("thing"),
        ),
        constants=(TypedName("Hub", ("place",)),),
        predicates=(
            Predicate("at", (TypedName("x", ("thing",)), TypedName("p", ("place",)))),
            Predicate("in", (TypedName("c", ("Crate",)), TypedName("t", ("truck",)))),
            Predicate("free"),
            Predicate("over", (TypedName("x", ("thing",)),)),
        ),
        functions=(
            Function("load", (TypedName("t", ("truck",)),)),
            Function("total-cost"),
            Function("home", (TypedName("t", ("truck",)),), ("place",)),
        ),
    )


def test_an_untyped_domain() -> None:
    domain = read_domain(
        "(define (domain d) (:constants c d) (:predicates (p ?a ?b)))", strict=True
    )
    assert domain.predicates == (Predicate("p", (TypedName("a"), TypedName("b"))),)
    assert domain.constants == (TypedName("c"), TypedName("d"))


def test_either() -> None:
    text = """(define (domain d) (:requirements :typing) (:types a b - (either c d) c d)
      (:constants k - (either a C))
      (:predicates (p ?x ?y - (either a b) ?z)))"""
    domain = read_domain(text, strict=True)
    assert domain.types[0] == TypedName("a", ("c", "d"))
    assert domain.constants == (TypedName("k", ("a", "c")),)
    assert domain.predicates[0].parameters[1] == TypedName("y", ("a", "b"))


def test_an_action_without_anything() -> None:
    assert read("(:action a :parameters ())").actions == (Action("action", "a"),)


@pytest.mark.parametrize("empty", ["()", "(and)", "(and (and) (and (and)))"])
def test_empty_conditions_and_effects(empty: str) -> None:
    found = action(f":precondition {empty} :effect {empty}")
    assert (found.condition, found.effect) == ((), ())


def test_conjunctions_at_the_top_are_flat() -> None:
    assert condition("(and (free) (and (at ?x ?p) (and (free))) (or (and (free))))") == (
        FREE,
        AT,
        FREE,
        Or((And((FREE,)),)),
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(free)", FREE),
        ("(at ?x ?p)", AT),
        ("(at ?x hub)", Atom("at", (X, Constant("Hub")))),
        ("(AT ?X HUB)", Atom("at", (X, Constant("Hub")))),
        ("(at ?x (home ?t))", Atom("at", (X, Fluent("home", (T,))))),
        ("(over ?x)", Atom("over", (X,))),
        ("(not (free))", Not(FREE)),
        ("(or)", Or()),
        ("(imply (free) (at ?x ?p))", Imply(FREE, AT)),
        ("(= ?x ?t)", Equal(X, T)),
        ("(= ?p (home ?t))", Equal(P, Fluent("home", (T,)))),
        ("(= (home ?t) hub)", Equal(Fluent("home", (T,)), Constant("Hub"))),
        ("(= (load ?t) 3)", Comparison("=", Fluent("load", (T,)), number("3"))),
        ("(= 3 (load ?t))", Comparison("=", number("3"), Fluent("load", (T,)))),
        ("(>= (total-cost) -2.50)", Comparison(">=", Fluent("total-cost"), number("-2.50"))),
        (
            "(< (- (load ?t)) (+ 1 2 (* 3 4)))",
            Comparison(
                "<",
                Arithmetic("-", (Fluent("load", (T,)),)),
                Arithmetic(
                    "+",
                    (number("1"), number("2"), Arithmetic("*", (number("3"), number("4")))),
                ),
            ),
        ),
        (
            "(forall (?y - crate) (in ?y ?t))",
            Forall((TypedName("y", ("Crate",)),), Atom("in", (Variable("y"), T))),
        ),
        (
            "(exists (?X - truck ?z - (either place crate)) (in ?y ?x))".replace("?y", "?t"),
            None,
        ),
        (
            "(exists (?X - crate) (and (in ?x ?t)))",
            Exists((TypedName("X", ("Crate",)),), And((Atom("in", (Variable("X"), T)),))),
        ),
        ("(preference quick (free))", Preference("quick", FREE)),
        ("(preference (free))", Preference(None, FREE)),
        (
            "(forall (?y - crate) (preference (free)))",
            Forall((TypedName("y", ("Crate",)),), Preference(None, FREE)),
        ),
    ],
)
def test_conditions(text: str, expected: Formula | None) -> None:
    if expected is None:
        with pytest.raises(PddlError, match="expected Crate as argument 1 of in"):
            condition(text)
    else:
        assert condition(text) == (expected,)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(free)", FREE),
        ("(not (at ?x ?p))", Not(AT)),
        (
            "(forall (?y - crate) (and (in ?y ?t) (free)))",
            Forall((TypedName("y", ("Crate",)),), And((Atom("in", (Variable("y"), T)), FREE))),
        ),
        ("(when (free) (not (free)))", When(FREE, Not(FREE))),
        ("(when () (free))", When(And(), FREE)),
        ("(increase (total-cost) 1)", Assign("increase", Fluent("total-cost"), number("1"))),
        (
            "(SCALE-UP (load ?t) (load ?t))",
            Assign("scale-up", Fluent("load", (T,)), Fluent("load", (T,))),
        ),
        ("(assign (home ?t) ?p)", Assign("assign", Fluent("home", (T,)), P)),
        (
            "(assign (home ?t) (home ?t))",
            Assign("assign", Fluent("home", (T,)), Fluent("home", (T,))),
        ),
    ],
)
def test_effects(text: str, expected: Formula) -> None:
    assert effect(text) == (expected,)


def test_times() -> None:
    found = timed(
        "(and (at start (at ?x ?p)) (OVER ALL (over ?x)) (forall (?y - crate) (at end (free)))"
        " (preference n (at start (free))))",
        "(and (at start (not (at ?x ?p))) (when (at end (free)) (at end (over ?x)))"
        " (when (at start (free)) (at end (free))) (at end (increase (load ?t) ?duration))"
        " (forall (?y - crate) (at start (free))) (increase (load ?t) (* #t 2)))",
    )
    assert found.condition == (
        Timed("at start", AT),
        Timed("over all", Atom("over", (X,))),
        Forall((TypedName("y", ("Crate",)),), Timed("at end", FREE)),
        Preference("n", Timed("at start", FREE)),
    )
    assert found.effect == (
        Timed("at start", Not(AT)),
        When(Timed("at end", FREE), Timed("at end", Atom("over", (X,)))),
        When(Timed("at start", FREE), Timed("at end", FREE)),
        Timed("at end", Assign("increase", Fluent("load", (T,)), Variable("duration"))),
        Forall((TypedName("y", ("Crate",)),), Timed("at start", FREE)),
        Assign(
            "increase",
            Fluent("load", (T,)),
            Arithmetic("*", (ContinuousTime(), number("2"))),
        ),
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("()", ()),
        ("(= ?duration 5)", (Comparison("=", Variable("duration"), number("5")),)),
        (
            "(and (>= ?duration (load ?t)) (at end (<= ?DURATION 9)))",
            (
                Comparison(">=", Variable("duration"), Fluent("load", (T,))),
                Timed("at end", Comparison("<=", Variable("duration"), number("9"))),
            ),
        ),
    ],
)
def test_durations(text: str, expected: tuple[Formula, ...]) -> None:
    assert timed("()", duration=text).duration == expected


def test_the_variable_duration_is_a_parameter_elsewhere() -> None:
    [found] = read(
        "(:action a :parameters (?duration - crate) :precondition (over ?duration))"
    ).actions
    assert found.condition == (Atom("over", (Variable("duration"),)),)


@pytest.mark.parametrize("kind", ["process", "event"])
def test_processes_and_events(kind: str) -> None:
    text = f"(:{kind} e :parameters (?t - truck) :precondition (free) :effect (not (free)))"
    assert read(text).actions[0].kind == kind


def test_a_continuous_effect_of_a_process() -> None:
    text = "(:process e :parameters (?t - truck) :effect (decrease (load ?t) (* #T 1)))"
    [found] = read(text).actions[0].effect
    assert isinstance(found, Assign)
    assert found.value == Arithmetic("*", (ContinuousTime(), number("1")))


def test_derived_predicates() -> None:
    domain = read("(:derived (at ?y - crate ?P) (over ?Y)) (:derived (free) (exists () (free)))")
    assert domain.derived == (
        Derived(
            "at",
            (TypedName("y", ("Crate",)), TypedName("P")),
            Atom("over", (Variable("y"),)),
        ),
        Derived("free", (), Exists((), FREE)),
    )


def test_constraints() -> None:
    domain = read_domain(
        """(define (domain d) (:requirements :constraints) (:predicates (p) (within ?x))
        (:constraints (and (always (p))
          (forall (?x) (preference n (sometime-after (p) (within ?x)))) (at end (p)) (within 5 (p))
          (hold-during 1 2.5 (p)) (always (sometime (p)))))
        (:action a :parameters (?x) :precondition (within ?x)))""",
        strict=True,
    )
    p = Atom("p")
    assert domain.constraints == (
        Modal("always", (), (p,)),
        Forall(
            (TypedName("x"),),
            Preference("n", Modal("sometime-after", (), (p, Atom("within", (Variable("x"),))))),
        ),
        Timed("at end", p),
        Modal("within", (number("5"),), (p,)),
        Modal("hold-during", (number("1"), number("2.5")), (p,)),
        Modal("always", (), (Modal("sometime", (), (p,)),)),
    )
    assert domain.actions[0].condition == (Atom("within", (Variable("x"),)),)


def test_a_variable_is_bound_anew_within_a_quantifier() -> None:
    text = "(and (exists (?X - place) (at ?t ?x)) (over ?x))"
    assert condition(text) == (
        Exists((TypedName("X", ("place",)),), Atom("at", (T, Variable("X")))),
        Atom("over", (X,)),
    )


def test_predicates_may_be_named_like_operators() -> None:
    domain = read_domain(
        """(define (domain d) (:constants start)
        (:predicates (at ?a ?b) (increase ?a) (always ?a) (preference ?a))
        (:action a :parameters (?x)
         :precondition (and (at start ?x) (always ?x) (not (preference ?x)))
         :effect (and (increase ?x) (at ?x start))))"""
    )
    start, x = Constant("start"), Variable("x")
    [found] = domain.actions
    assert found.condition[:2] == (Atom("at", (start, x)), Atom("always", (x,)))
    assert found.condition[2] == Not(Atom("preference", (x,)))
    assert found.effect == (Atom("increase", (x,)), Atom("at", (x, start)))


def test_subtypes_fit_and_so_does_one_of_either() -> None:
    found = read(
        """(:action a :parameters (?y - (either crate place) ?z)
        :precondition (and (over ?y) (at ?y hub)))"""
    )
    assert found.warnings == ()


def test_several_sources_are_one_domain() -> None:
    first = f"{HEAD} (:action a :parameters (?x - crate) :effect (over ?x)))"
    second = """(define (domain DEPOT) (:requirements :adl :typing)
      (:types truck - thing plane - thing place thing) (:constants hub - place sea - place)
      (:predicates (free) (flies ?p - plane) (at ?y - thing ?q - place))
      (:functions (TOTAL-COST))
      (:action A :parameters (?x - crate) :effect (over ?x))
      (:action fly :parameters (?p - plane) :effect (flies ?p)))"""
    domain = read_domain(first, second, strict=True)
    assert domain.name == "Depot"
    assert domain.requirements == (":ADL", ":fluents", ":durative-actions", ":typing")
    assert [one.name for one in domain.types] == ["truck", "Crate", "place", "thing", "plane"]
    assert [one.name for one in domain.constants] == ["Hub", "sea"]
    assert [one.name for one in domain.predicates] == ["at", "in", "free", "over", "flies"]
    assert [one.name for one in domain.actions] == ["a", "fly"]
    assert domain.warnings == ()
    assert read_domain(first) == read_domain(first, first)


def test_one_source_may_use_what_another_declares() -> None:
    using = "(define (domain Depot) (:action a :parameters (?c - crate) :effect (over ?c)))"
    assert read_domain(using, f"{HEAD})", strict=True).actions == (
        read_domain(f"{HEAD})", using).actions
    )


@pytest.mark.parametrize(
    "second",
    [
        "(:predicates (free ?x))",
        "(:predicates (at ?x - crate ?p - place))",
        "(:functions (load ?t - truck) - place)",
        "(:types truck - place)",
        "(:constants hub - crate)",
        "(:action a :parameters ())",
    ],
)
def test_sources_that_contradict_each_other(second: str) -> None:
    first = f"{HEAD} (:action a :parameters (?x - crate)))"
    with pytest.raises(PddlError) as refused:
        read_domain(first, f"(define (domain depot)\n {second})")
    assert refused.value.line == 2
