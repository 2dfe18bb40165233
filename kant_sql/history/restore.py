"""Restore: a new revision whose state equals that of a past one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any

from sqlalchemy import Select, literal_column, select, union_all

from ..dao.base import batches
from ..knowledge.definitions import KINDS
from ..sql.definitions import load_at
from ..sql.dialects.base import Row
from ..sql.query import Query, in_list
from ..sql.rows import KB, THEN, table_of
from ..sql.tables import (
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)
from ..store.caches import AtomKey, FluentKey, FluentValue, GroundAtom, GroundFluent, read_value
from ..store.store import Store
from ..store.transaction import Transaction
from .revisions import refuse_archived


def _moved(version: Any, owner: Any, *columns: Any) -> Query:
    """Select the versions that held then and ended since, and those that began since and hold."""
    past: Select[Any] = select(owner.label("owner"), literal_column("1").label("past"), *columns)
    now: Select[Any] = select(owner.label("owner"), literal_column("0").label("past"), *columns)
    return Query(
        union_all(
            past.where(version.kb_id == KB, version.since <= THEN, version.until > THEN),
            now.where(version.kb_id == KB, version.since > THEN, version.until.is_(None)),
        ).order_by("owner", "past")
    )


_PROPOSITION = table_of(PropositionVersionRow).c
_VALUE = table_of(FunctionValueVersionRow).c
_MOVED_PROPOSITIONS = _moved(_PROPOSITION, _PROPOSITION.proposition_id, _PROPOSITION.since)
_MOVED_VALUES = _moved(_VALUE, _VALUE.function_value_id, _VALUE.text, _VALUE.object_id)
THENOMS = Query(
    select(
        PropositionRow.id,
        PropositionRow.is_goal,
        PropositionRow.predicate_id,
        PropositionRow.arguments,
        PropositionRow.text,
    ).where(PropositionRow.kb_id == KB, in_list(PropositionRow.id, "ids"))
)
_FLUENTS = Query(
    select(
        FunctionValueRow.id,
        FunctionValueRow.function_id,
        FunctionValueRow.arguments,
        FunctionValueRow.text,
    ).where(FunctionValueRow.kb_id == KB, in_list(FunctionValueRow.id, "ids"))
)


def restore(store: Store, revision: int, reason: str | None, actor: str | None) -> int | None:
    """Restore a past revision; return the new one."""
    why = f"restored revision {revision}" if reason is None else reason
    is_part = store.current() is not None
    with store.transaction(actor, why) as transaction:
        if revision < transaction.head.archived_revision:
            # It was archived after the caller's check.
            refuse_archived(store, revision)
        # The statements below see what the transaction changed so far.
        transaction.flush()
        _restore_definitions(transaction, revision)
        _restore_propositions(transaction, revision, not is_part)
        _restore_values(transaction, revision)
    made = transaction.committed
    return None if is_part or made is None else made.number


def _restore_definitions(transaction: Transaction, at: int) -> None:
    past = load_at(transaction.session, transaction.kb_id, at)
    for kind in KINDS:
        elements, wanted = transaction.definitions.elements(kind), past.elements(kind)
        for definition in list(elements):
            if wanted.get(definition.id) is None:
                transaction.undefine(kind, definition.id)
        for definition in wanted:
            transaction.redefine(kind, definition)


def _restore_propositions(transaction: Transaction, at: int, is_new: bool) -> None:
    """Restore propositions. A new transaction has no pending ones: the tables say what holds."""
    propositions = transaction.propositions
    moved = transaction.session.stream(_MOVED_PROPOSITIONS, kb=transaction.kb_id, at=at)
    # By proposition id: the revision of its open version; None without one.
    differing: dict[int, int | None] = {}
    for id_, rows in groupby(moved, key=lambda row: row[0]):
        first, *others = rows
        if not others:
            differing[id_] = None if first[1] else first[2]
    for batch in batches(differing):
        atoms = _atoms(transaction, batch)
        if is_new:
            propositions.note(
                {atom.id: None if differing[atom.id] is None else atom for atom in atoms}
            )
        else:
            propositions.load(atoms)
        for atom in atoms:
            propositions.set(atom, differing[atom.id] is None)
        transaction.spill()


def _atoms(transaction: Transaction, ids: list[int]) -> list[GroundAtom]:
    session = transaction.session
    rows = session.rows(THENOMS, kb=transaction.kb_id, ids=session.list_value(ids))
    return [
        GroundAtom(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)
        for id_, is_goal, predicate_id, arguments, text in rows
    ]


def _restore_values(transaction: Transaction, at: int) -> None:
    moved = transaction.session.stream(_MOVED_VALUES, kb=transaction.kb_id, at=at)
    then = dict(_values_then(moved))
    for batch in batches(then):
        fluents = _fluents(transaction, batch)
        transaction.values.load(fluents)
        for fluent in fluents:
            transaction.values.spell(fluent, _value(fluent, *then[fluent.id]))


def _values_then(moved: Iterable[Row]) -> Iterator[tuple[int, tuple[str | None, int | None]]]:
    """Yield each fluent whose value differs by now, with the text and object that it was."""
    for id_, rows in groupby(moved, key=lambda row: row[0]):
        held = {bool(past): (text, object_id) for _, past, text, object_id in rows}
        if held.get(True) != held.get(False):
            yield id_, held.get(True, (None, None))


def _value(fluent: GroundFluent, text: str | None, object_id: int | None) -> FluentValue | None:
    return None if text is None else read_value(fluent.text, text, object_id)


def _fluents(transaction: Transaction, ids: list[int]) -> list[GroundFluent]:
    session = transaction.session
    rows = session.rows(_FLUENTS, kb=transaction.kb_id, ids=session.list_value(ids))
    return [
        GroundFluent(id_, FluentKey(function_id, arguments), text)
        for id_, function_id, arguments, text in rows
    ]
