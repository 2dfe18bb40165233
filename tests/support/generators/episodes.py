"""Random episodes: a domain, a sequence of states, and questions about them.

Unlike in `documents`, the rules of derived predicates are stratified, and many conditions hold for
some objects and fail for others. An episode is a function of its seed: Hypothesis would mostly draw
small and similar ones, which few answers distinguish.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from random import Random
from typing import NoReturn, TypeVar, cast

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from kant_sql import KnowledgeBase
from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import ROOT_TYPE, fold
from kant_sql.pddl import document
from kant_sql.pddl.requirements import used_requirements
from tests.support.evaluator import Ground, State, Theory
from tests.support.generators.documents import (
    AWKWARD,
    DEPTH,
    DURATION,
    VARIABLES,
    Formulas,
    Scope,
    World,
    bind,
)

T = TypeVar("T")

# The maximum number of ground atoms of one predicate that hold.
MOST = 150
NUMBERS = (Fraction(0), Fraction(1), Fraction(2), Fraction(-3), Fraction(1, 2), Fraction(5, 4))


@dataclass(frozen=True)
class Question:
    """A condition with its free variables, some of them bound."""

    columns: Scope
    formula: f.Formula
    fixed: dict[str, str]

    @property
    def free(self) -> Scope:
        """The variables that are not bound."""
        return tuple(part for part in self.columns if fold(part.name) not in self.fixed)


@dataclass(frozen=True)
class Change:
    """The difference of two states: facts, and values of fluents, None for no value."""

    added: tuple[f.Atom, ...]
    removed: tuple[f.Atom, ...]
    values: tuple[tuple[f.Fluent, Fraction | str | None], ...]

    def make(self, kb: KnowledgeBase) -> None:
        """Change a state by calls of the DAOs, as far as its objects exist."""

        def is_known(names: Iterable[object]) -> bool:
            return all(kb.objects.get(str(name)) is not None for name in names)

        kb.propositions.save_all([str(atom) for atom in self.added if is_known(atom.terms)])
        for atom in self.removed:
            if is_known(atom.terms):
                kb.propositions.delete(str(atom))
        for fluent, value in self.values:
            names = [str(term) for term in fluent.terms]
            if not is_known([*names, value] if isinstance(value, str) else names):
                continue
            if value is None:
                kb.function_values.unset(fluent.function, objects=names)
            else:
                held = value if isinstance(value, str) else float(value)
                kb.function_values.set(fluent.function, objects=names, value=held)

    def of(self, state: State) -> State:
        """Return the state after this change of another one."""
        facts = (state.facts | {*map(ground, self.added)}) - {*map(ground, self.removed)}
        values = dict(state.values)
        for fluent, value in self.values:
            values.pop(ground(fluent), None)
            if value is not None:
                values[ground(fluent)] = value
        return replace(state, facts=facts, values=values)


@dataclass(frozen=True)
class Episode:
    """A domain with a problem, changes of its initial state, and questions."""

    seed: int
    domain: document.Domain
    problem: document.Problem
    changes: tuple[Change, ...]
    questions: tuple[Question, ...]

    @property
    def theory(self) -> Theory:
        """The types and the rules."""
        return theory_of(self.domain)

    @property
    def first(self) -> State:
        """The initial state."""
        return state_of(self.domain, self.problem)


def ground(node: f.Atom | f.Fluent) -> Ground:
    """A ground atom, or a ground fluent, as a key."""
    name = node.predicate if isinstance(node, f.Atom) else node.function
    return (fold(name), *(fold(str(term)) for term in node.terms))


def theory_of(domain: document.Domain) -> Theory:
    """The types and the rules of a domain."""
    parents = {fold(part.name): tuple(map(fold, part.types)) for part in domain.types}
    return Theory(parents, domain.derived)


def state_of(domain: document.Domain, problem: document.Problem) -> State:
    """The initial state of a problem."""
    values = {
        ground(fluent): Fraction(value.value) if isinstance(value, f.Number) else fold(value.name)
        for fluent, value in problem.values
    }
    objects = {
        fold(part.name): tuple(map(fold, part.types))
        for part in (*domain.constants, *problem.objects)
    }
    return State(objects, frozenset(map(ground, problem.facts)), values)


class Conditions(Formulas):
    """Makes conditions; rules negate only predicates of lower layers."""

    def __init__(self, random: Random, world: World, layers: dict[str, int]) -> None:
        super().__init__(cast(DrawFn, _no_draw), world)
        self.random = random
        self.layers, self.layer, self.positive = layers, len(layers) + 1, True

    def pick(self, choices: Sequence[T]) -> T:
        return self.random.choice(choices)

    def flip(self) -> bool:
        return self.random.random() < 0.5

    def between(self, least: int, most: int) -> int:
        return self.random.randint(least, most)

    def types(self) -> tuple[str, ...]:
        """Return a type, or rarely several."""
        names = [*self.world.parents]
        if len(names) > 1 and self.random.random() < 0.2:
            return tuple(self.random.sample(names, 2))
        return (self.pick([*names, *names, ROOT_TYPE]),)

    def variables(self, names: Sequence[str]) -> Scope:
        return tuple(f.TypedName(name, self.types()) for name in names)

    def bound(self, least: int = 1) -> Scope:
        return self.variables(self.random.sample(VARIABLES, self.pick([1, 1, 2])))

    def term(self, wanted: tuple[str, ...], scope: Scope, nested: int) -> f.Term | None:
        """Return a term, mostly a variable."""
        fitting = [f.Variable(v.name) for v in scope if self.world.fits(v.types, wanted)]
        if fitting and self.random.random() < 0.8:
            return self.pick(fitting)
        return super().term(wanted, scope, nested)

    def atom(self, scope: Scope, basic: bool = False, nested: int = 0) -> f.Atom:
        most = -1 if basic else self.layer - (not self.positive)
        known = [p for p in self.world.predicates if self.layers.get(fold(p.name), -1) <= most]
        for _ in range(3):
            predicate = self.pick(known)
            terms = self.arguments(predicate.parameters, scope, nested)
            if terms and (not scope or any(isinstance(term, f.Variable) for term in terms)):
                break
        return f.Atom(predicate.name, terms) if terms else f.Atom(self.world.predicates[0].name)

    def literal(self, scope: Scope, basic: bool = False, nested: int = 0) -> f.Atom | f.Not:
        if self.random.random() < 0.7:
            return self.atom(scope, basic, nested)
        self.positive = not self.positive
        atom = self.atom(scope, basic, nested)
        self.positive = not self.positive
        return f.Not(atom)

    def goal(self, scope: Scope, depth: int = DEPTH) -> f.Formula:
        kinds = ["literal", "literal", "comparison", "not", "and", "and", "or", "imply", "all"]
        kind = self.pick(kinds) if depth else "literal"
        if kind == "comparison":
            return self.comparison(scope)
        if kind == "literal":
            return self.literal(scope, nested=self.pick([0, 0, 2]))
        if kind == "not":
            return f.Not(self.opposite(scope, depth - 1))
        if kind == "imply":
            return f.Imply(self.opposite(scope, depth - 1), self.goal(scope, depth - 1))
        if kind == "all":
            parts = self.bound()
            inner = self.goal(bind(scope, parts), depth - 1)
            return f.Exists(parts, inner) if self.random.random() < 0.7 else f.Forall(parts, inner)
        count = self.random.choices([2, 3, 1, 0], [20, 8, 1, 1])[0]
        made = tuple(self.goal(scope, depth - 1) for _ in range(count))
        return f.And(made) if kind == "and" else f.Or(made)

    def number(self, least: int | None = None) -> f.Number:
        return f.Number(Decimal(str(float(self.pick(NUMBERS)))))

    def opposite(self, scope: Scope, depth: int) -> f.Formula:
        """Return a condition under a negation."""
        self.positive = not self.positive
        made = self.goal(scope, depth)
        self.positive = not self.positive
        return made

    def narrowed(self, types: tuple[str, ...]) -> tuple[str, ...]:
        """Return the types, or rarely a subtype."""
        below = [name for name in self.world.parents if self.world.fits((name,), types)]
        return (self.pick(below),) if below and self.random.random() < 0.2 else types

    def rule(self, predicate: document.Predicate) -> f.Derived:
        """Return a rule: any condition, or a join with more variables, as for transitivity."""
        self.layer = self.layers[fold(predicate.name)]
        parts = tuple(
            f.TypedName(f"v{number}", self.narrowed(part.types))
            for number, part in enumerate(predicate.parameters)
        )
        if self.random.random() < 0.6:
            more = self.variables(["w0", "w1"][: self.pick([1, 1, 2])])
            joined = tuple(self.atom((*parts, *more)) for _ in range(self.pick([2, 2, 3])))
            body: f.Formula = f.Exists(more, f.And(joined))
            if self.flip():
                body = f.Or((self.literal(parts), body))
        else:
            body = self.goal(parts, 2)
        self.layer = len(self.layers) + 1
        return f.Derived(predicate.name, parts, body)

    def action(self, name: str) -> document.Action:
        scope = self.variables(self.random.sample(VARIABLES, self.pick([2, 1, 3, 0])))
        condition = self.conjuncts(lambda: self.goal(scope, 2), 2)
        return document.Action(
            document.ACTION, name, scope, (), condition, self.conjuncts(lambda: self.effect(scope))
        )

    def durative(self, name: str) -> document.Action:
        """Return a durative action whose conditional effects each have one time."""
        scope = self.variables(self.random.sample(VARIABLES, self.pick([2, 1, 3, 0])))
        condition = tuple(f.Timed(self.pick(f.TIMES), self.goal(scope, 2)) for _ in range(3))
        effect: list[f.Formula] = []
        for _ in range(self.between(1, 4)):
            time = self.pick((f.AT_START, f.AT_END))
            made: f.Formula = f.Timed(time, self.change(scope))
            if self.random.random() < 0.3:
                made = f.When(f.Timed(time, self.goal(scope, 1)), made)
            effect.append(made)
        changed = self.continuous(scope) if self.random.random() < 0.5 else None
        return document.Action(
            document.DURATIVE_ACTION,
            name,
            scope,
            tuple(self.lasts(scope) for _ in range(self.pick([1, 1, 2]))),
            condition,
            (*effect, *([] if changed is None else [changed])),
        )

    def lasts(self, scope: Scope) -> f.Comparison:
        """Return a constraint on a duration, which may contradict another one."""
        limit = self.expression(scope, 1) if self.random.random() < 0.3 else f.Number(5)
        return f.Comparison(self.pick(["=", "=", "<=", ">="]), DURATION, limit)

    def question(self) -> Question:
        columns = self.variables(self.random.sample(VARIABLES, self.pick([2, 1, 2, 0, 3])))
        fixed = {}
        for column in columns:
            fitting = [t for t in self.world.things if self.world.fits_any(t.types, column.types)]
            if fitting and self.random.random() < 0.15:
                fixed[fold(column.name)] = self.pick(fitting).name
        return Question(columns, self.goal(columns), fixed)


def _no_draw(*_: object, **__: object) -> NoReturn:
    raise AssertionError("an episode is made without draws")


def free_variables(domain: document.Domain, formula: f.Formula) -> dict[str, list[tuple[str, ...]]]:
    """Return the free variables in order, each with the types that its atoms allow."""
    declared = {fold(p.name): p for p in domain.predicates}
    functions = {fold(function.name): function for function in domain.functions}
    found: dict[str, list[tuple[str, ...]]] = {}

    def visit(node: f.Node, bound: frozenset[str]) -> None:
        parameters: Scope = ()
        if isinstance(node, f.Atom):
            parameters = declared[fold(node.predicate)].parameters
        elif isinstance(node, f.Fluent):
            parameters = functions[fold(node.function)].parameters
        elif isinstance(node, f.Forall | f.Exists):
            bound |= {fold(variable.name) for variable in node.variables}
        elif isinstance(node, f.Variable) and fold(node.name) not in bound:
            found.setdefault(fold(node.name), [])
        for number, part in enumerate(f.children(node)):
            visit(part, bound)
            if parameters and isinstance(part, f.Variable) and fold(part.name) not in bound:
                found[fold(part.name)].append(parameters[number].types)

    visit(formula, frozenset())
    return found


def atoms_of(world: World, parameters: Scope) -> list[tuple[f.Constant, ...]]:
    """Return the possible arguments of a predicate or a function."""
    ranges = [
        [
            f.Constant(thing.name)
            for thing in world.things
            if world.fits_any(thing.types, part.types)
        ]
        for part in parameters
    ]
    return list(itertools.islice(itertools.product(*ranges), MOST))


def changes(random: Random, world: World, begins: bool = False) -> Change:
    """Return some facts and values; after the initial state, also changes of existing ones."""
    added: list[f.Atom] = []
    removed: list[f.Atom] = []
    for predicate in world.predicates:
        # Facts of derived predicates can also be stored, but not in a problem.
        if fold(predicate.name) in world.derived and (begins or random.random() < 0.7):
            continue
        share = random.choice([0.1, 0.3, 0.6]) if begins else 0.15
        for terms in atoms_of(world, predicate.parameters):
            if random.random() < share:
                added.append(f.Atom(predicate.name, terms))
            elif not begins and random.random() < 0.3:
                removed.append(f.Atom(predicate.name, terms))
    values: list[tuple[f.Fluent, Fraction | str | None]] = []
    for function in world.functions:
        allowed: list[Fraction | str | None] = [*NUMBERS]
        if function.types:
            fitting = [t for t in world.things if world.fits_any(t.types, function.types)]
            allowed = [fold(thing.name) for thing in fitting]
        for terms in atoms_of(world, function.parameters):
            if begins or random.random() < 0.3:
                values.append((f.Fluent(function.name, terms), random.choice([*allowed, None])))
    return Change(tuple(added), tuple(removed), tuple(values))


def _names(random: Random, count: int) -> list[str]:
    """Return names that differ in PDDL, some of them awkward."""
    found: dict[str, str] = {}
    while len(found) < count:
        name = random.choice("abcxyzABCXYZ") + "".join(random.choices("abcXYZ0189-_", k=3))
        if random.random() < 0.3:
            name = random.choice(AWKWARD)
        found.setdefault(fold(name), name)
    return list(found.values())


def _world(words: Conditions, names: list[str]) -> tuple[World, dict[str, int]]:
    """Return types, objects, predicates and functions; and the layers of derived predicates."""
    parents: dict[str, str] = {}
    for name in names[: words.pick([2, 3, 2, 1, 0])]:
        parents[name] = words.pick([*parents, ROOT_TYPE])
    words.world = World(parents, (), (), ())
    many = words.random.choices(range(7), [1, 2, 2, 3, 6, 8, 4])[0]
    objects = words.variables(names[4 : 4 + many])
    predicates = [document.Predicate(names[10])]
    for name in names[11 : 11 + words.between(3, 6)]:
        count = words.random.choices([0, 1, 2, 3, 4], [1, 6, 8, 3, 1])[0]
        predicates.append(
            document.Predicate(name, words.variables([f"a{i}" for i in range(count)]))
        )
    functions = []
    for name in names[17 : 17 + words.between(0, 4)]:
        parameters = words.variables([f"a{i}" for i in range(words.pick([1, 0, 1, 2]))])
        functions.append(document.Function(name, parameters, words.types() if words.flip() else ()))
    ruled = [predicate.name for predicate in predicates[2:] if words.random.random() < 0.4]
    layers = {fold(name): words.between(0, 1) for name in ruled}
    return World(parents, objects, tuple(predicates), tuple(functions), frozenset(layers)), layers


def episode(seed: int, changed: int = 2, asked: int = 8) -> Episode:
    """Return a domain with stratified rules and actions, states of it, and questions."""
    random = Random(seed)
    names = _names(random, 30)
    world, layers = _world(Conditions(random, World({}, (), (), ()), {}), names)
    count = random.randint(0, len(world.things))
    # A domain knows only its constants.
    words = Conditions(random, replace(world, things=world.things[:count]), layers)
    ruled = [predicate for predicate in world.predicates if fold(predicate.name) in layers]
    rules = [words.rule(predicate) for predicate in ruled for _ in range(2)]
    domain = document.Domain(
        names[29],
        types=tuple(f.TypedName(name, (above,)) for name, above in world.parents.items()),
        constants=words.world.things,
        predicates=world.predicates,
        functions=world.functions,
        derived=tuple(dict.fromkeys(rules)),
        actions=(
            *(words.action(name) for name in names[22:25]),
            *(words.durative(name) for name in names[25:27]),
        ),
    )
    words.world = world
    begin = changes(random, world, begins=True)
    problem = document.Problem(
        names[28],
        domain.name,
        objects=world.things[count:],
        facts=begin.added,
        values=tuple(_value(fluent, value) for fluent, value in begin.values if value is not None),
        # Goals are not facts.
        goal=tuple({words.atom((), basic=True): None for _ in range(3)}),
    )
    return Episode(
        seed,
        replace(domain, requirements=tuple(used_requirements(domain, problem=problem))),
        problem,
        tuple(changes(random, world) for _ in range(changed)),
        tuple(words.question() for _ in range(asked)),
    )


def _value(fluent: f.Fluent, value: Fraction | str) -> document.FunctionValue:
    if isinstance(value, str):
        return document.FunctionValue(fluent, f.Constant(value))
    return document.FunctionValue(fluent, f.Number(Decimal(str(float(value)))))


EPISODES: SearchStrategy[Episode] = st.builds(episode, st.integers(0, 2**32 - 1))
