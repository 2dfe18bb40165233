"""Predicates: the DAO, and what others do when they refer to one."""

from __future__ import annotations

from typing import ClassVar

from ..dto import PddlPredicateDto, PddlTypeDto
from ..dto.name import RESERVED_PREDICATES, check_name, fold
from ..dto.pddl_predicate_dto import predicate_text
from ..errors import ArityError, ConflictError
from ..knowledge.predicate import ParameterDefinition, PredicateDefinition
from ..transaction import Transaction
from .base import expect, expect_list
from .builder import DtoBuilder
from .dependants import Scope, clear_for_redefinition, delete_scope
from .interfaces import PddlPredicateDao
from .named import SqlNamedDao
from .type import ensure_type

# A proposition's arguments are one index key, and PostgreSQL's keys end at 2,704 bytes.
MAX_ARITY = 100


def ensure_predicate(
    transaction: Transaction, dto: PddlPredicateDto, role: str
) -> PredicateDefinition:
    """Find the predicate that an element refers to; save it when it is missing.

    Args:
        transaction: the transaction.
        dto: the predicate as referred to.
        role: what refers to it, for the message.

    Returns:
        The predicate.

    Raises:
        ConflictError: it is stored with other parameters.
        InvalidKnowledgeError: it is missing, and not well formed.
    """
    expect(dto, PddlPredicateDto, f"the predicate of {role}")
    expect_list(dto.types, PddlTypeDto, f"the list of types of predicate {dto.name!r}")
    stored = transaction.definitions.predicates.named(dto.name)
    if stored is None:
        return put_predicate(transaction, dto, cascade=False)[0]
    types = transaction.definitions.types
    names = [types.live(parameter.type_ids[0]).name for parameter in stored.parameters]
    if len(names) != len(dto.types) or any(
        given.name != name and fold(given.name) != fold(name)
        for given, name in zip(dto.types, names, strict=True)
    ):
        raise ConflictError(
            f"predicate {dto.name!r} is stored as {stored.text}, but {role} refers to it as {dto}; "
            "use the stored definition, or save the predicate itself to redefine it"
        )
    for type_ in dto.types:
        if type_.parent is not None:
            ensure_type(transaction, type_, f"predicate {dto.name!r}")
    return stored


def put_predicate(
    transaction: Transaction, dto: PddlPredicateDto, cascade: bool
) -> tuple[PredicateDefinition, bool]:
    """Define a predicate as a DTO says.

    Args:
        transaction: the transaction.
        dto: the predicate.
        cascade: whether a redefinition retracts what depends on the present definition.

    Returns:
        The predicate, and whether it has changed.
    """
    check_name("predicate", dto.name, RESERVED_PREDICATES)
    expect_list(dto.types, PddlTypeDto, f"the list of types of predicate {dto.name!r}")
    if len(dto.types) > MAX_ARITY:
        raise ArityError(
            f"predicate {dto.name!r} has {len(dto.types)} parameters, {MAX_ARITY} at most"
        )
    types = [ensure_type(transaction, type_, f"predicate {dto.name!r}") for type_ in dto.types]
    stored = transaction.definitions.predicates.named(dto.name)
    id_, name = (stored.id, stored.name) if stored else transaction.intern("predicate", dto.name)
    parameters = tuple(
        ParameterDefinition(f"{type_.name[:1]}{position}", (type_.id,))
        for position, type_ in enumerate(types)
    )
    text = predicate_text(name, [type_.name for type_ in types])
    definition = PredicateDefinition(id_, name, parameters, text)
    if stored is not None and stored != definition:
        clear_for_redefinition(
            transaction,
            Scope(predicates={id_}),
            f"predicate {stored.text}",
            definition.text,
            cascade,
        )
    return definition, transaction.define("predicate", definition)


class SqlPredicateDao(SqlNamedDao[PddlPredicateDto], PddlPredicateDao):
    """Predicates in an SQL store."""

    kind: ClassVar[str] = "predicate"
    dto_class = PddlPredicateDto

    def _build(self, builder: DtoBuilder, definition: PredicateDefinition) -> PddlPredicateDto:
        return builder.predicate(definition.id)

    def _put(self, transaction: Transaction, dto: PddlPredicateDto, cascade: bool) -> bool:
        return put_predicate(transaction, dto, cascade)[1]

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        delete_scope(transaction, Scope(predicates=set(ids)))
