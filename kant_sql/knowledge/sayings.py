"""Sayings: statements about a period of valid time."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from heapq import heappop, heappush
from typing import NamedTuple, Protocol, TypeVar

from ..errors import InvalidArgumentError
from .canonical import in_utc, time_text

# The clock of a writer's statements: valid from the commit on, or from the observation on.
COMMITTED, OBSERVED = "committed", "observed"
# The given beginning and end of a transaction's period.
Given = tuple[datetime | None, datetime | None]
FROM_NOW_ON: Given = (None, None)


class Period(NamedTuple):
    """The valid period of a revision.

    Attributes:
        valid_from: its beginning.
        valid_until: its end; for an open period, the time of the revision.
        is_open: whether the period continues from now on.
    """

    valid_from: datetime
    valid_until: datetime
    is_open: bool

    def text(self, said: str, holds: bool) -> str:
        """Write a saying: that a fact or a value held, or did not hold."""
        begin, end = map(time_text, self[:2])
        return f'(:{"held" if holds else "not-held"} {said} :from "{begin}" :until "{end}")'


class OfPeriod(Protocol):
    """A statement about a period."""

    @property
    def begin(self) -> datetime:
        """The first time."""

    @property
    def end(self) -> datetime:
        """The end, which is not part of it."""


S = TypeVar("S", bound=OfPeriod)


def last_said(begin: datetime, end: datetime, said: Iterable[S]) -> list[tuple[datetime, S | None]]:
    """Return the statement that decides in each part of a period, with its beginning, or None.

    The last statement that covers a time decides.
    """
    rest = [(-n, one) for n, one in enumerate(said) if one.begin < end and begin < one.end]
    ends = {at for _, one in rest for at in (one.begin, one.end) if begin < at < end}
    rest.sort(key=lambda each: each[1].begin, reverse=True)
    active: list[tuple[int, S]] = []
    found: list[tuple[datetime, S | None]] = []
    for at in sorted({begin, *ends}):
        while rest and rest[-1][1].begin <= at:
            heappush(active, rest.pop())
        while active and active[0][1].end <= at:
            heappop(active)
        found.append((at, active[0][1] if active else None))
    return found


def make_period(given: Given, now: datetime, is_observed: bool = False) -> Period | None:
    """Make the valid period of a revision; None: from now on.

    Args:
        given: its beginning and its end.
        now: the time of the revision if it was committed now.
        is_observed: whether it begins at the time of an observation, by a clock that may be ahead.
    """
    begin, end = (in_utc(name, each) for name, each in zip(_NAMES, given, strict=True))
    if begin is None:
        if end is not None:
            raise InvalidArgumentError(
                f"valid_until {time_text(end)} has no valid_from: give both, or valid_from alone"
            )
        return None
    if is_observed and begin >= now:
        return None
    for name, moment in zip(_NAMES, (begin, end), strict=True):
        # A period that ends now is in the past.
        if moment is not None and (moment > now or moment == begin == now):
            raise InvalidArgumentError(
                f"{name} {time_text(moment)} is not before the store's clock, {time_text(now)}: "
                "a period is in the past. Leave it out for a fact that holds from now on; "
                "what will hold at a known time is a timed initial literal: "
                "kb.pddl.timed_initial_literals.save('(at 10 (door_open hall))')"
            )
    if end is not None and end <= begin:
        raise InvalidArgumentError(
            f"valid_until {time_text(end)} is not after valid_from {time_text(begin)}: a period "
            "has its beginning, and not its end; exchange them, or give a later end"
        )
    return Period(begin, now if end is None else end, end is None)


_NAMES = "valid_from", "valid_until"
