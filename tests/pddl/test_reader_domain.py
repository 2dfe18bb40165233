"""Reading domains: each construct of the language becomes its nodes."""

from __future__ import annotations

from decimal import Decimal

import pytest

from kant_sql.dto import formulas as f
from kant_sql.errors import PddlError
from kant_sql.pddl import Action, Domain, Function, Predicate, read_domain

HEAD = """(define (domain Depot)
  (:requirements :ADL :fluents :durative-actions)
  (:types truck Crate - thing place thing - object)
  (:constants Hub - place)
  (:predicates (at ?x - thing ?p - place) (in ?c - crate ?t - truck) (free) (over ?x - thing))
  (:functions (load ?t - truck) (total-cost) - number (home ?t - truck) - place)
"""
X, P, T = f.Variable("x"), f.Variable("p"), f.Variable("t")


def number(text: str) -> f.Number:
    return f.Number(Decimal(text))


def read(body: str) -> Domain:
    return read_domain(f"{HEAD}{body})", strict=True)


def action(body: str, kind: str = "action") -> Action:
    parameters = "(?x - crate ?t - truck ?p - place)"
    [found] = read(f"(:{kind} Go :parameters {parameters} {body})").actions
    return found


def condition(formula: str) -> tuple[f.Formula, ...]:
    return action(f":precondition {formula}").condition


def effect(formula: str) -> tuple[f.Formula, ...]:
    return action(f":effect {formula}").effect


def timed(condition: str, effect: str = "()", duration: str = "()") -> Action:
    body = f":duration {duration} :condition {condition} :effect {effect}"
    return action(body, "durative-action")


AT = f.Atom("at", (X, P))
FREE = f.Atom("free")


def test_declarations() -> None:
    assert read("") == Domain(
        name="Depot",
        requirements=(":ADL", ":fluents", ":durative-actions"),
        types=(
            f.TypedName("truck", ("thing",)),
            f.TypedName("Crate", ("thing",)),
            f.TypedName("place"),
            f.TypedName("thing"),
        ),
        constants=(f.TypedName("Hub", ("place",)),),
        predicates=(
            Predicate("at", (f.TypedName("x", ("thing",)), f.TypedName("p", ("place",)))),
            Predicate("in", (f.TypedName("c", ("Crate",)), f.TypedName("t", ("truck",)))),
            Predicate("free"),
            Predicate("over", (f.TypedName("x", ("thing",)),)),
        ),
        functions=(
            Function("load", (f.TypedName("t", ("truck",)),)),
            Function("total-cost"),
            Function("home", (f.TypedName("t", ("truck",)),), ("place",)),
        ),
    )


def test_an_untyped_domain() -> None:
    domain = read_domain(
        "(define (domain d) (:constants c d) (:predicates (p ?a ?b)))", strict=True
    )
    assert domain.predicates == (Predicate("p", (f.TypedName("a"), f.TypedName("b"))),)
    assert domain.constants == (f.TypedName("c"), f.TypedName("d"))


def test_either() -> None:
    text = """(define (domain d) (:requirements :typing) (:types a b - (either c d) c d)
      (:constants k - (either a C))
      (:predicates (p ?x ?y - (either a b) ?z)))"""
    domain = read_domain(text, strict=True)
    assert domain.types[0] == f.TypedName("a", ("c", "d"))
    assert domain.constants == (f.TypedName("k", ("a", "c")),)
    assert domain.predicates[0].parameters[1] == f.TypedName("y", ("a", "b"))


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
        f.Or((f.And((FREE,)),)),
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(free)", FREE),
        ("(at ?x ?p)", AT),
        ("(at ?x hub)", f.Atom("at", (X, f.Constant("Hub")))),
        ("(AT ?X HUB)", f.Atom("at", (X, f.Constant("Hub")))),
        ("(at ?x (home ?t))", f.Atom("at", (X, f.Fluent("home", (T,))))),
        ("(over ?x)", f.Atom("over", (X,))),
        ("(not (free))", f.Not(FREE)),
        ("(or)", f.Or()),
        ("(imply (free) (at ?x ?p))", f.Imply(FREE, AT)),
        ("(= ?x ?t)", f.Equal(X, T)),
        ("(= ?p (home ?t))", f.Equal(P, f.Fluent("home", (T,)))),
        ("(= (home ?t) hub)", f.Equal(f.Fluent("home", (T,)), f.Constant("Hub"))),
        ("(= (load ?t) 3)", f.Comparison("=", f.Fluent("load", (T,)), number("3"))),
        ("(= 3 (load ?t))", f.Comparison("=", number("3"), f.Fluent("load", (T,)))),
        ("(>= (total-cost) -2.50)", f.Comparison(">=", f.Fluent("total-cost"), number("-2.50"))),
        (
            "(< (- (load ?t)) (+ 1 2 (* 3 4)))",
            f.Comparison(
                "<",
                f.Arithmetic("-", (f.Fluent("load", (T,)),)),
                f.Arithmetic(
                    "+", (number("1"), number("2"), f.Arithmetic("*", (number("3"), number("4"))))
                ),
            ),
        ),
        (
            "(forall (?y - crate) (in ?y ?t))",
            f.Forall((f.TypedName("y", ("Crate",)),), f.Atom("in", (f.Variable("y"), T))),
        ),
        ("(exists (?X - truck ?z - (either place crate)) (in ?y ?x))".replace("?y", "?t"), None),
        (
            "(exists (?X - crate) (and (in ?x ?t)))",
            f.Exists((f.TypedName("X", ("Crate",)),), f.And((f.Atom("in", (f.Variable("X"), T)),))),
        ),
        ("(preference quick (free))", f.Preference("quick", FREE)),
        ("(preference (free))", f.Preference(None, FREE)),
        (
            "(forall (?y - crate) (preference (free)))",
            f.Forall((f.TypedName("y", ("Crate",)),), f.Preference(None, FREE)),
        ),
    ],
)
def test_conditions(text: str, expected: f.Formula | None) -> None:
    if expected is None:
        with pytest.raises(PddlError, match="expected Crate as argument 1 of in"):
            condition(text)
    else:
        assert condition(text) == (expected,)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(free)", FREE),
        ("(not (at ?x ?p))", f.Not(AT)),
        (
            "(forall (?y - crate) (and (in ?y ?t) (free)))",
            f.Forall(
                (f.TypedName("y", ("Crate",)),), f.And((f.Atom("in", (f.Variable("y"), T)), FREE))
            ),
        ),
        ("(when (free) (not (free)))", f.When(FREE, f.Not(FREE))),
        ("(when () (free))", f.When(f.And(), FREE)),
        ("(increase (total-cost) 1)", f.Assign("increase", f.Fluent("total-cost"), number("1"))),
        (
            "(SCALE-UP (load ?t) (load ?t))",
            f.Assign("scale-up", f.Fluent("load", (T,)), f.Fluent("load", (T,))),
        ),
        ("(assign (home ?t) ?p)", f.Assign("assign", f.Fluent("home", (T,)), P)),
        (
            "(assign (home ?t) (home ?t))",
            f.Assign("assign", f.Fluent("home", (T,)), f.Fluent("home", (T,))),
        ),
    ],
)
def test_effects(text: str, expected: f.Formula) -> None:
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
        f.Timed("at start", AT),
        f.Timed("over all", f.Atom("over", (X,))),
        f.Forall((f.TypedName("y", ("Crate",)),), f.Timed("at end", FREE)),
        f.Preference("n", f.Timed("at start", FREE)),
    )
    assert found.effect == (
        f.Timed("at start", f.Not(AT)),
        f.When(f.Timed("at end", FREE), f.Timed("at end", f.Atom("over", (X,)))),
        f.When(f.Timed("at start", FREE), f.Timed("at end", FREE)),
        f.Timed("at end", f.Assign("increase", f.Fluent("load", (T,)), f.Variable("duration"))),
        f.Forall((f.TypedName("y", ("Crate",)),), f.Timed("at start", FREE)),
        f.Assign(
            "increase", f.Fluent("load", (T,)), f.Arithmetic("*", (f.ContinuousTime(), number("2")))
        ),
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("()", ()),
        ("(= ?duration 5)", (f.Comparison("=", f.Variable("duration"), number("5")),)),
        (
            "(and (>= ?duration (load ?t)) (at end (<= ?DURATION 9)))",
            (
                f.Comparison(">=", f.Variable("duration"), f.Fluent("load", (T,))),
                f.Timed("at end", f.Comparison("<=", f.Variable("duration"), number("9"))),
            ),
        ),
    ],
)
def test_durations(text: str, expected: tuple[f.Formula, ...]) -> None:
    assert timed("()", duration=text).duration == expected


def test_the_variable_duration_is_a_parameter_elsewhere() -> None:
    [found] = read(
        "(:action a :parameters (?duration - crate) :precondition (over ?duration))"
    ).actions
    assert found.condition == (f.Atom("over", (f.Variable("duration"),)),)


@pytest.mark.parametrize("kind", ["process", "event"])
def test_processes_and_events(kind: str) -> None:
    text = f"(:{kind} e :parameters (?t - truck) :precondition (free) :effect (not (free)))"
    assert read(text).actions[0].kind == kind


def test_a_continuous_effect_of_a_process() -> None:
    text = "(:process e :parameters (?t - truck) :effect (decrease (load ?t) (* #T 1)))"
    [found] = read(text).actions[0].effect
    assert isinstance(found, f.Assign)
    assert found.value == f.Arithmetic("*", (f.ContinuousTime(), number("1")))


def test_derived_predicates() -> None:
    domain = read("(:derived (at ?y - crate ?P) (over ?Y)) (:derived (free) (exists () (free)))")
    assert domain.derived == (
        f.Derived(
            "at",
            (f.TypedName("y", ("Crate",)), f.TypedName("P")),
            f.Atom("over", (f.Variable("y"),)),
        ),
        f.Derived("free", (), f.Exists((), FREE)),
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
    p = f.Atom("p")
    assert domain.constraints == (
        f.Modal("always", (), (p,)),
        f.Forall(
            (f.TypedName("x"),),
            f.Preference(
                "n", f.Modal("sometime-after", (), (p, f.Atom("within", (f.Variable("x"),))))
            ),
        ),
        f.Timed("at end", p),
        f.Modal("within", (number("5"),), (p,)),
        f.Modal("hold-during", (number("1"), number("2.5")), (p,)),
        f.Modal("always", (), (f.Modal("sometime", (), (p,)),)),
    )
    assert domain.actions[0].condition == (f.Atom("within", (f.Variable("x"),)),)


def test_a_variable_is_bound_anew_within_a_quantifier() -> None:
    text = "(and (exists (?X - place) (at ?t ?x)) (over ?x))"
    assert condition(text) == (
        f.Exists((f.TypedName("X", ("place",)),), f.Atom("at", (T, f.Variable("X")))),
        f.Atom("over", (X,)),
    )


def test_predicates_may_be_named_like_operators() -> None:
    domain = read_domain(
        """(define (domain d) (:constants start)
        (:predicates (at ?a ?b) (increase ?a) (always ?a) (preference ?a))
        (:action a :parameters (?x)
         :precondition (and (at start ?x) (always ?x) (not (preference ?x)))
         :effect (and (increase ?x) (at ?x start))))"""
    )
    start, x = f.Constant("start"), f.Variable("x")
    [found] = domain.actions
    assert found.condition[:2] == (f.Atom("at", (start, x)), f.Atom("always", (x,)))
    assert found.condition[2] == f.Not(f.Atom("preference", (x,)))
    assert found.effect == (f.Atom("increase", (x,)), f.Atom("at", (x, start)))


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
        *("(:predicates (free ?x))", "(:predicates (at ?x - crate ?p - place))"),
        *("(:functions (load ?t - truck) - place)", "(:types truck - place)"),
        *("(:constants hub - crate)", "(:action a :parameters ())"),
    ],
)
def test_sources_that_contradict_each_other(second: str) -> None:
    first = f"{HEAD} (:action a :parameters (?x - crate)))"
    with pytest.raises(PddlError) as refused:
        read_domain(first, f"(define (domain depot)\n {second})")
    assert refused.value.line == 2
