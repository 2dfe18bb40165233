"""The caches of a process: definitions, and interned atoms and fluents."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Mapping
from typing import Generic, NamedTuple, TypeVar

from ..knowledge.atoms import AtomKey, FluentKey, GroundAtom, GroundFluent, HeldValue
from ..knowledge.definitions import Definition, Definitions
from ..sql.definition_rows import last_change, load, load_at, refresh
from ..sql.dialects.base import Session

# Clear the cache above this count, about 60 MB.
CACHED_ATOMS = 200_000
# The same where a process has many knowledge bases open, about 0.6 MB.
CACHED_OF_MANY = 2_000
CACHED_AGREEMENTS = 20_000
# Cached past revisions, with their definitions.
CACHED_PASTS, CACHED_EPOCHS = 64, 8

K = TypeVar("K")
A = TypeVar("A")
H = TypeVar("H")


class InternCache(Generic[K, A, H]):
    """Known identities, which are permanent, and the state at one revision."""

    def __init__(self, is_one_of_many: bool = False) -> None:
        self.identities: dict[K, A] = {}
        self.held: dict[int, H] = {}  # id -> content at `revision`, also that it did not hold
        self.revision = 0  # the revision of `held`, which is not valid for any other
        self._most = CACHED_OF_MANY if is_one_of_many else CACHED_ATOMS
        self._lock = threading.Lock()

    def at(self, revision: int) -> dict[int, H]:
        """Return the cached state of a revision."""
        with self._lock:
            if revision != self.revision:
                self.held, self.revision = {}, revision
            return self.held

    def advance(self, before: int, after: int) -> None:
        """Keep the cached state for a revision that changed nothing in it."""
        if before != after:
            with self._lock:
                if before == self.revision:
                    self.revision = after

    def learn(
        self,
        identities: Mapping[K, A],
        held: dict[int, H],
        before: int,
        after: int,
        news: Mapping[int, H] | None,
    ) -> None:
        """Share the identities and the state of a writer with later writers."""
        # Identities never change.
        self.identities.update(identities)
        if len(self.identities) > self._most:
            self.identities.clear()
        with self._lock:
            # The head is unlocked: another writer may have published first.
            if held is self.held and before == self.revision:
                if news is None or len(held) > self._most:
                    self.held = {}
                else:
                    held.update(news)
                self.revision = after


# The content of an id: the proposition or the value itself; None: it does not hold.
AtomCache = InternCache[AtomKey, GroundAtom, GroundAtom | None]
FluentCache = InternCache[FluentKey, GroundFluent, HeldValue | None]


class Agreements:
    """References by DTOs that agree with the store, as one transaction meets them.

    Agreements of earlier transactions are cached with the definitions. An added definition does not
    change the others, so agreements stay valid; `clear` them when a definition changes or is
    removed.
    """

    __slots__ = ("known", "new")

    def __init__(self, definitions: Definitions) -> None:
        self.known: dict[Hashable, Definition] = definitions.derived.setdefault(Agreements, {})
        self.new: dict[Hashable, Definition] = {}

    def clear(self) -> None:
        """Forget all, for this transaction only."""
        self.known, self.new = {}, {}

    def learn(self, definitions: Definitions) -> None:
        """Share the agreements of a writer, valid for the definitions after its commit."""
        known = self.known
        if len(known) + len(self.new) > CACHED_AGREEMENTS:
            known = {}
        known.update(self.new)
        definitions.derived[Agreements] = known


class Snapshot(NamedTuple):
    """Definitions, and the revision that last changed one."""

    definition_revision: int
    definitions: Definitions


class Pasts(NamedTuple):
    """Definitions of past revisions, with the names after the last erasure."""

    erased: int | None  # the erasure
    by_revision: dict[int, Definitions]
    by_epoch: dict[int, Definitions]  # by the revision that last changed them


class DefinitionCache:
    """The definitions of the last seen head, and of some past revisions."""

    # Cached snapshots never change, so threads share them: a newer snapshot replaces an older one.
    # Only an erasure changes them.

    def __init__(self) -> None:
        # The newest definitions; None before the first read.
        self.snapshot: Snapshot | None = None
        self._pasts = Pasts(None, {}, {})
        self._moved = 0  # the last change of definitions that a reader of the past has seen
        self.forgotten = 0  # how often the cache was cleared

    def forget(self) -> None:
        """Forget all, because texts of earlier revisions were erased."""
        self._forget(self._pasts.erased)

    def _forget(self, erased: int | None) -> Pasts:
        pasts = Pasts(erased, {}, {})
        self.snapshot, self._pasts = None, pasts
        self.forgotten += 1
        return pasts

    def heed(self, erased: int | None) -> Pasts:
        """Forget all if there was an erasure since the last call; `erased` is the last one.

        Returns the cached past revisions for readers that see this erasure, and no later one.
        """
        pasts = self._pasts
        return pasts if erased == pasts.erased else self._forget(erased)

    def adopt(self, other: DefinitionCache, revision: int, definitions: Definitions) -> None:
        """Keep the definitions of another cache, for a past revision."""
        pasts = other._pasts
        if pasts.by_revision.get(revision) is definitions:
            self._pasts = Pasts(pasts.erased, {revision: definitions}, {})
        guess = other.guess(revision)
        if guess is not None and guess.definitions is definitions:
            self.snapshot = guess

    def load(self, session: Session, kb_id: int) -> Definitions:
        """Read the definitions of the head, in one statement."""
        definition_revision, definitions = load(session, kb_id)
        self.keep(definition_revision, definitions)
        return definitions

    def at_head(
        self, session: Session, kb_id: int, definition_revision: int, archived: int
    ) -> Definitions:
        """Return the definitions of a head read in the session's transaction."""
        snapshot = self.snapshot
        if snapshot is not None and snapshot.definition_revision == definition_revision:
            return snapshot.definitions
        if snapshot is None or not archived <= snapshot.definition_revision < definition_revision:
            # Before an archive, the tables no longer show later ends. A cache may be ahead of a
            # reader that began before another thread's commit.
            return self.load(session, kb_id)
        known = snapshot.definition_revision
        definitions = refresh(session, kb_id, snapshot.definitions, known, definition_revision)
        if definitions is None:
            self.forget()
            return self.load(session, kb_id)
        self.keep(definition_revision, definitions)
        return definitions

    def guess(self, revision: int | None) -> Snapshot | None:
        """Return definitions that are current unless another process has changed some meanwhile."""
        known = self.snapshot
        if known is None or revision is None:
            return known
        return known if revision >= max(known.definition_revision, self._moved) else None

    def known(self, revision: int | None) -> Definitions | None:
        """Return cached definitions: those of a past revision never change."""
        kept = None if revision is None else self._pasts.by_revision.get(revision)
        guess = self.guess(revision) if kept is None else None
        return kept if guess is None else guess.definitions

    def at_revision(
        self,
        session: Session,
        kb_id: int,
        revision: int,
        definition_revision: int,
        archived: int,
        pasts: Pasts,
    ) -> Definitions:
        """Return the definitions of a past revision, with as few reads as possible."""
        self._moved = max(self._moved, definition_revision)
        kept = pasts.by_revision.get(revision)
        if kept is not None:
            return kept
        if revision >= definition_revision:
            definitions = self.at_head(session, kb_id, definition_revision, archived)
        else:
            # Archived versions no longer show their changes; before all of them there was nothing.
            epoch = max(last_change(session, kb_id, revision), min(archived, revision))
            known = pasts.by_epoch.get(epoch)
            definitions = load_at(session, kb_id, revision) if known is None else known
            _keep(pasts.by_epoch, epoch, definitions, CACHED_EPOCHS)
        _keep(pasts.by_revision, revision, definitions, CACHED_PASTS)
        return definitions

    def keep(self, definition_revision: int, definitions: Definitions) -> None:
        """Keep definitions, unless newer ones are kept already."""
        definitions.revision = definition_revision
        known = self.snapshot
        if known is None or known.definition_revision < definition_revision:
            self.snapshot = Snapshot(definition_revision, definitions)


def _keep(known: dict[int, Definitions], key: int, definitions: Definitions, limit: int) -> None:
    if key not in known and len(known) >= limit:
        known.clear()
    known[key] = definitions
