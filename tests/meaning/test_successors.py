"""What is applicable, and the state after it, is the same as in other tools, along random walks.

By default a few pairs; KANT_SQL_TEST_PROFILE=long takes every pair of the competitions through
each tool that reads it. The counts are printed (`pytest -rP`).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from math import prod
from pathlib import Path
from random import Random

import pytest

import kant_sql
from kant_sql import KnowledgeBase, NotApplicableError, PlanStep
from kant_sql.dto.lexical import fold
from kant_sql.pddl.document import Action
from tests.meaning.others import need
from tests.meaning.successors import (
    MIMIR,
    PYPERPLAN,
    UNIFIED_PLANNING,
    Look,
    Plain,
    is_near,
    looks,
    plain,
)
from tests.support.corpus import PAIRS, Pair, needs_corpus
from tests.support.evaluator import Evaluator, Ground, State, UndefinedEffectError
from tests.support.generators.episodes import state_of, theory_of
from tests.support.profile import PROFILE
from tests.support.reading import beside

STEPS = 50 if PROFILE.is_whole else 12
PLAIN_STEPS = 10 if PROFILE.is_whole else 3
# How long a tool may walk; what it has printed by then is compared.
SECONDS = 120.0 if PROFILE.is_whole else 20.0
# The same for the tool that enumerates all groundings.
ENUMERATED = 30.0 if PROFILE.is_whole else 10.0
# A pair of each kind: types or none, numbers, conditional effects, quantifiers, derived
# predicates, `either`, preferences, durative actions.
SAMPLE = (
    "ipc1998-gripper-round-1-strips",
    "ipc2000-blocks-strips-typed",
    "ipc2000-elevator-adl-full-typed",
    "ipc2002-depots-numeric",
    "ipc2002-zenotravel-strips",
    "ipc2004-psr-middle-derived-predicates-adl",
    "ipc2006-openstacks-preferences-simple",
    "ipc2006-openstacks-time/",
)
CHOSEN = [pair for pair in PAIRS if PROFILE.is_whole or pair.name.startswith(SAMPLE)]
# The plain evaluator goes through all objects for each parameter.
GROUNDINGS = 20_000
# What pyperplan refuses, or does not tell from something else.
NOT_STRIPS = frozenset(
    {"conditional-eff", "disjunctive", "neg-precond", "quantifiers", "either", "derived"}
    | {"functions", "numeric", "durative", "preferences", "traj-constraints"}
)
_numbers = itertools.count(1)


@pytest.fixture(scope="module")
def first_kb() -> Iterator[KnowledgeBase]:
    with kant_sql.connect("sqlite://") as kb:
        yield kb


def applicable(kb: KnowledgeBase | kant_sql.KnowledgeState) -> frozenset[Ground]:
    """The applicable actions, each once."""
    steps = [(fold(step.action), *map(fold, step.arguments)) for step in kb.applicable_actions()]
    assert len(steps) == len(set(steps))
    return frozenset(steps)


def facts(kb: KnowledgeBase, changed: frozenset[tuple[str, int]]) -> frozenset[Ground]:
    """The facts of what actions change."""
    return frozenset(
        (fold(dto.predicate.name), *(fold(each.name) for each in dto.objects))
        for dto in kb.propositions.get_all()
        if (fold(dto.predicate.name), len(dto.objects)) in changed
    )


def numbers(kb: KnowledgeBase) -> dict[Ground, Decimal]:
    """The values of numeric fluents."""
    return {
        (fold(dto.function.name), *(fold(each.name) for each in dto.objects)): Decimal(dto.value)
        for dto in kb.function_values.get_all()
        if not isinstance(dto.value, kant_sql.PddlObjectDto)
    }


def loaded(kb: KnowledgeBase, pair: Pair) -> KnowledgeBase:
    """A knowledge base of its own with a pair."""
    new = beside(kb, f"pair {next(_numbers)}")
    with new.transaction():
        new.load_domain(pair.domain)
        new.load_problem(pair.problem)
    return new


class Replay:
    """Goes along walks with a knowledge base and a state in memory, and compares each state."""

    def __init__(self, kb: KnowledgeBase, pair: Pair, judge: Plain) -> None:
        self.kb, self.judge = loaded(kb, pair), judge
        self.is_durative = any(action.durative for action in self.kb.actions.get_all())
        self.theory = theory_of(judge.domain)
        self.actions = {fold(action.name): action for action in judge.domain.actions}
        self.counts: Counter[str] = Counter()
        self.memory = self.kb.state()

    def go(self, walk: list[Look]) -> None:
        for number, look in enumerate(walk):
            if self.is_durative:
                self.set(look)
                self.memory = self.kb.state()
            ours = facts(self.kb, self.judge.changed)
            assert ours == look.facts, f"state {number}: {sorted(ours ^ look.facts)[:5]}"
            values = numbers(self.kb)
            for fluent, value in look.values.items():
                assert is_near(values[fluent], value), f"state {number}: {fluent}"
            self.same_actions(look, f"state {number}")
            self.counts["states"] += 1
            if look.taken is None or self.is_durative:
                continue
            step = PlanStep(None, look.taken[0], look.taken[1:])
            try:
                self.kb.apply(step)
            except NotApplicableError:
                with pytest.raises(NotApplicableError):
                    self.memory.apply(step)
                # unified-planning takes numbers without a value for 0.
                assert not self.has_values(look.taken), f"state {number}: {look.taken}"
                return
            self.memory = self.memory.apply(step)
            assert self.memory == self.kb.state(), f"state {number}: {look.taken}"
            self.counts["applied"] += 1

    def has_values(self, step: Ground) -> bool:
        """Whether all effects of a step have values."""
        return is_defined(Evaluator(self.theory, self.state()), self.actions[step[0]], step)

    def same_actions(self, look: Look, when: str) -> None:
        found = applicable(self.kb)
        assert applicable(self.memory) == found, when
        missing = look.applicable - found
        assert not missing, f"{when}: only theirs: {sorted(missing)[:3]} of {len(missing)}"
        # Other tools leave out an action whose effect has no value.
        here = Evaluator(self.theory, self.state()) if found - look.applicable else None
        for step in sorted(found - look.applicable):
            assert here is not None
            assert not is_defined(here, self.actions[step[0]], step), f"{when}: only ours: {step}"
        self.counts["actions"] += len(found)

    def state(self) -> State:
        """The state, as the plain evaluator has it."""
        first = state_of(self.judge.domain, self.judge.problem)
        every = frozenset((name, n) for name, n in self._every_predicate())
        values = {**first.values, **{key: Fraction(n) for key, n in numbers(self.kb).items()}}
        return State(first.objects, facts(self.kb, every), values)

    def _every_predicate(self) -> Iterator[tuple[str, int]]:
        for predicate in self.judge.domain.predicates:
            yield fold(predicate.name), len(predicate.parameters)

    def set(self, look: Look) -> None:
        """Make a state: what is applied to a durative action is its two halves."""
        kb = self.kb
        ours = facts(kb, self.judge.changed)
        with kb.transaction():
            for fact in sorted(ours ^ look.facts):
                change = kb.propositions.delete if fact in ours else kb.propositions.save
                change(f"({' '.join(fact)})")
            for fluent, value in look.values.items():
                kb.function_values.set(fluent[0], objects=fluent[1:], value=value)


def is_defined(here: Evaluator, action: Action, step: Ground) -> bool:
    """Whether all effects of a step have values."""
    try:
        here.apply(action, step[1:])
    except UndefinedEffectError:
        return False
    return True


def plain_walk(pair: Plain, steps: int) -> list[Look]:
    """A walk of the plain evaluator; none where it would take too long."""
    random, state = Random(1), state_of(pair.domain, pair.problem)
    theory = theory_of(pair.domain)
    actions = {fold(action.name): action for action in pair.domain.actions}
    found: list[Look] = []
    for number in range(steps + 1):
        here = Evaluator(theory, state)
        if any(groundings(here, action) > GROUNDINGS for action in actions.values()):
            return []
        possible = {
            (name, *arguments)
            for name, action in actions.items()
            for arguments in here.applicable(action)
        }
        taken, after = _chosen(here, actions, random.sample(sorted(possible), len(possible)))
        if number == steps:
            taken = None
        changed = frozenset(f for f in state.facts if (f[0], len(f) - 1) in pair.changed)
        values = {key: float(n) for key, n in state.values.items() if isinstance(n, Fraction)}
        found.append(Look(changed, values, frozenset(possible), taken))
        if taken is None:
            break
        state = after
    return found


def _chosen(
    here: Evaluator, actions: dict[str, Action], possible: list[Ground]
) -> tuple[Ground | None, State]:
    """The first action whose effect has a value, and the state after it."""
    for step in possible:
        if is_defined(here, actions[step[0]], step):
            return step, here.apply(actions[step[0]], step[1:])
    return None, here.state


def groundings(here: Evaluator, action: Action) -> int:
    """How many combinations of arguments an action has."""
    return prod(len(here.range(parameter.types)) for parameter in action.parameters)


def judged(
    kb: KnowledgeBase,
    pairs: list[Pair],
    folder: Path,
    walk: Callable[[Plain], tuple[list[Look], str]],
) -> Counter[str]:
    """Go along a walk in each pair; the pairs in which all is the same are counted."""
    counts: Counter[str] = Counter()
    wrong = []
    for number, pair in enumerate(pairs):
        own = folder / str(number)
        own.mkdir()
        judge = plain(pair, own)
        states, ended = walk(judge)
        if not states:
            print(f"{pair.name}: not judged: {ended[-200:]}")
            continue
        replay = Replay(kb, pair, judge)
        try:
            replay.go(states)
        except (AssertionError, kant_sql.KantSqlError) as error:
            wrong.append(f"{pair.name}: {error}")
        counts += replay.counts
        counts["pairs"] += 1
    print(dict(counts))
    assert not wrong, "\n".join(wrong)
    return counts


@needs_corpus
def test_pymimir_has_the_same_successors(first_kb: KnowledgeBase, tmp_path: Path) -> None:
    need(MIMIR)
    counts = judged(first_kb, CHOSEN, tmp_path, lambda pair: looks(MIMIR, pair, STEPS, SECONDS))
    assert counts["pairs"] >= (110 if PROFILE.is_whole else len(SAMPLE))


@needs_corpus
def test_pyperplan_has_the_same_successors(first_kb: KnowledgeBase, tmp_path: Path) -> None:
    need(PYPERPLAN)
    chosen = [pair for pair in CHOSEN if not pair.features & NOT_STRIPS]
    counts = judged(first_kb, chosen, tmp_path, lambda pair: looks(PYPERPLAN, pair, STEPS, SECONDS))
    assert counts["pairs"] >= (8 if PROFILE.is_whole else 2)


@needs_corpus
def test_unified_planning_has_the_same_successors(first_kb: KnowledgeBase, tmp_path: Path) -> None:
    need(UNIFIED_PLANNING)
    chosen = CHOSEN if PROFILE.is_whole else CHOSEN[:2]
    counts = judged(
        first_kb, chosen, tmp_path, lambda pair: looks(UNIFIED_PLANNING, pair, STEPS, ENUMERATED)
    )
    assert counts["pairs"] >= (20 if PROFILE.is_whole else 2)


@needs_corpus
def test_the_plain_evaluator_has_the_same_successors(
    first_kb: KnowledgeBase, tmp_path: Path
) -> None:
    counts = judged(
        first_kb, CHOSEN, tmp_path, lambda pair: (plain_walk(pair, PLAIN_STEPS), "too large")
    )
    assert counts["pairs"] >= (100 if PROFILE.is_whole else 4)
