"""Names, numbers and typed lists as PDDL text.

PDDL is case-insensitive (Fox and Long, PDDL 2.1, 2003, section 2 and appendix A), and its names are
a letter followed by letters, digits, `-` and `_`. Real files start names with digits and use other
characters, and users name things in their own language. So a name here is any sequence of
characters that PDDL text can express unambiguously in every place of a name of its kind. DAOs,
reader and writer share this rule; `docs/names.md` explains it.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence, Sized
from decimal import MAX_EMAX, MAX_PREC, MIN_EMIN, Context, Decimal
from functools import lru_cache
from math import isfinite
from typing import Any

from ..arguments import items, refusal
from ..errors import InvalidKnowledgeError, InvalidNameError

MAX_NAME_LENGTH = 255
ROOT_TYPE = "object"

# Numbers that the reader accepts.
NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,4})?")
_STANDARD = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,254}")
_FORBIDDEN = frozenset("();?\"'`")
_FORBIDDEN_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zs", "Zl", "Zp"})
# Default_Ignorable_Code_Point (Unicode Character Database, DerivedCoreProperties.txt) outside the
# categories Cf and Cn, and three other blank ones: the Khitan filler, the blank Braille pattern and
# the null notehead.
_INVISIBLE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180d\u180f\u2800\u3164\ufe00-\ufe0f\uffa0"
    "\U00016fe4\U0001d159\U000e0100-\U000e01ef]"
)
_COMPARISONS = frozenset({"<", "<=", "=", ">=", ">"})
_OPERATORS = _COMPARISONS | {"and", "or", "not", "imply", "forall", "exists", "when"}
# Folded words with another meaning in the place of a name of the kind.
RESERVED: dict[str, frozenset[str]] = {
    "predicate": _OPERATORS,
    "function": _OPERATORS | {"+", "-", "*", "/", "is-violated"},
    # In a metric, `(total-time)` may be a declared function, but only without parameters.
    "function of objects": _OPERATORS | {"+", "-", "*", "/", "is-violated", "total-time"},
    "type": frozenset({"either"}),
    "variable of a durative action": frozenset({"duration"}),
}
# Kinds of names in typed lists and among terms, without a prefix.
_BARE = frozenset({"type", "object", "constant"})


def fold(name: str) -> str:
    """Return the case-insensitive key of a name, for lookup and uniqueness."""
    if not isinstance(name, str):
        raise refusal("a name", "a string", name, InvalidNameError)
    if name.isascii():
        return name.lower()
    # The Unicode Standard, section 3.13, D145: fold the case of decomposed text.
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", name).casefold())


def _called(character: str) -> str:
    return unicodedata.name(character, f"U+{ord(character):04X}")


@lru_cache(maxsize=4096)
def _word_fault(name: str) -> str | None:
    """Return why a string cannot be one word of PDDL text."""
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
def name_fault(kind: str, name: str) -> str | None:
    """Return why a string cannot be a name of a kind."""
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
    """Return whether a string is one word of PDDL text.

    Lookups use this check: stores may have names that `is_name` of an older version accepted.
    """
    return _word_fault(name) is None


def is_name(name: str, kind: str) -> bool:
    """Return whether PDDL text can express a name in every place of its kind."""
    # The fast path: there may be a million names, most of them standard.
    if _STANDARD.fullmatch(name) is not None and kind not in RESERVED:
        return True
    return name_fault(kind, name) is None


def is_requirement(requirement: str) -> bool:
    """Return whether a string is a requirement."""
    return requirement[:1] == ":" and is_name(requirement[1:], "requirement")


def function_kind(parameters: Sized, types: Sized) -> str:
    """Return the kind of name of a function."""
    return "function of objects" if parameters or types else "function"


def with_article(noun: str) -> str:
    """Return a noun with `a` or `an`."""
    return f"{'an' if noun[0] in 'AEIOUaeiou' else 'a'} {noun}"


def check_name(kind: str, name: str) -> None:
    """Refuse a name that PDDL text cannot express."""
    if not isinstance(name, str):
        raise refusal(f"a name of {kind}", "a string", name, InvalidNameError)
    if is_name(name, kind):
        return
    short = name if len(name) <= 60 else name[:57] + "..."
    raise InvalidNameError(
        f"{short!r} cannot name {with_article(kind)}: {name_fault(kind, name)}; choose another name"
    )


# Enough digits for the exact value of any double; bounds the length of texts.
MAX_DIGITS = 400
# Sums, differences and products terminate, so they never need this many digits.
EXACT_DECIMALS = Context(prec=MAX_PREC, Emax=MAX_EMAX, Emin=MIN_EMIN)


def is_same_number(one: str, other: str) -> bool:
    """Return whether two texts are the same number, such as 10 and 10.0."""
    try:
        return Decimal(one) == Decimal(other)
    except ArithmeticError:
        return False


_NUMBERS = (int, float, Decimal)


def check_number(value: Any, role: str) -> Decimal:
    """Check and convert a number."""
    kind = type(value)
    # The fast path: a load checks hundreds of thousands of numbers.
    if kind is float and isfinite(value):
        # A double has at most 340 digits.
        return Decimal(repr(value))
    if kind is bool or not isinstance(value, _NUMBERS):
        raise refusal(role, "a number", value)
    number = Decimal(float.__repr__(value)) if isinstance(value, float) else Decimal(value)
    if not is_writable(number):
        raise refusal(role, f"a finite number of at most {MAX_DIGITS} digits", value)
    return number


def is_writable(number: Decimal) -> bool:
    """Return whether PDDL text has a number, which may have as many digits behind the point."""
    _, digits, exponent = number.as_tuple()
    return isinstance(exponent, int) and max(len(digits) + exponent, -exponent) <= MAX_DIGITS


def decimal_text(number: Decimal) -> str:
    """Write an exact number."""
    if not is_writable(number):
        raise InvalidKnowledgeError(
            f"PDDL text cannot express the number {str(number)[:60]}; give a finite number of at "
            f"most {MAX_DIGITS} digits"
        )
    # Zero has no sign.
    return format(number if number else number.copy_abs(), "f")


def number_text(number: int | float | Decimal) -> str:
    """Write a number."""
    if isinstance(number, float):
        # The point distinguishes a float from an int; the sum turns -0.0 into 0.0.
        text = decimal_text(Decimal(repr(float(number) + 0.0)))
        return text if "." in text else f"{text}.0"
    return decimal_text(Decimal(number))


_EITHER = "(either "


def either_text(type_names: Iterable[str]) -> str:
    """Write a type, or an `either` of several."""
    names = list(type_names)
    return names[0] if len(names) == 1 else f"{_EITHER}{' '.join(names)})"


def variable_name(type_name: str, position: int) -> str:
    """Return the default name of a parameter."""
    return f"{type_name.removeprefix(_EITHER)[:1]}{position}"


def checked_parameter_names(names: Iterable[str] | None, owner: str) -> list[str] | None:
    """Check the names that a DTO gives to parameters."""
    return None if names is None else items(names, str, f"the parameter names of {owner}")


def declaration_text(
    name: str, type_names: Iterable[str], parameter_names: Sequence[str] | None = None
) -> str:
    """Write the declaration of a predicate, or of a function without its type."""
    given = parameter_names or ()
    parts = [name]
    for position, type_name in enumerate(type_names):
        own = given[position] if position < len(given) else variable_name(type_name, position)
        parts.append(f"?{own} - {type_name}")
    return f"({' '.join(parts)})"
