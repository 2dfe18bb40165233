"""Named elements in memory: what is defined at one revision, found by id and by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isqrt
from typing import Generic, Protocol, TypeVar

from ..dto.name import fold
from ..errors import StoreIntegrityError


class Definition(Protocol):
    """What a named element is, at one revision; immutable, and equal when nothing changed."""

    @property
    def id(self) -> int:
        """The identity's id."""

    @property
    def name(self) -> str:
        """The name, in its first spelling."""

    @property
    def text(self) -> str:
        """The canonical PDDL text."""


D = TypeVar("D", bound=Definition)


class Elements(Generic[D]):
    """The live definitions of one kind of element, and every id that is known of the kind.

    A snapshot that threads share: `evolve` makes the next one. It keeps recent changes apart from
    the bulk, so that one change in a large knowledge base does not copy it.
    """

    __slots__ = ("_base", "_delta", "ids")

    def __init__(
        self,
        ids: dict[str, int] | None = None,
        base: dict[int, D] | None = None,
        delta: dict[int, D | None] | None = None,
    ) -> None:
        # Folded name -> id. An identity is for ever, so all snapshots share one growing map.
        self.ids: dict[str, int] = {} if ids is None else ids
        self._base: dict[int, D] = base or {}
        self._delta: dict[int, D | None] = delta or {}

    def get(self, id_: int | None) -> D | None:
        """Find a live definition by id.

        Args:
            id_: the id; None finds nothing.

        Returns:
            The definition, or None.
        """
        if id_ in self._delta:
            return self._delta[id_]
        return self._base.get(id_) if id_ is not None else None

    def live(self, id_: int) -> D:
        """Give a definition that something live refers to.

        Args:
            id_: the id.

        Returns:
            The definition.

        Raises:
            StoreIntegrityError: it is not live, so what refers to it should not be either.
        """
        definition = self.get(id_)
        if definition is None:
            raise StoreIntegrityError(
                f"element {id_} is referred to but not live; the tables were changed by hand"
            )
        return definition

    def named(self, name: str) -> D | None:
        """Find a live definition by name, in any spelling.

        Args:
            name: the name.

        Returns:
            The definition, or None.
        """
        return self.get(self.ids.get(fold(name)))

    def __iter__(self) -> Iterator[D]:
        """Give the live definitions, in the order in which the elements were first known."""
        if not self._delta:
            live = list(self._base.values())
        else:
            merged: dict[int, D | None] = {**self._base, **self._delta}
            live = [definition for definition in merged.values() if definition is not None]
        return iter(sorted(live, key=lambda definition: definition.id))

    def evolve(self, changes: Mapping[int, D | None]) -> Elements[D]:
        """Make the snapshot that follows.

        Args:
            changes: the new definition of each element that changed; None when it is gone.

        Returns:
            The new snapshot; this one stays as it is.
        """
        for definition in changes.values():
            if definition is not None:
                self.ids[fold(definition.name)] = definition.id
        return self._changed(changes)

    def _changed(self, changes: Mapping[int, D | None]) -> Elements[D]:
        if not changes:
            return self
        delta = {**self._delta, **changes}
        if len(delta) <= 64 + isqrt(len(self._base)):
            return Elements(self.ids, self._base, delta)
        base = dict(self._base)
        for id_, definition in delta.items():
            if definition is None:
                base.pop(id_, None)
            else:
                base[id_] = definition
        return Elements(self.ids, base)


class PendingElements(Elements[D]):
    """The definitions as a transaction has changed them so far, over those that it began with."""

    __slots__ = ("changes", "interned", "origin", "unwritten")

    def __init__(self, origin: Elements[D]) -> None:
        super().__init__(origin.ids, origin._base, origin._delta)
        self.origin = origin
        self.changes: dict[int, D | None] = {}
        # Folded name -> id and first spelling of what the transaction looked up or gave out, None
        # for a name that nothing ever had. An id that it gives out is nobody's if it rolls back.
        self.interned: dict[str, tuple[int, str] | None] = {}
        # Id -> name, of the identities that have no row yet.
        self.unwritten: dict[int, str] = {}

    def get(self, id_: int | None) -> D | None:
        """Find a definition by id, as changed so far."""
        if id_ in self.changes:
            return self.changes[id_]
        return super().get(id_)

    def named(self, name: str) -> D | None:
        """Find a definition by name, as changed so far."""
        return self.get(self.id_of(name))

    def id_of(self, name: str) -> int | None:
        """Find the id of an element that is, was, or is about to be known.

        Args:
            name: its name, in any spelling.

        Returns:
            The id, or None when none is known here; the database may know one.
        """
        key = fold(name)
        id_ = self.ids.get(key)
        if id_ is None and (identity := self.interned.get(key)) is not None:
            return identity[0]
        return id_

    def __iter__(self) -> Iterator[D]:
        """Give the live definitions, as changed so far."""
        return iter(self.evolved())

    def evolved(self) -> Elements[D]:
        """Make the snapshot that holds once the transaction is committed.

        Returns:
            The snapshot. The map of names is not touched before `publish`.
        """
        return Elements(self.ids, self._base, self._delta)._changed(self.changes)

    def publish(self) -> Elements[D]:
        """Make the snapshot after the commit, and let all know the ids that were given out.

        Returns:
            The snapshot.
        """
        self.ids.update(
            (key, found[0])
            for key, found in self.interned.items()
            if found is not None and found[0] not in self.unwritten
        )
        return self.evolved()
