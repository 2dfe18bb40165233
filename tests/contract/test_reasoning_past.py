"""When a condition held, by a plain evaluator of each revision's state, on every backend.

KANT_SQL_TEST_EXAMPLES=5000 hunts for longer, each time from another seed.
"""

from __future__ import annotations

import itertools
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import KnowledgeBase, PddlObjectDto, PddlTypeDto
from kant_sql.dto.formulas import Constant, Node, variables_text, walk
from kant_sql.dto.lexical import fold
from kant_sql.pddl import write
from tests.contract.test_reasoning_oracle import ranges_of
from tests.support.evaluator import Evaluator
from tests.support.generators.episodes import (
    Episode,
    Question,
    episode,
    free_variables,
    state_of,
    theory_of,
)
from tests.support.profile import PROFILE, hunting
from tests.support.reading import beside, loaded

_numbers = itertools.count(1)
REVISIONS = 7
Period = tuple[tuple[str, ...], int | None, int | None]


def recorded(kb: KnowledgeBase, told: Episode) -> KnowledgeBase:
    """A knowledge base with a revision for each state; objects come and go in some of them."""
    new = beside(kb, f"past {next(_numbers)}")
    random = Random(told.seed)
    with new.transaction():
        loaded(new, write(told.domain), write(told.problem))
    for number, change in enumerate(told.changes):
        with new.transaction():
            change.make(new)
            if random.random() < 0.3:
                types = [type_.name for type_ in told.domain.types] or ["object"]
                new.objects.save(PddlObjectDto(PddlTypeDto(random.choice(types)), f"new{number}"))
        if random.random() < 0.2:
            doomed = [each.name for each in told.problem.objects]
            gone = new.objects.get(random.choice(doomed)) if doomed else None
            if gone is not None:
                new.objects.delete(gone)
    return new


class Judge:
    """Compares periods with the states of all revisions, evaluated one by one."""

    def __init__(self, kb: KnowledgeBase, told: Episode) -> None:
        self.kb, self.told = kb, told
        self.states = []
        for number in range(1, kb.revision + 1):
            past = kb.at(number)
            domain, problem = past.pddl.domain(), past.pddl.problem()
            self.states.append(Evaluator(theory_of(domain), state_of(domain, problem)))

    def check(self) -> int:
        """Compare all questions; return how many periods there were."""
        count = 0
        for number, question in enumerate(self.told.questions):
            asked = question.formula if number % 2 else str(question.formula)
            count += self.declared(question, asked) + self.undeclared(question, asked)
        return count

    def declared(self, question: Question, asked: Any) -> int:
        """The free variables have declared types, and some are bound."""
        fixed = {name: fold(value) for name, value in question.fixed.items()}
        rows = [
            {*state.answers(question.formula, question.free, fixed)}
            if self.has_names(state, question.formula, fixed.values())
            else set()
            for state in self.states
        ]
        options = {"parameters": f"({variables_text(question.columns)})", **question.fixed}
        return self.compare(rows, asked, options, question)

    def undeclared(self, question: Question, asked: Any) -> int:
        """A free variable has the types that its atoms allow."""
        free = free_variables(self.told.domain, question.formula)
        fixed = {name: value for name, value in question.fixed.items() if name in free}
        names = [name for name in free if name not in fixed]
        given = {name: fold(value) for name, value in fixed.items()}
        rows: list[set[tuple[str, ...]]] = []
        for state in self.states:
            known = self.has_names(state, question.formula, given.values())
            every = itertools.product(*ranges_of(state, free, names)) if known else ()
            bound = {each: given | dict(zip(names, each, strict=True)) for each in every}
            rows.append({each for each in bound if state.holds(question.formula, bound[each])})
        return self.compare(rows, asked, fixed, question)

    @staticmethod
    def has_names(state: Evaluator, formula: Node, objects: Any) -> bool:
        """Whether all objects that a condition names are there."""
        named = {fold(node.name) for node in walk(formula) if isinstance(node, Constant)}
        return named | {*objects} <= state.state.objects.keys()

    def compare(
        self, rows: list[set[tuple[str, ...]]], asked: Any, options: Any, question: Question
    ) -> int:
        last = self.kb.revision
        found = 0
        for low, high in ((1, last), (2, max(2, last - 1)), (last, last)):
            if high > last:
                continue
            periods = self.kb.when(asked, since=low, until=high, **options)
            got = [
                (
                    tuple(map(fold, held.binding.values())),
                    held.since and held.since.number,
                    held.until and held.until.number,
                )
                for held in periods
            ]
            wanted = expected(rows, low, high)
            about = f"episode({self.told.seed}, {REVISIONS}) {low}-{high}: {question} {options}"
            assert sorted(got, key=str) == sorted(wanted, key=str), about
            # They come in the order of their beginnings.
            begins = [since or 0 for _, since, _ in got]
            assert begins == sorted(begins), about
            found += len(got)
        return found


def expected(rows: list[set[tuple[str, ...]]], low: int, high: int) -> list[Period]:
    """The periods of a range, from the answers of each revision."""
    found: list[Period] = []
    since: dict[tuple[str, ...], int | None] = {}
    before = rows[low - 2] if low > 1 else set[tuple[str, ...]]()
    for number in range(low, high + 1):
        now = rows[number - 1]
        found += [(one, since.pop(one), number) for one in [*since] if one not in now]
        for one in now:
            since.setdefault(one, None if number == low and one in before else number)
    return found + [(one, begin, None) for one, begin in since.items()]


@pytest.mark.more
def test_periods_are_those_of_the_plain_evaluator(fresh_kb: KnowledgeBase) -> None:
    counts: list[int] = []

    @hunting(PROFILE.episodes)
    @given(st.integers(0, 2**32 - 1))
    def same(seed: int) -> None:
        told = episode(seed, REVISIONS)
        counts.append(Judge(recorded(fresh_kb, told), told).check())

    same()
    assert sum(counts) > 10 * len(counts)
