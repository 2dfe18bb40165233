"""A predicate applied to terms: what propositions and literals have in common."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from ..arguments import expect, items
from .dto import Dto
from .pddl_object_dto import PddlObjectDto
from .pddl_predicate_dto import PddlPredicateDto


@dataclass(init=False, eq=False)
class AtomDto(Dto):
    """A predicate and the terms that it is applied to.

    Attributes:
        predicate: the predicate.
        objects: the terms, in order.
    """

    predicate: PddlPredicateDto
    objects: list[PddlObjectDto]

    _predicate_role: ClassVar[str]
    _objects_role: ClassVar[str]

    def __init__(
        self, predicate: PddlPredicateDto, objects: Iterable[PddlObjectDto] | None = None
    ) -> None:
        self.predicate = expect(predicate, PddlPredicateDto, self._predicate_role)
        self.objects = items(objects, PddlObjectDto, self._objects_role)

    def get_predicate(self) -> PddlPredicateDto:
        """Give the predicate.

        Returns:
            The predicate.
        """
        return self.predicate

    def set_predicate(self, predicate: PddlPredicateDto) -> None:
        """Set the predicate.

        Args:
            predicate: the new predicate.
        """
        self.predicate = expect(predicate, PddlPredicateDto, self._predicate_role)

    def get_objects(self) -> list[PddlObjectDto]:
        """Give the terms.

        Returns:
            The objects, in order.
        """
        return self.objects

    def set_objects(self, objects: Iterable[PddlObjectDto] | None) -> None:
        """Set the terms.

        Args:
            objects: the objects in order; copied. `None` means none.
        """
        self.objects = items(objects, PddlObjectDto, self._objects_role)


def atom_text(predicate: str, terms: Iterable[str]) -> str:
    """Write a predicate applied to terms.

    Args:
        predicate: the predicate's name.
        terms: each term as it is to be written, a variable with its question mark.

    Returns:
        The PDDL text, for example `(robot_at rb1 wp1)`.
    """
    return f"({' '.join([predicate, *terms])})"
