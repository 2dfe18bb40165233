"""The condition on the state before some effects under which a condition holds after them.

After effects, a fact holds if they add it, or if it held before and they do not delete it; a fluent
has its assigned value, or its former one changed (regression; Reiter, The frame problem in the
situation calculus, 1991). So one statement about the state before judges the state after.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import product
from math import prod

from ..dto.formulas import TOTAL_COST
from ..dto.lexical import fold
from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions
from ..knowledge.reads import Head, head_of, heads_of
from ..knowledge.rules import DerivationRules, rules_of
from .arithmetic import CHANGES
from .steps import EffectItem

# The maximum number of cases of one comparison.
MOST_CASES = 16


class OpaqueError(Exception):
    """No condition on the state before decides what holds after."""


def mapped(part: r.Part, of: Callable[[r.Part, bool], r.Part], is_negated: bool = False) -> r.Part:
    """Replace the leaves of a part; `of` gets each leaf, and whether it is below a negation."""
    match part:
        case r.AllOf(parts):
            return r.all_of(mapped(each, of, is_negated) for each in parts)
        case r.OneOf(parts):
            return r.any_of(mapped(each, of, is_negated) for each in parts)
        case r.Lacks(inner):
            return r.negate(mapped(inner, of, not is_negated))
        case r.Witness(bound, inner):
            within = mapped(inner, of, is_negated)
            return r.FALSE if within == r.FALSE else r.Witness(bound, within)
    return of(part, is_negated)


def with_quantities(quantity: r.Quantity, values: Mapping[r.Quantity, r.Quantity]) -> r.Quantity:
    """Replace numbers within a number."""
    if quantity in values:
        return values[quantity]
    if isinstance(quantity, r.Operation):
        operands = tuple(with_quantities(each, values) for each in quantity.operands)
        return r.Operation(quantity.operator, operands)
    return quantity


def with_numbers(part: r.Compares, values: Mapping[r.Quantity, r.Quantity]) -> r.Compares:
    """Replace numbers within a comparison."""
    left, right = (with_quantities(side, values) for side in (part.left, part.right))
    return r.Compares(part.operator, left, right)


def matched(
    bound: Sequence[r.Bound], pairs: Iterable[tuple[r.Place, r.Place]]
) -> tuple[dict[r.Slot, r.Place], list[r.Part], tuple[r.Bound, ...]]:
    """Match terms to places; return the places of variables, conditions, and other variables."""
    types = {each.slot: each.types for each in bound}
    places: dict[r.Slot, r.Place] = {}
    conditions: list[r.Part] = []
    for term, place in pairs:
        if isinstance(term, r.Known):
            conditions.append(r.same(term, place))
        elif term in types and term not in places:
            places[term] = place
            conditions += [r.HasType(place, one) for one in types[term]]
        else:
            conditions.append(r.same(places.get(term, term), place))
    return places, conditions, tuple([each for each in bound if each.slot not in places])


class After:
    """Rewrites conditions after effects as conditions on the state before."""

    def __init__(
        self,
        definitions: Definitions,
        items: Sequence[EffectItem],
        numbers: Iterator[int],
        *,
        is_whole: bool = False,
    ) -> None:
        self._functions = definitions.functions
        self._rules = rules_of(definitions)
        self._numbers = numbers  # gives the numbers of new variables
        # Whether the rules are those of `rules`, which derive the facts after the effects.
        self._is_whole = is_whole
        self._items: dict[Head, list[EffectItem]] = {}
        for item in items:
            head = item.operator in ("add", "delete"), item.head
            self._items.setdefault(head, []).append(item)

    def rules(self) -> DerivationRules:
        """Return the rules that derive the facts after the effects."""
        return self._rules.replaced(self.part)

    def part(self, part: r.Part) -> r.Part:
        """Return the condition before iff a part holds after, or raise `OpaqueError`."""
        return mapped(part, self._leaf) if self._items else part

    def _leaf(self, leaf: r.Part, _: bool) -> r.Part:
        match leaf:
            case r.HoldsFact(predicate, terms):
                if self._rules.of(predicate) and not leaf.is_stored:
                    return self._derived(leaf)
                items = self._items.get((True, predicate), ())
                deleted = [self._hits(each, terms) for each in items if each.operator == "delete"]
                added = [self._hits(each, terms) for each in items if each.operator == "add"]
                return r.any_of([r.all_of([leaf, *map(r.negate, deleted)]), *added])
            case r.FluentIs(function, terms, value):
                items = self._items.get((False, function), ())
                changed = [self._hits(each, terms) for each in items]
                assigned = [self._hits(each, terms, value) for each in items]
                return r.any_of([r.all_of([leaf, *map(r.negate, changed)]), *assigned])
            case r.Compares():
                return self._compares(leaf)
        return leaf

    def _derived(self, leaf: r.HoldsFact) -> r.Part:
        if not self._is_whole and not heads_of(self._rules, leaf).isdisjoint(self._items):
            raise OpaqueError
        return leaf

    def _hits(
        self, item: EffectItem, terms: Sequence[r.Place], value: r.Place | None = None
    ) -> r.Part:
        """Make the condition that an effect takes place on some objects."""
        part, _, _ = self._matched(item, terms, value)
        return part

    def _matched(
        self, item: EffectItem, terms: Sequence[r.Place], value: r.Place | None = None
    ) -> tuple[r.Part, dict[r.Slot, r.Place], tuple[r.Bound, ...]]:
        """Make that condition; return the objects of its variables and the other variables, too."""
        pairs = [*zip(item.terms, terms, strict=True)]
        if value is not None:
            assert isinstance(item.value, r.Slot | r.Known)
            pairs.append((item.value, value))
        places, conditions, rest = matched(item.bound, pairs)
        inner = r.all_of([item.condition, *conditions])
        whole = r.Witness(rest, inner) if rest and inner != r.FALSE else inner
        return r.replaced(whole, places, self._numbers), places, rest

    def _compares(self, leaf: r.Compares) -> r.Part:
        numbers = [
            each
            for each in dict.fromkeys(r.parts_of(leaf))
            if isinstance(each, r.NumberOf) and (False, each.function) in self._items
        ]
        choices = [self._values(each) for each in numbers]
        if prod(map(len, choices)) > MOST_CASES:
            raise OpaqueError
        found = []
        for chosen in product(*choices):
            values: dict[r.Quantity, r.Quantity] = {
                number: value for number, (_, value) in zip(numbers, chosen, strict=True)
            }
            found.append(r.all_of([*(guard for guard, _ in chosen), with_numbers(leaf, values)]))
        return r.any_of(found)

    def _values(self, number: r.NumberOf) -> list[tuple[r.Part, r.Quantity]]:
        """Return the possible values of a fluent after, each with its condition."""
        items = self._items[False, number.function]
        is_cost = fold(self._functions.live(number.function).name) == TOTAL_COST
        if 2 ** len(items) > MOST_CASES or (is_cost and not self._is_whole):
            raise OpaqueError
        matched = [self._matched(each, number.terms) for each in items]
        if any(rest for _, _, rest in matched):
            # There are as many changes as objects.
            raise OpaqueError
        found = []
        for hits in product((False, True), repeat=len(items)):
            value: r.Quantity = number
            guards = []
            for item, (hit, places, _), is_hit in zip(items, matched, hits, strict=True):
                guards.append(r.replaced(hit if is_hit else r.negate(hit), {}, self._numbers))
                if is_hit:
                    by = _replaced(item.value, places, self._numbers)
                    operator = CHANGES.get(item.operator)
                    value = by if operator is None else r.Operation(operator, (value, by))
            guard = r.all_of(guards)
            if guard != r.FALSE:
                found.append((guard, value))
        return found


def _replaced(
    value: r.Quantity | r.Place | None, places: dict[r.Slot, r.Place], numbers: Iterator[int]
) -> r.Quantity:
    assert value is not None
    assert not isinstance(value, r.Slot | r.Known)
    made: r.Quantity = r.replaced(value, copy(places), numbers)  # type: ignore[arg-type, assignment]
    return made


def ground_item(
    operator: str, head: int, ids: Sequence[int], value: r.Quantity | r.Place | None = None
) -> EffectItem:
    """Make an effect that takes place once, on given objects."""
    terms = tuple(map(r.Known, ids))
    return EffectItem(operator, head, terms, value, (), r.TRUE, r.TRUE, r.FALSE, ())


def weakened(part: r.Part, heads: set[Head]) -> r.Part:
    """Relax a condition on changing numbers for the ends of an open interval."""

    def leaf(each: r.Part, is_negated: bool) -> r.Part:
        if not isinstance(each, r.Compares) or heads.isdisjoint(map(head_of, r.parts_of(each))):
            return each
        changes = {"<=": "<", ">=": ">"} if is_negated else {"<": "<=", ">": ">="}
        return replace(each, operator=changes.get(each.operator, each.operator))

    return mapped(part, leaf)


def is_linear(
    part: r.Part, heads: set[Head], rules: DerivationRules, negated: bool = False
) -> bool:
    """Return whether a condition that holds at some points of linear change holds throughout.

    The points are both ends, where strict comparisons count as non-strict, and one inside.
    """

    def depends(each: r.Part) -> bool:
        return not heads_of(rules, each).isdisjoint(heads)

    if not depends(part):
        return True
    match part:
        case r.AllOf(parts) | r.OneOf(parts):
            is_choice = isinstance(part, r.OneOf) != negated
            return (not is_choice or sum(map(depends, parts)) < 2) and all(
                is_linear(each, heads, rules, negated) for each in parts
            )
        case r.Lacks(inner):
            return is_linear(inner, heads, rules, not negated)
        case r.Witness(_, inner):
            return negated and is_linear(inner, heads, rules, negated)
        case r.Compares(operator, left, right):
            degrees = [degree(side, heads) for side in (left, right)]
            return max(degrees) < 2 and not (negated and operator == "=")
    return False


def degree(quantity: r.Quantity, heads: set[Head]) -> int:
    """Return the degree of a number in the changing ones: 0 constant, 1 linear, 2 otherwise."""
    if not isinstance(quantity, r.Operation):
        return int(head_of(quantity) in heads)
    degrees = [degree(each, heads) for each in quantity.operands]
    if quantity.operator == "/" and len(degrees) > 1 and degrees[1]:
        return 2
    return min(2, sum(degrees)) if quantity.operator == "*" else max(degrees)
