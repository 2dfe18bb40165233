"""`kant-sql show`: a state or a part of it, now or in the past."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.actions import Duration
from ..dto.elements import NamedDto
from ..dto.formulas import Atom, Metric, Node
from ..dto.lexical import ROOT_TYPE, fold, number_text
from ..errors import KantSqlError, printable
from ..knowledge.canonical import time_text
from ..pddl.cursor import hint
from ..pddl.lexer import tokenize
from .common import AsJson, At, Name, Url, open_state, option
from .output import Document, Printer, write_json

if TYPE_CHECKING:
    from ..knowledge_base import KnowledgeBase

# The elements of a state by the name of their section.
Elements = Mapping[str, Sequence[Any]]

_OnlyFacts = Annotated[bool, option("Only facts.", "--facts")]
_OfPredicate = Annotated[
    str | None, option("Only facts and goals of this predicate.", metavar="NAME")
]
_OfObject = Annotated[
    str | None, option("Only elements that name this object.", "--object", metavar="NAME")
]
_OfType = Annotated[
    str | None,
    option(
        "Only elements that name an object of this type or a subtype.", "--type", metavar="NAME"
    ),
]


def show(
    url: Url,
    kb: Name = None,
    at: At = None,
    facts: _OnlyFacts = False,
    predicate: _OfPredicate = None,
    object_: _OfObject = None,
    type_: _OfType = None,
    as_json: AsJson = False,
) -> None:
    """Show a state: objects, facts, goals and the rest.

    Several options select the elements to which all of them apply.
    """
    with open_state(url, kb, at) as (name, state):
        is_part = facts or not predicate is object_ is type_ is None
        if is_part:
            objects = _find_objects(state, name, object_, type_)
            if predicate is not None:
                _find("predicate", predicate, state.predicates.get_all(), name)
            elements = _read_part(state, Selection(facts, predicate, objects))
        committed_at = _committed_at(state)
        if not is_part:
            elements = {section.name: section.read(state) for section in _SECTIONS}
        if as_json:
            header = {"knowledge_base": name, "revision": state.revision}
            write_json({**header, "committed_at": committed_at, **_state_document(elements)})
            return
        printer = Printer()
        moment = committed_at or "before the first"
        printer.line(f"knowledge base {name}, revision {state.revision}, {moment}", "bold")
        _write_state(printer, elements, _SHOWN_IN_PART if is_part else _SHOWN_IN_WHOLE)


def _committed_at(state: KnowledgeBase) -> str | None:
    if state.revision == 0:
        return None
    (revision,) = state.revisions(after=state.revision - 1, limit=1)
    return time_text(revision.committed_at)


# Selecting a part


class Selection(NamedTuple):
    """Which elements of a state to show: those that all of these conditions apply to.

    Attributes:
        facts: only facts.
        predicate: the name of the predicate of facts and goals.
        objects: the folded names of objects, one of which an element names; None for any.
    """

    facts: bool = False
    predicate: str | None = None
    objects: frozenset[str] | None = None


def _read_part(state: KnowledgeBase, selection: Selection) -> Elements:
    """Read the selected elements, by the sections that can have any."""
    dao, predicate, objects = state.propositions, selection.predicate, selection.objects
    atoms = dao.get_no_goals() if predicate is None else dao.get_by_predicate(predicate)
    part: dict[str, Sequence[Any]] = {"objects": [], "facts": [], "function_values": []}
    part["facts"] = [one for one in atoms if not one.is_goal and _names_one(one.objects, objects)]
    part["goals"] = []
    if selection.facts:
        return part
    part["goals"] = [node for node in state.goals.get_all() if _mentions(node, selection)]
    if predicate is None:
        part["objects"] = [one for one in state.objects.get_all() if _names_one([one], objects)]
        values = state.function_values.get_all()
        part["function_values"] = [one for one in values if _names_object(one, objects)]
    return part


def _names_one(dtos: Iterable[PddlObjectDto], objects: frozenset[str] | None) -> bool:
    return objects is None or any(fold(dto.name) in objects for dto in dtos)


def _names_object(dto: PddlFunctionValueDto, objects: frozenset[str] | None) -> bool:
    value = [dto.value] if isinstance(dto.value, PddlObjectDto) else []
    return _names_one([*dto.objects, *value], objects)


def _mentions(node: Node, selection: Selection) -> bool:
    """Return whether a goal of any form has the predicate and one of the objects in it."""
    words = set(tokenize(fold(str(node))))
    has_predicate = selection.predicate is None or fold(selection.predicate) in words
    return has_predicate and (selection.objects is None or bool(words & selection.objects))


def _find_objects(
    state: KnowledgeBase, kb: str, object_: str | None, type_: str | None
) -> frozenset[str] | None:
    """Return the objects of a name, a type or both; None for all."""
    if object_ is None and type_ is None:
        return None
    found = state.objects.get_all()
    if type_ is not None:
        types = state.types.get_all()
        if fold(type_) != ROOT_TYPE:
            _find("type", type_, types, kb)
        found = [dto for dto in found if fold(type_) in _lineage(dto.type)]
    if object_ is not None:
        one = _find("object", object_, state.objects.get_all(), kb)
        found = [dto for dto in found if dto.name == one]
    return frozenset(fold(dto.name) for dto in found)


def _lineage(dto: PddlTypeDto | None) -> Iterator[str]:
    yield ROOT_TYPE
    while dto is not None:
        yield fold(dto.name)
        dto = dto.parent


def _find(kind: str, name: str, dtos: Sequence[NamedDto], kb: str) -> str:
    """Return a name in its stored spelling; raise if there is none."""
    names = {fold(dto.name): dto.name for dto in dtos}
    if fold(name) not in names:
        raise KantSqlError(
            f"there is no {kind} {printable(name)!r} in knowledge base {kb!r} at this revision"
            f"{hint(name, list(names.values()))}"
        )
    return names[fold(name)]


# JSON


def _type(dto: PddlTypeDto) -> Document:
    return {"name": dto.name, "parent": dto.parent.name if dto.parent else None}


def _object(dto: PddlObjectDto) -> Document:
    return {"name": dto.name, "type": dto.type.name, "is_constant": dto.is_constant}


def _predicate(dto: PddlPredicateDto) -> Document:
    return {"name": dto.name, "types": [type_.name for type_ in dto.types], "pddl": str(dto)}


def _function(dto: PddlFunctionDto) -> Document:
    return {
        "name": dto.name,
        "types": [type_.name for type_ in dto.types],
        "value_types": [type_.name for type_ in dto.value_types],
        "pddl": str(dto),
    }


def _proposition(dto: PddlPropositionDto) -> Document:
    return {
        "predicate": dto.predicate.name,
        "objects": [object_.name for object_ in dto.objects],
        "pddl": str(dto),
    }


def _function_value(dto: PddlFunctionValueDto) -> Document:
    value = dto.value
    return {
        "function": dto.function.name,
        "objects": [object_.name for object_ in dto.objects],
        # As text, a number is exact in every JSON reader.
        "value": value.name if isinstance(value, PddlObjectDto) else number_text(value),
        "pddl": str(dto),
    }


def _goal(node: Node) -> Document:
    if not isinstance(node, Atom):
        return _node(node)
    objects = [str(term) for term in node.terms]
    return {"predicate": node.predicate, "objects": objects, "pddl": str(node)}


def _node(node: Node) -> Document:
    return {"pddl": str(node)}


def _metric(metric: Metric) -> Document:
    return {
        "optimization": metric.optimization,
        "expression": str(metric.expression),
        "pddl": str(metric),
    }


def _action(dto: PddlActionDto) -> Document:
    return {
        "name": dto.name,
        "parameters": [{"name": one.name, "type": one.type.name} for one in dto.parameters],
        "conditions": [_condition_effect(one) for one in dto.conditions],
        "effects": [_condition_effect(one) for one in dto.effects],
        "durative": dto.durative,
        "duration": _duration(dto.duration) if dto.durative else None,
        "pddl": str(dto),
    }


def _duration(duration: Duration) -> object:
    if isinstance(duration, int | float):
        return duration
    return str(duration) if isinstance(duration, Decimal) else [str(part) for part in duration]


def _condition_effect(dto: PddlConditionEffectDto | Node) -> Document:
    if isinstance(dto, Node):
        return _node(dto)
    return {
        "predicate": dto.predicate.name,
        "objects": [object_.name for object_ in dto.objects],
        "time": dto.time,
        "is_negative": dto.is_negative,
    }


# The sections


class Section(NamedTuple):
    """A section of a state.

    Attributes:
        name: its name, in JSON and, with spaces, as the title of its table.
        column: the head of its first column.
        read: reads its elements.
        document: makes JSON data of an element.
        second: the head of the second column and what makes its cells; the first then has the name.
    """

    name: str
    column: str
    read: Callable[[KnowledgeBase], Sequence[Any]]
    document: Callable[[Any], object] = _node
    second: tuple[str, Callable[[Any], str]] | None = None


_SECTIONS = (
    Section("requirements", "requirement", lambda state: state.domain().requirements, str),
    Section(
        "types",
        "type",
        lambda state: state.types.get_all(),
        _type,
        ("parent", lambda dto: dto.parent.name if dto.parent else ROOT_TYPE),
    ),
    Section(
        "objects",
        "object",
        lambda state: state.objects.get_all(),
        _object,
        ("type", lambda dto: dto.type.name),
    ),
    Section("predicates", "predicate", lambda state: state.predicates.get_all(), _predicate),
    Section("functions", "function", lambda state: state.functions.get_all(), _function),
    Section(
        "derived_predicates", "derived predicate", lambda state: state.derived_predicates.get_all()
    ),
    Section("facts", "fact", lambda state: state.propositions.get_no_goals(), _proposition),
    Section(
        "function_values",
        "function value",
        lambda state: state.function_values.get_all(),
        _function_value,
    ),
    Section("initial_literals", "initial literal", lambda state: state.initial_literals.get_all()),
    Section(
        "timed_initial_literals",
        "timed initial literal",
        lambda state: state.timed_initial_literals.get_all(),
    ),
    Section("goals", "goal", lambda state: state.goals.get_all(), _goal),
    Section("constraints", "constraint", lambda state: state.constraints.get_all()),
    Section(
        "domain_constraints", "domain constraint", lambda state: state.domain_constraints.get_all()
    ),
    Section("metric", "metric", lambda state: [m for m in [state.metric.get()] if m], _metric),
    Section("actions", "action", lambda state: state.actions.get_all(), _action),
    Section("processes", "process", lambda state: state.processes.get_all(), _action),
    Section("events", "event", lambda state: state.events.get_all(), _action),
)
# Sections that are shown to people even if they are empty.
_SHOWN_IN_WHOLE = frozenset({"types", "objects", "predicates", "facts", "goals", "actions"})
_SHOWN_IN_PART = frozenset({"facts"})


def _state_document(elements: Elements) -> Document:
    """Return a state, or a part of one, as JSON data."""
    document: Document = {
        section.name: [section.document(one) for one in elements[section.name]]
        for section in _SECTIONS
        if section.name in elements
    }
    if "metric" in elements:
        document["metric"] = next((_metric(one) for one in elements["metric"]), None)
    return document


def _write_state(printer: Printer, elements: Elements, always: frozenset[str]) -> None:
    """Write a state, or a part of one, for people."""
    for section in _SECTIONS:
        found = elements.get(section.name, ())
        if not found and section.name not in always:
            continue
        title, second = section.name.replace("_", " "), section.second
        if second is None:
            printer.table(title, [section.column], [[str(one)] for one in found])
        else:
            head, cell = second
            printer.table(title, [section.column, head], [[one.name, cell(one)] for one in found])
