"""Pushes the knowledge bases of a store: once, or for as long as a service runs."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from typing import NamedTuple

from sqlalchemy import literal_column, select

from ...errors import (
    ArchivedError,
    ConflictError,
    ConnectionLostError,
    KantSqlError,
    ReplicaError,
    StatementTimeoutError,
    StoreBusyError,
    StoreIntegrityError,
    StoreReplacedError,
    StoreUnreachableError,
)
from ...sql.dialects import create_backend
from ...sql.dialects.base import Backend, Listener
from ...sql.query import Query
from ...sql.schema import ensure_schema
from ...sql.tables import HeadRow, KnowledgeBaseRow
from .histories import read_state
from .push import Progress, Pushed, Terms, push
from .target import ReplicationSide, Target, open_store

# What may be over at the next attempt.
PASSING = (
    ConnectionLostError,
    StatementTimeoutError,
    StoreBusyError,
    StoreReplacedError,
    StoreUnreachableError,
)
# What concerns one knowledge base, and stays until somebody decides.
REFUSED = ArchivedError, ConflictError, ReplicaError, StoreIntegrityError

# Seconds before the first further attempt, and at most, while a store cannot be reached.
FIRST_DELAY, LONGEST_DELAY = 1.0, 60.0
# Seconds between looks at the source: for new knowledge bases, and for what nobody notified of.
LOOK_EVERY = 1.0
# Seconds between looks whether the service is to end.
_SLICE = 0.2

_HEADS = Query(
    select(KnowledgeBaseRow.name, KnowledgeBaseRow.id, HeadRow.revision)
    .join(HeadRow, HeadRow.kb_id == KnowledgeBaseRow.id)
    .where(HeadRow.revision > literal_column("0"))
    .order_by(KnowledgeBaseRow.id)
)


class PushEvent(NamedTuple):
    """Something that a service reports.

    Attributes:
        event: `following`, `pushed`, `current`, `ahead`, `refused`, `waiting` or `stopped`.
        knowledge_base: which one it concerns; None for all.
        pushed: what was sent, or found to be there.
        seconds: how long that took.
        error: why nothing was sent.
        retry_in: seconds until the next attempt.
    """

    event: str
    knowledge_base: str | None = None
    pushed: Pushed | None = None
    seconds: float | None = None
    error: KantSqlError | None = None
    retry_in: float | None = None


class Backoff:
    """Delays that double up to a limit, at random, so that robots do not return all at once."""

    def __init__(self) -> None:
        self._next = FIRST_DELAY

    def delay(self) -> float:
        """Return the seconds to wait before the next attempt."""
        delay, self._next = self._next, min(2 * self._next, LONGEST_DELAY)
        return delay * random.uniform(0.5, 1.0)

    def reset(self) -> None:
        """Begin with short delays again."""
        self._next = FIRST_DELAY


class _Followed:
    """A knowledge base that is pushed again and again."""

    def __init__(self, source: ReplicationSide, target: Target) -> None:
        self.source = source
        self.target = target
        self.head = 0  # the source's last revision, as last seen
        self.sent = -1  # the last revision that is known to be in the target
        self.due_at = 0.0
        self.is_refused = False

    @property
    def has_news(self) -> bool:
        """Whether the target lacks something."""
        return self.head > self.sent and not self.is_refused


class _Connection:
    """Both stores, open; after an error that may pass, a service opens them again."""

    def __init__(self, source_url: str, target_url: str) -> None:
        self.source = create_backend(source_url, read_only=True)
        try:
            ensure_schema(self.source)
            self.target: Backend = open_store(target_url, self.source, "a replica")
        except BaseException:
            self.source.close()
            raise
        self.listener: Listener = self.source.listener()

    def heads(self, names: Sequence[str] | None) -> list[tuple[str, int, int]]:
        """Read name, id and last revision: of all knowledge bases, or of the named ones."""
        with self.source.open_session() as session:
            if names is None:
                return [(name, id_, number) for name, id_, number in session.rows(_HEADS)]
            found = []
            for name in names:
                kb_id = ReplicationSide(self.source, name).find(session)
                if kb_id is not None:
                    found.append((name, kb_id, read_state(session, kb_id).revision))
            return found

    def close(self) -> None:
        """Close both."""
        self.listener.close()
        self.target.close()
        self.source.close()


class PushService:
    """Pushes the knowledge bases of one store to another.

    The source is opened for reading only.
    """

    def __init__(
        self,
        source_url: str,
        target_url: str,
        *,
        name: str | None,
        terms: Terms,
        report: Callable[[PushEvent], None],
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            source_url: the store to read.
            target_url: the store to write.
            name: the knowledge base; None for all, those to come, too.
            terms: what a push may do.
            report: called with all that happens.
            is_stopped: whether to end, after the batch that is being sent.
        """
        self._urls = source_url, target_url
        self._name = name
        self._terms = terms
        self._report = report
        self._is_stopped = is_stopped
        self._connection: _Connection | None = None
        self._followed: dict[str, _Followed] = {}
        self._backoff = Backoff()

    def once(
        self, bar: Callable[[str], AbstractContextManager[Progress | None]]
    ) -> list[KantSqlError]:
        """Push each knowledge base once; return the errors of those that were refused."""
        errors: list[KantSqlError] = []
        with closing(_Connection(*self._urls)) as connection:
            for name, kb_id, _ in connection.heads(self._names):
                followed = self._make(connection, name, kb_id)
                try:
                    with bar(name) as progress:
                        self._push(followed, progress)
                except REFUSED as error:
                    self._report(PushEvent("refused", name, error=error))
                    errors.append(error)
        return errors

    def follow(self, interval: float) -> list[KantSqlError]:
        """Push what comes until told to end, or until nothing is left that may be pushed.

        Args:
            interval: seconds between two pushes of one knowledge base, at least.

        Returns:
            The errors of what was refused, if that is why it ended.
        """
        self._report(PushEvent("following"))
        errors: dict[str, KantSqlError] = {}
        try:
            while not (self._is_stopped() or self._is_refused()):
                self._try_round(interval, errors)
        finally:
            self._disconnect()
        self._report(PushEvent("stopped"))
        return [] if self._is_stopped() else [*errors.values()]

    @property
    def _names(self) -> list[str] | None:
        return None if self._name is None else [self._name]

    def _is_refused(self) -> bool:
        """Whether nothing is left that may be pushed."""
        return bool(self._followed) and all(one.is_refused for one in self._followed.values())

    def _try_round(self, interval: float, errors: dict[str, KantSqlError]) -> None:
        try:
            self._round(interval, errors)
        except PASSING as error:
            self._disconnect()
            delay = self._backoff.delay()
            self._report(PushEvent("waiting", error=error, retry_in=delay))
            self._sleep(delay)

    def _round(self, interval: float, errors: dict[str, KantSqlError]) -> None:
        """Look at the source, push what is due, and wait for more."""
        connection = self._connect()
        for name, kb_id, revision in connection.heads(self._names):
            if name not in self._followed:
                self._followed[name] = self._make(connection, name, kb_id)
            self._followed[name].head = revision
        for name, one in self._followed.items():
            if one.has_news and one.due_at <= time.monotonic() and not self._is_stopped():
                try:
                    self._push(one, None)
                    self._backoff.reset()
                except REFUSED as error:
                    one.is_refused, errors[name] = True, error
                    self._report(PushEvent("refused", name, error=error))
                one.due_at = time.monotonic() + interval
        self._wait(connection)

    def _push(self, one: _Followed, progress: Progress | None) -> None:
        started = time.monotonic()
        done = push(one.source, one.target, self._terms, progress, self._is_stopped)
        one.sent = min(done.revision, done.source_revision)
        event = "pushed" if done.revisions else "current"
        if done.revision > done.source_revision:
            event = "ahead"
        took = time.monotonic() - started
        self._report(PushEvent(event, one.source.name, done, took))

    def _wait(self, connection: _Connection) -> None:
        """Wait for a commit, or until something is due."""
        due = [one.due_at for one in self._followed.values() if one.has_news]
        if due:
            self._sleep(min(max(0.0, min(due) - time.monotonic()), LOOK_EVERY))
        else:
            # SQLite notifies of any knowledge base, PostgreSQL of one.
            first = next((one.source.kb_id for one in self._followed.values()), None)
            connection.listener.wait(first, LOOK_EVERY)

    def _sleep(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not self._is_stopped() and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, _SLICE))

    def _connect(self) -> _Connection:
        if self._connection is None:
            self._connection = _Connection(*self._urls)
            # They belong to the connections that were lost.
            refused = [name for name, one in self._followed.items() if one.is_refused]
            self._followed = {name: self._followed[name] for name in refused}
        return self._connection

    def _disconnect(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    @staticmethod
    def _make(connection: _Connection, name: str, kb_id: int) -> _Followed:
        source = ReplicationSide(connection.source, name)
        source.kb_id = kb_id
        return _Followed(source, Target(connection.target, name))
