"""Facts in memory: sets of tuples with indexes on demand."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from operator import itemgetter

# The names of a fact's objects.
Row = tuple[str, ...]


def picker(positions: tuple[int, ...]) -> Callable[[Row | list[str]], Row]:
    """Return a function that picks items as a tuple."""
    if len(positions) > 1:
        return itemgetter(*positions)
    if not positions:
        return lambda row: ()
    only = positions[0]
    return lambda row: (row[only],)


class Relation:
    """The facts of one predicate.

    Attributes:
        rows: the facts; to be changed by the methods alone.
    """

    __slots__ = ("_indexes", "rows")

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self.rows: set[Row] = set(rows)
        self._indexes: dict[
            tuple[int, ...], tuple[Callable[[Row | list[str]], Row], dict[Row, set[Row]]]
        ] = {}

    def add(self, row: Row) -> bool:
        """Add a fact; return False if it is there."""
        if row in self.rows:
            return False
        self.rows.add(row)
        for pick, index in self._indexes.values():
            index.setdefault(pick(row), set()).add(row)
        return True

    def discard(self, row: Row) -> bool:
        """Remove a fact; return False if it is not there."""
        if row not in self.rows:
            return False
        self.rows.discard(row)
        for pick, index in self._indexes.values():
            index[pick(row)].discard(row)
        return True

    def clear(self) -> None:
        """Remove all facts."""
        self.rows.clear()
        self._indexes.clear()

    def lookup(self, positions: tuple[int, ...]) -> Callable[[Row], Collection[Row]]:
        """Return a function from objects at some positions to the facts that have them."""
        if not positions:
            return lambda key: self.rows
        return lambda key: self._index(positions).get(key, ())

    def _index(self, positions: tuple[int, ...]) -> dict[Row, set[Row]]:
        found = self._indexes.get(positions)
        if found is not None:
            return found[1]
        pick, index = picker(positions), dict[Row, set[Row]]()
        for row in self.rows:
            index.setdefault(pick(row), set()).add(row)
        self._indexes[positions] = pick, index
        return index
