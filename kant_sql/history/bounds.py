"""From which revision until which someone asks."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import NamedTuple

from ..store import Store
from .moments import Stand, check_number, check_zone, last_known, read_stand
from .revisions import FIRST_MOMENT, LARGEST

_MICROSECOND = timedelta(microseconds=1)


class Bounds(NamedTuple):
    """A range of revisions.

    Attributes:
        low: the first.
        high: the last; it is smaller where there is no such revision.
        redefined: no revision after this one has changed a definition up to `high`.
    """

    low: int
    high: int
    redefined: int


def find_bounds(
    store: Store,
    since: int | datetime | None,
    until: int | datetime | None,
    upto: int | None,
) -> Bounds:
    """Find the first and the last revision that someone asks for, with one statement at most.

    Args:
        store: the store.
        since: the first revision, or the time from which on they were committed; None for 1.
        until: the last revision, or the time up to which they were committed; None for the head.
        upto: the revision that a view of the past looks at; None for the head.

    Returns:
        The range.

    Raises:
        UnknownRevisionError: the knowledge base has not come to one of them yet, or a time has no
            zone.
    """
    after = _moment_before(since)
    moments = [moment for moment in (after, until) if isinstance(moment, datetime)]
    if upto is not None and not moments:
        stand = Stand(upto, 0, LARGEST)
    else:
        stand = read_stand(store, moments)
    last = last_known(store, stand, upto)
    low, high = 1, last
    if after is not None:
        low = min(stand.found[0], last) + 1
    elif since is not None and not isinstance(since, datetime):
        low = max(1, check_number(store, since, last))
    if isinstance(until, datetime):
        high = min(stand.found[-1], last)
    elif until is not None:
        high = check_number(store, until, last)
    return Bounds(low, high, stand.redefined)


def _moment_before(since: int | datetime | None) -> datetime | None:
    """Give the last moment that is too early; None where none is."""
    if not isinstance(since, datetime):
        return None
    check_zone(since)
    # Times have microseconds: nothing was committed between this one and the one before.
    return since - _MICROSECOND if since > FIRST_MOMENT else None
