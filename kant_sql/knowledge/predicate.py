"""What a predicate is, at one revision."""

from __future__ import annotations

from typing import NamedTuple


class ParameterDefinition(NamedTuple):
    """A parameter of a predicate or of an action.

    Attributes:
        name: its name, without the question mark.
        type_ids: the types that it allows: one, or several for `either`.
    """

    name: str
    type_ids: tuple[int, ...]


class PredicateDefinition(NamedTuple):
    """A predicate and its parameters.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        parameters: the parameters, in order.
        text: the canonical PDDL text.
    """

    id: int
    name: str
    parameters: tuple[ParameterDefinition, ...]
    text: str
