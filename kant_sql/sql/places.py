"""The beginning of a page: after a row, identified by its key, not by its number."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from sqlalchemy import BigInteger, ColumnElement, Text, bindparam, tuple_

from ..arguments import UNSTORABLE, shown
from ..errors import InvalidArgumentError

Key = tuple[int | str | None, ...]

# The characters of a text in an address; rows with the same beginning are skipped one by one.
_LENGTH = 200
_MOST = 2**63 - 1


class Place(NamedTuple):
    """The end of a page."""

    passed: int = 0  # the number of rows before
    key: Key = ()  # the key of the last of them, or its beginning
    skip: int = 0  # the number of rows before that have this key, or follow it in the order

    @property
    def types(self) -> tuple[type, ...]:
        """The types of the key, on which its statement depends."""
        return tuple(map(type, self.key))

    def of(self, name: str = "after") -> dict[str, Any]:
        """Return the parameters of `from_place`, and `skip`."""
        return {"skip": self.skip, **{f"{name}{n}": one for n, one in enumerate(self.key)}}

    def behind(self, keys: Sequence[Key]) -> Place:
        """Return the end of a page from here with these keys, in order."""
        *same, last = keys[-1]
        begin = last[:_LENGTH] if isinstance(last, str) else last
        key: Key = (*same, begin)
        skip = sum(one[:-1] == key[:-1] and _is_from(one[-1], begin) for one in keys)
        if skip == len(keys) and key == self.key:
            skip += self.skip
        return Place(self.passed + len(keys), key, skip)


def _is_from(last: Any, begin: Any) -> bool:
    return bool(last >= begin)


def from_place(
    columns: Sequence[Any], types: Sequence[type], name: str = "after"
) -> ColumnElement[bool]:
    """Return whether a row has the key of a place, with these types, or follows it."""
    values = [
        bindparam(f"{name}{n}", type_=Text() if one is str else BigInteger())
        for n, one in enumerate(types)
    ]
    return tuple_(*columns) >= tuple_(*values)


def place_text(*places: Place | None) -> str | None:
    """Write where the lists of a page continue; None if none does."""
    if not any(places):
        return None
    return json.dumps(places, ensure_ascii=False, separators=(",", ":"))


def read_place(text: str | None, *kinds: tuple[type, ...]) -> Place:
    """Read a place of one list from `place_text`, with a key of one of these types."""
    return read_places(text, 1, *kinds)[0] or Place()


def read_places(text: str | None, count: int, *kinds: tuple[type, ...]) -> list[Place | None]:
    """Read the places of several lists from `place_text`, with keys of these types."""
    if not text:
        return [Place()] * count
    try:
        given = json.loads(text)
        if not isinstance(given, list) or len(given) != count:
            raise ValueError
        return [None if one is None else _checked(one, kinds) for one in given]
    except (ValueError, TypeError, RecursionError):
        raise InvalidArgumentError(
            f"after is {shown(text)}, expected the value of `next` of a page"
        ) from None


def _checked(given: Any, kinds: Sequence[tuple[type, ...]]) -> Place:
    passed, key, skip = given
    if tuple(map(type, key)) not in kinds:
        raise ValueError
    for number in (passed, skip, *(one for one in key if isinstance(one, int))):
        if type(number) is not int or not 0 <= number <= _MOST:
            raise ValueError
    for one in key:
        if isinstance(one, str) and UNSTORABLE.search(one):
            raise ValueError
    return Place(passed, tuple(key), skip)
