"""What a PDDL function gives for some objects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal

from ..arguments import expect, items
from .atom_dto import atom_text
from .dto import Dto
from .name import fold
from .number import check_number, number_text
from .pddl_function_dto import PddlFunctionDto
from .pddl_object_dto import PddlObjectDto

FunctionValue = int | float | Decimal | PddlObjectDto


@dataclass(init=False, eq=False)
class PddlFunctionValueDto(Dto):
    """A function applied to objects, and the number or the object that it is there.

    Equal by function and objects: another value of them is the same element. Its text is
    `(= (distance wp1 wp2) 10)`.

    Attributes:
        function: the function.
        objects: the arguments, in order.
        value: a number, or an object for a function whose values are objects.
    """

    function: PddlFunctionDto
    objects: list[PddlObjectDto]
    value: FunctionValue

    def __init__(
        self,
        function: PddlFunctionDto,
        objects: Iterable[PddlObjectDto] | None = None,
        value: FunctionValue = 0,
    ) -> None:
        self.set_function(function)
        self.set_objects(objects)
        self.set_value(value)

    def get_function(self) -> PddlFunctionDto:
        """Give the function.

        Returns:
            The function.
        """
        return self.function

    def set_function(self, function: PddlFunctionDto) -> None:
        """Set the function.

        Args:
            function: the new function.
        """
        self.function = expect(function, PddlFunctionDto, "the function of a PddlFunctionValueDto")

    def get_objects(self) -> list[PddlObjectDto]:
        """Give the arguments.

        Returns:
            The objects, in order.
        """
        return self.objects

    def set_objects(self, objects: Iterable[PddlObjectDto] | None) -> None:
        """Set the arguments.

        Args:
            objects: the objects in order; copied. `None` means none.
        """
        self.objects = items(objects, PddlObjectDto, "the objects of a PddlFunctionValueDto")

    def get_value(self) -> FunctionValue:
        """Give the value.

        Returns:
            A number, or an object.
        """
        return self.value

    def set_value(self, value: FunctionValue) -> None:
        """Set the value.

        Args:
            value: a number, or an object for a function whose values are objects.
        """
        if not isinstance(value, PddlObjectDto):
            check_number(value, "the value of a PddlFunctionValueDto")
        self.value = value

    def _identity(self) -> tuple[object, ...]:
        arguments = tuple(fold(object_.name) for object_ in self.objects)
        return ("function value", fold(self.function.name), arguments)

    def __str__(self) -> str:
        fluent = atom_text(self.function.name, [object_.name for object_ in self.objects])
        value = self.value
        return value_text(
            fluent, value.name if isinstance(value, PddlObjectDto) else number_text(value)
        )


def value_text(fluent: str, value: str) -> str:
    """Write the value of a fluent.

    Args:
        fluent: the function applied to its arguments, as text.
        value: a number, or an object's name.

    Returns:
        The PDDL text, for example `(= (distance wp1 wp2) 10)`.
    """
    return f"(= {fluent} {value})"


def trusted_value(
    function: PddlFunctionDto, objects: list[PddlObjectDto], value: FunctionValue
) -> PddlFunctionValueDto:
    """Make a value of what is known to be right: a store gives hundreds of thousands.

    Args:
        function: the function.
        objects: the arguments, in order; not copied.
        value: a number, or an object.

    Returns:
        The value, unchecked.
    """
    dto = object.__new__(PddlFunctionValueDto)
    dto.function = function
    dto.objects = objects
    dto.value = value
    return dto
