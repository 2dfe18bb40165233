"""A state in the form that becomes JSON, and what of it is wanted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import NamedTuple

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
from ..dto.formula import Atom, Metric, Node
from ..dto.name import fold
from ..dto.number import number_text
from ..dto.pddl_action_dto import Duration
from ..knowledge_base import KnowledgeBase
from ..pddl.tokens import tokenize

Document = dict[str, object]


class Wanted(NamedTuple):
    """What of a state is wanted: the elements that all of these conditions apply to.

    Attributes:
        facts: only facts.
        predicate: the name of the predicate of facts and goals.
        objects: the names of objects, folded, of which an element names one; None for any.
    """

    facts: bool = False
    predicate: str | None = None
    objects: frozenset[str] | None = None


class Part(NamedTuple):
    """What is wanted of a state, by the sections that can answer.

    Attributes:
        objects: the objects.
        facts: the facts.
        function_values: the values of functions.
        goals: the goals.
    """

    objects: list[PddlObjectDto]
    facts: list[PddlPropositionDto]
    function_values: list[PddlFunctionValueDto]
    goals: Sequence[Node]


def wanted_part(state: KnowledgeBase, wanted: Wanted) -> Part:
    """Read what is wanted of a state.

    Args:
        state: the knowledge base at a revision.
        wanted: the conditions.

    Returns:
        The part.
    """
    dao, name = state.propositions, wanted.predicate
    atoms = dao.get_no_goals() if name is None else dao.get_by_predicate(name)
    facts = [dto for dto in atoms if not dto.is_goal and _names_one(dto.objects, wanted.objects)]
    if wanted.facts:
        return Part([], facts, [], [])
    goals = [node for node in state.goals.get_all() if _mentions(node, wanted)]
    if name is not None:
        return Part([], facts, [], goals)
    return Part(
        [dto for dto in state.objects.get_all() if _names_one([dto], wanted.objects)],
        facts,
        [dto for dto in state.function_values.get_all() if _has_object(dto, wanted.objects)],
        goals,
    )


def part_document(part: Part) -> Document:
    """Give a part of a state in the form that becomes JSON: its sections as `state_document` does.

    Args:
        part: the part.

    Returns:
        The document.
    """
    return {
        "objects": [_object(dto) for dto in part.objects],
        "facts": [_proposition(dto) for dto in part.facts],
        "function_values": [_value(dto) for dto in part.function_values],
        "goals": [_goal(node) for node in part.goals],
    }


def _names_one(dtos: Iterable[PddlObjectDto], objects: frozenset[str] | None) -> bool:
    return objects is None or any(fold(dto.name) in objects for dto in dtos)


def _has_object(dto: PddlFunctionValueDto, objects: frozenset[str] | None) -> bool:
    value = [dto.value] if isinstance(dto.value, PddlObjectDto) else []
    return _names_one([*dto.objects, *value], objects)


def _mentions(node: Node, wanted: Wanted) -> bool:
    """Tell whether a goal of any form has the predicate and one of the objects in it."""
    words = set(tokenize(fold(str(node))))
    has_predicate = wanted.predicate is None or fold(wanted.predicate) in words
    return has_predicate and (wanted.objects is None or bool(words & wanted.objects))


def state_document(state: KnowledgeBase) -> Document:
    """Give a state in the form that becomes JSON.

    Args:
        state: the knowledge base at a revision.

    Returns:
        The document.
    """
    return {
        "requirements": list(state.domain().requirements),
        "types": [_type(dto) for dto in state.types.get_all()],
        "objects": [_object(dto) for dto in state.objects.get_all()],
        "predicates": [_predicate(dto) for dto in state.predicates.get_all()],
        "functions": [_function(dto) for dto in state.functions.get_all()],
        "derived_predicates": [_node(node) for node in state.derived_predicates.get_all()],
        "facts": [_proposition(dto) for dto in state.propositions.get_no_goals()],
        "function_values": [_value(dto) for dto in state.function_values.get_all()],
        "initial_literals": [_node(node) for node in state.initial_literals.get_all()],
        "timed_initial_literals": [_node(node) for node in state.timed_initial_literals.get_all()],
        "goals": [_goal(node) for node in state.goals.get_all()],
        "constraints": [_node(node) for node in state.constraints.get_all()],
        "domain_constraints": [_node(node) for node in state.domain_constraints.get_all()],
        "metric": _metric(state.metric.get()),
        "actions": [_action(dto) for dto in state.actions.get_all()],
        "processes": [_action(dto) for dto in state.processes.get_all()],
        "events": [_action(dto) for dto in state.events.get_all()],
    }


def _type(dto: PddlTypeDto) -> Document:
    return {"name": dto.name, "parent": dto.parent.name if dto.parent else None}


def _object(dto: PddlObjectDto) -> Document:
    return {"name": dto.name, "type": dto.type.name, "is_constant": dto.is_constant}


def _parameter(dto: PddlObjectDto) -> Document:
    return {"name": dto.name, "type": dto.type.name}


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


def _value(dto: PddlFunctionValueDto) -> Document:
    value = dto.value
    return {
        "function": dto.function.name,
        "objects": [object_.name for object_ in dto.objects],
        # A number as text is exact, in every reader of JSON.
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


def _metric(metric: Metric | None) -> Document | None:
    if metric is None:
        return None
    return {
        "optimization": metric.optimization,
        "expression": str(metric.expression),
        "pddl": str(metric),
    }


def _action(dto: PddlActionDto) -> Document:
    return {
        "name": dto.name,
        "parameters": [_parameter(parameter) for parameter in dto.parameters],
        "conditions": [_part(part) for part in dto.conditions],
        "effects": [_part(part) for part in dto.effects],
        "durative": dto.durative,
        "duration": _duration(dto.duration) if dto.durative else None,
        "pddl": str(dto),
    }


def _duration(duration: Duration) -> object:
    if isinstance(duration, int | float):
        return duration
    return str(duration) if isinstance(duration, Decimal) else [str(part) for part in duration]


def _part(dto: PddlConditionEffectDto | Node) -> Document:
    if isinstance(dto, Node):
        return _node(dto)
    return {
        "predicate": dto.predicate.name,
        "objects": [object_.name for object_ in dto.objects],
        "time": dto.time,
        "is_negative": dto.is_negative,
    }
