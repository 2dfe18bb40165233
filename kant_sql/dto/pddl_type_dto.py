"""A PDDL type."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any, ClassVar

from ..arguments import expect
from .dto import NamedDto


@dataclass(init=False, eq=False, repr=False)
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

    def __repr__(self) -> str:
        texts: list[str] = []
        current: PddlTypeDto | None = self
        seen: set[int] = set()
        while type(current) is PddlTypeDto:
            if id(current) in seen:
                # A parent that was assigned may lead back: the text ends all the same.
                return "".join(texts) + "..." + ")" * len(texts)
            seen.add(id(current))
            texts.append(f"PddlTypeDto(name={current.name!r}, parent=")
            current = current.parent
        return f"{''.join(texts)}{current!r}{')' * len(texts)}"

    def __deepcopy__(self, memo: dict[int, Any]) -> PddlTypeDto:
        chain: list[PddlTypeDto] = []
        current: PddlTypeDto | None = self
        while current is not None and id(current) not in memo:
            chain.append(current)
            made = memo[id(current)] = copy.copy(current)
            made.__dict__.pop("parent")
            current = current.parent
        # From the top, so that what others refer to is there: hierarchies may be of any depth.
        for one in reversed(chain):
            made = memo[id(one)]
            for name, value in vars(one).items():
                setattr(made, name, copy.deepcopy(value, memo))
        found: PddlTypeDto = memo[id(self)]
        return found

    def __str__(self) -> str:
        return self.name if self.parent is None else f"{self.name} - {self.parent.name}"
