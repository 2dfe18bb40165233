"""The canonical text of a definition, from its rows alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..dao.formula import formula_text
from ..dao.object import object_text
from ..dao.parameters import type_text, type_texts
from ..dto.parameters import declaration_text
from ..dto.pddl_action_dto import action_text, duration_text
from ..dto.pddl_function_dto import function_text
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.document import DocumentDefinition, document_text
from ..knowledge.formula import FormulaDefinition
from ..knowledge.function import FunctionDefinition
from ..knowledge.object import ObjectDefinition
from ..knowledge.predicate import PredicateDefinition
from ..knowledge.tree_reader import TreeReader, typed_name
from ..knowledge.type import TypeDefinition
from ..pddl.node_text import node_text


def _type(names: Definitions, type_: TypeDefinition) -> str:
    above = type_.parent_ids
    return f"{type_.name} - {type_text(names, above)}" if above else type_.name


def _object(names: Definitions, object_: ObjectDefinition) -> str:
    return object_text(object_.name, type_text(names, object_.type_ids), object_.is_constant)


def _predicate(names: Definitions, predicate: PredicateDefinition) -> str:
    types = type_texts(names, predicate.parameters)
    return declaration_text(predicate.name, types, [each.name for each in predicate.parameters])


def _function(names: Definitions, function: FunctionDefinition) -> str:
    return function_text(
        function.name,
        type_texts(names, function.parameters),
        [type_text(names, [type_id]) for type_id in function.type_ids],
        [each.name for each in function.parameters],
    )


def _action(names: Definitions, action: ActionDefinition) -> str:
    duration, condition, effect = (
        TreeReader(names, tree, action.parameters).conjuncts() for tree in action.trees
    )
    parameters = (typed_name(names, parameter) for parameter in action.parameters)
    return action_text(
        action.kind,
        action.name,
        [(each.name, each.type_text) for each in parameters],
        duration_text(duration),
        map(node_text, condition),
        map(node_text, effect),
    )


def _formula(names: Definitions, formula: FormulaDefinition) -> str:
    return formula_text(TreeReader(names, formula.tree).formula())


def _document(_: Definitions, document: DocumentDefinition) -> str:
    return document_text(document.name, document.title, document.domain, document.items)


_TEXTS: dict[str, Callable[[Definitions, Any], str]] = {
    "type": _type,
    "object": _object,
    "predicate": _predicate,
    "function": _function,
    "action": _action,
    "formula": _formula,
    "document": _document,
}


def definition_text(names: Definitions, kind: str, definition: Any) -> str:
    """Write a definition down as it is written when it is saved.

    Args:
        names: gives the names of what it refers to.
        kind: what it is.
        definition: the definition, as its rows have it.

    Returns:
        The canonical text.

    Raises:
        KantSqlError: the rows make no definition of the kind.
    """
    return _TEXTS[kind](names, definition)
