"""What a condition uses, judged by changing the state and evaluating it again, plainly.

- Complete: if changing one fact or value makes a condition fail that held, it is used.
- Sufficient: any state with the same used literals satisfies the condition.
- Minimal: where a formula has facts alone, of predicates that are neither derived nor mentioned
  twice, each used literal is in a smallest set of literals by which the condition holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, islice, product
from random import Random

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.knowledge.resolved import Resolver
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.reasoning.derived import read_world
from kant_sql.reasoning.uses import Literal, Uses
from kant_sql.reasoning.world import World
from tests.support.evaluator import Evaluator, Ground, State
from tests.support.generators.episodes import NUMBERS, Episode, episode
from tests.support.profile import HUNT, PROFILE

# A fact or a fluent in the plain evaluator's words.
Key = tuple[bool, Ground]
# Bindings of a question, literals of which all sets are tried, and those that are flipped alone.
BOUND, MOST, SAMPLED = 3, 6, 12


def test_what_conditions_use_is_what_they_rest_on() -> None:
    """`KANT_SQL_TEST_EXAMPLES` sets how many conditions are judged."""
    judged, seed = 0, 0
    while judged < (HUNT or 5 * PROFILE.episodes):
        judged, seed = judged + judge_episode(episode(seed)), seed + 1


def judge_episode(episode: Episode) -> int:
    """Judge the conditions of an episode that hold, a few of each question."""
    judged = 0
    domain = read_domain(write(episode.domain))
    world = read_world(domain, read_problem(write(episode.problem), domain=domain))
    state, random = episode.first, Random(episode.seed)
    plain = Evaluator(episode.theory, state)
    for question in episode.questions:
        held = (one for one in islice(plain.bindings(question.columns), 100)
                if plain.holds(question.formula, one))  # fmt: skip
        for bound in islice(held, BOUND):
            judged += 1
            judge = Judge(episode, state, question.formula, bound)
            used = {key(world, one): one.holds for one in used_by(world, question.formula, bound)}
            about = f"episode({episode.seed}), {bound}: {question.formula}; used {used}"
            judge.check(world, used, random, about)
    return judged


def used_by(world: World, formula: f.Formula, bound: dict[str, str]) -> list[Literal]:
    resolver = Resolver(world.definitions)
    slots = [resolver.slot() for _ in bound]
    for name, slot in zip(bound, slots, strict=True):
        resolver.bind(name, slot)
    found = [world.definitions.objects.named(name) for name in bound.values()]
    row = tuple([one.id for one in found if one is not None])
    return list(Uses(world).of(resolver.part(formula), slots, row))


def key(world: World, literal: Literal) -> Key:
    text = world.text(literal[:2], literal.row)
    return literal.is_fact, tuple(map(fold, text[1:-1].split()))


def changed(state: State, keys: set[Key], random: Random | None = None) -> State:
    """Return a state with facts the other way round; numbers lack, or are others at random."""
    facts, held = state.facts ^ {one for is_fact, one in keys if is_fact}, dict(state.values)
    for is_fact, one in sorted(keys):
        if is_fact:
            continue
        before = held.pop(one, None)
        if random is not None and isinstance(before, Fraction) and random.random() < 0.7:
            held[one] = random.choice(NUMBERS)
    return replace(state, facts=facts, values=held)


class Judge:
    def __init__(
        self, episode: Episode, state: State, formula: f.Formula, bound: dict[str, str]
    ) -> None:
        self.episode, self.state, self.formula, self.bound = episode, state, formula, bound
        theory = episode.theory
        heads = {fold(one.predicate) for one in f.walk(formula) if isinstance(one, f.Atom)}
        derived = heads & {fold(rule.predicate) for rule in theory.rules}
        # To derive what the condition does not mention takes nearly all the time.
        self.theory = theory if derived else replace(theory, rules=())

    def holds(self, state: State) -> bool:
        return Evaluator(self.theory, state).holds(self.formula, self.bound)

    def atoms(self, world: World) -> Iterator[Key]:
        """All ground facts and fluents, of the declared types or not."""
        declared = world.definitions
        for is_fact, heads in ((True, declared.predicates), (False, declared.functions)):
            for head in heads:
                names = (self.state.objects for _ in head.parameters)
                for row in islice(product(*names), 100):
                    yield is_fact, (fold(head.name), *row)

    def check(self, world: World, used: dict[Key, bool], random: Random, about: str) -> None:
        every = [*self.atoms(world)]
        rest = [one for one in every if one not in used]
        for one in random.sample(rest, min(len(rest), SAMPLED)):
            # A fluent without a value may get any.
            if one[0] or one[1] in self.state.values:
                assert self.holds(changed(self.state, {one})), f"{about}; {one} flips it"
        for _ in range(4):
            some = {one for one in rest if random.random() < 0.5}
            assert self.holds(changed(self.state, some, random)), f"{about}; {sorted(some)} flip it"
        if len(used) <= MOST and self.is_read_once():
            self.check_minimal(used, about)

    def is_read_once(self) -> bool:
        """Whether the formula has facts alone, none twice or derived, and nothing trivial."""
        heads = []
        for node in f.walk(self.formula):
            match node:
                case f.Atom():
                    heads.append(fold(node.predicate))
                case f.And() | f.Or():
                    if not node.formulas:
                        return False
                case f.Exists() | f.Forall():
                    plain = Evaluator(self.theory, self.state)
                    if not all(plain.range(one.types) for one in node.variables):
                        return False
                case f.Not() | f.Imply() | f.Variable() | f.Constant():
                    pass
                case _:
                    return False
        return not self.theory.rules and len(heads) == len({*heads})

    def check_minimal(self, used: dict[Key, bool], about: str) -> None:
        for one in used:
            others = [each for each in used if each != one]
            sets = (set(some) for n in range(len(others) + 1) for some in combinations(others, n))
            assert any(
                self.holds(changed(self.state, gone))
                and not self.holds(changed(self.state, gone | {one}))
                for gone in sets
            ), f"{about}; {one} is in no smallest support"
