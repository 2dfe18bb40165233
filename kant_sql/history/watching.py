"""Waiting for news of a knowledge base, whichever process makes it."""

from __future__ import annotations

import time
from contextlib import closing

from ..arguments import seconds
from ..backends import Listener
from ..errors import (
    ClosedError,
    ConnectionLostError,
    ReadOnlyError,
    StoreBusyError,
    StoreError,
    StoreUnreachableError,
)
from ..store import Store
from .following import Place, read_place
from .revisions import check_after, refuse_unknown

# News of which no word came, as when a writer was killed right after its commit, waits so long.
LOOK_EVERY = 1.0
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 0.5
_PASSING = (StoreBusyError, ConnectionLostError, StoreUnreachableError)


def watch(
    store: Store, after: int | None, timeout: float | None, upto: int | None = None
) -> int | None:
    """Wait until there is a revision that the caller does not know; `History.watch` says all of it.

    Args:
        store: the store.
        after: the last revision that the caller knows; None for the head as it is now.
        timeout: how many seconds to wait; None for as long as it takes.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The number of the last revision; None when time ran out.
    """
    _refuse_where_nothing_comes(store, upto)
    if after is not None:
        check_after(after)
    deadline = time.monotonic() + seconds(timeout)
    with closing(store.backend.listener()) as listener:
        return _Watch(store, listener, after, deadline).wait()


def _refuse_where_nothing_comes(store: Store, upto: int | None) -> None:
    if upto is not None:
        raise ReadOnlyError(
            f"this is knowledge base {store.name!r} as it was at revision {upto}, where nothing "
            "new comes; watch the knowledge base itself"
        )
    if store.current() is not None:
        raise ReadOnlyError(
            f"this task or thread has a transaction of knowledge base {store.name!r} open, which "
            "keeps from it what it would wait for; end the transaction first, or watch in another "
            "task or thread"
        )


class _Watch:
    """A call that waits. It goes on when the store is gone for a while."""

    def __init__(
        self, store: Store, listener: Listener, after: int | None, deadline: float
    ) -> None:
        self._store = store
        self._listener = listener
        self._after = after
        self._deadline = deadline
        self._pause = FIRST_PAUSE

    def wait(self) -> int | None:
        """Wait until there is news, or time is over.

        Returns:
            The last revision, or None.
        """
        while True:
            self._refuse_closed()
            place = None
            try:
                place = self._listener.look(self._look)
                if self._is_news(place):
                    return place.head
                if self._left() <= 0:
                    return None
                self._listener.wait(place.kb_id, min(self._left(), LOOK_EVERY))
                self._pause = FIRST_PAUSE
            except StoreError as error:
                self._refuse_closed()
                if not isinstance(error, _PASSING):
                    raise
                if place is None and self._left() <= 0:
                    # Whether there is news is not known: as any other call, try for a while.
                    place = self._store.look(read_place)
                    return place.head if self._is_news(place) else None
                self._recover(error)

    def _refuse_closed(self) -> None:
        backend = self._store.backend
        if backend.is_closed:
            raise ClosedError(
                f"{backend.label}: knowledge base {self._store.name!r} was closed while this call "
                "waited for news of it; connect again to go on"
            )

    def _look(self) -> Place:
        return self._store.look_once(read_place)

    def _is_news(self, place: Place) -> bool:
        if self._after is None:
            self._after = place.head
        refuse_unknown(self._store.name, self._after, place.head)
        return place.head > self._after

    def _left(self) -> float:
        return self._deadline - time.monotonic()

    def _recover(self, error: Exception) -> None:
        backend = self._store.backend
        if isinstance(error, StoreUnreachableError) and not backend.has_answered:
            raise error
        if isinstance(error, ConnectionLostError):
            # What else the pool holds was lost with it, most likely.
            backend.renew()
        time.sleep(max(0.0, min(self._pause, self._left())))
        self._pause = min(2 * self._pause, LONGEST_PAUSE)
