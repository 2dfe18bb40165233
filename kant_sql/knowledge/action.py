"""What an action, a process or an event is, at one revision."""

from __future__ import annotations

from typing import NamedTuple

from .predicate import ParameterDefinition
from .tree import Tree

CONDITION, EFFECT, DURATION = "condition", "effect", "duration"


class ActionDefinition(NamedTuple):
    """An action, a process or an event.

    Attributes:
        id: the identity's id.
        name: the name, in its first spelling.
        kind: `action`, `durative-action`, `process` or `event`.
        parameters: the parameters, in order.
        duration: the conjunction of the constraints on the duration; empty when there is none.
        condition: the conjunction of what must hold.
        effect: the conjunction of what it brings about.
        text: the canonical PDDL text.
    """

    id: int
    name: str
    kind: str
    parameters: tuple[ParameterDefinition, ...]
    duration: Tree
    condition: Tree
    effect: Tree
    text: str

    @property
    def trees(self) -> tuple[Tree, ...]:
        """All its trees."""
        return (self.duration, self.condition, self.effect)
