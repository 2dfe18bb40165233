"""Actions of a world in memory: their conditions, their effects, and which of them interfere.

The semantics is that of PDDL 2.1 (Fox and Long, Journal of Artificial Intelligence Research 20,
2003): all conditions and right-hand sides are evaluated in the state before (definition 13),
deletes come before adds, and a durative action is two instantaneous ones with an invariant and
continuous change between them (definition 18). Two actions at one time may not interfere
(definition 12): neither adds or deletes a fact that the other reads or changes the opposite way,
and neither changes a number that the other reads or changes, unless both increase or decrease it.
As in VAL, only conditional effects that take place count.

An effect on a fluent without a value is undefined and fails, except for `assign`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise
from typing import Any, NamedTuple

from ..dto import formulas as f
from ..dto.lexical import fold
from ..knowledge import resolved as r
from ..knowledge.grounding import Binding, bound, substitute
from ..knowledge.reads import Reading, read_by
from ..knowledge.rules import rules_of
from ..pddl.cursor import hint
from ..pddl.document import Action
from .arithmetic import ADDITIVE, CHANGES, EXACT, LINEARS, Exact, Linear, decimal_of
from .evaluate import Compiler, Env, Rows, Search
from .failures import (
    BY_ZERO,
    NO_OBJECT,
    NO_VALUE,
    UNDEFINED,
    FailedCondition,
    duration_failure,
    failed_parts,
)
from .steps import CONTINUOUS, EffectItem, PreparedAction
from .world import FluentRow, Row, World


class Update(NamedTuple):
    """A change of a fluent: `assign` and the like, with the value of the right-hand side."""

    operator: str
    value: Exact | int


@dataclass
class Changes:
    """The changes of an action at one time; `undefined` are effects without a result."""

    deletes: set[FluentRow] = field(default_factory=set)
    adds: set[FluentRow] = field(default_factory=set)
    updates: dict[FluentRow, list[Update]] = field(default_factory=dict)
    undefined: list[FailedCondition] = field(default_factory=list)


class _CompiledEffect:
    """A single effect, with the search for its objects."""

    def __init__(self, world: World, action: PreparedAction, item: EffectItem) -> None:
        self._world, self._item = world, item
        compiler = self._compiler = _compiler(world, action)
        self._search = compiler.search(item.bound, item.condition)
        self._objects = compiler.picker([each.slot for each in item.bound])
        self._around = compiler.picker([each.slot for each in item.around])
        self._row = compiler.picker(item.terms)
        self._value = _value(compiler, item.value)
        self._lacking: Search | None = None
        if item.lacking != r.FALSE:
            self._lacking = compiler.search(item.around, item.lacking)
        self._early: Rows | None = None
        if item.earlier != r.TRUE:
            self._early = compiler.rows(item.around, item.earlier)

    def remember(self, snap: Snap) -> set[Row] | None:
        """Return the objects for which the conditions at start hold; None without conditions."""
        if self._early is None:
            return None
        return self._early(self._compiler.env(snap.arguments, snap.duration))

    def collect(self, snap: Snap, remembered: set[Row] | None) -> None:
        """Add the changes of the effect."""
        env, changes = self._compiler.env(snap.arguments, snap.duration), snap.changes
        if self._lacking is not None:
            for _ in self._lacking(env):
                if remembered is None or self._around(env) in remembered:
                    changes.undefined.append(FailedCondition(str(self._item.node), NO_OBJECT))
        seen: set[Row] = set()
        for _ in self._search(env):
            # Alternatives of a disjunction may find the same objects.
            row = self._objects(env)
            if row not in seen and (remembered is None or self._around(env) in remembered):
                seen.add(row)
                self._apply(env, changes)

    def _apply(self, env: Env, changes: Changes) -> None:
        item, row = self._item, self._row(env)
        if item.operator == "delete":
            changes.deletes.add((item.head, row))
        elif item.operator == "add":
            changes.adds.add((item.head, row))
        else:
            self._update(row, self._value(env), changes)

    def _update(self, row: Row, value: Exact | int | None, changes: Changes) -> None:
        item, failed = self._item, None
        if value is None:
            failed = f"({item.operator} {self._fluent(row)} ...)", UNDEFINED
        elif item.operator != "assign" and row not in self._world.table(item.head):
            text = self._fluent(row)
            # As in `combined`.
            failed = None if fold(text) == f"({f.TOTAL_COST})" else (text, NO_VALUE)
        elif item.operator == "scale-down" and not value:
            failed = self._fluent(row), BY_ZERO
        if failed is not None:
            changes.undefined.append(FailedCondition(*failed))
        elif value is not None:
            changes.updates.setdefault((item.head, row), []).append(Update(item.operator, value))

    def _fluent(self, row: Row) -> str:
        return self._world.text((False, self._item.head), row)


def _compiler(world: World, action: PreparedAction) -> Compiler:
    return Compiler(world, [each.slot for each in action.parameters])


def _value(compiler: Compiler, value: r.Quantity | r.Place | None) -> Callable[[Env], Any]:
    """Compile the right-hand side of an assignment."""
    if value is None:
        return lambda env: None
    if isinstance(value, r.Slot | r.Known):
        at = compiler.at(value)
        return lambda env: env[at]
    number = compiler.number(value)
    return lambda env: number(env, EXACT)


class Phase:
    """The conditions, effects and reads of an action at one time: at start, at end, or at once."""

    def __init__(self, world: World, action: PreparedAction, time: str) -> None:
        self._world, self._action, self._time = world, action, time
        self.condition = action.condition(time)
        self._compiler = _compiler(world, action)
        self._holds = self._compiler.test(self.condition)
        items = action.items(time)
        self.effects = [_CompiledEffect(world, action, item) for item in items]
        self._limits = [*self._durations()]
        self._preferences = [*self._preferred()]
        self.reads: list[r.Part | r.Quantity] = [self.condition]
        self.reads += [each for limit in self._limits for each in limit.reads]
        self.reads += [part for _, part, _ in self._preferences]
        for item in items:
            self.reads.append(item.condition)
            if not isinstance(item.value, r.Slot | r.Known | None):
                self.reads.append(item.value)
        if time == f.AT_START and action.is_durative:
            # The conditions at the start of effects at the end are read at the start.
            self.reads += [item.earlier for item in action.items(f.AT_END)]

    def _durations(self) -> Iterator[_Limit]:
        resolver, compiler = self._action.resolver, self._compiler
        for constraint in self._action.constraints(self._time) if self._action.is_durative else ():
            sides = [resolver.number(side) for side in (constraint.left, constraint.right)]
            reads = [part for number, needed in sides for part in (number, *needed.needed)]
            left, right = (compiler.number(*side) for side in sides)
            yield _Limit(constraint, left, right, reads)

    def _preferred(self) -> Iterator[tuple[str | None, r.Part, Rows]]:
        """Yield preferences, each with a search for the objects that violate it."""
        compile_ = self._compiler.counterexamples
        for name, variables, formula in self._action.preferences(self._time):
            yield name, *compile_(self._action.resolver, variables, formula)

    def unmet(self, snap: Snap) -> list[FailedCondition]:
        """Return the conditions, and the constraints on the duration, that do not hold."""
        env, found, binding = self._compiler.env(snap.arguments, snap.duration), [], snap.binding
        # Without a given duration, nothing depends on it.
        for limit in self._limits if snap.duration is not None else ():
            sides = [limit.left(env, EXACT), limit.right(env, EXACT)]
            left, right = (None if side is None else decimal_of(side) for side in sides)
            found += duration_failure(substitute(limit.constraint, binding), left, right)
        if not self._holds(env):
            for node in self._action.nodes(self._time):
                found += failed_parts(self._world, node, binding, snap.duration)
        return found

    def violated(self, arguments: Sequence[int]) -> Iterator[str | None]:
        """Yield the name of a preference for each of its violations."""
        env = self._compiler.env(arguments)
        for name, _, rows in self._preferences:
            yield from [name] * len(rows(env))


class _Limit(NamedTuple):
    """A constraint on the duration."""

    constraint: f.Comparison
    left: Callable[..., Any]
    right: Callable[..., Any]
    reads: list[r.Part | r.Quantity]


class _Continuous:
    """A continuous effect: the rate at which fluents change while an action is running."""

    def __init__(self, world: World, action: PreparedAction, item: EffectItem) -> None:
        assert isinstance(item.value, r.Operation)
        self._item = item
        compiler = self._compiler = _compiler(world, action)
        self._search = compiler.search(item.bound, item.condition)
        self._row = compiler.picker(item.terms)
        # The value is the rate times the duration.
        self._rate = compiler.number(item.value.operands[0])
        self._sign = 1 if item.operator == "increase" else -1

    def rates(self, snap: Snap) -> Iterator[tuple[FluentRow, Fraction]]:
        """Yield the rate of each fluent; refuse change that is not linear in time."""
        env = self._compiler.env(snap.arguments, snap.duration)
        for _ in self._search(env):
            rate = self._rate(env, LINEARS)
            if rate is not None:
                change = LINEARS.apply("*", Linear(Fraction(0), Fraction(1)), rate)
                assert change is not None
                yield (self._item.head, self._row(env)), self._sign * change.rate


class Schema:
    """An action, compiled for a world."""

    def __init__(self, world: World, node: Action) -> None:
        """Compile an action of a document."""
        self._world = world
        action = self.action = PreparedAction(world.definitions, node)
        self._durative = (f.AT_START, f.AT_END) if action.is_durative else ()
        # The phases at its times; the time of an instantaneous action is None.
        self.phases: dict[str | None, Phase] = {
            time: Phase(world, action, time) for time in self._durative
        } or {None: Phase(world, action, f.AT_START)}
        items = action.items(CONTINUOUS) if action.is_durative else ()
        self.continuous = [_Continuous(world, action, item) for item in items]
        self._compiler = _compiler(world, action)
        always = action.condition(f.OVER_ALL) if action.is_durative else r.TRUE
        self._is_kept = self._compiler.test(always)

    def broken(self, snap: Snap) -> list[FailedCondition]:
        """Return the conditions over all that do not hold."""
        if self._is_kept(self._compiler.env(snap.arguments, snap.duration)):
            return []
        nodes = self.action.nodes(f.OVER_ALL)
        parts = [failed_parts(self._world, one, snap.binding, snap.duration) for one in nodes]
        return [failed for found in parts for failed in found]

    def misfit(self, world: World, names: Sequence[str]) -> FailedCondition | None:
        """Return why names are not valid arguments of the action, or None."""
        variables = self.action.variables
        text = f"({' '.join((self.action.name, *names))})"
        if len(names) != len(variables):
            needs = f"{self.action.name} has {len(variables)} parameters"
            return FailedCondition(text, f"{needs}, and {len(names)} arguments are given")
        for name, variable, own in zip(names, variables, self.action.parameters, strict=True):
            known = world.object(name)
            if known is None:
                near = hint(name, [one.name for one in world.definitions.objects])
                return FailedCondition(text, f"there is no object {name}{near}")
            if known not in world.members(own.types):
                wanted = f"?{variable.name} is of type {variable.type_text}"
                [spelled] = world.names([known])
                return FailedCondition(text, f"{spelled} does not fit: {wanted}")
        return None


@dataclass(eq=False)
class Snap:
    """A ground action at one of its times."""

    world: World
    schema: Schema
    arguments: Row
    time: str | None  # its time in the action; None for an instantaneous action
    position: int  # the position of its step in the plan
    duration: Decimal | None
    # The objects for which the start conditions of the effects at the end held.
    memory: dict[int, set[Row]]
    changes: Changes = field(default_factory=Changes)  # its changes; computed by `prepare`

    @property
    def phase(self) -> Phase:
        """The conditions and effects of the action at that time."""
        return self.schema.phases[self.time]

    @property
    def binding(self) -> Binding:
        """The names of the objects of the action's parameters."""
        return bound(self.schema.action.variables, self.world.names(self.arguments))

    def prepare(self) -> list[FailedCondition]:
        """Compute the changes in the present state; return the reasons if this is impossible."""
        self.changes = Changes()
        for number, effect in enumerate(self.phase.effects):
            remembered = self.memory.get(number) if self.time == f.AT_END else None
            effect.collect(self, remembered)
        if self.time == f.AT_START:
            for number, effect in enumerate(self.schema.phases[f.AT_END].effects):
                found = effect.remember(self)
                if found is not None:
                    self.memory[number] = found
        return self.changes.undefined

    def conflicts(self) -> list[FailedCondition]:
        """Return the fluents that effects of the action change in conflicting ways."""
        return [
            FailedCondition(
                self.world.text((False, function), row), "two effects of the action change it"
            )
            for (function, row), updates in self.changes.updates.items()
            if len(updates) > 1 and any(one.operator not in ADDITIVE for one in updates)
        ]

    def reads(self) -> list[Reading[frozenset[int]]]:
        """Return the facts and fluents that it reads, each argument as a set of objects."""
        world, parameters = self.world, self.schema.action.parameters
        given = {
            each.slot: frozenset((id_,))
            for each, id_ in zip(parameters, self.arguments, strict=True)
        }
        return read_by(
            rules_of(world.definitions),
            self.phase.reads,
            given,
            lambda id_: frozenset((id_,)),
            lambda each: world.members(each.types),
        )


def interference(
    world: World, mine: Changes, reads: Sequence[Reading[frozenset[int]]], others: Changes
) -> FailedCondition | None:
    """Return a simultaneous change by others that conflicts with this action, or None."""

    def about(found: Sequence[tuple[bool, FluentRow]], reason: str) -> FailedCondition:
        return FailedCondition(
            min(world.text((is_fact, head), row) for is_fact, (head, row) in found), reason
        )

    facts = (mine.adds & others.deletes) | (mine.deletes & others.adds)
    if facts:
        reason = "of two actions at the same time, one adds it and one deletes it"
        return about([(True, fact) for fact in facts], reason)
    for fluent, updates in mine.updates.items():
        both = [*updates, *others.updates.get(fluent, ())]
        if fluent in others.updates and any(one.operator not in ADDITIVE for one in both):
            return about([(False, fluent)], "two actions at the same time change it")
    changed = [(True, fact) for fact in others.adds | others.deletes]
    changed += [(False, fluent) for fluent in others.updates]
    for *head, pattern in reads:
        found = [
            (is_fact, (id_, row))
            for is_fact, (id_, row) in changed
            if [is_fact, id_] == head
            and all(own is None or one in own for one, own in zip(row, pattern, strict=True))
        ]
        if found:
            return about(found, "an action reads it at the same time as another changes it")
    return None


def apply_changes(world: World, changes: Sequence[Changes]) -> None:
    """Apply the changes of actions at one time: deletes, then adds, then updates."""
    updates: dict[FluentRow, Exact | int] = {}
    for one in changes:
        for fluent, several in one.updates.items():
            value = updates.get(fluent, world.table(fluent[0]).get(fluent[1]))
            for update in several:
                value = _updated(update, value)
            assert value is not None
            updates[fluent] = value
    for one in changes:
        for predicate, row in one.deletes:
            world.remove(predicate, row)
    for one in changes:
        for predicate, row in one.adds:
            world.add(predicate, row)
    for (function, row), value in updates.items():
        world.set(function, row, value if isinstance(value, int) else decimal_of(value))


def _updated(update: Update, value: Exact | int | None) -> Exact | int:
    operator, by = update
    if operator == "assign" or isinstance(by, int):
        return by
    # Only the cost of a plan may change without a value.
    value = Decimal(0) if value is None else value
    assert isinstance(value, Decimal | Fraction)
    result = EXACT.apply(CHANGES[operator], value, by)
    assert result is not None
    return result


def rates_of(world: World, running: Sequence[Snap]) -> dict[FluentRow, Fraction]:
    """Return the rates at which fluents change while durative actions are running."""

    def found() -> Iterator[tuple[FluentRow, Fraction]]:
        for snap in running:
            for effect in snap.schema.continuous:
                yield from effect.rates(snap)

    rates: dict[FluentRow, Fraction] = {}
    for fluent, rate in found():
        rates[fluent] = rates.get(fluent, Fraction(0)) + rate
    # A rate that depends on changing numbers is refused: its product with #t is not linear.
    world.rates = rates
    for _ in found():
        pass
    world.rates = {}
    return rates


_Broken = tuple[Snap, list[FailedCondition]]


def first_broken(running: Sequence[Snap]) -> _Broken | None:
    """Return the first action with a broken condition over all, and the conditions that fail."""
    return next(((each, found) for each in running if (found := each.schema.broken(each))), None)


def broken_within(
    world: World, running: Sequence[Snap], rates: dict[FluentRow, Fraction], elapsed: Fraction
) -> _Broken | None:
    """The same as `first_broken`, for the open interval of linear change that begins now."""
    if not rates or elapsed <= 0:
        return first_broken(running)
    world.rates = rates
    bounds = [Fraction(0), elapsed]
    checked: set[Fraction] = set()
    try:
        while True:
            middles = [(low + high) / 2 for low, high in pairwise(bounds)]
            moments = [one for one in [*bounds[1:-1], *middles] if one not in checked]
            if not moments:
                return None
            world.roots = set()
            for moment in moments:
                checked.add(moment)
                world.move(moment)
                found = first_broken(running)
                if found is not None:
                    return found
            bounds = sorted({*bounds, *(one for one in world.roots if 0 < one < elapsed)})
    finally:
        world.move(Fraction(0))
        world.rates = {}


def pass_time(world: World, elapsed: Fraction) -> None:
    """Change all fluents by their rates, and end the continuous change."""
    rates = world.rates
    moved = {fluent: world.linear(*fluent) for fluent in rates}
    world.rates = {}
    world.elapsed = Fraction(0)
    for (function, row), linear in moved.items():
        if linear is not None:
            world.set(function, row, decimal_of(linear.at(elapsed)))
