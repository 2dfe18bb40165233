"""Typed parameters, as predicates and functions declare them: checked, stored and compared."""

from __future__ import annotations

from collections.abc import Sequence

from ..arguments import expect_list
from ..dto import PddlEitherTypeDto, PddlFunctionDto, PddlPredicateDto, PddlTypeDto
from ..dto.name import check_name, fold
from ..dto.parameters import either_text, variable_name
from ..errors import ArityError, InvalidKnowledgeError
from ..knowledge.definitions import Definitions
from ..knowledge.predicate import ParameterDefinition
from ..transaction import Transaction
from .type import ensure_type, ensure_types

# The arguments of an atom are one index key, and PostgreSQL's keys end at 2,704 bytes.
MAX_ARITY = 100

Parameters = tuple[ParameterDefinition, ...]


def put_parameters(
    transaction: Transaction,
    dto: PddlPredicateDto | PddlFunctionDto,
    role: str,
    stored: Parameters,
) -> Parameters:
    """Check the parameters of a DTO that is saved, and save their types when they are missing.

    Args:
        transaction: the transaction.
        dto: the predicate or the function.
        role: what it is, for the message.
        stored: its present parameters, which keep their names when the DTO gives none.

    Returns:
        The parameters.

    Raises:
        ArityError: there are more than `MAX_ARITY`, or not as many names as types.
        InvalidNameError: a name is none.
    """
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
    """Check the names that a DTO gives to its parameters.

    Args:
        dto: the predicate or the function.
        role: what it is, for the message.

    Returns:
        The names, or None when it gives none.

    Raises:
        ArityError: there are not as many names as types.
        InvalidNameError: a name is none.
    """
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
    """Find the types that a type stands for; save those that are missing.

    Args:
        transaction: the transaction.
        dto: the type, or several as `PddlEitherTypeDto`.
        role: what refers to it, for the message.

    Returns:
        Their ids, each once.
    """
    return tuple(dict.fromkeys(ensure_types(transaction, dto, role)))


def type_text(definitions: Definitions, type_ids: Sequence[int]) -> str:
    """Write the types that a parameter allows.

    Args:
        definitions: the definitions.
        type_ids: the types.

    Returns:
        The PDDL text.
    """
    return either_text(definitions.types.live(id_).name for id_ in type_ids)


def type_texts(definitions: Definitions, parameters: Parameters) -> list[str]:
    """Write the types that parameters allow.

    Args:
        definitions: the definitions.
        parameters: the parameters.

    Returns:
        The PDDL text of each.
    """
    return [type_text(definitions, parameter.type_ids) for parameter in parameters]


def same_types(one: Parameters, other: Parameters) -> bool:
    """Tell whether parameters allow the same, whatever their names and the order in `either`.

    Args:
        one: some parameters.
        other: others.

    Returns:
        Whether they do.
    """
    return [{*part.type_ids} for part in one] == [{*part.type_ids} for part in other]


def agrees(definitions: Definitions, dto: PddlTypeDto, type_ids: Sequence[int]) -> bool:
    """Tell whether a type that is referred to is the stored one.

    Args:
        definitions: the definitions.
        dto: the type, or several as `PddlEitherTypeDto`.
        type_ids: the stored types.

    Returns:
        Whether it is, by its name; for several, in any order.
    """
    names = [definitions.types.live(id_).name for id_ in type_ids]
    if not isinstance(dto, PddlEitherTypeDto) and len(names) == 1:
        return dto.name == names[0] or fold(dto.name) == fold(names[0])
    return {fold(part.name) for part in _parts(dto)} == {fold(name) for name in names}


def check_parents(transaction: Transaction, dto: PddlTypeDto, role: str) -> None:
    """Check that a type that is referred to says of its parent what is stored.

    Args:
        transaction: the transaction.
        dto: the type, or several as `PddlEitherTypeDto`.
        role: what refers to it, for the message.

    Raises:
        ConflictError: it is stored with another parent.
    """
    for part in _parts(dto):
        if part.parent is not None:
            ensure_type(transaction, part, role)


def _parts(dto: PddlTypeDto) -> Sequence[PddlTypeDto]:
    if not isinstance(dto, PddlEitherTypeDto):
        return (dto,)
    return expect_list(dto.types, PddlTypeDto, f"the list of types of {dto.name}")


def refuse_number(dto: PddlTypeDto, role: str) -> None:
    """Refuse the word that PDDL 3.1 has for numbers as the type of a function's objects.

    Args:
        dto: the type of the values.
        role: the function, for the message.

    Raises:
        InvalidKnowledgeError: it is that word.
    """
    if any(fold(part.name) == "number" for part in _parts(dto)):
        raise InvalidKnowledgeError(
            f"{role} has values of a type called 'number', which PDDL reads as numbers; choose "
            "another name for the type, or give no value types for numbers"
        )
