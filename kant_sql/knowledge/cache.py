"""Definitions kept in memory, always together with the revision that last changed one."""

from __future__ import annotations

from typing import NamedTuple

from ..backends import Session
from .definitions import Definitions
from .loading import last_change, load, load_at, refresh

# So many past revisions, and past definitions, are kept.
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
        # By the revision that made them so.
        self._epochs: dict[int, Definitions] = {}

    @property
    def snapshot(self) -> Snapshot | None:
        """The newest definitions that were read; None before the first."""
        return self._snapshot

    def load(self, session: Session, kb_id: int) -> Definitions:
        """Read the definitions of the head, in one statement.

        Args:
            session: the session.
            kb_id: the knowledge base.

        Returns:
            The definitions.
        """
        definition_revision, definitions = load(session, kb_id)
        self.keep(definition_revision, definitions)
        return definitions

    def at_head(
        self, session: Session, kb_id: int, definition_revision: int, archived: int
    ) -> Definitions:
        """Give the definitions of a head that was read in the session's transaction.

        Args:
            session: the session.
            kb_id: the knowledge base.
            definition_revision: what the head says of itself.
            archived: what ended up to this revision was moved to an archive.

        Returns:
            The definitions; at most one statement is needed.
        """
        snapshot = self._snapshot
        if snapshot is not None and snapshot.definition_revision == definition_revision:
            return snapshot.definitions
        if snapshot is None or not archived <= snapshot.definition_revision < definition_revision:
            # Behind an archive, the tables do not tell any more what has ended since. Ahead of the
            # head is a reader that began before another thread's commit.
            return self.load(session, kb_id)
        definitions = refresh(session, kb_id, snapshot.definitions, snapshot.definition_revision)
        self.keep(definition_revision, definitions)
        return definitions

    def guess(self, revision: int | None) -> Snapshot | None:
        """Give definitions that are right unless another process has changed some meanwhile.

        Args:
            revision: the revision that they are of; None for the head.

        Returns:
            The definitions, with the revision that the head has to name for them to be right; None
            when nothing is known.
        """
        known = self._snapshot
        if revision is None or known is None or revision >= known.definition_revision:
            return known
        return None

    def at_revision(
        self,
        session: Session,
        kb_id: int,
        revision: int,
        definition_revision: int,
        archived: int,
    ) -> Definitions:
        """Give the definitions of a past revision, reading no more than has to be read.

        Args:
            session: the session.
            kb_id: the knowledge base.
            revision: the revision.
            definition_revision: what the head says of itself.
            archived: what ended up to this revision was moved to an archive.

        Returns:
            The definitions.
        """
        kept = self._past.get(revision)
        if kept is not None:
            return kept
        if revision >= definition_revision:
            definitions = self.at_head(session, kb_id, definition_revision, archived)
        else:
            # What has ended before is not there to tell of a change.
            epoch = max(last_change(session, kb_id, revision), archived)
            known = self._epochs.get(epoch)
            definitions = load_at(session, kb_id, revision) if known is None else known
            _keep(self._epochs, epoch, definitions, CACHED_EPOCHS)
        _keep(self._past, revision, definitions, CACHED_PASTS)
        return definitions

    def keep(self, definition_revision: int, definitions: Definitions) -> None:
        """Keep definitions, unless newer ones are kept already.

        Args:
            definition_revision: the revision that last changed one.
            definitions: the definitions.
        """
        known = self._snapshot
        if known is None or known.definition_revision < definition_revision:
            self._snapshot = Snapshot(definition_revision, definitions)


def _keep(known: dict[int, Definitions], key: int, definitions: Definitions, limit: int) -> None:
    if key not in known and len(known) >= limit:
        known.clear()
    known[key] = definitions
