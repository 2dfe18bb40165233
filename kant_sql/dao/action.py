"""Actions, processes and events: the DAOs, and the rules that an action must keep."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from decimal import Decimal
from typing import ClassVar, TypeVar

from ..arguments import expect, expect_list, flag, shown
from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEventDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlTypeDto,
)
from ..dto.formula import TIMES, Atom, Comparison, Constant, Node, Not, Number, Timed, Variable
from ..dto.name import check_name, fold
from ..dto.number import number_text
from ..dto.pddl_action_dto import action_text, duration_text
from ..errors import ArityError, ConflictError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge.action import ActionDefinition
from ..knowledge.predicate import ParameterDefinition
from ..knowledge.tree_reader import TreeReader, typed_name
from ..pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS
from ..pddl.node_text import node_text
from ..transaction import Transaction
from .action_trees import Trees, action_trees
from .builder import DtoBuilder
from .interfaces import PddlActionDao, PddlEventDao, PddlProcessDao
from .named import SqlNamedDao
from .object import check_object
from .predicate import ensure_predicate
from .type import ensure_type, ensure_types

A = TypeVar("A", bound=PddlActionDto)


def put_action(
    transaction: Transaction,
    keyword: str,
    name: str,
    parameters: tuple[ParameterDefinition, ...],
    parts: Trees,
) -> bool:
    """Define an action, a process or an event.

    Args:
        transaction: the transaction.
        keyword: what it is.
        name: its name.
        parameters: its parameters.
        parts: duration, condition and effect.

    Returns:
        Whether that is a change.

    Raises:
        InvalidNameError: PDDL text could not carry the name.
        ConflictError: the name is one of another kind of action.
    """
    check_name("action", name)
    definitions = transaction.definitions
    stored = definitions.actions.named(name)
    if stored is not None and _family(stored.kind) != _family(keyword):
        raise ConflictError(
            f"{stored.name!r} is a stored {stored.kind}, so it cannot name a {keyword} as well; "
            "delete that first, or choose another name"
        )
    id_, name = (stored.id, stored.name) if stored else transaction.intern("action", name)
    duration, condition, effect = (
        TreeReader(definitions, tree, parameters).conjuncts() for tree in parts
    )
    named = (typed_name(definitions, parameter) for parameter in parameters)
    text = action_text(
        keyword,
        name,
        [(part.name, part.type_text) for part in named],
        duration_text(duration),
        map(node_text, condition),
        map(node_text, effect),
    )
    definition = ActionDefinition(id_, name, keyword, parameters, *parts, text)
    return transaction.define("action", definition)


def _family(kind: str) -> str:
    return "action" if kind.endswith("action") else kind


class ActionReader:
    """Checks one action's DTO and defines it."""

    def __init__(self, transaction: Transaction, dto: PddlActionDto) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._dto = dto
        self._role = f"{dto.keyword.rpartition('-')[2]} {dto.name!r}"
        self._positions: dict[str, int] = {}
        self._parameters: list[ParameterDefinition] = []

    def put(self) -> bool:
        """Check the action, and save it and what it refers to when that is missing.

        Returns:
            Whether that is a change.

        Raises:
            InvalidKnowledgeError: a rule is broken; the message says which and where.
            ConflictError: it refers to something that is stored with another definition.
        """
        dto = self._dto
        check_name("action", dto.name)
        durative = flag(dto.durative, f"durative of {self._role}")
        duration = self._duration() if durative else ()
        for parameter in expect_list(dto.parameters, PddlObjectDto, self._part("parameters")):
            self._add_parameter(parameter)
        condition = self._formulas("condition", dto.conditions)
        effect = self._formulas("effect", dto.effects)
        parameters = tuple(self._parameters)
        parts = action_trees(
            self._transaction, dto.keyword, dto.name, parameters, duration, condition, effect
        )
        return put_action(self._transaction, dto.keyword, dto.name, parameters, parts)

    def _part(self, part: str) -> str:
        return f"the list of {part} of {self._role}"

    def _duration(self) -> tuple[Node, ...]:
        duration = self._dto.duration
        if isinstance(duration, list | tuple) and all(isinstance(part, Node) for part in duration):
            return tuple(duration)
        if isinstance(duration, bool) or not isinstance(duration, int | float | Decimal):
            raise InvalidKnowledgeError(
                f"{self._role}: the duration is {shown(duration)}, expected a number of 0 or more"
            )
        if not 0 <= duration <= sys.float_info.max:
            # In words: Python itself refuses to print an integer of thousands of digits.
            fault = "too large" if duration > 0 else "negative" if duration < 0 else "nan"
            raise InvalidKnowledgeError(
                f"{self._role}: the duration is {fault}, expected a number of 0 or more"
            )
        number = Number(Decimal(number_text(duration)))
        return (Comparison("=", Variable("duration"), number),)

    def _add_parameter(self, dto: PddlObjectDto) -> None:
        check_name("parameter", dto.name)
        key = fold(dto.name)
        if key in self._positions:
            raise InvalidKnowledgeError(
                f"{self._role} has two parameters of the name ?{dto.name}; rename one"
            )
        role = f"parameter ?{dto.name} of {self._role}"
        types = ensure_types(self._transaction, dto.type, role)
        self._positions[key] = len(self._parameters)
        self._parameters.append(ParameterDefinition(dto.name, types))

    def _formulas(self, section: str, parts: Iterable[PddlConditionEffectDto | Node]) -> list[Node]:
        expect_list(parts, (PddlConditionEffectDto, Node), self._part(f"{section}s"))
        return [
            part
            if isinstance(part, Node)
            else self._literal(part, f"{section} {number} of {self._role}")
            for number, part in enumerate(parts, start=1)
        ]

    def _literal(self, dto: PddlConditionEffectDto, role: str) -> Node:
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
            term, type_ids = self._term(object_, f"term {number} of {role}")
            if not self._definitions.any_fits(type_ids, wanted.type_ids):
                types = self._definitions.types
                raise TypeMismatchError(
                    f"{role}: term {number} of {dto}, {object_.name!r}, is of type "
                    f"{types.live(type_ids[0]).name!r}, expected "
                    f"{types.live(wanted.type_ids[0]).name!r} or a subtype, as in {predicate.text}"
                )
            terms.append(term)
        atom = Atom(predicate.name, tuple(terms))
        literal = Not(atom) if flag(dto.is_negative, f"is_negative of {role}") else atom
        return Timed(dto.time, literal) if self._dto.durative and dto.time else literal

    def _check_time(self, dto: PddlConditionEffectDto, role: str) -> None:
        # The original library's programs write no time as an empty text.
        if not self._dto.durative and dto.time not in (None, ""):
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {shown(dto.time)}, but the action is not durative; "
                "leave the time out"
            )
        if self._dto.durative and dto.time not in TIMES:
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {shown(dto.time)}, expected one of "
                f"{', '.join(map(repr, TIMES))}, for the action is durative"
            )

    def _term(self, dto: PddlObjectDto, role: str) -> tuple[Variable | Constant, tuple[int, ...]]:
        """Find what a term denotes: a parameter first, else an object that is known."""
        expect(dto.type, PddlTypeDto, f"the type of {role}")
        position = self._positions.get(fold(dto.name))
        if position is not None:
            parameter = self._parameters[position]
            type_text = typed_name(self._definitions, parameter).type_text
            if fold(dto.type.name) != fold(type_text):
                raise TypeMismatchError(
                    f"{role}: ?{dto.name} is given the type {dto.type.name!r}, but the parameter "
                    f"of this name has {type_text!r}"
                )
            if len(parameter.type_ids) == 1:
                ensure_type(self._transaction, dto.type, role)
            return Variable(parameter.name), parameter.type_ids
        constant = self._definitions.objects.named(dto.name)
        if constant is None:
            raise InvalidKnowledgeError(
                f"{role}: {dto.name!r} is neither a parameter of the action nor an object that is "
                "known; add the parameter, or save the object first"
            )
        check_object(self._transaction, dto, constant, role)
        return Constant(constant.name), constant.type_ids


class _SqlActionDao(SqlNamedDao[A]):
    kind: ClassVar[str] = "action"
    keywords: ClassVar[tuple[str, ...]]

    def _is_mine(self, definition: ActionDefinition) -> bool:
        return definition.kind in self.keywords

    def _check(self, dto: A) -> None:
        super()._check(dto)
        if dto.keyword not in self.keywords:
            raise InvalidKnowledgeError(
                f"{dto.name!r} is a {dto.keyword}, which has a DAO of its own; save it there"
            )

    def _build(self, builder: DtoBuilder, definition: ActionDefinition) -> A:
        dto = builder.action(definition)
        assert isinstance(dto, self.dto_class)
        return dto

    def _put(self, transaction: Transaction, dto: A, cascade: bool) -> bool:
        return ActionReader(transaction, dto).put()

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        for id_ in ids:
            transaction.undefine("action", id_)


class SqlActionDao(_SqlActionDao[PddlActionDto], PddlActionDao):
    """Actions in an SQL store."""

    dto_class = PddlActionDto
    keywords = (ACTION, DURATIVE_ACTION)


class SqlProcessDao(_SqlActionDao[PddlProcessDto], PddlProcessDao):
    """Processes in an SQL store."""

    dto_class = PddlProcessDto
    keywords = (PROCESS,)


class SqlEventDao(_SqlActionDao[PddlEventDto], PddlEventDao):
    """Events in an SQL store."""

    dto_class = PddlEventDto
    keywords = (EVENT,)
