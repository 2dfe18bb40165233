"""Pushes the knowledge bases of a store: once, or continuously as a service."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, closing
from typing import NamedTuple

from ...arguments import Progress
from ...errors import (
    ArchivedError,
    AuthenticationError,
    ClosedError,
    ConflictError,
    DivergedError,
    ForkedError,
    KantSqlError,
    ReadOnlyStoreError,
    ReplicaError,
    SchemaError,
    SchemaMissingError,
    StatementTimeoutError,
    StoreError,
    StoreFullError,
    StoreIntegrityError,
    StoreReplacedError,
    TableMissingError,
)
from ...sql.catalog import of_written
from ...sql.dialects import create_backend
from ...sql.dialects.base import PASSING, Backend, Listener
from ...sql.schema import check_session, ensure_schema
from ...sql.tables import HeadRow, KnowledgeBaseRow
from .push import Pushed, Terms, read_head, send
from .target import ReplicationSide, Target, begin_on, open_store, read_state

# Errors that the next attempt may not have.
MAY_PASS = (*PASSING, StatementTimeoutError, StoreFullError, StoreReplacedError)
# Errors of one knowledge base that stay until somebody decides.
REFUSED = ArchivedError, ConflictError, ReplicaError, StoreIntegrityError
# Errors of all knowledge bases that stay.
_ENDING = AuthenticationError, ClosedError, ForkedError, ReadOnlyStoreError
# Errors that an upgrade, or the return of a file, ends.
_REBUILT = SchemaError, TableMissingError

# Seconds before the first retry, and the maximum, while a store cannot be reached.
FIRST_DELAY, LONGEST_DELAY = 1.0, 60.0
# Seconds between checks of the source for new knowledge bases, and for missed notifications.
LOOK_EVERY = 1.0
# Seconds between checks whether the service should end.
_SLICE = 0.2

_HEADS = of_written(KnowledgeBaseRow.name, KnowledgeBaseRow.id, HeadRow.revision)


class PushEvent(NamedTuple):
    """An event that a service reports."""

    event: str  # `following`, `pushed`, `current`, `ahead`, `refused`, `waiting` or `stopped`
    knowledge_base: str | None = None  # its knowledge base; None for all
    pushed: Pushed | None = None  # the revisions that were sent, or already there
    seconds: float | None = None  # the duration
    error: KantSqlError | None = None  # why nothing was sent
    retry_in: float | None = None  # seconds until the next attempt


class Backoff:
    """Delays that double up to a limit, with a random part, so robots do not all return at once."""

    def __init__(self) -> None:
        self._next = FIRST_DELAY

    def delay(self) -> float:
        """Return the seconds to wait before the next attempt."""
        delay, self._next = self._next, min(2 * self._next, LONGEST_DELAY)
        return delay * random.uniform(0.5, 1.0)

    def longest(self) -> float:
        """Return the seconds to wait for somebody's intervention."""
        self._next = LONGEST_DELAY
        return self.delay()

    def reset(self) -> None:
        """Return to short delays."""
        self._next = FIRST_DELAY


class _Followed:
    """A knowledge base that is pushed repeatedly."""

    def __init__(self, source: ReplicationSide, target: Target) -> None:
        self.source = source
        self.target = target
        self.head = 0  # the source's last known revision
        self.sent = -1  # the last revision that is certainly in the target
        self.due_at = 0.0
        self.is_refused = False
        self.backoff = Backoff()

    @property
    def has_news(self) -> bool:
        """Whether the target may lack something."""
        # In a damaged source, the head may have any value.
        return self.head != self.sent and not self.is_refused


class _Connection:
    """Both stores, open; after a temporary error, a service opens them again."""

    def __init__(self, source_url: str, target_url: str) -> None:
        with ExitStack() as opened:
            self.source = create_backend(source_url, read_only=True)
            opened.callback(self.source.close)
            ensure_schema(self.source)
            self.target: Backend = open_store(target_url, self.source, "a replica")
            opened.callback(self.target.close)
            self.listener: Listener = self.source.listener()
            opened.callback(self.listener.close)
            self._opened = opened.pop_all()

    def heads(self, name: str | None) -> list[tuple[str, int, int]]:
        """Read name, id and last revision of all knowledge bases, or of the named one."""
        with self.source.open_session() as session:
            if name is None:
                return [(each, id_, number) for each, id_, number in session.rows(_HEADS)]
            kb_id = ReplicationSide(self.source, name).find(session)
            return [] if kb_id is None else [(name, kb_id, read_state(session, kb_id).revision)]

    def check(self) -> None:
        """Raise an error that concerns all knowledge bases: a store is gone, locked or replaced."""
        for backend in (self.source, self.target):
            # The connections in the pool may be lost, too.
            backend.renew()
        with begin_on(self.source) as session:
            check_session(session)
        # On a database that writers lock as a whole, this waits for them.
        with begin_on(self.target, write=True) as session:
            check_session(session)

    def close(self) -> None:
        """Close both stores."""
        self._opened.close()


class PushService:
    """Pushes the knowledge bases of one store to another.

    The source is opened for reading only.
    """

    def __init__(
        self,
        source_url: str,
        target_url: str,
        *,
        name: str | None,  # the knowledge base; None for all, including later ones
        terms: Terms,
        report: Callable[[PushEvent], None],
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare without opening anything."""
        # `is_stopped` is called after each batch: whether to end.
        self._urls = source_url, target_url
        self._name = name
        self._terms = terms
        self._report = report
        self._is_stopped = is_stopped
        self._connection: _Connection | None = None
        self._was_connected = False
        self._followed: dict[str, _Followed] = {}
        self._backoff = Backoff()

    def once(
        self, bar: Callable[[str], AbstractContextManager[Progress | None]]
    ) -> list[KantSqlError]:
        """Push each knowledge base once; return the errors of those that were not sent."""
        errors: list[KantSqlError] = []
        with closing(_Connection(*self._urls)) as connection:
            for name, kb_id, _ in connection.heads(self._name):
                followed = self._make(connection, name, kb_id)
                with bar(name) as progress:
                    error = self._attempt(connection, followed, progress)
                if error is None:
                    continue
                errors.append(error)
                may_pass = isinstance(error, MAY_PASS)
                self._report(PushEvent("waiting" if may_pass else "refused", name, error=error))
                if may_pass:
                    # After waiting in vain, such as for an archive, do not wait again.
                    self._terms = self._terms._replace(is_patient=False)
        return errors

    def follow(self, interval: float) -> list[KantSqlError]:
        """Push new revisions until told to end, or until no knowledge base may be pushed."""
        # Two pushes of one knowledge base are at least `interval` seconds apart. If refusals end
        # it, their errors are returned.
        self._report(PushEvent("following"))
        errors: dict[str, KantSqlError] = {}
        try:
            while not (self._is_stopped() or self._is_refused()):
                self._try_round(interval, errors)
        finally:
            self._disconnect()
        self._report(PushEvent("stopped"))
        return [] if self._is_stopped() else [*errors.values()]

    def _is_refused(self) -> bool:
        """Whether no knowledge base may be pushed any more."""
        return bool(self._followed) and all(one.is_refused for one in self._followed.values())

    def _try_round(self, interval: float, errors: dict[str, KantSqlError]) -> None:
        try:
            self._round(interval, errors)
        except _REBUILT as error:
            is_missing = isinstance(error, (SchemaMissingError, TableMissingError))
            if is_missing and not self._was_connected:
                raise
            self._wait_after(
                error, self._backoff.delay() if is_missing else self._backoff.longest()
            )
        except MAY_PASS as error:
            self._wait_after(error, self._backoff.delay())

    def _wait_after(self, error: KantSqlError, delay: float) -> None:
        """Close both stores, and wait before opening them again."""
        self._disconnect()
        self._report(PushEvent("waiting", error=error, retry_in=delay))
        self._sleep(delay)

    def _round(self, interval: float, errors: dict[str, KantSqlError]) -> None:
        """Check the source, push what is due, and wait."""
        connection = self._connect()
        for name, kb_id, revision in connection.heads(self._name):
            if name not in self._followed:
                self._followed[name] = self._make(connection, name, kb_id)
            self._followed[name].head = revision
        for one in self._followed.values():
            if one.has_news and one.due_at <= time.monotonic() and not self._is_stopped():
                self._push_due(connection, one, interval, errors)
        self._wait(connection)

    def _push_due(
        self,
        connection: _Connection,
        one: _Followed,
        interval: float,
        errors: dict[str, KantSqlError],
    ) -> None:
        name, error = one.source.name, self._attempt(connection, one, None)
        delay = interval
        if error is None:
            self._backoff.reset()
            one.backoff.reset()
        elif isinstance(error, MAY_PASS) or _is_behind(one.source, error):
            delay = max(interval, one.backoff.delay())
            self._report(PushEvent("waiting", name, error=error, retry_in=delay))
        else:
            one.is_refused, errors[name] = True, error
            self._report(PushEvent("refused", name, error=error))
        one.due_at = time.monotonic() + delay

    def _attempt(
        self, connection: _Connection, one: _Followed, progress: Progress | None
    ) -> KantSqlError | None:
        """Push a knowledge base; return errors of it alone, and raise errors of all."""
        try:
            self._push(one, progress)
        except REFUSED as error:
            return error
        except _ENDING:
            raise
        except StoreError as error:
            # The failed store may be an archive, which only some knowledge bases need.
            connection.check()
            return error if isinstance(error, MAY_PASS) else _unreadable(one, error)
        return None

    def _push(self, one: _Followed, progress: Progress | None) -> None:
        started = time.monotonic()
        done = send(one.source, one.target, self._terms, progress, self._is_stopped)
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
            # SQLite notifies about all knowledge bases, PostgreSQL about one.
            kept = (one.source.kb_id for one in self._followed.values() if not one.is_refused)
            connection.listener.wait(next(kept, None), LOOK_EVERY)

    def _sleep(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not self._is_stopped() and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, _SLICE))

    def _connect(self) -> _Connection:
        if self._connection is None:
            self._connection = _Connection(*self._urls)
            self._was_connected = True
            # The others belong to the lost connections.
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


def _is_behind(source: ReplicationSide, error: KantSqlError) -> bool:
    """Whether the source is a replica behind its target: its origin will send it the rest."""
    if not isinstance(error, DivergedError) or error.source_hash is not None:
        return False
    return read_head(source).origin is not None


def _unreadable(one: _Followed, error: StoreError) -> StoreIntegrityError:
    """Make the error for a knowledge base that a database cannot read or accept."""
    source, name = one.source.backend.label, one.source.name
    made = StoreIntegrityError(
        f"{source}: knowledge base {name!r} was not sent, or only its first revisions: {error}; "
        f"'kant-sql verify' shows what is damaged in {source}; restore it from a copy"
    )
    made.__cause__ = error
    return made
