"""Types: the DAO, and what others do when they refer to one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar

from ..arguments import expect, expect_list
from ..dto import PddlEitherTypeDto, PddlTypeDto
from ..dto.name import ROOT_TYPE, check_name, fold
from ..dto.parameters import either_text
from ..errors import ConflictError, InvalidKnowledgeError, TypeCycleError
from ..knowledge.type import TypeDefinition
from ..transaction import Transaction
from .builder import DtoBuilder
from .dependants import clear_for_redefinition, delete_scope, of_types
from .interfaces import PddlTypeDao
from .named import SqlNamedDao


def ensure_type(transaction: Transaction, dto: PddlTypeDto, role: str) -> TypeDefinition:
    """Find the type that an element refers to; save it when it is missing.

    Args:
        transaction: the transaction.
        dto: the type as referred to.
        role: what refers to it, for the message.

    Returns:
        The type.

    Raises:
        ConflictError: it is stored with another parent than the one given.
        InvalidKnowledgeError: it is missing, and not well formed.
    """
    expect(dto, PddlTypeDto, f"the type of {role}")
    if dto.parent is not None:
        _ensure_above(transaction, dto, is_saved=False)
    return _ensure_one(transaction, dto, role)


def _ensure_one(transaction: Transaction, dto: PddlTypeDto, role: str) -> TypeDefinition:
    """Find a type, or save it, when all types above it are known."""
    stored = transaction.definitions.types.named(dto.name)
    if stored is None:
        return _define(transaction, dto, cascade=False)[0]
    if dto.parent is not None and _parent_key(transaction, stored) != fold(dto.parent.name):
        raise ConflictError(
            f"type {dto.name!r} is stored as '{stored.text}', but {role} refers to it as '{dto}'; "
            "use the stored definition, or save the type itself to redefine it"
        )
    return stored


def _ensure_above(transaction: Transaction, dto: PddlTypeDto, is_saved: bool) -> None:
    """Find or save all types above one, from the top: hierarchies may be of any depth."""
    agreed = transaction.agreed_types
    done: set[int] = set()
    path: dict[str, None] = {}
    stack: list[tuple[PddlTypeDto, str, bool]] = [(dto, "", False)]
    while stack:
        current, role, is_complete = stack.pop()
        key = fold(current.name)
        if is_complete:
            del path[key]
            done.add(id(current))
            if current is not dto:
                _ensure_one(transaction, current, role)
                if agreed is not None:
                    agreed[id(current)] = current
            continue
        if id(current) in done or (agreed is not None and id(current) in agreed):
            continue
        if key in path:
            raise TypeCycleError(
                f"type {dto.name!r} would be its own ancestor: {' - '.join([*path, key])}; "
                "leave out one of the parents"
            )
        if key == ROOT_TYPE and current.parent is not None:
            raise InvalidKnowledgeError(
                f"type {ROOT_TYPE!r} is the root of all types and has no parent, "
                f"not {current.parent.name!r}"
            )
        path[key] = None
        stack.append((current, role, True))
        inner = f"type {current.name!r}"
        goes_up = (current is dto and is_saved) or not _agrees_alone(transaction, current)
        stack += [
            (parent, inner, False)
            for parent in reversed(_parents(current))
            if goes_up or fold(parent.name) in path
        ]


def _agrees_alone(transaction: Transaction, dto: PddlTypeDto) -> bool:
    """Tell whether nothing above a type has to be looked at: it is stored, and its parent bare."""
    parent = dto.parent
    return (
        isinstance(parent, PddlTypeDto)
        and not isinstance(parent, PddlEitherTypeDto)
        and parent.parent is None
        and transaction.definitions.types.named(dto.name) is not None
    )


def _parents(dto: PddlTypeDto) -> Sequence[PddlTypeDto]:
    """Give the types right above one, as its DTO says."""
    if dto.parent is None:
        return ()
    expect(dto.parent, PddlTypeDto, f"the parent of type {dto.name!r}")
    if isinstance(dto.parent, PddlEitherTypeDto):
        return expect_list(dto.parent.types, PddlTypeDto, f"the parents of {dto.name!r}")
    return (dto.parent,)


def ensure_types(transaction: Transaction, dto: PddlTypeDto, role: str) -> tuple[int, ...]:
    """Find the types that an element's type stands for; save those that are missing.

    Args:
        transaction: the transaction.
        dto: the type as referred to, or several as `PddlEitherTypeDto`.
        role: what refers to it, for the message.

    Returns:
        The ids: one, or several for `either`.

    Raises:
        ConflictError: as `ensure_type`.
        InvalidKnowledgeError: as `ensure_type`, or `either` has no types.
    """
    if not isinstance(dto, PddlEitherTypeDto):
        return (ensure_type(transaction, dto, role).id,)
    types = expect_list(dto.types, PddlTypeDto, f"the list of types of {role}")
    if not types:
        raise InvalidKnowledgeError(
            f"the type of {role} is 'either' of no types; give at least one"
        )
    return tuple(ensure_type(transaction, type_, role).id for type_ in types)


def put_type(
    transaction: Transaction, dto: PddlTypeDto, cascade: bool
) -> tuple[TypeDefinition, bool]:
    """Define a type as a DTO says.

    Args:
        transaction: the transaction.
        dto: the type.
        cascade: whether a redefinition retracts what depends on the present definition.

    Returns:
        The type, and whether it has changed.
    """
    check_name("type", dto.name)
    if dto.parent is not None:
        _ensure_above(transaction, dto, is_saved=True)
    return _define(transaction, dto, cascade)


def _define(
    transaction: Transaction, dto: PddlTypeDto, cascade: bool
) -> tuple[TypeDefinition, bool]:
    """Define a type when all types above it are known."""
    check_name("type", dto.name)
    parents: tuple[int, ...] = ()
    if dto.parent is not None:
        _parents(dto)
        if isinstance(dto.parent, PddlEitherTypeDto) and not dto.parent.types:
            raise InvalidKnowledgeError(
                f"the type of type {dto.name!r} is 'either' of no types; give at least one"
            )
        known = transaction.definitions.types
        ids = (known.named(parent.name) for parent in _parents(dto))
        parents = tuple(each.id for each in ids if each is not None)
    stored = transaction.definitions.types.named(dto.name)
    id_, name = (stored.id, stored.name) if stored else transaction.intern("type", dto.name)
    above = _names(transaction, parents)
    text = f"{name} - {above}" if parents else name
    definition = TypeDefinition(id_, name, parents[0] if parents else None, text, parents[1:])
    if stored is not None and stored != definition:
        if transaction.agreed_types:
            transaction.agreed_types.clear()
        for parent in parents:
            _check_cycle(transaction, stored, transaction.definitions.types.live(parent))
        scope = of_types(transaction.definitions, [id_])
        clear_for_redefinition(transaction, scope, f"type {stored.text}", f"'{text}'", cascade)
    return definition, transaction.define("type", definition)


def _parent_key(transaction: Transaction, type_: TypeDefinition) -> str:
    """Give the folded name of the type above; the root is above all that say nothing."""
    return fold(_names(transaction, type_.parent_ids)) if type_.parent_ids else ROOT_TYPE


def _names(transaction: Transaction, type_ids: Iterable[int]) -> str:
    return either_text(transaction.definitions.types.live(id_).name for id_ in type_ids)


def _check_cycle(transaction: Transaction, type_: TypeDefinition, parent: TypeDefinition) -> None:
    chain = list(transaction.definitions.ancestry(parent.id))
    if any(above.id == type_.id for above in chain):
        path = " - ".join([type_.name, *(above.name for above in chain)])
        raise TypeCycleError(
            f"type {type_.name!r} would be its own ancestor: {path}; choose another parent"
        )


class SqlTypeDao(SqlNamedDao[PddlTypeDto], PddlTypeDao):
    """Types in an SQL store."""

    kind: ClassVar[str] = "type"
    dto_class = PddlTypeDto

    def _build(self, builder: DtoBuilder, definition: TypeDefinition) -> PddlTypeDto:
        return builder.type(definition.id)

    def _put(self, transaction: Transaction, dto: PddlTypeDto, cascade: bool) -> bool:
        return put_type(transaction, dto, cascade)[1]

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        delete_scope(transaction, of_types(transaction.definitions, ids))
