"""Names that PDDL can carry, for the elements of a problem of unified-planning."""

from __future__ import annotations

import re

from ..dto.formula import ASSIGNMENTS, MODALS
from ..dto.name import RESERVED, ROOT_TYPE, fold
from ..errors import InvalidNameError

_RESERVED = (
    RESERVED["function"]
    | RESERVED["type"]
    | set(ASSIGNMENTS)
    | set(MODALS)
    | {ROOT_TYPE, "number", "preference", "is-violated", "undefined", "total-time"}
)
_RESERVED_VARIABLES = frozenset({"duration"})
VARIABLE = "variable"
_CARRIED = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def pddl_name(category: str, name: str) -> str:
    """Make a name that the grammar of PDDL allows.

    Args:
        category: what the name is of; its first letter is put before a name that starts with none.
        name: any name.

    Returns:
        The name; signs that PDDL does not know become `_`, and a reserved word gets one appended.
    """
    carried = re.sub(r"[^A-Za-z0-9_-]", "_", name)
    if not _CARRIED.fullmatch(carried):
        carried = f"{category[0]}_{carried}"
    reserved = _RESERVED_VARIABLES if category == VARIABLE else _RESERVED
    return f"{carried}_" if fold(carried) in reserved else carried


class PddlNames:
    """What each element is called in PDDL, where letters' case makes no difference."""

    def __init__(self) -> None:
        """Begin with no name taken."""
        self._names: dict[tuple[str, str], str] = {}
        self._owners: dict[str, tuple[str, str]] = {}

    def claim(self, category: str, name: str) -> str:
        """Choose a name for an element.

        Where the name belongs to another category already, the category is appended.

        Args:
            category: what it is.
            name: its name in unified-planning.

        Returns:
            Its name in PDDL.

        Raises:
            InvalidNameError: another element of its category has that name.
        """
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
        """Give an element's name in PDDL.

        Args:
            category: what it is.
            name: its name in unified-planning.

        Returns:
            Its name in PDDL.
        """
        return self._names[category, name]
