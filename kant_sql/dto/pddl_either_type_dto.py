"""Several types, of which an object has one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..arguments import items, refusal
from .parameters import either_text
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlEitherTypeDto(PddlTypeDto):
    """The type of a parameter, or an object, that is of one of several types (PDDL 1.2).

    It stands wherever a type does, but is none of its own: it cannot be saved. Its name and its
    text are `(either robot human)`.

    Attributes:
        types: the types, in order.
    """

    types: list[PddlTypeDto]

    def __init__(self, types: Iterable[PddlTypeDto]) -> None:
        self.types = self._checked_types(types)
        super().__init__(either_text(type_.name for type_ in self.types))

    def get_types(self) -> list[PddlTypeDto]:
        """Give the types.

        Returns:
            The types, in order.
        """
        return self.types

    def set_types(self, types: Iterable[PddlTypeDto]) -> None:
        """Set the types.

        Args:
            types: the types in order; copied.
        """
        self.types = self._checked_types(types)
        self.name = either_text(type_.name for type_ in self.types)

    @staticmethod
    def _checked_types(types: Iterable[PddlTypeDto]) -> list[PddlTypeDto]:
        if types is None:
            raise refusal("the types of a PddlEitherTypeDto", "a list", types)
        return items(types, PddlTypeDto, "the types of a PddlEitherTypeDto")
