"""Waiting for news: how a store tells who waits that something was committed."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


class Listener(ABC):
    """Hears of what is committed to a store, by whichever process. One thread uses it."""

    @abstractmethod
    def wait(self, kb_id: int | None, seconds: float) -> None:
        """Wait until something may have been committed since the last call.

        The first call only begins to listen: what was committed before is not heard of, so look
        after each call. Nor is it a promise that there is news when the wait ends.

        Args:
            kb_id: the knowledge base; None when it was never written to.
            seconds: how long to wait at most.

        Raises:
            StoreError: the connection cannot be made, or was lost; the next call makes another.
        """

    def look(self, work: Callable[[], T]) -> T:
        """Look whether there is news, at no moment at which this process is forked.

        Args:
            work: looks; it waits for nobody.

        Returns:
            What `work` returns.
        """
        return work()

    @abstractmethod
    def close(self) -> None:
        """Listen no more."""


class Commits:
    """Counts what is committed to a store that one process has for itself."""

    def __init__(self) -> None:
        self._number = 0
        self._changed = threading.Condition()

    def tell(self) -> None:
        """Tell who waits that something was committed."""
        with self._changed:
            self._number += 1
            self._changed.notify_all()

    def wait(self, seen: int | None, seconds: float) -> int:
        """Wait until something was committed since a number was given.

        Args:
            seen: the number; None not to wait.
            seconds: how long to wait at most.

        Returns:
            The number now.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._number != seen, seconds)
            return self._number
