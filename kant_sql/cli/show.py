"""`kant-sql show`: the whole state, now or at a moment of the past."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer

from ..canonical import time_text
from ..dto.name import ROOT_TYPE
from ..knowledge_base import KnowledgeBase
from .output import Printer, write_json
from .state import state_document
from .stores import Name, Url, open_state
from .times import At


def show(
    url: Url,
    kb: Name = None,
    at: At = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Write all that is known: objects, facts, goals and the rest."""
    with open_state(url, kb, at) as (name, state):
        committed_at = _committed_at(state)
        if as_json:
            header = {
                "knowledge_base": name,
                "revision": state.revision,
                "committed_at": committed_at,
            }
            write_json(header | state_document(state))
        else:
            printer = Printer()
            moment = committed_at or "before the first"
            printer.line(f"knowledge base {name}, revision {state.revision}, {moment}", "bold")
            write_state(printer, state)


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
