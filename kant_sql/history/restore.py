"""Restoring a past state, and branches that begin with one.

In a branch each element keeps its id, so both knowledge bases list elements in the same order and
write the same documents.
"""

from __future__ import annotations

import logging
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import Select, select, union_all

from ..dao.base import batches
from ..errors import ConflictError, StaleRevisionError, reading_rows
from ..knowledge.atoms import FluentValue, GroundAtom, GroundFluent, HeldValue
from ..knowledge.definitions import KINDS, Definitions
from ..moment_text import When
from ..sql.definition_rows import load_at
from ..sql.dialects.base import Row
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, now_and_then
from ..sql.query import Query, constant, found_rows, in_rows
from ..sql.rows import ATOM_TABLES, KB, PROPOSITION, THEN, VALUE, AtomTables
from ..store.head import hash_of
from ..store.snapshot import View, read_revision
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .moments import state_at
from .revisions import refuse_archived_revision

logger = logging.getLogger("kant_sql.history")


def _moved(atoms: AtomTables, *names: str) -> Query:
    """Select versions that held then and ended since, and versions that began since and hold."""
    version = atoms.version.c
    columns = version[atoms.owner].label("owner"), *(version[name] for name in names)
    past: Select[Any] = select(constant(1).label("past"), *columns)
    now: Select[Any] = select(constant(0).label("past"), *columns)
    return Query(
        union_all(
            past.where(version.kb_id == KB, version.since <= THEN, version.until > THEN),
            now.where(version.kb_id == KB, version.since > THEN, version.until.is_(None)),
        ).order_by("owner", "past")
    )


_FACT, _VALUE = ATOM_TABLES[PROPOSITION], ATOM_TABLES[VALUE]
_MOVED_PROPOSITIONS = _moved(_FACT, "since")
_MOVED_VALUES = _moved(_VALUE, "text", "object_id")
_ATOMS, _FLUENTS = (
    Query(select(*found_rows(one.identities(), one.identity.c.id, "ids").c))
    for one in (_FACT, _VALUE)
)


def restore(
    state: State, when: When, *, reason: str | None = None, actor: str | None = None
) -> int | None:
    """Restore a past state as a new revision.

    You lose nothing, and another restore undoes it. Recorded plans and archives belong to no state,
    and stay.

    Args:
        when: a revision, given as for `kb.at`.
        reason: why; by default `restored revision NUMBER`.
        actor: who restores; by default the knowledge base's actor.

    Returns:
        The new revision; None if the states are equal, or within an open transaction.

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
    revision = state_at(State(store), when)
    why = f"restored revision {revision}" if reason is None else reason
    is_part = store.current() is not None
    with store.transaction(actor, why) as transaction:
        transaction.refuse_period("a restored state", "restore in another transaction")
        if revision < transaction.head.archived_revision:
            # It was archived after the caller's check.
            refuse_archived_revision(store, revision)
        # The statements below read the transaction's own changes from the tables.
        transaction.flush()
        _restore_definitions(transaction, revision)
        _restore_propositions(transaction, revision, not is_part)
        _restore_values(transaction, revision)
    made = transaction.made
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
    # Proposition id -> the revision since which its version holds; None without one.
    differing: dict[int, int | None] = {}
    for id_, rows in groupby(moved, key=itemgetter(1)):
        (past, _, since), *others = rows
        if not others:
            differing[id_] = None if past else since
    for batch in batches(differing):
        atoms = [*map(GroundAtom.of, _read(transaction, _ATOMS, batch))]
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
        fluents = [*map(GroundFluent.of, _read(transaction, _FLUENTS, batch))]
        transaction.values.load(fluents)
        for fluent in fluents:
            text, object_id = then[fluent.id]
            value = None if text is None else FluentValue.of(fluent.text, text, object_id)
            transaction.values.spell(fluent, value)


def _read(transaction: Transaction, query: Query, ids: list[int]) -> list[Row]:
    session = transaction.session
    return session.rows(query, kb=transaction.kb_id, ids=session.list_value(ids))


def _held(atoms: AtomTables, any_owner: Any, *names: str) -> dict[bool, Select[Any]]:
    """Select columns of live versions, keyed by whether it is about the past."""
    version = atoms.version.c
    rows = select(*(version[name] for name in (atoms.owner, *names))).where(version.kb_id == KB)
    return {past: rows.where(held) for past, held in now_and_then(version, any_owner)}


def _held_identities(atoms: AtomTables, any_owner: Any) -> dict[bool, Query]:
    """Make queries of the identities of these versions."""
    id_, identities = atoms.identity.c.id, atoms.identities()
    held = _held(atoms, any_owner)
    return {past: Query(identities.where(in_rows(id_, ids))) for past, ids in held.items()}


_HELD_ATOMS = _held_identities(_FACT, ANY_PREDICATE)
_HELD_FLUENTS = _held_identities(_VALUE, ANY_FUNCTION)
_HELD_VALUES = {
    past: Query(rows) for past, rows in _held(_VALUE, ANY_FUNCTION, "text", "object_id").items()
}


class Origin(NamedTuple):
    """The state that a branch begins with."""

    parent: str  # the knowledge base of the state
    revision: int  # the revision; 0 before the first
    hash: str | None  # the hash of that revision; None before the first
    definitions: Definitions  # all that is defined
    atoms: list[GroundAtom]  # the facts and the goals that are atoms, by their ids
    values: list[HeldValue]  # the values of functions, by the ids of their fluents

    @property
    def reason(self) -> str:
        """The reason of a branch's first revision."""
        return f"branch of {self.parent} at revision {self.revision}"

    @property
    def source(self) -> dict[str, str | int | None]:
        """The source of a branch's first revision."""
        return {"parent": self.parent, "revision": self.revision, "hash": self.hash}


def read_origin(store: Store, at: int | None) -> Origin:
    """Read a state whole, from one snapshot, in a number of statements that does not grow."""
    refuse_open(store, "that a branch could name")
    return store.read_in_snapshot(lambda view: origin_of(store, view), at)


def refuse_open(store: Store, what: str) -> None:
    """Refuse to read a pending state, which has neither revision nor hash."""
    store.refuse_open(f", whose state has no revision yet {what}")


def origin_of(store: Store, view: View) -> Origin:
    """Read a state whole."""
    revision = read_revision(view)
    digest = None
    if view.kb_id is not None and revision:
        digest = hash_of(view.session, view.kb_id, revision)
    atoms = [*map(GroundAtom.of, sorted(view.rows(_HELD_ATOMS), key=itemgetter(0)))]
    return Origin(store.name, revision, digest, view.definitions, atoms, _read_values(view))


def _read_values(view: View) -> list[HeldValue]:
    fluents = {row[0]: GroundFluent.of(row) for row in view.rows(_HELD_FLUENTS)}
    held = []
    for id_, text, object_id in sorted(view.rows(_HELD_VALUES), key=itemgetter(0)):
        with reading_rows("function_value_version", f"function value {id_!r}"):
            fluent = fluents[id_]
        held.append(HeldValue.of(fluent, text, object_id))
    return held


def write_branch(store: Store, origin: Origin) -> int | None:
    """Write a state as the first revision; return its number, None if the state is empty."""
    try:
        with store.transaction(
            reason=origin.reason, source=origin.source, expected_revision=0
        ) as transaction:
            _write(transaction, origin)
    except StaleRevisionError as error:
        raise ConflictError(
            f"{store.backend.label}: knowledge base {store.name!r} exists there, at revision "
            f"{error.actual}; give the branch another name"
        ) from error
    logger.info("knowledge base %r: %s", store.name, origin.reason)
    return transaction.made


def _write(transaction: Transaction, origin: Origin) -> None:
    for kind in KINDS:
        for definition in origin.definitions.elements(kind):
            transaction.adopt(kind, definition)
    for atoms in batches(origin.atoms):
        transaction.propositions.adopt({atom.id: atom for atom in atoms})
        transaction.spill()
    transaction.values.adopt({held.fluent.id: held for held in origin.values})
