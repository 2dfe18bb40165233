"""A PDDL type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..arguments import expect
from .dto import NamedDto


@dataclass(init=False, eq=False)
class PddlTypeDto(NamedDto):
    """A type, and its parent in the hierarchy.

    Equal by name. Its text is `robot`, or `robot - vehicle` with a parent.

    Attributes:
        name: the type's name.
        parent: the type right above it. `None` means the root type `object` when this DTO is
            saved itself, and "not said" when another element merely refers to it.
    """

    name: str
    parent: PddlTypeDto | None

    _kind: ClassVar[str] = "type"

    def __init__(self, name: str, *, parent: PddlTypeDto | None = None) -> None:
        self.name = self._checked_name(name)
        self.set_parent(parent)

    def get_parent(self) -> PddlTypeDto | None:
        """Give the parent.

        Returns:
            The parent type, `None` when not said.
        """
        return self.parent

    def set_parent(self, parent: PddlTypeDto | None) -> None:
        """Set the parent.

        Args:
            parent: the parent type, or `None`.
        """
        if parent is not None:
            expect(parent, PddlTypeDto, "the parent of a PddlTypeDto")
        self.parent = parent

    def __str__(self) -> str:
        return self.name if self.parent is None else f"{self.name} - {self.parent.name}"
