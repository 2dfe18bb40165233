"""Erases texts if an archive has a part of the history: finds them there, records them here.

The archive has all versions, so the erasure is first made there and rolled back; its writes are
repeated here, for the rows that are here. Then the archive follows, like any replica.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import Any

from sqlalchemy import Table

from ...arguments import expect
from ...errors import (
    ConflictError,
    InvalidArgumentError,
    InvalidUrlError,
    KantSqlError,
    StoreBusyError,
    StoreIntegrityError,
)
from ...sql.changes import SIGNS, keyed_changes_of
from ...sql.dialects import create_backend
from ...sql.dialects.base import Row, Session
from ...sql.query import Query
from ...store.store import Store
from ...store.transaction import Transaction
from ..archive.archive import check_archive, record_archive, replicate
from ..archive.remove import Leaving, refuse_without_right
from ..replication.copy import ATOMS, Identities, Stores, references
from ..replication.erasures import first_fault, touched_by
from ..replication.target import ReplicationSide, Target, begin_on, open_target, read_state
from ..rewriting.parts import Destroyer
from ..rewriting.texts import Renaming, TextWriter
from ..verify.chain import rest_digest
from ..verify.head import read_archives
from ..verify.parts import WHOLE, Part
from ..verify.sides import Check, Report
from ..verify.verify import verify_session

# Attempts to bring the archive to the store's last revision, while others write.
_ATTEMPTS = 20


@contextmanager
def open_archive(store: Store, url: str) -> Iterator[ArchivedPart]:
    """Open the archive of a knowledge base for an erasure; refuse another or an incomplete one."""
    expect(url, str, "the URL of the archive", InvalidUrlError)
    store.refuse_read_only()
    refuse_without_right(store)
    with closing(create_backend(url)) as backend:
        if not backend.exists():
            raise ConflictError(f"{backend.label}: there is no such archive; nothing was erased")
    with open_target(url, store.name, store.backend, "an archive") as target:
        found = ArchivedPart(store, target)
        found.check()
        yield found


class ArchivedPart:
    """The archive that an erasure reaches."""

    stores: Stores  # the archive and the store, in transactions: the archive's is rolled back

    def __init__(self, store: Store, target: Target) -> None:
        self._store = store
        self._target = target
        self._source = ReplicationSide(store.backend, store.name)
        # Versions that ended up to this revision were moved there; the hash of the rest.
        self.upto, self._rest = 0, ""

    def check(self) -> None:
        """Check that the archive is intact, and has all of this history up to some revision."""
        label, name = self._target.backend.label, self._store.name
        with begin_on(self._target.backend) as there, begin_on(self._source.backend) as here:
            kb_id, own_id = self._target.find(there), self._source.find(here)
            self.upto = read_state(here, own_id).archived_revision
            if own_id is None or not self.upto:
                raise InvalidArgumentError(
                    f"nothing of knowledge base {name!r} was moved to an archive; leave archive= "
                    "(--archive) out: 'kant-sql push' erases in replicas"
                )
            state = read_state(there, kb_id)
            check_archive(Stores(here, own_id, there, kb_id or 0), name, state.revision)
            if state.archived_revision or state.origin is None:
                raise ConflictError(
                    f"{label}: knowledge base {name!r} is not an archive there, which is a replica "
                    "with all versions; nothing was erased: name the archive, or a copy of it"
                )
            self._check_rest(here, own_id)
            found, _ = verify_session(there, kb_id, name)
        for _, _, message in found.findings[:1]:
            raise StoreIntegrityError(
                f"{label}: the archive of knowledge base {name!r} was altered: {message}; nothing "
                "was erased: 'kant-sql verify' shows all of it, name an intact copy"
            )

    @contextmanager
    def begin(self, actor: str | None, reason: str | None) -> Iterator[Transaction]:
        """Begin the transaction of the erasure, with the archive locked at the same revision."""
        for _ in range(_ATTEMPTS):
            last = self._store.query_in_snapshot(read_state).revision
            replicate(self._source, self._target, last)
            with ExitStack() as stack:
                # The target's lock comes first, as when versions are moved there.
                there, kb_id, head = stack.enter_context(self._target.locked())
                transaction = stack.enter_context(self._store.transaction(actor, reason))
                if head.hash == transaction.head.hash:
                    self.stores = Stores(there, kb_id, transaction.session, transaction.kb_id)
                    self._refuse_moved()
                    yield transaction
                    return
        raise StoreBusyError(
            f"{self._source.backend.label}: others write to knowledge base {self._store.name!r} "
            "faster than its archive follows; nothing was erased: try again"
        )

    def _check_rest(self, session: Session, kb_id: int) -> None:
        """Check the rest of the archived revisions: it must have the recorded hash."""
        self._rest = rest_digest(session, kb_id, self.upto)
        if not self._is_last_rest(session, kb_id):
            raise StoreIntegrityError(
                f"{self._source.backend.label}: the rest of the revisions of knowledge base "
                f"{self._store.name!r} up to {self.upto} has changed since versions were moved to "
                "an archive; nothing was erased: 'kant-sql verify' shows more"
            )

    def _is_last_rest(self, session: Session, kb_id: int) -> bool:
        records = read_archives(Check(session, kb_id, Report()))
        return [(one.revision, one.rest) for one in records[-1:]] == [(self.upto, self._rest)]

    def _refuse_moved(self) -> None:
        """Refuse if others have moved or erased versions since the check, which locks nothing."""
        *_, session, kb_id = self.stores
        if not self._is_last_rest(session, kb_id):
            raise StoreBusyError(
                f"{self._source.backend.label}: versions of knowledge base {self._store.name!r} "
                "were moved to its archive, or erased there, meanwhile; nothing was erased: try "
                "again"
            )

    def writer(self, renaming: Renaming) -> TextWriter:
        """Return a writer that renames an object in the archive and here."""
        there, kb_id, session, own_id = self.stores
        identities = Identities(self.stores, may_return=True)

        def also(table: Table, query: Query, rows: list[dict[str, Any]]) -> None:
            to = {f"own_{table.columns[at].name}": atoms for at, atoms in references(table)}
            owner = {"own_id": table} if table in ATOMS else to
            for key, atoms in owner.items():
                if atoms in ATOMS and key in rows[0]:
                    ids = identities.find_ids(atoms, {row[key] for row in rows})
                    rows = [{**row, key: ids[row[key]]} for row in rows if row[key] in ids]
                    break
            if rows:
                session.run_many(query, [{**row, "kb": own_id} for row in rows])

        return TextWriter(there, kb_id, self._store.name, renaming, also)

    def finish(self, transaction: Transaction, renaming: Renaming | None, erasure_id: int) -> None:
        """Rename in the rows that only this store has, record the rest, and check everything."""
        *_, session, kb_id = self.stores
        name = self._store.name
        if renaming is not None:
            TextWriter(session, kb_id, name, renaming).run_atoms()
        rest = rest_digest(session, kb_id, self.upto)
        if rest != self._rest:
            label = self._target.backend.label
            record_archive(transaction, Leaving(self.upto, self.upto, {}), rest, label)
            self._rest = rest
        fault = first_fault(session, kb_id, name, {*touched_by(session, kb_id, [erasure_id])})
        if fault is not None:
            raise StoreIntegrityError(
                f"{self._source.backend.label} and {self._target.backend.label} differ in what "
                f"they have of knowledge base {name!r}: {fault}; nothing was erased: "
                "'kant-sql verify' of both shows which was changed by hand"
            )

    def follow(self, revision: int | None) -> tuple[str, ...]:
        """Erase in the archive; return where bytes of it may remain."""
        backend = self._target.backend
        try:
            return replicate(self._source, self._target, revision or 0)
        except KantSqlError as error:
            here = self._source.backend.label
            return (f"{backend.label} ({error}); run 'kant-sql push {here} {backend.label}'",)


class ArchiveDestroyer(Destroyer):
    """Destroys parts in an archive; writes the results to the store, which lacks the versions."""

    def __init__(self, name: str, moved: ArchivedPart) -> None:
        there, kb_id, *_ = moved.stores
        super().__init__(there, kb_id, name, into=(moved.stores.target, moved.stores.target_kb))
        self._moved = moved
        self._identities = Identities(moved.stores, may_return=True)
        self._here: set[tuple[Any, ...]] = set()

    def _changes(self, numbers: list[int]) -> list[Row]:
        rows = super()._changes(numbers)
        for atoms in ATOMS:
            self._identities.find_ids(atoms, {row[4] for row in rows})
        here = keyed_changes_of(*self._into, numbers)
        self._here = {(number, SIGNS[sign], kind, *key) for number, sign, kind, _, *key in here}
        return rows

    def _own(self, part: Part) -> Part:
        return part._replace(owner_id=self._identities.known_id(part.owner_id))

    def _has(self, number: int, part: Part) -> bool:
        is_said = part.position < 0 and part.kind != WHOLE
        return number > self._moved.upto or is_said or (number, *part.key) in self._here
