"""Branches: a knowledge base that begins with a state of another one.

Each element keeps its id, so that both list theirs in one order and write the same documents.
"""

from __future__ import annotations

import logging
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import Select, and_, select

from ..dao.base import batches
from ..errors import ConflictError, ReadOnlyError, StaleRevisionError, reading_rows
from ..knowledge.definitions import KINDS, Definitions
from ..sql.intervals import ANY_FUNCTION, ANY_PREDICATE, held_then, then
from ..sql.query import Query, in_rows
from ..sql.rows import KB
from ..sql.tables import (
    FunctionValueRow,
    FunctionValueVersionRow,
    PropositionRow,
    PropositionVersionRow,
)
from ..store.caches import (
    AtomKey,
    FluentKey,
    GroundAtom,
    GroundFluent,
    HeldValue,
    read_value,
)
from ..store.head import hash_of
from ..store.snapshot import View, read_revision
from ..store.store import Store
from ..store.transaction import Transaction

logger = logging.getLogger("kant_sql.history")


def _held(version: Any, any_owner: Any) -> tuple[tuple[bool, Any], ...]:
    """Return the condition of the present, and that of the past."""
    return (False, version.until.is_(None)), (True, and_(any_owner, held_then(version)))


def _identities(identity: Any, owner: Any, versions: Select[Any], *columns: Any) -> Query:
    return Query(
        select(identity.id, owner, identity.arguments, identity.text, *columns).where(
            identity.kb_id == KB, in_rows(identity.id, versions)
        )
    )


def _versions(version: Any, held: Any, *columns: Any) -> Select[Any]:
    return select(*columns).where(version.kb_id == KB, held)


# By whether they are about the past.
_ATOMS = {
    is_past: _identities(
        PropositionRow,
        PropositionRow.predicate_id,
        _versions(PropositionVersionRow, held, PropositionVersionRow.proposition_id),
        PropositionRow.is_goal,
    )
    for is_past, held in _held(PropositionVersionRow, ANY_PREDICATE)
}
_FLUENTS = {
    is_past: _identities(
        FunctionValueRow,
        FunctionValueRow.function_id,
        _versions(FunctionValueVersionRow, held, FunctionValueVersionRow.function_value_id),
    )
    for is_past, held in _held(FunctionValueVersionRow, ANY_FUNCTION)
}
_VALUES = {
    is_past: Query(
        _versions(
            FunctionValueVersionRow,
            held,
            FunctionValueVersionRow.function_value_id,
            FunctionValueVersionRow.text,
            FunctionValueVersionRow.object_id,
        )
    )
    for is_past, held in _held(FunctionValueVersionRow, ANY_FUNCTION)
}


class Origin(NamedTuple):
    """The state that a branch begins with.

    Attributes:
        parent: the knowledge base that it is of.
        revision: the revision; 0 before the first.
        hash: the hash of that revision; None before the first.
        definitions: all that is defined.
        atoms: the facts and the goals that are atoms, by their ids.
        values: the values of functions, by the ids of their fluents.
    """

    parent: str
    revision: int
    hash: str | None
    definitions: Definitions
    atoms: list[GroundAtom]
    values: list[HeldValue]

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
    if store.current() is not None:
        # Nothing could name what it begins with: a pending state has neither revision nor hash.
        raise ReadOnlyError(
            f"knowledge base {store.name!r} has a transaction open in this task or thread, whose "
            "state has no revision yet that a branch could name; end it first"
        )

    def work(view: View) -> Origin:
        revision = read_revision(view)
        digest = None
        if view.kb_id is not None and revision:
            digest = hash_of(view.session, view.kb_id, revision)
        return Origin(
            store.name, revision, digest, view.definitions, _read_atoms(view), _read_values(view)
        )

    return store.read_in_snapshot(work, at)


def _rows(view: View, queries: dict[bool, Query]) -> list[Any]:
    if view.kb_id is None:
        return []
    past = {} if view.at is None else then(view.session, view.at)
    rows = view.session.rows(queries[view.at is not None], kb=view.kb_id, **past)
    return sorted(rows, key=itemgetter(0))


def _read_atoms(view: View) -> list[GroundAtom]:
    return [
        GroundAtom(id_, AtomKey(bool(is_goal), predicate_id, arguments), text)
        for id_, predicate_id, arguments, text, is_goal in _rows(view, _ATOMS)
    ]


def _read_values(view: View) -> list[HeldValue]:
    fluents = {
        id_: GroundFluent(id_, FluentKey(function_id, arguments), text)
        for id_, function_id, arguments, text in _rows(view, _FLUENTS)
    }
    held = []
    for id_, text, object_id in _rows(view, _VALUES):
        with reading_rows("function_value_version", f"function value {id_!r}"):
            fluent = fluents[id_]
        held.append(HeldValue(fluent, read_value(fluent.text, text, object_id)))
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
    made = transaction.committed
    logger.info("knowledge base %r: %s", store.name, origin.reason)
    return None if made is None else made.number


def _write(transaction: Transaction, origin: Origin) -> None:
    for kind in KINDS:
        for definition in origin.definitions.elements(kind):
            transaction.adopt(kind, definition)
    for atoms in batches(origin.atoms):
        transaction.propositions.adopt({atom.id: atom for atom in atoms})
        transaction.spill()
    transaction.values.adopt({held.fluent.id: held for held in origin.values})
