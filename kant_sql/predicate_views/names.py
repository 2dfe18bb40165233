"""Names of generated views and their columns: safe on every dialect, whatever PDDL calls things.

A name is made of letters, digits and underscores and is no reserved word, so that no statement has
to quote it. It has 63 bytes at most, which is what PostgreSQL keeps of a name. Names that differ in
other signs only come to the same identifier: the oldest has it, and each other has a hash of its
own name behind it, so that no view's name ever changes its meaning.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Sequence
from hashlib import sha256
from itertools import count

from ..dto.name import fold

KINDS = ("fact", "goal")
MAX_BYTES = 63
MAX_PART_BYTES = 24
_HASH_DIGITS = 8
_LAST_DIGITS = 4

# What PostgreSQL 18 or SQLite 3.50 would not take for a column unquoted.
_RESERVED = (
    "add all alter analyse analyze and any array as asc asymmetric authorization autoincrement "
    "between binary both case cast check collate collation column commit concurrently "
    "constraint create cross current_catalog current_date current_role current_schema "
    "current_time current_timestamp current_user default deferrable delete desc distinct do "
    "drop else end escape except exists false fetch for foreign freeze from full grant group "
    "having ilike in index initially inner insert intersect into is isnull join lateral leading "
    "left like limit localtime localtimestamp natural not nothing notnull null offset on only "
    "or order outer overlaps placing primary raise references returning right select "
    "session_user set similar some symmetric system_user table tablesample then to trailing "
    "transaction true union unique update user using values variadic verbose when where window "
    "with "
)
RESERVED_WORDS = frozenset(_RESERVED.split())


def identifier(name: str) -> str:
    """Make an identifier of a name.

    Args:
        name: the name, in any spelling.

    Returns:
        The case-folded name with an underscore for each character that is no letter or digit, and
        none at its ends; it may be empty.
    """
    return "".join(
        character if unicodedata.category(character)[0] in "LNM" else "_"
        for character in fold(name)
    ).strip("_")


def view_names(prefix: str, names: Sequence[str], taken: Collection[str]) -> Iterator[str]:
    """Name the views of the predicates of one knowledge base.

    Args:
        prefix: what all of them begin with.
        names: the names of the predicates, the oldest first.
        taken: names in lower case that the database has for other things.

    Yields:
        The name of the view of each predicate, in order.
    """
    claimed: set[str] = set()
    for name in names:
        for part in _candidates(identifier(name), fold(name), MAX_BYTES - len(prefix.encode())):
            if part in claimed:
                continue
            # Taken by others or not, it is not for a younger one to have: what took it may go.
            claimed.add(part)
            if prefix + part not in taken:
                yield prefix + part
                break


def prefixes(kind: str, names: Sequence[str]) -> Iterator[str]:
    """Tell what the names of each knowledge base's views begin with.

    That is `fact_` for the first one, and `fact__tiago__` for another called tiago. What follows
    has no underscore at its beginning, and what stands between has no two of them: so no view of
    one knowledge base has the name that one of another could have.

    Args:
        kind: the kind of the views.
        names: the names of the store's knowledge bases, the oldest first.

    Yields:
        The prefix of each, in order.
    """
    claimed: set[str] = set()
    for position, name in enumerate(names):
        plain = re.sub("__+", "_", identifier(name))
        part = next(
            part for part in _candidates(plain, name, MAX_PART_BYTES) if part not in claimed
        )
        if position == 0:
            yield f"{kind}_"
        else:
            claimed.add(part)
            yield f"{kind}__{part}__"


def column_names(names: Sequence[str], fixed: Sequence[str]) -> list[str]:
    """Name the columns of arguments.

    Args:
        names: what the arguments are called, in order.
        fixed: the names of the columns that follow them.

    Returns:
        The names of their columns: a reserved word has an underscore behind it, a name that begins
        with a digit one before it, and one that is there already a number behind it.
    """
    found: list[str] = []
    for name in names:
        plain = identifier(name)
        plain = f"{plain}_" if plain in RESERVED_WORDS else plain
        plain = plain if plain[:1].isalpha() else f"_{plain}"
        candidates = (
            _cut(plain, MAX_BYTES - 1 - _LAST_DIGITS) + f"_{number}" for number in count(2)
        )
        first = plain if len(plain.encode()) <= MAX_BYTES else _hashed(plain, name, MAX_BYTES)
        taken = {*found, *fixed}
        found.append(first if first not in taken else next(c for c in candidates if c not in taken))
    return found


def _candidates(plain: str, key: str, size: int) -> Iterator[str]:
    if plain and len(plain.encode()) <= size:
        yield plain
    for number in count():
        yield _hashed(plain, f"{number} {key}", size)


def _hashed(plain: str, key: str, size: int) -> str:
    digest = sha256(key.encode()).hexdigest()[:_HASH_DIGITS]
    return f"{_cut(plain, size - 1 - _HASH_DIGITS)}_{digest}".lstrip("_")


def _cut(text: str, size: int) -> str:
    return text.encode()[:size].decode(errors="ignore").rstrip("_")
