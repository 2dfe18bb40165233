"""What a function is, at one revision."""

from __future__ import annotations

from typing import NamedTuple

from .predicate import ParameterDefinition


class FunctionDefinition(NamedTuple):
    """A function, its parameters and its values.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        parameters: the parameters, in order.
        type_ids: the types of its values; none for numbers.
        text: the canonical PDDL text.
    """

    id: int
    name: str
    parameters: tuple[ParameterDefinition, ...]
    type_ids: tuple[int, ...]
    text: str
