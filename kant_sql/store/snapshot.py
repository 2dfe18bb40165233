"""A consistent state to read from, and the definitions that are cached with it."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import BigInteger, bindparam, select

from ..errors import ArchivedError, StoreIntegrityError, check_integer
from ..knowledge.definitions import Definitions
from ..sql.definition_rows import last_change, load, load_at, refresh
from ..sql.dialects.base import Session
from ..sql.query import Query
from ..sql.rows import KB
from ..sql.tables import ArchiveRow, HeadRow

# How many past revisions, and their definitions, are cached.
CACHED_PASTS, CACHED_EPOCHS = 64, 8


class Snapshot(NamedTuple):
    """Definitions, and the revision that last changed one.

    Attributes:
        definition_revision: the revision.
        definitions: the definitions.
    """

    definition_revision: int
    definitions: Definitions


class DefinitionCache:
    """The definitions of the head as a process last saw it, and of some past revisions.

    What is kept never changes, so threads share it: a newer snapshot takes the place of an older.
    """

    def __init__(self) -> None:
        self._snapshot: Snapshot | None = None
        self._past: dict[int, Definitions] = {}
        # By the revision that last changed them.
        self._epochs: dict[int, Definitions] = {}

    @property
    def snapshot(self) -> Snapshot | None:
        """The newest definitions that were read; None before the first."""
        return self._snapshot

    def load(self, session: Session, kb_id: int) -> Definitions:
        """Read the definitions of the head, in one statement."""
        definition_revision, definitions = load(session, kb_id)
        self.keep(definition_revision, definitions)
        return definitions

    def at_head(
        self, session: Session, kb_id: int, definition_revision: int, archived: int
    ) -> Definitions:
        """Return the definitions of a head that was read in the session's transaction."""
        snapshot = self._snapshot
        if snapshot is not None and snapshot.definition_revision == definition_revision:
            return snapshot.definitions
        if snapshot is None or not archived <= snapshot.definition_revision < definition_revision:
            # Behind an archive, the tables no longer show what has ended since. Ahead of the
            # head is a reader that began before another thread's commit.
            return self.load(session, kb_id)
        definitions = refresh(session, kb_id, snapshot.definitions, snapshot.definition_revision)
        self.keep(definition_revision, definitions)
        return definitions

    def guess(self, revision: int | None) -> Snapshot | None:
        """Return definitions that are right unless another process has changed some meanwhile."""
        known = self._snapshot
        if revision is None or known is None or revision >= known.definition_revision:
            return known
        return None

    def known(self, revision: int | None) -> Definitions | None:
        """Return definitions that are in memory: those of a past revision are right for good."""
        if revision in self._past:
            return self._past[revision]
        guess = self.guess(revision)
        return None if guess is None else guess.definitions

    def at_revision(
        self,
        session: Session,
        kb_id: int,
        revision: int,
        definition_revision: int,
        archived: int,
    ) -> Definitions:
        """Return the definitions of a past revision, reading no more than has to be read."""
        kept = self._past.get(revision)
        if kept is not None:
            return kept
        if revision >= definition_revision:
            definitions = self.at_head(session, kb_id, definition_revision, archived)
        else:
            # Archived versions no longer show their changes.
            epoch = max(last_change(session, kb_id, revision), archived)
            known = self._epochs.get(epoch)
            definitions = load_at(session, kb_id, revision) if known is None else known
            _keep(self._epochs, epoch, definitions, CACHED_EPOCHS)
        _keep(self._past, revision, definitions, CACHED_PASTS)
        return definitions

    def keep(self, definition_revision: int, definitions: Definitions) -> None:
        """Keep definitions, unless newer ones are kept already."""
        known = self._snapshot
        if known is None or known.definition_revision < definition_revision:
            self._snapshot = Snapshot(definition_revision, definitions)


def _keep(known: dict[int, Definitions], key: int, definitions: Definitions, limit: int) -> None:
    if key not in known and len(known) >= limit:
        known.clear()
    known[key] = definitions


_HEAD = Query(
    select(HeadRow.definition_revision, HeadRow.archived_revision).where(HeadRow.kb_id == KB)
)
_REVISION = Query(select(HeadRow.revision).where(HeadRow.kb_id == KB))
_ARCHIVE = Query(
    select(ArchiveRow.target)
    .where(ArchiveRow.kb_id == KB, ArchiveRow.revision > bindparam("at", type_=BigInteger))
    .order_by(ArchiveRow.revision)
)


class View(NamedTuple):
    """A consistent state to read from: now, or as it was at a revision.

    Attributes:
        session: the session, in a transaction.
        kb_id: the knowledge base; None when it has not been written to yet.
        definitions: what is defined in that state.
        at: the revision; None for now.
        definition_revision: the revision that last changed a definition, where it still has to be
            compared with the head in the statement that reads; else None.
    """

    session: Session
    kb_id: int | None
    definitions: Definitions
    at: int | None = None
    definition_revision: int | None = None


class DefinitionsMovedError(Exception):
    """A statement found that definitions have changed since they were cached."""


def open_view(session: Session, kb_id: int | None, cache: DefinitionCache, at: int | None) -> View:
    """Open a state to read from."""
    if kb_id is None:
        return View(session, None, Definitions(), at)
    if at is not None:
        definition_revision, archived = _read_head(session, kb_id)
        refuse_archived(session, kb_id, at, archived)
        definitions = cache.at_revision(session, kb_id, at, definition_revision, archived)
        return View(session, kb_id, definitions, at)
    if cache.snapshot is None:
        return View(session, kb_id, cache.load(session, kb_id))
    return View(session, kb_id, cache.at_head(session, kb_id, *_read_head(session, kb_id)))


def read_definition_revision(session: Session, kb_id: int) -> int:
    """Read the revision that last changed a definition."""
    return _read_head(session, kb_id)[0]


def _read_head(session: Session, kb_id: int) -> tuple[int, int]:
    row = session.first(_HEAD, kb=kb_id)
    if row is None:
        raise vanished(session)
    for column, value in zip(("definition_revision", "archived_revision"), row, strict=True):
        check_integer("head", f"knowledge base {kb_id!r}", column, value)
    return row[0], row[1]


def refuse_archived(session: Session, kb_id: int, at: int, archived: int) -> None:
    """Refuse to read a state of which a part was moved elsewhere."""
    # Before the first revision there was nothing that could have been moved.
    if 0 < at < archived:
        raise ArchivedError(
            f"a part of what the knowledge base was at revision {at} was moved to an archive: ask "
            f"the one in {archive_of(session, kb_id, at)}"
        )


def archive_of(session: Session, kb_id: int, at: int) -> str:
    """Return where the archive is that has a part of a state."""
    row = session.first(_ARCHIVE, kb=kb_id, at=at)
    if row is None:
        raise StoreIntegrityError(
            f"{session.backend.label}: the head of knowledge base {kb_id} says that what ended "
            f"after revision {at} was moved to an archive, and there is no record of one; "
            "'kant-sql verify' shows what else was changed by hand"
        )
    return str(row[0])


def read_revision(view: View) -> int:
    """Read which revision a state is of."""
    if view.at is not None or view.kb_id is None:
        return view.at or 0
    row = view.session.first(_REVISION, kb=view.kb_id)
    if row is None:
        raise vanished(view.session)
    check_integer("head", f"knowledge base {view.kb_id!r}", "revision", row[0])
    return int(row[0])


def vanished(session: Session) -> StoreIntegrityError:
    """Make the error for a knowledge base that was there, and is gone."""
    return StoreIntegrityError(
        f"{session.backend.label}: the head of the knowledge base is gone; the database was "
        "replaced while it was open, connect again"
    )
