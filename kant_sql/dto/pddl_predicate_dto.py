"""A PDDL predicate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from ..arguments import items
from .dto import NamedDto
from .parameters import checked_parameter_names, declaration_text
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlPredicateDto(NamedDto):
    """A predicate and its parameters.

    Equal by name. Its text is `(robot_at ?r0 - robot ?w1 - wp)`: a parameter that was given no name
    has the first letter of its type and the position.

    Attributes:
        name: the predicate's name.
        types: the type of each parameter, in order; empty for a predicate without parameters.
        parameter_names: the name of each parameter, in order, without question marks; they may
            repeat. `None` means "not said": what is stored keeps its names.
    """

    name: str
    types: list[PddlTypeDto]
    parameter_names: list[str] | None

    _kind: ClassVar[str] = "predicate"

    def __init__(
        self,
        name: str,
        types: Iterable[PddlTypeDto] | None = None,
        *,
        parameter_names: Iterable[str] | None = None,
    ) -> None:
        self.name = self._checked_name(name)
        self.set_types(types)
        self.set_parameter_names(parameter_names)

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
        self.types = items(types, PddlTypeDto, "the types of a PddlPredicateDto")

    def get_parameter_names(self) -> list[str] | None:
        """Give the names of the parameters.

        Returns:
            The names in order, without question marks; `None` when not said.
        """
        return self.parameter_names

    def set_parameter_names(self, parameter_names: Iterable[str] | None) -> None:
        """Set the names of the parameters.

        Args:
            parameter_names: the names in order, without question marks; copied. `None` means "not
                said".
        """
        self.parameter_names = checked_parameter_names(parameter_names, "a PddlPredicateDto")

    def __str__(self) -> str:
        return declaration_text(self.name, [part.name for part in self.types], self.parameter_names)
