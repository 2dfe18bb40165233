"""What a condition uses, judged by changing the state and evaluating it again, plainly.

- Complete: if changing one fact or value makes a condition fail that held, it is used.
- Sufficient: any state with the same used literals satisfies the condition.
- The derived facts that use a literal are those that are found from it, in a state that has only
  what these depend on, too.
- Minimal: where a formula has facts alone, of predicates that are neither derived nor mentioned
  twice, each used literal is in a smallest set of literals by which the condition holds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, islice, product
from random import Random
from typing import Any

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.knowledge.reads import Reading, read_by
from kant_sql.knowledge.resolved import HoldsFact, Known, Resolver
from kant_sql.knowledge.rules import rules_of
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.reasoning.derived import read_world, world_of
from kant_sql.reasoning.uses import Literal, Uses, users_of
from kant_sql.reasoning.world import World
from tests.support.evaluator import Evaluator, Ground, State
from tests.support.generators.episodes import NUMBERS, Episode, episode
from tests.support.profile import HUNT, PROFILE

# A fact or a fluent in the plain evaluator's words.
Key = tuple[bool, Ground]
# Bindings of a question, literals of which all sets are tried, and those that are flipped alone.
BOUND, MOST, SAMPLED = 3, 6, 12
DERIVED = 60
VALUES = """
(define (domain d) (:requirements :adl :derived-predicates :fluents :object-fluents)
  (:types robot place)
  (:predicates (low ?r - robot) (home ?r - robot) (lost ?r - robot) (bad) (good ?r - robot)
    (at ?r - robot ?p - place) (odd ?r - robot ?p - place) (twice ?a ?b - robot))
  (:functions (battery ?r - robot) - number (limit) - number (on ?r - robot) - place
    (base ?r - robot) - place)
  (:derived (low ?r - robot) (< (battery ?r) (limit)))
  (:derived (home ?r - robot) (= (on ?r) (base ?r)))
  (:derived (lost ?r - robot) (and (not (home ?r)) (not (low ?r))))
  (:derived (bad) (forall (?r - robot) (or (low ?r) (lost ?r))))
  (:derived (good ?r - robot) (exists (?p - place)
    (and (at ?r ?p) (not (exists (?s - robot) (and (at ?s ?p) (low ?s)))))))
  (:derived (odd ?r - robot ?p - place) (or (at ?r ?p) (= (on ?r) ?p)))
  (:derived (twice ?a ?b - robot) (and (good ?a) (not (= ?a ?b)) (odd ?b (on ?a)))))
"""
VALUES_NOW = """
(define (problem p) (:domain d) (:objects a b c e - robot x y z - place)
  (:init (= (battery a) 1) (= (battery b) 50) (= (limit) 10) (= (on a) x) (= (on b) y) (= (on c) z)
    (= (base a) x) (= (base b) x) (= (base c) y) (at a x) (at b y) (at c z) (at c y))
  (:goal (bad)))
"""


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


def test_derived_facts_are_found_by_what_they_use() -> None:
    """The literals that some derived facts of an episode use, and some facts that none may use."""
    judged, seed = 0, 0
    while judged < (HUNT or 2 * PROFILE.episodes):
        one = episode(seed)
        domain = read_domain(write(one.domain))
        world = read_world(domain, read_problem(write(one.problem), domain=domain))
        judged, seed = judged + judge_users(world, seed), seed + 1


def test_derived_facts_are_found_by_the_values_they_use() -> None:
    domain = read_domain(VALUES)
    assert judge_users(read_world(domain, read_problem(VALUES_NOW, domain=domain)), 0) > SAMPLED


def judge_users(world: World, seed: int) -> int:
    random, rules = Random(seed), rules_of(world.definitions)
    uses, users = Uses(world), defaultdict[Literal, set[Literal]](set)
    derived: list[Literal] = []
    for head in rules.component:
        component = world.rules(head)
        assert component is not None
        component.refresh()
        derived += [Literal(True, head, row, True) for row in sorted(world.relation(head).rows)]
    for one in derived[:DERIVED]:
        part = fact_of(one)
        for literal in uses.of(part):
            users[literal].add(one)
        again = Uses(restricted(world, {*read_by(rules, [part], {})}))
        assert {*again.of(part)} == {*uses.of(part)}, f"{seed}: {one}"
    literals = random.sample(sorted(users), min(len(users), 2 * SAMPLED))
    literals += [Literal(True, *one, True) for one in islice(sorted(world.facts()), SAMPLED)]
    for literal in literals:
        found = {*uses.users(literal)}
        assert found & {*derived[:DERIVED]} == users[literal] - {literal}, f"{seed}: {literal}"
        parts = [one for some in users_of(world.definitions, literal).values() for one in some]
        some = {pattern for part, given in parts for pattern in read_by(rules, [part], given)}
        assert {*Uses(restricted(world, some)).users(literal)} == found, f"{seed}: {literal}"
    return len(literals)


def fact_of(literal: Literal) -> HoldsFact:
    return HoldsFact(literal.owner, tuple(map(Known, literal.row)))


def restricted(world: World, patterns: set[Reading[int]]) -> World:
    """Return a state that has only what fits some patterns."""

    def fits(*atom: Any) -> bool:
        return any(
            atom[:2] == one[:2]
            and all(a in (None, b) for a, b in zip(one[2], atom[2], strict=True))
            for one in patterns
        )

    made = world_of(world.definitions)
    for fact in world.facts():
        if fits(True, *fact):
            made.add(*fact)
    for fluent, value in world.values().items():
        if fits(False, *fluent):
            made.set(*fluent, value)
    return made


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
