"""All that is defined at one revision, facts and the values of functions apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

from ..dto.name import ROOT_TYPE, fold
from ..pddl.hierarchy import Ancestry
from .action import ActionDefinition
from .document import DocumentDefinition
from .elements import Elements, PendingElements
from .formula import FormulaDefinition
from .function import FunctionDefinition
from .object import ObjectDefinition
from .predicate import PredicateDefinition
from .type import TypeDefinition

# In the order in which they can be written: each refers to those before it only.
KINDS = ("type", "object", "predicate", "function", "action", "formula", "document")
_ATTRIBUTES = tuple(f"{kind}s" for kind in KINDS)


class Definitions:
    """The definitions of one revision, as a snapshot that threads share.

    Attributes:
        types: the types.
        objects: the objects.
        predicates: the predicates.
        functions: the functions.
        actions: the actions, processes and events.
        formulas: the formulas that stand on their own.
        documents: the domain and the problem.
    """

    __slots__ = (
        "_ancestry",
        "_by_kind",
        "actions",
        "documents",
        "formulas",
        "functions",
        "objects",
        "predicates",
        "types",
    )

    types: Elements[TypeDefinition]
    objects: Elements[ObjectDefinition]
    predicates: Elements[PredicateDefinition]
    functions: Elements[FunctionDefinition]
    actions: Elements[ActionDefinition]
    formulas: Elements[FormulaDefinition]
    documents: Elements[DocumentDefinition]

    def __init__(self, *elements: Elements[Any]) -> None:
        """Make it.

        Args:
            *elements: the elements of each kind, in the order of `KINDS`; all of them or none.
        """
        self._ancestry: Ancestry[int] | None = None
        given: Iterable[Elements[Any]] = elements or [Elements() for _ in KINDS]
        self._by_kind: dict[str, Any] = dict(zip(KINDS, given, strict=True))
        for name, of_kind in zip(_ATTRIBUTES, self._by_kind.values(), strict=True):
            setattr(self, name, of_kind)

    def elements(self, kind: str) -> Elements[Any]:
        """Find the elements of one kind.

        Args:
            kind: one of `KINDS`.

        Returns:
            The elements.
        """
        elements: Elements[Any] = self._by_kind[kind]
        return elements

    def arguments(self, names: Iterable[str]) -> str | None:
        """Give what interns the arguments of a proposition or a fluent.

        Args:
            names: the names of the objects, in order.

        Returns:
            Their ids, separated by spaces; None when one is not known.
        """
        ids = []
        for name in names:
            object_ = self.objects.named(name)
            if object_ is None:
                return None
            ids.append(str(object_.id))
        return " ".join(ids)

    def ancestry(self, type_id: int) -> Iterator[TypeDefinition]:
        """Give a type and all types above it.

        Args:
            type_id: the type.

        Yields:
            The type itself, its parents, and so on up, each once.
        """
        pending, seen = [type_id], {type_id}
        while pending:
            definition = self.types.get(pending.pop(0))
            if definition is not None:
                yield definition
                above = [id_ for id_ in definition.parent_ids if id_ not in seen]
                seen.update(above)
                pending += above

    def is_root(self, type_id: int) -> bool:
        """Tell whether a type is `object`, above all types (PDDL 2.1, appendix A), said or not.

        Args:
            type_id: the type.

        Returns:
            Whether it is.
        """
        definition = self.types.get(type_id)
        return definition is not None and fold(definition.name) == ROOT_TYPE

    def fits(self, type_id: int, allowed: Iterable[int]) -> bool:
        """Tell whether an object of a type fits a parameter.

        Args:
            type_id: the object's type.
            allowed: the types that the parameter allows.

        Returns:
            Whether the type is one of them, or a subtype of one.
        """
        for wanted in allowed:
            if type_id == wanted or self.is_root(wanted):
                return True
            if self._hierarchy().is_below(type_id, wanted):
                return True
        return False

    def _hierarchy(self) -> Ancestry[int]:
        """Give what knows which types are above which."""
        found = self._ancestry
        if found is None:
            # Snapshots share it, so it holds the types alone.
            found = self._ancestry = Ancestry(partial(_parents, self.types))
        return found

    def any_fits(self, type_ids: Iterable[int], allowed: Iterable[int]) -> bool:
        """Tell whether what is of one of some types fits a parameter.

        Args:
            type_ids: the types, several for `either`.
            allowed: the types that the parameter allows.

        Returns:
            Whether one of the types fits.
        """
        return any(self.fits(type_id, allowed) for type_id in type_ids)

    def subtypes(self, *type_ids: int) -> set[int]:
        """Give types and all types below them.

        Args:
            *type_ids: the types.

        Returns:
            Their ids.
        """
        children: dict[int, list[int]] = {}
        for definition in self.types:
            for parent_id in definition.parent_ids:
                children.setdefault(parent_id, []).append(definition.id)
        found: set[int] = set()
        pending = list(type_ids)
        while pending:
            current = pending.pop()
            if current not in found:
                found.add(current)
                pending.extend(children.get(current, ()))
        return found


def _parents(types: Elements[TypeDefinition], type_id: int) -> tuple[int, ...]:
    definition = types.get(type_id)
    return () if definition is None else definition.parent_ids


class PendingDefinitions(Definitions):
    """The definitions as a transaction has changed them so far."""

    __slots__ = ("_origin",)

    types: PendingElements[TypeDefinition]
    objects: PendingElements[ObjectDefinition]
    predicates: PendingElements[PredicateDefinition]
    functions: PendingElements[FunctionDefinition]
    actions: PendingElements[ActionDefinition]
    formulas: PendingElements[FormulaDefinition]
    documents: PendingElements[DocumentDefinition]

    def __init__(self, origin: Definitions) -> None:
        # Most transactions look at few kinds: the others come to be when they are asked for.
        self._origin = origin
        self._by_kind = {}
        self._ancestry = None

    def __getattr__(self, name: str) -> Any:
        if name not in _ATTRIBUTES:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return self.elements(name[:-1])

    def changed(self) -> list[tuple[str, PendingElements[Any]]]:
        """Give the kinds of which a definition was set, even to what it was.

        Returns:
            The name of each kind, and its elements.
        """
        return [(kind, elements) for kind, elements in self.used() if elements.changes]

    def used(self) -> list[tuple[str, PendingElements[Any]]]:
        """Give the kinds that were asked for so far: of the others, nothing has changed.

        Returns:
            The name of each kind, and its elements, in the order of `KINDS`.
        """
        return [(kind, self._by_kind[kind]) for kind in KINDS if kind in self._by_kind]

    def elements(self, kind: str) -> PendingElements[Any]:
        """Find the elements of one kind, with what has changed of them."""
        elements: PendingElements[Any] | None = self._by_kind.get(kind)
        if elements is None:
            elements = self._by_kind[kind] = PendingElements(self._origin.elements(kind))
            setattr(self, f"{kind}s", elements)
        return elements

    def _hierarchy(self) -> Ancestry[int]:
        """Give what knows which types are above which: as it was while no type has changed."""
        types = self._by_kind.get("type")
        return super()._hierarchy() if types and types.changes else self._origin._hierarchy()

    def reshape(self, new_type: int | None = None) -> None:
        """Let checks know that the hierarchy of types is about to change.

        Args:
            new_type: the type that comes to be; None when others change, or changes are undone.
        """
        if self._ancestry is not None and new_type is not None:
            self._ancestry.forget(new_type)
        else:
            self._ancestry = None

    def publish(self) -> Definitions:
        """Make the snapshot after the commit.

        Returns:
            The snapshot.
        """
        made = Definitions(*(self.elements(kind).publish() for kind in KINDS))
        if not self.elements("type").changes:
            made._ancestry = self._origin._hierarchy()
        return made
