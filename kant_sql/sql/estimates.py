"""How many facts of a predicate hold, about: what the order of a join is chosen by.

No database has statistics of what was loaded a moment ago, and SQLite never has any by itself. So a
part of each predicate's facts is counted when a condition is first written as a statement, and
again now and then: an order that was good for few facts may be bad for many.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from sqlalchemy import text

from ..knowledge.definitions import Definitions
from .dialects.base import Session
from .dialects.words import Words
from .query import Query

# Up to this number facts are counted; they are counted again after so many seconds, and statements
# are written anew when a number has changed so many times over.
COUNTED, COUNTED_FOR, CHANGED = 10_000, 10.0, 4
Size = Callable[[int], float]


class Estimates:
    """The numbers of facts that hold, by predicate.

    Attributes:
        generation: changes with the numbers; statements are kept by it.
    """

    def __init__(self) -> None:
        self.generation = 0
        self._sizes: dict[int, int] = {}
        self._counted_at = time.monotonic()

    def size(self, session: Session, kb_id: int | None, predicate: int) -> int:
        """Return how many facts of a predicate hold, up to `COUNTED`."""
        found = self._sizes.get(predicate)
        if found is None:
            found = self._sizes[predicate] = _count(session, kb_id, predicate)
        return found

    def current(self, session: Session, kb_id: int | None) -> int:
        """Return the generation; count again when that was long ago."""
        if time.monotonic() - self._counted_at > COUNTED_FOR:
            self._counted_at = time.monotonic()
            for predicate, size in list(self._sizes.items()):
                now = _count(session, kb_id, predicate)
                if not size <= CHANGED * now <= CHANGED * CHANGED * size:
                    self._sizes[predicate] = now
                    self.generation += 1
        return self.generation


def estimates_of(definitions: Definitions) -> Estimates:
    """Return the estimates that are kept with definitions."""
    found: Estimates | None = definitions.derived.get(Estimates)
    if found is None:
        found = definitions.derived[Estimates] = Estimates()
    return found


_queries: dict[Words, Query] = {}


def _count(session: Session, kb_id: int | None, predicate: int) -> int:
    words = session.backend.words
    query = _queries.get(words)
    if query is None:
        query = _queries[words] = Query(
            text(
                "SELECT count(*) FROM (SELECT 1 FROM proposition_version AS v WHERE v.kb_id = :kb"
                f" AND v.predicate_id = :predicate AND {words.is_fact.format('v')}"
                f" AND v.until IS NULL LIMIT {COUNTED}) AS counted"
            )
        )
    [row] = session.rows(query, kb=kb_id, predicate=predicate)
    return int(row[0])


def domain_size(definitions: Definitions, types: frozenset[int] | None) -> int:
    """Return how many objects fit some types, at least 1."""
    sizes: dict[int | None, int] | None = definitions.derived.get(domain_size)
    if sizes is None:
        sizes = {None: 0}
        for object_ in definitions.objects:
            sizes[None] += 1
            for type_id in object_.type_ids:
                sizes[type_id] = sizes.get(type_id, 0) + 1
        definitions.derived[domain_size] = sizes
    if types is None:
        return max(sizes[None], 1)
    return max(sum(sizes.get(type_id, 0) for type_id in types), 1)
