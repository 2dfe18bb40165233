"""Building the domain that a store holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

from ..dao.formula import read_formula, read_formulas
from ..dto.formula import TypedName
from ..dto.name import ROOT_TYPE, fold
from ..errors import reading_rows
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.document import DOMAIN, DocumentDefinition
from ..knowledge.elements import Definition
from ..knowledge.formula import DERIVED_PREDICATE, DOMAIN_CONSTRAINT
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree_reader import TreeReader, typed_name
from ..knowledge.type import TypeDefinition
from ..pddl import used_requirements
from ..pddl.document import Action, Domain, Function, Predicate
from .constants import constant_ids
from .ordering import domain_title, find_document, ordered

N = TypeVar("N", bound=Definition)


class DomainBuilder:
    """Builds a domain from definitions."""

    def __init__(self, definitions: Definitions) -> None:
        """Make it.

        Args:
            definitions: what is defined.
        """
        self._definitions = definitions
        self._document = find_document(definitions, DOMAIN)

    def build(self, default_name: str) -> Domain:
        """Build the domain.

        Args:
            default_name: what it is called when none was loaded.

        Returns:
            The domain.
        """
        definitions, document = self._definitions, self._document
        ids = constant_ids(definitions)
        constants = [object_ for object_ in definitions.objects if object_.id in ids]
        return Domain(
            domain_title(definitions, default_name),
            () if document is None else tuple(document.names("requirement")),
            tuple(self._type(each) for each in self._types()),
            tuple(
                self._typed(each.name, each.type_ids) for each in self._named("constant", constants)
            ),
            tuple(
                Predicate(each.name, self._parameters(each.parameters))
                for each in self._named("predicate", definitions.predicates)
            ),
            tuple(
                Function(
                    each.name,
                    self._parameters(each.parameters),
                    self._typed("", each.type_ids).types,
                )
                for each in self._named("function", definitions.functions)
            ),
            self._formulas(DOMAIN_CONSTRAINT),
            self._formulas(DERIVED_PREDICATE),
            tuple(self._action(each) for each in self._named("action", definitions.actions)),
        )

    def _types(self) -> list[TypeDefinition]:
        named = {*self._document.names("type")} if self._document else set()
        # `object` is there without being said, unless the domain says it.
        types = [
            each
            for each in self._definitions.types
            if fold(each.name) != ROOT_TYPE or ROOT_TYPE in named
        ]
        return self._named("type", types)

    def _named(self, section: str, definitions: Iterable[N]) -> list[N]:
        return ordered(definitions, lambda each: fold(each.name), self._document, section)

    def _type(self, type_: TypeDefinition) -> TypedName:
        return (
            self._typed(type_.name, type_.parent_ids) if type_.parent_ids else TypedName(type_.name)
        )

    def _typed(self, name: str, type_ids: Iterable[int]) -> TypedName:
        return typed_name(self._definitions, ParameterDefinition(name, tuple(type_ids)))

    def _parameters(self, parameters: Iterable[ParameterDefinition]) -> tuple[TypedName, ...]:
        return tuple(typed_name(self._definitions, parameter) for parameter in parameters)

    def _formulas(self, section: str) -> tuple[Any, ...]:
        return read_section(self._definitions, self._document, section)

    def _action(self, action: ActionDefinition) -> Action:
        with reading_rows("action_version", f"action {action.id!r}"):
            parts = (
                TreeReader(self._definitions, tree, action.parameters).conjuncts()
                for tree in action.trees
            )
            return Action(action.kind, action.name, self._parameters(action.parameters), *parts)


def read_section(
    definitions: Definitions, document: DocumentDefinition | None, section: str
) -> tuple[Any, ...]:
    """Read the formulas of one section, in the order of a document.

    Args:
        definitions: what is defined.
        document: the document, if there is one.
        section: its section.

    Returns:
        The formulas.
    """
    stored = read_formulas(definitions, section)
    found = ordered(stored, lambda each: each.name, document, section)
    return tuple(read_formula(definitions, each) for each in found)


def build_domain(definitions: Definitions, default_name: str) -> Domain:
    """Build the domain that is defined.

    Args:
        definitions: what is defined.
        default_name: what it is called when none was loaded.

    Returns:
        The domain.
    """
    domain = DomainBuilder(definitions).build(default_name)
    if find_document(definitions, DOMAIN) is not None:
        return domain
    # Nobody has written any, and a reader has to know.
    return replace(domain, requirements=used_requirements(domain))
