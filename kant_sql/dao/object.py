"""Objects: the DAO, and what others do when they refer to one."""

from __future__ import annotations

from typing import ClassVar

from ..arguments import expect, flag
from ..dto import PddlObjectDto, PddlTypeDto
from ..dto.name import check_name, fold
from ..dto.parameters import either_text
from ..errors import ConflictError
from ..knowledge.object import ObjectDefinition
from ..transaction import Transaction
from .builder import DtoBuilder
from .dependants import Scope, clear_for_redefinition, delete_scope
from .interfaces import PddlObjectDao
from .named import SqlNamedDao
from .type import ensure_types


def check_object(
    transaction: Transaction, dto: PddlObjectDto, stored: ObjectDefinition, role: str
) -> None:
    """Check that an element refers to an object as it is stored.

    Args:
        transaction: the transaction.
        dto: the object as referred to.
        stored: the object as stored.
        role: what refers to it, for the message.

    Raises:
        ConflictError: it is stored with another type.
    """
    types = transaction.definitions.types
    name = either_text(types.live(id_).name for id_ in stored.type_ids)
    if dto.type.parent is None and dto.type.name == name:
        return
    if fold(dto.type.name) != fold(name):
        raise ConflictError(
            f"object {dto.name!r} is stored as '{stored.text}', but {role} refers to it as "
            f"'{dto}'; use the stored definition, or save the object itself to redefine it"
        )
    ensure_types(transaction, dto.type, f"object {dto.name!r}")


def ensure_object(transaction: Transaction, dto: PddlObjectDto, role: str) -> ObjectDefinition:
    """Find the object that an element refers to; save it when it is missing.

    Args:
        transaction: the transaction.
        dto: the object as referred to.
        role: what refers to it, for the message.

    Returns:
        The object.

    Raises:
        ConflictError: it is stored with another type.
        InvalidKnowledgeError: it is missing, and not well formed.
    """
    expect(dto, PddlObjectDto, role)
    expect(dto.type, PddlTypeDto, "the type of an object")
    stored = transaction.definitions.objects.named(dto.name)
    if stored is None:
        return put_object(transaction, dto, cascade=False)[0]
    check_object(transaction, dto, stored, role)
    return stored


def put_object(
    transaction: Transaction, dto: PddlObjectDto, cascade: bool
) -> tuple[ObjectDefinition, bool]:
    """Define an object as a DTO says.

    Args:
        transaction: the transaction.
        dto: the object.
        cascade: whether a redefinition retracts what depends on the present definition.

    Returns:
        The object, and whether it has changed.
    """
    check_name("object", dto.name)
    type_ids = ensure_types(transaction, dto.type, f"object {dto.name!r}")
    stored = transaction.definitions.objects.named(dto.name)
    id_, name = (stored.id, stored.name) if stored else transaction.intern("object", dto.name)
    live = transaction.definitions.types.live
    types = either_text(live(type_id).name for type_id in type_ids)
    is_constant = flag(dto.is_constant, f"is_constant of object {dto.name!r}")
    text = object_text(name, types, is_constant)
    definition = ObjectDefinition(id_, name, type_ids[0], text, type_ids[1:], is_constant)
    if stored is not None and stored.type_ids != type_ids:
        clear_for_redefinition(
            transaction,
            Scope(objects={id_}),
            f"object {stored.text}",
            f"'{definition.text}'",
            cascade,
        )
    return definition, transaction.define("object", definition)


def object_text(name: str, types: str, is_constant: bool) -> str:
    """Write an object down.

    Args:
        name: its name.
        types: its type as text.
        is_constant: whether the domain declares it.

    Returns:
        The text, for example `rb1 - robot`, or `(:constants rb1 - robot)`.
    """
    text = f"{name} - {types}"
    return f"(:constants {text})" if is_constant else text


class SqlObjectDao(SqlNamedDao[PddlObjectDto], PddlObjectDao):
    """Objects in an SQL store."""

    kind: ClassVar[str] = "object"
    dto_class = PddlObjectDto

    def _build(self, builder: DtoBuilder, definition: ObjectDefinition) -> PddlObjectDto:
        return builder.object(definition.id)

    def _put(self, transaction: Transaction, dto: PddlObjectDto, cascade: bool) -> bool:
        return put_object(transaction, dto, cascade)[1]

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        delete_scope(transaction, Scope(objects=set(ids)))
