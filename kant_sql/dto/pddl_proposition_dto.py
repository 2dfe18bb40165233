"""A PDDL proposition: a fact or a goal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from ..arguments import flag
from .atom_dto import AtomDto, atom_text
from .name import fold
from .pddl_object_dto import PddlObjectDto
from .pddl_predicate_dto import PddlPredicateDto


@dataclass(init=False, eq=False)
class PddlPropositionDto(AtomDto):
    """A predicate applied to objects: a fact of the present state, or a goal.

    Equal by predicate, objects and `is_goal`: a proposition may be a fact and a goal at once, and
    then it is two elements. Its text is `(robot_at rb1 wp1)`.

    Attributes:
        predicate: the predicate.
        objects: the arguments, in order.
        is_goal: whether it is a goal rather than a fact.
    """

    is_goal: bool

    _predicate_role: ClassVar[str] = "the predicate of a PddlPropositionDto"
    _objects_role: ClassVar[str] = "the objects of a PddlPropositionDto"

    def __init__(
        self,
        predicate: PddlPredicateDto,
        objects: Iterable[PddlObjectDto] | None = None,
        is_goal: bool = False,
    ) -> None:
        super().__init__(predicate, objects)
        self.is_goal = flag(is_goal, "is_goal of a PddlPropositionDto")

    def get_is_goal(self) -> bool:
        """Tell whether it is a goal.

        Returns:
            True for a goal, False for a fact.
        """
        return self.is_goal

    def set_is_goal(self, is_goal: bool) -> None:
        """Say whether it is a goal.

        Args:
            is_goal: True for a goal, False for a fact.
        """
        self.is_goal = flag(is_goal, "is_goal of a PddlPropositionDto")

    def _identity(self) -> tuple[object, ...]:
        arguments = tuple(fold(object_.name) for object_ in self.objects)
        return ("proposition", fold(self.predicate.name), arguments, bool(self.is_goal))

    def __str__(self) -> str:
        return atom_text(self.predicate.name, [object_.name for object_ in self.objects])


def trusted_proposition(
    predicate: PddlPredicateDto, objects: list[PddlObjectDto], is_goal: bool
) -> PddlPropositionDto:
    """Make a proposition of what is known to be right: a store gives hundreds of thousands.

    Args:
        predicate: the predicate.
        objects: the arguments, in order; not copied.
        is_goal: whether it is a goal.

    Returns:
        The proposition, unchecked.
    """
    dto = object.__new__(PddlPropositionDto)
    dto.predicate = predicate
    dto.objects = objects
    dto.is_goal = is_goal
    return dto
