"""Interned propositions, and what is known of them between transactions."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import NamedTuple

# Beyond so many, the cache begins anew: about 60 MB.
CACHED_ATOMS = 200_000


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


class AtomCache:
    """What is known of propositions between transactions: identities for good, and what held.

    Attributes:
        atoms: the identities.
        since: what held at `revision`: the open version's revision, None for what did not hold.
        revision: the head when `since` was taken; it says nothing about any other.
    """

    def __init__(self) -> None:
        self.atoms: dict[AtomKey, Atom] = {}
        self.since: dict[int, int | None] = {}
        self.revision = 0
        self._lock = threading.Lock()

    def at(self, revision: int) -> dict[int, int | None]:
        """Give what is known of a revision.

        Args:
            revision: the head that a writer has locked.

        Returns:
            Proposition id -> revision of its open version.
        """
        with self._lock:
            if revision != self.revision:
                self.since, self.revision = {}, revision
            return self.since

    def learn(
        self,
        since: dict[int, int | None],
        before: int,
        after: int,
        news: Mapping[int, int | None] | None,
    ) -> None:
        """Let later writers know what a writer has found and made.

        Args:
            since: what `at` gave to the writer.
            before: the head that the writer had locked.
            after: the head that it left.
            news: proposition id -> revision of its open version, at `after`; None when that was
                too much to keep.
        """
        with self._lock:
            # The lock of the head is gone by now: another writer may have been quicker.
            if since is self.since and before == self.revision:
                if news is None or len(since) > CACHED_ATOMS:
                    self.since = {}
                else:
                    since.update(news)
                self.revision = after
