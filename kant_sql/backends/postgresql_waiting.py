"""News on PostgreSQL: a channel for each knowledge base.

A writer notifies after its commit. Within the transaction, NOTIFY would take a lock that the whole
database shares and hold it until the commit is on disk, so that writers of different knowledge
bases would wait for each other.
"""

from __future__ import annotations

import logging
import selectors
import time
from typing import TYPE_CHECKING, Any

from .waiting import Listener

if TYPE_CHECKING:
    from .postgresql import PostgresqlBackend

logger = logging.getLogger("kant_sql.postgresql")

# Where nothing is told of, it is looked for so often.
UNTOLD_PAUSE = 0.1
# "Read-only": a standby that follows another server lets nobody listen.
_STANDBY = "25006"
# It has no file of its own, which the child of a fork would keep open.
_Selector: type[selectors.BaseSelector] = getattr(
    selectors, "PollSelector", selectors.SelectSelector
)


def channel(kb_id: int) -> str:
    """Name the channel of a knowledge base, on which nothing is said but that there is news.

    Args:
        kb_id: the knowledge base.

    Returns:
        The name, as SQL has it.
    """
    return f"kant_sql_{kb_id:d}"


class PostgresqlListener(Listener):
    """Listens to the channel of one knowledge base, on a connection apart from the others."""

    def __init__(self, backend: PostgresqlBackend) -> None:
        self._backend = backend
        self._pooled: Any = None
        self._pool: Any = None
        self._is_deaf = False

    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait for a notification; the first call begins to listen."""
        if kb_id is None or self._is_deaf:
            # It has no channel yet, or cannot be listened to.
            time.sleep(min(UNTOLD_PAUSE, seconds))
            return
        try:
            if self._pooled is None:
                self._listen(kb_id)
            else:
                self._hear(self._pooled.driver_connection, seconds)
        except self._backend.driver_errors as error:
            self._drop()
            self._is_deaf = getattr(error, "sqlstate", None) == _STANDBY
            if self._is_deaf:
                logger.warning(
                    "%s: a standby lets nobody listen; news is looked for every %g s",
                    self._backend.label,
                    UNTOLD_PAUSE,
                )
            else:
                raise self._backend.translate(error) from error

    def _listen(self, kb_id: int) -> None:
        engine = self._backend.listening
        self._pool, self._pooled = engine.pool, self._backend.take(engine)
        self._pooled.driver_connection.execute(f"LISTEN {channel(kb_id)}")

    def _hear(self, connection: Any, seconds: float) -> None:
        # The driver's own wait begins anew with each signal that the process gets, and may not end.
        with _Selector() as selector:
            selector.register(connection, selectors.EVENT_READ)
            if selector.select(seconds):
                for _ in connection.notifies(timeout=0):
                    pass

    def _drop(self) -> None:
        pooled, self._pooled = self._pooled, None
        if pooled is not None:
            pooled.invalidate()

    def close(self) -> None:
        """Listen no more, and keep the connection for who listens next."""
        if self._pooled is None:
            return
        if self._pool is not self._backend.listening.pool:
            self._drop()  # The pool was closed while this was in use.
            return
        try:
            # Else the server would keep for it what is notified meanwhile.
            self._pooled.driver_connection.execute("UNLISTEN *")
        except self._backend.driver_errors:
            self._drop()
        else:
            self._pooled.close()
