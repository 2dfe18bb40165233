"""What a type is, at one revision."""

from __future__ import annotations

from typing import NamedTuple


class TypeDefinition(NamedTuple):
    """A type and the type above it.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        parent_id: the type above it; None right under the root.
        text: the canonical PDDL text.
        other_parent_ids: further parents, when the parent is declared with `either`.
    """

    id: int
    name: str
    parent_id: int | None
    text: str
    other_parent_ids: tuple[int, ...] = ()

    @property
    def parent_ids(self) -> tuple[int, ...]:
        """All types right above it; none right under the root."""
        return () if self.parent_id is None else (self.parent_id, *self.other_parent_ids)
