"""Resolved conditions and numbers, compiled for a world in memory.

What `sql.condition_writer` writes as SQL becomes a closure here. `Witness` is a search for objects:
a nested loop over facts of the positive atoms in its conjunction, those with the most known terms
first, and over the objects of a type if no atom is left; each other part is tested as soon as its
variables have objects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from decimal import Decimal
from fractions import Fraction
from itertools import islice
from typing import Any, NamedTuple

from ..dto import formulas as f
from ..errors import UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.grounding import Binding
from .arithmetic import EXACT, LINEARS, Exact, Linear, Numbers, decimal_of
from .world import Relation, Row, World, picker

# The objects of variables and constants, and the duration, by position.
Env = list[Any]
Test = Callable[[Env], bool]
Number = Callable[[Env, Numbers[Any]], Any]
# Yields once for each solution, whose objects are then in the environment.
Search = Callable[[Env], Iterator[None]]
Rows = Callable[[Env], set[Row]]
# An atom of a conjunction, and the other facts to read it from.
Delta = tuple[r.Part, Relation] | None

_DURATION = 0
_Types = dict[r.Slot, tuple[r.TypeSet, ...]]


def alternatives(bound: Iterable[r.Bound], part: r.Part) -> list[tuple[_Types, tuple[r.Part, ...]]]:
    """Return the conjunctions of a disjunction, each with its variables; or the part itself."""
    variables = {each.slot: each.types for each in bound}
    while isinstance(part, r.Witness):
        variables.update({each.slot: each.types for each in part.bound})
        part = part.part
    if not isinstance(part, r.OneOf):
        return [(variables, part.parts if isinstance(part, r.AllOf) else (part,))]
    return [
        (variables | more, parts) for one in part.parts for more, parts in alternatives((), one)
    ]


class Compiler:
    """Compiles parts whose variables share an environment; evaluations give `parameters`."""

    def __init__(self, world: World, parameters: Iterable[r.Slot] = ()) -> None:
        self.world = world
        self.template: Env = [None]
        self._places: dict[r.Place, int] = {}
        self._parameters = [self.at(slot) for slot in parameters]

    def env(self, arguments: Sequence[int] = (), duration: Decimal | None = None) -> Env:
        """Return the initial environment of an evaluation."""
        env = self.template.copy()
        env[_DURATION] = duration
        env[1 : len(arguments) + 1] = arguments
        return env

    def at(self, place: r.Place) -> int:
        """Return the position of an object in the environment."""
        found = self._places.get(place)
        if found is None:
            found = self._places[place] = len(self.template)
            self.template.append(place.id if isinstance(place, r.Known) else None)
        return found

    def picker(self, terms: Iterable[r.Place]) -> Callable[[Env], Row]:
        """Return a function that picks objects from the environment."""
        return picker(tuple([self.at(term) for term in terms]))

    # Tests.

    def test(self, part: r.Part) -> Test:
        """Compile the test of a part whose variables have objects."""
        match part:
            case r.HoldsFact():
                return self._fact(part)
            case r.FluentIs(function, terms, value):
                table, pick, at = self.world.table(function), self.picker(terms), self.at(value)
                return lambda env: table.get(pick(env)) == env[at]
            case r.SameObject(left, right):
                first, second = self.at(left), self.at(right)
                return lambda env: bool(env[first] == env[second])
            case r.HasType(term, types):
                members, at = self.world.members((types,)), self.at(term)
                return lambda env: env[at] in members
            case r.Compares():
                return self._compares(part)
            case r.Lacks(inner):
                test = self.test(inner)
                return lambda env: not test(env)
            case r.AllOf(parts):
                return _joined([self.test(each) for each in parts], False)
            case r.OneOf(parts):
                return _joined([self.test(each) for each in parts], True)
            case r.Witness(bound, inner):
                search = self.search(bound, inner)
                return lambda env: next(search(env), True) is None

    def _fact(self, fact: r.HoldsFact) -> Test:
        pick, world = self.picker(fact.terms), self.world
        rows = world.relation(fact.predicate, fact.is_stored).rows
        rules = None if fact.is_stored else world.rules(fact.predicate)
        if rules is None:
            return lambda env: pick(env) in rows
        its = rules

        def derived(env: Env) -> bool:
            if not its.is_fresh:
                its.refresh()
            return pick(env) in rows

        return derived

    def _compares(self, part: r.Compares) -> Test:
        compare = r.COMPARE[part.operator]
        left, right = self.number(part.left), self.number(part.right)
        world = self.world

        def test(env: Env) -> bool:
            if world.rates:
                return _compare_linear(world, part.operator, left, right, env)
            first, second = left(env, EXACT), right(env, EXACT)
            return first is not None and second is not None and compare(first, second)

        return test

    # Searches.

    def search(self, bound: Iterable[r.Bound], part: r.Part, delta: Delta = None) -> Search:
        """Compile a search for the objects of variables, which yields for each solution."""
        # Skip alternatives without the atom of the delta.
        searches = [
            self._join(variables, parts, delta)
            for variables, parts in alternatives(bound, part)
            if delta is None or any(each is delta[0] for each in parts)
        ]
        if len(searches) == 1:
            return searches[0]

        def union(env: Env) -> Iterator[None]:
            for search in searches:
                yield from search(env)

        return union

    def rows(self, bound: Sequence[r.Bound], part: r.Part) -> Rows:
        """Compile the query for the objects of variables for which a part holds."""
        search, pick = self.search(bound, part), self.picker([each.slot for each in bound])
        # Without variables, one solution is enough, however many there are inside `exists`.
        most = None if bound else 1
        return lambda env: {pick(env) for _ in islice(search(env), most)}

    def counterexamples(
        self, resolver: r.Resolver, variables: Sequence[f.TypedName], formula: f.Formula
    ) -> tuple[r.Witness, Rows]:
        """Make the condition that a formula fails for some objects; compile the query for them."""
        with resolver.within(variables) as bound:
            part = r.negate(resolver.part(formula))
        return r.Witness(bound, part), self.rows(bound, part)

    def _join(self, unbound: _Types, parts: Sequence[r.Part], delta: Delta) -> Search:
        """Compile a nested loop over a conjunction."""
        rest = [_Conjunct(each, r.slots_of(each)) for each in parts]
        steps: list[_Step] = []
        tests = self._ready(rest, unbound)
        while unbound:
            step = self._chosen(rest, unbound, delta) or self._all_objects(rest, unbound)
            steps.append(step._replace(tests=tuple(self._ready(rest, unbound))))
        return _loop(tuple(tests), tuple(steps))

    def _ready(self, rest: list[_Conjunct], unbound: _Types) -> list[Test]:
        """Compile and remove the parts whose variables all have objects."""
        ready = [each.part for each in rest if each.free.isdisjoint(unbound)]
        rest[:] = [each for each in rest if not each.free.isdisjoint(unbound)]
        ready.sort(key=_is_slow)
        return [self.test(part) for part in ready]

    def _chosen(self, rest: list[_Conjunct], unbound: _Types, delta: Delta) -> _Step | None:
        """Choose the next atom or fluent to loop over."""
        ranks: dict[int, tuple[int, int]] = {}
        for place, (part, _) in enumerate(rest):
            is_delta = delta is not None and part is delta[0]
            if is_delta or (isinstance(part, r.FluentIs) and unbound.keys().isdisjoint(part.terms)):
                ranks[place] = (0, 0)
            elif isinstance(part, r.HoldsFact):
                known = sum(term not in unbound for term in part.terms)
                ranks[place] = (len(part.terms) - known, -known)
        if not ranks:
            return None
        part = rest.pop(min(ranks, key=ranks.__getitem__)).part
        if isinstance(part, r.FluentIs):
            return self._value(part, unbound)
        assert isinstance(part, r.HoldsFact)
        return self._scan(part, unbound, delta)

    def _all_objects(self, rest: Sequence[_Conjunct], unbound: _Types) -> _Step:
        """Loop over the objects of a variable, preferably not one that a fluent gives."""
        values = {each.part.value for each in rest if isinstance(each.part, r.FluentIs)}
        members = self.world.members
        slot = min(unbound, key=lambda one: (one in values, len(members(unbound[one]))))
        rows = [(id_,) for id_ in sorted(members(unbound.pop(slot)))]
        return _Step(lambda env: rows, (0,), (self.at(slot),), ())

    def _value(self, part: r.FluentIs, unbound: _Types) -> _Step:
        """Look up the value of a fluent."""
        assert isinstance(part.value, r.Slot)
        function = self.world.definitions.functions.live(part.function)
        own = r.closure(self.world.definitions, function.type_ids)
        members = self._misfits(unbound.pop(part.value), own)
        table, pick = self.world.table(part.function), self.picker(part.terms)

        def rows(env: Env) -> Collection[Row]:
            value = table.get(pick(env))
            if not isinstance(value, int) or (members is not None and value not in members):
                return ()
            return ((value,),)

        return _Step(rows, (0,), (self.at(part.value),), ())

    def _misfits(self, wanted: tuple[r.TypeSet, ...], own: r.TypeSet) -> frozenset[int] | None:
        """Return the objects that fit all wanted types; None if those of the own type do anyway."""
        left = tuple(
            [each for each in wanted if each is not None and (own is None or not own <= each)]
        )
        return self.world.members(left) if left else None

    def _scan(self, atom: r.HoldsFact, unbound: _Types, delta: Delta) -> _Step:
        """Compile a loop over the facts of an atom; from then on, its variables have objects."""
        world, definitions = self.world, self.world.definitions
        known = tuple([at for at, term in enumerate(atom.terms) if term not in unbound])
        declared = definitions.predicates.live(atom.predicate).parameters
        targets: dict[r.Slot, int] = {}
        repeated: list[tuple[int, int]] = []
        kinds: list[tuple[int, frozenset[int]]] = []
        for at, term in enumerate(atom.terms):
            if not isinstance(term, r.Slot) or term not in unbound:
                continue
            if term in targets:
                repeated.append((targets[term], at))
                continue
            targets[term] = at
            members = self._misfits(unbound[term], r.closure(definitions, declared[at].type_ids))
            if members is not None:
                kinds.append((at, members))
        for slot in targets:
            del unbound[slot]
        is_delta = delta is not None and atom is delta[0]
        relation = (
            delta[1] if delta and is_delta else world.relation(atom.predicate, atom.is_stored)
        )
        rules = None if is_delta or atom.is_stored else world.rules(atom.predicate)
        find, pick = relation.lookup(known), self.picker([atom.terms[at] for at in known])

        def rows(env: Env) -> Collection[Row]:
            if rules is not None and not rules.is_fresh:
                rules.refresh()
            return _fitting(find(pick(env)), repeated, kinds)

        slots = tuple([self.at(slot) for slot in targets])
        return _Step(rows, tuple(targets.values()), slots, ())

    # Numbers.

    def number(self, quantity: r.Quantity, needed: r.Needed | None = None) -> Number:
        """Compile a number, with its needed objects; the number is None if it has no value."""
        number = self._number(quantity)
        if needed is None or not needed.bound:
            return number
        search = self.search(needed.bound, r.all_of(needed.needed))

        def found(env: Env, numbers: Numbers[Any]) -> Any:
            return next((number(env, numbers) for _ in search(env)), None)

        return found

    def _number(self, quantity: r.Quantity) -> Number:
        if isinstance(quantity, Decimal):
            return lambda env, numbers: numbers.of(quantity)
        if isinstance(quantity, r.NumberOf):
            return self._fluent(quantity)
        if isinstance(quantity, r.Operation):
            operands = [self._number(each) for each in quantity.operands]
            symbol = quantity.operator
            return lambda env, numbers: numbers.calculate(
                symbol, [each(env, numbers) for each in operands]
            )
        return self._parameter(quantity.name)

    def _parameter(self, name: str) -> Number:
        world = self.world
        if name == "#t":
            return _continuous_time
        if name == f.TOTAL_TIME:
            return lambda env, numbers: numbers.of(world.total_time)
        if name == f.DURATION:
            return lambda env, numbers: (
                None if env[_DURATION] is None else numbers.of(env[_DURATION])
            )
        preference = name.partition("is-violated ")[2]
        return lambda env, numbers: numbers.of(Decimal(world.violations.get(preference, 0)))

    def _fluent(self, fluent: r.NumberOf) -> Number:
        world, function = self.world, fluent.function
        table, pick = world.table(function), self.picker(fluent.terms)

        def value(env: Env, numbers: Numbers[Any]) -> Any:
            row = pick(env)
            if numbers is LINEARS:
                return world.linear(function, row)
            found = table.get(row)
            if found is None:
                return None
            if world.rates and (function, row) in world.rates:
                linear = world.linear(function, row)
                found = linear and decimal_of(linear.at(world.elapsed))
            return numbers.of(found)  # type: ignore[arg-type]

        return value


class _Conjunct(NamedTuple):
    """A part of a conjunction, and its free variables."""

    part: r.Part
    free: set[r.Slot]


class _Step(NamedTuple):
    """A loop: rows, the positions of new objects in them, their positions, and its tests."""

    rows: Callable[[Env], Collection[Row]]
    positions: tuple[int, ...]
    slots: tuple[int, ...]
    tests: tuple[Test, ...]


def _is_slow(part: r.Part) -> bool:
    return not isinstance(
        part.part if isinstance(part, r.Lacks) else part, r.HoldsFact | r.SameObject
    )


def _joined(tests: Sequence[Test], decides: bool) -> Test:
    """Test a disjunction (`decides` is True) or a conjunction (False)."""
    if len(tests) == 2:
        first, second = tests
        if decides:
            return lambda env: first(env) or second(env)
        return lambda env: first(env) and second(env)

    def test(env: Env) -> bool:
        for each in tests:
            if each(env) is decides:
                return decides
        return not decides

    return test


def _fitting(
    rows: Collection[Row],
    repeated: list[tuple[int, int]],
    kinds: list[tuple[int, frozenset[int]]],
) -> Collection[Row]:
    """Return the rows with equal objects at some positions, and objects of types at others."""
    if not repeated and not kinds:
        return rows
    return [
        row
        for row in rows
        if all(row[one] == row[other] for one, other in repeated)
        and all(row[at] in members for at, members in kinds)
    ]


def _loop(tests: tuple[Test, ...], steps: tuple[_Step, ...]) -> Search:
    """Return a nested loop that uses an explicit stack."""
    is_possible = _joined(tests, False)

    def run(env: Env) -> Iterator[None]:
        if not is_possible(env):
            return
        if not steps:
            yield None
            return
        depth = len(steps)
        stack = [iter(steps[0].rows(env))]
        while stack:
            row = next(stack[-1], None)
            if row is None:
                stack.pop()
                continue
            step = steps[len(stack) - 1]
            for position, slot in zip(step.positions, step.slots, strict=True):
                env[slot] = row[position]
            for test in step.tests:
                if not test(env):
                    break
            else:
                if len(stack) == depth:
                    yield None
                else:
                    stack.append(iter(steps[len(stack)].rows(env)))

    return run


def _continuous_time(env: Env, numbers: Numbers[Any]) -> Any:
    del env
    if numbers is not LINEARS:
        raise UnsupportedConstructError(
            "#t is not a number; it belongs to a continuous effect such as "
            "(increase (fuel) (* #t 2))"
        )
    return Linear(Fraction(0), Fraction(1))


def _compare_linear(world: World, operator: str, left: Number, right: Number, env: Env) -> bool:
    """Compare while numbers change; record the time at which the sides are equal."""
    first, second = left(env, LINEARS), right(env, LINEARS)
    if first is None or second is None:
        return False
    difference = LINEARS.apply("-", first, second)
    assert difference is not None
    if difference.rate:
        world.roots.add(-difference.value / difference.rate)
    return r.COMPARE[operator](difference.at(world.elapsed), Fraction(0))


class Conditions:
    """The formulas of one world, each compiled once."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._compiled: dict[tuple[int, tuple[str, ...]], tuple[f.Node, Compiler, Any]] = {}

    def holds(
        self, formula: f.Formula, binding: Binding | None = None, duration: Decimal | None = None
    ) -> bool:
        """Return whether a formula holds now; preferences in it always hold."""
        test, env = self._get(formula, binding or {}, duration)
        return bool(test(env))

    def exact_number(
        self, expression: f.Expression, binding: Binding, duration: Decimal | None = None
    ) -> Exact | None:
        """Return the value of an expression now; None without one."""
        run, env = self._get(expression, binding, duration)
        found: Exact | None = run(env, EXACT)
        return found

    def _get(
        self, node: f.Node, binding: Binding, duration: Decimal | None
    ) -> tuple[Callable[..., Any], Env]:
        key = id(node), tuple(binding)
        found = self._compiled.get(key)
        if found is None:
            # Keep the node: its id could be reused once it is gone.
            found = self._compiled[key] = (node, *self._compile(node, key[1]))
        ids = self.world.ids
        return found[2], found[1].env([ids[name] for name in binding.values()], duration)

    def _compile(self, node: f.Node, names: Iterable[str]) -> tuple[Compiler, Any]:
        resolver = r.Resolver(self.world.definitions)
        slots = {name: resolver.slot() for name in names}
        for name, slot in slots.items():
            resolver.bind(name, slot)
        compiler = Compiler(self.world, slots.values())
        if isinstance(node, f.Expression):
            return compiler, compiler.number(*resolver.number(node))
        return compiler, compiler.test(resolver.part(node))
