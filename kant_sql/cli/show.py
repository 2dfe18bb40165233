"""`kant-sql show`: the whole state, now or at a moment of the past."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated

import typer

from ..canonical import time_text
from ..dto import PddlTypeDto
from ..dto.dto import NamedDto
from ..dto.name import ROOT_TYPE, fold
from ..errors import KantSqlError
from ..knowledge_base import KnowledgeBase
from ..pddl.cursor import hint
from .output import AsJson, Printer, printable, write_json
from .state import Part, Wanted, part_document, state_document, wanted_part
from .stores import Name, Url, open_state
from .times import At


def show(
    url: Url,
    kb: Name = None,
    at: At = None,
    facts: Annotated[bool, typer.Option("--facts", help="Only the facts.")] = False,
    predicate: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", show_default=False, help="Only facts and goals of this predicate."
        ),
    ] = None,
    object_: Annotated[
        str | None,
        typer.Option(
            "--object", metavar="NAME", show_default=False, help="Only what names this object."
        ),
    ] = None,
    type_: Annotated[
        str | None,
        typer.Option(
            "--type",
            metavar="NAME",
            show_default=False,
            help="Only what names an object of this type, or of a subtype.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write all that is known: objects, facts, goals and the rest.

    With several options, only what all of them apply to.
    """
    with open_state(url, kb, at) as (name, state):
        part = None
        if facts or not predicate is object_ is type_ is None:
            objects = _objects(state, name, object_, type_)
            if predicate is not None:
                _find("predicate", predicate, state.predicates.get_all(), name)
            part = wanted_part(state, Wanted(facts, predicate, objects))
        committed_at = _committed_at(state)
        if as_json:
            header = {
                "knowledge_base": name,
                "revision": state.revision,
                "committed_at": committed_at,
            }
            document = state_document(state) if part is None else part_document(part)
            write_json(header | document)
        else:
            printer = Printer()
            moment = committed_at or "before the first"
            printer.line(f"knowledge base {name}, revision {state.revision}, {moment}", "bold")
            if part is None:
                write_state(printer, state)
            else:
                write_part(printer, part)


def _objects(
    state: KnowledgeBase, kb: str, object_: str | None, type_: str | None
) -> frozenset[str] | None:
    """Find the objects that are meant by name, type or both; None for all."""
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
    """Find a name in the spelling that is stored; raise when there is none."""
    names = {fold(dto.name): dto.name for dto in dtos}
    if fold(name) not in names:
        raise KantSqlError(
            f"there is no {kind} {printable(name)!r} in knowledge base {kb!r} at this revision"
            f"{hint(name, list(names.values()))}"
        )
    return names[fold(name)]


def write_part(printer: Printer, part: Part) -> None:
    """Write a part of a state for people.

    Args:
        printer: where to.
        part: the part.
    """
    objects = [[dto.name, dto.type.name] for dto in part.objects]
    if objects:
        printer.table("objects", ["object", "type"], objects)
    _write(printer, "facts", "fact", part.facts)
    _write_some(printer, "function values", "function value", part.function_values)
    _write_some(printer, "goals", "goal", part.goals)


def write_state(printer: Printer, state: KnowledgeBase) -> None:
    """Write a state for people. What not every domain has is left out when there is none.

    Args:
        printer: where to.
        state: the knowledge base at a revision.
    """
    types, objects = state.types.get_all(), state.objects.get_all()
    _write_some(printer, "requirements", "requirement", state.domain().requirements)
    printer.table(
        "types",
        ["type", "parent"],
        [[dto.name, dto.parent.name if dto.parent else ROOT_TYPE] for dto in types],
    )
    printer.table("objects", ["object", "type"], [[dto.name, dto.type.name] for dto in objects])
    _write(printer, "predicates", "predicate", state.predicates.get_all())
    _write_some(printer, "functions", "function", state.functions.get_all())
    _write_some(
        printer, "derived predicates", "derived predicate", state.derived_predicates.get_all()
    )
    _write(printer, "facts", "fact", state.propositions.get_no_goals())
    _write_some(printer, "function values", "function value", state.function_values.get_all())
    _write_some(printer, "initial literals", "initial literal", state.initial_literals.get_all())
    _write_some(
        printer,
        "timed initial literals",
        "timed initial literal",
        state.timed_initial_literals.get_all(),
    )
    _write(printer, "goals", "goal", state.goals.get_all())
    _write_some(printer, "constraints", "constraint", state.constraints.get_all())
    _write_some(
        printer, "domain constraints", "domain constraint", state.domain_constraints.get_all()
    )
    metric = state.metric.get()
    _write_some(printer, "metric", "metric", [] if metric is None else [metric])
    _write(printer, "actions", "action", state.actions.get_all())
    _write_some(printer, "processes", "process", state.processes.get_all())
    _write_some(printer, "events", "event", state.events.get_all())


def _write(printer: Printer, title: str, column: str, elements: Iterable[object]) -> None:
    """Write elements as PDDL, in a table of one column."""
    printer.table(title, [column], [[str(element)] for element in elements])


def _write_some(printer: Printer, title: str, column: str, elements: Iterable[object]) -> None:
    """Write elements, if there are any."""
    found = list(elements)
    if found:
        _write(printer, title, column, found)


def _committed_at(state: KnowledgeBase) -> str | None:
    if state.revision == 0:
        return None
    (revision,) = state.revisions(after=state.revision - 1, limit=1)
    return time_text(revision.committed_at)
