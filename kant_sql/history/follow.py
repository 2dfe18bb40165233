"""The change feed: resumable pages, and waiting for new revisions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial

from ..arguments import seconds
from ..errors import (
    ArchivedError,
    ClosedError,
    ConnectionLostError,
    ReadOnlyError,
    StoreError,
    StoreUnreachableError,
)
from ..moment_text import When
from ..sql.dialects import base as retry
from ..sql.dialects.base import FIRST_PAUSE, LONGEST_PAUSE, PASSING, Listener, Session
from ..store.snapshot import HeadPosition, archive_of, read_position
from ..store.state import State
from ..store.store import Store
from .moments import last_before
from .revisions import PAGE, LogEntry, at_most, feed, read_page, refuse_unknown


def changes(state: State, after: When = 0, *, limit: int | None = None) -> Iterator[LogEntry]:
    """Read revisions and their changes, oldest first: a feed that you can resume.

    Revisions come in order and without gaps. A consumer that stores the number of the last
    revision it processed, and resumes from there, receives each revision at least once.

    Args:
        after: begin after this revision, given as for `kb.at`.
        limit: the maximum number of revisions; None for all.

    Returns:
        The entries, read in pages on demand; the iterator ends at the head.

    Raises:
        UnknownRevisionError: the knowledge base has no revision `after` yet.
        ArchivedError: changes after `after` were moved to an archive.
        StoreIntegrityError: a revision is missing.

    Examples:
        >>> processed = 0
        >>> for entry in kb.changes(after=processed):
        ...     processed = entry.revision.number
        >>> processed
        1
    """
    return feed(state.store, partial(_read_changes, state, after), limit)


def _read_changes(state: State, after: When, limit: int | None) -> Iterator[LogEntry]:
    """Read changes, oldest first, in pages."""
    begin = last_before(state, after)
    left = at_most(limit)
    return _following(state, begin, left, _read_page(state, begin, min(left, PAGE)))


def _following(state: State, after: int, left: int, page: list[LogEntry]) -> Iterator[LogEntry]:
    size = PAGE
    while page:
        yield from page
        wanted, left = min(left, size), left - len(page)
        after = page[-1].revision.number
        # A page that ended early, for its many changes, sizes the next one.
        size = min(2 * size, PAGE) if len(page) == wanted else len(page)
        page = _read_page(state, after, min(left, size))


def _read_page(state: State, after: int, size: int) -> list[LogEntry]:
    store = state.store

    def page(session: Session, kb_id: int | None) -> list[LogEntry]:
        _, head, archived, *_ = read_position(session, kb_id)
        head = head if state.at is None else state.at
        refuse_unknown(store.name, after, head)
        if kb_id is not None and after < archived:
            raise ArchivedError(
                f"changes of knowledge base {store.name!r} up to revision {archived} were moved to "
                f"an archive; begin after that one, or ask the archive in "
                f"{archive_of(session, kb_id, after)}"
            )
        high = int(min(head, after + size))
        return [] if kb_id is None or high <= after else read_page(session, kb_id, after + 1, high)

    return store.query_in_snapshot(page)


# Seconds between polls: a writer killed right after its commit notifies nobody.
LOOK_EVERY = 1.0
# Seconds between checks whether to end the wait.
SLICE = 0.5


def watch(state: State, after: When | None = None, *, timeout: float | None = None) -> int | None:
    """Wait for a new revision.

    Revisions of other processes count, too. The wait survives a restart of the server.

    Args:
        after: the last revision that the caller knows, given as for `kb.at`; None for the present
            head.
        timeout: seconds to wait; None to wait without limit.

    Returns:
        The number of the head, which is larger than `after`; None after a timeout.

    Raises:
        UnknownRevisionError: the knowledge base has no revision `after` yet.
        ReadOnlyError: this is a view of the past, or the task or thread has a transaction open.
        InvalidTimeoutError: `timeout` is negative, or not a number.
        StoreError: the timeout passed while the store was unreachable, or the knowledge base
            was closed.

    Examples:
        >>> kb.watch(after=0)
        1
        >>> kb.watch(after=1, timeout=0) is None
        True
    """
    return watch_until(state, after, timeout)


def watch_until(
    state: State,
    after: When | None,
    timeout: float | None,
    is_ended: Callable[[], bool] | None = None,
) -> int | None:
    """Wait as `watch` does, or until somebody ends the wait, which takes effect after a while."""
    refuse_unwatchable(state)
    begin = None if after is None else last_before(state, after)
    deadline = time.monotonic() + seconds(timeout)
    with closing(state.store.backend.listener()) as listener:
        return _Watch(state.store, listener, begin, deadline, is_ended).wait()


def refuse_unwatchable(state: State) -> None:
    """Refuse to wait if no revision can come."""
    store, at = state
    if at is not None:
        raise ReadOnlyError(
            f"this is knowledge base {store.name!r} at revision {at}, which never changes; watch "
            "the knowledge base itself"
        )
    if store.current() is not None:
        raise ReadOnlyError(
            f"this task or thread has a transaction of knowledge base {store.name!r} open, and "
            "would wait for itself; end the transaction first, or watch in another task or thread"
        )


@dataclass(eq=False)
class _Watch:
    """A waiting call, which survives a temporary loss of the store."""

    _store: Store
    _listener: Listener
    _after: int | None
    _deadline: float
    _is_ended: Callable[[], bool] | None
    _pause: float = FIRST_PAUSE
    _unknown_since: float | None = None

    def wait(self) -> int | None:
        """Wait for a new revision, or until the deadline."""
        most = LOOK_EVERY if self._is_ended is None else min(LOOK_EVERY, SLICE)
        while self._is_ended is None or not self._is_ended():
            self._refuse_closed()
            position = None
            try:
                position = self._listener.guarded(self._read)
                if self._is_news(position):
                    return position.head
                if self._left() <= 0:
                    return None
                self._listener.wait(position.kb_id, min(self._left(), most))
                self._pause = FIRST_PAUSE
            except StoreError as error:
                self._refuse_closed()
                if not isinstance(error, PASSING):
                    raise
                if position is None:
                    self._distrust(error)
                    if self._left() <= 0:
                        return self._ask_at_last(error)
                self._pause_after_failure()
        return None

    def _refuse_closed(self) -> None:
        store = self._store
        if store.is_closed:
            raise ClosedError(
                f"{store.backend.label}: knowledge base {store.name!r} was closed while this call "
                "waited for a revision; connect again"
            )

    def _read(self) -> HeadPosition:
        if self._unknown_since is None:
            self._unknown_since = time.monotonic()
        position = self._store.query_once(read_position)
        self._unknown_since = None
        return position

    def _ask_at_last(self, error: StoreError) -> int | None:
        """Retry for a while, as any other call does: the state is unknown."""
        since = self._unknown_since
        if since is not None and time.monotonic() - since > retry.RETRY_FOR:
            # The time was used up before, or by one attempt that waited for a connection.
            raise error
        position = self._store.query_in_snapshot(read_position)
        return position.head if self._is_news(position) else None

    def _is_news(self, position: HeadPosition) -> bool:
        if self._after is None:
            self._after = position.head
        refuse_unknown(self._store.name, self._after, position.head)
        return position.head > self._after

    def _left(self) -> float:
        return self._deadline - time.monotonic()

    def _distrust(self, error: Exception) -> None:
        """Note the failure of a read; a shared listener does so itself."""
        backend = self._store.backend
        if isinstance(error, StoreUnreachableError) and not backend.has_answered:
            raise error
        if isinstance(error, ConnectionLostError):
            # The other connections of the pool are probably lost, too.
            backend.renew()

    def _pause_after_failure(self) -> None:
        time.sleep(max(0.0, min(self._pause, self._left())))
        self._pause = min(2 * self._pause, LONGEST_PAUSE)
