"""Estimates of the number of facts of a predicate, for the order of joins.

A database has no statistics right after a load, and SQLite never makes any by itself. So a part of
each predicate's facts is counted when a condition is first written as a statement, and again from
time to time: a good order for few facts may be bad for many.
"""

from __future__ import annotations

import time
from collections import Counter
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import text

from ..knowledge.definitions import Definitions
from .dialects.base import Session
from .dialects.words import Words
from .query import Query

# The maximum count; seconds until the next count; and the factor of change after which statements
# are rewritten.
COUNTED, COUNTED_FOR, CHANGED = 10_000, 10.0, 4
# The maximum count for the choice between reading a whole predicate and many lookups.
COUNTED_OF_MANY = 100_000
# Objects that represent their type, and the maximum count of their atoms.
SAMPLE, MENTIONED = 8, 20_000


class Estimates:
    """The numbers of facts that hold by predicate, and of atoms by the objects they mention.

    Attributes:
        generation: changes with the numbers; statements are kept by it.
    """

    def __init__(self) -> None:
        self.generation = 0
        # By predicate, or by objects: the number, and up to which number it was counted.
        self.sizes: dict[int | tuple[int, ...], tuple[int, int]] = {}
        self._counted_at = time.monotonic()

    def current(self, session: Session, kb_id: int | None) -> int:
        """Return the generation; count again when that was long ago."""
        if time.monotonic() - self._counted_at > COUNTED_FOR:
            self._counted_at = time.monotonic()
            for of, (known, counted) in list(self.sizes.items()):
                # More than this need not be known again: it would take long.
                upto = min(counted, COUNTED)
                size, now = min(known, upto), _count(session, kb_id, of, upto)
                if not size <= CHANGED * now <= CHANGED * CHANGED * size:
                    self.sizes[of] = now, upto
                    self.generation += 1
        return self.generation


class Size(NamedTuple):
    """The estimates for one statement, counted in a session."""

    estimates: Estimates
    session: Session
    kb_id: int | None

    def facts(self, predicate: int, compared: float) -> float:
        """Estimate the number of facts of a predicate, for a comparison with a number."""
        return self._counted(predicate, max(int(min(compared, COUNTED_OF_MANY)), COUNTED))

    def mentions(self, objects: tuple[int, ...]) -> float:
        """Return the average number of atoms, of any time, that mention one of some objects."""
        return self._counted(objects, MENTIONED) / max(len(objects), 1)

    def _counted(self, of: int | tuple[int, ...], upto: int) -> int:
        sizes = self.estimates.sizes
        size, counted = sizes.get(of, (0, 0))
        if size >= counted < upto:
            size = _count(self.session, self.kb_id, of, upto)
            sizes[of] = size, upto
        return size


def estimates_of(definitions: Definitions) -> Estimates:
    """Return the estimates cached with definitions."""
    found: Estimates | None = definitions.derived.get(Estimates)
    if found is None:
        found = definitions.derived[Estimates] = Estimates()
    return found


@cache
def _counting(words: Words, of_predicate: bool) -> Query:
    """Count the facts of a predicate, or the atoms that mention one of some objects."""
    if of_predicate:
        rows = (
            "proposition_version AS v WHERE v.kb_id = :kb AND v.predicate_id = :of"
            f" AND {words.is_fact.format('v')} AND v.until IS NULL"
        )
    else:
        among = words.in_list.format("a.object_id", ":of")
        rows = f"proposition_argument AS a WHERE a.kb_id = :kb AND {among}"
    return Query(text(f"SELECT count(*) FROM (SELECT 1 FROM {rows} LIMIT :upto) AS counted"))


def _count(session: Session, kb_id: int | None, of: int | tuple[int, ...], upto: int) -> int:
    query = _counting(session.backend.words, isinstance(of, int))
    wanted: Any = of if isinstance(of, int) else session.list_value(of)
    [row] = session.rows(query, kb=kb_id, of=wanted, upto=upto)
    return int(row[0])


def sample(definitions: Definitions, types: frozenset[int] | None) -> tuple[int, ...]:
    """Return a few of the objects that fit some types."""
    samples: dict[frozenset[int] | None, tuple[int, ...]]
    samples = definitions.derived.setdefault(sample, {})
    found = samples.get(types)
    if found is None:
        ids = [
            object_.id
            for object_ in definitions.objects
            if types is None or not types.isdisjoint(object_.type_ids)
        ]
        found = samples[types] = tuple(ids[:: max(len(ids) // SAMPLE, 1)][:SAMPLE])
    return found


def domain_size(definitions: Definitions, types: frozenset[int] | None) -> int:
    """Return how many objects fit some types, at least 1."""
    sizes = definitions.derive(_sizes)
    return max(sizes[None] if types is None else sum(map(sizes.__getitem__, types)), 1)


def _sizes(definitions: Definitions) -> Counter[int | None]:
    """Count the objects of each type, and all of them."""
    return Counter(id_ for object_ in definitions.objects for id_ in (None, *object_.type_ids))
