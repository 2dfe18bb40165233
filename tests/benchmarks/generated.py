"""Large generated problems: what the benchmarks of documents read, store and write."""

from __future__ import annotations

import random
from collections.abc import Iterator

DOMAIN = """\
(define (domain logistics)
  (:requirements :typing :fluents)
  (:types place vehicle parcel - object)
  (:predicates
    (road ?from ?to - place)
    (at ?vehicle - vehicle ?place - place)
    (in ?parcel - parcel ?vehicle - vehicle ?place - place)
    (closed ?place - place))
  (:functions (distance ?from ?to - place) - number)
  (:action drive
    :parameters (?vehicle - vehicle ?from ?to - place)
    :precondition (and (at ?vehicle ?from) (road ?from ?to))
    :effect (and (not (at ?vehicle ?from)) (at ?vehicle ?to))))
"""
PLACES, VEHICLES, PARCELS = 1_000, 500, 1_000
# Of 100 facts, so many are of each predicate; the rest are roads.
SHARES = {"at": 10, "in": 10}


def problem(facts: int, values: int = 0) -> str:
    """Give a problem of so many facts, up to a million, and values: the same one each time."""
    places, vehicles, parcels = (
        [f"{word}{number}" for number in range(count)]
        for word, count in (("place", PLACES), ("vehicle", VEHICLES), ("parcel", PARCELS))
    )
    lines = [
        "(define (problem generated) (:domain logistics)",
        "(:objects",
        f"{' '.join(places)} - place",
        f"{' '.join(vehicles)} - vehicle",
        f"{' '.join(parcels)} - parcel)",
        "(:init",
        *_facts(facts, places, vehicles, parcels),
        *_values(values, places),
        ")",
        "(:goal (and (at vehicle0 place1) (at vehicle1 place2))))",
    ]
    return "\n".join(lines) + "\n"


def _facts(
    number: int, places: list[str], vehicles: list[str], parcels: list[str]
) -> Iterator[str]:
    closed = [f"  (closed {place})" for place in places[: number // 100]]
    some, more = (number * share // 100 for share in SHARES.values())
    yield from closed
    yield from (f"  (at {' '.join(pair)})" for pair in _tuples(some, vehicles, places))
    yield from (f"  (in {' '.join(three)})" for three in _tuples(more, parcels, vehicles, places))
    rest = number - len(closed) - some - more
    yield from (f"  (road {' '.join(pair)})" for pair in _tuples(rest, places, places))


def _values(number: int, places: list[str]) -> Iterator[str]:
    for count, pair in enumerate(_tuples(number, places, places)):
        yield f"  (= (distance {' '.join(pair)}) {count % 1000}.{count % 10})"


def _tuples(number: int, *names: list[str]) -> list[tuple[str, ...]]:
    """Choose so many tuples without repeating one, in no order."""
    chosen: dict[tuple[str, ...], None] = {}
    choose = random.Random(number).choice
    while len(chosen) < number:
        chosen[tuple([choose(each) for each in names])] = None
    return list(chosen)
