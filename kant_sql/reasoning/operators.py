"""The instantaneous steps of a state in memory, each grounded when it first comes into reach.

A task has the parts that no step changes: the definitions, the goals, and the facts and values that
no action has an effect on. Any other fact is a bit, so a state is an integer and some values.

Of the condition that `promise` makes for an action, fixed parts are judged when a step is grounded,
literals by bits, comparisons by values, quantifiers and `or` by either; other parts, such as
derived predicates, by the closures of `evaluate`, after the task's world has moved to the state.
A changed fact brings steps into reach: a search with this fact as its delta finds them, once for
all states.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from functools import cached_property, partial, reduce
from itertools import islice, zip_longest
from operator import attrgetter, is_not, itemgetter, or_
from threading import RLock
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary, WeakValueDictionary

from ..dao.function_value import ROUNDED_DIGITS
from ..dto import formulas as f
from ..dto.lexical import decimal_text, fold
from ..knowledge import resolved as r
from ..knowledge.definitions import KINDS, Definitions
from ..knowledge.reads import Head, heads_of
from ..knowledge.rules import rules_of
from ..planning import PlanStep
from ..sql.dialects.base import unforked
from .arithmetic import CHANGES, EXACT, FEW_DIGITS, NOT_FEW, Exact
from .derived import world_of
from .effects import combined
from .evaluate import Compiler, Env, Search, alternatives
from .failures import FailedCondition
from .promise import promise_of
from .steps import EffectItem, PreparedAction, executable, prepared
from .world import FluentRow, Relation, Row, Value

# The values of fluents by their numbers; None, or no item, without a value.
Values = Sequence[Value | None]
# The parts of a state that steps change: the facts that hold, as bits, and the values.
At = tuple[int, Values]
Judge = Callable[[int, Values], bool]
# A number in a state; without a value, it is None or raises IndexError.
NumberIn = Callable[[Values], Exact | None]
Assignments = dict[int, tuple[str, list[tuple[str, Exact | int]]]]
# The steps whose literals hold, in order, and the bits of their state.
Near = tuple[list["Operator"], int]
# A state, and its applicable steps.
Tested = tuple[int, Values, frozenset["Operator"]]
_ORDER = attrgetter("order")
# No state has all these bits.
_NEVER = -1
# If at least this many steps contain one fact, the world finds those in reach faster.
MOST_OF_FACT = 150
# For more cases of a quantifier than this, the world is faster.
MOST_CHOICES = 50


class _Needs(NamedTuple):
    """A grounded condition: the bits that matter, their required values, and another test."""

    care: int
    want: int
    test: Judge | None = None

    def holds(self, bits: int, values: Values) -> bool:
        """Return whether it holds in a state."""
        return bits & self.care == self.want and (self.test is None or self.test(bits, values))


def _every(tests: Sequence[Judge]) -> Judge | None:
    """Combine several tests into one that requires all."""
    if len(tests) < 2:
        return tests[0] if tests else None

    def every(bits: int, values: Values) -> bool:
        for test in tests:  # noqa: SIM110
            if not test(bits, values):
                return False
        return True

    return every


def _some(single: int, others: Sequence[_Needs]) -> Judge:
    """Return a test that one of some bits is set, or another condition holds."""

    def some(bits: int, values: Values) -> bool:
        if bits & single:
            return True
        for each in others:  # noqa: SIM110
            if each.holds(bits, values):
                return True
        return False

    return some


def _is_value(part: r.Part) -> bool:
    """Return whether a comparison only requires that a number has a value."""
    return isinstance(part, r.Compares) and part == r.Compares("=", part.left, part.left)


def _conjuncts(part: r.Part) -> Iterator[r.Part]:
    """Yield the parts of a conjunction; drop tests for values that a comparison implies."""
    parts = part.parts if isinstance(part, r.AllOf) else (part,)
    compared = [each for each in parts if isinstance(each, r.Compares)]
    said = {one for each in compared if not _is_value(each) for one in r.parts_of(each)}
    for each in parts:
        inner = [*r.parts_of(each)]
        if not _is_value(each) or any(getattr(one, "operator", "") == "/" for one in inner):
            yield each
            continue
        numbers = {one for one in inner if isinstance(one, r.NumberOf | r.Parameter)} - said
        yield from (r.Compares("=", one, one) for one in numbers)
        said |= numbers


class _Conjunction:
    """A conjunction, divided by how its parts are judged."""

    def __init__(self, task: GroundedTask, compiler: Compiler, part: r.Part) -> None:
        self._task, fixed = task, list[r.Part]()
        self.is_left = False  # whether the world judges some of its parts
        self.literals: list[r.Part] = []  # the facts that are bits, and negations of such facts
        self._bits: list[tuple[bool, int, Callable[[Env], Row]]] = []
        self._tests: list[tuple[bool, Callable[[Env], Judge]]] = []
        for each in _conjuncts(part):
            inner = each.part if isinstance(each, r.Lacks) else each
            if not task.changes(each):
                fixed.append(each)
            elif isinstance(inner, r.HoldsFact) and not task.rules.of(inner.predicate):
                self.literals.append(each)
                row = compiler.picker(inner.terms)
                self._bits.append((inner is each, inner.predicate, row))
            else:
                ground = _grounder(task, compiler, inner)
                self.is_left |= ground is None
                self._tests.append((inner is each, ground or _in_world(task, compiler, inner)))
        self.fixed = r.all_of(fixed)  # the parts that no step changes
        self._is_possible = compiler.test(self.fixed)

    def ground(self, env: Env) -> _Needs:
        """Judge the fixed parts, and ground the rest."""
        if not self._is_possible(env):
            return _Needs(0, _NEVER)
        want = against = 0
        for is_positive, predicate, row in self._bits:
            bit = self._task.bit((predicate, row(env)))
            want, against = (want | bit, against) if is_positive else (want, against | bit)
        found = [(is_positive, ground(env)) for is_positive, ground in self._tests]
        tests = [test if is_positive else _negated(test) for is_positive, test in found]
        return _Needs(want | against, _NEVER if want & against else want, _every(tests))


def _in_world(task: GroundedTask, compiler: Compiler, part: r.Part) -> Callable[[Env], Judge]:
    """Compile a function that grounds a test in the world of a task."""
    test = compiler.test(part)

    def ground(env: Env) -> Judge:
        own = env.copy()

        def judged(bits: int, values: Values) -> bool:
            with task.lock:
                task.go((bits, values))
                return test(own.copy())

        return judged

    return ground


def _grounder(
    task: GroundedTask, compiler: Compiler, part: r.Part
) -> Callable[[Env], Judge] | None:
    """Compile a function that grounds a test of bits and values; None if the world must judge."""
    if isinstance(part, r.Compares):
        left, right = (_number(task, compiler, side) for side in (part.left, part.right))
        if _is_value(part):
            return lambda env: _compared(is_not, left(env), None)
        by = _is_same if part.operator == "=" else r.COMPARE[part.operator]
        number = part.right if isinstance(part.right, Decimal) else None
        return lambda env: _compared(by, left(env), right(env) if number is None else number)
    return _choice(task, compiler, part) if isinstance(part, r.OneOf | r.Witness) else None


def _choice(task: GroundedTask, compiler: Compiler, part: r.Part) -> Callable[[Env], Judge] | None:
    """Compile the grounding of a disjunction or a quantifier, as `_grounder`."""
    ways, whole = _ways(task, compiler, (), part), _in_world(task, compiler, part)
    if any(each.is_left for _, each in ways):
        return None

    def ground(env: Env) -> Judge:
        own, single, others = env.copy(), 0, list[_Needs]()
        for search, condition in ways:
            for _ in search(own):
                needs = condition.ground(own)
                if needs.care == needs.want and not needs.test and needs.care.bit_count() == 1:
                    single |= needs.care
                else:
                    others.append(needs)
                if len(others) > MOST_CHOICES:
                    return whole(env)
        return _some(single, others)

    return ground


def _ways(
    task: GroundedTask, compiler: Compiler, bound: Iterable[r.Bound], part: r.Part
) -> list[tuple[Search, _Conjunction]]:
    """Split into alternatives, each with the search for objects that satisfy its fixed parts."""
    found = []
    for variables, parts in alternatives(bound, part):
        condition = _Conjunction(task, compiler, r.all_of(parts))
        slots = [r.Bound(*each) for each in variables.items()]
        found.append((compiler.search(slots, condition.fixed), condition))
    return found


def _negated(test: Judge) -> Judge:
    return lambda bits, values: not test(bits, values)


def _is_same(left: Exact | None, right: Exact | None) -> bool:
    return left is not None and left == right


def _compared(
    by: Callable[[Any, Any], bool], left: NumberIn, right: NumberIn | Decimal | None
) -> Judge:
    number, second = (None, right) if callable(right) else (right, None)

    def test(bits: int, values: Values) -> bool:
        try:
            return by(left(values), number if second is None else second(values))
        except (IndexError, TypeError):
            return False

    return test


def _number(
    task: GroundedTask, compiler: Compiler, quantity: r.Quantity
) -> Callable[[Env], NumberIn]:
    """Compile a function that grounds a number."""
    if isinstance(quantity, r.NumberOf) and (False, quantity.function) in task.changing:
        pick, function = compiler.picker(quantity.terms), quantity.function
        return lambda env: itemgetter(task.fluent((function, pick(env))))
    if isinstance(quantity, r.Operation):
        operands = [_number(task, compiler, each) for each in quantity.operands]
        if len(operands) == 1:
            operands.insert(0, _number(task, compiler, Decimal(0)))
        calculated = partial(_calculated, quantity.operator)
        return lambda env: reduce(calculated, [each(env) for each in operands])
    number = compiler.number(quantity)
    return lambda env: _always(number(env, EXACT))


def _always(number: Exact | None) -> NumberIn:
    return lambda values: number


def _calculated(symbol: str, left: NumberIn, right: NumberIn) -> NumberIn:
    quick = FEW_DIGITS[symbol]

    def number(values: Values) -> Exact | None:
        operands = left(values), right(values)
        try:
            return quick(*operands)
        except NOT_FEW:
            return EXACT.calculate(symbol, operands)

    return number


# An effect on facts: its condition, the bits that it deletes, and those that it adds.
_Branch = tuple[_Needs, int, int]
# The effects on fluents, each with its text: the operators, with functions for their operands.
_Updates = dict[int, tuple[str, list[tuple[str, NumberIn | int]]]]
# The fluent, the function for its new number, the fixed first operand, and the second operand.
_Change = tuple[int, Callable[[Any, Any], Decimal], Decimal | None, NumberIn]


class _Effect:
    """An effect; `is_plain` if bits and values decide where it takes place and what it changes."""

    def __init__(self, task: GroundedTask, compiler: Compiler, item: EffectItem) -> None:
        self._task, self._item = task, item
        self._ways = _ways(task, compiler, item.bound, item.condition)
        self._row = compiler.picker(item.terms)
        self.is_plain = not (item.needs_values or any(each.is_left for _, each in self._ways))
        self._value: Callable[[Env], NumberIn | int] | None = None
        if isinstance(item.value, r.Slot | r.Known):
            at = compiler.at(item.value)
            self._value = lambda env: int(env[at])
        elif item.value is not None:
            self._value = _number(task, compiler, item.value)
        if self._value is not None:
            # Alternatives add a fact once, but each would change a number: allow one, fixed.
            self.is_plain &= [each.fixed for _, each in self._ways] == [item.condition]

    def ground(self, env: Env, branches: list[_Branch], updates: _Updates) -> None:
        """Add its changes for the objects of a step."""
        head, operator, task = self._item.head, self._item.operator, self._task
        for search, condition in self._ways:
            for _ in search(env):
                row = self._row(env)
                if self._value is None:
                    bit, is_added = task.bit((head, row)), operator == "add"
                    branches.append((condition.ground(env), bit * (not is_added), bit * is_added))
                else:
                    text, fluent = task.world.text((False, head), row), task.fluent((head, row))
                    updates.setdefault(fluent, (text, []))[1].append((operator, self._value(env)))


def _quick(updates: _Updates) -> list[_Change]:
    """Return the changes of numbers with few digits; none if some change is of another kind."""
    found: list[_Change] = []
    for fluent, (_, changes) in updates.items():
        [operator, by] = changes[0]
        if len(changes) > 1 or isinstance(by, int) or operator.startswith("scale"):
            return []
        first = Decimal(0) if operator == "assign" else None
        found.append((fluent, FEW_DIGITS[CHANGES.get(operator, "+")], first, by))
    return found


class Operator:
    """A step: an action with objects for its parameters."""

    __slots__ = (
        *("_branches", "_is_grounded", "_quick", "_updates"),
        *("adds", "care", "is_plain", "keep", "order", "step", "test", "want"),
    )

    def __init__(self, schema: _Schema, ids: Row) -> None:
        self.step = PlanStep(None, schema.action.name, schema.task.world.names(ids))
        self.order = schema.place, *ids  # the position of its action, and its objects
        env = schema.compiler.env(ids)
        # The bits that matter to its condition, their required values, and the rest of it.
        self.care, self.want, self.test = schema.condition.ground(env)
        branches: list[_Branch] = []
        self._updates: _Updates = {}
        for effect in schema.effects or () if self.want != _NEVER else ():
            effect.ground(env, branches, self._updates)
        self._quick = _quick(self._updates)
        self._branches = [each for each in branches if each[0] != _Needs(0, 0)]
        certain = [each for each in branches if each[0] == _Needs(0, 0)]
        # The bits that it keeps, and those that it adds.
        self.keep = ~reduce(or_, [deleted for _, deleted, _ in certain], 0)
        self.adds = reduce(or_, [added for _, _, added in certain], 0)
        self._is_grounded = schema.effects is not None
        # Whether bits decide all of its condition and effects.
        self.is_plain = self._is_grounded and not (self.test or self._branches or self._updates)

    def after(self, bits: int, values: Values, tested: Tested) -> At | None:
        """Return the state after the step; None if more is needed to know, or it is refused."""
        if not (tested[1] is values and tested[0] == bits and self in tested[2]) and (
            bits & self.care != self.want or (self.test and not self.test(bits, values))
        ):
            return None
        if not self._is_grounded:
            return None
        keep, adds = self.keep, self.adds
        for needs, deletes, added in self._branches:
            if needs.holds(bits, values):
                keep, adds = keep & ~deletes, adds | added
        try:
            after = self._changed(values) if self._updates else values
        except IndexError:
            return None
        return None if after is None else (bits & keep | adds, after)

    def _changed(self, values: Values) -> Values | None:
        """Return the values after the step; None if the step is refused."""
        after, quick = [*values], self._quick
        try:
            for fluent, calculate, first, by in quick:
                before = after[fluent]
                found = calculate(before if first is None else first, by(values))
                # Otherwise, the number keeps its spelling, as in the store.
                if found != before:
                    after[fluent] = found
            if quick:
                return after
        except (IndexError, *NOT_FEW):
            pass
        made: Assignments = {}
        for fluent, (text, changes) in self._updates.items():
            made[fluent] = text, []
            for operator, number in changes:
                value = number if isinstance(number, int) else number(values)
                if value is None:
                    return None
                made[fluent][1].append((operator, value))
        settled, failed = changed_values(values, made)
        return None if failed else settled


def changed_values(values: Values, made: Assignments) -> tuple[Values, list[FailedCondition]]:
    """Return values after the changes of a step, and why some have none."""
    after, failed = [*values], list[FailedCondition]()
    for fluent, (text, changes) in made.items():
        after += [None] * (fluent + 1 - len(after))
        before = after[fluent]
        found = combined(text, changes, before if isinstance(before, Decimal) else None)
        if isinstance(found, FailedCondition):
            failed.append(found)
        elif found != before:
            if isinstance(found, Decimal) and abs(found.adjusted()) > ROUNDED_DIGITS:
                # Raises for a number that the store cannot write.
                decimal_text(found)
            # Otherwise, the number keeps its spelling, as in the store.
            after[fluent] = found
    return after, failed


class _Schema:
    """An instantaneous action with the searches for its steps; `effects` if all are plain."""

    def __init__(self, task: GroundedTask, place: int, action: PreparedAction) -> None:
        self.task, self.place, self.action = task, place, action
        compiler = self.compiler = task.compiler(action)
        self.condition = _Conjunction(task, compiler, promise_of(action).part)
        effects = [_Effect(task, compiler, item) for item in action.items(f.AT_START)]
        self.effects = effects if all(each.is_plain for each in effects) else None
        self._pick = compiler.picker([each.slot for each in action.parameters])
        self._searches: list[tuple[int, Row | None, Relation, Search]] = []
        fixed = self.condition.fixed
        for literal in self.condition.literals:
            fact = literal.part if isinstance(literal, r.Lacks) else literal
            assert isinstance(fact, r.HoldsFact)
            only = tuple([term.id for term in fact.terms if isinstance(term, r.Known)])
            relation, part, row = Relation(), r.all_of([fact, fixed]), None
            if len(only) == len(fact.terms):
                # Without a variable, there are no objects to look up.
                part, row = fixed, only
            delta = (fact, relation) if row is None else None
            search = compiler.search(action.parameters, part, delta)
            self._searches.append((fact.predicate, row, relation, search))
        # Finds the steps whose literals hold in the present state of the world.
        self.all = compiler.search(action.parameters, r.all_of([*self.condition.literals, fixed]))

    def of_fact(self, predicate: int, row: Row) -> list[Operator]:
        """Return the steps that depend on a fact, whether it holds or not."""
        found: list[Operator] = []
        for own, only, relation, search in self._searches:
            if own == predicate and only in (None, row) and self not in self.task.searched:
                relation.clear()
                relation.add(row)
                env = self.compiler.env()
                if sum(1 for _ in islice(search(env), MOST_OF_FACT)) == MOST_OF_FACT:
                    self.task.searched.append(self)
                else:
                    found += self.found(search)
        return found

    def found(self, search: Search) -> list[Operator]:
        """Return the steps that a search finds."""
        env = self.compiler.env()
        rows = {self._pick(env) for _ in search(env)}
        return [self.task.operator(self.action.name, row) for row in rows]


class GroundedTask:
    """The parts that no step changes, and the steps found so far; threads share it."""

    def __init__(
        self,
        definitions: Definitions,
        goals: Sequence[f.Formula],
        facts: frozenset[FluentRow],
        values: Mapping[FluentRow, Value],
    ) -> None:
        self.definitions, self.goals, self.facts, self.values = definitions, goals, facts, values
        self.rules, self.world = rules_of(definitions), world_of(definitions)
        # The actions, in their order; `timed` are the durative ones.
        self.actions = [prepared(definitions, each) for each in executable(definitions)]
        self.timed = [each for each in self.actions if each.is_durative]
        self.changing = definitions.derive(changing_heads)
        for fact in facts:
            self.world.add(*fact)
        for fluent, value in values.items():
            self.world.set(*fluent, value)
        self.lock = RLock()  # held while the world moves and is read
        # The actions for which the world finds the steps in reach, for each state.
        self.searched: list[_Schema] = []
        # The found steps, by the ids of their listed `PlanStep`s.
        self.listed: dict[int, Operator] = {}
        self.is_tested = False  # whether some conditions of steps need more than bits
        # The last state whose steps were listed, and the steps whose tests held.
        self.tested: Tested = 0, [], frozenset()
        # The compiled questions.
        self.asked: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()
        self._facts: list[FluentRow] = []
        self._bits: dict[FluentRow, int] = {}
        # The fluents that steps change, with their numbers.
        self._fluents: dict[FluentRow, int] = {}
        self._at: At = 0, []
        self._kept: dict[Any, Any] = {}
        self._operators: dict[tuple[str, Row], Operator] = {}
        # The steps that depend on a fact, by its bit.
        self._of_bit: dict[int, list[Operator]] = {}

    def changes(self, part: r.Part) -> bool:
        """Return whether steps can change the truth of a part."""
        return not heads_of(self.rules, part).isdisjoint(self.changing)

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return something that is made once."""
        with self.lock:
            if key not in self._kept:
                self._kept[key] = make()
            return self._kept[key]

    def compiler(self, action: PreparedAction) -> Compiler:
        """Return a compiler of parts with the parameters of an action."""
        slots = [each.slot for each in action.parameters]
        found: Compiler = self.kept((Compiler, action.name), lambda: Compiler(self.world, slots))
        return found

    # Facts.

    def fluent(self, fluent: FluentRow) -> int:
        """Return the number of a fluent."""
        with self.lock:
            return self._fluents.setdefault(fluent, len(self._fluents))

    def bit(self, fact: FluentRow) -> int:
        """Return the bit of a fact."""
        with self.lock:
            if fact not in self._bits:
                self._bits[fact] = 1 << len(self._facts)
                self._facts.append(fact)
            return self._bits[fact]

    def facts_of(self, bits: int) -> Iterator[FluentRow]:
        """Yield the facts of bits."""
        while bits:
            last = bits & -bits
            yield self._facts[last.bit_length() - 1]
            bits ^= last

    def numbered(self, values: Mapping[FluentRow, Value]) -> Values:
        """Return values by the numbers of their fluents."""
        found = {self.fluent(each): value for each, value in values.items()}
        return [found.get(n) for n in range(max(found, default=-1) + 1)]

    def values_of(self, values: Values) -> dict[FluentRow, Value]:
        """Return the values of fluents that have one."""
        pairs = zip([*self._fluents], values, strict=False)
        return {fluent: value for fluent, value in pairs if value is not None}

    def go(self, at: At) -> None:
        """Move the world to a state; the caller holds the lock."""
        world, (was, old), (bits, values) = self.world, self._at, at
        self._at = at
        for fact in self.facts_of(was & ~bits):
            world.remove(*fact)
        for fact in self.facts_of(bits & ~was):
            world.add(*fact)
        if old is not values:
            fluents = [*self._fluents]
            for n, (before, value) in enumerate(zip_longest(old, values)):
                if before is not value:
                    world.set(*fluents[n], value)

    # Steps.

    @cached_property
    def _schemas(self) -> dict[str, _Schema]:
        actions = enumerate(self.actions)
        return {each.name: _Schema(self, n, each) for n, each in actions if not each.is_durative}

    def operator(self, action: str, ids: Row) -> Operator:
        """Return an instantaneous step whose objects fit."""
        key = action, ids
        with self.lock:
            if key not in self._operators:
                found = self._operators[key] = Operator(self._schemas[action], ids)
                self.is_tested |= found.test is not None
                self.listed[id(found.step)] = found
            return self._operators[key]

    def in_reach(self, near: Near | None, at: At) -> Near:
        """Return the steps whose literals hold in a state, in order, from those of another one."""
        now = at[0]
        if near is None:
            with self.lock:
                self.go(at)
                every = [found for each in self._schemas.values() for found in each.found(each.all)]
            return sorted(every, key=_ORDER), now
        before, bits = near
        found = [each for each in before if now & each.care == each.want]
        new: list[Operator] = []
        changed, of_bit = bits ^ now, self._of_bit
        while changed:
            bit = changed & -changed
            changed ^= bit
            matter = of_bit.get(bit)
            if matter is None:
                matter = self._matter(bit)
            new += [each for each in matter if now & each.care == each.want]
        if self.searched:
            with self.lock:
                self.go(at)
                new += [one for each in self.searched for one in each.found(each.all)]
        if new:
            # The steps of these bits were not in reach before; one may depend on several bits.
            found = [*dict.fromkeys(found + new)] if self.searched or len(new) > 1 else found + new
            found.sort(key=_ORDER)
        return found, now

    def _matter(self, bit: int) -> list[Operator]:
        """Find the steps that depend on a fact."""
        [fact] = self.facts_of(bit)
        with self.lock:
            found = [one for each in self._schemas.values() for one in each.of_fact(*fact)]
            self._of_bit[bit] = [*dict.fromkeys(found)]
            return self._of_bit[bit]

    def is_goal(self, at: At) -> bool:
        """Return whether the goals hold; preferences among them do not count."""
        needs: _Needs = self.kept("goal", self._goals_needs)
        return needs.holds(*at)

    def _goals_needs(self) -> _Needs:
        resolver, compiler = r.Resolver(self.definitions), Compiler(self.world)
        part = r.all_of(resolver.part(goal) for goal in self.goals)
        r.check_levels(part)
        return _Conjunction(self, compiler, part).ground(compiler.env())


# The tasks of living states, by their contents.
_TASKS: WeakValueDictionary[Any, GroundedTask] = WeakValueDictionary()
_LOCK = unforked()

if hasattr(os, "register_at_fork"):
    # Another thread may have held the lock of a task.
    os.register_at_fork(after_in_child=_TASKS.clear)


def task_of(
    definitions: Definitions,
    goals: Sequence[f.Formula],
    facts: Iterable[FluentRow],
    values: Mapping[FluentRow, Value],
) -> GroundedTask:
    """Return the one task with these contents in this process."""
    held = frozenset(facts)
    key = definitions.derive(_said), tuple(map(str, goals)), held, frozenset(values.items())
    with _LOCK:
        found = _TASKS.get(key)
        if found is None:
            found = _TASKS[key] = GroundedTask(definitions, goals, held, values)
        return found


def _said(definitions: Definitions) -> tuple[tuple[str, int, str], ...]:
    """Return all definitions as texts."""
    every = ((kind, each) for kind in KINDS[:-1] for each in definitions.elements(kind))
    return tuple([(kind, each.id, each.text) for kind, each in every])


def changing_heads(definitions: Definitions) -> set[Head]:
    """Return the predicates and functions that actions have effects on."""
    found = set[Head]()
    actions = [prepared(definitions, each).node for each in executable(definitions)]
    stack: list[f.Node] = [effect for action in actions for effect in action.effect]
    while stack:
        node = stack.pop()
        if isinstance(node, f.Atom):
            found.add((True, definitions.predicates.ids[fold(node.predicate)]))
        elif isinstance(node, f.Assign):
            found.add((False, definitions.functions.ids[fold(node.fluent.function)]))
        else:
            stack += (node.effect,) if isinstance(node, f.When) else f.children(node)
    return found
