"""`kant-sql show`: a state or a part of it, now or in the past."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from decimal import Decimal
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from ..dto import PddlActionDto, PddlConditionEffectDto, PddlObjectDto, PddlTypeDto
from ..dto.actions import Duration
from ..dto.elements import NamedDto
from ..dto.formulas import Atom, Node
from ..dto.lexical import ROOT_TYPE, fold, number_text
from ..errors import UnknownNameError, UnknownRevisionError, printable
from ..knowledge.canonical import time_text
from ..pddl.cursor import hint
from ..pddl.lexer import tokenize
from .common import AsJson, At, CommandWords, Name, Valid, open_state, option, parse_optional
from .history import write_entry
from .output import Document, Printer, write_each, write_json

if TYPE_CHECKING:
    from ..knowledge_base import KnowledgeBase

# The elements of a state by the name of their section.
Elements = Mapping[str, Sequence[Any]]

_OnlyFacts = Annotated[bool, option("Show only facts.", "--facts")]
_OfPredicate = Annotated[
    str | None, option("Show only facts and goals of this predicate.", metavar="NAME")
]
_OfObject = Annotated[
    str | None, option("Show only elements that name this object.", "--object", metavar="NAME")
]
_OfType = Annotated[
    str | None,
    option(
        "Show only elements that name an object of this type or a subtype.",
        "--type",
        metavar="NAME",
    ),
]


_WORDS = CommandWords("[URL] [REV|TIME]", "sqlite:///robot.db 19")


def show(
    words: Annotated[
        list[str] | None,
        _WORDS.argument(
            "a revision, by its number or a time: who wrote it, when and why, and its changes. "
            "Its state: --at.",
        ),
    ] = None,
    kb: Name = None,
    at: At = None,
    valid: Valid = None,
    facts: _OnlyFacts = False,
    predicate: _OfPredicate = None,
    object_: _OfObject = None,
    type_: _OfType = None,
    as_json: AsJson = False,
) -> None:
    """Show a state, or what a revision changed.

    Several options select the elements that match all of them.
    """
    url, revisions = _WORDS.split(words)
    is_part = facts or not predicate is object_ is type_ is None
    if revisions:
        if is_part or at is not None or valid is not None:
            raise typer.BadParameter(
                "REV shows the changes of a revision, --at and its options show a state; give one",
                param_hint="REV|TIME",
            )
        _show_revision(url, kb, revisions[0], as_json)
        return
    then = parse_optional(valid, "--valid")
    valid = time_text(then) if isinstance(then, datetime) else valid
    with open_state(url, kb, at, valid) as (name, state):
        if is_part:
            objects = _find_objects(state, name, object_, type_)
            if predicate is not None:
                _find("predicate", predicate, state.predicates.get_all(), name)
            elements = _read_part(state, facts, predicate, objects)
        committed_at = _committed_at(state)
        if not is_part:
            elements = {section.name: section.elements(state) for section in _SECTIONS}
        if as_json:
            header = {"revision": state.revision, "committed_at": committed_at}
            write_json(_state_document(elements), knowledge_base=name, **header)
            return
        printer = Printer()
        moment = committed_at or "before the first"
        moment = moment if valid is None else f"{moment}, valid at {valid}"
        printer.line(f"knowledge base {name}, revision {state.revision}, {moment}", "bold")
        _write_state(printer, elements, _SHOWN_IN_PART if is_part else _SHOWN_IN_WHOLE)


def _show_revision(url: str, kb: str | None, when: str, as_json: bool) -> None:
    """Show a revision, or the last one at a time, as the log does."""
    with open_state(url, kb, when) as (name, state):
        if state.revision == 0:
            raise UnknownRevisionError(f"there was no revision of knowledge base {name!r} yet")
        write_each(state.log(state.revision), as_json, write_entry, is_spaced=True)


def _committed_at(state: KnowledgeBase) -> str | None:
    if state.revision == 0:
        return None
    (revision,) = state.store.revisions(after=state.revision - 1, limit=1)
    return time_text(revision.committed_at)


def _read_part(
    state: KnowledgeBase, only_facts: bool, predicate: str | None, objects: frozenset[str] | None
) -> Elements:
    """Read the elements that name the predicate and one of the objects, by their sections."""
    dao = state.propositions
    facts = dao.get_all() if predicate is None else dao.get_by_predicate(predicate)
    part: dict[str, Sequence[Any]] = {"objects": [], "facts": [], "function_values": []}
    part["facts"] = [one for one in facts if _names_one(one.objects, objects)]
    part["goals"] = []
    if only_facts:
        return part
    part["goals"] = [node for node in state.goals.get_all() if _mentions(node, predicate, objects)]
    if predicate is None:
        part["objects"] = [one for one in state.objects.get_all() if _names_one([one], objects)]
        values = state.function_values.get_all()
        part["function_values"] = [
            one for one in values if _names_one([*one.objects, one.value], objects)
        ]
    return part


def _names_one(parts: Iterable[object], objects: frozenset[str] | None) -> bool:
    dtos = (part for part in parts if isinstance(part, PddlObjectDto))
    return objects is None or any(fold(dto.name) in objects for dto in dtos)


def _mentions(node: Node, predicate: str | None, objects: frozenset[str] | None) -> bool:
    """Return whether a goal of any form contains the predicate and one of the objects."""
    words = set(tokenize(fold(str(node))))
    has_predicate = predicate is None or fold(predicate) in words
    return has_predicate and (objects is None or bool(words & objects))


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
        raise UnknownNameError(
            f"there is no {kind} {printable(name)!r} in knowledge base {kb!r} at this revision"
            f"{hint(name, list(names.values()))}"
        )
    return names[fold(name)]


def _document(*names: str, has_text: bool = True) -> Callable[[Any], Document]:
    """Convert an element to JSON data: some of its fields, and its text."""

    def write(dto: Any) -> Document:
        own = {name: _plain(getattr(dto, name)) for name in names}
        return own | ({"pddl": str(dto)} if has_text else {})

    return write


def _plain(value: object) -> object:
    """Convert a field: an element to its name, a number to text, which is exact everywhere."""
    if isinstance(value, list):
        return [*map(_plain, value)]
    if isinstance(value, NamedDto):
        return value.name
    if isinstance(value, Decimal):
        return number_text(value)
    return str(value) if isinstance(value, Node) else value


_node, _metric = _document(), _document("optimization", "expression")
_literal = _document("predicate", "objects", "time", "is_negative", has_text=False)


def _goal(node: Node) -> Document:
    if not isinstance(node, Atom):
        return _node(node)
    objects = [str(term) for term in node.terms]
    return {"predicate": node.predicate, "objects": objects, "pddl": str(node)}


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
    return _node(dto) if isinstance(dto, Node) else _literal(dto)


class ElementTable(NamedTuple):
    """A section of a state."""

    name: str  # in JSON and, with spaces, as the title of its table
    column: str  # the head of its first column
    document: Callable[[Any], object] = _node  # makes JSON data of an element
    # The head of a second column and the function that makes its cells; the first has the names.
    second: tuple[str, Callable[[Any], str]] | None = None
    # By default, the elements are those of the DAO of this name.
    read: Callable[[KnowledgeBase], Sequence[Any]] | None = None

    def elements(self, state: KnowledgeBase) -> Sequence[Any]:
        """Read its elements."""
        if self.read is not None:
            return self.read(state)
        of = state if hasattr(type(state), self.name) else state.pddl
        found: Sequence[Any] = getattr(of, self.name).get_all()
        return found


_SECTIONS = (
    ElementTable(
        "requirements", "requirement", str, read=lambda state: state.pddl.domain().requirements
    ),
    ElementTable(
        "types",
        "type",
        _document("name", "parent", has_text=False),
        ("parent", lambda dto: dto.parent.name if dto.parent else ROOT_TYPE),
    ),
    ElementTable(
        "objects",
        "object",
        _document("name", "type", "is_constant", has_text=False),
        ("type", lambda dto: dto.type.name),
    ),
    ElementTable("predicates", "predicate", _document("name", "types")),
    ElementTable("functions", "function", _document("name", "types", "value_types")),
    ElementTable("derived_predicates", "derived predicate"),
    ElementTable(
        "facts",
        "fact",
        _document("predicate", "objects"),
        read=lambda state: state.propositions.get_all(),
    ),
    ElementTable("function_values", "function value", _document("function", "objects", "value")),
    ElementTable("initial_literals", "initial literal"),
    ElementTable("timed_initial_literals", "timed initial literal"),
    ElementTable("goals", "goal", _goal),
    ElementTable("constraints", "constraint"),
    ElementTable("domain_constraints", "domain constraint"),
    ElementTable(
        "metric", "metric", _metric, read=lambda state: [*filter(None, [state.pddl.metric.get()])]
    ),
    ElementTable("actions", "action", _action),
    ElementTable("processes", "process", _action),
    ElementTable("events", "event", _action),
)
# Sections that people see even if they are empty.
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
