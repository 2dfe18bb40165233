"""Functions: the DAO, and what others do when they refer to one."""

from __future__ import annotations

from typing import ClassVar

from ..arguments import expect, expect_list
from ..dto import PddlEitherTypeDto, PddlFunctionDto, PddlTypeDto
from ..dto.name import check_name, function_kind
from ..dto.pddl_function_dto import function_text
from ..errors import ConflictError
from ..knowledge.function import FunctionDefinition
from ..transaction import Transaction
from .builder import DtoBuilder
from .dependants import Scope, clear_for_redefinition, delete_scope
from .fluent_interfaces import PddlFunctionDao
from .named import SqlNamedDao
from .parameters import (
    agrees,
    allowed_types,
    check_parents,
    put_parameters,
    refuse_number,
    same_types,
    type_text,
    type_texts,
)


def ensure_function(
    transaction: Transaction, dto: PddlFunctionDto, role: str
) -> FunctionDefinition:
    """Find the function that an element refers to; save it when it is missing.

    Args:
        transaction: the transaction.
        dto: the function as referred to; the names of its parameters do not matter.
        role: what refers to it, for the message.

    Returns:
        The function.

    Raises:
        ConflictError: it is stored with other parameters, or other values.
        InvalidKnowledgeError: it is missing, and not well formed.
    """
    expect(dto, PddlFunctionDto, f"the function of {role}")
    expect_list(dto.types, PddlTypeDto, f"the list of types of function {dto.name!r}")
    expect_list(dto.value_types, PddlTypeDto, f"the list of value types of function {dto.name!r}")
    stored = transaction.definitions.functions.named(dto.name)
    if stored is None:
        return put_function(transaction, dto, cascade=False)[0]
    if not _is_stored(transaction, dto, stored):
        raise ConflictError(
            f"function {dto.name!r} is stored as {stored.text}, but {role} refers to it as {dto}; "
            "use the stored definition, or save the function itself to redefine it"
        )
    for type_ in (*dto.types, *dto.value_types):
        check_parents(transaction, type_, f"function {dto.name!r}")
    return stored


def _is_stored(transaction: Transaction, dto: PddlFunctionDto, stored: FunctionDefinition) -> bool:
    definitions = transaction.definitions
    if len(stored.parameters) != len(dto.types) or bool(dto.value_types) != bool(stored.type_ids):
        return False
    pairs = zip(dto.types, (parameter.type_ids for parameter in stored.parameters), strict=True)
    return all(agrees(definitions, given, type_ids) for given, type_ids in pairs) and (
        not dto.value_types or agrees(definitions, value_type(dto), stored.type_ids)
    )


def value_type(dto: PddlFunctionDto) -> PddlTypeDto:
    """Give the type of a function's objects as one.

    Args:
        dto: the function, whose values are objects.

    Returns:
        The type, or several as `PddlEitherTypeDto`.
    """
    types = dto.value_types
    return types[0] if len(types) == 1 else PddlEitherTypeDto(types)


def put_function(
    transaction: Transaction, dto: PddlFunctionDto, cascade: bool
) -> tuple[FunctionDefinition, bool]:
    """Define a function as a DTO says.

    Args:
        transaction: the transaction.
        dto: the function.
        cascade: whether a redefinition retracts what depends on the present definition.

    Returns:
        The function, and whether it has changed.
    """
    role = f"function {dto.name!r}"
    check_name(function_kind(dto.types, dto.value_types), dto.name)
    expect_list(dto.value_types, PddlTypeDto, f"the list of value types of {role}")
    stored = transaction.definitions.functions.named(dto.name)
    present = stored.parameters if stored else ()
    parameters = put_parameters(transaction, dto, role, present)
    type_ids: tuple[int, ...] = ()
    if dto.value_types:
        refuse_number(value_type(dto), role)
        type_ids = allowed_types(transaction, value_type(dto), role)
    id_, name = (stored.id, stored.name) if stored else transaction.intern("function", dto.name)
    text = function_text(
        name,
        type_texts(transaction.definitions, parameters),
        [type_text(transaction.definitions, [type_id]) for type_id in type_ids],
        [parameter.name for parameter in parameters],
    )
    definition = FunctionDefinition(id_, name, parameters, type_ids, text)
    # What depends on a function does not depend on the names of its parameters.
    if stored is not None and not (
        same_types(parameters, present) and {*type_ids} == {*stored.type_ids}
    ):
        clear_for_redefinition(
            transaction,
            Scope(functions={id_}),
            f"function {stored.text}",
            definition.text,
            cascade,
        )
    return definition, transaction.define("function", definition)


class SqlFunctionDao(SqlNamedDao[PddlFunctionDto], PddlFunctionDao):
    """Functions in an SQL store."""

    kind: ClassVar[str] = "function"
    dto_class = PddlFunctionDto

    def _build(self, builder: DtoBuilder, definition: FunctionDefinition) -> PddlFunctionDto:
        return builder.function(definition.id)

    def _put(self, transaction: Transaction, dto: PddlFunctionDto, cascade: bool) -> bool:
        return put_function(transaction, dto, cascade)[1]

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        delete_scope(transaction, Scope(functions=set(ids)))
