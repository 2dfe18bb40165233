"""What an object is, at one revision."""

from __future__ import annotations

from typing import NamedTuple


class ObjectDefinition(NamedTuple):
    """An object and its type.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        type_id: its type.
        text: the canonical PDDL text.
        other_type_ids: further types, when it is declared with `either`.
        is_constant: whether the domain declares it, not the problem.
    """

    id: int
    name: str
    type_id: int
    text: str
    other_type_ids: tuple[int, ...] = ()
    is_constant: bool = False

    @property
    def type_ids(self) -> tuple[int, ...]:
        """All its types."""
        return (self.type_id, *self.other_type_ids)
