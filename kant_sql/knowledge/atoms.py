"""Ground atoms and fluents: their keys, their texts, and values of fluents."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import Any, NamedTuple, Self

from ..dto.elements import atom_text, value_text
from ..errors import reading_rows
from .definitions import Definitions


class AtomKey(NamedTuple):
    """The key of a proposition."""

    is_goal: bool  # whether it is a goal rather than a fact
    predicate_id: int
    arguments: str  # the ids of its objects in order, separated by spaces

    def text(self, definitions: Definitions) -> str:
        """Write the proposition."""
        name = definitions.predicates.live(self.predicate_id).name
        return atom_text(name, definitions.names(self.arguments))


class GroundAtom(NamedTuple):
    """An interned proposition."""

    id: int
    key: AtomKey  # its predicate and its arguments
    text: str  # its canonical PDDL text

    @classmethod
    def of(cls, row: Sequence[Any]) -> Self:
        """Make it of a row of `AtomTables.identities`."""
        id_, is_goal, predicate_id, arguments, text = row
        return cls(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)


class FluentKey(NamedTuple):
    """The key of a fluent."""

    function_id: int
    arguments: str  # the ids of its objects in order, separated by spaces

    def text(self, definitions: Definitions) -> str:
        """Write the fluent, without a value."""
        name = definitions.functions.live(self.function_id).name
        return atom_text(name, definitions.names(self.arguments))


class GroundFluent(NamedTuple):
    """An interned fluent."""

    id: int
    key: FluentKey  # its function and its arguments
    text: str  # its canonical PDDL text, without a value

    @classmethod
    def of(cls, row: Sequence[Any]) -> Self:
        """Make it of a row of `AtomTables.identities`."""
        id_, function_id, arguments, text = row
        return cls(id_, FluentKey(function_id, arguments), text)


class FluentValue(NamedTuple):
    """The value of a fluent."""

    text: str  # the number, as exact decimal text, or the object's name
    object_id: int | None = None  # the object; None for a number

    def is_same(self, other: FluentValue | None) -> bool:
        """Return whether two values are equal: 10 and 10.0 are the same number."""
        if other is None or self.object_id != other.object_id:
            return False
        if self.text == other.text or self.object_id is not None:
            return True
        return Decimal(self.text) == Decimal(other.text)

    @classmethod
    def of(cls, fluent: str, held: str, object_id: int | None) -> Self:
        """Read it from the canonical text, after the fluent."""
        begin = value_text(fluent, "")[:-1]
        text = held[len(begin) : -1]
        with reading_rows("function_value_version", f"the value of {fluent!r}"):
            if not held.startswith(begin) or (object_id is None and not Decimal(text).is_finite()):
                raise ValueError(f"{held!r} is not a value of it")
        return cls(text, object_id)


class HeldValue(NamedTuple):
    """A fluent and its value."""

    fluent: GroundFluent
    value: FluentValue

    @classmethod
    def of(cls, fluent: GroundFluent, held: str, object_id: int | None) -> Self:
        """Read it from its canonical text."""
        return cls(fluent, FluentValue.of(fluent.text, held, object_id))

    @property
    def text(self) -> str:
        """The canonical PDDL text, for example `(= (distance wp1 wp2) 10)`."""
        return value_text(self.fluent.text, self.value.text)
