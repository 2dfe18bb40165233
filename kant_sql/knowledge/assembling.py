"""From the rows of one statement to definitions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any, NamedTuple

from ..backends import Row
from .action import (
    CONDITION,
    DURATION,
    EFFECT,
    ActionDefinition,
    Node,
    Term,
    tree_duration,
    tree_literals,
)
from .definitions import KINDS, Definitions
from .object import ObjectDefinition
from .predicate import ParameterDefinition, PredicateDefinition
from .type import TypeDefinition

# How the part is named that says which elements of a kind are live no more.
GONE = "gone "


class _Part(NamedTuple):
    """A row of the statement. What `a`, `b` and `c` are depends on the part."""

    part: str
    owner: int
    section: Any
    position: int
    a: Any
    b: Any
    c: Any
    name: Any
    text: Any


def evolve(definitions: Definitions, rows: Iterable[Row]) -> Definitions:
    """Make the definitions that follow from those of before and the rows that were read since.

    Args:
        definitions: the definitions of before; empty ones for a whole reading.
        rows: the rows of the statement, in any order.

    Returns:
        The new definitions.
    """
    parts: defaultdict[str, list[_Part]] = defaultdict(list)
    for row in rows:
        parts[row[0]].append(_Part(*row))
    changes: dict[str, dict[int, Any]] = {
        kind: {row.owner: None for row in parts[f"{GONE}{kind}"]} for kind in KINDS
    }
    for row in parts["type"]:
        changes["type"][row.owner] = TypeDefinition(row.owner, row.name, row.a, row.text)
    for row in parts["object"]:
        changes["object"][row.owner] = ObjectDefinition(row.owner, row.name, row.a, row.text)
    parameters = _parameters(parts, "predicate")
    for row in parts["predicate"]:
        changes["predicate"][row.owner] = PredicateDefinition(
            row.owner, row.name, parameters.get(row.owner, ()), row.text
        )
    changes["action"].update(_actions(parts))
    return Definitions(*(definitions.elements(kind).evolve(changes[kind]) for kind in KINDS))


def _parameters(
    parts: dict[str, list[_Part]], kind: str
) -> dict[int, tuple[ParameterDefinition, ...]]:
    types: defaultdict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for row in parts[f"{kind} type"]:
        types[row.owner, row.position].append((row.a, row.b))
    parameters: defaultdict[int, list[ParameterDefinition]] = defaultdict(list)
    for row in sorted(parts[f"{kind} parameter"], key=lambda row: row.position):
        allowed = tuple(type_id for _, type_id in sorted(types[row.owner, row.position]))
        parameters[row.owner].append(ParameterDefinition(row.name, allowed))
    return {owner: tuple(listed) for owner, listed in parameters.items()}


def _actions(parts: dict[str, list[_Part]]) -> dict[int, ActionDefinition]:
    parameters, trees = _parameters(parts, "action"), _trees(parts)
    return {
        row.owner: ActionDefinition(
            row.owner,
            row.name,
            parameters.get(row.owner, ()),
            tree_literals(trees[row.owner, CONDITION]),
            tree_literals(trees[row.owner, EFFECT]),
            tree_duration(trees[row.owner, DURATION]),
            row.text,
        )
        for row in parts["action"]
    }


def _trees(parts: dict[str, list[_Part]]) -> defaultdict[tuple[int, str], list[Node]]:
    terms: defaultdict[tuple[int, str, int], list[tuple[int, Term]]] = defaultdict(list)
    for row in parts["term"]:
        terms[row.owner, row.section, row.position].append((row.a, Term(row.b, row.c)))
    trees: defaultdict[tuple[int, str], list[Node]] = defaultdict(list)
    for row in sorted(parts["expression"], key=lambda row: row.position):
        own = tuple(term for _, term in sorted(terms[row.owner, row.section, row.position]))
        node = Node(row.position, row.a, row.name, row.b, row.text, own)
        trees[row.owner, row.section].append(node)
    return trees
