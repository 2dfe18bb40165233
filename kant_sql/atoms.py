"""Interned propositions, and what is known of the interned between transactions."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Generic, NamedTuple, TypeVar

# Beyond so many, the cache begins anew: about 60 MB.
CACHED_ATOMS = 200_000

K = TypeVar("K")
A = TypeVar("A")
H = TypeVar("H")


class AtomKey(NamedTuple):
    """What makes a proposition the one that it is.

    Attributes:
        is_goal: whether it is a goal rather than a fact.
        predicate_id: its predicate.
        arguments: the ids of its objects in order, separated by spaces.
    """

    is_goal: bool
    predicate_id: int
    arguments: str


class Atom(NamedTuple):
    """An interned proposition.

    Attributes:
        id: its id.
        key: what makes it the one that it is.
        text: its canonical PDDL text.
    """

    id: int
    key: AtomKey
    text: str


class Status(NamedTuple):
    """What the tables say of a proposition.

    Attributes:
        since: the revision of its open version, or of the version that the revision which is being
            made has closed; None when it neither holds nor did before this revision.
        holds: whether the version is open.
    """

    since: int | None
    holds: bool


ABSENT = Status(None, False)


def open_status(since: int | None) -> Status:
    """Give the status of a proposition that this revision has not touched yet.

    Args:
        since: the revision of its open version; None when it has none.

    Returns:
        The status.
    """
    return ABSENT if since is None else Status(since, True)


class InternCache(Generic[K, A, H]):
    """What is known between transactions: identities for good, and what held.

    Attributes:
        identities: the identities, by what makes each the one that it is.
        held: what held at `revision`, by id: also that something did not.
        revision: the head when `held` was taken; it says nothing about any other.
    """

    def __init__(self) -> None:
        self.identities: dict[K, A] = {}
        self.held: dict[int, H] = {}
        self.revision = 0
        self._lock = threading.Lock()

    def at(self, revision: int) -> dict[int, H]:
        """Give what is known of a revision.

        Args:
            revision: the head that a writer has locked.

        Returns:
            What held, by id.
        """
        with self._lock:
            if revision != self.revision:
                self.held, self.revision = {}, revision
            return self.held

    def know(self, identities: Mapping[K, A]) -> None:
        """Remember identities for good.

        Args:
            identities: what the tables have.
        """
        self.identities.update(identities)
        if len(self.identities) > CACHED_ATOMS:
            self.identities.clear()

    def learn(
        self, held: dict[int, H], before: int, after: int, news: Mapping[int, H] | None
    ) -> None:
        """Let later writers know what a writer has found and made.

        Args:
            held: what `at` gave to the writer.
            before: the head that the writer had locked.
            after: the head that it left.
            news: what holds at `after`, by id; None when that was too much to keep.
        """
        with self._lock:
            # The lock of the head is gone by now: another writer may have been quicker.
            if held is self.held and before == self.revision:
                if news is None or len(held) > CACHED_ATOMS:
                    self.held = {}
                else:
                    held.update(news)
                self.revision = after


# Of a proposition, the revision of its open version is known; None: it does not hold.
AtomCache = InternCache[AtomKey, Atom, int | None]
