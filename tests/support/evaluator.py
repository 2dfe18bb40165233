"""The meaning of PDDL, in plain code: conditions, derived predicates and effects on dictionaries.

It tries all objects, and uses nothing of the product except the nodes of formulas and the folding
of names. All names in a state are folded.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Protocol, TypeVar

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import ROOT_TYPE, fold

# A predicate or a function, and its arguments.
Ground = tuple[str, ...]
Bindings = Mapping[str, str]
Typing = Mapping[str, tuple[str, ...]]
N = TypeVar("N", float, Fraction)

COMPARE: dict[str, Callable[[Fraction, Fraction], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    "=": operator.eq,
    ">=": operator.ge,
    ">": operator.gt,
}
OPERATE: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
CHANGE: dict[str, Callable[[Fraction, Fraction], Fraction]] = {
    "increase": operator.add,
    "decrease": operator.sub,
    "scale-up": operator.mul,
    "scale-down": operator.truediv,
}


ZERO = Fraction(0)
TOLERANCE = Fraction(1, 100)
# The distance from the ends of an interval at which it is checked.
NEAR = Fraction(1, 2**40)


class UndefinedEffectError(Exception):
    """An effect has no result: a value is missing, a divisor is 0, or two effects disagree."""


class ActionLike(Protocol):
    """The attributes of an action."""

    @property
    def name(self) -> str: ...
    @property
    def parameters(self) -> Sequence[f.TypedName]: ...
    @property
    def condition(self) -> Sequence[f.Node]: ...
    @property
    def effect(self) -> Sequence[f.Node]: ...
    @property
    def duration(self) -> Sequence[f.Node]: ...


@dataclass(frozen=True)
class State:
    """Objects with their types, in the order of declaration; facts; values of fluents."""

    objects: Typing
    facts: frozenset[Ground]
    values: Mapping[Ground, Fraction | str]


@dataclass(frozen=True)
class Theory:
    """The types with their ancestors, and the rules of derived predicates."""

    parents: Typing
    rules: Sequence[f.Derived] = ()

    def is_below(self, lower: str, upper: str) -> bool:
        if lower == upper or upper == ROOT_TYPE:
            return True
        return any(self.is_below(above, upper) for above in self.parents.get(lower, ()))

    def fits(self, types: Iterable[str], wanted: Iterable[str]) -> bool:
        return any(self.is_below(fold(one), fold(other)) for one in types for other in wanted)

    def strata(self) -> list[list[f.Derived]]:
        """Return the rules in layers: each negates only predicates of lower layers."""
        level = {fold(rule.predicate): 0 for rule in self.rules}
        for _ in range(len(level) + 1):
            for rule in self.rules:
                head = fold(rule.predicate)
                for name, positive in occurrences(rule.formula):
                    if name in level:
                        level[head] = max(level[head], level[name] + (not positive))
        if level and max(level.values()) >= len(level):
            raise ValueError("the rules are not stratified")
        layers: list[list[f.Derived]] = [[] for _ in level]
        for rule in self.rules:
            layers[level[fold(rule.predicate)]].append(rule)
        return layers


def is_continuous(effect: f.Node) -> bool:
    """Return whether an effect is continuous."""
    return isinstance(effect, f.Assign) and any(
        isinstance(node, f.ContinuousTime) for node in f.walk(effect.value)
    )


def occurrences(formula: f.Node, positive: bool = True) -> Iterator[tuple[str, bool]]:
    """Yield the predicates in a formula, each with whether its negations cancel out."""
    match formula:
        case f.Atom():
            yield fold(formula.predicate), positive
        case f.Not():
            yield from occurrences(formula.formula, not positive)
        case f.Imply():
            yield from occurrences(formula.condition, not positive)
            yield from occurrences(formula.formula, positive)
        case f.And() | f.Or():
            for part in formula.formulas:
                yield from occurrences(part, positive)
        case f.Forall() | f.Exists():
            yield from occurrences(formula.formula, positive)


def of_time(condition: f.Node, time: str | None) -> f.Node:
    """Return the part of a condition at a time; untimed parts belong to each time."""
    if isinstance(condition, f.Timed):
        return condition.formula if condition.time == time else f.And()
    return condition


class Evaluator:
    """Evaluates in a state."""

    def __init__(
        self,
        theory: Theory,
        state: State,
        duration: Fraction | None = None,
        passed: Fraction = ZERO,
    ) -> None:
        self.theory, self.state = theory, state
        self.duration, self.passed = duration, passed
        self.facts = set(state.facts)
        for layer in theory.strata():
            while new := {fact for rule in layer for fact in self._derived(rule)} - self.facts:
                self.facts |= new

    def _derived(self, rule: f.Derived) -> Iterator[Ground]:
        for bound in self.bindings(rule.variables):
            if self.holds(rule.formula, bound):
                yield (fold(rule.predicate), *bound.values())

    def range(self, types: Iterable[str]) -> list[str]:
        """Return the objects of a variable with these types, in the order of declaration."""
        wanted = tuple(types)
        return [o for o, own in self.state.objects.items() if self.theory.fits(own, wanted)]

    def bindings(self, variables: Iterable[f.TypedName]) -> Iterator[dict[str, str]]:
        """Yield all values of variables; the last one changes fastest."""
        listed = list(variables)
        names = [fold(variable.name) for variable in listed]
        for objects in itertools.product(*(self.range(variable.types) for variable in listed)):
            yield dict(zip(names, objects, strict=True))

    def holds(self, formula: f.Node, bound: Bindings) -> bool:
        match formula:
            case f.Atom() | f.Equal() | f.Comparison():
                return self._is_true(formula, bound)
            case f.Not():
                return not self.holds(formula.formula, bound)
            case f.And():
                return all(self.holds(part, bound) for part in formula.formulas)
            case f.Or():
                return any(self.holds(part, bound) for part in formula.formulas)
            case f.Imply():
                return self.holds(f.Or((f.Not(formula.condition), formula.formula)), bound)
            case f.Forall():
                return not self.holds(f.Exists(formula.variables, f.Not(formula.formula)), bound)
            case f.Exists():
                inner = self.bindings(formula.variables)
                return any(self.holds(formula.formula, {**bound, **more}) for more in inner)
            case f.Preference():
                return True
        raise TypeError(f"no condition: {formula!r}")

    def _is_true(self, formula: f.Atom | f.Equal | f.Comparison, bound: Bindings) -> bool:
        """Return whether a leaf holds; none holds if a fluent in it has no value."""
        if isinstance(formula, f.Atom):
            return self.ground(formula.predicate, formula.terms, bound) in self.facts
        if isinstance(formula, f.Equal):
            value = self.term(formula.left, bound)
            return value is not None and value == self.term(formula.right, bound)
        left = self.number(formula.left, bound, Fraction)
        right = self.number(formula.right, bound, Fraction)
        if left is None or right is None:
            return False
        return COMPARE[formula.operator](left, right)

    def term(self, term: f.Node, bound: Bindings) -> str | None:
        """Return the object of a term; None for a fluent without a value."""
        match term:
            case f.Variable():
                return bound[fold(term.name)]
            case f.Constant():
                return fold(term.name)
            case f.Fluent():
                value = self.value(term, bound)
                assert value is None or isinstance(value, str)
                return value
        raise TypeError(f"no term: {term!r}")

    def value(self, fluent: f.Fluent, bound: Bindings) -> Fraction | str | None:
        key = self.ground(fluent.function, fluent.terms, bound)
        return None if key is None else self.state.values.get(key)

    def ground(self, name: str, terms: Iterable[f.Node], bound: Bindings) -> Ground | None:
        objects = [self.term(term, bound) for term in terms]
        found = tuple(object_ for object_ in objects if object_ is not None)
        return (fold(name), *found) if len(found) == len(objects) else None

    def number(self, expression: f.Node, bound: Bindings, kind: type[N]) -> N | None:
        """Return the value of an expression; None if a part has none, or for a division by 0."""
        match expression:
            case f.Number():
                return kind(expression.value)
            case f.Fluent():
                value = self.value(expression, bound)
                return None if value is None else kind(value)
            case f.Arithmetic():
                parts = [self.number(part, bound, kind) for part in expression.operands]
                operands = [part for part in parts if part is not None]
                if len(operands) < len(parts):
                    return None
                return calculated(expression.operator, operands)
            case f.Variable():
                return None if self.duration is None else kind(self.duration)
            case f.ContinuousTime():
                return kind(self.passed)
        raise TypeError(f"no number: {expression!r}")

    def answers(
        self, formula: f.Node, columns: Sequence[f.TypedName], fixed: Bindings | None = None
    ) -> list[tuple[str, ...]]:
        """Return the objects for which a condition holds, in the order of the columns."""
        given = fixed or {}
        return [
            tuple(bound.values())
            for bound in self.bindings(columns)
            if self.holds(formula, {**given, **bound})
        ]

    def applicable(self, action: ActionLike, time: str = f.AT_START) -> list[tuple[str, ...]]:
        """Return the arguments for which the condition holds; of a durative action, at a time."""
        parts = tuple(of_time(part, time) for part in action.condition)
        return self.answers(f.And(parts), action.parameters)  # type: ignore[arg-type]

    def apply(self, action: ActionLike, arguments: Sequence[str], time: str | None = None) -> State:
        """Return the state after an applicable action, or after one time of a durative one."""
        return self.changed(action.effect, self._bound(action, arguments), time)

    def changed(self, effects: Iterable[f.Node], bound: Bindings, time: str | None = None) -> State:
        """Return the state after effects; of a durative action, after those at a time.

        All are evaluated in the state before; adds win over deletes.
        """
        found = [change for effect in effects for change in self._changes(effect, bound, time)]
        removed = {self._changed_fact(e.formula, b) for e, b in found if isinstance(e, f.Not)}
        added = {self._changed_fact(e, b) for e, b in found if isinstance(e, f.Atom)}
        values = dict(self.state.values)
        changes: dict[Ground, list[tuple[str, Fraction | str]]] = {}
        for effect, inner in found:
            if isinstance(effect, f.Assign):
                key, value = self._assignment(effect, inner)
                changes.setdefault(key, []).append((effect.operator, value))
        for key, several in changes.items():
            # The cost of a plan begins at 0.
            begun = Fraction(0) if key == ("total-cost",) else None
            values[key] = assigned(values.get(key, begun), several)
        return replace(self.state, facts=(self.state.facts - removed) | added, values=values)

    # Durative actions, step by step.

    def lasting(
        self, action: ActionLike, arguments: Sequence[str], given: Fraction | None = None
    ) -> Iterator[Fraction]:
        """Yield possible durations of a step: the given one, the fixed one, or some of many."""
        bound = self._bound(action, arguments)
        limits = []
        for constraint in action.duration:
            part = of_time(constraint, f.AT_START)
            if isinstance(part, f.Comparison):
                limit = self.number(part.right, bound, Fraction)
                if limit is None:
                    return
                limits.append((part.operator, limit))
        fixed = [limit for operator, limit in limits if operator == "="]
        some = [ZERO, *(limit + by for _, limit in limits for by in (-TOLERANCE, ZERO, TOLERANCE))]
        for one in fixed[:1] if fixed else some:
            at = one if given is None else given
            if at >= 0 and all(is_allowed(operator, at - limit) for operator, limit in limits):
                yield at

    def begun(
        self, action: ActionLike, arguments: Sequence[str], given: Fraction | None = None
    ) -> Evaluator | None:
        """Return the state right after a step begins, with its duration; None if it cannot."""
        time = f.AT_START if action.duration else None
        here = self
        if action.duration:
            durations = [*self.lasting(action, arguments, given)]
            is_known = given is not None or any(
                isinstance(part, f.Comparison) and part.operator == "=" for part in action.duration
            )
            needed = f.walk(*action.condition, *action.effect)
            is_needed = any(part in (f.Variable("duration"), f.ContinuousTime()) for part in needed)
            if not durations or (is_needed and not is_known):
                return None
            here = Evaluator(self.theory, self.state, durations[0] if is_known else None)
        bound = self._bound(action, arguments)
        if not here.meets(action, bound, f.AT_START):
            return None
        try:
            state = here.changed(action.effect, bound, time)
        except UndefinedEffectError:
            return None
        after = Evaluator(self.theory, state, here.duration)
        return after if time is None or after.meets(action, bound, f.OVER_ALL) else None

    def ended(self, action: ActionLike, arguments: Sequence[str]) -> State | None:
        """Return the state after a step's end, without changes during its duration."""
        bound, duration = self._bound(action, arguments), self.duration or ZERO
        moments = [NEAR, *(Fraction(number, 97) for number in range(1, 97)), 1 - NEAR]
        try:
            for moment in moments:
                then = self._moved(action, bound, moment * duration)
                if not then.meets(action, bound, f.OVER_ALL):
                    return None
            last = self._moved(action, bound, duration)
            if not last.meets(action, bound, f.AT_END):
                return None
            return last.changed(action.effect, bound, f.AT_END)
        except UndefinedEffectError:
            return None

    def meets(self, action: ActionLike, bound: Bindings, time: str) -> bool:
        """Return whether the conditions at a time hold."""
        return all(self.holds(of_time(part, time), bound) for part in action.condition)

    def _moved(self, action: ActionLike, bound: Bindings, passed: Fraction) -> Evaluator:
        here = Evaluator(self.theory, self.state, self.duration, passed)
        state = here.changed(action.effect, bound, "while")
        return Evaluator(self.theory, state, self.duration)

    @staticmethod
    def _bound(action: ActionLike, arguments: Sequence[str]) -> Bindings:
        names = [fold(parameter.name) for parameter in action.parameters]
        return dict(zip(names, arguments, strict=True))

    def _changes(
        self, effect: f.Node, bound: Bindings, time: str | None
    ) -> Iterator[tuple[f.Node, Bindings]]:
        """Yield the literals and assignments of an effect, with their variables."""
        match effect:
            case f.And():
                for part in effect.formulas:
                    yield from self._changes(part, bound, time)
            case f.Forall():
                for more in self.bindings(effect.variables):
                    yield from self._changes(effect.formula, {**bound, **more}, time)
            case f.When():
                if self.holds(of_time(effect.condition, time), bound):
                    yield from self._changes(effect.effect, bound, time)
            case f.Timed():
                if effect.time == time:
                    yield from self._changes(effect.formula, bound, time)
            case _ if is_continuous(effect) is (time == "while"):
                yield effect, bound

    def _changed_fact(self, atom: f.Node, bound: Bindings) -> Ground:
        assert isinstance(atom, f.Atom)
        found = self.ground(atom.predicate, atom.terms, bound)
        if found is None:
            raise UndefinedEffectError(f"an argument of {atom} has no value")
        return found

    def _assignment(self, effect: f.Assign, bound: Bindings) -> tuple[Ground, Fraction | str]:
        key = self.ground(effect.fluent.function, effect.fluent.terms, bound)
        value: Fraction | str | None
        if isinstance(effect.value, f.Variable | f.Constant):
            value = self.term(effect.value, bound)
        elif isinstance(effect.value, f.Fluent):
            value = self.value(effect.value, bound)
        else:
            value = self.number(effect.value, bound, Fraction)
        if key is None or value is None:
            raise UndefinedEffectError(f"{effect} has no value")
        return key, value


def is_allowed(operator: str, difference: Fraction) -> bool:
    """Return whether the difference of a duration from its limit is allowed, with tolerance."""
    if operator == "=":
        return abs(difference) <= TOLERANCE
    return difference <= TOLERANCE if operator == "<=" else -difference <= TOLERANCE


def calculated(sign: str, operands: Sequence[N]) -> N | None:
    """Return the value of an operation, from left to right."""
    first, *rest = operands
    if not rest:
        return first * -1 if sign == "-" else first
    for operand in rest:
        if sign == "/" and not operand:
            return None
        first = OPERATE[sign](first, operand)
    return first


def assigned(
    value: Fraction | str | None, changes: Sequence[tuple[str, Fraction | str]]
) -> Fraction | str:
    """Return the value after the effects on one fluent, which must commute."""
    kinds = {kind for kind, _ in changes}
    if kinds == {"assign"}:
        if len({to for _, to in changes}) > 1:
            raise UndefinedEffectError("two values for one fluent")
        return changes[0][1]
    if not (kinds <= {"increase", "decrease"} or kinds <= {"scale-up", "scale-down"}):
        raise UndefinedEffectError("effects on one fluent do not commute")
    for kind, by in changes:
        if not isinstance(value, Fraction) or not isinstance(by, Fraction):
            raise UndefinedEffectError("no number to change")
        if kind == "scale-down" and not by:
            raise UndefinedEffectError("a division by 0")
        value = CHANGE[kind](value, by)
    assert value is not None
    return value
