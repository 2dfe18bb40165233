"""The data transfer objects: PDDL elements as plain data, one module for each."""

from __future__ import annotations

from .dto import Dto
from .pddl_action_dto import PddlActionDto, PddlEventDto, PddlProcessDto
from .pddl_condition_effect_dto import PddlConditionEffectDto
from .pddl_either_type_dto import PddlEitherTypeDto
from .pddl_function_dto import PddlFunctionDto
from .pddl_function_value_dto import PddlFunctionValueDto
from .pddl_object_dto import PddlObjectDto
from .pddl_predicate_dto import PddlPredicateDto
from .pddl_proposition_dto import PddlPropositionDto
from .pddl_type_dto import PddlTypeDto

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
