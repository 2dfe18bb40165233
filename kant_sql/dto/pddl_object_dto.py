"""A PDDL object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .dto import NamedDto
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlObjectDto(NamedDto):
    """An object of the world, or a parameter of an action.

    Equal by name. Its text is `rb1 - robot`.

    Attributes:
        type: the object's type.
        name: the object's name; a parameter's is written without its question mark.
    """

    type: PddlTypeDto
    name: str

    _kind: ClassVar[str] = "object"

    def __init__(self, type: PddlTypeDto, name: str) -> None:
        self.type = type
        self.name = name

    def get_type(self) -> PddlTypeDto:
        """Give the type.

        Returns:
            The object's type.
        """
        return self.type

    def set_type(self, type: PddlTypeDto) -> None:
        """Set the type.

        Args:
            type: the new type.
        """
        self.type = type

    def __str__(self) -> str:
        return f"{self.name} - {self.type.name}"
