"""PDDL names: which strings are one, and when two are the same.

PDDL is case-insensitive (Fox and Long, PDDL 2.1, 2003, section 2 and appendix A), and its names are
a letter followed by letters, digits, `-` and `_`. Real files start names with digits and use other
signs, and people name things in their own language, so a name here is any run of characters that
PDDL text can carry without ambiguity. `docs/names.md` gives the rules and their reasons.
"""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from ..errors import InvalidNameError

MAX_NAME_LENGTH = 255
ROOT_TYPE = "object"

_FORBIDDEN = frozenset("();?\"'`")
_FORBIDDEN_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zs", "Zl", "Zp"})
# Words that begin a formula or a type expression: as a name, the text could not be read back.
RESERVED_PREDICATES = frozenset({"and", "or", "not", "imply", "forall", "exists", "when", "="})
RESERVED_TYPES = frozenset({"either"})


def fold(name: str) -> str:
    """Give the form of a name under which lookup and uniqueness compare it.

    Args:
        name: a PDDL name, in any spelling.

    Returns:
        The name in Unicode normal form C, case folded: equal for names that PDDL holds equal.
    """
    if not isinstance(name, str):
        raise InvalidNameError(f"a name is a string, not {type(name).__name__}: {name!r}")
    if name.isascii():
        return name.lower()
    # The Unicode Standard, section 3.13, D145: case folding is of decomposed text.
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


@lru_cache(maxsize=4096)
def _fault(name: str) -> str | None:
    if not name:
        return "it is empty"
    if len(name) > MAX_NAME_LENGTH:
        return f"it has {len(name)} characters, {MAX_NAME_LENGTH} at most"
    if name == "-" or name[0] == ":":
        return "PDDL text reads it as a separator or a keyword"
    for position, character in enumerate(name):
        if (
            character in _FORBIDDEN
            or character.isspace()
            or unicodedata.category(character) in _FORBIDDEN_CATEGORIES
        ):
            label = unicodedata.name(character, f"U+{ord(character):04X}")
            return f"it has {character!r} ({label}) at position {position}"
    return None


def is_name(name: str) -> bool:
    """Tell whether PDDL text could carry a name.

    Args:
        name: the name.

    Returns:
        Whether `check_name` lets it pass, reserved words apart.
    """
    return _fault(name) is None


def check_name(element: str, name: str, reserved: frozenset[str] = frozenset()) -> None:
    """Refuse a name that PDDL text could not carry.

    Args:
        element: what the name is of, for the message ("type", "object" ...).
        name: the name.
        reserved: folded words that may not name such an element.

    Raises:
        InvalidNameError: the name is no string, is empty, longer than 255 characters, holds white
            space, a parenthesis, `;`, `?`, a quote, a control or format character, reads as a
            keyword, or is reserved.
    """
    if not isinstance(name, str):
        raise InvalidNameError(
            f"a name of {element} is a string, not {type(name).__name__}: {name!r}"
        )
    fault = _fault(name)
    if fault is None and reserved and fold(name) in reserved:
        fault = "the word is reserved in PDDL"
    if fault is not None:
        shown = name if len(name) <= 60 else name[:57] + "..."
        article = "an" if element[0] in "aeiou" else "a"
        raise InvalidNameError(
            f"{shown!r} cannot name {article} {element}: {fault}; choose another name"
        )
