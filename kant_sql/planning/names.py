"""Names, numbers and operators for both directions of the conversion.

In PDDL, an action and a predicate, or an object and a type, may have the same name. Objects and
actions keep theirs, because plans consist of them; other elements get their category appended.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Container
from decimal import Context, Decimal, Inexact
from fractions import Fraction
from unicodedata import normalize

from ..dto import formulas as f
from ..dto.lexical import RESERVED, ROOT_TYPE, fold
from ..errors import InvalidNameError, PlannerMissingError, UnsupportedConstructError
from ..pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS, Domain, Problem


def require_unified_planning() -> None:
    """Raise `PlannerMissingError` unless unified-planning can be imported."""
    if importlib.util.find_spec("unified_planning") is None:
        raise PlannerMissingError(
            "planning needs unified-planning, which is not installed; "
            'run pip install "kant-sql[planning]"'
        )


OBJECT, PREDICATE, FUNCTION, TYPE = "object", "predicate", "function", "type"
ACTION_CLASSES = {
    ACTION: "InstantaneousAction",
    DURATIVE_ACTION: "DurativeAction",
    PROCESS: "Process",
    EVENT: "Event",
}
# Operators as methods of the expression manager; `OperatorKind` spells them in capitals.
UP_ARITHMETIC = {"+": "Plus", "-": "Minus", "*": "Times", "/": "Div"}
UP_COMPARISONS = {"<": "LT", "<=": "LE", "=": "Equals", ">=": "GE", ">": "GT"}
# Modal operators of both; unified-planning spells them `AT_MOST_ONCE` and `AtMostOnce`.
SHARED_MODALS = ("always", "sometime", "at-most-once", "sometime-after", "sometime-before")


def unused_name(wanted: str, taken: Container[str]) -> str:
    """Return a name whose folded form is free, with a number appended if needed."""
    candidate, number = wanted, 2
    while fold(candidate) in taken:
        candidate, number = f"{wanted}_{number}", number + 1
    return candidate


def unsupported(
    system: str, construct: object, where: str, reason: str
) -> UnsupportedConstructError:
    """Make the error for a construct without counterpart in a system."""
    text = " ".join(str(construct).split())
    short = text if len(text) <= 120 else text[:117] + "..."
    return UnsupportedConstructError(f"{system} cannot express {short} in {where}: {reason}")


def too_deep(problem: Problem) -> UnsupportedConstructError:
    """Make the error for formulas that recursion cannot handle."""
    return UnsupportedConstructError(
        f"problem {problem.name} or its domain has formulas that are nested too deeply for a "
        "conversion to unified-planning; give their parts predicates of their own"
    )


class UpNames:
    """The name of each element in unified-planning: the same for the same documents."""

    def __init__(self, domain: Domain, problem: Problem) -> None:
        self._taken: set[str] = set()
        self._chosen: dict[tuple[str, str], str] = {}
        # The PDDL names of actions, by their names in unified-planning.
        self.action_of: dict[str, str] = {}
        clashing = [key for key in declared(domain, problem) if not self._claim(*key)]
        for category, name in clashing:
            self._chosen[category, fold(name)] = self.unused(f"{name}_{category}")

    def _claim(self, category: str, name: str) -> bool:
        if fold(name) in self._taken:
            return (category, fold(name)) in self._chosen
        self._taken.add(fold(name))
        self._chosen[category, fold(name)] = name
        return True

    def unused(self, name: str) -> str:
        """Reserve a name that no other element has."""
        candidate = unused_name(name, self._taken)
        self._taken.add(fold(candidate))
        return candidate

    def of(self, category: str, name: str) -> str:
        """Return an element's name in unified-planning."""
        return self._chosen.get((category, fold(name)), name)


def declared(domain: Domain, problem: Problem) -> list[tuple[str, str]]:
    """Return the category and the name of each element."""
    return [
        *((OBJECT, part.name) for part in (*domain.constants, *problem.objects)),
        *((action.kind, action.name) for action in domain.actions),
        *((PREDICATE, part.name) for part in domain.predicates),
        *((FUNCTION, part.name) for part in domain.functions),
        *((TYPE, part.name) for part in domain.types),
    ]


_EXACT = Context(prec=60, traps=[Inexact])


def number(value: int | Fraction) -> f.Number | f.Arithmetic:
    """Return the exact expression of a number."""
    if isinstance(value, int):
        return f.Number(Decimal(value))
    try:
        return f.Number(_EXACT.divide(Decimal(value.numerator), Decimal(value.denominator)))
    except Inexact:
        parts = (f.Number(Decimal(value.numerator)), f.Number(Decimal(value.denominator)))
        return f.Arithmetic("/", parts)


_RESERVED = (
    RESERVED["function"]
    | RESERVED["type"]
    | set(f.ASSIGNMENTS)
    | set(f.MODALS)
    | {ROOT_TYPE, "number", "preference", "is-violated", "undefined", f.TOTAL_TIME}
)
_RESERVED_VARIABLES = frozenset({f.DURATION})
VARIABLE = "variable"
_CARRIED = re.compile(r"[^\W\d_][\w-]*")


def pddl_name(category: str, name: str) -> str:
    """Return a name that the grammar of PDDL allows, except for letters of other languages."""
    carried = re.sub(r"[^\w-]", "_", normalize("NFC", name))
    if not _CARRIED.fullmatch(carried):
        carried = f"{category[0]}_{carried}"
    reserved = _RESERVED_VARIABLES if category == VARIABLE else _RESERVED
    return f"{carried}_" if fold(carried) in reserved else carried


class PddlNames:
    """The name of each element in PDDL, which ignores case."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], str] = {}
        self._owners: dict[str, tuple[str, str]] = {}

    def claim(self, category: str, name: str) -> str:
        """Choose a name for an element; append its category to a name of another category."""
        chosen = pddl_name(category, name)
        owner = self._owners.get(fold(chosen))
        if owner is not None and owner[0] != category:
            chosen = f"{chosen}_{category}"
            owner = self._owners.get(fold(chosen))
        if owner is not None:
            raise InvalidNameError(
                f"{category} {name} and {owner[0]} {owner[1]} would both be named {chosen} in "
                "PDDL; rename one of them"
            )
        self._owners[fold(chosen)] = (category, name)
        self._names[category, name] = chosen
        return chosen

    def of(self, category: str, name: str) -> str:
        """Return an element's name in PDDL."""
        return self._names[category, name]
