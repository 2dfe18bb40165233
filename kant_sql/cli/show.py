"""`kant-sql show`: the whole state, now or at a moment of the past."""

from __future__ import annotations

from typing import Annotated

import typer

from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.name import ROOT_TYPE
from ..knowledge_base import KnowledgeBase
from .output import Printer, time_text, write_json
from .stores import Name, Url, open_to_read, parse_when


def show(
    url: Url,
    kb: Name = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="REV|TIME",
            show_default=False,
            help="The revision's number, or a time in ISO 8601 (UTC without a zone).",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> None:
    """Write what is known: types, objects, predicates, facts, goals and actions."""
    when = None if at is None else parse_when(at)
    with open_to_read(url, kb) as (name, knowledge_base):
        # All is read at one revision, whatever is written meanwhile.
        state = knowledge_base.at(knowledge_base.revision if when is None else when)
        committed_at = _committed_at(knowledge_base, state.revision)
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


def state_document(state: KnowledgeBase) -> dict[str, list[dict[str, object]]]:
    """Give a state in the form that becomes JSON.

    Args:
        state: the knowledge base at a revision.

    Returns:
        The document.
    """
    return {
        "types": [_type(dto) for dto in state.types.get_all()],
        "objects": [_object(dto) for dto in state.objects.get_all()],
        "predicates": [_predicate(dto) for dto in state.predicates.get_all()],
        "facts": [_proposition(dto) for dto in state.propositions.get_no_goals()],
        "goals": [_proposition(dto) for dto in state.propositions.get_goals()],
        "actions": [_action(dto) for dto in state.actions.get_all()],
    }


def write_state(printer: Printer, state: KnowledgeBase) -> None:
    """Write a state for people.

    Args:
        printer: where to.
        state: the knowledge base at a revision.
    """
    types, objects, predicates = state.types, state.objects, state.predicates
    printer.table(
        "types",
        ["type", "parent"],
        [[dto.name, dto.parent.name if dto.parent else ROOT_TYPE] for dto in types.get_all()],
    )
    printer.table(
        "objects", ["object", "type"], [[dto.name, dto.type.name] for dto in objects.get_all()]
    )
    printer.table("predicates", ["predicate"], [[str(dto)] for dto in predicates.get_all()])
    propositions = state.propositions
    printer.table("facts", ["fact"], [[str(dto)] for dto in propositions.get_no_goals()])
    printer.table("goals", ["goal"], [[str(dto)] for dto in propositions.get_goals()])
    printer.table("actions", ["action"], [[str(dto)] for dto in state.actions.get_all()])


def _committed_at(knowledge_base: KnowledgeBase, number: int) -> str | None:
    if number == 0:
        return None
    (revision,) = knowledge_base.revisions(after=number - 1, limit=1)
    return time_text(revision.committed_at)


def _type(dto: PddlTypeDto) -> dict[str, object]:
    return {"name": dto.name, "parent": dto.parent.name if dto.parent else None}


def _object(dto: PddlObjectDto) -> dict[str, object]:
    return {"name": dto.name, "type": dto.type.name}


def _predicate(dto: PddlPredicateDto) -> dict[str, object]:
    return {"name": dto.name, "types": [type_.name for type_ in dto.types], "pddl": str(dto)}


def _proposition(dto: PddlPropositionDto) -> dict[str, object]:
    return {
        "predicate": dto.predicate.name,
        "objects": [object_.name for object_ in dto.objects],
        "pddl": str(dto),
    }


def _action(dto: PddlActionDto) -> dict[str, object]:
    return {
        "name": dto.name,
        "parameters": [_object(parameter) for parameter in dto.parameters],
        "conditions": [_literal(literal) for literal in dto.conditions],
        "effects": [_literal(literal) for literal in dto.effects],
        "durative": dto.durative,
        "duration": dto.duration if dto.durative else None,
        "pddl": str(dto),
    }


def _literal(dto: PddlConditionEffectDto) -> dict[str, object]:
    return {
        "predicate": dto.predicate.name,
        "objects": [object_.name for object_ in dto.objects],
        "time": dto.time,
        "is_negative": dto.is_negative,
    }
