"""Tables of what is declared: repetitions that say the same are one, contradictions are refused."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, NamedTuple, TypeVar

from ..dto.formula import TypedName
from ..dto.name import ROOT_TYPE, fold
from .cursor import Cursor
from .hierarchy import Types
from .symbols import Symbols
from .typed_lists import Group, ListReader

Element = TypeVar("Element")


class Table(Generic[Element]):
    """What is declared under names, in the order of first appearance.

    Args:
        kind: what is declared, for messages.
        meaning: gives what two declarations of a name must have in common.
    """

    def __init__(self, kind: str, meaning: Callable[[Element], Hashable]) -> None:
        self._kind = kind
        self._meaning = meaning
        self._elements: dict[str, tuple[Element, object]] = {}

    def __contains__(self, name: str) -> bool:
        return fold(name) in self._elements

    def elements(self) -> tuple[Element, ...]:
        """Give what is declared.

        Returns:
            The elements, in order.
        """
        return tuple([element for element, _ in self._elements.values()])

    def add(self, cursor: Cursor, name: str, element: Element, at: int) -> bool:
        """Declare something.

        Args:
            cursor: the reader.
            name: its name.
            element: what is declared.
            at: the index of the name's token.

        Returns:
            Whether it is new.
        """
        source = cursor.section.text
        known, first = self._elements.setdefault(fold(name), (element, source))
        if known is element:
            return True
        if self._meaning(known) != self._meaning(element):
            found = f"another {self._kind} {name}, which differs from the first"
            cursor.fail(f"one {self._kind} of that name", found, at)
        if first is source:
            cursor.deviate(f"each {self._kind} once", "left out", f"'{name}' again", at)
        return False


class _Entry(NamedTuple):
    name: str
    types: Types
    reader: ListReader
    types_at: int


class NameTable:
    """Names with types, which are looked up when all types are known.

    Args:
        kind: what is named, for messages.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._entries: dict[str, _Entry] = {}

    def __contains__(self, name: str) -> bool:
        return fold(name) in self._entries

    def names(self) -> list[str]:
        """Give the names.

        Returns:
            The names, as declared, in order.
        """
        return [entry.name for entry in self._entries.values()]

    def add(self, reader: ListReader, name: str, group: Group, at: int) -> bool:
        """Declare a name.

        Args:
            reader: the reader of the list that it is in.
            name: the name.
            group: the names of the same type that it is among.
            at: the index of its token.

        Returns:
            Whether it is new.
        """
        key = fold(name)
        known = self._entries.get(key)
        if known is None:
            self._entries[key] = _Entry(name, group.types, reader, group.types_at)
            return True
        same_source = known.reader.section.text is reader.section.text
        types = self._united(known, name, group.types, reader, at)
        if same_source:
            together = TypedName("", types or (ROOT_TYPE,)).type_text
            repeated = f"the {self._kind} '{name}' again"
            reader.deviate(f"each {self._kind} once", f"read as {together}", repeated, at)
        if types != known.types:
            self._entries[key] = _Entry(known.name, types, reader, group.types_at)
        return False

    def _united(self, known: _Entry, name: str, types: Types, reader: ListReader, at: int) -> Types:
        """The types of a name that is declared twice."""
        first = {fold(one): one for one in known.types}
        second = {fold(one): one for one in types}
        if first.keys() == second.keys() or second.keys() <= {ROOT_TYPE}:
            return known.types
        if first.keys() <= {ROOT_TYPE}:
            return types
        other = known.reader.section.text
        if other is not reader.section.text:
            found = f"the {self._kind} '{name}' of another type"
            expected = f"{TypedName('', known.types).type_text}, as in {other.name}"
            reader.fail(expected, found, at)
        return tuple((first | second).values())

    def resolve(self, symbols: Symbols) -> list[TypedName]:
        """Look up the types.

        Args:
            symbols: the names that are declared.

        Returns:
            The names, with their types in the declared spelling.
        """
        found: list[TypedName] = []
        memo: dict[tuple[Types, int], Types] = {}
        for entry in self._entries.values():
            key = (entry.types, id(entry.reader))
            types = memo.get(key)
            if types is None:
                types = entry.reader.resolve(symbols, entry.types, entry.types_at)
                memo[key] = types
            found.append(TypedName(entry.name, types))
        return found

    def refuse(self, name: str, expected: str, found: str) -> None:
        """Refuse a name that is declared.

        Args:
            name: the name.
            expected: what is right.
            found: what is wrong.
        """
        entry = self._entries[fold(name)]
        entry.reader.fail(expected, found, entry.types_at)
