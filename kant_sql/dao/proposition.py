"""Propositions: the DAO of facts and goals."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import ColumnElement, bindparam, false, literal_column, select

from ..arguments import expect, expect_list, flag
from ..atoms import AtomKey
from ..backends import in_rows
from ..dto import PddlObjectDto, PddlPredicateDto, PddlPropositionDto
from ..errors import each_readable
from ..knowledge.loading import KB
from ..knowledge.past import ANY_PREDICATE, held_then
from ..knowledge.rows import table_of
from ..tables import PropositionRow, PropositionVersionRow
from ..transaction import Transaction
from ..view import View
from .base import SqlDao, batches
from .builder import DtoBuilder
from .dependants import propositions_on, retract
from .interfaces import PddlPropositionDao
from .reading import NO_ID, Reading
from .references import References

_COLUMNS = (
    PropositionRow.id,
    PropositionRow.predicate_id,
    PropositionRow.arguments,
    PropositionRow.is_goal,
)
_NOW, _THEN = PropositionVersionRow.until.is_(None), held_then(PropositionVersionRow)


class PropositionReading(Reading):
    """One question about propositions, as asked of the present and of the past."""

    @classmethod
    def of_versions(cls, *conditions: ColumnElement[bool]) -> PropositionReading:
        """Ask for the propositions of the versions that are open.

        Args:
            *conditions: what else is asked of the versions.

        Returns:
            The question.
        """
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
        """Ask it.

        Args:
            view: the state to read from.
            **parameters: the question's parameters.

        Returns:
            The propositions, in the order in which each was first known.
        """
        proposition = DtoBuilder(view.definitions).proposition
        rows = [*self.rows(view, **parameters)]
        return each_readable("proposition", rows, lambda row: proposition(*row[1:]))


_ALL = PropositionReading.of_versions()
_OF_PREDICATE = PropositionReading.of_versions(
    PropositionVersionRow.predicate_id == bindparam("predicate")
)
GOALS = PropositionReading.of_versions(table_of(PropositionVersionRow).c.is_goal)


def existing_key(transaction: Transaction, dto: PddlPropositionDto) -> AtomKey | None:
    """Find what makes a proposition the one that it is, from names alone.

    Args:
        transaction: the transaction.
        dto: the proposition.

    Returns:
        The key; None when a name in it is not known, so that it cannot hold.
    """
    expect(dto.predicate, PddlPredicateDto, "the predicate of a proposition")
    predicate = transaction.definitions.predicates.named(dto.predicate.name)
    ids = transaction.definitions.arguments(object_.name for object_ in dto.objects)
    if predicate is None or ids is None:
        return None
    return AtomKey(flag(dto.is_goal, "is_goal of a proposition"), predicate.id, ids)


class SqlPropositionDao(SqlDao, PddlPropositionDao):
    """Propositions in an SQL store."""

    def get_all(self) -> list[PddlPropositionDto]:
        """Read all facts and goals."""
        return self._store.read(_ALL.answer, self._at)

    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        """Read the facts and the goals of one predicate."""

        def work(view: View) -> list[PddlPropositionDto]:
            predicate = view.definitions.predicates.named(name)
            # Asked even of no predicate: the head may say that there is one by now.
            id_ = NO_ID if predicate is None else predicate.id
            return _OF_PREDICATE.answer(view, predicate=id_)

        return self._store.read(work, self._at)

    def get_goals(self) -> list[PddlPropositionDto]:
        """Read the goals."""
        return self._store.read(GOALS.answer, self._at)

    def get_no_goals(self) -> list[PddlPropositionDto]:
        """Read the facts."""
        return [dto for dto in self.get_all() if not dto.is_goal]

    def save(self, dto: PddlPropositionDto) -> bool:
        """Let a proposition hold."""
        self._check(dto)
        self._store.write(lambda transaction: self._save_batch(transaction, [dto]))
        return True

    def insert(self, dto: PddlPropositionDto) -> bool:
        """Let a proposition hold that does not hold yet."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            return not self._holds(transaction, dto) and self._save_batch(transaction, [dto]) == 1

        return self._store.write(work)

    def update(self, dto: PddlPropositionDto) -> bool:
        """Tell whether a proposition holds: there is nothing else of it to update."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            if not self._holds(transaction, dto):
                return False
            References(transaction).resolve(dto)
            return True

        return self._store.write(work)

    def save_all(self, dtos: Iterable[PddlPropositionDto]) -> int:
        """Let many propositions hold, in one revision."""
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(dtos):
                for dto in batch:
                    self._check(dto)
                names = (object_.name for dto in batch for object_ in dto.objects)
                # What has no name is refused in its turn.
                transaction.look_up("object", {name for name in names if isinstance(name, str)})
                with transaction.batch():
                    changed += self._save_batch(transaction, batch)
                transaction.propositions.spill()
        return changed

    def delete(self, dto: PddlPropositionDto) -> bool:
        """Let a proposition hold no more."""
        self._check(dto)

        def work(transaction: Transaction) -> bool:
            atom = self._find(transaction, dto)
            return atom is not None and transaction.propositions.set(atom, False)

        return self._store.write(work)

    def delete_all(self) -> int:
        """Let nothing hold, and no goal stand."""
        self._check_writable()

        def work(transaction: Transaction) -> int:
            atoms = propositions_on(transaction, None)
            retract(transaction, atoms)
            return len(atoms)

        return self._store.write(work)

    def _check(self, dto: PddlPropositionDto) -> None:
        self._check_writable()
        expect(dto, PddlPropositionDto, "what the proposition DAO takes")
        expect_list(dto.objects, PddlObjectDto, "the list of objects of a proposition")

    @staticmethod
    def _save_batch(transaction: Transaction, dtos: Iterable[PddlPropositionDto]) -> int:
        resolve = References(transaction).resolve
        return transaction.propositions.hold_all(dict([resolve(dto) for dto in dtos]))

    @classmethod
    def _holds(cls, transaction: Transaction, dto: PddlPropositionDto) -> bool:
        atom = cls._find(transaction, dto)
        return atom is not None and transaction.propositions.holds(atom)

    @staticmethod
    def _find(transaction: Transaction, dto: PddlPropositionDto) -> Any:
        key = existing_key(transaction, dto)
        return None if key is None else transaction.propositions.find([key]).get(key)
