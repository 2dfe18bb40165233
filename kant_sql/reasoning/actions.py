"""Actions of a world in memory: their conditions, their effects, and which of them interfere.

The semantics is that of PDDL 2.1 (Fox and Long, Journal of Artificial Intelligence Research 20,
2003): all conditions and right-hand sides are evaluated in the state before (definition 13),
deletes come before adds, and a durative action is two instantaneous ones with an invariant and
continuous change between them (definition 18). Two actions at one time may not interfere
(definition 12): none adds or deletes what another one reads or changes the other way round, and
none changes a number that another one reads or changes, unless both increase or decrease it. As in
VAL, of conditional effects those count that take place.

An effect on a fluent without a value is undefined, except `assign`, and fails.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError
from ..pddl.cursor import hint
from ..pddl.document import DURATIVE_ACTION, Action
from ..pddl.formulas import flatten
from .arithmetic import CHANGES, EXACT, LINEARS, Exact, Linear, decimal_of
from .conditions import Compiler, Conditions, Env, Search
from .failures import FailedCondition, duration_failure, failed_parts
from .grounding import (
    Binding,
    bound,
    check_continuous,
    is_continuous,
    no_multiple,
    substitute,
)
from .junctions import positive
from .relations import Row
from .world import FluentRow, World

_ADDITIVE = ("increase", "decrease")
_CONTINUOUS = "continuously"


class Update(NamedTuple):
    """A change of a fluent: `assign` and the like, with the value of the right-hand side."""

    operator: str
    value: Exact | str


@dataclass
class Changes:
    """What an action changes at one time.

    Attributes:
        deletes: the facts that it deletes.
        adds: the facts that it adds.
        updates: what it does to each fluent.
        undefined: effects that have no defined result.
    """

    deletes: set[tuple[str, Row]] = field(default_factory=set)
    adds: set[tuple[str, Row]] = field(default_factory=set)
    updates: dict[FluentRow, list[Update]] = field(default_factory=dict)
    undefined: list[FailedCondition] = field(default_factory=list)


class _Effect(NamedTuple):
    """A single effect, with the quantified variables and the conditions around it."""

    leaf: f.Formula
    time: str | None
    variables: tuple[f.TypedName, ...]
    conditions: tuple[tuple[f.Formula, str | None], ...]


def _effects(action: Action) -> Iterator[_Effect]:
    """Yield the single effects of an action."""
    stack = [_Effect(one, None, (), ()) for one in reversed(action.effect)]
    while stack:
        whole = stack.pop()
        part, _, variables, conditions = whole
        if isinstance(part, f.And):
            stack.extend(whole._replace(leaf=one) for one in reversed(part.formulas))
        elif isinstance(part, f.Timed):
            stack.append(whole._replace(leaf=part.formula, time=part.time))
        elif isinstance(part, f.When):
            parts = [_timed(one) for one in flatten(part.condition)]
            stack.append(whole._replace(leaf=part.effect, conditions=(*conditions, *parts)))
        elif isinstance(part, f.Forall):
            inner = _renamed(part, variables)
            stack.append(
                whole._replace(leaf=inner.formula, variables=(*variables, *inner.variables))
            )
        else:
            yield whole._replace(time=_CONTINUOUS) if is_continuous(part) else whole


def _timed(condition: f.Formula) -> tuple[f.Formula, str | None]:
    if isinstance(condition, f.Timed):
        return condition.formula, condition.time
    return condition, None


def _renamed(part: f.Forall, outside: Sequence[f.TypedName]) -> f.Forall:
    """Rename variables that would hide those of a quantifier outside."""
    taken = {fold(one.name) for one in outside}
    other = {
        fold(v.name): f"{v.name}-{len(taken)}" for v in part.variables if fold(v.name) in taken
    }
    variables = [f.TypedName(other.get(fold(v.name), v.name), v.types) for v in part.variables]
    return f.Forall(tuple(variables), substitute(part.formula, other, f.Variable))


# Notes what an effect changes, in an environment where all its variables have objects.
_Apply = Callable[[Env, Changes], None]


class _CompiledEffect:
    """A single effect, with the search for the objects that it takes place for."""

    def __init__(self, world: World, action: Action, effect: _Effect, time: str | None) -> None:
        self.source = effect
        compiler = Compiler(world, action.parameters)
        early = [part for part, when in effect.conditions if when == f.AT_START != time]
        now = [part for part, when in effect.conditions if when in (None, time)]
        for _, when in effect.conditions:
            if when not in (None, time) and (when, time) != (f.AT_START, f.AT_END):
                raise UnsupportedConstructError(
                    f"the action {action.name} has an effect {time} with a condition {when}; a "
                    "condition of an effect is at the same time, or at the start"
                )
        applied: list[_Apply] = []
        self._search, self._slots = compiler.open_search(
            effect.variables,
            positive(now),
            within=lambda: applied.append(_leaf(world, compiler, effect.leaf)),
        )
        self._apply = applied[0]
        self._early: Search | None = None
        if early:
            self._early, self._early_slots = compiler.open_search(effect.variables, positive(early))
        self._template, self._duration = compiler.template, compiler.duration

    def _env(self, arguments: Sequence[str], duration: Decimal | None) -> Env:
        env = self._template.copy()
        env[: len(arguments)] = arguments
        env[self._duration] = duration
        return env

    def remember(self, arguments: Sequence[str], duration: Decimal | None) -> set[Row] | None:
        """Return the objects for which the conditions at start hold, if there are such."""
        if self._early is None:
            return None
        env = self._env(arguments, duration)
        return {tuple([env[slot] for slot in self._early_slots]) for _ in self._early(env)}

    def collect(
        self,
        arguments: Sequence[str],
        duration: Decimal | None,
        remembered: set[Row] | None,
        changes: Changes,
    ) -> None:
        """Note what the effect changes."""
        env = self._env(arguments, duration)
        seen: set[Row] = set()
        for _ in self._search(env):
            row = tuple([env[slot] for slot in self._slots])
            # Alternatives of a disjunction may find the same objects.
            if row not in seen and (remembered is None or row in remembered):
                seen.add(row)
                self._apply(env, changes)


def _leaf(world: World, compiler: Compiler, leaf: f.Formula) -> _Apply:
    if isinstance(leaf, f.Assign):
        return _assignment(world, compiler, leaf)
    is_delete = isinstance(leaf, f.Not)
    atom = leaf.formula if isinstance(leaf, f.Not) else leaf
    if not isinstance(atom, f.Atom):
        raise UnsupportedConstructError(f"({f.head(leaf)} ...) is no effect")
    row_of = compiler.row(atom.terms)
    predicate = atom.predicate

    def apply(env: Env, changes: Changes) -> None:
        row = row_of(env)
        if row is None:
            changes.undefined.append(FailedCondition(str(leaf), "an argument has no value"))
        elif is_delete:
            changes.deletes.add((predicate, row))
        else:
            changes.adds.add((predicate, row))

    return apply


def _assignment(world: World, compiler: Compiler, leaf: f.Assign) -> _Apply:
    row_of = compiler.row(leaf.fluent.terms)
    function, operator = leaf.fluent.function, leaf.operator
    value_of = _value(world, compiler, leaf)

    def apply(env: Env, changes: Changes) -> None:
        row, value = row_of(env), value_of(env)
        present = None if row is None else world.table(function).get(row)
        if row is None or value is None:
            changes.undefined.append(FailedCondition(str(leaf), "its value is undefined"))
        elif present is None and operator != "assign":
            text = f"({' '.join((function, *row))})"
            changes.undefined.append(FailedCondition(str(leaf), f"{text} has no value"))
        elif operator == "scale-down" and not value:
            changes.undefined.append(FailedCondition(str(leaf), "it divides by 0"))
        else:
            changes.updates.setdefault((function, row), []).append(Update(operator, value))

    return apply


def _value(world: World, compiler: Compiler, leaf: f.Assign) -> Callable[[Env], Exact | str | None]:
    """Compile the right-hand side of an assignment."""
    if world.is_numeric(leaf.fluent.function):
        assert not isinstance(leaf.value, f.Constant)
        number = compiler.expression(leaf.value)
        return lambda env: number(env, EXACT)
    assert isinstance(leaf.value, f.Variable | f.Constant | f.Fluent)
    row_of = compiler.row((leaf.value,))

    def of(env: Env) -> str | None:
        row = row_of(env)
        return None if row is None else row[0]

    return of


class Phase:
    """What an action requires and does at one time: at its start, at its end, or at once.

    Attributes:
        time: `at start`, `at end`, or None for an instantaneous action.
        conditions: the conjuncts of its condition.
        durations: the constraints on its duration.
        effects: its effects.
        reads: what it reads: conditions, those of effects included, and right-hand sides.
    """

    def __init__(self, world: World, action: Action, time: str | None) -> None:
        self.time = time
        self.conditions = [*_conditions(action, time)]
        self.durations = [*_durations(action, time)]
        found = [one for one in _effects(action) if one.time == time]
        self.effects = [_CompiledEffect(world, action, one, time) for one in found]
        self.reads: list[f.Node] = [*self.conditions, *self.durations]
        for effect in found:
            self.reads += [part for part, when in effect.conditions if when in (None, time)]
            if isinstance(effect.leaf, f.Assign):
                self.reads += [effect.leaf.value, *effect.leaf.fluent.terms]
        if time == f.AT_START:
            # What an effect at the end depends on at the start is read then.
            self.reads += [
                part
                for one in _effects(action)
                for part, when in one.conditions
                if (one.time, when) == (f.AT_END, f.AT_START)
            ]


def _conditions(action: Action, time: str | None) -> Iterator[f.Formula]:
    """Yield the conditions at a time; one without a time in a durative action is at the start."""
    default = f.AT_START if action.kind == DURATIVE_ACTION else None
    for part in _spread(action.condition):
        condition, when = _timed(part)
        if (when or default) == time:
            yield condition


def _spread(conditions: Sequence[f.Formula]) -> Iterator[f.Formula]:
    """Yield conjuncts; quantifiers and preferences go inside of times."""
    for condition in conditions:
        for part in flatten(condition):
            if isinstance(part, f.Forall | f.Preference) and _has_times(part):
                for inner in _spread((part.formula,)):
                    formula, when = _timed(inner)
                    wrapped = (
                        f.Forall(part.variables, formula)
                        if isinstance(part, f.Forall)
                        else f.Preference(part.name, formula)
                    )
                    yield wrapped if when is None else f.Timed(when, wrapped)
            elif isinstance(part, f.Timed) and isinstance(part.formula, f.And):
                yield from (f.Timed(part.time, one) for one in flatten(part.formula))
            else:
                yield part


def _has_times(part: f.Formula) -> bool:
    return any(isinstance(node, f.Timed) for node in f.walk(part))


def _durations(action: Action, time: str | None) -> Iterator[f.Comparison]:
    """Yield the constraints on the duration at a time; by default at the start."""
    for part in action.duration:
        constraint, when = _timed(part)
        if action.kind == DURATIVE_ACTION and (when or f.AT_START) == time:
            yield from (one for one in flatten(constraint) if isinstance(one, f.Comparison))


class _Continuous:
    """A continuous effect: the rate at which fluents change while an action runs."""

    def __init__(self, world: World, action: Action, effect: _Effect) -> None:
        leaf = effect.leaf
        assert isinstance(leaf, f.Assign)
        assert not isinstance(leaf.value, f.Constant)
        value = leaf.value
        check_continuous(action.name, leaf, bool(effect.conditions))
        self._leaf = leaf
        compiler = Compiler(world, action.parameters)
        parts: list[tuple[Callable[[Env], Row | None], Callable[..., Linear | None]]] = []
        self._search, _ = compiler.open_search(
            effect.variables,
            (),
            within=lambda: parts.append(
                (compiler.row(leaf.fluent.terms), compiler.expression(value))
            ),
        )
        self._row, self._number = parts[0]
        self._sign = 1 if leaf.operator == "increase" else -1
        self._template, self._duration = compiler.template, compiler.duration

    def rates(
        self, arguments: Sequence[str], duration: Decimal | None
    ) -> Iterator[tuple[FluentRow, Fraction]]:
        """Yield the rate of each fluent.

        Raises:
            UnsupportedConstructError: the change is not linear in time.
        """
        env = self._template.copy()
        env[: len(arguments)] = arguments
        env[self._duration] = duration
        for _ in self._search(env):
            row, change = self._row(env), self._number(env, LINEARS)
            if row is None or change is None:
                continue
            if change.value:
                raise no_multiple(self._leaf)
            yield (self._leaf.fluent.function, row), self._sign * change.rate


class Schema:
    """An action, compiled for a world.

    Attributes:
        action: the action.
        phases: what it requires and does at each of its times.
        invariants: the conjuncts of its condition over all.
        continuous: its continuous effects.
    """

    def __init__(self, world: World, action: Action) -> None:
        """Compile an action.

        Raises:
            UnsupportedConstructError: an effect has a condition at another time, or changes a
                fluent continuously, but not linearly.
        """
        self.action = action
        times = (f.AT_START, f.AT_END) if action.kind == DURATIVE_ACTION else (None,)
        self.phases = {time: Phase(world, action, time) for time in times}
        self.invariants = [*_conditions(action, f.OVER_ALL)]
        self.continuous = [
            _Continuous(world, action, one) for one in _effects(action) if one.time == _CONTINUOUS
        ]

    def misfit(self, world: World, names: Sequence[str]) -> FailedCondition | None:
        """Return why names are no arguments of the action, if so."""
        parameters = self.action.parameters
        text = f"({' '.join((self.action.name, *names))})"
        if len(names) != len(parameters):
            needs = f"{self.action.name} has {len(parameters)} parameters"
            return FailedCondition(text, f"{needs}, and {len(names)} arguments are given")
        for name, parameter in zip(names, parameters, strict=True):
            known = world.object(name)
            if known is None:
                near = hint(name, list(world.objects))
                return FailedCondition(text, f"there is no object {name}{near}")
            if known not in world.members(parameter.types):
                wanted = f"?{parameter.name} is of type {parameter.type_text}"
                return FailedCondition(text, f"{known} does not fit: {wanted}")
        return None

    def binding(self, names: Sequence[str]) -> Binding:
        """Bind the parameters."""
        return bound(self.action.parameters, names)


# What an argument may be: one object, or some.
_Pattern = tuple[frozenset[str], ...]


class Snap:
    """A ground action at one of its times.

    Attributes:
        position: the position of its step in the plan; None for a timed initial literal.
        time: its time in the action; None for an instantaneous action.
        changes: what it changes; computed by `prepare`.
    """

    def __init__(
        self,
        world: World,
        schema: Schema,
        arguments: Sequence[str],
        time: str | None,
        position: int,
        duration: Decimal | None,
        memory: dict[int, set[Row]],
    ) -> None:
        self.position, self.time = position, time
        self.schema = schema
        self.arguments = tuple(arguments)
        self.duration = duration
        self.changes = Changes()
        self._world = world
        self._phase = schema.phases[time]
        self._memory = memory

    @property
    def binding(self) -> Binding:
        """The objects of the action's parameters."""
        return self.schema.binding(self.arguments)

    @property
    def conditions(self) -> list[f.Formula]:
        """The conjuncts of the condition at this time."""
        return self._phase.conditions

    def unmet(self, conditions: Conditions) -> Iterator[FailedCondition]:
        """Yield what of the condition and of the constraints on the duration does not hold."""
        binding, duration = self.binding, self.duration
        for constraint in self._phase.durations:
            sides = (constraint.left, constraint.right)
            left, right = (conditions.number(side, binding, duration) for side in sides)
            failed = duration_failure(substitute(constraint, binding), left, right)
            if failed is not None:
                yield failed
        for condition in self.conditions:
            if not conditions.holds(condition, binding, duration):
                yield from failed_parts(self._world, conditions, condition, binding, duration)

    def prepare(self) -> list[FailedCondition]:
        """Compute the changes in the present state; return what makes them impossible."""
        changes = self.changes = Changes()
        for number, effect in enumerate(self._phase.effects):
            remembered = self._memory.get(number) if self.time == f.AT_END else None
            effect.collect(self.arguments, self.duration, remembered, changes)
        if self.time == f.AT_START:
            for number, effect in enumerate(self.schema.phases[f.AT_END].effects):
                found = effect.remember(self.arguments, self.duration)
                if found is not None:
                    self._memory[number] = found
        failed = list(changes.undefined)
        for fluent, updates in changes.updates.items():
            if len(updates) > 1 and any(one.operator not in _ADDITIVE for one in updates):
                failed.append(_about(fluent, "two effects of the action change it"))
        return failed

    def reads(self) -> list[tuple[str, _Pattern]]:
        """Return the facts and fluents that it reads."""
        objects = {key: frozenset((name,)) for key, name in self.binding.items()}
        return [*_patterns(self._world, self._phase.reads, objects)]


def interference(
    mine: Changes, reads: Sequence[tuple[str, _Pattern]], others: Changes
) -> FailedCondition | None:
    """Return what another action at the same time changes, and this one reads or changes.

    Args:
        mine: what this action changes.
        reads: what it reads.
        others: what the other action changes.
    """
    facts = sorted((mine.adds & others.deletes) | (mine.deletes & others.adds))
    if facts:
        return _about(facts[0], "of two actions at the same time, one adds it and one deletes it")
    for fluent, updates in mine.updates.items():
        both = [*updates, *others.updates.get(fluent, ())]
        if fluent in others.updates and any(one.operator not in _ADDITIVE for one in both):
            return _about(fluent, "two actions at the same time change it")
    changed = sorted({*others.adds, *others.deletes, *others.updates})
    for name, pattern in reads:
        for found in changed:
            if found[0] == name and _matches(found[1], pattern):
                return _about(found, "an action reads it at the same time as another changes it")
    return None


def _about(fact: tuple[str, Row], reason: str) -> FailedCondition:
    return FailedCondition(f"({' '.join((fact[0], *fact[1]))})", reason)


def _matches(row: Row, pattern: _Pattern) -> bool:
    return len(row) == len(pattern) and all(
        name in objects for name, objects in zip(row, pattern, strict=True)
    )


def _patterns(
    world: World, nodes: Sequence[f.Node], binding: dict[str, frozenset[str]]
) -> Iterator[tuple[str, _Pattern]]:
    """Yield what formulas read: names with the objects that each argument may be."""
    everything = frozenset(world.objects)
    derived: set[tuple[str, _Pattern]] = set()
    stack: list[tuple[f.Node, dict[str, frozenset[str]]]] = [(node, binding) for node in nodes]
    while stack:
        node, names = stack.pop()
        variables = getattr(node, "variables", ())
        if variables:
            names = {**names, **{fold(v.name): world.members(v.types) for v in variables}}
        stack.extend((child, names) for child in f.children(node))
        if not isinstance(node, f.Atom | f.Fluent):
            continue
        name = node.predicate if isinstance(node, f.Atom) else node.function
        pattern = tuple([_objects(term, names, everything) for term in node.terms])
        yield name, pattern
        if world.rules(name) is not None and (name, pattern) not in derived:
            derived.add((name, pattern))
            for rule in world.domain.derived:
                if rule.predicate == name:
                    keys = [fold(one.name) for one in rule.variables]
                    stack.append((rule.formula, dict(zip(keys, pattern, strict=True))))


def _objects(
    term: f.Term, names: dict[str, frozenset[str]], everything: frozenset[str]
) -> frozenset[str]:
    if isinstance(term, f.Constant):
        return frozenset((term.name,))
    if isinstance(term, f.Variable):
        return names.get(fold(term.name), everything)
    return everything


def apply_changes(world: World, changes: Sequence[Changes]) -> None:
    """Apply the changes of actions at one time: deletes, then adds, then updates."""
    updates: dict[FluentRow, Exact | str] = {}
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
        world.set(function, row, value if isinstance(value, str) else decimal_of(value))


def _updated(update: Update, value: Exact | str | None) -> Exact | str:
    operator, by = update
    if operator == "assign" or isinstance(by, str):
        return by
    assert isinstance(value, Decimal | Fraction)
    result = CHANGES[operator](value, by)
    assert result is not None
    return result


def pass_time(world: World, elapsed: Fraction) -> None:
    """Change all fluents by their rates, and end the continuous change."""
    rates = world.rates
    moved = {fluent: world.linear(*fluent) for fluent in rates}
    world.rates = {}
    world.elapsed = Fraction(0)
    for (function, row), linear in moved.items():
        if linear is not None:
            world.set(function, row, decimal_of(linear.at(elapsed)))
