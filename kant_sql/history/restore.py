"""Restore: a new revision whose state equals that of a past one."""

from __future__ import annotations

import logging
from itertools import groupby
from operator import itemgetter
from typing import Any

from sqlalchemy import Select, literal_column, select, union_all

from ..dao.base import batches
from ..knowledge.definitions import KINDS
from ..moment_text import When
from ..sql import tables as t
from ..sql.definition_rows import load_at
from ..sql.dialects.base import Row
from ..sql.query import Query, found_rows
from ..sql.rows import KB, THEN, table_of
from ..store.caches import AtomKey, FluentKey, GroundAtom, GroundFluent, read_value
from ..store.state import State
from ..store.transaction import Transaction
from .moments import state_at
from .revisions import refuse_archived_revision

logger = logging.getLogger("kant_sql.history")


def _moved(mapped: type[t.Base], owner: str, *names: str) -> Query:
    """Select the versions that held then and ended since, and those that began since and hold."""
    version = table_of(mapped).c
    columns = version[owner].label("owner"), *(version[name] for name in names)
    past: Select[Any] = select(literal_column("1").label("past"), *columns)
    now: Select[Any] = select(literal_column("0").label("past"), *columns)
    return Query(
        union_all(
            past.where(version.kb_id == KB, version.since <= THEN, version.until > THEN),
            now.where(version.kb_id == KB, version.since > THEN, version.until.is_(None)),
        ).order_by("owner", "past")
    )


def _identities(mapped: type[t.Base], *names: str) -> Query:
    identity = table_of(mapped).c
    columns = (identity[name] for name in ("id", *names, "arguments", "text"))
    rows = select(*columns).where(identity.kb_id == KB)
    return Query(select(*found_rows(rows, identity.id, "ids").c))


_MOVED_PROPOSITIONS = _moved(t.PropositionVersionRow, "proposition_id", "since")
_MOVED_VALUES = _moved(t.FunctionValueVersionRow, "function_value_id", "text", "object_id")
_ATOMS = _identities(t.PropositionRow, "is_goal", "predicate_id")
_FLUENTS = _identities(t.FunctionValueRow, "function_id")


def restore(
    state: State, when: When, *, reason: str | None = None, actor: str | None = None
) -> int | None:
    """Restore a past state as a new revision.

    The history is kept, so a restoration can itself be undone. Recorded plans and archives
    belong to no state, and stay.

    Args:
        when: a revision, given as for `kb.at`.
        reason: why; by default `restored revision NUMBER`.
        actor: who restores; by default the knowledge base's actor.

    Returns:
        The new revision; None when the states are equal, or within an open transaction.

    Raises:
        UnknownRevisionError: there is no such revision yet, or the time lies in the future or
            has no zone.
        ArchivedError: that state was moved to an archive.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.propositions.delete_all()
        1
        >>> kb.restore(1)
        3
        >>> print(*kb.propositions.get_all())
        (robot_at rb1 wp1)
    """
    store = state.store
    revision = state_at(store, when)
    why = f"restored revision {revision}" if reason is None else reason
    is_part = store.current() is not None
    with store.transaction(actor, why) as transaction:
        if revision < transaction.head.archived_revision:
            # It was archived after the caller's check.
            refuse_archived_revision(store, revision)
        # The statements below read the transaction's own changes from the tables.
        transaction.flush()
        _restore_definitions(transaction, revision)
        _restore_propositions(transaction, revision, not is_part)
        _restore_values(transaction, revision)
    committed = transaction.committed
    made = None if is_part or committed is None else committed.number
    logger.info(
        "knowledge base %r: revision %d restored, by revision %s", store.name, revision, made
    )
    return made


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
    """Restore propositions; a new transaction has no pending ones, so the tables are current."""
    propositions = transaction.propositions
    moved = transaction.session.stream(_MOVED_PROPOSITIONS, kb=transaction.kb_id, at=at)
    # By proposition id: the revision since which its version holds; None without one.
    differing: dict[int, int | None] = {}
    for id_, rows in groupby(moved, key=itemgetter(1)):
        (past, _, since), *others = rows
        if not others:
            differing[id_] = None if past else since
    for batch in batches(differing):
        atoms = [
            GroundAtom(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)
            for id_, is_goal, predicate_id, arguments, text in _read(transaction, _ATOMS, batch)
        ]
        if is_new:
            propositions.note(
                {atom.id: None if differing[atom.id] is None else atom for atom in atoms}
            )
        else:
            propositions.load(atoms)
        for atom in atoms:
            propositions.set(atom, differing[atom.id] is None)
        transaction.spill()


def _restore_values(transaction: Transaction, at: int) -> None:
    moved = transaction.session.stream(_MOVED_VALUES, kb=transaction.kb_id, at=at)
    then: dict[int, tuple[str | None, int | None]] = {}
    for id_, rows in groupby(moved, key=itemgetter(1)):
        held = {bool(past): (text, object_id) for past, _, text, object_id in rows}
        if held.get(True) != held.get(False):
            then[id_] = held.get(True, (None, None))
    for batch in batches(then):
        fluents = [
            GroundFluent(id_, FluentKey(function_id, arguments), text)
            for id_, function_id, arguments, text in _read(transaction, _FLUENTS, batch)
        ]
        transaction.values.load(fluents)
        for fluent in fluents:
            text, object_id = then[fluent.id]
            value = None if text is None else read_value(fluent.text, text, object_id)
            transaction.values.spell(fluent, value)


def _read(transaction: Transaction, query: Query, ids: list[int]) -> list[Row]:
    session = transaction.session
    return session.rows(query, kb=transaction.kb_id, ids=session.list_value(ids))
