"""Writing a knowledge base: transactions, what is retried, and commits whose answer is lost."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from typing import TypeVar

from .arguments import shown
from .backends import Session
from .canonical import Metadata, make_metadata
from .errors import (
    ConnectionLostError,
    OutcomeUnknownError,
    StaleRevisionError,
    StoreBusyError,
    StoreError,
    StoreReplacedError,
)
from .head import Committed, Head, create_knowledge_base, is_stored, lock_head
from .ownership import Block, block_ahead, blocks_of_thread
from .reader import Reader, end_session
from .transaction import Transaction
from .view import vanished

T = TypeVar("T")

logger = logging.getLogger("kant_sql.store")

WRITE_LOCK_TIMEOUT = 20.0
# How far behind the last revision the store's clock may be without a word, and how often a warning
# of it is repeated, in seconds.
CLOCK_BEHIND = timedelta(minutes=1)
CLOCK_PATIENCE = 3600.0


class Store(Reader):
    """Reads and writes a knowledge base, for all threads of a process."""

    _last: Committed | None = None
    _clock_warned_at: float | None = None

    def write(self, work: Callable[[Transaction], T]) -> T:
        """Change the knowledge base: in the open transaction, or in one of its own.

        Args:
            work: makes the change; it is called again when nothing was committed because the store
                was busy or the connection was lost.

        Returns:
            What `work` returns.
        """
        outer = self.current()
        if outer is not None:
            with outer.scope():
                return work(outer)
        metadata = Metadata(self.actor, None, None)
        return self._retrying(lambda: self._write_once(metadata, work))

    def _write_once(self, metadata: Metadata, work: Callable[[Transaction], T]) -> T:
        with self._transaction(metadata, None) as transaction:
            return work(transaction)

    @contextmanager
    def transaction(
        self,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | None = None,
        plan_step: tuple[int, int] | None = None,
    ) -> Iterator[Transaction]:
        """Open a transaction; within another of this thread, task and context, join that one.

        Args:
            actor: who writes; the store's actor when not given.
            reason: why.
            source: what the caller knows, as JSON.
            expected_revision: the head that the caller has seen.
            observed_at: when what is written was sensed.
            plan_step: the step that is running: the id of its plan, and its position.

        Yields:
            The transaction.

        Raises:
            StaleRevisionError: the head is another than expected.
        """
        who = actor if actor is not None else self.actor
        metadata = make_metadata(who, reason, source, observed_at, plan_step)
        outer = self.current()
        if outer is not None:
            self._expect(expected_revision, outer.head.revision)
            with outer.scope():
                yield outer
            return
        with self._transaction(metadata, expected_revision) as transaction:
            yield transaction

    def close(self) -> None:
        """Close all connections; what this thread has open is rolled back at once.

        A block of another thread is rolled back when it ends, and its further calls are refused.
        """
        backend = self.backend
        backend.is_closed = True
        for block in blocks_of_thread():
            transaction = block.transaction
            if transaction is not None and transaction.session.backend is backend:
                with suppress(StoreError):
                    transaction.session.rollback()
        backend.close()

    @contextmanager
    def _transaction(self, metadata: Metadata, expected: int | None) -> Iterator[Transaction]:
        ahead = block_ahead(self._queue)
        if ahead is not None:
            raise ahead.refuse("to write")
        lock = self.backend.write_lock()
        if lock is not None and not lock.acquire(timeout=WRITE_LOCK_TIMEOUT):
            raise StoreBusyError(
                f"{self.backend.label}: another thread held the store for over "
                f"{WRITE_LOCK_TIMEOUT:g} s; nothing was written, try again"
            )
        try:
            transaction = self._retrying(lambda: self._begin(metadata, expected))
            try:
                block = Block(self, self._queue, transaction)
                try:
                    yield transaction
                finally:
                    block.close()
                self.backend.refuse_closed()
                self._commit(transaction)
            finally:
                end_session(transaction.session)
        finally:
            if lock is not None:
                lock.release()

    def _begin(self, metadata: Metadata, expected: int | None) -> Transaction:
        session = self.backend.session()
        try:
            session.begin(write=True)
            kb_id = self._find(session)
            if kb_id is None:
                self._expect(expected, 0)
                kb_id = create_knowledge_base(session, self.name)
            head = lock_head(session, kb_id)
            if head is None:
                raise vanished(session)
            self._judge(head)
            self._expect(expected, head.revision)
            self._forget_what_was_archived(head.archived_revision)
            stands = head.definition_revision, head.archived_revision
            definitions = self._definitions.at_head(session, kb_id, *stands)
            known = definitions, self._atoms, self._fluents
            return Transaction(session, kb_id, self.name, head, metadata, *known)
        except BaseException:
            end_session(session)
            raise

    def _judge(self, head: Head) -> None:
        """Refuse a store that lacks what was committed before; warn of a clock that is behind."""
        last = self._last
        if last is not None and (
            head.revision < last.number or (head.revision == last.number and head.hash != last.hash)
        ):
            raise StoreReplacedError(
                f"{self.backend.label}: knowledge base {self.name!r} is at revision "
                f"{head.revision}, and revision {last.number}, committed before, is not in it; the "
                "store was put back to another state: close the knowledge base and connect again"
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
            raise StaleRevisionError(
                f"knowledge base {self.name!r} is at revision {actual}, not at {shown(expected)}: "
                "another writer came first; read again and decide anew",
                expected,
                actual,
            )

    def _commit(self, transaction: Transaction) -> None:
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
            self._kb_id, self._last = transaction.kb_id, committed
            if transaction.redefined:
                self._definitions.keep(committed.number, transaction.definitions.publish())
        transaction.publish()
        if committed is not None and logger.isEnabledFor(logging.DEBUG):
            self._log_revision(transaction, committed)

    def _log_revision(self, transaction: Transaction, made: Committed) -> None:
        took, said = transaction.age, transaction.metadata
        logger.debug(
            # What others have written must not pass for a line of its own.
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
        """Tell whether a commit got through whose answer was lost."""

        def check(session: Session) -> bool:
            session.begin(write=True)
            # Waits for a server process that is still at it.
            lock_head(session, kb_id)
            return is_stored(session, kb_id, made)

        try:
            return self._outside(check)
        except StoreError as error:
            raise OutcomeUnknownError(
                f"{self.backend.label}: the connection was lost while revision {made.number} of "
                f"{self.name!r} was being committed, and the store does not come back ({error}); "
                f"if it has a revision {made.number} of hash {made.hash}, all of it was written"
            ) from error
