"""Predicates: the DAO, and what others do when they refer to one."""

from __future__ import annotations

from typing import ClassVar

from ..arguments import expect, expect_list
from ..dto import PddlPredicateDto, PddlTypeDto
from ..dto.name import check_name
from ..dto.parameters import declaration_text
from ..errors import ConflictError
from ..knowledge.predicate import PredicateDefinition
from ..transaction import Transaction
from .builder import DtoBuilder
from .dependants import Scope, clear_for_redefinition, delete_scope
from .interfaces import PddlPredicateDao
from .named import SqlNamedDao
from .parameters import agrees, check_parents, given_names, put_parameters, same_types, type_texts


def ensure_predicate(
    transaction: Transaction, dto: PddlPredicateDto, role: str
) -> PredicateDefinition:
    """Find the predicate that an element refers to; save it when it is missing.

    Args:
        transaction: the transaction.
        dto: the predicate as referred to; the names of its parameters do not matter.
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
    if len(stored.parameters) != len(dto.types) or not all(
        agrees(transaction.definitions, given, parameter.type_ids)
        for given, parameter in zip(dto.types, stored.parameters, strict=True)
    ):
        raise ConflictError(
            f"predicate {dto.name!r} is stored as {stored.text}, but {role} refers to it as {dto}; "
            "use the stored definition, or save the predicate itself to redefine it"
        )
    given_names(dto, f"predicate {dto.name!r}")
    for type_ in dto.types:
        check_parents(transaction, type_, f"predicate {dto.name!r}")
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
    check_name("predicate", dto.name)
    stored = transaction.definitions.predicates.named(dto.name)
    present = stored.parameters if stored else ()
    parameters = put_parameters(transaction, dto, f"predicate {dto.name!r}", present)
    id_, name = (stored.id, stored.name) if stored else transaction.intern("predicate", dto.name)
    text = declaration_text(
        name,
        type_texts(transaction.definitions, parameters),
        [parameter.name for parameter in parameters],
    )
    definition = PredicateDefinition(id_, name, parameters, text)
    # What depends on a predicate does not depend on the names of its parameters.
    if stored is not None and not same_types(parameters, present):
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
