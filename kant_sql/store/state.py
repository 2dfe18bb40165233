"""What a question is asked of."""

from __future__ import annotations

from typing import NamedTuple

from .store import Store


class State(NamedTuple):
    """A knowledge base as it is now, or as it was at one revision."""

    store: Store  # the knowledge base, on its connections
    at: int | None = None  # the revision that is read; None for the present

    @property
    def upto(self) -> int | None:
        """The last revision that questions about the past know; None for the last committed one."""
        transaction = self.store.current() if self.at is None else None
        return self.at if transaction is None else transaction.head.revision
