"""A state in the form that becomes JSON."""

from __future__ import annotations

from decimal import Decimal

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
from ..dto.number import number_text
from ..dto.pddl_action_dto import Duration
from ..knowledge_base import KnowledgeBase

Document = dict[str, object]


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
