"""Pushes a knowledge base to another store: the missing revisions, in batches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from ...arguments import Progress
from ...errors import (
    ArchivedError,
    AuthenticationError,
    ConnectionLostError,
    DivergedError,
    InvalidUrlError,
    ReplicaError,
    SchemaError,
)
from ...sql.dialects import create_backend
from ...sql.dialects.base import Session, retrying
from ...sql.schema import ensure_schema
from ...store.head import Head, hash_of
from .batch import Batches, copy_batch, move, wipe
from .copy import Stores
from .target import HeadState, ReplicationSide, Target, begin_on, diverged, last_archive, read_state

T = TypeVar("T")


class Pushed(NamedTuple):
    """The result of a push.

    Attributes:
        target: the URL of the target, without a password.
        before: the last revision that the target had before.
        revision: the last revision that it has now.
        source_revision: the last revision of the source.
        versions: the number of versions written or ended there.
        remaining: where bytes of erased texts may remain there, and the command that removes them.
    """

    target: str
    before: int
    revision: int
    source_revision: int
    versions: int
    remaining: tuple[str, ...] = ()

    @property
    def revisions(self) -> int:
        """The number of sent revisions."""
        return self.revision - self.before


class Terms(NamedTuple):
    """The options of a push."""

    # the URL of the archive with the moved versions of the source; None for the one that the
    # source names
    archive: str | None = None
    # whether a knowledge base that is not a replica becomes one, if its history fits
    adopt: bool = False
    # whether to retry for some seconds while a store is busy or unreachable
    is_patient: bool = True


def send(
    source: ReplicationSide,
    target: Target,
    terms: Terms,
    progress: Progress | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> Pushed:
    """Send the revisions that a target lacks, as the question `push` describes."""
    # Each of several transactions leaves the target complete at some revision. `is_stopped` is
    # called between them.
    with ExitStack() as stack:
        return _Push(source, target, terms, stack).run(progress, is_stopped)


@dataclass
class _Push:
    _source: ReplicationSide
    _target: Target
    _terms: Terms
    _stack: ExitStack
    _archive: ReplicationSide | None = None
    _batches: Batches = field(default_factory=Batches)
    # The target's last revision under its first lock: another push may have come before.
    _before: int | None = None

    def run(self, progress: Progress | None, is_stopped: Callable[[], bool]) -> Pushed:
        """Compare the heads, and send batches until the target has all revisions of the source."""
        # One statement on each side, once the ids are known.
        here, there = self._retrying(lambda: (read_head(self._source), read_head(self._target)))
        at = there.revision
        is_same = (there.revision, there.hash) == (here.revision, here.hash)
        # A knowledge base that is not a replica may be ahead; the check refuses it.
        is_replica = there.origin is not None or there.revision == 0
        is_over = is_replica and (is_same or here.revision == 0)
        while not is_over and not is_stopped():
            here, at, is_over = self._retrying(self._advance)
            if progress is not None:
                progress(min(at, here.revision), here.revision)
        remaining = wipe(self._target.backend) if self._batches.erasures else ()
        versions = self._batches.versions
        before = there.revision if self._before is None else self._before
        return Pushed(self._target.backend.label, before, at, here.revision, versions, remaining)

    def _retrying(self, work: Callable[[], T]) -> T:
        def once() -> T:
            try:
                return work()
            except ConnectionLostError:
                for side in (self._source, self._archive):
                    if side is not None:
                        side.backend.renew()
                raise

        return retrying(self._target.backend, once) if self._terms.is_patient else once()

    def _advance(self) -> tuple[HeadState, int, bool]:
        """Send a batch; return the source's head, the target's last revision, and if it is all."""
        with (
            self._target.locked() as (session, target_kb, head),
            begin_on(self._source.backend) as reader,
        ):
            here = read_state(reader, self._source.find(reader))
            stores = Stores(reader, self._source.kb_id or 0, session, target_kb)
            self._check(stores, here, head)
            self._before = head.revision if self._before is None else self._before
            if head.revision >= here.revision:
                self._adopt(stores, here, head)
                return here, head.revision, True
            with self._complete(stores, here, head) as (whole, state):
                may_return = max(here.archived_revision, head.archived_revision) > 0
                bounds = self._batches.following(state, head, state.revision, may_return)
                copied = copy_batch(whole, self._source, here, head, bounds)
        self._batches.add(copied)
        return here, bounds.high, bounds.high == here.revision

    def _check(self, stores: Stores, here: HeadState, head: Head) -> None:
        """Refuse a target with another history, or one that others may write to."""
        name, label = self._source.name, self._target.backend.label
        at = min(here.revision, head.revision)
        if at:
            hashes = {
                _hash(stores.source, stores.source_kb, at, here),
                _hash(stores.target, stores.target_kb, at, head),
            }
            if None in hashes or len(hashes) > 1:
                raise diverged(stores, name, at)
        if not head.revision or head.origin is not None:
            if head.revision > here.revision:
                self._refuse_restored(stores, here)
            return
        if head.revision > here.revision:
            raise ReplicaError(
                f"{label}: knowledge base {name!r} is not a replica, and is at revision "
                f"{head.revision}, ahead of {here.revision} in {self._source.backend.label}; "
                "nothing was written: push the other way, or into another store"
            )
        if self._terms.adopt and here.origin is not None:
            raise ReplicaError(
                f"{self._source.backend.label}: knowledge base {name!r} is itself a replica, of "
                f"the one in {here.origin}; nothing was written: if {label} is that one, nobody "
                "could write to either; push from the original, or promote this source"
            )
        if not self._terms.adopt:
            raise ReplicaError(
                f"{label}: knowledge base {name!r} is not a replica: others may write to it; "
                f"nothing was written. It has the same history up to revision {head.revision}: to "
                "make it a replica, which refuses local writes, push with adopt=True (--adopt)"
            )

    def _refuse_restored(self, stores: Stores, here: HeadState) -> None:
        """Refuse a source that lacks an erasure: its erased texts came back."""
        session, kb_id = stores.target, stores.target_kb
        erased = read_state(session, kb_id).erased
        if erased <= here.revision:
            return
        label, target = self._source.backend.label, self._target.backend.label
        why = (
            "it was restored from an older backup, and has the erased texts again; nothing was "
            "written: push from that replica into a new store, promote that, and destroy this one"
            if here.origin is None
            else f"it is behind that replica, and has the erased texts; nothing was written: push "
            f"to it from {here.origin} first"
        )
        raise DivergedError(
            f"{target}: revision {erased} of knowledge base {self._source.name!r} is an erasure, "
            f"and {label} is at revision {here.revision}: {why}",
            erased,
            None,
            hash_of(session, kb_id, erased),
        )

    def _adopt(self, stores: Stores, here: HeadState, head: Head) -> None:
        """Make a target a replica if it already has all revisions."""
        if head.origin is None and head.revision == here.revision:
            session, kb_id = stores.target, stores.target_kb
            next_id = max(head.next_id, here.next_id)
            definitions = head.definition_revision
            move(session, kb_id, self._source, here, head, None, definitions, next_id)
            session.commit(kb_id)

    @contextmanager
    def _complete(
        self, stores: Stores, here: HeadState, head: Head
    ) -> Iterator[tuple[Stores, HeadState]]:
        """Find the store with all versions of the next revisions: the source, or its archive."""
        if head.revision >= here.archived_revision:
            yield stores, here
            return
        archive = self._find_archive(stores, here, head)
        with begin_on(archive.backend) as reader:
            state = read_state(reader, archive.find(reader))
            whole = stores._replace(source=reader, source_kb=archive.kb_id or 0)
            self._check_archive(stores, whole, here, head, state)
            # After these revisions, the source is newer. They bring the results of later erasures.
            last = max(here.archived_revision, state.erased)
            yield whole, state._replace(revision=min(state.revision, last))

    def _find_archive(self, stores: Stores, here: HeadState, head: Head) -> ReplicationSide:
        if self._archive is None:
            url = self._terms.archive
            if url is None:
                url = last_archive(stores.source, stores.source_kb) or ""
            try:
                backend = create_backend(url, read_only=True)
                self._stack.callback(backend.close)
                if backend.is_server and self._terms.archive is None:
                    # Anybody who wrote the source's file could name a server, and get a password.
                    why = ", a server, which only who pushes may name"
                    raise self._lacking(stores, here, head, why)
                ensure_schema(backend)
            except (AuthenticationError, InvalidUrlError, SchemaError) as error:
                raise self._lacking(stores, here, head, f": {error}") from error
            self._archive = ReplicationSide(backend, self._source.name)
        return self._archive

    def _check_archive(
        self, stores: Stores, whole: Stores, here: HeadState, head: Head, state: HeadState
    ) -> None:
        """Refuse an archive of another knowledge base, or an incomplete one."""
        upto = here.archived_revision
        is_it = state.revision >= upto and hash_of(whole.source, whole.source_kb, upto) == hash_of(
            stores.source, stores.source_kb, upto
        )
        if not is_it or state.archived_revision > head.revision:
            label = whole.source.backend.label
            raise self._lacking(stores, here, head, f", and {label} does not have them")

    def _lacking(self, stores: Stores, here: HeadState, head: Head, why: str) -> ArchivedError:
        """Build the error for revisions that only an archive has."""
        low, high = head.revision + 1, here.archived_revision
        place = last_archive(stores.source, stores.source_kb) or ""
        return ArchivedError(
            f"{self._source.backend.label}: a part of revisions {low} to {high} of knowledge base "
            f"{self._source.name!r} was moved to the archive {place}{why}; nothing of these was "
            "written: give the URL of that archive, with its password, as archive= (--archive URL)"
        )


def _hash(session: Session, kb_id: int, at: int, head: HeadState | Head) -> str | None:
    """Read the hash of a revision; None if it is missing, or if the head has another."""
    found = hash_of(session, kb_id, at)
    return found if head.revision != at or head.hash == found else None


def read_head(side: ReplicationSide) -> HeadState:
    """Read the head of one side, in its own session."""
    with side.backend.open_session() as session:
        return read_state(session, side.find(session))
