"""The base of all data transfer objects."""

from __future__ import annotations

from typing import ClassVar

from ..arguments import expect
from ..errors import InvalidNameError
from .name import fold


class Dto:
    """A piece of PDDL knowledge as plain data; `str()` of it is its PDDL text.

    Two DTOs are equal when they denote the same element, whatever else they say of it.
    """

    def _identity(self) -> tuple[object, ...]:
        """Give what makes this element the one that it is, in a hashable form."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Dto):
            return NotImplemented
        return self._identity() == other._identity()

    def __hash__(self) -> int:
        return hash(self._identity())


class NamedDto(Dto):
    """An element that is identified by its kind and its name, in any spelling of it."""

    name: str
    _kind: ClassVar[str]

    def get_name(self) -> str:
        """Give the name.

        Returns:
            The name, in the spelling that was given.
        """
        return self.name

    def set_name(self, name: str) -> None:
        """Set the name.

        Args:
            name: the new name.
        """
        self.name = self._checked_name(name)

    @classmethod
    def _checked_name(cls, name: str) -> str:
        # What PDDL makes a name is checked when it is saved.
        if type(name) is not str:
            expect(name, str, f"the name of a {cls.__name__}", InvalidNameError)
        return name

    def _identity(self) -> tuple[object, ...]:
        return (self._kind, fold(self.name))
