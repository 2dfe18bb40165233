"""A PDDL function: a number, or an object, that changes over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..arguments import items
from .dto import NamedDto
from .formula import TypedName
from .parameters import checked_parameter_names, declaration_text
from .pddl_type_dto import PddlTypeDto


@dataclass(init=False, eq=False)
class PddlFunctionDto(NamedDto):
    """A function, its parameters and what its values are.

    Numbers are PDDL 2.1's numeric fluents (section 3), objects PDDL 3.1's object fluents.

    Equal by name. Its text is `(distance ?w0 - wp ?w1 - wp)`, and `(loc ?t0 - truck) - place` when
    its values are objects.

    Attributes:
        name: the function's name.
        types: the type of each parameter, in order; empty for a function without parameters.
        value_types: the types of its values: empty for numbers, several when a value is of one of
            them.
        parameter_names: the name of each parameter, in order, without question marks; they may
            repeat. `None` means "not said": what is stored keeps its names.
    """

    name: str
    types: list[PddlTypeDto]
    value_types: list[PddlTypeDto]
    parameter_names: list[str] | None

    _kind: ClassVar[str] = "function"

    def __init__(
        self,
        name: str,
        types: Iterable[PddlTypeDto] | None = None,
        *,
        value_types: Iterable[PddlTypeDto] | None = None,
        parameter_names: Iterable[str] | None = None,
    ) -> None:
        self.name = self._checked_name(name)
        self.set_types(types)
        self.set_value_types(value_types)
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
        self.types = items(types, PddlTypeDto, "the types of a PddlFunctionDto")

    def get_value_types(self) -> list[PddlTypeDto]:
        """Give the types of the values.

        Returns:
            The types; empty for numbers.
        """
        return self.value_types

    def set_value_types(self, value_types: Iterable[PddlTypeDto] | None) -> None:
        """Set the types of the values.

        Args:
            value_types: the types; copied. `None` means numbers.
        """
        self.value_types = items(value_types, PddlTypeDto, "the value types of a PddlFunctionDto")

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
        self.parameter_names = checked_parameter_names(parameter_names, "a PddlFunctionDto")

    def __str__(self) -> str:
        return function_text(
            self.name,
            [part.name for part in self.types],
            [part.name for part in self.value_types],
            self.parameter_names,
        )


def function_text(
    name: str,
    type_names: Iterable[str],
    value_type_names: Sequence[str],
    parameter_names: Sequence[str] | None = None,
) -> str:
    """Write a function's declaration.

    Args:
        name: the function's name.
        type_names: the type of each parameter as text, in order.
        value_type_names: the types of its values; none for numbers.
        parameter_names: the name of each parameter, in order; `None` for derived ones.

    Returns:
        The PDDL text, for example `(loc ?t0 - truck) - place`.
    """
    text = declaration_text(name, type_names, parameter_names)
    if not value_type_names:
        return text
    return f"{text} - {TypedName(text, tuple(value_type_names)).type_text}"
