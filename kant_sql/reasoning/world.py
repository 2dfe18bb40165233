"""A state in memory: resolved conditions are evaluated in it, and effects change it.

- A fluent without a value makes the atom, the equality or the comparison around it false, as in
  VAL; so does a division by zero. Negation is classical: `(not (< (f) 3))` holds then.
- Conditions and effects calculate exactly; effects write finite decimals.
- A derived predicate holds by its rules, and by the stored facts about it.
- While numbers change continuously, the state is the one at `elapsed` since the change began.

Predicates, functions and objects are ids, as in `knowledge.resolved`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from operator import itemgetter
from typing import Any, Protocol

from ..dto.elements import atom_text
from ..dto.formulas import Atom, Expression, Fluent, Number, Term, TypedName
from ..dto.lexical import ROOT_TYPE, fold
from ..knowledge import definitions as d
from ..knowledge.reads import Head
from ..knowledge.resolved import Resolver, TypeSet
from ..knowledge.rules import DerivationRules
from ..knowledge.trees import ParameterDefinition
from ..pddl.document import Domain, Problem
from .arithmetic import Linear

# The objects of a fact; a fluent with its function.
Row = tuple[int, ...]
FluentRow = tuple[int, Row]
Value = Decimal | int


def picker(positions: tuple[int, ...]) -> Callable[[Sequence[Any]], Row]:
    """Return a function that picks the items at some positions, as a tuple."""
    if len(positions) > 1:
        return itemgetter(*positions)
    if not positions:
        return lambda row: ()
    only = positions[0]
    return lambda row: (row[only],)


class Relation:
    """The facts of one predicate, with indexes on demand; only the methods change `rows`."""

    __slots__ = ("_indexes", "rows")

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self.rows: set[Row] = set(rows)
        self._indexes: dict[
            tuple[int, ...], tuple[Callable[[Sequence[Any]], Row], dict[Row, set[Row]]]
        ] = {}

    def add(self, row: Row) -> bool:
        """Add a fact; return False if it is already there."""
        if row in self.rows:
            return False
        self.rows.add(row)
        for pick, index in self._indexes.values():
            index.setdefault(pick(row), set()).add(row)
        return True

    def discard(self, row: Row) -> bool:
        """Remove a fact; return False if it is not there."""
        if row not in self.rows:
            return False
        self.rows.discard(row)
        for pick, index in self._indexes.values():
            index[pick(row)].discard(row)
        return True

    def clear(self) -> None:
        """Remove all facts."""
        self.rows.clear()
        self._indexes.clear()

    def lookup(self, positions: tuple[int, ...]) -> Callable[[Row], Collection[Row]]:
        """Return a function from objects at some positions to the facts with these objects."""
        if not positions:
            return lambda key: self.rows
        return lambda key: self._index(positions).get(key, ())

    def _index(self, positions: tuple[int, ...]) -> dict[Row, set[Row]]:
        found = self._indexes.get(positions)
        if found is not None:
            return found[1]
        pick, index = picker(positions), dict[Row, set[Row]]()
        for row in self.rows:
            index.setdefault(pick(row), set()).add(row)
        self._indexes[positions] = pick, index
        return index


class Rules(Protocol):
    """The rules of derived predicates that depend on each other."""

    heads: frozenset[int]  # the predicates that they derive
    sources: set[Head]  # the predicates and functions that their facts depend on
    is_fresh: bool  # whether the derived facts belong to the present state

    def refresh(self) -> None:
        """Derive the facts unless they are fresh."""


class World:
    """The facts and values of one state; `derived.world_of` adds the rules."""

    def __init__(self, definitions: d.Definitions) -> None:
        self.definitions = definitions  # the definitions in this state
        # The continuous change of each fluent in a unit of time.
        self.rates: dict[FluentRow, Fraction] = {}
        self.elapsed = Fraction(0)  # the time since `rates` began to hold
        # The times at which comparisons change their truth value, collected while numbers change.
        self.roots: set[Fraction] = set()
        self.total_time = Decimal(0)  # the value of `total-time` in a metric
        # The number of violations of each preference, by folded name.
        self.violations: dict[str, int] = {}
        self._relations: defaultdict[int, Relation] = defaultdict(Relation)
        self._tables: defaultdict[int, dict[Row, Value]] = defaultdict(dict)
        self._rules: dict[int, Rules] = {}
        # The facts of derived predicates that hold without a rule.
        self._stored: dict[int, Relation] = {}
        self._dependants: dict[Head, list[Rules]] = {}

    def add_rules(self, rules: Rules) -> None:
        """Derive the facts of some predicates by rules."""
        self._rules.update(dict.fromkeys(rules.heads, rules))
        for predicate in rules.heads:
            self._stored[predicate] = Relation(self.relation(predicate).rows)
        for head in rules.sources:
            self._dependants.setdefault(head, []).append(rules)

    # Names and types.

    def object(self, name: str) -> int | None:
        """Return the id of an object."""
        found = self.definitions.objects.named(name)
        return None if found is None else found.id

    @cached_property
    def ids(self) -> dict[str, int]:
        """The ids of objects by their declared names."""
        return {one.name: one.id for one in self.definitions.objects}

    def names(self, ids: Iterable[int]) -> tuple[str, ...]:
        """Return the names of objects."""
        live = self.definitions.objects.live
        return tuple([live(id_).name for id_ in ids])

    def text(self, head: Head, row: Row) -> str:
        """Write a fact or a fluent."""
        declared: Any = self.definitions.predicates if head[0] else self.definitions.functions
        return atom_text(declared.live(head[1]).name, self.names(row))

    def members(self, types: tuple[TypeSet, ...]) -> frozenset[int]:
        """Return the objects that fit all of some type sets."""
        kept = self.definitions.derived
        found: frozenset[int] | None = kept.get(("members", types))
        if found is None:
            wanted = [each for each in types if each is not None]
            found = kept["members", types] = frozenset(
                one.id
                for one in self.definitions.objects
                if not any(each.isdisjoint(one.type_ids) for each in wanted)
            )
        return found

    def range_of(self, variable: TypedName) -> tuple[str, ...]:
        """Return the names of the objects of a variable's types, as declared."""
        types = Resolver(self.definitions).types(variable.types)
        return self.names(sorted(self.members((types,))))

    # Facts and values.

    def relation(self, predicate: int, is_stored: bool = False) -> Relation:
        """Return the facts of a predicate; derived ones may be out of date."""
        if is_stored and predicate in self._stored:
            return self._stored[predicate]
        return self._relations[predicate]

    def rules(self, predicate: int) -> Rules | None:
        """Return the rules of a derived predicate."""
        return self._rules.get(predicate)

    def table(self, function: int) -> dict[Row, Value]:
        """Return the values of a function."""
        return self._tables[function]

    def add(self, predicate: int, row: Row) -> None:
        """Add a fact."""
        if self.relation(predicate, is_stored=True).add(row):
            self.touch((True, predicate))

    def remove(self, predicate: int, row: Row) -> None:
        """Remove a fact."""
        if self.relation(predicate, is_stored=True).discard(row):
            self.touch((True, predicate))

    def set(self, function: int, row: Row, value: Value | None) -> None:
        """Set the value of a fluent, or remove it with None."""
        if value is None:
            self.table(function).pop(row, None)
        else:
            self.table(function)[row] = value
        self.touch((False, function))

    def change(self, atom: tuple[bool, int, Row], value: Any, holds: bool = True) -> None:
        """Change a fact (True), or the value of a fluent, given as in a row of the store."""
        is_fact, owner, row = atom
        if is_fact:
            (self.add if holds else self.remove)(owner, row)
        elif not holds or isinstance(value, int):
            self.set(owner, row, value if holds else None)
        else:
            self.set(owner, row, Decimal(str(value)))

    def touch(self, head: Head) -> None:
        """Record that the facts of a predicate, or the values of a function, have changed."""
        own = self._rules.get(head[1]) if head[0] else None
        if own is not None:
            own.is_fresh = False
        for rules in self._dependants.get(head, ()):
            rules.is_fresh = False

    def facts(self) -> frozenset[tuple[int, Row]]:
        """Return the facts that hold without a rule."""
        heads = [*self._relations]
        return frozenset((one, row) for one in heads for row in self.relation(one, True).rows)

    def values(self) -> dict[FluentRow, Value]:
        """Return the values of all fluents."""
        tables = self._tables.items()
        return {(function, row): value for function, rows in tables for row, value in rows.items()}

    # Continuous change.

    def move(self, elapsed: Fraction) -> None:
        """Go to another time since the continuous change began."""
        self.elapsed = elapsed
        for function, _ in self.rates:
            self.touch((False, function))

    def linear(self, function: int, row: Row) -> Linear | None:
        """Return the value of a fluent as a linear function of the time since the change began."""
        value = self.table(function).get(row)
        if not isinstance(value, Decimal):
            return None
        return Linear(Fraction(value), self.rates.get((function, row), Fraction(0)))


def definitions_of(domain: Domain, problem: Problem) -> d.Definitions:
    """Return the definitions of documents, without actions and formulas, but with their rules."""
    types = {ROOT_TYPE: 0}
    for one in domain.types:
        for name in (one.name, *one.types):
            types.setdefault(fold(name), len(types))

    def ids(names: Iterable[str]) -> tuple[int, ...]:
        return tuple([types[fold(name)] for name in names])

    def parameters(variables: Iterable[TypedName]) -> tuple[ParameterDefinition, ...]:
        return tuple([ParameterDefinition(one.name, ids(one.types)) for one in variables])

    above = {fold(one.name): ids(one.types) for one in domain.types}
    objects = {one.name: one for one in (*domain.constants, *problem.objects)}
    made: tuple[list[Any], ...] = (
        [d.TypeDefinition(id_, name, *_first(above.get(name, ()))) for name, id_ in types.items()],
        [
            d.ObjectDefinition(number, one.name, *_first(ids(one.types)))
            for number, one in enumerate(objects.values())
        ],
        [
            d.PredicateDefinition(number, one.name, parameters(one.parameters))
            for number, one in enumerate(domain.predicates)
        ],
        [
            d.FunctionDefinition(number, one.name, parameters(one.parameters), ids(one.types))
            for number, one in enumerate(domain.functions)
        ],
    )
    elements = [
        d.Elements({fold(one.name): one.id for one in some}, {one.id: one for one in some})
        for some in made
    ]
    rest = [d.Elements[Any]() for _ in d.KINDS[len(elements) :]]
    definitions = d.Definitions(*elements, *rest)
    definitions.derived[DerivationRules] = DerivationRules(definitions, domain.derived)
    return definitions


def _first(ids: Sequence[int]) -> tuple[Any, tuple[int, ...]]:
    """Return the first of some types, and the others."""
    return (ids[0] if ids else None), tuple(ids[1:])


def fact_of(world: World, atom: Atom) -> FluentRow:
    """Return the ids of a ground atom."""
    predicate = world.definitions.predicates.ids[fold(atom.predicate)]
    return predicate, tuple([world.ids[str(term)] for term in atom.terms])


def value_of(world: World, fluent: Fluent, value: Expression | Term) -> tuple[int, Row, Value]:
    """Return the ids of a ground fluent, and its value."""
    function = world.definitions.functions.ids[fold(fluent.function)]
    row = tuple([world.ids[str(term)] for term in fluent.terms])
    return function, row, value.value if isinstance(value, Number) else world.ids[str(value)]


def fill(world: World, problem: Problem) -> None:
    """Add the initial state of a problem."""
    for atom in problem.facts:
        world.add(*fact_of(world, atom))
    for fluent, value in problem.values:
        world.set(*value_of(world, fluent, value))
