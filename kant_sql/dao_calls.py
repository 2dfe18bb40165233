"""Calls of DAOs as JSON, which the server and the DAO family over HTTP exchange.

A document is `{"pool": [...], "value": ...}`. The pool has each DTO, node and typed name once, as
`{"PddlTypeDto": {"name": "robot", "parent": null}}`, behind what it refers to: `{"ref": 0}` is the
first of the pool. Texts, booleans, integers, finite floats, lists and null are themselves; other
values are `{"decimal": "0.1"}`, `{"float": "nan"}`, `{"map": {...}}`, `{"time":
"2026-01-31T09:30:00+00:00"}`, and `{"other": [class, text]}` for invalid arguments.
"""

from __future__ import annotations

import inspect
import ipaddress
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from datetime import datetime
from decimal import Decimal
from functools import cached_property, lru_cache
from typing import Any, get_type_hints

from . import dto as dtos
from .arguments import shown
from .dto import Dto, PddlEitherTypeDto, formulas
from .dto.formulas import Checked, Node
from .errors import InvalidArgumentError, InvalidKnowledgeError, TypeCycleError, printable
from .json_values import JsonValue
from .knowledge_base import KnowledgeBase, PddlParts

# Shared by the server and its clients.
DAO_PATH = "/api/dao"
TRANSACTION_PATH = f"{DAO_PATH}/transaction"
TOKEN_VARIABLE = "KANT_SQL_TOKEN"
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
# Bytes of a request's address, with its headers, and of its body; and elements in that.
LONGEST_HEAD = 256 << 10
LONGEST_BODY, MOST_CHANGES = 16 << 20, 100_000
# Levels of lists in lists: no argument has more than three.
_DEEPEST = 8
# No number of a store has a longer integer or decimal text.
_MOST_BITS, _LONGEST_NUMBER = 4_000, 1_000
# The limit to which a document may unfold, or so many times its pool: formulas nest 50 levels.
_MOST_PARTS, _PARTS_EACH, _CHARACTERS = 1_000_000, 50, 32

_PLAIN = {str, bool, int, float, type(None)}

# The classes of a pool, by name.
CLASSES: dict[str, type] = {
    name: found
    for module in (dtos, formulas)
    for name, found in vars(module).items()
    if isinstance(found, type) and issubclass(found, Dto | Checked) and is_dataclass(found)
}
_FIELDS = {name: inspect.signature(found).parameters.keys() for name, found in CLASSES.items()}
# Classes whose texts contain the whole texts of their references.
_UNFOLDED = {name for name, found in CLASSES.items() if issubclass(found, Node | PddlEitherTypeDto)}

# The interface of each DAO, by its attribute of a knowledge base or of its `pddl`.
KINDS: dict[str, type] = {
    name: get_type_hints(member.func)["return"]
    for front in (KnowledgeBase, PddlParts)
    for name, member in vars(front).items()
    if isinstance(member, cached_property) and hasattr(member.func, "__wrapped__")
    if name != "plans"
}


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address."""
    if host in LOOPBACK:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def is_read(do: str) -> bool:
    """Return whether a method of a DAO only reads."""
    return do.startswith("get")


def dao_of(kb: KnowledgeBase, kind: str) -> Any:
    """Return a DAO, of a knowledge base or of its `pddl`."""
    return getattr(kb if hasattr(type(kb), kind) else kb.pddl, kind)


def call(kb: KnowledgeBase, kind: str, do: str, arguments: object, *, reads: bool) -> Any:
    """Call a reading or writing method of a DAO with a document of its arguments."""
    interface = KINDS.get(kind)
    known: frozenset[str] = getattr(interface, "__abstractmethods__", frozenset())
    if do not in known or is_read(do) is not reads:
        raise InvalidArgumentError(
            f"{shown(kind)} have no method {shown(do)} that {'reads' if reads else 'writes'}"
        )
    dao = dao_of(kb, kind)
    try:
        given = inspect.signature(getattr(interface, do)).bind(dao, **keywords(arguments))
    except TypeError as error:
        raise InvalidArgumentError(f"{kind}.{do}: {error}") from error
    return getattr(dao, do)(*given.args[1:], **given.kwargs)


def keywords(arguments: object) -> dict[str, Any]:
    """Read a document of arguments by name."""
    named = read(arguments)
    if not isinstance(named, dict):
        raise InvalidArgumentError(f"the arguments are a map of names, not {shown(named)}")
    return named


def document(value: Any) -> dict[str, JsonValue]:
    """Write a value: a result of a DAO, or a dictionary of its arguments.

    Raises:
        TypeCycleError: a DTO refers to itself.
        InvalidKnowledgeError: a DTO lacks a field.
    """
    writer = _Writer()
    for one in _parts(value):
        writer.add(one)
    return {"pool": writer.pool, "value": writer.value(value)}


def _found(kind: type) -> str | None:
    """Return the name of a class, or of its base class in the pool."""
    return next((one.__name__ for one in kind.__mro__ if CLASSES.get(one.__name__) is one), None)


_name_of: Callable[[type], str | None] = lru_cache(maxsize=256)(_found)


def _parts(value: Any, level: int = _DEEPEST) -> Iterator[Any]:
    """Yield the parts of a value that belong in the pool."""
    if _name_of(type(value)) is not None:
        yield value
    elif level and isinstance(value, list | tuple | dict):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _parts(one, level - 1)


class _Writer:
    def __init__(self) -> None:
        self.pool: list[JsonValue] = []
        # By identity; None while its references are being written.
        self._places: dict[int, int | None] = {}

    def add(self, root: Any) -> None:
        """Write a DTO or node after its references, at any depth."""
        places, stack = self._places, [root]
        while stack:
            one = stack[-1]
            if places.get(id(one)) is not None:
                stack.pop()
                continue
            name = _name_of(type(one))
            assert name is not None
            try:
                fields = {field: getattr(one, field) for field in _FIELDS[name]}
            except AttributeError as error:
                raise InvalidKnowledgeError(f"a {name} lacks a field: {error}") from error
            inner = [part for value in fields.values() for part in _parts(value)]
            if any(places.get(id(part), 0) is None for part in inner):
                raise TypeCycleError(
                    f"{name} {shown(getattr(one, 'name', ''))} would be its own ancestor: it "
                    "refers to itself; leave out one of the references"
                )
            if missing := [part for part in inner if id(part) not in places]:
                places[id(one)] = None
                stack += missing
                continue
            places[id(one)] = len(self.pool)
            own = {field: self.value(value) for field, value in fields.items()}
            self.pool.append({name: own})
            stack.pop()

    def value(self, value: Any, level: int = _DEEPEST) -> JsonValue:
        """Write a value whose parts are in the pool."""
        if value is None or isinstance(value, str | bool):
            return value
        if isinstance(value, int) and int.bit_length(value) <= _MOST_BITS:
            return int(value)
        if isinstance(value, float):
            return float(value) if math.isfinite(value) else {"float": float.__repr__(value)}
        if isinstance(value, Decimal):
            return {"decimal": str(value)}
        if isinstance(value, datetime):
            return {"time": value.isoformat()}
        place = self._places.get(id(value)) if _name_of(type(value)) is not None else None
        if place is not None:
            return {"ref": place}
        if level and isinstance(value, list | tuple):
            return [self.value(one, level - 1) for one in value]
        if level and isinstance(value, dict) and all(isinstance(key, str) for key in value):
            return {"map": {key: self.value(one, level - 1) for key, one in value.items()}}
        return {"other": [type(value).__name__, shown(value)]}


def read(given: object) -> Any:
    """Read a document; only the classes of `CLASSES` are made, by their constructors.

    Raises:
        InvalidArgumentError: it is not a document, or unfolds to too much.
        InvalidKnowledgeError: a DTO or node in it is not well-formed.
    """
    if not (isinstance(given, dict) and isinstance(given.get("pool"), list) and "value" in given):
        raise _malformed(given, "a document, {'pool': [...], 'value': ...}")
    reader = _Reader(_MOST_PARTS + _PARTS_EACH * len(given["pool"]))
    for one in given["pool"]:
        reader.add(one)
    return reader.value(given["value"])


def _malformed(given: object, expected: str) -> InvalidArgumentError:
    return InvalidArgumentError(f"expected {expected}, not {shown(given)}")


class _Reader:
    def __init__(self, left: int) -> None:
        self._left = left
        # With the size that each unfolds to in a reference.
        self._pool: list[tuple[object, int]] = []

    def add(self, given: object) -> None:
        """Make the next item of the pool."""
        name, fields = _only(given)
        made = CLASSES.get(name)
        if made is None or not isinstance(fields, dict) or not fields.keys() <= _FIELDS[name]:
            raise _malformed(given, "a DTO or a node with its fields")
        before = self._left
        own = {field: self.value(value) for field, value in fields.items()}
        try:
            item = made(**own)
        except TypeError as error:
            raise _malformed(given, f"the fields of a {name} ({error})") from error
        unfolds = before - self._left
        if name not in _UNFOLDED:
            unfolds = sum(len(one) for one in own.values() if type(one) is str) // _CHARACTERS
        self._pool.append((item, 1 + unfolds))

    def value(self, given: Any, level: int = _DEEPEST) -> Any:
        """Read a value."""
        kind = type(given)
        self._spend(1 + len(given) // _CHARACTERS if kind is str else 1)
        if kind in _PLAIN:
            return given
        if kind is list and level:
            return [self.value(one, level - 1) for one in given]
        tag, inner = _only(given)
        if tag == "ref" and type(inner) is int and 0 <= inner < len(self._pool):
            item, weight = self._pool[inner]
            self._spend(weight)
            return item
        if tag == "map" and isinstance(inner, dict) and level:
            return {key: self.value(one, level - 1) for key, one in inner.items()}
        make = _SCALARS.get(tag)
        made = None if make is None else make(inner)
        if made is None:
            raise _malformed(given, "a value")
        return made

    def _spend(self, parts: int) -> None:
        self._left -= parts
        if self._left < 0:
            raise InvalidArgumentError(
                "the document is too large with its references; give fewer elements"
            )


def _only(given: object) -> tuple[str, Any]:
    """Return the key and the value of an object with one member."""
    if not isinstance(given, dict) or len(given) != 1:
        raise _malformed(given, "a value")
    ((key, inner),) = given.items()
    return key, inner


def _decimal(text: object) -> Decimal | None:
    if not isinstance(text, str) or len(text) > _LONGEST_NUMBER:
        return None
    try:
        return Decimal(text)
    except ArithmeticError:
        return None


def _float(text: object) -> float | None:
    return float(text) if isinstance(text, str) and text in ("nan", "inf", "-inf") else None


def _time(text: object) -> datetime | None:
    try:
        return datetime.fromisoformat(text) if isinstance(text, str) else None
    except ValueError:
        return None


def _other(given: object) -> object:
    """Make a stand-in that is refused like the value it represents."""
    if not (isinstance(given, list) and len(given) == 2 and all(isinstance(p, str) for p in given)):
        return None
    name, text = given
    return type(printable(name[:80]), (), {"__repr__": lambda _: text})()


_SCALARS: Mapping[str, Callable[[object], object]] = {
    "decimal": _decimal,
    "float": _float,
    "time": _time,
    "other": _other,
}
