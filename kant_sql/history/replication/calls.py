"""Pushes an open knowledge base, and keeps the stores that it was pushed to open for the next."""

from __future__ import annotations

import threading
from weakref import WeakKeyDictionary

from ...arguments import expect, flag, optional_call, optional_text
from ...errors import (
    InvalidArgumentError,
    InvalidUrlError,
    ReadOnlyError,
    StoreError,
)
from ...sql.dialects.base import PASSING, Backend
from ...store.store import Store
from .push import Progress, Pushed, Terms, push
from .target import ReplicationSide, Target, open_store


class _Targets:
    """The stores that the knowledge bases of one store were pushed to.

    A robot pushes every few seconds; connecting anew would take longer than what it sends.
    """

    def __init__(self, source: Backend) -> None:
        self._lock = threading.Lock()
        self._backends: dict[str, Backend] = {}
        self._pairs: dict[tuple[str, str], tuple[ReplicationSide, Target]] = {}
        source.when_closed.append(self.close)

    def open(self, url: str, name: str, source: Backend) -> tuple[ReplicationSide, Target]:
        """Return a knowledge base in both stores; the target is opened if it is not yet."""
        with self._lock:
            found = self._pairs.get((url, name))
            backend = self._backends.get(url)
        if found is not None:
            return found
        made = open_store(url, source, "a replica") if backend is None else backend
        with self._lock:
            kept = self._backends.setdefault(url, made)
            sides = ReplicationSide(source, name), Target(kept, name)
            pair = self._pairs.setdefault((url, name), sides)
        if kept is not made and made is not backend:
            # Another thread was first.
            made.close()
        return pair

    def forget(self, url: str) -> None:
        """Close a store that is no longer what it was."""
        with self._lock:
            backend = self._backends.pop(url, None)
            for key in [key for key in self._pairs if key[0] == url]:
                del self._pairs[key]
        if backend is not None:
            backend.close()

    def close(self) -> None:
        """Close all of them."""
        for url in [*self._backends]:
            self.forget(url)


_GUARD = threading.Lock()
_TARGETS: WeakKeyDictionary[Backend, _Targets] = WeakKeyDictionary()


def push_from(
    store: Store, url: str, archive: str | None, adopt: bool, progress: Progress | None
) -> Pushed:
    """Push an open knowledge base; see `History.push`."""
    expect(url, str, "the URL of the target", InvalidUrlError)
    optional_text(archive, "archive")
    flag(adopt, "adopt", InvalidArgumentError)
    optional_call(progress, "progress")
    if store.current() is not None:
        raise ReadOnlyError(
            f"knowledge base {store.name!r} has a transaction open in this task or thread, and "
            "what is committed is pushed; end it first"
        )
    store.refuse_closed()
    source = store.backend
    with _GUARD:
        targets = _TARGETS.get(source) or _TARGETS.setdefault(source, _Targets(source))
    try:
        sides = targets.open(url, store.name, source)
        return push(*sides, Terms(archive, adopt), progress)
    except StoreError as error:
        if not isinstance(error, PASSING):
            # It may have been replaced, or be of another version by now.
            targets.forget(url)
        raise
