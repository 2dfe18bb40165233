"""From the rows of one statement to definitions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from ..backends import Row
from ..errors import UNREADABLE, reading_rows, unreadable
from .action import CONDITION, DURATION, EFFECT, ActionDefinition
from .definitions import KINDS, Definitions
from .document import DOMAIN, PROBLEM, DocumentDefinition, Item
from .formula import FormulaDefinition
from .function import FunctionDefinition
from .object import ObjectDefinition
from .predicate import ParameterDefinition, PredicateDefinition
from .tree import Node, Term, Tree
from .type import TypeDefinition

# How the part is named that says which elements of a kind are live no more.
GONE = "gone "


class Part(NamedTuple):
    """A row of the statement. What `a` to `f` are depends on the part."""

    part: str
    owner: int
    section: Any
    position: int
    a: Any
    b: Any
    c: Any
    d: Any
    e: Any
    f: Any
    name: Any
    text: Any


_Parts = dict[str, list[Part]]


def evolve(definitions: Definitions, rows: Iterable[Row]) -> Definitions:
    """Make the definitions that follow from those of before and the rows that were read since.

    Args:
        definitions: the definitions of before; empty ones for a whole reading.
        rows: the rows of the statement, in any order.

    Returns:
        The new definitions.
    """
    parts: defaultdict[str, list[Part]] = defaultdict(list)
    for row in rows:
        parts[row[0]].append(Part(*row))
    made: list[Any] = []
    for kind in KINDS:
        changes: dict[int, Any] = {row.owner: None for row in parts[f"{GONE}{kind}"]}
        try:
            changes.update((definition.id, definition) for definition in _made(kind, parts))
            made.append(definitions.elements(kind).evolve(changes))
        except UNREADABLE as error:
            _find_unreadable(kind, parts)
            raise unreadable(f"{kind}_version", f"some {kind}", error) from error
    return Definitions(*made)


def _find_unreadable(kind: str, parts: _Parts) -> None:
    """Raise the error of the first definition whose rows cannot be read, by its id."""
    for id_ in dict.fromkeys(row.owner for rows in parts.values() for row in rows):
        own = defaultdict(list)
        for part, rows in parts.items():
            own[part] = [row for row in rows if row.owner == id_]
        with reading_rows(f"{kind}_version", f"{kind} {id_!r}"):
            Definitions().elements(kind).evolve(
                {definition.id: definition for definition in _made(kind, own)}
            )


def _made(kind: str, parts: _Parts) -> Iterator[Any]:
    """Make the definitions of one kind, each with a name and a text: SQLite keeps anything."""
    for definition in _ASSEMBLE[kind](parts):
        if not (
            isinstance(definition.id, int)
            and isinstance(definition.name, str)
            and isinstance(definition.text, str)
        ):
            raise TypeError(f"{definition.id!r}, {definition.name!r} is {definition.text!r}")
        yield definition


def assemble(kind: str, rows: Iterable[Part]) -> list[Any]:
    """Make the definitions of one kind that rows say.

    Args:
        kind: one of `KINDS`.
        rows: the rows, in any order.

    Returns:
        The definitions.
    """
    parts: defaultdict[str, list[Part]] = defaultdict(list)
    for row in rows:
        parts[row.part].append(row)
    return [*_ASSEMBLE[kind](parts)]


def _types(parts: _Parts) -> Iterable[TypeDefinition]:
    others = _listed(parts["type parent"])
    for row in parts["type"]:
        yield TypeDefinition(row.owner, row.name, row.a, row.text, others.get(row.owner, ()))


def _objects(parts: _Parts) -> Iterable[ObjectDefinition]:
    others = _listed(parts["object type"])
    for row in parts["object"]:
        yield ObjectDefinition(
            row.owner, row.name, row.a, row.text, others.get(row.owner, ()), bool(row.b)
        )


def _predicates(parts: _Parts) -> Iterable[PredicateDefinition]:
    parameters = _parameters(parts, "predicate")
    for row in parts["predicate"]:
        yield PredicateDefinition(row.owner, row.name, parameters.get(row.owner, ()), row.text)


def _functions(parts: _Parts) -> Iterable[FunctionDefinition]:
    parameters, types = _parameters(parts, "function"), _listed(parts["function value type"])
    for row in parts["function"]:
        own = parameters.get(row.owner, ())
        yield FunctionDefinition(row.owner, row.name, own, types.get(row.owner, ()), row.text)


def _actions(parts: _Parts) -> Iterable[ActionDefinition]:
    parameters, trees = _parameters(parts, "action"), _trees(parts, "action")
    for row in parts["action"]:
        own = parameters.get(row.owner, ())
        duration, condition, effect = (
            trees.get((row.owner, section), ()) for section in (DURATION, CONDITION, EFFECT)
        )
        yield ActionDefinition(
            row.owner, row.name, row.section, own, duration, condition, effect, row.text
        )


def _formulas(parts: _Parts) -> Iterable[FormulaDefinition]:
    trees = _trees(parts, "formula")
    for row in parts["formula"]:
        if not isinstance(row.section, str):
            raise TypeError(f"the section is {row.section!r}")
        tree = trees.get((row.owner, row.section), ())
        yield FormulaDefinition(row.owner, row.name, row.section, tree, row.text)


def _documents(parts: _Parts) -> Iterable[DocumentDefinition]:
    items: defaultdict[int, list[Item]] = defaultdict(list)
    for row in sorted(parts["item"], key=lambda row: (row.section, row.position)):
        items[row.owner].append(Item(row.section, row.text))
    for row in parts["document"]:
        name = DOMAIN if row.section is None else PROBLEM
        own = tuple(items[row.owner])
        yield DocumentDefinition(row.owner, name, row.name, row.section, own, row.text)


_ASSEMBLE: dict[str, Callable[[_Parts], Iterable[Any]]] = {
    "type": _types,
    "object": _objects,
    "predicate": _predicates,
    "function": _functions,
    "action": _actions,
    "formula": _formulas,
    "document": _documents,
}


def _listed(rows: Iterable[Part]) -> dict[int, tuple[int, ...]]:
    """Give each owner's ids, in their order."""
    ids: defaultdict[int, list[int]] = defaultdict(list)
    for row in sorted(rows, key=lambda row: row.position):
        ids[row.owner].append(row.a)
    return {owner: tuple(listed) for owner, listed in ids.items()}


def _parameters(parts: _Parts, kind: str) -> dict[int, tuple[ParameterDefinition, ...]]:
    types: defaultdict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for row in parts[f"{kind} type"]:
        types[row.owner, row.position].append((row.a, row.b))
    parameters: defaultdict[int, list[ParameterDefinition]] = defaultdict(list)
    for row in sorted(parts[f"{kind} parameter"], key=lambda row: row.position):
        allowed = tuple(type_id for _, type_id in sorted(types[row.owner, row.position]))
        parameters[row.owner].append(ParameterDefinition(row.name, allowed))
    return {owner: tuple(listed) for owner, listed in parameters.items()}


def _trees(parts: _Parts, owner: str) -> dict[tuple[int, str], Tree]:
    terms: defaultdict[tuple[int, str, int], list[tuple[int, Term]]] = defaultdict(list)
    for row in parts[f"{owner} term"]:
        term = Term(row.b, row.c, row.d, row.e, row.f)
        terms[row.owner, row.section, row.position].append((row.a, term))
    variables = _variables(parts, owner)
    trees: defaultdict[tuple[int, str], list[Node]] = defaultdict(list)
    for row in sorted(parts[f"{owner} node"], key=lambda row: row.position):
        place = (row.owner, row.section, row.position)
        # By position alone, for a term's other fields may be None.
        own = tuple(term for _, term in sorted(terms[place], key=lambda pair: pair[0]))
        bound = variables.get(place, ())
        node = Node(row.position, row.a, row.name, row.b, row.c, row.text, own, bound)
        trees[row.owner, row.section].append(node)
    return {place: tuple(nodes) for place, nodes in trees.items()}


def _variables(
    parts: _Parts, owner: str
) -> dict[tuple[int, str, int], tuple[ParameterDefinition, ...]]:
    types: defaultdict[tuple[int, str, int, int], list[tuple[int, int]]] = defaultdict(list)
    for row in parts[f"{owner} variable type"]:
        types[row.owner, row.section, row.position, row.a].append((row.b, row.c))
    variables: defaultdict[tuple[int, str, int], list[ParameterDefinition]] = defaultdict(list)
    for row in sorted(parts[f"{owner} variable"], key=lambda row: row.a):
        place = (row.owner, row.section, row.position)
        allowed = tuple(type_id for _, type_id in sorted(types[*place, row.a]))
        variables[place].append(ParameterDefinition(row.text, allowed))
    return {place: tuple(listed) for place, listed in variables.items()}
