"""What the DAOs of the SQL families share."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import TypeVar

from ..arguments import iterate
from ..errors import ReadOnlyError
from ..store import Store

T = TypeVar("T")

BATCH = 5_000


class SqlDao:
    """A DAO on a store: on its present, or on its past at one revision."""

    def __init__(self, store: Store, at: int | None = None) -> None:
        """Make a DAO.

        Args:
            store: the store.
            at: the revision to read at, which cannot be written to; None for now.
        """
        self._open_store = store
        self._at = at

    @property
    def _store(self) -> Store:
        """The store, if it was not closed: no call goes by without asking."""
        store = self._open_store
        if store.backend.is_closed:
            store.backend.refuse_closed()
        return store

    def _check_writable(self) -> None:
        refuse_past(self._store, self._at)


def refuse_past(store: Store, at: int | None) -> None:
    """Refuse to write where only the past is looked at.

    Args:
        store: the store.
        at: the revision that is looked at; None for now.

    Raises:
        ReadOnlyError: it is a revision.
    """
    if at is not None:
        raise ReadOnlyError(
            f"this is knowledge base {store.name!r} as it was at revision {at}: "
            "the past cannot be changed; write to the knowledge base itself"
        )


def batches(items: Iterable[T]) -> Iterable[list[T]]:
    """Split what is given into lists of a bounded length.

    Args:
        items: the items.

    Yields:
        Lists of at most `BATCH` of them.

    Raises:
        InvalidKnowledgeError: it is not iterable.
    """
    iterator = iterate(items, "what save_all takes", "an iterable of DTOs")
    while batch := list(islice(iterator, BATCH)):
        yield batch
