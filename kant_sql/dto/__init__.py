"""The data transfer objects: PDDL elements as plain data, one module for each."""

from __future__ import annotations

from .actions import PddlActionDto, PddlConditionEffectDto, PddlEventDto, PddlProcessDto
from .elements import (
    Dto,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)

__all__ = [
    "Dto",
    "PddlActionDto",
    "PddlConditionEffectDto",
    "PddlEitherTypeDto",
    "PddlEventDto",
    "PddlFunctionDto",
    "PddlFunctionValueDto",
    "PddlObjectDto",
    "PddlPredicateDto",
    "PddlProcessDto",
    "PddlPropositionDto",
    "PddlTypeDto",
]
