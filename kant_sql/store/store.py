"""One knowledge base, shared by the threads of a process: reads, transactions, lost commits.

It holds the caches: identities, which never change, and definitions with the revision that last
changed one.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from datetime import datetime, timedelta
from functools import partial
from types import TracebackType
from typing import Any, TypeVar

from sqlalchemy import select

from ..arguments import one_of, shown, whole_number
from ..errors import (
    ConnectionLostError,
    InvalidArgumentError,
    InvalidMetadataError,
    KantSqlError,
    OutcomeUnknownError,
    ReadOnlyError,
    ReplicaError,
    StaleRevisionError,
    StoreBusyError,
    StoreError,
    StoreReplacedError,
    printable,
)
from ..knowledge.canonical import Metadata, make_metadata
from ..knowledge.definitions import Definitions, PendingDefinitions
from ..knowledge.sayings import COMMITTED, FROM_NOW_ON, OBSERVED, Given, make_period
from ..sql.dialects.base import Backend, Session, WriterLock, retrying
from ..sql.query import Query, StoreClock
from ..sql.schema import ensure_schema
from .caches import Agreements, AtomCache, DefinitionCache, FluentCache
from .head import Committed, Head, create_knowledge_base, find_knowledge_base, hash_of, lock_head
from .ledger import WriteContext
from .ownership import OPEN, Block, block_ahead, blocks_of_thread, own_block
from .snapshot import DefinitionsMovedError, View, open_view, read_position, vanished
from .transaction import Transaction

T = TypeVar("T")

logger = logging.getLogger("kant_sql.store")

_CLOCK = Query(select(StoreClock()))

# In seconds: how far the store's clock may be behind the last revision without a warning, and the
# interval of warnings.
CLOCK_BEHIND = timedelta(minutes=1)
CLOCK_PATIENCE = 3600.0


def end_session(session: Session) -> None:
    """Roll back an open transaction, and return the connection."""
    try:
        session.rollback()
    except ConnectionLostError:
        # The server rolls it back; do not hide an earlier error.
        pass
    finally:
        session.close()


def close_backend(backend: Backend) -> None:
    """Close all connections; roll back this thread's open transactions at once."""
    backend.is_closed = True
    _roll_back(
        block
        for block in blocks_of_thread()
        if block.transaction is not None and block.transaction.session.backend is backend
    )
    backend.close()


def _roll_back(blocks: Iterable[Block]) -> None:
    for block in blocks:
        if block.transaction is not None:
            with suppress(StoreError):
                block.transaction.session.rollback()


class Store:
    """Reads and writes a knowledge base, for all threads of a process."""

    def __init__(
        self,
        backend: Backend,
        name: str,
        actor: str | None,
        clock: str = COMMITTED,
        *,
        is_one_of_many: bool = False,
    ) -> None:
        # The metadata of revisions without a block.
        self._metadata = make_metadata(actor, None, None)
        if not isinstance(name, str) or not name or len(name) > 255 or not name.isprintable():
            raise InvalidMetadataError(
                f"{shown(name)} cannot name a knowledge base; give 1 to 255 printable characters"
            )
        self.backend = backend
        self.name = name
        self.actor = actor  # the actor of transactions that name none
        # Whether others share the backend: then it was checked before, and this store does not
        # close it.
        self.is_one_of_many = is_one_of_many
        # Whether a transaction is valid from its commit on, or from `observed_at` on.
        self.write_clock = one_of(clock, (COMMITTED, OBSERVED), "the clock")
        # Data that questions keep for their next call, by class.
        self.remembered: dict[type, Any] = {}
        self._is_closed = False
        self._kb_id: int | None = None
        self._definitions = DefinitionCache()
        self._forget_identities()
        # The archived revision and the count of erasures at the time of caching identities.
        self._known_of = 0, 0
        self._last: Committed | None = None
        self._publishing = threading.Lock()
        self._clock_warned_at: float | None = None
        self.queue = backend.queue(name)  # the queue of its writers: equal values are one queue
        backend.sharers.add(self)
        if not is_one_of_many:
            ensure_schema(backend)
            with backend.open_session() as session:
                self._find(session)
        logger.info("%s: connected, knowledge base %r, actor %r", backend.label, name, actor)

    def forked(self) -> None:
        """Start over in a forked child: another thread may have held locks."""
        self._publishing = threading.Lock()
        self._forget_identities()
        self.remembered.clear()

    @property
    def is_closed(self) -> bool:
        """Whether this knowledge base, or the whole backend, was closed."""
        return self._is_closed or self.backend.is_closed

    def refuse_closed(self) -> None:
        """Raise if it is closed."""
        if self.is_closed:
            raise self.backend.closed_error()

    def refuse_open(self, why: str = "") -> None:
        """Raise if this thread, task and context has a transaction open."""
        if self.current() is not None:
            raise ReadOnlyError(
                f"knowledge base {self.name!r} has a transaction open in this task or thread{why}; "
                "end it first"
            )

    def described(self, at: int) -> str:
        """Return the name of a past state, for messages."""
        return f"revision {at}"

    def _forget_identities(self) -> None:
        self._atoms: AtomCache = AtomCache(self.is_one_of_many)
        self._fluents: FluentCache = FluentCache(self.is_one_of_many)

    def current(self) -> Transaction | None:
        """Return the transaction that this thread, task and context has open."""
        if not OPEN.get():
            return None
        block = own_block(self)
        transaction = None if block is None else block.transaction
        if transaction is None or transaction.session.is_abandoned:
            return None
        self.refuse_closed()
        return transaction

    def _take_session(self) -> Session:
        """Take a connection to read committed data."""
        if self._is_closed:
            self.refuse_closed()
        if self.backend.has_one_connection:
            ahead = block_ahead(self.queue)
            if ahead is not None and not ahead.is_mine():
                raise ahead.refuse("to read a store in memory, whose one connection it holds,")
        return self.backend.reader()

    def read(self, work: Callable[[View], T], at: int | None = None) -> T:
        """Read from one consistent state; one statement needs no transaction."""
        transaction = self.current()
        if transaction is not None and at is None:
            transaction.flush()
            definitions = transaction.definitions.current()
            return work(View(transaction.session, transaction.kb_id, definitions))
        guess, kb_id = self._definitions.guess(at), self._kb_id
        if guess is not None and kb_id is not None:
            revision, definitions = guess
            try:
                # One statement sees one state, so it needs no transaction around it.
                return self._outside(
                    lambda session: work(View(session, kb_id, definitions, at, revision))
                )
            except StoreError:
                raise
            except (DefinitionsMovedError, KantSqlError):
                # Another process may have changed a definition since.
                pass
        return self.read_in_snapshot(work, at)

    def read_in_snapshot(self, work: Callable[[View], T], at: int | None = None) -> T:
        """Read from one consistent state with several statements, in a transaction."""
        if self.current() is not None and at is None:
            return self.read(work)
        return self._apart(
            lambda session: work(open_view(session, self._find(session), self._definitions, at))
        )

    def read_definitions(self, work: Callable[[Definitions], T], at: int | None = None) -> T:
        """Read only definitions."""
        transaction = self.current()
        if transaction is not None and at is None:
            return work(transaction.definitions)
        snapshot, kb_id = self._definitions.snapshot, self._kb_id
        if at is None and snapshot is not None and kb_id is not None:
            now = self._outside(lambda session: read_position(session, kb_id).redefined)
            if now == snapshot.definition_revision:
                return work(snapshot.definitions)
        return self.read_in_snapshot(lambda view: work(view.definitions), at)

    def check_definitions(self, work: Callable[[Definitions], T], at: int | None = None) -> T:
        """Run a check against the definitions; it takes a statement only if it fails."""
        transaction = self.current()
        if transaction is None or at is not None:
            known = self._definitions.known(at)
            if known is not None:
                try:
                    return work(known)
                except KantSqlError:
                    # Another process may have changed a definition since.
                    pass
        return self.read_definitions(work, at)

    def _find(self, session: Session) -> int | None:
        if self._kb_id is None:
            found = find_knowledge_base(session, self.name)
            if found is None or self.current() is not None:
                # An open transaction that created the knowledge base may be rolled back.
                return found
            self._kb_id = found
        return self._kb_id

    def query_in_snapshot(self, work: Callable[[Session, int | None], T]) -> T:
        """Query committed data in a read transaction: one consistent state."""
        return self._apart(lambda session: work(session, self._find(session)))

    def query(self, work: Callable[[Session, int | None], T]) -> T:
        """Query committed data without a transaction: each statement sees its own state."""
        return self._outside(lambda session: work(session, self._find(session)))

    def query_known(
        self, work: Callable[[Session, int], T], unknown: T, in_snapshot: bool = True
    ) -> T:
        """Query committed data like the others; `unknown` before the first write."""
        query = self.query_in_snapshot if in_snapshot else self.query
        return query(lambda session, kb_id: unknown if kb_id is None else work(session, kb_id))

    def query_once(self, work: Callable[[Session, int | None], T]) -> T:
        """Query committed data with one statement, without retries."""
        session = self._take_session()
        try:
            return work(session, self._find(session))
        finally:
            end_session(session)

    def _apart(self, work: Callable[[Session], T]) -> T:
        """Read in a separate transaction, which sees one state and never waits for a writer."""

        def begun(session: Session) -> T:
            session.begin(write=False)
            return work(session)

        return self._outside(begun)

    def _outside(
        self, work: Callable[[Session], T], take: Callable[[], Session] | None = None
    ) -> T:
        """Use a session outside the thread's transaction: for reading, or from `take`."""

        def once() -> T:
            session = self._take_session() if take is None else take()
            try:
                return work(session)
            finally:
                end_session(session)

        return retrying(self.backend, once)

    def clock(self, session: Session) -> datetime:
        """Read the store's own clock."""
        row = session.first(_CLOCK)
        return session.now(None if row is None else row[0])

    def write(self, work: Callable[[Transaction], T]) -> T:
        """Change the knowledge base: in the open transaction, or in one of its own."""
        outer = self.current()
        if outer is not None:
            with outer.scope():
                return work(outer)
        begin = partial(self._begin, self._metadata)

        def once() -> T:
            with OwnTransaction(self, begin) as transaction:
                return work(transaction)

        return retrying(self.backend, once)

    def write_beside(self, work: Callable[[Session], object]) -> None:
        """Write data outside of the history, in a separate transaction without a revision."""
        # Like all writes, it ignores the limits of questions.

        def begun(session: Session) -> None:
            session.begin(write=True)
            work(session)
            session.commit()

        lock = self.queue_up()
        try:
            self._outside(begun, self.backend.session)
        finally:
            if lock is not None:
                lock.release()

    def transaction(
        self,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | None = None,
        plan_step: tuple[int, int] | None = None,
        promotes: bool = False,
        given: Given = FROM_NOW_ON,
    ) -> AbstractContextManager[Transaction]:
        """Open a transaction; within another of this thread, task and context, join that one."""
        # Only a promotion may write to a replica. `given` is the valid period.
        if expected_revision is not None:
            whole_number(expected_revision, "expected_revision")
        who = actor if actor is not None else self.actor
        metadata = make_metadata(who, reason, source, observed_at, plan_step)
        is_observed = self.write_clock == OBSERVED and given == FROM_NOW_ON
        if is_observed:
            given = (metadata.observed_at, None)
        outer = self.current()
        if outer is not None:
            self._expect(expected_revision, outer.head.revision)
            if given not in (FROM_NOW_ON, outer.given):
                raise InvalidArgumentError(
                    "this block is part of a transaction about another period, or from now on: a "
                    "transaction is about one period; end that transaction first, or give it this "
                    "period"
                )
            return outer.joined()
        own = (metadata, expected_revision, promotes, given, is_observed)
        return OwnTransaction(self, partial(retrying, self.backend, partial(self._begin, *own)))

    def close(self) -> None:
        """Close it, and its connections unless others share them."""
        # This thread's open transaction is rolled back at once.
        # A block of another thread is rolled back at its end, and its further calls are refused.
        self._is_closed = True
        if self.is_one_of_many:
            _roll_back(block for block in blocks_of_thread() if block.store is self)
        else:
            close_backend(self.backend)

    def refuse_read_only(self) -> None:
        """Raise if the store is open read-only."""
        if self.backend.is_read_only:
            raise ReadOnlyError(
                f"{self.backend.label}: knowledge base {self.name!r} was opened with "
                "read_only=True; connect without it to write"
            )

    def queue_up(self) -> WriterLock | None:
        """Wait for this process's turn to write, if its writers queue on a lock."""
        if self._is_closed:
            self.refuse_closed()
        if self.backend.is_read_only:
            self.refuse_read_only()
        ahead = block_ahead(self.queue)
        if ahead is not None:
            raise ahead.refuse("to write")
        lock = self.backend.write_lock(self.name)
        patience = self.backend.patience
        if lock is not None and not lock.acquire(timeout=patience):
            raise StoreBusyError(
                f"{self.backend.label}: another thread held the store for over "
                f"{patience:g} s; nothing was written, try again"
            )
        return lock

    def _begin(
        self,
        metadata: Metadata,
        expected: int | None = None,
        promotes: bool = False,
        given: Given = FROM_NOW_ON,
        is_observed: bool = False,
    ) -> Transaction:
        # Before the lock: once its connection is lost, another thread can commit at any moment.
        last = self._last
        session = self.backend.session()
        try:
            session.begin(write=True)
            kb_id = self._kb_id or self._find(session)
            if kb_id is None:
                self._expect(expected, 0)
                kb_id = create_knowledge_base(session, self.name)
            head = lock_head(session, kb_id)
            if head is None:
                raise vanished(session)
            self._judge(head, last)
            if head.origin is not None and not promotes:
                raise self._is_replica(head.origin)
            if expected is not None:
                self._expect(expected, head.revision)
            period = None
            if given != FROM_NOW_ON:
                # Never before the last revision.
                now = max(head.clock, head.committed_at or head.clock)
                period = make_period(given, now, is_observed)
            definitions = self._definitions.at_head(
                session, kb_id, head.definition_revision, head.archived_revision
            )
            state = head.archived_revision, self._definitions.forgotten
            if state != self._known_of:
                # Cached ones may have been archived, or their texts erased, since.
                self._forget_identities()
                self._known_of = state
            return Transaction(
                *(session, kb_id, self.name, head, metadata),
                PendingDefinitions(definitions),
                Agreements(definitions),
                WriteContext(session, kb_id, head, period),
                *(self._atoms, self._fluents, given),
            )
        except BaseException:
            end_session(session)
            raise

    def _is_replica(self, origin: str) -> ReplicaError:
        return ReplicaError(
            f"{self.backend.label}: knowledge base {self.name!r} is a replica of the one in "
            f"{printable(origin)}: nothing was written; write there, or end the replication here "
            "with kb.store.promote() or 'kant-sql promote'"
        )

    def _judge(self, head: Head, last: Committed | None) -> None:
        """Refuse a store that lacks committed revisions; warn of a clock that is behind."""
        if last is not None and (
            head.revision < last.number or (head.revision == last.number and head.hash != last.hash)
        ):
            raise StoreReplacedError(
                f"{self.backend.label}: knowledge base {self.name!r} is at revision "
                f"{head.revision}, and revision {last.number}, committed before, is not in it; the "
                "store was restored to another state: close the knowledge base and connect again"
            )
        if head.committed_at is not None and head.clock < head.committed_at - CLOCK_BEHIND:
            self._warn_of_clock(head.revision, head.committed_at, head.clock)

    def _warn_of_clock(self, revision: int, committed_at: datetime, clock: datetime) -> None:
        now = time.monotonic()
        if self._clock_warned_at is None or now >= self._clock_warned_at + CLOCK_PATIENCE:
            self._clock_warned_at = now
            logger.warning(
                "%s: knowledge base %r: the clock says %s, but revision %d is of %s: the clock is "
                "behind, or was ahead then; revisions get the time of that one until the clock "
                "has passed it",
                self.backend.label,
                self.name,
                clock.isoformat(),
                revision,
                committed_at.isoformat(),
            )

    def _expect(self, expected: int | None, actual: int) -> None:
        if expected is not None and expected != actual:
            is_ahead = expected > actual
            why = "that one is not written yet" if is_ahead else "another writer came first"
            raise StaleRevisionError(
                f"knowledge base {self.name!r} is at revision {actual}, not at {shown(expected)}: "
                f"{why}; read again and decide again",
                expected,
                actual,
            )

    def commit(self, transaction: Transaction) -> None:
        """Commit a transaction; after a lost answer, look the revision up."""
        if self.is_closed:
            self.refuse_closed()
        try:
            committed = transaction.commit()
        except ConnectionLostError:
            committed = transaction.committed
            if committed is None or not self._is_stored(transaction.kb_id, committed):
                raise
            logger.warning(
                "%s: the answer to the COMMIT of revision %d of %r was lost; it is in the store",
                self.backend.label,
                committed.number,
                self.name,
            )
        self._publish(transaction, committed)

    def _publish(self, transaction: Transaction, committed: Committed | None) -> None:
        if committed is not None:
            self._kb_id = transaction.kb_id
            with self._publishing:
                # Threads may come here in another order than they committed.
                if self._last is None or self._last.number < committed.number:
                    self._last = committed
            if transaction.erases:
                # Concurrent readers may have cached the old texts.
                self._definitions.forget()
                return
            definitions = transaction.definitions.origin
            if transaction.redefined:
                definitions = transaction.definitions.publish()
                self._definitions.keep(committed.number, definitions)
            transaction.agreements.learn(definitions)
        transaction.publish()
        if committed is not None and logger.isEnabledFor(logging.DEBUG):
            self._log_revision(transaction, committed)

    def _log_revision(self, transaction: Transaction, made: Committed) -> None:
        took, said = transaction.age, transaction.metadata
        logger.debug(
            # Text from outside must not begin a log line.
            "knowledge base %r: revision %d by %r because %r: %d changes, %.3f ms",
            self.name,
            made.number,
            said.actor,
            said.reason,
            transaction.changed,
            took,
            extra={
                "knowledge_base": self.name,
                "revision": made.number,
                "actor": said.actor,
                "reason": said.reason,
                "changes": transaction.changed,
                "milliseconds": took,
            },
        )

    def _is_stored(self, kb_id: int, made: Committed) -> bool:
        """Return whether a commit whose answer was lost reached the database."""

        def check(session: Session) -> bool:
            session.begin(write=True)
            # Waits for a server process that is still committing.
            lock_head(session, kb_id)
            return hash_of(session, kb_id, made.number) == made.hash

        try:
            # The limits of questions do not apply here.
            return self._outside(check, self.backend.session)
        except StoreError as error:
            raise OutcomeUnknownError(
                f"{self.backend.label}: the connection was lost while revision {made.number} of "
                f"{self.name!r} was being committed, and the store cannot be reached ({error}); if "
                f"it has revision {made.number} with hash {made.hash}, everything was written"
            ) from error


class OwnTransaction(AbstractContextManager[Transaction]):
    """The block of one transaction: it begins on entry, commits or rolls back on exit."""

    __slots__ = ("_begin", "_block", "_lock", "_store", "_transaction")

    _block: Block
    _transaction: Transaction

    def __init__(self, store: Store, begin: Callable[[], Transaction]) -> None:
        self._store = store
        self._begin = begin
        self._lock: WriterLock | None = None

    def __enter__(self) -> Transaction:
        store = self._store
        self._lock = lock = store.queue_up()
        try:
            self._transaction = transaction = self._begin()
            try:
                self._block = Block(store, store.queue, transaction)
            except BaseException:
                end_session(transaction.session)
                raise
        except BaseException:
            if lock is not None:
                lock.release()
            raise
        return self._transaction

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._block.close()
            if kind is None:
                self._store.commit(self._transaction)
        finally:
            try:
                end_session(self._transaction.session)
            finally:
                if self._lock is not None:
                    self._lock.release()
