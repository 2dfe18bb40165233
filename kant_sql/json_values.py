"""Results as JSON, for the command line and the web.

A result is a frozen dataclass or a NamedTuple, and its document has its public fields, in order. A
class with another document lists its names in `_json_`: `*name` means all names of that field's own
document, and `key=name` a field under another key.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import datetime
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from .knowledge.canonical import time_text

JsonValue: TypeAlias = "str | int | float | bool | list[JsonValue] | dict[str, JsonValue] | None"

_PLAIN = frozenset((str, int, float, bool, type(None)))


class JsonField(NamedTuple):
    """A part of a document.

    Attributes:
        key: its key; None for all keys of the attribute's own document.
        name: the attribute.
    """

    key: str | None
    name: str


@cache
def json_fields(kind: type) -> tuple[JsonField, ...] | None:
    """Return the fields of the document of a class; None for a class that is not a result."""
    names: tuple[str, ...] | None = getattr(kind, "_json_", None)
    if names is None and is_dataclass(kind):
        names = tuple(one.name for one in fields(kind) if not one.name.startswith("_"))
    if names is None:
        names = getattr(kind, "_fields", None)
    return None if names is None else tuple(map(_field, names))


def _field(said: str) -> JsonField:
    key, _, name = said.rpartition("=")
    return JsonField(None, said[1:]) if said.startswith("*") else JsonField(key or name, name)


def json_value(value: object) -> JsonValue:
    """Convert a result, or a value that contains results, to JSON data.

    Times are in UTC, as 2026-03-02T14:03:00.000000Z; decimal numbers are strings.

    Raises:
        TypeError: a value of this class has no JSON form.
    """
    kind: type = type(value)
    return _writer(kind)(value)


@cache
def _writer(kind: type) -> Callable[[Any], JsonValue]:
    parts = json_fields(kind)
    if parts is not None:
        return _writer_of(parts)
    for bases, write in _WRITERS:
        if issubclass(kind, bases):
            return write
    raise TypeError(f"a {kind.__name__} is neither a JSON value nor a result")


def _writer_of(parts: tuple[JsonField, ...]) -> Callable[[Any], JsonValue]:
    def write(value: Any) -> JsonValue:
        document: dict[str, JsonValue] = {}
        for key, name in parts:
            found = getattr(value, name)
            if type(found) not in _PLAIN:
                found = json_value(found)
            if key is None:
                document.update(found)
            else:
                document[key] = found
        return document

    return write


_WRITERS: tuple[tuple[tuple[type, ...], Callable[[Any], JsonValue]], ...] = (
    ((str, int, float, type(None)), lambda value: value),
    ((datetime,), time_text),
    ((Decimal,), lambda value: f"{value:f}"),
    ((Path,), str),
    ((Mapping,), lambda value: {key: json_value(one) for key, one in value.items()}),
    ((Sequence,), lambda value: [json_value(one) for one in value]),
)
