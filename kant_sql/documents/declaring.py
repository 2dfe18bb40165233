"""Declarations of a document become definitions: types, objects, predicates and functions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ..dao.object import object_text
from ..dao.parameters import same_types, type_text, type_texts
from ..dto.formula import TypedName
from ..dto.name import ROOT_TYPE, fold
from ..dto.parameters import declaration_text
from ..dto.pddl_function_dto import function_text
from ..errors import ConflictError
from ..knowledge.function import FunctionDefinition
from ..knowledge.object import ObjectDefinition
from ..knowledge.predicate import ParameterDefinition, PredicateDefinition
from ..knowledge.type import TypeDefinition
from ..pddl.document import Function, Predicate
from ..transaction import Transaction
from ..verification.findings import Progress

# A caller is told so often how far a load has come.
_REPORTS = 200


class Steps:
    """Counts the elements that are stored, and reports about each percent of them."""

    def __init__(self, progress: Progress | None = None, whole: int = 0) -> None:
        self._progress, self._whole = progress, whole
        self._done = self._next = 0

    def add(self, count: int) -> None:
        """Count elements that are stored.

        Args:
            count: how many there are.
        """
        self._done += count
        if self._progress is not None and (self._done >= min(self._next, self._whole)):
            self._next = self._done + max(1, self._whole // _REPORTS)
            self._progress(self._done, self._whole)


class Declaring:
    """Defines what a document declares; the document is consistent in itself.

    Attributes:
        said: kind -> ids of what was declared.
    """

    def __init__(self, transaction: Transaction, replace: bool) -> None:
        """Make it for one document.

        Args:
            transaction: the transaction.
            replace: whether what is stored with another definition is redefined, not refused.
        """
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._replace = replace
        self.said: dict[str, set[int]] = {}

    def types(self, types: Sequence[TypedName]) -> None:
        """Declare types.

        Args:
            types: the types, each with the types above it.
        """
        ids = self._identities("type", [type_.name for type_ in types])
        for type_ in types:
            # First without parents, which may come later in the list.
            id_, name = ids[fold(type_.name)]
            if self._definitions.types.get(id_) is None:
                self._transaction.define("type", TypeDefinition(id_, name, None, name))
        for type_ in types:
            id_, name = ids[fold(type_.name)]
            above = () if type_.types == (ROOT_TYPE,) else self.type_ids(type_.types)
            text = f"{name} - {type_text(self._definitions, above)}" if above else name
            first = above[0] if above else None
            self._define("type", TypeDefinition(id_, name, first, text, above[1:]))

    def type_ids(self, names: Iterable[str]) -> tuple[int, ...]:
        """Find the types of a name; `object` comes to be when it is first needed.

        Args:
            names: the names of the types.

        Returns:
            The ids.
        """
        ids = []
        for name in names:
            type_ = self._definitions.types.named(name)
            if type_ is None:
                self.types([TypedName(name)])
                type_ = self._definitions.types.named(name)
                assert type_ is not None
            ids.append(type_.id)
        return tuple(dict.fromkeys(ids))

    def objects(self, objects: Sequence[TypedName], is_constant: bool) -> None:
        """Declare objects, or constants.

        Args:
            objects: the objects.
            is_constant: whether the domain declares them.
        """
        ids = self._identities("object", [object_.name for object_ in objects])
        texts: dict[tuple[str, ...], tuple[tuple[int, ...], str]] = {}
        for object_ in objects:
            if object_.types not in texts:
                type_ids = self.type_ids(object_.types)
                texts[object_.types] = type_ids, type_text(self._definitions, type_ids)
            type_ids, types = texts[object_.types]
            id_, name = ids[fold(object_.name)]
            text = object_text(name, types, is_constant)
            self._define(
                "object",
                ObjectDefinition(id_, name, type_ids[0], text, type_ids[1:], is_constant),
            )

    def parameters(self, parameters: Iterable[TypedName]) -> tuple[ParameterDefinition, ...]:
        """Find the types of parameters.

        Args:
            parameters: the parameters.

        Returns:
            Their definitions.
        """
        return tuple(
            ParameterDefinition(part.name, self.type_ids(part.types)) for part in parameters
        )

    def predicates(self, predicates: Sequence[Predicate]) -> None:
        """Declare predicates.

        Args:
            predicates: the predicates.
        """
        ids = self._identities("predicate", [predicate.name for predicate in predicates])
        for predicate in predicates:
            id_, name = ids[fold(predicate.name)]
            own = self.parameters(predicate.parameters)
            types = type_texts(self._definitions, own)
            text = declaration_text(name, types, [part.name for part in own])
            self._define("predicate", PredicateDefinition(id_, name, own, text))

    def functions(self, functions: Sequence[Function]) -> None:
        """Declare functions.

        Args:
            functions: the functions.
        """
        ids = self._identities("function", [function.name for function in functions])
        for function in functions:
            id_, name = ids[fold(function.name)]
            own, type_ids = self.parameters(function.parameters), self.type_ids(function.types)
            text = function_text(
                name,
                type_texts(self._definitions, own),
                [type_text(self._definitions, [type_id]) for type_id in type_ids],
                [part.name for part in own],
            )
            self._define("function", FunctionDefinition(id_, name, own, type_ids, text))

    def _identities(self, kind: str, names: Sequence[str]) -> dict[str, tuple[int, str]]:
        elements = self._definitions.elements(kind)
        self._transaction.look_up(kind, names)
        ids = {}
        for name in names:
            live = elements.named(name)
            found = (live.id, live.name) if live else self._transaction.intern(kind, name)
            ids[fold(name)] = found
        self.said.setdefault(kind, set()).update(id_ for id_, _ in ids.values())
        return ids

    def _define(self, kind: str, definition: Any) -> None:
        elements = self._definitions.elements(kind)
        stored, before = elements.get(definition.id), elements.origin.get(definition.id)
        if stored is not None and _becomes_constant(stored, definition):
            # An action may mention an object, which the domain then declares.
            before = None
        if stored is None or self._replace or before is None:
            self._transaction.define(kind, definition)
        elif stored != definition and not _says_the_same(stored, definition):
            raise ConflictError(
                f"{kind} {stored.text} is stored, but the document declares {definition.text}; "
                "load it with mode='replace', or make the two agree"
            )


def _becomes_constant(stored: Any, definition: Any) -> bool:
    """Tell whether an object becomes a constant, and nothing else."""
    return (
        isinstance(stored, ObjectDefinition)
        and stored.type_ids == definition.type_ids
        and definition.is_constant
    )


def _says_the_same(stored: Any, definition: Any) -> bool:
    """Tell whether two definitions differ in the names of parameters alone."""
    if isinstance(stored, PredicateDefinition | FunctionDefinition):
        values = getattr(stored, "type_ids", ()) == getattr(definition, "type_ids", ())
        return values and same_types(stored.parameters, definition.parameters)
    return False
