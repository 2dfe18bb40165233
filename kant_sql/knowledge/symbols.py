"""The names of a state, for readers of PDDL text."""

from __future__ import annotations

from typing_extensions import override

from ..dto.formulas import Constant
from ..dto.lexical import ROOT_TYPE, fold
from ..pddl.symbols import ANY, Entity, Signature, Signatures, SymbolTable, Types
from .definitions import Definitions, FunctionDefinition
from .trees import ParameterDefinition


class _StoredSignatures(Signatures):
    """The predicates or the functions of a state, read on first use."""

    def __init__(self, kind: str, definitions: Definitions) -> None:
        super().__init__(kind)
        self._elements = definitions.elements(kind)
        self._definitions = definitions

    @override
    def find(self, name: str) -> Signature | None:
        found = self._found.get(name)
        if found is None:
            definition = self._elements.named(name)
            if definition is None:
                return super().find(name)
            known = self._definitions
            types: Types = ()
            if isinstance(definition, FunctionDefinition) and definition.type_ids:
                types = _named(known, definition.type_ids)
            parameters: tuple[ParameterDefinition, ...] = definition.parameters
            accepted = tuple([_named(known, parameter.type_ids) for parameter in parameters])
            found = Signature(definition.name, accepted, types)
            self._found[name] = self._found.setdefault(fold(name), found)
        return found

    @override
    def names(self) -> list[str]:
        return [definition.name for definition in self._elements]


class StoredSymbols(SymbolTable):
    """The names of a state. Objects are looked up one by one: there may be many."""

    def __init__(self, definitions: Definitions) -> None:
        super().__init__()
        self._definitions = definitions
        self.predicates = _StoredSignatures("predicate", definitions)
        self.functions = _StoredSignatures("function", definitions)
        for type_ in definitions.types:
            self.types[fold(type_.name)] = type_.name
            self.parents[type_.name] = _named(definitions, type_.parent_ids)

    @override
    def object(self, name: str) -> Entity | None:
        found = self.objects.get(name)
        if found is None:
            definition = self._definitions.objects.named(name)
            if definition is None:
                return None
            found = Constant(definition.name), _named(self._definitions, definition.type_ids)
            self.objects[name] = found
        return found

    @override
    def is_object(self, name: str) -> bool:
        return self.object(name) is not None

    @override
    def object_names(self) -> list[str]:
        return [definition.name for definition in self._definitions.objects]


def _named(definitions: Definitions, ids: tuple[int, ...]) -> Types:
    """Name types, with `object` for none."""
    types = tuple([definitions.types.live(id_).name for id_ in ids])
    return ANY if not types or ROOT_TYPE in map(fold, types) else types


def symbols_of(definitions: Definitions) -> SymbolTable:
    """Return the names of a state, cached with it."""
    return definitions.derive(StoredSymbols)
