"""A state in memory answers, acts and is compared as the store does, on every backend."""

from __future__ import annotations

import copy
import re
import threading
from decimal import Decimal
from random import Random
from typing import Any, cast

import pytest
from hypothesis import given

import kant_sql
from kant_sql import (
    InvalidArgumentError,
    KantSqlError,
    KnowledgeBase,
    NotApplicableError,
    PlanStep,
    ReadOnlyError,
    StaleRevisionError,
    UnsupportedConstructError,
)
from kant_sql.dto.formulas import variables_text
from kant_sql.pddl.document import Action
from kant_sql.reasoning.memory import KnowledgeState
from tests.contract.test_reasoning_oracle import ASSIGNED, opened
from tests.support.generators.episodes import EPISODES, Episode
from tests.support.profile import PROFILE, hunting
from tests.support.reading import beside, loaded, undone
from tests.support.statements import recorded

Lines = frozenset[tuple[str, str]]


def lines(kb: KnowledgeBase) -> Lines:
    """The facts and values of a store."""
    facts = {("fact", str(each)) for each in kb.propositions.get_all()}
    return frozenset(facts | {("value", str(each)) for each in kb.function_values.get_all()})


def result(call: Any) -> Any:
    """What a call returns, or its error."""
    try:
        return call()
    except NotApplicableError as error:
        # Effects without a result are told as `validate` tells them.
        return "NotApplicableError", bool(error.unsatisfied)
    except KantSqlError as error:
        return type(error).__name__, str(error)


class Twins:
    """A knowledge base and its state in memory, asked and acted on alike."""

    def __init__(self, kb: KnowledgeBase, episode: Episode) -> None:
        self.kb, self.state, self.episode = kb, kb.state(), episode
        self.before = lines(kb)

    def ask(self) -> None:
        for question in self.episode.questions:
            about = f"episode({self.episode.seed}): {question}"
            given: dict[str, Any] = {**question.fixed}
            parameters = f"({variables_text(question.columns)})"
            found = [
                one.query(question.formula, parameters=parameters, **given)
                for one in (self.kb, self.state)
            ]
            assert [*found[0]] == [*found[1]], about
            assert found[0].columns == found[1].columns, about
            both = [result(lambda: one.holds(question.formula)) for one in (self.kb, self.state)]  # noqa: B023
            assert both[0] == both[1], about
        assert self.state.goal_reached() is (not self.kb.unsatisfied())

    def act(self) -> None:
        actions, random = self.episode.domain.actions, Random(self.episode.seed)
        about = f"episode({self.episode.seed})"
        timed = {each.name for each in actions if each.duration}
        ours, theirs = self.state.applicable_actions(), [*self.kb.applicable_actions()]
        at_once = [[one for one in steps if one.action not in timed] for steps in (ours, theirs)]
        assert at_once[0] == at_once[1], about
        for step in ours:
            assert not self.kb.why_not(step), f"{about}: {step}"
        names = [one.name for one in self.kb.objects.get_all()]
        for action in actions:
            for _ in range(ASSIGNED if names else 0):
                self.take(action, tuple(random.choices(names, k=len(action.parameters))), random)
        for step in random.sample(ours, min(len(ours), ASSIGNED)):
            self.same(step)

    def take(self, action: Action, arguments: tuple[str, ...], random: Random) -> None:
        step = f"({' '.join((action.name, *arguments))})"
        for lasts in (None, random.randint(0, 9)) if action.duration else (None,):
            self.same(step if lasts is None else f"{step} [{lasts}]")

    def same(self, step: str | PlanStep) -> None:
        about = f"episode({self.episode.seed}): {step}"
        with undone(self.kb):
            theirs = result(lambda: self.kb.apply(step))
            after = lines(self.kb)
        ours = result(lambda: self.state.apply(step))
        if not isinstance(ours, KnowledgeState):
            assert theirs is not None, about
            assert (ours[0], ours[1]) == (theirs[0], theirs[1]), about
            return
        assert theirs is None, f"{about}: {theirs}"
        changes = ours.difference()
        gone = {change[1:] for change in changes if change.sign == "-"}
        assert gone <= self.before, about
        assert self.before - gone | {c[1:] for c in changes if c.sign == "+"} == after, about
        assert ours.difference(ours) == [], about
        assert self.state.difference(self.state) == [] == self.state.difference(), about


def test_states_answer_and_act_as_the_store(fresh_kb: KnowledgeBase) -> None:
    @hunting(PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        kb = opened(fresh_kb, episode)
        episode.changes[0].make(kb)
        twins = Twins(kb, episode)
        twins.ask()
        twins.act()

    same()


DOMAIN = """(define (domain home)
  (:requirements :typing :fluents :derived-predicates :durative-actions :conditional-effects)
  (:types place) (:predicates (at ?p - place) (door ?a ?b - place) (lit) (near ?p - place))
  (:functions (battery) (length ?a ?b - place) - number (base) - place)
  (:derived (near ?p - place) (or (at ?p) (exists (?q - place) (and (near ?q) (door ?q ?p)))))
  (:action move :parameters (?a ?b - place)
    :precondition (and (at ?a) (door ?a ?b) (>= (battery) (length ?a ?b)))
    :effect (and (not (at ?a)) (at ?b) (decrease (battery) (length ?a ?b))
                 (when (lit) (assign (base) ?b))))
  (:durative-action charge :parameters (?p - place)
    :duration (and (>= ?duration 2) (<= ?duration (- 10 (battery))))
    :condition (and (at start (at ?p)) (over all (<= (battery) 10)))
    :effect (and (increase (battery) #t) (at end (lit)))))"""
PROBLEM = """(define (problem night) (:domain home) (:objects hall lab attic - place)
  (:init (at hall) (door hall lab) (door lab hall) (door lab attic)
         (= (battery) 7) (= (length hall lab) 3) (= (length lab hall) 3) (= (length lab attic) 0.1))
  (:goal (and (at lab) (lit))))"""


@pytest.fixture
def home(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    with fresh_kb.transaction():
        return loaded(fresh_kb, DOMAIN, PROBLEM)


def test_a_search_ends_in_one_revision(home: KnowledgeBase) -> None:
    frontier, seen = [home.state()], {home.state()}
    while not frontier[0].goal_reached():
        state = frontier.pop(0)
        for step in state.applicable_actions():
            after = state.apply(step)
            if after not in seen:
                seen.add(after)
                frontier.append(after)
    found, before = frontier[0], home.revision
    with recorded() as statements:
        assert home.commit(found, reason="searched", actor="search") == before + 1
    assert len(statements) <= 12
    entry = next(home.log())
    assert (entry.revision.actor, entry.revision.reason) == ("search", "searched")
    assert home.diff(before, before + 1) == found.difference()
    assert not home.unsatisfied()
    assert home.state() == found
    assert home.commit(home.state()) is None


def test_durations_are_those_that_the_constraints_admit(home: KnowledgeBase) -> None:
    state = home.state()
    assert [*map(str, state.applicable_actions())] == ["(move hall lab)", "(charge hall) [2]"]
    assert state.durations("(charge hall)") == kant_sql.Durations(Decimal(2), Decimal(3))
    assert state.durations("(move hall lab)") is None
    for lasts, is_admitted in ((1, False), (2, True), (3, True), (4, False)):
        step = f"(charge hall) [{lasts}]"
        assert (home.why_not(step) == []) is is_admitted
        assert isinstance(result(lambda: state.apply(step)), KnowledgeState) is is_admitted  # noqa: B023
    for number in (3, 3.0):
        # Numbers of any kind are taken, as they are for values.
        given = PlanStep(None, "charge", ("hall",), cast("Any", number))
        assert home.why_not(given) == []
        assert state.apply(given) == state.apply("(charge hall) [3]")
    charged = state.apply("(charge hall) [3]")
    assert charged.holds("(and (= (battery) 10) (lit))")
    with pytest.raises(NotApplicableError, match="no duration is from 2 to 0"):
        charged.durations("(charge hall)")


def test_objects_fit_before_durations_are_asked_for(home: KnowledgeBase) -> None:
    home.objects.save("crate")
    with pytest.raises(NotApplicableError, match="crate is of type object, expected place"):
        home.state().durations("(charge crate)")


def test_numbers_that_no_store_can_write_are_refused(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain growth) (:requirements :fluents) (:functions (n))
      (:action square :parameters () :effect (assign (n) (* (n) (n)))))""")
    fresh_kb.function_values.set("n", value=Decimal(7))

    def grow(found: Any) -> None:
        for _ in range(10):
            after = found.apply("(square)")
            found = after if isinstance(after, KnowledgeState) else found

    first = fresh_kb.state()
    theirs, ours = (result(lambda: grow(each)) for each in (fresh_kb, first))  # noqa: B023
    assert ours == theirs
    assert theirs[0] == "InvalidKnowledgeError"
    assert "cannot express the number 4.9" in theirs[1]


# Few digits, many, without an end, without a value at first, and the same number spelled otherwise.
NUMBERS = """(define (domain numbers) (:requirements :fluents)
  (:functions (a) (b) (c) (e) (total-cost))
  (:action add :parameters () :precondition (< (* (a) (a)) 1000000) :effect (and
    (increase (a) (- (* (b) 1.25) 3)) (decrease (b) (/ (a) 4)) (increase (total-cost) 0.50)))
  (:action third :parameters () :effect (and (assign (a) (/ (- (a)) 3)) (increase (b) (/ 1 3))))
  (:action scale :parameters () :effect (and
    (scale-up (a) 12345678901234567890.10) (scale-down (b) 0.5) (increase (e) 0)))
  (:action spell :parameters () :effect (and (assign (e) 7) (assign (a) (+ (a) 0.000))))
  (:action make :parameters () :effect (assign (c) (+ (a) (b))))
  (:action use :parameters () :precondition (>= (c) (- 1000)) :effect (increase (e) (c)))
  (:action swap :parameters () :effect (and (assign (b) (e)) (assign (e) (b)))))"""


def test_states_calculate_and_write_numbers_as_the_store(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain(NUMBERS)
    for name, value in (("a", "5.20"), ("b", "7"), ("e", "7.0")):
        fresh_kb.function_values.set(name, value=Decimal(value))
    random, found = Random(1), fresh_kb.state()
    names = ["add", "third", "scale", "spell", "make", "use", "swap"]
    for name in ["use", "make", *random.choices(names, k=25)]:
        listed = [step.action for step in found.applicable_actions()]
        assert listed == [step.action for step in fresh_kb.applicable_actions()]
        after, theirs = (result(lambda: one.apply(f"({name})")) for one in (found, fresh_kb))  # noqa: B023
        assert isinstance(after, KnowledgeState) == (name in listed), (after, theirs)
        found = after if isinstance(after, KnowledgeState) else found
        again = fresh_kb.state()
        new = {(each.kind, each.text) for each in found.difference() if each.sign == "+"}
        assert new <= lines(fresh_kb)
        assert (found, hash(found)) == (again, hash(again))


def test_states_refuse_undefined_effects_in_the_words_of_the_store(
    fresh_kb: KnowledgeBase,
) -> None:
    loaded(
        fresh_kb,
        """(define (domain d) (:requirements :typing :fluents :object-fluents) (:types room)
          (:predicates (lit ?r - room)) (:functions (f) (g) (zero) (of ?r - room) - number
            (best) - room)
          (:action a :parameters (?r - room) :effect (increase (of ?r) 1))
          (:action b :parameters (?r - room) :effect (assign (of ?r) (/ 1 (f))))
          (:action c :parameters () :effect (lit (best)))
          (:action e :parameters () :effect (assign (of (best)) 3))
          (:action h :parameters () :effect (scale-down (g) (zero))))""",
        """(define (problem p) (:domain d) (:objects hall - room)
          (:init (= (g) 1) (= (zero) 0)) (:goal (and)))""",
    )
    for step in ("(a hall)", "(b hall)", "(c)", "(e)", "(h)"):
        with pytest.raises(NotApplicableError) as stored:
            fresh_kb.apply(step)
        with pytest.raises(NotApplicableError) as found:
            fresh_kb.state().apply(step)
        assert str(found.value) == str(stored.value)


def test_states_of_other_histories_are_refused_by_what_they_are(home: KnowledgeBase) -> None:
    state = home.state()
    moved = state.apply("(move hall lab)")
    first = home.revision
    other = beside(home, "elsewhere")
    loaded(other, DOMAIN, PROBLEM)
    for refused in (other.state(), other.state().apply("(move hall lab)")):
        with pytest.raises(InvalidArgumentError, match="of another knowledge base: 'elsewhere'"):
            home.commit(refused)
    with pytest.raises(InvalidArgumentError, match="the state is of the past"):
        home.commit(home.at(first).state())
    with pytest.raises(ReadOnlyError, match="past cannot be changed"):
        home.at(first).commit(moved)
    with home.transaction():
        for refused_call in (home.state, lambda: home.commit(moved)):
            with pytest.raises(ReadOnlyError, match="has a transaction open"):
                refused_call()
        assert home.at(first).state() == state
    with pytest.raises(InvalidArgumentError, match="KnowledgeState"):
        home.commit("(at lab)")  # type: ignore[arg-type]
    with home.transaction(actor="nurse", reason="rounds"):
        home.propositions.save("(lit)")
    with pytest.raises(StaleRevisionError) as stale:
        home.commit(moved)
    assert (stale.value.expected, stale.value.actual) == (first, first + 1)
    assert re.search(rf"after it came revision {first + 1} \(.*, nurse, rounds\)", str(stale.value))
    assert home.holds("(at hall)")


def test_states_are_values(home: KnowledgeBase) -> None:
    state = home.state()
    there = state.apply("(move hall lab)")
    assert (state == home.state(), state == there, state == "") == (True, False, False)
    home.function_values.set("battery", objects=[], value=Decimal("7.0"))
    home.propositions.save("(lit)")
    assert home.state().difference(state) == [kant_sql.Change("+", "fact", "(lit)")]
    home.objects.save("cellar - place")
    home.propositions.save("(door hall cellar)")
    assert home.state() != state
    changes = home.state().difference(state)
    assert [str(each.text) for each in changes] == ["(door hall cellar)", "(lit)"]
    assert home.at(state.revision).state() == state
    assert "9 facts" not in repr(state)
    assert repr(state).endswith("from revision 1: 4 facts, 4 values>")
    with pytest.raises(InvalidArgumentError, match="not asked with SQL"):
        _ = state.query("(at ?p)").sql


def test_threads_share_states(home: KnowledgeBase) -> None:
    state = home.state()
    steps = ["(move hall lab)", "(charge hall) [2]", "(charge hall) [3]"]
    wanted = [(str(state.apply(step).difference()), state.holds("(near attic)")) for step in steps]
    wrong: list[object] = []

    def work() -> None:
        for number in range(40):
            step = steps[number % 3]
            after = state.apply(step)
            if (str(after.difference()), after.holds("(near attic)")) != wanted[number % 3]:
                wrong.append(step)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not wrong


def test_unsupported_actions_are_refused_by_name(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain quadratic) (:requirements :durative-actions :fluents)
      (:functions (speed) (way))
      (:durative-action run :parameters () :duration (= ?duration 1)
        :effect (and (increase (speed) #t) (increase (way) (* #t (speed))))))""")
    state = fresh_kb.state()
    assert state.applicable_actions() == [*fresh_kb.applicable_actions()] == []
    with pytest.raises(UnsupportedConstructError, match="run changes way"):
        state.apply("(run)")


def test_an_empty_knowledge_base_has_a_state(fresh_kb: KnowledgeBase) -> None:
    state = fresh_kb.state()
    assert (state.revision, state.applicable_actions(), state.goal_reached()) == (0, [], True)
    assert fresh_kb.commit(state) is None


def test_a_state_is_its_own_copy(kb: KnowledgeBase) -> None:
    state = kb.state()
    assert copy.deepcopy([state]) == [state]
