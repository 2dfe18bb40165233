"""Trying again, within a bound, what has not changed anything."""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable
from typing import TypeVar

from .backends import Backend
from .errors import ConnectionLostError, StoreBusyError, StoreUnreachableError, printable

T = TypeVar("T")

logger = logging.getLogger("kant_sql.retry")

RETRY_FOR = 10.0
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 0.5


def retrying(backend: Backend, work: Callable[[], T]) -> T:
    """Call `work` again, for some seconds, while the store is busy or the connection is lost.

    Args:
        backend: the database.
        work: what to do; it leaves nothing behind when it raises.

    Returns:
        What `work` returns.

    Raises:
        StoreBusyError: the store stayed busy.
        ConnectionLostError: the connection was lost again and again.
        StoreUnreachableError: the server never answered, or did not come back.
    """
    deadline = time.monotonic() + RETRY_FOR
    pause = FIRST_PAUSE
    attempt = 0
    while True:
        attempt += 1
        try:
            return work()
        except (StoreBusyError, ConnectionLostError, StoreUnreachableError) as error:
            if isinstance(error, ConnectionLostError):
                # What else the pool holds was lost with it, most likely.
                backend.renew()
            elif isinstance(error, StoreUnreachableError) and not backend.has_answered:
                raise
            if time.monotonic() + pause > deadline:
                raise
            logger.warning("attempt %d failed, trying again: %s", attempt, printable(str(error)))
        time.sleep(pause * random.uniform(0.5, 1.5))
        pause = min(2 * pause, LONGEST_PAUSE)
