"""The literals on which the truth of a condition depends, in a state in memory.

A literal is used if it is in an instance of the condition and every part around it, up to the
condition, has the truth value by which it counts: all parts of a true conjunction and the false
parts of a false one, the true parts of a disjunction, each object for which a quantified part
counts. Atoms of derived predicates are followed through all instances of their rules, even if
several derive one fact. Any state with the same used literals satisfies the condition, whatever
else differs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from decimal import Decimal
from itertools import product
from typing import Any, NamedTuple

from ..dto.formulas import AT_END, AT_START
from ..errors import UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions
from ..knowledge.reads import head_of
from ..knowledge.rules import DerivationRules, rules_of
from .after import matched
from .derived import fitting
from .evaluate import Compiler, Env, Rows, Test
from .steps import CONTINUOUS, PreparedAction
from .world import Row, World


class Literal(NamedTuple):
    """A fact or a fluent (`is_fact` is False), and whether it holds, or has a value."""

    is_fact: bool
    owner: int
    row: Row
    holds: bool


def parts_used(action: PreparedAction, time: str) -> list[r.Part]:
    """Return the conditions at a time, and of its effects, with the numbers that these read."""
    return action.kept(("parts used", time), lambda: list(_parts_used(action, time)))


def _parts_used(action: PreparedAction, time: str) -> Iterator[r.Part]:
    yield action.condition(time)
    items = [*action.items(time)]
    if time == AT_END:
        with suppress(UnsupportedConstructError):  # Such a step can only be reported.
            items += action.items(CONTINUOUS)
    for item in items:
        part = item.condition
        if item.numbers:
            # This holds if the fluents have values.
            part = r.all_of([part, *(r.Compares("=", one, one) for one in item.numbers)])
        if part != r.TRUE:
            yield _of_effect(item.bound, part)
    # The start also decides on effects at the end.
    for item in action.items(AT_END) if action.is_durative and time == AT_START else ():
        if item.earlier != r.TRUE:
            yield _of_effect(item.bound, item.earlier)


def _of_effect(bound: tuple[r.Bound, ...], part: r.Part) -> r.Part:
    """Return what an effect used: all of it or nothing, as it takes place or does not."""
    return r.Witness(bound, part) if bound else r.AllOf((part,))


Given = Mapping[r.Place, int | None]


class RuleUse(NamedTuple):
    """A way in which a derived fact, or its absence, depends on a literal by one rule."""

    predicate: int
    holds: bool  # whether the body of the rule does
    parameters: tuple[r.Slot, ...]  # the objects of the literal
    row: tuple[r.Place, ...]  # the objects of the predicate
    bound: tuple[r.Bound, ...]  # the other variables
    part: r.Part  # the condition under which it does


def rule_uses(definitions: Definitions) -> Mapping[tuple[bool, int, bool], list[RuleUse]]:
    """Return how derived facts, or their absence, may depend on each literal, or derived atom."""
    rules, found = rules_of(definitions), defaultdict[Any, list[RuleUse]](list)
    # A condition may also negate a derived predicate that no rule negates.
    for predicate, holds in product(rules.component, (True, False)):
        for rule in rules.of(predicate):
            own = fitting(definitions, predicate, rule)
            for leaf, leaf_holds, bound, around in _paths(rule.body, holds):
                use = _rule_use(rules, (predicate, holds), leaf, own, (*own, *bound), around)
                head: Any = head_of(leaf)
                if not head[0]:
                    # It may have a value or not, under a negation or not.
                    found[*head, not leaf_holds].append(use)
                found[*head, leaf_holds].append(use)
    return found


def _paths(
    part: r.Part, holds: bool
) -> Iterator[tuple[Any, bool, tuple[r.Bound, ...], list[r.Part]]]:
    """Yield leaves that may be used, their truth, the variables around, and the conditions."""
    own = part if holds else r.negate(part)
    match part:
        case r.Lacks(inner):
            yield from _paths(inner, not holds)
        case r.AllOf() | r.OneOf() | r.Witness():
            bound = part.bound if isinstance(part, r.Witness) else ()
            # One true part of a disjunction is enough, one false part of a conjunction likewise.
            needed = [own] if isinstance(part, r.AllOf) == holds else []
            for one in r.inner_parts(part):
                for leaf, leaf_holds, within, around in _paths(one, holds):
                    yield leaf, leaf_holds, (*bound, *within), [*needed, *around]
        case _:
            for one in r.parts_of(part):
                if head_of(one):
                    yield one, holds, (), [own]


def _rule_use(
    rules: DerivationRules,
    head: tuple[int, bool],
    leaf: Any,
    parameters: Sequence[r.Bound],
    bound: Sequence[r.Bound],
    around: Sequence[r.Part],
) -> RuleUse:
    """Match the variables of a leaf to the objects of a literal."""
    given = tuple([r.Slot(next(rules.numbers)) for _ in leaf.terms])
    places, conditions, rest = matched(bound, zip(leaf.terms, given, strict=True))
    # A variable of a quantifier may be bound both around the leaf and within a part beside it.
    conditions += [r.replaced(one, {**places}, rules.numbers) for one in around]
    row = tuple([places.get(one.slot, one.slot) for one in parameters])
    return RuleUse(*head, given, row, rest, r.all_of(conditions))


def users_of(definitions: Definitions, literal: Literal) -> dict[Any, list[tuple[r.Part, Given]]]:
    """Return a literal and the atoms that may use it, with conditions; None for any object."""
    uses, pending = definitions.derive(rule_uses), [literal]
    found: dict[Any, list[tuple[r.Part, Given]]] = {literal: []}
    while pending:
        one: Any = pending.pop()
        for use in uses.get((one.is_fact, one.owner, one.holds), ()):
            if len(use.parameters) == len(one.row):
                given = dict[r.Place, int | None](zip(use.parameters, one.row, strict=True))
                row: Any = tuple([given.get(place) for place in use.row])
                user = Literal(True, use.predicate, row, use.holds)
                if user not in found:
                    found[user] = []
                    pending.append(user)
                found[user].append((use.part, given))
    return found


class _Compiled:
    """A part, with tests of all parts within it and searches for the objects of its variables."""

    def __init__(self, world: World, part: r.Part, parameters: Iterable[r.Slot]) -> None:
        self.part = part
        self.compiler = Compiler(world, parameters)
        self.tests: dict[int, Test] = {}
        self.rows: dict[int, Rows] = {}
        for inner in r.parts_of(part):
            if isinstance(inner, r.Witness):
                self.rows[id(inner)] = self.compiler.rows(inner.bound, inner.part)
            if isinstance(inner, r.Part):
                self.tests[id(inner)] = self.compiler.test(inner)


# A derived atom to follow: predicate, objects, and whether it holds.
_Pending = list[tuple[int, Row, bool]]


class Uses:
    """Finds the literals that conditions use in the present state of a world."""

    def __init__(self, world: World) -> None:
        self._world = world
        # Keeps the parts, too: an id could be reused once its object is gone.
        self._compiled: dict[int, _Compiled] = {}
        self._bodies: dict[int, list[tuple[_Compiled, tuple[r.Bound, ...]]]] = {}
        self._users: dict[int, Callable[[Row], set[Row]]] = {}

    def users(self, literal: Literal) -> Iterator[Literal]:
        """Yield the derived facts that use a literal, by each instance of each rule."""
        seen, pending, uses = {literal}, [literal], self._world.definitions.derive(rule_uses)
        while pending:
            one = pending.pop()
            for use in uses.get((one.is_fact, one.owner, one.holds), ()):
                for row in self._rows(use)(one.row) if len(use.parameters) == len(one.row) else ():
                    user = Literal(True, use.predicate, row, use.holds)
                    if user not in seen:
                        seen.add(user)
                        pending.append(user)
                        if user.holds:
                            yield user

    def _rows(self, use: RuleUse) -> Callable[[Row], set[Row]]:
        """Return a function from the objects of a literal to those of the predicate."""
        found = self._users.get(id(use))
        if found is None:
            compiler = Compiler(self._world, use.parameters)
            search, pick = compiler.search(use.bound, use.part), compiler.picker(use.row)
            found = self._users[id(use)] = lambda row: {
                pick(env) for env in [compiler.env(row)] for _ in search(env)
            }
        return found

    def of(
        self,
        part: r.Part,
        parameters: Sequence[r.Slot] = (),
        arguments: Row = (),
        duration: Decimal | None = None,
    ) -> Iterator[Literal]:
        """Yield the literals that a part uses; for a false conjunction, those of its true parts."""
        compiled = self._compile(part, parameters)
        env = compiled.compiler.env(arguments, duration)
        pending: _Pending = []
        conjuncts = part.parts if isinstance(part, r.AllOf) else (part,)
        for one in conjuncts:
            if compiled.tests[id(one)](env):
                yield from _walk(compiled, one, env, True, pending)
        seen = {*pending}
        while pending:
            predicate, row, holds = pending.pop()
            for body, bound in self._rules(predicate):
                fits = zip(row, bound, strict=True)
                if not all(id_ in self._world.members(one.types) for id_, one in fits):
                    continue
                env, found = body.compiler.env(row), _Pending()
                if body.tests[id(body.part)](env) == holds:
                    yield from _walk(body, body.part, env, holds, found)
                pending += [one for one in dict.fromkeys(found) if one not in seen]
                seen.update(found)

    def _compile(self, part: r.Part, parameters: Sequence[r.Slot]) -> _Compiled:
        found = self._compiled.get(id(part))
        if found is None:
            found = self._compiled[id(part)] = _Compiled(self._world, part, parameters)
        return found

    def _rules(self, predicate: int) -> list[tuple[_Compiled, tuple[r.Bound, ...]]]:
        """Return the bodies of the rules of a predicate, with the types of their parameters."""
        found = self._bodies.get(predicate)
        if found is None:
            definitions, found = self._world.definitions, []
            for rule in rules_of(definitions).of(predicate):
                own = fitting(definitions, predicate, rule)
                found.append((_Compiled(self._world, rule.body, [one.slot for one in own]), own))
            self._bodies[predicate] = found
        return found


def _walk(
    compiled: _Compiled, part: r.Part, env: Env, holds: bool, pending: _Pending
) -> Iterator[Literal]:
    """Yield the literals by which a part holds or fails; collect atoms that rules may derive."""
    match part:
        case r.Lacks(inner):
            yield from _walk(compiled, inner, env, not holds, pending)
        case r.AllOf(parts) | r.OneOf(parts):
            for one in parts:
                if compiled.tests[id(one)](env) == holds:
                    yield from _walk(compiled, one, env, holds, pending)
        case r.Witness(bound, inner):
            # Inner searches also change the environment.
            members = compiled.compiler.world.members
            every = product(*(members(one.types) for one in bound))
            places = [compiled.compiler.at(one.slot) for one in bound]
            for row in compiled.rows[id(part)](env.copy()) if holds else every:
                own = env.copy()
                for place, id_ in zip(places, row, strict=True):
                    own[place] = id_
                yield from _walk(compiled, inner, own, holds, pending)
        case _:
            yield from _leaf(compiled, part, env, holds, pending)


def _leaf(
    compiled: _Compiled, part: r.Part, env: Env, holds: bool, pending: _Pending
) -> Iterator[Literal]:
    """Yield the literals of a leaf."""
    for one in r.parts_of(part):
        if not isinstance(one, r.HoldsFact | r.NumberOf | r.FluentIs):
            continue
        row = compiled.compiler.picker(one.terms)(env)
        if isinstance(one, r.HoldsFact):
            yield Literal(True, one.predicate, row, holds)
            if not one.is_stored:
                pending.append((one.predicate, row, holds))
        else:
            has_value = row in compiled.compiler.world.table(one.function)
            yield Literal(False, one.function, row, has_value)
