"""PDDL names: which strings are one, and when two are the same.

PDDL is case-insensitive (Fox and Long, PDDL 2.1, 2003, section 2 and appendix A), and its names are
a letter followed by letters, digits, `-` and `_`. Real files start names with digits and use other
signs, and people name things in their own language, so a name here is any run of characters that
PDDL text can carry without ambiguity, wherever a name of its kind stands. This is the only rule:
DAOs, the reader and the writer ask here. `docs/names.md` gives the rules and their reasons.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sized
from functools import lru_cache

from ..arguments import shown
from ..errors import InvalidNameError

MAX_NAME_LENGTH = 255
ROOT_TYPE = "object"

# What the reader takes for a number.
NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,4})?")
_STANDARD = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,254}")
_FORBIDDEN = frozenset("();?\"'`")
_FORBIDDEN_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zs", "Zl", "Zp"})
# Default_Ignorable_Code_Point (Unicode Character Database, DerivedCoreProperties.txt) beside the
# categories Cf and Cn, and three that have no ink either: the Khitan filler, the blank Braille
# pattern and the null notehead.
_INVISIBLE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180d\u180f\u2800\u3164\ufe00-\ufe0f\uffa0"
    "\U00016fe4\U0001d159\U000e0100-\U000e01ef]"
)
_COMPARISONS = frozenset({"<", "<=", "=", ">=", ">"})
_OPERATORS = _COMPARISONS | {"and", "or", "not", "imply", "forall", "exists", "when"}
# Folded words that begin something else where a name of the kind stands.
RESERVED: dict[str, frozenset[str]] = {
    "predicate": _OPERATORS,
    "function": _OPERATORS | {"+", "-", "*", "/", "is-violated"},
    # In a metric, `(total-time)` may be of a function of that name, but of no other.
    "function of objects": _OPERATORS | {"+", "-", "*", "/", "is-violated", "total-time"},
    "type": frozenset({"either"}),
    "variable of a durative action": frozenset({"duration"}),
}
# What stands in typed lists and among terms, without a sign of its own.
_BARE = frozenset({"type", "object", "constant"})


def fold(name: str) -> str:
    """Give the form of a name under which lookup and uniqueness compare it.

    Args:
        name: a PDDL name, in any spelling.

    Returns:
        The name in Unicode normal form C, case folded: equal for names that PDDL holds equal.
    """
    if not isinstance(name, str):
        raise InvalidNameError(f"a name is a string, not {type(name).__name__}: {shown(name)}")
    if name.isascii():
        return name.lower()
    # The Unicode Standard, section 3.13, D145: case folding is of decomposed text.
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _called(character: str) -> str:
    return unicodedata.name(character, f"U+{ord(character):04X}")


@lru_cache(maxsize=4096)
def _word_fault(name: str) -> str | None:
    """Find why a string cannot be one word of PDDL text."""
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
            return f"it has {character!r} ({_called(character)}) at position {position}"
    return None


@lru_cache(maxsize=4096)
def _fault(kind: str, name: str) -> str | None:
    """Find why a string cannot name something of a kind."""
    fault = _word_fault(name)
    if fault is not None:
        return fault
    invisible = _INVISIBLE.search(name)
    if invisible is not None:
        return (
            f"it has {invisible[0]!r} ({_called(invisible[0])}), which cannot be seen, at position "
            f"{invisible.start()}"
        )
    if unicodedata.category(name[0])[0] == "M":
        return f"it begins with {_called(name[0])}, which joins the character before it"
    if kind in _BARE:
        if name[0] == "-":
            return "it begins with '-', which PDDL text reads as the sign before a type"
        if NUMBER.fullmatch(name) or fold(name) == "#t":
            return "PDDL text reads it as a number"
    if fold(name) in RESERVED.get(kind, ()):
        return "the word is reserved in PDDL"
    return None


def is_word(name: str) -> bool:
    """Tell whether a string is one word of PDDL text: what is none was never a name in a store.

    Stores keep names that older versions accepted, so whoever looks one up asks this.

    Args:
        name: the string.

    Returns:
        Whether it is one.
    """
    return _word_fault(name) is None


def is_name(name: str, kind: str) -> bool:
    """Tell whether PDDL text can carry a name, wherever a name of its kind stands.

    Args:
        name: the name; a variable's without its question mark.
        kind: what it names, as for `check_name`.

    Returns:
        Whether `check_name` lets it pass.
    """
    # Most names are standard, and there may be a million of them.
    if _STANDARD.fullmatch(name) is not None and kind not in RESERVED:
        return True
    return _fault(kind, name) is None


def is_requirement(requirement: str) -> bool:
    """Tell whether a string is a requirement.

    Args:
        requirement: the string.

    Returns:
        Whether it is a colon and a name.
    """
    return requirement[:1] == ":" and is_name(requirement[1:], "requirement")


def function_kind(parameters: Sized, types: Sized) -> str:
    """Tell which kind of name a function has.

    Args:
        parameters: its parameters.
        types: the types of its values; none for numbers.

    Returns:
        The kind, as for `check_name`.
    """
    return "function of objects" if parameters or types else "function"


def check_name(kind: str, name: str) -> None:
    """Refuse a name that PDDL text could not carry.

    Args:
        kind: what it names: `type`, `object`, `constant`, `predicate`, `function`,
            `function of objects`, `action`, `parameter`, `variable`, `preference`,
            `variable of a durative action`, `requirement`, `domain` or `problem`.
        name: the name; a variable's without its question mark.

    Raises:
        InvalidNameError: the name is no string, is empty, longer than 255 characters, holds white
            space, a parenthesis, `;`, `?`, a quote, a control, format or invisible character,
            begins with a combining character, reads as a keyword, or is reserved; or it is an
            object's or a type's, and begins with `-` or reads as a number.
    """
    if not isinstance(name, str):
        raise InvalidNameError(
            f"a name of {kind} is a string, not {type(name).__name__}: {shown(name)}"
        )
    if is_name(name, kind):
        return
    short = name if len(name) <= 60 else name[:57] + "..."
    article = "an" if kind[0] in "aeiou" else "a"
    raise InvalidNameError(
        f"{short!r} cannot name {article} {kind}: {_fault(kind, name)}; choose another name"
    )
