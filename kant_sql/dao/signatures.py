"""Predicates and functions: their parameters, definitions and DAOs."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

from ..arguments import expect_list
from ..dto import PddlEitherTypeDto, PddlFunctionDto, PddlPredicateDto, PddlTypeDto
from ..dto.lexical import check_name, fold, function_kind, variable_name
from ..errors import ArityError, InvalidKnowledgeError
from ..knowledge.canonical import type_text
from ..knowledge.definitions import Definitions, FunctionDefinition, PredicateDefinition
from ..knowledge.trees import ParameterDefinition
from ..pddl.given import read_function, read_predicate
from ..store.transaction import Transaction
from .base import Definer, SqlNamedDao
from .interfaces import PddlFunctionDao, PddlPredicateDao
from .type import TYPES, ensure_types, plain_types

# The arguments of an atom are one index key, and PostgreSQL's keys end at 2,704 bytes.
MAX_ARITY = 100

Parameters = tuple[ParameterDefinition, ...]


def put_parameters(
    transaction: Transaction,
    dto: PddlPredicateDto | PddlFunctionDto,
    role: str,
    stored: Parameters,
) -> Parameters:
    """Check the parameters of a DTO to save, and save their missing types."""
    types = expect_list(dto.types, PddlTypeDto, f"the list of types of {role}")
    if len(types) > MAX_ARITY:
        raise ArityError(f"{role} has {len(types)} parameters, {MAX_ARITY} at most")
    names = given_names(dto, role)
    allowed = [allowed_types(transaction, type_, role) for type_ in types]
    definitions = transaction.definitions
    made = tuple(
        ParameterDefinition(
            names[position] if names else variable_name(type_text(definitions, ids), position), ids
        )
        for position, ids in enumerate(allowed)
    )
    if names is None and same_types(made, stored):
        return tuple(part._replace(name=kept.name) for part, kept in zip(made, stored, strict=True))
    return made


def given_names(dto: PddlPredicateDto | PddlFunctionDto, role: str) -> Sequence[str] | None:
    """Check the parameter names of a DTO."""
    if dto.parameter_names is None:
        return None
    names = expect_list(dto.parameter_names, str, f"the list of parameter names of {role}")
    if len(names) != len(dto.types):
        raise ArityError(
            f"{role} has {len(names)} parameter names for {len(dto.types)} types; give one for "
            "each, or none at all"
        )
    for name in names:
        check_name("parameter", name)
    return names


def allowed_types(transaction: Transaction, dto: PddlTypeDto, role: str) -> tuple[int, ...]:
    """Find the types that a type stands for; save missing ones."""
    return tuple(dict.fromkeys(ensure_types(transaction, dto, role)))


def same_types(one: Parameters, other: Parameters) -> bool:
    """Return whether parameters allow the same, whatever their names and the order in `either`."""
    return [{*part.type_ids} for part in one] == [{*part.type_ids} for part in other]


def agrees(definitions: Definitions, dto: PddlTypeDto, type_ids: Sequence[int]) -> bool:
    """Return whether a referenced type is the stored one."""
    names = [definitions.types.live(id_).name for id_ in type_ids]
    if not isinstance(dto, PddlEitherTypeDto) and len(names) == 1:
        return dto.name == names[0] or fold(dto.name) == fold(names[0])
    return {fold(part.name) for part in _parts(dto)} == {fold(name) for name in names}


def agree(definitions: Definitions, types: Sequence[PddlTypeDto], parameters: Parameters) -> bool:
    """Return whether the referenced types are those of stored parameters."""
    return len(types) == len(parameters) and all(
        agrees(definitions, given, parameter.type_ids)
        for given, parameter in zip(types, parameters, strict=True)
    )


def check_parents(transaction: Transaction, types: Iterable[PddlTypeDto], role: str) -> None:
    """Check the parents that referenced types state against the stored ones."""
    for type_ in types:
        for part in _parts(type_):
            if part.parent is not None:
                TYPES.ensure(transaction, part, role)


def _parts(dto: PddlTypeDto) -> Sequence[PddlTypeDto]:
    if not isinstance(dto, PddlEitherTypeDto):
        return (dto,)
    return expect_list(dto.types, PddlTypeDto, f"the list of types of {dto.name}")


def refuse_number(dto: PddlTypeDto, role: str) -> None:
    """Refuse PDDL 3.1's word for numbers as the type of a function's objects."""
    if any(fold(part.name) == "number" for part in _parts(dto)):
        raise InvalidKnowledgeError(
            f"{role} has values of a type called 'number', which PDDL reads as numbers; choose "
            "another name for the type, or give no value types for numbers"
        )


class PredicateDefiner(Definer[PddlPredicateDto, PredicateDefinition]):
    """Defines predicates."""

    kind = "predicate"
    dto_class = PddlPredicateDto

    def _reference(self, dto: PddlPredicateDto) -> Hashable:
        if type(dto) is not PddlPredicateDto or type(dto.name) is not str:
            return None
        types = None if dto.parameter_names is not None else plain_types(dto.types)
        return None if types is None else ("predicate", dto.name, types)

    def _make(
        self, transaction: Transaction, dto: PddlPredicateDto, stored: PredicateDefinition | None
    ) -> PredicateDefinition:
        present = stored.parameters if stored else ()
        parameters = put_parameters(transaction, dto, f"predicate {dto.name!r}", present)
        return PredicateDefinition(*self._identity(transaction, dto, stored), parameters)

    def _keeps(self, stored: PredicateDefinition, made: PredicateDefinition) -> bool:
        return same_types(stored.parameters, made.parameters)

    def _agrees(
        self, transaction: Transaction, dto: PddlPredicateDto, stored: PredicateDefinition
    ) -> bool:
        role = f"predicate {dto.name!r}"
        expect_list(dto.types, PddlTypeDto, f"the list of types of {role}")
        if not agree(transaction.definitions, dto.types, stored.parameters):
            return False
        given_names(dto, role)
        check_parents(transaction, dto.types, role)
        return True


PREDICATES = PredicateDefiner()


class SqlPredicateDao(SqlNamedDao[PddlPredicateDto], PddlPredicateDao):
    """Predicates in an SQL store."""

    _reads = staticmethod(read_predicate)
    definer = PREDICATES


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

    _reads = staticmethod(read_function)
    definer = FUNCTIONS
