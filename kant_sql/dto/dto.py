"""The base of all data transfer objects."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ClassVar

from ..arguments import expect
from ..errors import InvalidKnowledgeError, InvalidNameError, KantSqlError
from .name import fold


def _malformed(dto: Dto) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(
        f"a field of this {type(dto).__name__} was overwritten with what cannot be there; "
        "make it again with its constructor, which says what is wrong"
    )


def _checked_text(text: Callable[[Dto], str]) -> Callable[[Dto], str]:
    """Have a `__str__` raise an error of the library where a field is of a wrong type."""

    @wraps(text)
    def checked(self: Dto) -> str:
        try:
            found: object = text(self)
        except KantSqlError:
            raise
        except Exception as error:
            raise _malformed(self) from error
        if not isinstance(found, str):
            raise _malformed(self)
        return found

    return checked


class Dto:
    """A piece of PDDL knowledge as plain data; `str()` of it is its PDDL text.

    Two DTOs are equal when they denote the same element, whatever else they say of it. Fields may
    be assigned, unchecked: a DTO with a field of a wrong type equals only itself, and its text and
    its hash are an `InvalidKnowledgeError`.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__str__" in vars(cls):
            cls.__str__ = _checked_text(cls.__str__)  # type: ignore[method-assign,assignment]

    def _identity(self) -> tuple[object, ...]:
        """Give what makes this element the one that it is, in a hashable form."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Dto):
            return NotImplemented
        try:
            return bool(self._identity() == other._identity())
        except Exception:
            # Fields are public and unchecked: what has no identity is equal to nothing else.
            return self is other

    def __hash__(self) -> int:
        try:
            return hash(self._identity())
        except KantSqlError:
            raise
        except Exception as error:
            raise _malformed(self) from error


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
