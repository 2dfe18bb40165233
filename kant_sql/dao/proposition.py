"""Propositions: the DAO of facts and goals, and what propositions refer to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import ColumnElement, bindparam, false, literal_column, select
from typing_extensions import override

from ..arguments import expect, expect_list, flag
from ..dto import PddlObjectDto, PddlPredicateDto, PddlPropositionDto
from ..dto.elements import atom_text
from ..errors import ArityError, TypeMismatchError, all_readable
from ..knowledge.canonical import type_text
from ..knowledge.definitions import FunctionDefinition, ObjectDefinition, PredicateDefinition
from ..sql.intervals import ANY_PREDICATE, held_then
from ..sql.query import in_rows
from ..sql.rows import KB, table_of
from ..sql.tables import PropositionRow, PropositionVersionRow
from ..store.caches import AtomKey
from ..store.snapshot import View
from ..store.transaction import Transaction
from .base import NO_ID, DtoBuilder, Reading, SqlGroundDao
from .dependants import propositions_on, retract
from .interfaces import PddlPropositionDao
from .object import OBJECTS
from .predicate import PREDICATES

_ROLE = "a proposition"


class Arguments:
    """The objects that the elements of one batch refer to."""

    def __init__(self, transaction: Transaction, role: str) -> None:
        self._transaction = transaction
        self._role = role

    def check(
        self,
        shown: object,
        declared: PredicateDefinition | FunctionDefinition,
        objects: Sequence[PddlObjectDto | str],
    ) -> list[ObjectDefinition]:
        """Check arguments, and save those that are missing."""
        if len(objects) != len(declared.parameters):
            raise ArityError(
                f"{shown} has {len(objects)} arguments, expected {len(declared.parameters)} as "
                f"in {declared.text}"
            )
        found: list[ObjectDefinition] = []
        definitions = self._transaction.definitions
        for parameter, object_dto in zip(declared.parameters, objects, strict=True):
            object_ = self.object(object_dto)
            allowed = parameter.type_ids
            if object_.type_id not in allowed and not definitions.any_fits(
                object_.type_ids, allowed
            ):
                role = f"{shown}: argument {len(found) + 1}"
                raise self.mismatch(role, object_, allowed, declared.text)
            found.append(object_)
        return found

    def object(self, dto: PddlObjectDto | str) -> ObjectDefinition:
        """Find an object; save it when it is missing."""
        if isinstance(dto, str):
            return OBJECTS.known(self._transaction, dto, self._role)
        return OBJECTS.ensure(self._transaction, dto, self._role)

    def mismatch(
        self, role: str, object_: ObjectDefinition, allowed: Sequence[int], declared: str
    ) -> TypeMismatchError:
        """Make the error for an object that does not fit its place."""
        definitions = self._transaction.definitions
        return TypeMismatchError(
            f"{role}, {object_.name!r}, is of type "
            f"{type_text(definitions, object_.type_ids)!r}, expected "
            f"{type_text(definitions, allowed)!r} or a subtype, as in {declared}"
        )


class References(Arguments):
    """What the propositions of one batch refer to."""

    def __init__(self, transaction: Transaction) -> None:
        super().__init__(transaction, _ROLE)

    def resolve(self, dto: PddlPropositionDto) -> tuple[AtomKey, str]:
        """Check a proposition, and save what it refers to when it is missing."""
        predicate = PREDICATES.ensure(self._transaction, dto.predicate, _ROLE)
        objects = self.check(dto, predicate, dto.objects)
        ids = " ".join([str(object_.id) for object_ in objects])
        text = atom_text(predicate.name, [object_.name for object_ in objects])
        return AtomKey(flag(dto.is_goal, "is_goal of a proposition"), predicate.id, ids), text


_COLUMNS = (
    PropositionRow.id,
    PropositionRow.predicate_id,
    PropositionRow.arguments,
    PropositionRow.is_goal,
)
_NOW, _THEN = PropositionVersionRow.until.is_(None), held_then(PropositionVersionRow)


class PropositionReading(Reading):
    """A query of propositions, with a statement for the present and one for the past."""

    @classmethod
    def of_versions(cls, *conditions: ColumnElement[bool]) -> PropositionReading:
        """Ask for the propositions of the versions that are open."""
        versions = select(PropositionVersionRow.proposition_id).where(
            PropositionVersionRow.kb_id == KB, *conditions
        )
        now, then = (
            select(*_COLUMNS).where(
                PropositionRow.kb_id == KB, in_rows(PropositionRow.id, versions.where(*held))
            )
            for held in ((_NOW,), (_THEN, *([] if conditions else [ANY_PREDICATE])))
        )
        return cls(now, then, literal_column("''"), false())

    def answer(self, view: View, **parameters: Any) -> list[PddlPropositionDto]:
        """Run it on a state."""
        build = DtoBuilder(view.definitions).propositions
        return all_readable("proposition", self.rows(view, **parameters), build)


_ALL = PropositionReading.of_versions()
_OF_PREDICATE = PropositionReading.of_versions(
    PropositionVersionRow.predicate_id == bindparam("predicate")
)
GOALS = PropositionReading.of_versions(table_of(PropositionVersionRow).c.is_goal)


def existing_key(transaction: Transaction, dto: PddlPropositionDto) -> AtomKey | None:
    """Find the key of a proposition from names alone."""
    expect(dto.predicate, PddlPredicateDto, "the predicate of a proposition")
    definitions = transaction.definitions.current()
    predicate = definitions.predicates.named(dto.predicate.name)
    ids = definitions.arguments([object_.name for object_ in dto.objects])
    if predicate is None or ids is None:
        return None
    return AtomKey(flag(dto.is_goal, "is_goal of a proposition"), predicate.id, ids)


class SqlPropositionDao(SqlGroundDao[PddlPropositionDto], PddlPropositionDao):
    """Propositions in an SQL store."""

    @override
    def get_all(self) -> list[PddlPropositionDto]:
        return self._store.read(_ALL.answer, self._at)

    @override
    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        def work(view: View) -> list[PddlPropositionDto]:
            predicate = view.definitions.predicates.named(name)
            # Asked even without a predicate: the head may show that there is one now.
            id_ = NO_ID if predicate is None else predicate.id
            return _OF_PREDICATE.answer(view, predicate=id_)

        return self._store.read(work, self._at)

    @override
    def get_goals(self) -> list[PddlPropositionDto]:
        return self._store.read(GOALS.answer, self._at)

    @override
    def get_no_goals(self) -> list[PddlPropositionDto]:
        return [dto for dto in self.get_all() if not dto.is_goal]

    @override
    def save(self, dto: PddlPropositionDto) -> bool:
        self._check(dto)
        self._store.write(lambda transaction: self._save_batch(transaction, [dto]))
        return True

    @override
    def update(self, dto: PddlPropositionDto) -> bool:
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            if not self._holds(transaction, dto):
                return False
            References(transaction).resolve(dto)
            return True

        return self._store.write(work)

    @override
    def delete(self, dto: PddlPropositionDto) -> bool:
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            atom = self._find(transaction, dto)
            return atom is not None and transaction.propositions.set(atom, False)

        return self._store.write(work)

    def _check(self, dto: PddlPropositionDto) -> None:
        self._check_writable()
        expect(dto, PddlPropositionDto, "what the proposition DAO takes")
        expect_list(dto.objects, PddlObjectDto, "the list of objects of a proposition")

    def _save_batch(self, transaction: Transaction, dtos: Iterable[PddlPropositionDto]) -> int:
        resolve = References(transaction).resolve
        return transaction.propositions.hold_all(dict([resolve(dto) for dto in dtos]))

    def _holds(self, transaction: Transaction, dto: PddlPropositionDto) -> bool:
        atom = self._find(transaction, dto)
        return atom is not None and transaction.propositions.holds(atom)

    def _remove_all(self, transaction: Transaction) -> int:
        atoms = propositions_on(transaction, None)
        retract(transaction, atoms)
        return len(atoms)

    @staticmethod
    def _find(transaction: Transaction, dto: PddlPropositionDto) -> Any:
        key = existing_key(transaction, dto)
        return None if key is None else transaction.propositions.find([key]).get(key)
