"""Functions: how they are defined, and their DAO."""

from __future__ import annotations

from collections.abc import Hashable
from typing import ClassVar

from ..arguments import expect_list
from ..dto import PddlEitherTypeDto, PddlFunctionDto, PddlTypeDto
from ..dto.lexical import function_kind
from ..knowledge.definitions import FunctionDefinition
from ..pddl.given import read_function
from ..store.transaction import Transaction
from .base import Definer, SqlNamedDao
from .interfaces import PddlFunctionDao
from .predicate import (
    agree,
    agrees,
    allowed_types,
    check_parents,
    put_parameters,
    refuse_number,
    same_types,
)
from .type import plain_types


class FunctionDefiner(Definer[PddlFunctionDto, FunctionDefinition]):
    """Defines functions."""

    kind = "function"
    dto_class = PddlFunctionDto

    def _name_kind(self, dto: PddlFunctionDto) -> str:
        return function_kind(dto.types, dto.value_types)

    def _reference(self, dto: PddlFunctionDto) -> Hashable:
        if type(dto) is not PddlFunctionDto or type(dto.name) is not str:
            return None
        types, values = plain_types(dto.types), plain_types(dto.value_types)
        return None if None in (types, values) else ("function", dto.name, types, values)

    def _make(
        self, transaction: Transaction, dto: PddlFunctionDto, stored: FunctionDefinition | None
    ) -> FunctionDefinition:
        role = f"function {dto.name!r}"
        expect_list(dto.value_types, PddlTypeDto, f"the list of value types of {role}")
        present = stored.parameters if stored else ()
        parameters = put_parameters(transaction, dto, role, present)
        type_ids: tuple[int, ...] = ()
        if dto.value_types:
            refuse_number(_value_type(dto), role)
            type_ids = allowed_types(transaction, _value_type(dto), role)
        identity = self._identity(transaction, dto, stored)
        return FunctionDefinition(*identity, parameters, type_ids)

    def _keeps(self, stored: FunctionDefinition, made: FunctionDefinition) -> bool:
        same_values = {*stored.type_ids} == {*made.type_ids}
        return same_values and same_types(stored.parameters, made.parameters)

    def _agrees(
        self, transaction: Transaction, dto: PddlFunctionDto, stored: FunctionDefinition
    ) -> bool:
        role, definitions = f"function {dto.name!r}", transaction.definitions
        expect_list(dto.types, PddlTypeDto, f"the list of types of {role}")
        expect_list(dto.value_types, PddlTypeDto, f"the list of value types of {role}")
        if bool(dto.value_types) != bool(stored.type_ids):
            return False
        if dto.value_types and not agrees(definitions, _value_type(dto), stored.type_ids):
            return False
        if not agree(definitions, dto.types, stored.parameters):
            return False
        check_parents(transaction, (*dto.types, *dto.value_types), role)
        return True


FUNCTIONS = FunctionDefiner()


def _value_type(dto: PddlFunctionDto) -> PddlTypeDto:
    """Return the type of a function's objects as one."""
    types = dto.value_types
    return types[0] if len(types) == 1 else PddlEitherTypeDto(types)


class SqlFunctionDao(SqlNamedDao[PddlFunctionDto], PddlFunctionDao):
    """Functions in an SQL store."""

    kind: ClassVar[str] = "function"
    dto_class = PddlFunctionDto
    _reads = staticmethod(read_function)
    definer = FUNCTIONS
