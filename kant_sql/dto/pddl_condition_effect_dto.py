"""A literal in an action's condition or effect."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import ClassVar

from ..arguments import expect, flag
from .atom_dto import AtomDto, atom_text
from .name import fold
from .pddl_object_dto import PddlObjectDto
from .pddl_predicate_dto import PddlPredicateDto


@dataclass(init=False, eq=False)
class PddlConditionEffectDto(AtomDto):
    """A literal over an action's parameters, with a time in a durative action.

    Equal by predicate, objects, time and negation. Its text is `(at start (not (robot_at ?r ?s)))`,
    without the time wrapper when it has none.

    Attributes:
        predicate: the predicate.
        objects: the terms in order: parameters of the action, or constants.
        time: `AT_START`, `AT_END` or `OVER_ALL`; `None` in an action that is not durative.
        is_negative: whether the literal is negated.
    """

    AT_START: ClassVar[str] = "at start"
    AT_END: ClassVar[str] = "at end"
    OVER_ALL: ClassVar[str] = "over all"

    time: str | None
    is_negative: bool

    _predicate_role: ClassVar[str] = "the predicate of a PddlConditionEffectDto"
    _objects_role: ClassVar[str] = "the objects of a PddlConditionEffectDto"

    def __init__(
        self,
        predicate: PddlPredicateDto,
        objects: Iterable[PddlObjectDto] | None = None,
        time: str | None = None,
        is_negative: bool = False,
    ) -> None:
        super().__init__(predicate, objects)
        self.set_time(time)
        self.set_is_negative(is_negative)

    def get_time(self) -> str | None:
        """Give the time.

        Returns:
            `AT_START`, `AT_END`, `OVER_ALL` or `None`.
        """
        return self.time

    def set_time(self, time: str | None) -> None:
        """Set the time.

        Args:
            time: `AT_START`, `AT_END`, `OVER_ALL` or `None`.
        """
        if time is not None:
            expect(time, str, "the time of a PddlConditionEffectDto")
        self.time = time

    def get_is_negative(self) -> bool:
        """Tell whether the literal is negated.

        Returns:
            True when it is.
        """
        return self.is_negative

    def set_is_negative(self, is_negative: bool) -> None:
        """Say whether the literal is negated.

        Args:
            is_negative: True when it is.
        """
        self.is_negative = flag(is_negative, "is_negative of a PddlConditionEffectDto")

    def _identity(self) -> tuple[object, ...]:
        terms = tuple(fold(object_.name) for object_ in self.objects)
        return ("literal", fold(self.predicate.name), terms, self.time, bool(self.is_negative))

    def text(self, parameters: Collection[str] | None = None) -> str:
        """Write the literal.

        Args:
            parameters: the folded names of the action's parameters; any other term is a constant
                and gets no question mark. `None` when the action is not known: all are variables.

        Returns:
            The PDDL text.
        """
        names = [object_.name for object_ in self.objects]
        terms = [
            f"?{name}" if parameters is None or fold(name) in parameters else name for name in names
        ]
        return literal_text(self.predicate.name, terms, self.time, self.is_negative)

    def __str__(self) -> str:
        return self.text()


def literal_text(predicate: str, terms: Iterable[str], time: str | None, is_negative: bool) -> str:
    """Write a literal.

    Args:
        predicate: the predicate's name.
        terms: each term as it is to be written, a variable with its question mark.
        time: the time, or `None`.
        is_negative: whether the literal is negated.

    Returns:
        The PDDL text, for example `(at start (not (robot_at ?r ?s)))`.
    """
    text = atom_text(predicate, terms)
    if is_negative:
        text = f"(not {text})"
    return f"({time} {text})" if time else text
