"""The hierarchy of types: the subtype relation, and cycles."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from enum import Enum
from typing import Generic, NamedTuple, TypeVar

Types = tuple[str, ...]
K = TypeVar("K", bound=Hashable)


class Fit(Enum):
    """Whether an argument of some types fits a parameter of some types."""

    YES = "yes"
    # The argument's type is a supertype of the parameter's: some of its objects fit.
    PERHAPS = "perhaps"
    NO = "no"


class _Place(NamedTuple, Generic[K]):
    """The place of a type: its distance from a root along first parents, and its ancestors."""

    depth: int
    parent: K | None
    # An ancestor, chosen to make each level reachable in logarithmically many steps.
    jump: K
    # The nearest type with several parents along first parents, itself included.
    fork: K | None


class Ancestry(Generic[K]):
    """The subtype relation; the cost of a check is logarithmic in the levels between two types.

    Each type knows its parent and a jump to an ancestor (E. W. Myers, An applicative random-access
    stack, 1983). A type with several parents continues at each of them, so a check costs a step for
    each such ancestor.

    Args:
        parents: returns the parents of a type, which must not change after the first call.
    """

    __slots__ = ("_parents", "_places")

    def __init__(self, parents: Callable[[K], Sequence[K]]) -> None:
        self._parents = parents
        self._places: dict[K, _Place[K]] = {}

    def is_below(self, lower: K, upper: K) -> bool:
        """Return whether a type equals another or is a subtype of it."""
        depth = self._place(upper).depth
        pending, seen = [lower], {lower}
        while pending:
            current = pending.pop()
            if self._is_on_path(current, upper, depth):
                return True
            fork = self._place(current).fork
            while fork is not None:
                others = self._parents(fork)[1:]
                if fork != current and fork in seen:
                    break
                seen.add(fork)
                pending += [other for other in others if other not in seen]
                seen.update(others)
                parent = self._places[fork].parent
                fork = None if parent is None else self._places[parent].fork
        return False

    def forget(self, type_: K) -> None:
        """Forget the place of a new type, which has no subtypes yet."""
        self._places.pop(type_, None)

    def _is_on_path(self, type_: K, upper: K, depth: int) -> bool:
        """Return whether a type, at a depth, is another or above it along first parents."""
        place = self._place(type_)
        while place.depth > depth:
            above = self._places[place.jump]
            if above.depth >= depth:
                type_ = place.jump
            elif place.parent is not None:
                type_ = place.parent
            place = self._places[type_]
        return type_ == upper

    def _place(self, type_: K) -> _Place[K]:
        found = self._places.get(type_)
        if found is not None:
            return found
        path: dict[K, Sequence[K]] = {}
        current: K | None = type_
        while current is not None and current not in self._places:
            above = path[current] = self._parents(current)
            # Only damaged tables have cycles.
            current = above[0] if above and above[0] not in path else None
        for one in reversed(path):
            self._places[one] = self._below(one, current, path[one])
            current = one
        return self._places[type_]

    def _below(self, type_: K, parent: K | None, parents: Sequence[K]) -> _Place[K]:
        if parent is None:
            return _Place(0, None, type_, type_ if len(parents) > 1 else None)
        above = self._places[parent]
        jump = self._places[above.jump]
        is_equal = above.depth - jump.depth == jump.depth - self._places[jump.jump].depth
        fork = type_ if len(parents) > 1 else above.fork
        return _Place(above.depth + 1, parent, jump.jump if is_equal else parent, fork)


def find_cycle(parents: Mapping[str, Types]) -> str | None:
    """Return a type that is its own ancestor, or None."""
    children: dict[str, list[str]] = {}
    waiting = {type_: sum(1 for one in above if one in parents) for type_, above in parents.items()}
    for type_, above in parents.items():
        for parent in above:
            children.setdefault(parent, []).append(type_)
    ready = [type_ for type_, count in waiting.items() if not count]
    while ready:
        type_ = ready.pop()
        del waiting[type_]
        for child in children.get(type_, ()):
            waiting[child] -= 1
            if not waiting[child]:
                ready.append(child)
    seen: set[str] = set()
    type_ = next(iter(waiting), "")
    while type_ not in seen and waiting:
        seen.add(type_)
        type_ = next(one for one in parents[type_] if one in waiting)
    return type_ or None
