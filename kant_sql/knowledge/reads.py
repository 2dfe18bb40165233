"""The facts and fluents that conditions and numbers read, also through derived predicates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from . import resolved as r
from .rules import DerivationRules

T = TypeVar("T")
# A predicate (True) or a function, by id.
Head = tuple[bool, int]
# The same, with the possible objects of each argument; None for any object.
Reading = tuple[bool, int, tuple[T | None, ...]]


def head_of(part: r.Part | r.Quantity) -> Head | None:
    """Return the predicate or function of a leaf or a number."""
    match part:
        case r.HoldsFact(predicate, _):
            return True, predicate
        case r.FluentIs(function, _, _) | r.NumberOf(function, _):
            return False, function
    return None


def heads_of(rules: DerivationRules, *parts: r.Part | r.Quantity) -> set[Head]:
    """Return the predicates and functions that parts read."""
    return {(is_fact, owner) for is_fact, owner, _ in read_by(rules, parts, {})}


def read_by(
    rules: DerivationRules,
    parts: Iterable[r.Part | r.Quantity],
    given: Mapping[Any, T | None],
    known: Callable[[int], T] = int,  # type: ignore[assignment]
    ranges: Callable[[r.Bound], T] | None = None,
) -> list[Reading[T]]:
    """Return the facts and fluents that parts read, for given objects of some variables.

    `known` maps an object to the possible arguments, and `ranges` variables of quantifiers to their
    possible objects; by default any object.
    """
    found: dict[Reading[T], None] = {}
    pending: list[tuple[Any, dict[Any, T | None]]] = [(part, {**given}) for part in parts]
    while pending:
        part, places = pending.pop()
        # A quantifier comes before what it is about.
        for one in r.parts_of(part):
            if isinstance(one, r.Witness) and ranges is not None:
                places.update((each.slot, ranges(each)) for each in one.bound)
            head = head_of(one)
            if head is None:
                continue
            row = [known(x.id) if isinstance(x, r.Known) else places.get(x) for x in one.terms]
            reading = (*head, tuple(row))
            if reading not in found:
                found[reading] = None
                for rule in rules.of(head[1]) if head[0] else ():
                    slots = (each.slot for each in rule.parameters)
                    pending.append((rule.body, dict(zip(slots, row, strict=False))))
    return [*found]
