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
    """

    id: int
    name: str
    type_id: int
    text: str
