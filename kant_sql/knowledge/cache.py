"""Definitions kept in memory, always together with the revision that last changed one."""

from __future__ import annotations

from typing import NamedTuple

from ..backends import Session
from .definitions import Definitions
from .loading import load, load_at, refresh

CACHED_PASTS = 8


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

    def at_head(self, session: Session, kb_id: int, definition_revision: int) -> Definitions:
        """Give the definitions of a head that was read in the session's transaction.

        Args:
            session: the session.
            kb_id: the knowledge base.
            definition_revision: what the head says of itself.

        Returns:
            The definitions; at most one statement is needed.
        """
        snapshot = self._snapshot
        if snapshot is not None and snapshot.definition_revision == definition_revision:
            return snapshot.definitions
        if snapshot is None or snapshot.definition_revision > definition_revision:
            # The latter is a reader that began before another thread's commit.
            return self.load(session, kb_id)
        definitions = refresh(session, kb_id, snapshot.definitions, snapshot.definition_revision)
        self.keep(definition_revision, definitions)
        return definitions

    def at_revision(self, session: Session, kb_id: int, revision: int) -> Definitions:
        """Give the definitions of a past revision.

        Args:
            session: the session.
            kb_id: the knowledge base.
            revision: the revision.

        Returns:
            The definitions.
        """
        definitions = self._past.get(revision)
        if definitions is None:
            definitions = load_at(session, kb_id, revision)
            if len(self._past) >= CACHED_PASTS:
                self._past.clear()
            self._past[revision] = definitions
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
