"""All that is defined at one revision: types, objects, predicates and actions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..dto.name import ROOT_TYPE, fold
from .action import ActionDefinition
from .elements import Elements, PendingElements
from .object import ObjectDefinition
from .predicate import PredicateDefinition
from .type import TypeDefinition

# In the order in which they can be written: each refers to those before it only.
KINDS = ("type", "object", "predicate", "action")


class Definitions:
    """The definitions of one revision, as a snapshot that threads share.

    Attributes:
        types: the types.
        objects: the objects.
        predicates: the predicates.
        actions: the actions.
    """

    __slots__ = ("actions", "objects", "predicates", "types")

    def __init__(
        self,
        types: Elements[TypeDefinition] | None = None,
        objects: Elements[ObjectDefinition] | None = None,
        predicates: Elements[PredicateDefinition] | None = None,
        actions: Elements[ActionDefinition] | None = None,
    ) -> None:
        self.types = types or Elements()
        self.objects = objects or Elements()
        self.predicates = predicates or Elements()
        self.actions = actions or Elements()

    def elements(self, kind: str) -> Elements[Any]:
        """Find the elements of one kind.

        Args:
            kind: one of `KINDS`.

        Returns:
            The elements.
        """
        elements: Elements[Any] = getattr(self, f"{kind}s")
        return elements

    def ancestry(self, type_id: int) -> Iterator[TypeDefinition]:
        """Give a type and all types above it.

        Args:
            type_id: the type.

        Yields:
            The type itself, its parent, and so on up.
        """
        current: int | None = type_id
        while (definition := self.types.get(current)) is not None:
            yield definition
            current = definition.parent_id

    def fits(self, type_id: int, allowed: Iterable[int]) -> bool:
        """Tell whether an object of a type fits a parameter.

        Every type is a subtype of `object` (PDDL 2.1, appendix A), declared or not.

        Args:
            type_id: the object's type.
            allowed: the types that the parameter allows.

        Returns:
            Whether the type is one of them, or a subtype of one.
        """
        for wanted in allowed:
            if type_id == wanted:
                return True
            root = self.types.get(wanted)
            if root is not None and fold(root.name) == ROOT_TYPE:
                return True
            if any(above.id == wanted for above in self.ancestry(type_id)):
                return True
        return False

    def subtypes(self, type_id: int) -> set[int]:
        """Give a type and all types below it.

        Args:
            type_id: the type.

        Returns:
            Their ids.
        """
        children: dict[int | None, list[int]] = {}
        for definition in self.types:
            children.setdefault(definition.parent_id, []).append(definition.id)
        found: set[int] = set()
        pending = [type_id]
        while pending:
            current = pending.pop()
            if current not in found:
                found.add(current)
                pending.extend(children.get(current, ()))
        return found


class PendingDefinitions(Definitions):
    """The definitions as a transaction has changed them so far."""

    __slots__ = ()

    types: PendingElements[TypeDefinition]
    objects: PendingElements[ObjectDefinition]
    predicates: PendingElements[PredicateDefinition]
    actions: PendingElements[ActionDefinition]

    def __init__(self, origin: Definitions) -> None:
        super().__init__(
            PendingElements(origin.types),
            PendingElements(origin.objects),
            PendingElements(origin.predicates),
            PendingElements(origin.actions),
        )

    def changed(self) -> list[tuple[str, PendingElements[Any]]]:
        """Give the kinds of which a definition was set, even to what it was.

        Returns:
            The name of each kind, and its elements.
        """
        kinds = (
            ("type", self.types),
            ("object", self.objects),
            ("predicate", self.predicates),
            ("action", self.actions),
        )
        return [(kind, elements) for kind, elements in kinds if elements.changes]

    def elements(self, kind: str) -> PendingElements[Any]:
        """Find the elements of one kind, with what has changed of them."""
        elements: PendingElements[Any] = super().elements(kind)  # type: ignore[assignment]
        return elements

    def publish(self) -> Definitions:
        """Make the snapshot after the commit.

        Returns:
            The snapshot.
        """
        return Definitions(
            self.types.publish(),
            self.objects.publish(),
            self.predicates.publish(),
            self.actions.publish(),
        )
