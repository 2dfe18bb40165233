"""Actions, processes and events: the DAOs, their trees, and the checks of an action."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Any, ClassVar, TypeVar

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
from ..dto.actions import action_text, duration_text
from ..dto.formulas import (
    AT_END,
    AT_START,
    TIMES,
    And,
    Atom,
    Comparison,
    Constant,
    Node,
    Not,
    Number,
    Timed,
    TypedName,
    Variable,
)
from ..dto.lexical import check_name, fold, number_text, with_article
from ..errors import ArityError, ConflictError, InvalidKnowledgeError, TypeMismatchError
from ..knowledge.canonical import with_text
from ..knowledge.definitions import ActionDefinition
from ..knowledge.formulas import typed_name
from ..knowledge.trees import ParameterDefinition, Tree
from ..pddl.document import ACTION, DURATIVE_ACTION, EVENT, PROCESS
from ..pddl.formulas import flatten
from ..pddl.given import read_action
from ..store.transaction import Transaction
from .base import SqlNamedDao, identify
from .formula import refuse_others, tree_writer
from .interfaces import PddlActionDao, PddlEventDao, PddlProcessDao
from .signatures import PREDICATES
from .text import read_text
from .type import OBJECTS, TYPES, ensure_types

Trees = tuple[Tree, Tree, Tree]
# The duration, the conditions and the effects.
Parts = tuple[Sequence[Node], Sequence[Node], Sequence[Node]]


def read_parts(
    transaction: Transaction, kind: str, name: str, parameters: Sequence[TypedName], parts: Parts
) -> Parts:
    """Read the formulas of an action from its text, which the PDDL reader checks."""
    duration, condition, effect = map(_conjuncts, parts)
    typed = [(one.name, one.type_text) for one in parameters]
    conditions, effects = map(str, condition), map(str, effect)
    text = action_text(kind, name, typed, duration_text(duration), conditions, effects)
    read: Any = read_text(transaction, read_action, text)
    found = (read.duration if read.durative else [], read.conditions, read.effects)
    for given, part in zip((duration, condition, effect), found, strict=True):
        refuse_others(And(tuple(given)), And(tuple(part)))
    return found


def _conjuncts(formulas: Iterable[Any]) -> list[Any]:
    return [one for formula in formulas for one in flatten(formula)]


def action_trees(
    transaction: Transaction, parameters: Sequence[ParameterDefinition], parts: Parts
) -> Trees:
    """Make the trees of an action with checked formulas."""
    write = tree_writer(transaction, parameters).tree
    duration, condition, effect = [And(tuple(_conjuncts(part))) for part in parts]
    limit = duration.formulas[0] if len(duration.formulas) == 1 else duration
    return write(limit) if duration.formulas else (), write(condition), write(effect)


A = TypeVar("A", bound=PddlActionDto)


def put_action(
    transaction: Transaction,
    keyword: str,
    name: str,
    parameters: tuple[ParameterDefinition, ...],
    parts: Trees,
) -> bool:
    """Define an action, a process or an event."""
    check_name("action", name)
    definitions = transaction.definitions
    stored = definitions.actions.named(name)
    if stored is not None and _family(stored.kind) != _family(keyword):
        raise ConflictError(
            f"{stored.name!r} is a stored {stored.kind}, so it cannot also name this {keyword}; "
            "delete that first, or choose another name"
        )
    identity = identify(transaction, "action", name)
    made = ActionDefinition(*identity, keyword, parameters, *parts)
    return transaction.define("action", with_text(definitions, made))


def _family(kind: str) -> str:
    return "action" if kind.endswith("action") else kind


class ActionChecker:
    """Checks one action's DTO and defines it."""

    def __init__(self, transaction: Transaction, dto: PddlActionDto) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._dto = dto
        self._role = f"{dto.keyword.rpartition('-')[2]} {dto.name!r}"
        self._positions: dict[str, int] = {}
        self._parameters: list[ParameterDefinition] = []

    def put(self) -> bool:
        """Check and save the action, and save missing elements that it refers to."""
        dto = self._dto
        check_name("action", dto.name)
        durative = flag(dto.durative, f"durative of {self._role}")
        duration = self._duration() if durative else ()
        for parameter in expect_list(dto.parameters, PddlObjectDto, self._part("parameters")):
            self._add_parameter(parameter)
        condition = self._formulas("condition", dto.conditions, *TIMES)
        effect = self._formulas("effect", dto.effects, AT_START, AT_END)
        parameters = tuple(self._parameters)
        typed = [typed_name(self._definitions, one) for one in parameters]
        given = duration, condition, effect
        parts = read_parts(self._transaction, dto.keyword, dto.name, typed, given)
        trees = action_trees(self._transaction, parameters, parts)
        return put_action(self._transaction, dto.keyword, dto.name, parameters, trees)

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

    def _formulas(
        self, section: str, parts: Iterable[PddlConditionEffectDto | Node], *times: str
    ) -> list[Node]:
        expect_list(parts, (PddlConditionEffectDto, Node), self._part(f"{section}s"))
        return [
            part
            if isinstance(part, Node)
            else self._literal(part, f"{section} {number} of {self._role}", times)
            for number, part in enumerate(parts, start=1)
        ]

    def _literal(self, dto: PddlConditionEffectDto, role: str, times: Sequence[str]) -> Node:
        expect(dto.predicate, PddlPredicateDto, f"the predicate of {role}")
        expect_list(dto.objects, PddlObjectDto, f"the list of objects of {role}")
        self._check_time(dto, role, times)
        predicate = PREDICATES.ensure(self._transaction, dto.predicate, role)
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

    def _check_time(self, dto: PddlConditionEffectDto, role: str, times: Sequence[str]) -> None:
        # Programs of the original library write an empty text for no time.
        if not self._dto.durative and dto.time not in (None, ""):
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {shown(dto.time)}, but the action is not durative; "
                "leave the time out"
            )
        if self._dto.durative and dto.time not in times:
            raise InvalidKnowledgeError(
                f"{role}: {dto} has the time {shown(dto.time)}, expected one of "
                f"{', '.join(map(repr, times))}, for the action is durative"
            )

    def _term(self, dto: PddlObjectDto, role: str) -> tuple[Variable | Constant, tuple[int, ...]]:
        """Find what a term denotes: a parameter, or else a known object."""
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
                TYPES.ensure(self._transaction, dto.type, role)
            return Variable(parameter.name), parameter.type_ids
        constant = self._definitions.objects.named(dto.name)
        if constant is None:
            raise InvalidKnowledgeError(
                f"{role}: {dto.name!r} is neither a parameter of the action nor an object that is "
                "known; add the parameter, or save the object first"
            )
        OBJECTS.check(self._transaction, dto, constant, role)
        return Constant(constant.name), constant.type_ids


class _SqlActionDao(SqlNamedDao[A]):
    kind: ClassVar[str] = "action"
    keywords: ClassVar[tuple[str, ...]]
    _reads = staticmethod(read_action)
    _needs_names = True

    def _is_mine(self, definition: ActionDefinition) -> bool:
        return definition.kind in self.keywords

    def _check(self, dto: object) -> None:
        super()._check(dto)
        if isinstance(dto, PddlActionDto) and dto.keyword not in self.keywords:
            raise InvalidKnowledgeError(
                f"{dto.name!r} is {with_article(dto.keyword)}, which has a DAO of its own; save it "
                "there"
            )

    def _put(self, transaction: Transaction, dto: A, cascade: bool) -> bool:
        return ActionChecker(transaction, dto).put()

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
