"""Restoring: the state becomes again what it was at a past revision."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Select,
    bindparam,
    literal_column,
    select,
    union_all,
)

from ..atoms import Atom, AtomKey
from ..backends import Query, Row, in_list
from ..dao.base import batches
from ..dto.name import fold
from ..fluents import Fluent, FluentKey, FluentValue, read_value
from ..knowledge.definitions import KINDS
from ..knowledge.loading import KB, load_at
from ..knowledge.rows import table_of
from ..store import Store
from ..tables import (
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)
from ..transaction import Transaction
from .revisions import refuse_archived

_AT: ColumnElement[int] = bindparam("at", type_=BigInteger)


def _moved(version: Any, owner: Any, *columns: Any) -> Query:
    """Read what held then and ended since, and what came since and holds."""
    past: Select[Any] = select(owner.label("owner"), literal_column("1").label("past"), *columns)
    now: Select[Any] = select(owner.label("owner"), literal_column("0").label("past"), *columns)
    return Query(
        union_all(
            past.where(version.kb_id == KB, version.since <= _AT, version.until > _AT),
            now.where(version.kb_id == KB, version.since > _AT, version.until.is_(None)),
        ).order_by("owner", "past")
    )


_PROPOSITION = table_of(PropositionVersionRow).c
_VALUE = table_of(FunctionValueVersionRow).c
_MOVED_PROPOSITIONS = _moved(_PROPOSITION, _PROPOSITION.proposition_id, _PROPOSITION.since)
_MOVED_VALUES = _moved(_VALUE, _VALUE.function_value_id, _VALUE.text, _VALUE.object_id)
_ATOMS = Query(
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
    """Make the state equal to that of a past revision, as a new revision.

    Args:
        store: the store.
        revision: the past revision.
        reason: why; that it was restored, when not given.
        actor: who does it; the store's actor when not given.

    Returns:
        The new revision; None when nothing was different, or when it is part of a transaction
        that is still open.
    """
    why = f"restored revision {revision}" if reason is None else reason
    is_part = store.current() is not None
    with store.transaction(actor, why) as transaction:
        if revision < transaction.head.archived_revision:
            # It was not when the caller looked.
            refuse_archived(store, revision)
        # What the transaction has changed so far is looked at with the rest.
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
            if transaction.define(kind, definition):
                # This process may never have met the name.
                identity = (definition.id, definition.name)
                transaction.assign(elements.interned, fold(definition.name), identity)


def _restore_propositions(transaction: Transaction, at: int, is_new: bool) -> None:
    """Let propositions hold, or not: in a new transaction, the tables say what it knows of them."""
    propositions = transaction.propositions
    moved = transaction.session.stream(_MOVED_PROPOSITIONS, kb=transaction.kb_id, at=at)
    # Proposition id -> the revision that its open version is of; None: it has none.
    differing: dict[int, int | None] = {}
    for id_, rows in groupby(moved, key=lambda row: row[0]):
        first, *others = rows
        if not others:
            differing[id_] = None if first[1] else first[2]
    for batch in batches(differing):
        atoms = _atoms(transaction, batch)
        if is_new:
            propositions.note({id_: differing[id_] for id_ in batch})
        else:
            propositions.look_at(atoms)
        for atom in atoms:
            propositions.set(atom, differing[atom.id] is None)
        propositions.spill()


def _atoms(transaction: Transaction, ids: list[int]) -> list[Atom]:
    session = transaction.session
    rows = session.rows(_ATOMS, kb=transaction.kb_id, ids=session.list_value(ids))
    return [
        Atom(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)
        for id_, is_goal, predicate_id, arguments, text in rows
    ]


def _restore_values(transaction: Transaction, at: int) -> None:
    moved = transaction.session.stream(_MOVED_VALUES, kb=transaction.kb_id, at=at)
    then = dict(_values_then(moved))
    for batch in batches(then):
        fluents = _fluents(transaction, batch)
        transaction.values.look_at(fluents)
        for fluent in fluents:
            transaction.values.put(fluent, _value(fluent, *then[fluent.id]))


def _values_then(moved: Iterable[Row]) -> Iterator[tuple[int, tuple[str | None, int | None]]]:
    """Give each fluent that is something else by now, and the text and object that it was."""
    for id_, rows in groupby(moved, key=lambda row: row[0]):
        held = {bool(past): (text, object_id) for _, past, text, object_id in rows}
        if held.get(True) != held.get(False):
            yield id_, held.get(True, (None, None))


def _value(fluent: Fluent, text: str | None, object_id: int | None) -> FluentValue | None:
    return None if text is None else read_value(fluent.text, text, object_id)


def _fluents(transaction: Transaction, ids: list[int]) -> list[Fluent]:
    session = transaction.session
    rows = session.rows(_FLUENTS, kb=transaction.kb_id, ids=session.list_value(ids))
    return [
        Fluent(id_, FluentKey(function_id, arguments), text)
        for id_, function_id, arguments, text in rows
    ]
