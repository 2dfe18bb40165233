"""Actions: the DAO, and the rules that an action must keep."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import ClassVar

from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from ..dto.name import check_name, fold
from ..dto.pddl_action_dto import action_text, number_text
from ..dto.pddl_condition_effect_dto import literal_text
from ..errors import ArityError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge.action import TIMES, ActionDefinition, LiteralDefinition, Term
from ..knowledge.predicate import ParameterDefinition
from ..transaction import Transaction
from .base import expect, expect_list
from .builder import DtoBuilder
from .interfaces import PddlActionDao
from .named import SqlNamedDao
from .object import check_object
from .predicate import ensure_predicate
from .type import ensure_type


class ActionReader:
    """Checks one action's DTO and makes its definition."""

    def __init__(self, transaction: Transaction, dto: PddlActionDto) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._dto = dto
        self._role = f"action {dto.name!r}"
        self._positions: dict[str, int] = {}
        self._parameters: list[ParameterDefinition] = []

    def read(self) -> ActionDefinition:
        """Check the action, and save what it refers to when it is missing.

        Returns:
            The definition.

        Raises:
            InvalidKnowledgeError: a rule is broken; the message says which and where.
            ConflictError: it refers to something that is stored with another definition.
        """
        dto = self._dto
        check_name("action", dto.name)
        duration = self._duration()
        for parameter in expect_list(dto.parameters, PddlObjectDto, self._part("parameters")):
            self._add_parameter(parameter)
        conditions = self._literals("condition", dto.conditions)
        effects = self._literals("effect", dto.effects)
        stored = self._definitions.actions.named(dto.name)
        id_, name = (
            (stored.id, stored.name) if stored else self._transaction.intern("action", dto.name)
        )
        types = self._definitions.types
        text = action_text(
            name,
            [(part.name, types.live(part.type_ids[0]).name) for part in self._parameters],
            map(self._literal_text, conditions),
            map(self._literal_text, effects),
            duration,
        )
        return ActionDefinition(
            id_, name, tuple(self._parameters), conditions, effects, duration, text
        )

    def _part(self, part: str) -> str:
        return f"the list of {part} of {self._role}"

    def _duration(self) -> str | None:
        duration = self._dto.duration
        if not self._dto.durative:
            return None
        if isinstance(duration, bool) or not isinstance(duration, int | float):
            raise InvalidKnowledgeError(
                f"{self._role}: the duration is {duration!r:.80}, expected a number of 0 or more"
            )
        if not 0 <= duration <= sys.float_info.max:
            # In words: Python itself refuses to print an integer of thousands of digits.
            shown = "too large" if duration > 0 else "negative" if duration < 0 else "nan"
            raise InvalidKnowledgeError(
                f"{self._role}: the duration is {shown}, expected a number of 0 or more"
            )
        return number_text(duration)

    def _add_parameter(self, dto: PddlObjectDto) -> None:
        check_name("parameter", dto.name)
        key = fold(dto.name)
        if key in self._positions:
            raise InvalidKnowledgeError(
                f"{self._role} has two parameters of the name ?{dto.name}; rename one"
            )
        type_ = ensure_type(self._transaction, dto.type, f"parameter ?{dto.name} of {self._role}")
        self._positions[key] = len(self._parameters)
        self._parameters.append(ParameterDefinition(dto.name, (type_.id,)))

    def _literals(
        self, section: str, dtos: Iterable[PddlConditionEffectDto]
    ) -> tuple[LiteralDefinition, ...]:
        expect_list(dtos, PddlConditionEffectDto, self._part(f"{section}s"))
        return tuple(
            self._literal(dto, f"{section} {number} of {self._role}")
            for number, dto in enumerate(dtos, start=1)
        )

    def _literal(self, dto: PddlConditionEffectDto, role: str) -> LiteralDefinition:
        expect(dto.predicate, PddlPredicateDto, f"the predicate of {role}")
        expect_list(dto.objects, PddlObjectDto, f"the list of objects of {role}")
        self._check_time(dto, role)
        predicate = ensure_predicate(self._transaction, dto.predicate, role)
        if len(dto.objects) != len(predicate.parameters):
            raise ArityError(
                f"{role}: {dto} has {len(dto.objects)} terms, expected "
                f"{len(predicate.parameters)} as in {predicate.text}"
            )
        terms = []
        for number, (object_, wanted) in enumerate(
            zip(dto.objects, predicate.parameters, strict=True), start=1
        ):
            term, type_id = self._term(object_, f"term {number} of {role}")
            if not self._definitions.fits(type_id, wanted.type_ids):
                raise TypeMismatchError(
                    f"{role}: term {number} of {dto}, {object_.name!r}, is of type "
                    f"{self._definitions.types.live(type_id).name!r}, expected "
                    f"{self._definitions.types.live(wanted.type_ids[0]).name!r} or a subtype, as "
                    f"in {predicate.text}"
                )
            terms.append(term)
        time = dto.time if self._dto.durative else None
        return LiteralDefinition(predicate.id, tuple(terms), time, bool(dto.is_negative))

    def _check_time(self, dto: PddlConditionEffectDto, role: str) -> None:
        # The original library's programs write no time as an empty text.
        if not self._dto.durative and dto.time not in (None, ""):
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {dto.time!r}, but the action is not durative; "
                "leave the time out"
            )
        if self._dto.durative and dto.time not in TIMES:
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {dto.time!r}, expected one of "
                f"{', '.join(map(repr, TIMES))}, for the action is durative"
            )

    def _term(self, dto: PddlObjectDto, role: str) -> tuple[Term, int]:
        """Find what a term denotes: a parameter first, else an object that is known."""
        expect(dto.type, PddlTypeDto, f"the type of {role}")
        position = self._positions.get(fold(dto.name))
        if position is not None:
            type_id = self._parameters[position].type_ids[0]
            type_ = self._definitions.types.live(type_id)
            if fold(dto.type.name) != fold(type_.name):
                raise TypeMismatchError(
                    f"{role}: ?{dto.name} is given the type {dto.type.name!r}, but the parameter "
                    f"of this name has {type_.name!r}"
                )
            ensure_type(self._transaction, dto.type, role)
            return Term(position, None), type_id
        constant = self._definitions.objects.named(dto.name)
        if constant is None:
            raise InvalidKnowledgeError(
                f"{role}: {dto.name!r} is neither a parameter of the action nor an object that is "
                "known; add the parameter, or save the object first"
            )
        check_object(self._transaction, dto, constant, role)
        return Term(None, constant.id), constant.type_id

    def _literal_text(self, literal: LiteralDefinition) -> str:
        terms = [
            f"?{self._parameters[term.parameter].name}"
            if term.parameter is not None
            else self._definitions.objects.live(term.object_id or 0).name
            for term in literal.terms
        ]
        predicate = self._definitions.predicates.live(literal.predicate_id)
        return literal_text(predicate.name, terms, literal.time, literal.is_negative)


class SqlActionDao(SqlNamedDao[PddlActionDto], PddlActionDao):
    """Actions in an SQL store."""

    kind: ClassVar[str] = "action"
    dto_class = PddlActionDto

    def _build(self, builder: DtoBuilder, definition: ActionDefinition) -> PddlActionDto:
        return builder.action(definition)

    def _put(self, transaction: Transaction, dto: PddlActionDto, cascade: bool) -> bool:
        return transaction.define("action", ActionReader(transaction, dto).read())

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        for id_ in ids:
            transaction.undefine("action", id_)
