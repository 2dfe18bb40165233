"""The state that a question reads."""

from __future__ import annotations

from typing import NamedTuple

from .store import Store


class State(NamedTuple):
    """A knowledge base now, or at one revision."""

    store: Store  # the knowledge base, on its connections
    at: int | None = None  # the revision to read; None for the present

    @property
    def upto(self) -> int | None:
        """The last revision for questions about the past; None for the last committed one."""
        transaction = self.store.current() if self.at is None else None
        return self.at if transaction is None else transaction.head.revision
