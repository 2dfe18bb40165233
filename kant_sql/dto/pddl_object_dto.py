"""A PDDL object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..arguments import expect, flag
from .dto import NamedDto
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlObjectDto(NamedDto):
    """An object of the world, or a parameter of an action.

    Equal by name. Its text is `rb1 - robot`.

    Attributes:
        type: the object's type.
        name: the object's name; a parameter's is written without its question mark.
        is_constant: whether the domain declares it, not the problem; when another element refers
            to it, it does not count.
    """

    type: PddlTypeDto
    name: str
    is_constant: bool

    _kind: ClassVar[str] = "object"

    def __init__(self, type: PddlTypeDto, name: str, *, is_constant: bool = False) -> None:
        self.set_type(type)
        self.name = self._checked_name(name)
        self.set_is_constant(is_constant)

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
        self.type = expect(type, PddlTypeDto, "the type of a PddlObjectDto")

    def get_is_constant(self) -> bool:
        """Tell whether the domain declares it, not the problem.

        Returns:
            True for a constant of the domain.
        """
        return self.is_constant

    def set_is_constant(self, is_constant: bool) -> None:
        """Say whether the domain declares it, not the problem.

        Args:
            is_constant: True for a constant of the domain.
        """
        self.is_constant = flag(is_constant, "is_constant of a PddlObjectDto")

    def __str__(self) -> str:
        return f"{self.name} - {self.type.name}"
