"""The parts of a knowledge base by paths such as `pddl.metric`; parts of documents as DTOs."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from functools import cached_property
from operator import attrgetter
from typing import Any

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlEitherTypeDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlTypeDto,
)
from kant_sql.knowledge_base import Operations, PddlParts
from kant_sql.pddl import Action, Function, Predicate

# The classes of objects behind attributes.
FRONTS: dict[str, type] = {"": KnowledgeBase, "pddl": PddlParts, "store": Operations}


def _daos() -> Iterator[tuple[str, type]]:
    for front, cls in FRONTS.items():
        for name, member in vars(cls).items():
            if isinstance(member, cached_property) and name not in FRONTS:
                yield f"{front}.{name}".lstrip("."), typing.get_type_hints(member.func)["return"]


DAOS = dict(_daos())
# All objects with methods to call.
PATHS = [*FRONTS, *DAOS]


def part(of: Any, path: str) -> Any:
    """Return the part of a knowledge base, or of an asynchronous one, at a path."""
    return attrgetter(path)(of) if path else of


def dao_of(kb: Any, name: str) -> Any:
    """Return the DAO with a name, even of a rarer part of PDDL."""
    return getattr(kb if hasattr(kb, name) else kb.pddl, name)


def type_dto(types: tuple[str, ...]) -> PddlTypeDto:
    made = [PddlTypeDto(name) for name in types]
    return made[0] if len(made) == 1 else PddlEitherTypeDto(made)


def predicate_dto(predicate: Predicate) -> PddlPredicateDto:
    types = [type_dto(part.types) for part in predicate.parameters]
    names = [part.name for part in predicate.parameters]
    return PddlPredicateDto(predicate.name, types, parameter_names=names)


def function_dto(function: Function) -> PddlFunctionDto:
    types = [type_dto(part.types) for part in function.parameters]
    values, names = map(PddlTypeDto, function.types), [part.name for part in function.parameters]
    return PddlFunctionDto(function.name, types, value_types=values, parameter_names=names)


def action_dto(action: Action) -> PddlActionDto:
    parameters = [PddlObjectDto(type_dto(part.types), part.name) for part in action.parameters]
    parts = (action.name, parameters, action.condition, action.effect)
    if action.kind in ("process", "event"):
        return (PddlProcessDto if action.kind == "process" else PddlEventDto)(*parts)
    dto = PddlActionDto(*parts, durative=action.kind == "durative-action")
    if dto.durative:
        dto.duration = list(action.duration)
    return dto
