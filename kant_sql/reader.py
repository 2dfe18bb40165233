"""Reading a knowledge base, as the threads of a process share it.

What may be cached is kept here: identities for good, definitions together with the revision that
last changed one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from typing import TypeVar

from sqlalchemy import bindparam, select

from .arguments import shown
from .atoms import AtomCache
from .backends import Backend, Query, Session, StoreClock
from .canonical import make_metadata
from .errors import ConnectionLostError, InvalidMetadataError
from .fluents import FluentCache
from .knowledge.cache import DefinitionCache
from .knowledge.definitions import Definitions
from .ownership import OPEN, block_ahead, own_block
from .retry import retrying
from .schema import ensure_schema
from .tables import KnowledgeBaseRow
from .transaction import Transaction
from .view import DefinitionsMovedError, View, open_view, read_definition_revision

T = TypeVar("T")

logger = logging.getLogger("kant_sql.store")

_FIND = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))
_CLOCK = Query(select(StoreClock()))


class Reader:
    """Reads a knowledge base, for all threads of a process.

    Attributes:
        backend: the database.
        name: the knowledge base's name.
        actor: who writes, when a transaction does not say.
    """

    def __init__(self, backend: Backend, name: str, actor: str | None) -> None:
        make_metadata(actor, None, None)
        if not isinstance(name, str) or not name or len(name) > 255 or not name.isprintable():
            raise InvalidMetadataError(
                f"{shown(name)} cannot name a knowledge base; give 1 to 255 printable characters"
            )
        self.backend = backend
        self.name = name
        self.actor = actor
        self._kb_id: int | None = None
        self._definitions = DefinitionCache()
        self._atoms: AtomCache = AtomCache()
        self._fluents: FluentCache = FluentCache()
        self._archived_revision = 0
        self._queue = backend.queue(name)
        backend.when_forked.append(self._forked)
        ensure_schema(backend)
        with backend.open_session() as session:
            self._find(session)
        logger.info("%s: connected, knowledge base %r, actor %r", backend.label, name, actor)

    def _forked(self) -> None:
        # Another thread may have had the locks of the old ones.
        self._forget_identities()

    def _forget_identities(self) -> None:
        self._atoms = AtomCache()
        self._fluents = FluentCache()

    def _forget_what_was_archived(self, revision: int) -> None:
        """Forget identities when some may have been moved since they were cached."""
        if revision != self._archived_revision:
            self._forget_identities()
            self._archived_revision = revision

    def current(self) -> Transaction | None:
        """Give the transaction that this thread, task and context has open.

        Returns:
            The transaction, or None.

        Raises:
            ClosedError: there is one, and the knowledge base was closed meanwhile.
        """
        if not OPEN.get():
            return None
        block = own_block(self)
        transaction = None if block is None else block.transaction
        if transaction is None or transaction.session.is_abandoned:
            return None
        self.backend.refuse_closed()
        return transaction

    def _take_session(self) -> Session:
        """Take a connection to read what is committed."""
        if self.backend.has_one_connection:
            ahead = block_ahead(self._queue)
            if ahead is not None and not ahead.is_mine():
                raise ahead.refuse("to read a store in memory, whose one connection it holds,")
        return self.backend.session()

    def read(self, work: Callable[[View], T], at: int | None = None) -> T:
        """Read from one consistent state.

        Args:
            work: reads with one statement from the view that it is given; it may be called again
                after a lost connection, or when definitions have changed.
            at: the revision to read at; None for now, within the open transaction if there is one.

        Returns:
            What `work` returns.
        """
        transaction = self.current()
        if transaction is not None and at is None:
            transaction.flush()
            return work(View(transaction.session, transaction.kb_id, transaction.definitions))
        guess, kb_id = self._definitions.guess(at), self._kb_id
        if guess is not None and kb_id is not None:
            revision, definitions = guess
            try:
                # One statement sees one state, so it needs no transaction around it.
                return self._outside(
                    lambda session: work(View(session, kb_id, definitions, at, revision))
                )
            except DefinitionsMovedError:
                pass
        return self.read_together(work, at)

    def read_together(self, work: Callable[[View], T], at: int | None = None) -> T:
        """Read with several statements from one consistent state.

        Args:
            work: reads from the view that it is given; it may be called again after a lost
                connection.
            at: the revision to read at; None for now, within the open transaction if there is one.

        Returns:
            What `work` returns.
        """
        if self.current() is not None and at is None:
            return self.read(work)
        return self._apart(
            lambda session: work(open_view(session, self._find(session), self._definitions, at))
        )

    def read_definitions(self, work: Callable[[Definitions], T], at: int | None = None) -> T:
        """Read definitions alone.

        Args:
            work: reads from the definitions that it is given.
            at: the revision to read at; None for now, within the open transaction if there is one.

        Returns:
            What `work` returns.
        """
        transaction = self.current()
        if transaction is not None and at is None:
            return work(transaction.definitions)
        snapshot, kb_id = self._definitions.snapshot, self._kb_id
        if at is None and snapshot is not None and kb_id is not None:
            now = self._outside(lambda session: read_definition_revision(session, kb_id))
            if now == snapshot.definition_revision:
                return work(snapshot.definitions)
        return self._apart(
            lambda session: work(
                open_view(session, self._find(session), self._definitions, at).definitions
            )
        )

    def _find(self, session: Session) -> int | None:
        if self._kb_id is None:
            row = session.first(_FIND, name=self.name)
            if row is None or self.current() is not None:
                # What an open transaction has created may yet be rolled back.
                return None if row is None else int(row[0])
            self._kb_id = row[0]
        return self._kb_id

    def look(self, work: Callable[[Session, int | None], T]) -> T:
        """Read tables apart from any transaction, as committed.

        Args:
            work: reads with the session, of the knowledge base whose id it is given (None when
                it was never written to); it may be called again after a lost connection.

        Returns:
            What `work` returns.
        """
        return self._apart(lambda session: work(session, self._find(session)))

    def glance(self, work: Callable[[Session, int | None], T]) -> T:
        """Read tables without a transaction: each statement sees what is committed as it begins.

        Args:
            work: reads with the session, as for `look`, with one statement, or with several of
                which it does not matter what is committed in between.

        Returns:
            What `work` returns.
        """
        return self._outside(lambda session: work(session, self._find(session)))

    def look_once(self, work: Callable[[Session, int | None], T]) -> T:
        """Read tables with one statement, as committed, and do not try again what fails.

        Args:
            work: reads with the session, as for `look`.

        Returns:
            What `work` returns.
        """
        session = self._take_session()
        try:
            return work(session, self._find(session))
        finally:
            end_session(session)

    def _apart(self, work: Callable[[Session], T]) -> T:
        """Read in a transaction of its own, which sees one state and waits for nobody."""

        def begun(session: Session) -> T:
            session.begin(write=False)
            return work(session)

        return self._outside(begun)

    def _outside(self, work: Callable[[Session], T]) -> T:
        """Use a session outside the thread's transaction."""

        def once() -> T:
            session = self._take_session()
            try:
                return work(session)
            finally:
                end_session(session)

        return self._retrying(once)

    def clock(self, session: Session) -> datetime:
        """Read the store's own clock.

        Args:
            session: the session.

        Returns:
            The time, in UTC.
        """
        row = session.first(_CLOCK)
        return session.now(None if row is None else row[0])

    def _retrying(self, work: Callable[[], T]) -> T:
        return retrying(self.backend, work)


def end_session(session: Session) -> None:
    """Roll back what is open, and give the connection back.

    Args:
        session: the session.
    """
    try:
        # A lost connection is rolled back by the server, and must not hide an error before it.
        with suppress(ConnectionLostError):
            session.rollback()
    finally:
        session.close()
