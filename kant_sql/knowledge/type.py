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
    """

    id: int
    name: str
    parent_id: int | None
    text: str
