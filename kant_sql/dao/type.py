"""Types and objects: their definitions, references to them, and the DAOs."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence

from typing_extensions import override

from ..arguments import expect, expect_list, flag
from ..dto import PddlEitherTypeDto, PddlObjectDto, PddlTypeDto
from ..dto.lexical import ROOT_TYPE, check_name, fold
from ..errors import InvalidKnowledgeError, TypeCycleError
from ..html import Listing
from ..knowledge.canonical import type_text
from ..knowledge.definitions import Definitions, ObjectDefinition, TypeDefinition
from ..knowledge.trees import Mentioned
from ..pddl.given import read_object, read_type
from ..store.transaction import Transaction
from .base import Definer, DtoBuilder, SqlNamedDao
from .dependants import of_types
from .interfaces import PddlObjectDao, PddlTypeDao
from .text import refuse_unknown


class TypeDefiner(Definer[PddlTypeDto, TypeDefinition]):
    """Defines types, from the top of their hierarchy."""

    kind = "type"
    dto_class = PddlTypeDto

    def put(self, transaction: Transaction, dto: PddlTypeDto, cascade: bool) -> bool:
        """Insert or redefine a type; return whether it changed."""
        check_name("type", dto.name)
        if dto.parent is not None:
            self._ensure_above(transaction, dto, is_saved=True)
        return super().put(transaction, dto, cascade)

    def scope(self, definitions: Definitions, ids: Collection[int]) -> Mentioned:
        """Find the elements that are defined in terms of some types or their subtypes."""
        return of_types(definitions, ids)

    def _find(self, transaction: Transaction, dto: PddlTypeDto, role: str) -> TypeDefinition:
        if dto.parent is not None:
            self._ensure_above(transaction, dto, is_saved=False)
        return super()._find(transaction, dto, role)

    def _reference(self, dto: PddlTypeDto) -> Hashable:
        name = plain_type(dto)
        return None if name is None else ("type", name)

    def _make(
        self, transaction: Transaction, dto: PddlTypeDto, stored: TypeDefinition | None
    ) -> TypeDefinition:
        types = transaction.definitions.types
        known = [types.named(parent.name) for parent in _parents(dto)]
        if not known and dto.parent is not None:
            raise InvalidKnowledgeError(
                f"the type of type {dto.name!r} is 'either' of no types; give at least one"
            )
        above = [each for each in known if each is not None]
        ids = tuple(each.id for each in above)
        if stored is not None and stored.parent_ids != ids:
            if transaction.agreed_types:
                transaction.agreed_types.clear()
            for parent in above:
                _check_cycle(transaction, stored, parent)
        identity = self._identity(transaction, dto, stored)
        return TypeDefinition(*identity, ids[0] if ids else None, ids[1:])

    def _keeps(self, stored: TypeDefinition, made: TypeDefinition) -> bool:
        return stored.parent_ids == made.parent_ids

    def _agrees(self, transaction: Transaction, dto: PddlTypeDto, stored: TypeDefinition) -> bool:
        if dto.parent is None:
            return True
        above = stored.parent_ids
        # The root is the parent of types that state none.
        parent = type_text(transaction.definitions, above) if above else ROOT_TYPE
        return fold(parent) == fold(dto.parent.name)

    def _ensure_above(self, transaction: Transaction, dto: PddlTypeDto, is_saved: bool) -> None:
        """Find or save all supertypes of a type, from the top: hierarchies may be of any depth."""
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
                    super()._find(transaction, current, role)
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


TYPES = TypeDefiner()

# With more ancestors than this, types are compared one by one.
_PLAIN_DEPTH = 8


def plain_type(dto: PddlTypeDto) -> Hashable:
    """Return the names of a referenced type and its supertypes; None if the DTO states more."""
    if type(dto) is not PddlTypeDto or type(dto.name) is not str:
        return None
    if dto.parent is None:
        return dto.name
    names: list[str] = []
    above: PddlTypeDto | None = dto
    while above is not None:
        is_plain = type(above) is PddlTypeDto and type(above.name) is str
        if not is_plain or len(names) == _PLAIN_DEPTH:
            return None
        names.append(above.name)
        above = above.parent
    return tuple(names)


def plain_types(dtos: object) -> Hashable:
    """Return `plain_type` of each type in a list; None if one of them is None."""
    if type(dtos) is not list:
        return None
    found = tuple(map(plain_type, dtos))
    return None if None in found else found


def _agrees_alone(transaction: Transaction, dto: PddlTypeDto) -> bool:
    """Return whether the supertypes need no check: the type is stored, its parent states none."""
    parent = dto.parent
    return (
        isinstance(parent, PddlTypeDto)
        and not isinstance(parent, PddlEitherTypeDto)
        and parent.parent is None
        and transaction.definitions.types.named(dto.name) is not None
    )


def _parents(dto: PddlTypeDto) -> Sequence[PddlTypeDto]:
    """Return the direct supertypes of a type, from its DTO."""
    if dto.parent is None:
        return ()
    expect(dto.parent, PddlTypeDto, f"the parent of type {dto.name!r}")
    if isinstance(dto.parent, PddlEitherTypeDto):
        return expect_list(dto.parent.types, PddlTypeDto, f"the parents of {dto.name!r}")
    return (dto.parent,)


def ensure_types(transaction: Transaction, dto: PddlTypeDto, role: str) -> tuple[int, ...]:
    """Find the types that an element's type stands for; save missing ones."""
    if not isinstance(dto, PddlEitherTypeDto):
        return (TYPES.ensure(transaction, dto, role).id,)
    types = expect_list(dto.types, PddlTypeDto, f"the list of types of {role}")
    if not types:
        raise InvalidKnowledgeError(
            f"the type of {role} is 'either' of no types; give at least one"
        )
    return tuple(TYPES.ensure(transaction, type_, role).id for type_ in types)


def _check_cycle(transaction: Transaction, type_: TypeDefinition, parent: TypeDefinition) -> None:
    chain = list(transaction.definitions.ancestry(parent.id))
    if any(above.id == type_.id for above in chain):
        path = " - ".join([type_.name, *(above.name for above in chain)])
        raise TypeCycleError(
            f"type {type_.name!r} would be its own ancestor: {path}; choose another parent"
        )


class SqlTypeDao(SqlNamedDao[PddlTypeDto], PddlTypeDao):
    """Types in an SQL store."""

    _reads = staticmethod(read_type)
    definer = TYPES


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

    _reads = staticmethod(read_object)
    definer = OBJECTS

    @override
    def _dto(self, transaction: Transaction, given: PddlObjectDto | str) -> PddlObjectDto:
        dto = super()._dto(transaction, given)
        if isinstance(given, str):
            # A text cannot express it, so keep it.
            stored = transaction.definitions.objects.named(dto.name)
            dto.set_is_constant(stored is not None and stored.is_constant)
        return dto

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

        found = self._store.read_definitions(find, self._at)
        if found is None:
            refuse_unknown(self._store, name, "type")
        return Listing(found or (), "element")
