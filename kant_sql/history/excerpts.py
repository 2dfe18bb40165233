"""What pages have in common that show a part of a large store: patterns."""

from __future__ import annotations

from string import ascii_lowercase, ascii_uppercase
from typing import Any

from sqlalchemy import ColumnElement, bindparam, func

from ..errors import InvalidArgumentError

# A pattern longer than this is refused by SQLite, which takes 50,000 bytes.
LONGEST_SOUGHT = 5_000
# As `lower` of both databases does, which leaves all but ASCII as it is.
_LOWER = str.maketrans(ascii_uppercase, ascii_lowercase)


def contains(column: Any) -> ColumnElement[bool]:
    """Return whether a text contains the one of the parameter `pattern`, in any case."""
    return func.lower(column).like(bindparam("pattern"), escape="!")


def pattern_of(text: str) -> str:
    """Return the pattern of what contains a text.

    Raises:
        InvalidArgumentError: no text can contain it.
    """
    if "\0" in text:
        raise InvalidArgumentError("no text of a store contains a NUL; leave it out")
    folded = text[:LONGEST_SOUGHT].translate(_LOWER)
    for special in ("!", "%", "_"):
        folded = folded.replace(special, f"!{special}")
    return f"%{folded}%"


def is_in(text: str | None, said: str) -> bool:
    """Return whether a text contains another as `contains` does; all contain None."""
    return text is None or text.translate(_LOWER) in said.translate(_LOWER)


def word_pattern(name: str) -> str:
    """Return the pattern of what has a name among words between spaces."""
    return f"% {pattern_of(name)[1:-1]} %"
