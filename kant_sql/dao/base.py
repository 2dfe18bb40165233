"""What the DAOs of the SQL families share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any, TypeVar

from ..errors import InvalidKnowledgeError, ReadOnlyError
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
        self._store = store
        self._at = at

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


def expect(value: Any, wanted: type[T], role: str) -> T:
    """Check that a value is a DTO of the class that its place asks for.

    Args:
        value: the value.
        wanted: the class.
        role: what the value is, for the message.

    Returns:
        The value.

    Raises:
        InvalidKnowledgeError: it is something else.
    """
    if not isinstance(value, wanted):
        raise InvalidKnowledgeError(
            f"{role} is a {wanted.__name__}, not {type(value).__name__}: {value!r:.80}"
        )
    return value


def expect_list(value: Any, wanted: type[T] | tuple[type[T], ...], role: str) -> Sequence[T]:
    """Check that a value is a list, or a tuple, of DTOs of the class that its place asks for.

    Args:
        value: the value.
        wanted: the class, or several.
        role: what the list is, for the message.

    Returns:
        The value.

    Raises:
        InvalidKnowledgeError: it, or something in it, is something else.
    """
    if not isinstance(value, tuple):
        expect(value, list, role)
    for item in value:
        if not isinstance(item, wanted):
            first = wanted[0] if isinstance(wanted, tuple) else wanted
            expect(item, first, f"each item of {role}")
    return value  # type: ignore[no-any-return]


def batches(items: Iterable[T]) -> Iterable[list[T]]:
    """Split what is given into lists of a bounded length.

    Args:
        items: the items.

    Yields:
        Lists of at most `BATCH` of them.

    Raises:
        InvalidKnowledgeError: it is not iterable.
    """
    if not isinstance(items, Iterable):
        raise InvalidKnowledgeError(
            f"what save_all takes is an iterable of DTOs, not {type(items).__name__}"
        )
    iterator = iter(items)
    while batch := list(islice(iterator, BATCH)):
        yield batch
