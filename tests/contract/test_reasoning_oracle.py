"""What is asked and done has the results of a plain evaluator, on every backend.

KANT_SQL_TEST_EXAMPLES=5000 hunts for longer, each time from another seed.
"""

from __future__ import annotations

import contextlib
import itertools
import re
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from random import Random
from typing import Any

import pytest
from hypothesis import given

from kant_sql import (
    Answers,
    KnowledgeBase,
    NotApplicableError,
    PddlObjectDto,
    Plan,
    PlanStep,
    UnsupportedConstructError,
)
from kant_sql.dto.formulas import And, variables_text
from kant_sql.dto.formulas import walk as nodes_of
from kant_sql.dto.lexical import fold
from kant_sql.errors import TypeMismatchError
from kant_sql.pddl import write
from kant_sql.pddl.document import DURATIVE_ACTION, Action
from kant_sql.sql import condition_writer
from tests.support.evaluator import (
    Bindings,
    Evaluator,
    Ground,
    State,
    UndefinedEffectError,
    is_continuous,
)
from tests.support.generators.episodes import EPISODES, Episode, Question, episode, free_variables
from tests.support.profile import PROFILE, hunting
from tests.support.reading import beside, loaded, undone

_numbers = itertools.count(1)
# So many assignments of a question's variables are asked one by one.
ASSIGNED = 3


def opened(kb: KnowledgeBase, episode: Episode) -> KnowledgeBase:
    """A knowledge base of its own with the initial state."""
    new = beside(kb, f"episode {next(_numbers)}")
    with new.transaction():
        loaded(new, write(episode.domain), write(episode.problem))
    return new


def state_in(kb: KnowledgeBase) -> tuple[frozenset[Ground], dict[Ground, Fraction | str]]:
    """The stored facts and values."""
    facts = frozenset(
        (fold(dto.predicate.name), *(fold(each.name) for each in dto.objects))
        for dto in kb.propositions.get_all()
    )
    values: dict[Ground, Fraction | str] = {}
    for dto in kb.function_values.get_all():
        key = (fold(dto.function.name), *(fold(each.name) for each in dto.objects))
        is_object = isinstance(dto.value, PddlObjectDto)
        values[key] = fold(dto.value.name) if is_object else Fraction(dto.value)  # type: ignore[union-attr, arg-type]
    return facts, values


def is_same(found: Fraction | str, wanted: Fraction | str) -> bool:
    """Whether a value is exact, or rounded where no decimal is."""
    if isinstance(found, str) or isinstance(wanted, str) or found == wanted:
        return found == wanted
    return abs(found - wanted) <= abs(wanted) * Fraction(1, 10**25)


def folded(rows: Any) -> list[tuple[str, ...]]:
    return [tuple(map(fold, row)) for row in rows]


def is_refused(act: Callable[[str], object], step: str) -> bool:
    """Whether a step cannot be executed."""
    try:
        act(step)
    except NotApplicableError:
        return True
    return False


def ranges_of(
    plain: Evaluator, free: dict[str, list[tuple[str, ...]]], names: list[str]
) -> list[list[str]]:
    """The objects that fit all places of each of some variables."""
    return [
        [
            object_
            for object_, types in plain.state.objects.items()
            if all(plain.theory.fits(types, wanted) for wanted in free[name])
        ]
        for name in names
    ]


class Judge:
    """Compares what a view of a knowledge base answers with what holds in a state."""

    def __init__(self, view: KnowledgeBase, episode: Episode, state: State, when: str) -> None:
        self.view, self.episode, self.when = view, episode, when
        self.plain = Evaluator(episode.theory, state)

    def check(self) -> None:
        for number, question in enumerate(self.episode.questions):
            about = f"episode({self.episode.seed}), {self.when}: {question}"
            # Nodes and text in turn.
            asked = question.formula if number % 2 else str(question.formula)
            self.declared(question, asked, about)
            self.undeclared(question, asked, about)
            self.one_by_one(question, asked, about)

    def declared(self, question: Question, asked: Any, about: str) -> None:
        """The free variables have declared types, and some are bound."""
        given: dict[str, Any] = {**question.fixed}
        parameters = f"({variables_text(question.columns)})"
        answers = self.view.query(asked, parameters=parameters, **given)
        fixed = {name: fold(value) for name, value in question.fixed.items()}
        wanted = self.plain.answers(question.formula, question.free, fixed)
        assert [*map(fold, answers.columns)] == [fold(part.name) for part in question.free], about
        if self.when != "pending":
            self.same_statement(answers, wanted, about)
        assert folded(answers) == wanted, about
        assert len(answers) == len(wanted), about

    def same_statement(self, answers: Answers, wanted: list[tuple[str, ...]], about: str) -> None:
        """The statement that can be pasted elsewhere finds the same."""
        store: Any = self.view.store.factory._store  # type: ignore[attr-defined]
        with store.backend.engine.connect() as connection:
            driver = connection.connection.driver_connection
            found = driver.execute(answers.sql).fetchall()
            connection.rollback()
        if answers.columns:
            assert folded(found) == wanted, about
        else:
            assert found == [(len(wanted),)], about

    def undeclared(self, question: Question, asked: Any, about: str) -> None:
        """A free variable has the types that its atoms allow."""
        free = free_variables(self.episode.domain, question.formula)
        fixed: dict[str, Any] = {
            name: value for name, value in question.fixed.items() if name in free
        }
        names = [name for name in free if name not in fixed]
        ranges = ranges_of(self.plain, free, names)
        try:
            answers = self.view.query(asked, **fixed)
        except TypeMismatchError:
            # No object can be in all places of a variable.
            assert [] in ranges or fixed, about
            return
        given = {name: fold(value) for name, value in fixed.items()}
        wanted = [
            objects
            for objects in itertools.product(*ranges)
            if self.plain.holds(
                question.formula, {**given, **dict(zip(names, objects, strict=True))}
            )
        ]
        assert [*map(fold, answers.columns)] == names, about
        assert folded(answers) == wanted, about

    def one_by_one(self, question: Question, asked: Any, about: str) -> None:
        """All free variables are bound."""
        free = free_variables(self.episode.domain, question.formula)
        every = [*self.plain.bindings(question.columns)]
        for bound in Random(self.episode.seed).sample(every, min(len(every), ASSIGNED)):
            given = {name: object_ for name, object_ in bound.items() if name in free}
            wanted = self.plain.holds(question.formula, bound)
            if not self.can_be(bound, free):
                continue
            assert self.view.holds(asked, **given) is wanted, f"{about} {bound}"
            assert (self.view.unsatisfied(asked, **given) == []) is wanted, f"{about} {bound}"

    def can_be(self, bound: Bindings, free: dict[str, list[tuple[str, ...]]]) -> bool:
        """Whether objects fit all places of their variables."""
        types = self.plain.state.objects
        fits = self.plain.theory.fits
        return all(fits(types[bound[name]], one) for name in free for one in free[name])

    def acts(self) -> None:
        """Steps are applicable, and have the effects, that they have in the state."""
        kb, actions = self.view, self.episode.domain.actions
        wanted = [
            (fold(action.name), *bound.values())
            for action in actions
            for bound in self.plain.bindings(action.parameters)
            if self.plain.begun(action, tuple(bound.values())) and self.can_follow(action)
        ]
        found = [(step.action, *step.arguments) for step in kb.applicable_actions()]
        about = f"episode({self.episode.seed}), {self.when}"
        assert folded(found) == wanted, about
        random = Random(self.episode.seed)
        for action in actions:
            every = [tuple(bound.values()) for bound in self.plain.bindings(action.parameters)]
            for arguments in random.sample(every, min(len(every), ASSIGNED)):
                for lasts in (None, random.randint(0, 9)) if action.duration else (None,):
                    self.act(action, arguments, lasts)

    def can_follow(self, action: Action) -> bool:
        """Whether continuous change, if any, can be executed; else all say so by its name."""
        if not any(map(is_continuous, nodes_of(*action.effect))):
            return True
        arguments = next(self.plain.bindings(action.parameters), None)
        if arguments is None:
            return True
        step = f"({' '.join((action.name, *arguments.values()))}) [5]"
        try:
            self.view.why_not(step)
        except UnsupportedConstructError as error:
            for refused in (self.view.start, self.view.apply):
                with pytest.raises(UnsupportedConstructError, match=re.escape(str(error))):
                    refused(step)
            return False
        return True

    def act(self, action: Action, arguments: tuple[str, ...], lasts: int | None) -> None:
        kb, step = self.view, f"({' '.join((action.name, *arguments))})"
        step += "" if lasts is None else f" [{lasts}]"
        about = f"episode({self.episode.seed}), {self.when}: {step}"
        if not self.can_follow(action):
            return
        here = self.plain.begun(action, arguments, None if lasts is None else Fraction(lasts))
        is_applicable = here is not None
        assert (kb.why_not(step) == []) is is_applicable, about
        before = state_in(kb)
        after = None
        if here is not None:
            after = here.ended(action, arguments) if action.duration else here.state
        if after is None:
            assert is_refused(kb.apply, step), about
            assert state_in(kb) == before, about
            return
        with undone(kb):
            kb.apply(step)
            self.is_in(after, about)
        assert state_in(kb) == before, about

    def lasts(self) -> None:
        """Durative steps start and end as they do in the state."""
        random = Random(self.episode.seed)
        for action in self.episode.domain.actions:
            every = [tuple(bound.values()) for bound in self.plain.bindings(action.parameters)]
            if action.kind == DURATIVE_ACTION:
                for arguments in random.sample(every, min(len(every), ASSIGNED)):
                    with undone(self.view):
                        self.last(action, arguments)

    def last(self, action: Action, arguments: tuple[str, ...]) -> None:
        kb, step = self.view, f"({' '.join((action.name, *arguments))})"
        about = f"episode({self.episode.seed}): {step}"
        if not self.can_follow(action):
            return
        here = self.plain.begun(action, arguments)
        assert is_refused(kb.start, step) is (here is None), about
        if here is None:
            return
        self.is_in(here.state, about)
        after = here.ended(action, arguments)
        assert is_refused(kb.end, step) is (after is None), about
        self.is_in(here.state if after is None else after, about)

    def is_in(self, state: State, about: str) -> None:
        facts, values = state_in(self.view)
        assert facts == state.facts, about
        assert values.keys() == state.values.keys(), about
        for fluent, value in state.values.items():
            assert is_same(values[fluent], value), f"{about}: {fluent}"


def test_answers_are_those_of_the_plain_evaluator(fresh_kb: KnowledgeBase) -> None:
    @hunting(PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        first, second = episode.changes
        kb = opened(fresh_kb, episode)
        states = [episode.first]
        Judge(kb, episode, states[0], "present").check()
        with kb.transaction():
            first.make(kb)
            states.append(first.of(states[0]))
            Judge(kb, episode, states[1], "pending").check()
        revisions = [1, kb.revision]
        second.make(kb)
        states.append(second.of(states[1]))
        Judge(kb, episode, states[2], "present again").check()
        for revision, state in zip(revisions, states, strict=False):
            Judge(kb.at(revision), episode, state, "past").check()

    same()


@pytest.mark.parametrize("weight", [0, 10**9], ids=["looked up", "read"])
@pytest.mark.more
def test_the_past_has_the_same_answers_looked_up_and_read(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, weight: int
) -> None:
    monkeypatch.setattr(condition_writer, "LOOKED_UP", weight)

    @hunting(PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        kb = opened(fresh_kb, episode)
        episode.changes[0].make(kb)
        Judge(kb.at(1), episode, episode.first, "past").check()
        second = episode.changes[0].of(episode.first)
        Judge(kb.at(kb.revision), episode, second, "past").check()

    same()


@pytest.mark.more
def test_steps_are_those_of_the_plain_evaluator(fresh_kb: KnowledgeBase) -> None:
    @hunting(PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        kb = opened(fresh_kb, episode)
        judge = Judge(kb, episode, episode.first, "present")
        judge.acts()
        judge.lasts()
        with kb.transaction():
            episode.changes[0].make(kb)
            Judge(kb, episode, episode.changes[0].of(episode.first), "pending").acts()

    same()


def test_statements_fit_the_stack_of_a_parser(fresh_kb: KnowledgeBase) -> None:
    drawn = episode(434)
    kb = opened(fresh_kb, drawn)
    drawn.changes[0].make(kb)
    assert [*kb.applicable_actions()] == kb.state().applicable_actions()


@pytest.mark.more
def test_deep_statements_have_the_same_answers(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part that is nested too deep for the parser of SQLite becomes a table of its own."""
    store: Any = fresh_kb.store.factory._store  # type: ignore[attr-defined]
    kind = type(store.backend)
    monkeypatch.setattr(kind, "words", kind.words._replace(levels=10))

    @hunting(PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        kb = opened(fresh_kb, episode)
        Judge(kb, episode, episode.first, "present").check()
        Judge(kb.at(kb.revision), episode, episode.first, "past").check()

    same()


def is_moderate(value: Fraction | str) -> bool:
    """Whether a value, even multiplied by itself, has not too many digits to be stored."""
    digits = 10**60
    return not value or isinstance(value, str) or Fraction(1, digits) < abs(value) < digits


def walk(episode: Episode, steps: int) -> Iterator[tuple[Action, tuple[str, ...], State]]:
    """Random steps from the initial state, each with the state after it."""
    random, state = Random(episode.seed), episode.first
    for _ in range(steps):
        if not all(map(is_moderate, state.values.values())):
            return
        here = Evaluator(episode.theory, state)
        possible = [
            (action, arguments)
            for action in episode.domain.actions
            if action.kind != DURATIVE_ACTION
            for arguments in here.applicable(action)
        ]
        for action, arguments in random.sample(possible, min(5, len(possible))):
            with contextlib.suppress(UndefinedEffectError):
                state = here.apply(action, arguments)
                yield action, arguments, state
                break


def test_walks_are_those_of_the_plain_evaluator(fresh_kb: KnowledgeBase) -> None:
    @hunting(2 * PROFILE.episodes)
    @given(EPISODES)
    def same(episode: Episode) -> None:
        kb = opened(fresh_kb, episode)
        begun, goal = kb.revision, And(episode.problem.goal)
        steps: list[PlanStep] = []
        state = episode.first
        for number, (action, arguments, after) in enumerate(walk(episode, 5)):
            step = PlanStep(Decimal(number), action.name, arguments)
            before, revision = state, kb.revision
            made = kb.apply(step)
            steps.append(step)
            state = after
            about = f"episode({episode.seed}): {steps}"
            Judge(kb, episode, after, "").is_in(after, about)
            assert (made is None) is (kb.revision == revision), about
            Judge(kb.at(revision), episode, before, "").is_in(before, about)
        holds = Evaluator(episode.theory, state).holds(goal, {})
        assert (kb.unsatisfied() == []) is holds
        verdict = kb.validate(Plan(tuple(steps), "walk", "found"), at=begun)
        if "two effects of the action change it" in str(verdict):
            # As VAL has it; a step that assigns the same value twice can be applied.
            return
        assert verdict.failed_step is None, f"episode({episode.seed}): {verdict}"
        assert verdict.is_goal_reached is holds, f"episode({episode.seed}): {verdict}"

    same()
