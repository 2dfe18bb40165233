"""What a generated document may speak of, and the names that it gives to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeVar

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from kant_sql.dto.formula import Atom, Constant, Fluent, Term, TypedName, Variable
from kant_sql.dto.name import ROOT_TYPE, fold
from kant_sql.pddl.document import Domain, Function, Predicate

T = TypeVar("T")
Scope = tuple[TypedName, ...]

# Legal names that a careless reader takes for something else.
AWKWARD = (
    *("at", "over", "start", "end", "all", "object1", "number1", "either1", "domain", "problem"),
    *("defined", "init", "goal", "x", "X1", "A-B", "a_b", "a-", "b--c", "T", "t1", "nil", "true"),
    *("minimize", "duration", "always1", "preference1", "is-violated1", "increase1", "not-p"),
    *("parameters", "condition", "effect", "metric", "e1", "E2", "inf", "NaN", "total-cost"),
)
LETTERS = "abcxyzABCXYZ"
NAMES = st.one_of(
    st.sampled_from(AWKWARD),
    st.builds(
        str.__add__, st.sampled_from(LETTERS), st.text(alphabet=LETTERS + "0189-_", max_size=5)
    ),
)
VARIABLES = ("x", "y", "Z1", "a-b", "r_", "start", "object", "either", "number", "end")


def distinct(count: int, taken: Sequence[str] = ()) -> SearchStrategy[list[str]]:
    """Names that PDDL holds different, from each other and from those that are taken."""
    keys = {fold(name) for name in taken}
    free = NAMES.filter(lambda name: fold(name) not in keys)
    return st.lists(free, min_size=count, max_size=count, unique_by=fold)


def some(elements: SearchStrategy[T], most: int, least: int = 0) -> SearchStrategy[tuple[T, ...]]:
    return st.lists(elements, min_size=least, max_size=most).map(tuple)


_FLIPS = st.booleans()


@lru_cache
def _below(count: int) -> SearchStrategy[int]:
    return st.integers(0, count - 1)


@dataclass(frozen=True)
class World:
    """The types, with the one above each; what there is of them; what can be said and changed."""

    parents: dict[str, str]
    things: tuple[TypedName, ...]
    predicates: tuple[Predicate, ...]
    functions: tuple[Function, ...]
    derived: frozenset[str] = frozenset()

    def fits(self, types: tuple[str, ...], wanted: tuple[str, ...]) -> bool:
        return all(any(self._is_below(name, above) for above in wanted) for name in types)

    def _is_below(self, name: str, above: str) -> bool:
        while name not in (above, ROOT_TYPE):
            name = self.parents[name]
        return name == above

    @cached_property
    def type_choice(self) -> SearchStrategy[tuple[str, ...]]:
        names = [*self.parents, ROOT_TYPE]
        one = st.sampled_from(names).map(lambda name: (name,))
        if len(names) == 1:
            return one
        either = st.lists(st.sampled_from(names), min_size=2, max_size=3, unique=True).map(tuple)
        return st.one_of(one, one, either)

    def parameters(self, most: int = 3, repeats: bool = False) -> SearchStrategy[Scope]:
        one = st.builds(TypedName, st.sampled_from(VARIABLES), self.type_choice)
        if repeats:
            return some(one, most)
        listed = st.lists(one, max_size=most, unique_by=lambda part: fold(part.name))
        return listed.map(tuple)


def world_of(domain: Domain, objects: tuple[TypedName, ...] = ()) -> World:
    return World(
        {name.name: name.types[0] for name in domain.types},
        (*domain.constants, *objects),
        domain.predicates,
        domain.functions,
        frozenset(fold(rule.predicate) for rule in domain.derived),
    )


def bind(scope: Scope, parts: Scope) -> Scope:
    """What is in scope once more is bound: the inner of two that have one name."""
    bound = {fold(part.name) for part in parts}
    return (*(part for part in scope if fold(part.name) not in bound), *parts)


class Words:
    """Draws terms, atoms and fluents that are well typed."""

    def __init__(self, draw: DrawFn, world: World) -> None:
        self.draw, self.world = draw, world

    def pick(self, choices: Sequence[T]) -> T:
        return choices[self.draw(_below(len(choices)))]

    def flip(self) -> bool:
        return self.draw(_FLIPS)

    def term(self, wanted: tuple[str, ...], scope: Scope, nested: int) -> Term | None:
        fits = self.world.fits
        choices: list[Term] = [Constant(t.name) for t in self.world.things if fits(t.types, wanted)]
        choices += [Variable(part.name) for part in scope if fits(part.types, wanted)]
        if nested and (fluent := self.fluent(scope, wanted, nested - 1)) is not None:
            choices.append(fluent)
        return self.pick(choices) if choices else None

    def arguments(self, parameters: Scope, scope: Scope, nested: int) -> tuple[Term, ...] | None:
        terms = [self.term(part.types, scope, nested) for part in parameters]
        found = tuple(term for term in terms if term is not None)
        return found if len(found) == len(parameters) else None

    def fluent(self, scope: Scope, wanted: tuple[str, ...] = (), nested: int = 1) -> Fluent | None:
        """A number, or where types are wanted an object of these."""
        fitting = [
            function
            for function in self.world.functions
            if bool(function.types) == bool(wanted)
            and (not wanted or self.world.fits(function.types, wanted))
        ]
        if not fitting:
            return None
        function = self.pick(fitting)
        terms = self.arguments(function.parameters, scope, nested)
        return None if terms is None else Fluent(function.name, terms)

    def atom(self, scope: Scope, basic: bool = False, nested: int = 0) -> Atom:
        """An atom; a basic one is of a predicate that no rule defines."""
        predicate = self.pick(
            [
                p
                for p in self.world.predicates
                if not basic or fold(p.name) not in self.world.derived
            ]
        )
        terms = self.arguments(predicate.parameters, scope, nested)
        if terms is None:
            # The first predicate has no parameters, and no rule.
            return Atom(self.world.predicates[0].name)
        return Atom(predicate.name, terms)
