"""Propositions: the DAO of facts, and the references of facts and goals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import timedelta
from typing import Any, ClassVar, Self

from sqlalchemy import ColumnElement, String, bindparam, case, false, or_, select
from typing_extensions import override

from ..arguments import expect, expect_list, flag, period, shown
from ..dto import PddlObjectDto, PddlPredicateDto, PddlPropositionDto
from ..dto.elements import atom_text
from ..dto.formulas import Atom, Node
from ..errors import ArityError, InvalidKnowledgeError, PddlError, TypeMismatchError, all_readable
from ..html import Listing
from ..knowledge.atoms import AtomKey
from ..knowledge.canonical import type_text
from ..knowledge.definitions import FunctionDefinition, ObjectDefinition, PredicateDefinition
from ..knowledge.rules import rules_of
from ..pddl.given import read_fact
from ..sql import tables as t
from ..sql.intervals import ANY_PREDICATE, held_then
from ..sql.query import Query, constant, first_rows, in_list, in_rows, integer
from ..sql.rows import KB, THEN, looked_up, table_of
from ..sql.valid_time import OWN
from ..store.snapshot import View
from ..store.transaction import Transaction
from .base import DtoBuilder, Reading, SqlGroundDao, batches
from .dependants import propositions_on, retract
from .interfaces import FactLike, PddlPropositionDao
from .signatures import PREDICATES
from .text import expect_text, read_stored, read_text
from .type import OBJECTS

FACT = "(robot_at rb1 wp1)"


class Arguments:
    """The objects of the elements of one batch."""

    role: ClassVar[str]

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction

    def check(
        self,
        shown: object,
        declared: PredicateDefinition | FunctionDefinition,
        objects: Sequence[PddlObjectDto | str],
    ) -> list[ObjectDefinition]:
        """Check arguments, and save missing ones."""
        if len(objects) != len(declared.parameters):
            raise ArityError(
                f"{shown} has {len(objects)} arguments, expected {len(declared.parameters)} as "
                f"in {declared.text}"
            )
        found: list[ObjectDefinition] = []
        definitions = self._transaction.definitions
        for parameter, object_dto in zip(declared.parameters, objects, strict=True):
            object_ = OBJECTS.ensure(self._transaction, object_dto, self.role)
            allowed = parameter.type_ids
            if object_.type_id not in allowed and not definitions.any_fits(
                object_.type_ids, allowed
            ):
                role = f"{shown}: argument {len(found) + 1}"
                raise self.mismatch(role, object_, allowed, declared.text)
            found.append(object_)
        return found

    def mismatch(
        self, role: str, object_: ObjectDefinition, allowed: Sequence[int], declared: str
    ) -> TypeMismatchError:
        """Make the error for an object that does not fit its parameter."""
        definitions = self._transaction.definitions
        return TypeMismatchError(
            f"{role}, {object_.name!r}, is of type "
            f"{type_text(definitions, object_.type_ids)!r}, expected "
            f"{type_text(definitions, allowed)!r} or a subtype, as in {declared}"
        )


class References(Arguments):
    """The references of the propositions of one batch."""

    role = "a proposition"

    def __init__(self, transaction: Transaction, *, are_goals: bool) -> None:
        super().__init__(transaction)
        self._are_goals = are_goals

    def resolve(self, given: FactLike) -> tuple[AtomKey, str]:
        """Check a proposition; save missing elements that a DTO refers to."""
        if isinstance(given, str | Node):
            atom = read_text(self._transaction, read_fact, given)
            predicate = PREDICATES.ensure(self._transaction, atom.predicate, self.role)
            objects = self.check(atom, predicate, [str(term) for term in atom.terms])
        else:
            predicate = PREDICATES.ensure(self._transaction, given.predicate, self.role)
            objects = self.check(given, predicate, given.objects)
        ids = " ".join([str(object_.id) for object_ in objects])
        text = atom_text(predicate.name, [object_.name for object_ in objects])
        return AtomKey(self._are_goals, predicate.id, ids), text


_COLUMNS = (
    t.PropositionRow.id,
    t.PropositionRow.predicate_id,
    t.PropositionRow.arguments,
    t.PropositionRow.is_goal,
)
_NOW, _THEN = t.PropositionVersionRow.until.is_(None), held_then(t.PropositionVersionRow)


class PropositionReading(Reading):
    """A query of propositions, with a statement for the present and one for the past."""

    are_goals = False

    @classmethod
    def of_versions(cls, *conditions: ColumnElement[bool], are_goals: bool = False) -> Self:
        """Query the facts, or the goals, of open versions."""
        versions = select(t.PropositionVersionRow.proposition_id).where(
            t.PropositionVersionRow.kb_id == KB, *conditions
        )
        now, then = (
            select(*_COLUMNS).where(
                t.PropositionRow.kb_id == KB, in_rows(t.PropositionRow.id, versions.where(*held))
            )
            for held in ((_NOW,), (_THEN, *([] if conditions else [ANY_PREDICATE])))
        )
        made = cls(now, then, constant(""), false())
        made.are_goals = are_goals
        return made

    @classmethod
    def of_object(cls) -> Self:
        """Query the propositions that mention an object: look one version up for each."""
        mentioning = select(t.PropositionArgumentRow.proposition_id).where(
            t.PropositionArgumentRow.kb_id == KB,
            t.PropositionArgumentRow.object_id == integer("object"),
        )
        version = table_of(t.PropositionVersionRow).alias(OWN).c
        holds = case((or_(version.until.is_(None), version.until > THEN), constant(1)))
        last = select(holds).where(
            version.kb_id == KB,
            version.proposition_id == t.PropositionRow.id,
            version.since <= THEN,
        )
        last = first_rows(last.order_by(version.since.desc()), 1)
        is_open = version.until.is_(None)
        now, then = (
            select(*_COLUMNS).where(
                t.PropositionRow.kb_id == KB,
                in_rows(t.PropositionRow.id, mentioning),
                held.is_not(None),
            )
            for held in (
                looked_up(
                    version.proposition_id, version.proposition_id, t.PropositionRow.id, is_open
                ),
                last.scalar_subquery(),
            )
        )
        return cls(now, then, constant(""), false(), is_of_any_state=True)

    def answer(self, view: View, **parameters: Any) -> list[PddlPropositionDto]:
        """Run it on a state."""
        build = DtoBuilder(view.definitions).propositions
        found = [row for row in self.rows(view, **parameters) if bool(row[3]) is self.are_goals]
        return all_readable("proposition", found, build)


_ALL = PropositionReading.of_versions()
_OF_OBJECT = PropositionReading.of_object()
_OF_PREDICATE = PropositionReading.of_versions(
    t.PropositionVersionRow.predicate_id == bindparam("predicate")
)
GOALS = PropositionReading.of_versions(table_of(t.PropositionVersionRow).c.is_goal, are_goals=True)


def existing_key(transaction: Transaction, given: FactLike, *, is_goal: bool) -> AtomKey | None:
    """Find the key of a proposition by names alone; text must name elements known at some time."""
    if isinstance(given, str | Node):
        atom = read_stored(transaction, read_fact, given)
        return None if atom is None else key_of_atom(transaction, atom, is_goal)
    dto = given
    expect(dto.predicate, PddlPredicateDto, "the predicate of a proposition")
    definitions = transaction.definitions.current()
    predicate = definitions.predicates.named(dto.predicate.name)
    ids = definitions.arguments([object_.name for object_ in dto.objects])
    if predicate is None or ids is None:
        return None
    return AtomKey(is_goal, predicate.id, ids)


def _key_to_confirm(transaction: Transaction, fact: FactLike) -> AtomKey | None:
    """Find the key of a fact to confirm; refuse a value, which has no confirmations."""
    try:
        return existing_key(transaction, fact, is_goal=False)
    except PddlError as error:
        name = str(fact).translate(_NO_WORDS).split()[:1]
        if not name or transaction.definitions.functions.named(name[0]) is None:
            raise
        raise InvalidKnowledgeError(
            f"{shown(fact)} is a value, and values have no confirmations: save the measured value "
            "with kb.function_values"
        ) from error


_NO_WORDS = str.maketrans("()=", "   ")


def check_dto(dto: PddlPropositionDto) -> None:
    """Refuse a proposition whose fields have wrong types."""
    expect_list(dto.objects, PddlObjectDto, "the list of objects of a proposition")
    flag(dto.is_goal, "is_goal of a proposition")


def key_of_atom(transaction: Transaction, atom: Atom, is_goal: bool) -> AtomKey | None:
    """Return the key of a ground atom; None if it has an unknown name."""
    predicate = transaction.definitions.predicates.named(atom.predicate)
    ids = transaction.definitions.arguments(map(str, atom.terms))
    return None if predicate is None or ids is None else AtomKey(is_goal, predicate.id, ids)


def retract_all(transaction: Transaction, *, are_goals: bool) -> int:
    """Delete all facts, or all goals that are propositions; return their number."""
    atoms = [atom for atom in propositions_on(transaction, None) if atom.key.is_goal is are_goals]
    retract(transaction, atoms)
    return len(atoms)


_CONFIRMED, _REVISION = table_of(t.ConfirmationRow).c, table_of(t.RevisionRow).c
# Times never go back, so the first revision after a moment is the first by number.
_FIRST = first_rows(
    select(_REVISION.number)
    .where(_REVISION.kb_id == KB, _REVISION.committed_at > bindparam("after"))
    .order_by(_REVISION.committed_at, _REVISION.number),
    1,
).scalar_subquery()
_ACTOR = looked_up(_REVISION.actor, _REVISION.number, _CONFIRMED.since)
_HELD = table_of(t.PropositionVersionRow).c
# A fact that was retracted and saved again since is another effect, which nobody has confirmed.
_SINCE = looked_up(
    _HELD.since, _HELD.proposition_id, _CONFIRMED.proposition_id, _HELD.until.is_(None)
)
# The facts that an actor has confirmed since a moment, and since they began to hold.
_RECENT = Query(
    select(_CONFIRMED.proposition_id).where(
        _CONFIRMED.kb_id == KB,
        in_list(_CONFIRMED.proposition_id, "ids", bounded=_CONFIRMED.since),
        _CONFIRMED.since >= _FIRST,
        _CONFIRMED.since >= _SINCE,
        _ACTOR.is_not_distinct_from(bindparam("actor", type_=String)),
    )
)


class SqlPropositionDao(SqlGroundDao[FactLike], PddlPropositionDao):
    """Propositions in an SQL store."""

    @override
    def get_all(self) -> list[PddlPropositionDto]:
        return Listing(self._store.read(_ALL.answer, self._at), "element")

    @override
    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        return self._of_named(
            "predicate", name, "fact", lambda view, id_: _OF_PREDICATE.answer(view, predicate=id_)
        )

    @override
    def get_by_object(self, name: str) -> list[PddlPropositionDto]:
        return self._of_named(
            "object", name, "fact", lambda view, id_: _OF_OBJECT.answer(view, object=id_)
        )

    # Defined here so that `help` shows its arguments.
    @override
    def save(self, dto: FactLike | Sequence[FactLike]) -> bool:
        return super().save(dto)

    @override
    def confirm(
        self, facts: FactLike | Iterable[FactLike], *, not_within: float | None = None
    ) -> int:
        self._check_writable()
        within = None if not_within is None else period(not_within, "not_within")
        several = isinstance(facts, Iterable) and not isinstance(facts, str | bytes)
        wanted: Any = facts if several else [facts]
        confirmed = 0
        with self._store.transaction() as transaction:
            for batch in batches(wanted):
                for fact in batch:
                    self._check(fact)
                confirmed += self._confirm_batch(transaction, batch, within)
        return confirmed

    def _remove(self, transaction: Transaction, dto: FactLike) -> bool:
        key = existing_key(transaction, dto, is_goal=False)
        atom = transaction.propositions.find_or_say(key, transaction.definitions)
        return atom is not None and transaction.propositions.set(atom, False)

    def _check(self, dto: object) -> None:
        self._check_writable()
        if isinstance(dto, PddlPropositionDto):
            check_dto(dto)
            if dto.is_goal:
                raise InvalidKnowledgeError(
                    f"{dto} is a goal (is_goal=True), and kb.propositions takes facts; give goals "
                    f"to kb.goals: kb.goals.save('{dto}')"
                )
        else:
            expect_text(dto, "the proposition DAO", "a fact", FACT, PddlPropositionDto)

    def _save_batch(self, transaction: Transaction, dtos: Iterable[FactLike]) -> int:
        texts = dict(map(References(transaction, are_goals=False).resolve, dtos))
        changed = transaction.propositions.hold_all(texts)
        if transaction.confirms:
            transaction.confirm(transaction.propositions.find(texts).values())
        return changed

    def _confirm_batch(
        self, transaction: Transaction, facts: Sequence[FactLike], within: timedelta | None
    ) -> int:
        """Confirm facts, with a bounded number of statements."""
        ledger = transaction.propositions
        keys = [_key_to_confirm(transaction, fact) for fact in facts]
        atoms = ledger.find([key for key in keys if key is not None])
        ledger.load(atoms.values())
        for fact, key in zip(facts, keys, strict=True):
            if key is None or key not in atoms or not ledger.holds(atoms[key]):
                rules = rules_of(transaction.definitions.current())
                if key is not None and rules.of(key.predicate_id):
                    raise InvalidKnowledgeError(
                        f"{fact} is not stored, as rules derive it, so it cannot be confirmed; "
                        "nothing was confirmed: confirm the facts that it follows from"
                    )
                raise InvalidKnowledgeError(
                    f"{fact} does not hold, so it cannot be confirmed; nothing was confirmed: save "
                    f"it, as in kb.propositions.save('{fact}')"
                )
        recent: set[int] = set()
        if within is not None:
            session = transaction.session
            ids = session.list_value([atom.id for atom in atoms.values()])
            after = session.from_time(transaction.head.clock - within)
            given = {"ids": ids, "actor": transaction.metadata.actor, "after": after}
            recent = {id_ for (id_,) in session.rows(_RECENT, kb=transaction.kb_id, **given)}
        return transaction.confirm(atom for atom in atoms.values() if atom.id not in recent)

    def _holds(self, transaction: Transaction, dto: FactLike) -> bool:
        atom = transaction.propositions.find_one(existing_key(transaction, dto, is_goal=False))
        return atom is not None and transaction.propositions.holds(atom)

    def _remove_all(self, transaction: Transaction) -> int:
        self._refuse_all_of_past(transaction)
        return retract_all(transaction, are_goals=False)
