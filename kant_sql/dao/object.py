"""Objects: how they are defined, and their DAO."""

from __future__ import annotations

from collections.abc import Hashable
from typing import ClassVar

from typing_extensions import override

from ..arguments import expect, flag
from ..dto import PddlObjectDto, PddlTypeDto
from ..dto.lexical import ROOT_TYPE, fold
from ..knowledge.canonical import type_text
from ..knowledge.definitions import Definitions, ObjectDefinition
from ..pddl.given import read_object
from ..store.transaction import Transaction
from .base import Definer, DtoBuilder, SqlNamedDao
from .interfaces import PddlObjectDao
from .known import refuse_unknown
from .type import ensure_types, plain_type


class ObjectDefiner(Definer[PddlObjectDto, ObjectDefinition]):
    """Defines objects."""

    kind = "object"
    dto_class = PddlObjectDto

    def _reference(self, dto: PddlObjectDto) -> Hashable:
        if type(dto) is not PddlObjectDto or type(dto.name) is not str:
            return None
        of = plain_type(dto.type)
        return None if of is None else ("object", dto.name, of)

    def _make(
        self, transaction: Transaction, dto: PddlObjectDto, stored: ObjectDefinition | None
    ) -> ObjectDefinition:
        type_ids = ensure_types(transaction, dto.type, f"object {dto.name!r}")
        identity = self._identity(transaction, dto, stored)
        is_constant = flag(dto.is_constant, f"is_constant of object {dto.name!r}")
        return ObjectDefinition(*identity, type_ids[0], type_ids[1:], is_constant)

    def _keeps(self, stored: ObjectDefinition, made: ObjectDefinition) -> bool:
        return stored.type_ids == made.type_ids

    def _agrees(
        self, transaction: Transaction, dto: PddlObjectDto, stored: ObjectDefinition
    ) -> bool:
        expect(dto.type, PddlTypeDto, "the type of an object")
        name = type_text(transaction.definitions, stored.type_ids)
        if dto.type.parent is None and dto.type.name == name:
            return True
        if fold(dto.type.name) != fold(name):
            return False
        ensure_types(transaction, dto.type, f"object {dto.name!r}")
        return True


OBJECTS = ObjectDefiner()


class SqlObjectDao(SqlNamedDao[PddlObjectDto], PddlObjectDao):
    """Objects in an SQL store."""

    kind: ClassVar[str] = "object"
    dto_class = PddlObjectDto
    _reads = staticmethod(read_object)
    definer = OBJECTS

    @override
    def get_by_type(self, name: str) -> list[PddlObjectDto]:
        def find(definitions: Definitions) -> list[PddlObjectDto] | None:
            builder = DtoBuilder(definitions)
            wanted = definitions.types.named(name)
            if fold(name) == ROOT_TYPE:
                return [builder.object(each.id) for each in definitions.objects]
            if wanted is None:
                return None
            types = definitions.subtypes(wanted.id)
            return [
                builder.object(each.id)
                for each in definitions.objects
                if not types.isdisjoint(each.type_ids)
            ]

        found = self._open_store.read_definitions(find, self._at)
        if found is None:
            refuse_unknown(self._open_store, name, "type")
        return found or []
