"""Whether a text contains another: the rule of all filters by text, in SQL and in Python.

It ignores the case of every letter: KÜCHE finds Küche. SQLite knows the case of ASCII letters
only, and PostgreSQL that of its locale, so a pattern names each spelling of a letter.
"""

from __future__ import annotations

from functools import cache
from typing import Any
from unicodedata import normalize

from sqlalchemy import ColumnElement, bindparam

from ...arguments import UNSTORABLE
from ...errors import InvalidArgumentError
from ..query import Condition, write_as
from .base import Session
from .words import OPERATORS

# SQLite refuses patterns of more than 50,000 bytes; a letter takes at most 14.
LONGEST_SOUGHT = 3_500
# The special characters of patterns, and their escapes, by dialect.
_SPECIAL = {"sqlite": ("*?[", "[{}]"), "postgresql": (".^$*+?()[]{}|\\", "\\{}")}
# No letter beyond this has a case.
_CASED = 0x20000


class _Contains(Condition):
    """Whether a text fits the pattern of a parameter."""

    inherit_cache = True
    name = "contains"


for _dialect, _operator in OPERATORS.items():
    write_as(_Contains, f"({{0}}) {_operator} {{1}}", _dialect)


def contains(column: Any, parameter: str = "pattern") -> ColumnElement[bool]:
    """Return whether a text fits a parameter from `pattern_of`."""
    return _Contains(column, bindparam(parameter))


def pattern_of(
    session: Session,
    text: str,
    *,
    begins: bool = False,
    ends: bool = False,
    is_composed: bool = True,
) -> str:
    """Return the pattern of texts that contain a text, or begin or end with it.

    Names are stored with composed letters, so the text is composed, unless you disable that.

    Raises:
        InvalidArgumentError: no text can contain it.
    """
    dialect = session.backend.dialect.name
    if UNSTORABLE.search(text):
        raise InvalidArgumentError(
            "no text of a store contains a NUL character or an unpaired surrogate; leave it out"
        )
    special, escaped = _SPECIAL[dialect]
    sought = text[:LONGEST_SOUGHT]
    sought = _folded(sought) if is_composed else sought.translate(_keys())
    written = "".join(
        f"[{_spellings()[one]}]"
        if one in _spellings()
        else escaped.format(one)
        if one in special
        else one
        for one in sought
    )
    if dialect == "sqlite":
        return f"{'' if begins else '*'}{written}{'' if ends else '*'}"
    return f"{'^' if begins else ''}{written}{'$' if ends else ''}"


def is_in(text: str | None, said: str) -> bool:
    """Return whether a text contains another, like `contains`; all texts contain None."""
    return text is None or _folded(text) in _folded(said)


def _folded(text: str) -> str:
    return normalize("NFC", text).translate(_keys())


def _key(letter: str) -> str:
    """Return the key of all spellings of a letter; spellings have the same number of letters."""
    return next(one for one in (letter.casefold(), letter.lower(), letter) if len(one) == 1)


@cache
def _keys() -> dict[int, str]:
    letters = map(chr, range(_CASED))
    # Few letters differ in lower case, and only these take long.
    cased = [each for each in letters if not each == each.casefold() == each.lower()]
    return {ord(letter): key for letter in cased if (key := _key(letter)) != letter}


@cache
def _spellings() -> dict[str, str]:
    found: dict[str, str] = {}
    for letter, key in _keys().items():
        found[key] = found.get(key, key) + chr(letter)
    return found
