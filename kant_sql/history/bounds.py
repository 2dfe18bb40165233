"""From which revision until which someone asks."""

from __future__ import annotations

from datetime import datetime, timedelta

from ..store import Store
from .revisions import FIRST_MOMENT, head_revision, revision_at

_MICROSECOND = timedelta(microseconds=1)


def find_bounds(
    store: Store,
    since: int | datetime | None,
    until: int | datetime | None,
    upto: int | None,
) -> tuple[int, int]:
    """Find the first and the last revision that someone asks for.

    Args:
        store: the store.
        since: the first revision, or the time from which on they were committed; None for 1.
        until: the last revision, or the time up to which they were committed; None for the head.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        Both numbers; the first is larger when there is no such revision.

    Raises:
        UnknownRevisionError: the knowledge base has not come to one of them yet, or a time has no
            zone.
    """
    last = head_revision(store) if upto is None else upto
    low = 1 if since is None else max(1, _first_since(store, since, last))
    high = last if until is None else revision_at(store, until, last)
    return low, high


def _first_since(store: Store, since: int | datetime, last: int) -> int:
    if not isinstance(since, datetime) or since.utcoffset() is None:
        return revision_at(store, since, last)
    if since <= FIRST_MOMENT:
        return 1
    # Times have microseconds: nothing was committed between this one and the one before.
    return revision_at(store, since - _MICROSECOND, last) + 1
