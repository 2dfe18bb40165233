"""A PDDL predicate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from .dto import NamedDto
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlPredicateDto(NamedDto):
    """A predicate and the types of its parameters.

    Equal by name. Its text is `(robot_at ?r0 - robot ?w1 - wp)`: each variable is the first letter
    of the type and the position.

    Attributes:
        name: the predicate's name.
        types: the type of each parameter, in order; empty for a predicate without parameters.
    """

    name: str
    types: list[PddlTypeDto]

    _kind: ClassVar[str] = "predicate"

    def __init__(self, name: str, types: Iterable[PddlTypeDto] | None = None) -> None:
        self.name = name
        self.types = list(types or ())

    def get_types(self) -> list[PddlTypeDto]:
        """Give the types of the parameters.

        Returns:
            The types, in order.
        """
        return self.types

    def set_types(self, types: Iterable[PddlTypeDto] | None) -> None:
        """Set the types of the parameters.

        Args:
            types: the types in order; copied. `None` means none.
        """
        self.types = list(types or ())

    def __str__(self) -> str:
        return predicate_text(self.name, [type_.name for type_ in self.types])


def predicate_text(name: str, type_names: Iterable[str]) -> str:
    """Write a predicate's declaration.

    Args:
        name: the predicate's name.
        type_names: the name of each parameter's type, in order.

    Returns:
        The PDDL text, for example `(robot_at ?r0 - robot ?w1 - wp)`.
    """
    parameters = [
        f"?{type_name[:1]}{position} - {type_name}" for position, type_name in enumerate(type_names)
    ]
    return f"({' '.join([name, *parameters])})"
