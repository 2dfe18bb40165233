"""Which texts contain another: the one rule of every filter by text, in SQL and in Python.

Case does not matter, whatever the letter: KÜCHE finds Küche. SQLite knows the case of ASCII letters
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

# SQLite refuses a pattern of more than 50,000 bytes; no letter takes more than 14.
LONGEST_SOUGHT = 3_500
# By dialect: the characters that a pattern cannot have as they are, and how they are escaped.
_SPECIAL = {"sqlite": ("*?[", "[{}]"), "postgresql": (".^$*+?()[]{}|\\", "\\{}")}
# No letter beyond this has a case.
_CASED = 0x20000


class _Contains(Condition):
    """A text fits the pattern of a parameter."""

    inherit_cache = True
    name = "contains"


for _dialect, _operator in OPERATORS.items():
    write_as(_Contains, f"({{0}}) {_operator} {{1}}", _dialect)


def contains(column: Any, parameter: str = "pattern") -> ColumnElement[bool]:
    """Return whether a text fits a parameter, which `pattern_of` gives."""
    return _Contains(column, bindparam(parameter))


def pattern_of(
    session: Session,
    text: str,
    *,
    begins: bool = False,
    ends: bool = False,
    is_composed: bool = True,
) -> str:
    """Return the pattern of what contains a text, or begins or ends with it.

    Names are stored with composed letters, so the text is composed, unless you say that it is not.

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
    """Return whether a text contains another as `contains` does; all contain None."""
    return text is None or _folded(text) in _folded(said)


def _folded(text: str) -> str:
    return normalize("NFC", text).translate(_keys())


def _key(letter: str) -> str:
    """Return what the spellings of a letter share; what has another number of letters is none."""
    return next(one for one in (letter.casefold(), letter.lower(), letter) if len(one) == 1)


@cache
def _keys() -> dict[int, str]:
    letters = map(chr, range(_CASED))
    # Few letters are others in lower case, and only these take long.
    cased = [each for each in letters if not each == each.casefold() == each.lower()]
    return {ord(letter): key for letter in cased if (key := _key(letter)) != letter}


@cache
def _spellings() -> dict[str, str]:
    found: dict[str, str] = {}
    for letter, key in _keys().items():
        found[key] = found.get(key, key) + chr(letter)
    return found
