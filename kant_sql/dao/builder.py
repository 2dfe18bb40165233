"""From definitions to DTOs, sharing what is referred to within one result."""

from __future__ import annotations

from collections.abc import Iterable

from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..knowledge.action import ActionDefinition, LiteralDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.predicate import ParameterDefinition


class DtoBuilder:
    """Builds the DTOs of one result from the definitions that it was read with."""

    def __init__(self, definitions: Definitions) -> None:
        self._definitions = definitions
        self._types: dict[int, PddlTypeDto] = {}
        self._objects: dict[int, PddlObjectDto] = {}
        self._predicates: dict[int, PddlPredicateDto] = {}

    def type(self, id_: int) -> PddlTypeDto:
        """Build a type, with the types above it.

        Args:
            id_: the type's id.

        Returns:
            The DTO.
        """
        dto = self._types.get(id_)
        if dto is None:
            definition = self._definitions.types.live(id_)
            parent = definition.parent_id
            dto = PddlTypeDto(definition.name, parent=None if parent is None else self.type(parent))
            self._types[id_] = dto
        return dto

    def object(self, id_: int) -> PddlObjectDto:
        """Build an object.

        Args:
            id_: the object's id.

        Returns:
            The DTO.
        """
        dto = self._objects.get(id_)
        if dto is None:
            definition = self._definitions.objects.live(id_)
            dto = PddlObjectDto(self.type(definition.type_id), definition.name)
            self._objects[id_] = dto
        return dto

    def predicate(self, id_: int) -> PddlPredicateDto:
        """Build a predicate.

        Args:
            id_: the predicate's id.

        Returns:
            The DTO.
        """
        dto = self._predicates.get(id_)
        if dto is None:
            definition = self._definitions.predicates.live(id_)
            types = [self._parameter_type(parameter) for parameter in definition.parameters]
            dto = PddlPredicateDto(definition.name, types)
            self._predicates[id_] = dto
        return dto

    def proposition(self, predicate_id: int, arguments: str, is_goal: bool) -> PddlPropositionDto:
        """Build a proposition.

        Args:
            predicate_id: its predicate.
            arguments: the ids of its objects in order, separated by spaces.
            is_goal: whether it is a goal.

        Returns:
            The DTO.
        """
        objects = [self.object(int(id_)) for id_ in arguments.split()]
        return PddlPropositionDto(self.predicate(predicate_id), objects, bool(is_goal))

    def action(self, definition: ActionDefinition) -> PddlActionDto:
        """Build an action.

        Args:
            definition: the action.

        Returns:
            The DTO.
        """
        parameters = [
            PddlObjectDto(self._parameter_type(parameter), parameter.name)
            for parameter in definition.parameters
        ]
        dto = PddlActionDto(
            definition.name,
            parameters,
            self._literals(definition.conditions, parameters),
            self._literals(definition.effects, parameters),
            durative=definition.duration is not None,
        )
        if definition.duration is not None:
            text = definition.duration
            dto.duration = float(text) if "." in text else int(text)
        return dto

    def _literals(
        self, literals: Iterable[LiteralDefinition], parameters: list[PddlObjectDto]
    ) -> list[PddlConditionEffectDto]:
        return [
            PddlConditionEffectDto(
                self.predicate(literal.predicate_id),
                [
                    self.object(term.object_id)
                    if term.object_id is not None
                    else parameters[term.parameter or 0]
                    for term in literal.terms
                ],
                literal.time,
                literal.is_negative,
            )
            for literal in literals
        ]

    def _parameter_type(self, parameter: ParameterDefinition) -> PddlTypeDto:
        return self.type(parameter.type_ids[0])
