"""The calls of replication: push to another store, with open connections, and promote."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing, contextmanager
from weakref import WeakKeyDictionary

from sqlalchemy import null

from ...arguments import Progress, expect, flag, optional_call, optional_text
from ...errors import (
    ClosedError,
    InvalidArgumentError,
    InvalidUrlError,
    SchemaError,
    StoreReplacedError,
    TableMissingError,
)
from ...knowledge.canonical import promotion_text
from ...sql.changes import PROMOTION
from ...sql.dialects import create_backend
from ...sql.dialects.base import Backend, unforked
from ...sql.rows import table_of
from ...sql.tables import PromotionRow
from ...store.head import check_last, set_head
from ...store.state import State
from ...store.store import Store
from .push import Pushed, Terms, send
from .target import ReplicationSide, Target, open_store

logger = logging.getLogger("kant_sql.history")

# Errors that a new connection may not have: the store was replaced, or has another version now.
_STALE = ClosedError, SchemaError, StoreReplacedError, TableMissingError
# Guards changes of the state that all objects of this module share.
_GUARD = unforked()


class _OpenTarget:
    """A store that stays open; a forgotten one closes after its last push."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.pushes = 0  # the number of running pushes
        self.is_forgotten = False  # whether no further push begins on it
        # For each knowledge base, its id in the source and in the target, once known.
        self.ids: dict[str, tuple[int | None, int | None]] = {}


class _Targets:
    """The stores to which the knowledge bases of one store were pushed.

    A robot pushes every few seconds; a new connection would take longer than the data.
    """

    def __init__(self, source: Backend) -> None:
        self._open: dict[str, _OpenTarget] = {}
        source.when_closed.append(self.close)

    @contextmanager
    def using(self, url: str, source: Backend) -> Iterator[_OpenTarget]:
        """Keep a store open during a `with` block; open it if needed."""
        with _GUARD:
            target = self._open.get(url)
            if target is not None:
                target.pushes += 1
        if target is None:
            made = open_store(url, source, "a replica")
            with _GUARD:
                target = self._open.setdefault(url, _OpenTarget(made))
                target.pushes += 1
            if target.backend is not made:
                # Another thread was first.
                made.close()
        try:
            yield target
        finally:
            with _GUARD:
                target.pushes -= 1
                is_over = target.is_forgotten and not target.pushes
            if is_over:
                target.backend.close()

    def is_open(self, url: str) -> bool:
        """Whether a store is open."""
        return url in self._open

    def forget(self, url: str, target: _OpenTarget | None = None) -> None:
        """Stop keeping a store open; with `target`, unless it was opened again since."""
        with _GUARD:
            found = self._open.get(url)
            if found is None or target not in (None, found):
                return
            del self._open[url]
            found.is_forgotten = True
            is_idle = not found.pushes
        if is_idle:
            found.backend.close()

    def close(self) -> None:
        """Close all stores, even during their pushes."""
        for url, target in [*self._open.items()]:
            self.forget(url)
            target.backend.close()


_TARGETS: WeakKeyDictionary[Backend, _Targets] = WeakKeyDictionary()


def push(
    state: State,
    url: str,
    *,
    archive: str | None = None,
    adopt: bool = False,
    progress: Progress | None = None,
) -> Pushed:
    """Send the revisions that another store lacks, with their numbers, times and hashes.

    The target becomes a replica, which refuses local writes until you promote it. The push checks
    each batch there against its hashes before it commits. Call it again to resume an interrupted
    push. The connection to the target stays open for the next call; if there is nothing new, that
    push takes one statement on each side.

    Args:
        url: the target's URL, on any dialect; a new SQLite file is created.
        archive: the URL of the archive with the moved versions of this store; by default the
            one that this store names.
        adopt: whether a target that is not a replica becomes one, if it has a part of this history
            and nothing else.
        progress: called with the last revisions of the target and of this store.

    Returns:
        The sent revisions.

    Raises:
        DivergedError: the target's history differs; the error names the first different revision.
        ReplicaError: the target is not a replica.
        ArchivedError: an archive has some of the revisions to send.
        StoreIntegrityError: a revision does not fit its hash; nothing of its batch was written.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.

    Examples:
        >>> kb.store.push("sqlite:///server.db").revisions == kb.revision
        True
        >>> kb.store.push("sqlite:///server.db").revisions
        0
    """
    store = state.store
    expect(url, str, "the URL of the target", InvalidUrlError)
    optional_text(archive, "archive")
    flag(adopt, "adopt", InvalidArgumentError)
    optional_call(progress, "progress")
    store.refuse_open(", and what is committed is pushed")
    sent = _push(store, url, Terms(archive, adopt), progress)
    if sent.revisions:
        logger.info(
            "knowledge base %r: revisions %d to %d were sent to %s",
            store.name,
            sent.before + 1,
            sent.revision,
            sent.target,
        )
    return sent


def _push(store: Store, url: str, terms: Terms, progress: Progress | None) -> Pushed:
    store.refuse_closed()
    source = store.backend
    with _GUARD:
        targets = _TARGETS.get(source) or _TARGETS.setdefault(source, _Targets(source))

    def run() -> Pushed:
        with targets.using(url, source) as opened:
            here, there = ReplicationSide(source, store.name), Target(opened.backend, store.name)
            here.kb_id, there.kb_id = opened.ids.get(store.name, (None, None))
            try:
                done = send(here, there, terms, progress)
            except _STALE:
                targets.forget(url, opened)
                raise
            opened.ids[store.name] = here.kb_id, there.kb_id
        return done

    if targets.is_open(url):
        try:
            return run()
        except _STALE:
            if source.is_closed:
                raise
            # An earlier call opened it; the present store at this URL may work.
    # Remove a new file that gets no revision.
    with closing(create_backend(url)) as file:
        is_new, done = not file.exists(), None
        try:
            done = run()
        finally:
            if is_new and (done is None or not done.revision):
                targets.forget(url)
                file.remove()
    return done


_FORGET_ORIGIN = set_head(
    origin=null(), origin_revision=null(), origin_committed_at=null(), heard_at=null()
)


def promote(state: State, *, reason: str | None = None, actor: str | None = None) -> int | None:
    """Turn a replica into a knowledge base that you can write to.

    This makes a revision. From then on it refuses new revisions of the origin.

    Args:
        reason: why.
        actor: who promotes; by default the knowledge base's actor.

    Returns:
        The revision; None if this is not a replica.

    Raises:
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.store.promote() is None
        True
    """
    store = state.store
    with store.transaction(actor, reason, promotes=True) as transaction:
        head, number = transaction.head, transaction.number
        if head.origin is None:
            return None
        check_last(transaction.session, transaction.kb_id, head)
        said = transaction.allocate(), head.revision, head.origin
        transaction.record(PROMOTION, table_of(PromotionRow), promotion_text, *said)
        transaction.session.run(_FORGET_ORIGIN, kb=transaction.kb_id)
    logger.info("knowledge base %r: revision %d promoted it", store.name, number)
    return number
