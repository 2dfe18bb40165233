"""Interned fluents and their values: what a function gives for some objects."""

from __future__ import annotations

from decimal import Decimal
from typing import Any, NamedTuple

from .atoms import InternCache
from .dto.pddl_function_value_dto import value_text
from .errors import reading_rows
from .knowledge.past import HOLDS_NOW


class FluentKey(NamedTuple):
    """What makes a fluent the one that it is.

    Attributes:
        function_id: its function.
        arguments: the ids of its objects in order, separated by spaces.
    """

    function_id: int
    arguments: str


class Fluent(NamedTuple):
    """An interned fluent.

    Attributes:
        id: its id.
        key: what makes it the one that it is.
        text: its canonical PDDL text, without a value.
    """

    id: int
    key: FluentKey
    text: str


class FluentValue(NamedTuple):
    """What a fluent is.

    Attributes:
        text: the number, as exact decimal text, or the object's name.
        object_id: the object; None for a number.
    """

    text: str
    object_id: int | None = None

    def is_same(self, other: FluentValue | None) -> bool:
        """Tell whether a value is another one: 10 and 10.0 are the same number.

        Args:
            other: the other; None for no value.

        Returns:
            Whether they are the same.
        """
        if other is None or self.object_id != other.object_id:
            return False
        if self.text == other.text or self.object_id is not None:
            return True
        return Decimal(self.text) == Decimal(other.text)


class HeldValue(NamedTuple):
    """A fluent and what it is.

    Attributes:
        fluent: the fluent.
        value: its value.
    """

    fluent: Fluent
    value: FluentValue

    @property
    def text(self) -> str:
        """The canonical PDDL text, for example `(= (distance wp1 wp2) 10)`."""
        return value_text(self.fluent.text, self.value.text)


def read_value(fluent: str, held: str, object_id: int | None) -> FluentValue:
    """Read a value from its canonical text, where it stands between the fluent and the end.

    Args:
        fluent: the fluent's text.
        held: the text of fluent and value.
        object_id: the object that it is; None for a number.

    Returns:
        The value.

    Raises:
        StoreIntegrityError: the text is that of another fluent, or has no number.
    """
    begin = value_text(fluent, "")[:-1]
    text = held[len(begin) : -1]
    with reading_rows("function_value_version", f"the value of {fluent!r}"):
        if not held.startswith(begin) or (object_id is None and not Decimal(text).is_finite()):
            raise ValueError(f"{held!r} is no value of it")
    return FluentValue(text, object_id)


def version_row(kb_id: int, number: int, fluent: Fluent, value: FluentValue) -> tuple[Any, ...]:
    """Give the row of a value that is asserted.

    Args:
        kb_id: the knowledge base.
        number: the revision that asserts it.
        fluent: the fluent.
        value: its value.

    Returns:
        The values of the row, in the order of the table's columns.
    """
    text, object_id = value
    is_number = object_id is None
    return (
        kb_id,
        fluent.id,
        number,
        None,
        fluent.key.function_id,
        text if is_number else None,
        float(text) if is_number else None,
        object_id,
        value_text(fluent.text, text),
        HOLDS_NOW,
    )


# Of a fluent, its value is known; None: it has none.
FluentCache = InternCache[FluentKey, Fluent, FluentValue | None]
