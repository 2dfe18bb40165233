"""What is said of a period: of when a writer speaks, if not of now on."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from heapq import heappop, heappush
from typing import NamedTuple, Protocol, TypeVar

from ..errors import InvalidArgumentError
from .canonical import in_utc, time_text

# By which clock a writer says when something held: from the commit on, or from the observation on.
COMMITTED, OBSERVED = "committed", "observed"
# What a transaction was given: where its period begins, and where it ends.
Given = tuple[datetime | None, datetime | None]
FROM_NOW_ON: Given = (None, None)


class Period(NamedTuple):
    """The period that a revision speaks of.

    Attributes:
        valid_from: where it begins.
        valid_until: where it is over; if it is open, this is the time of the revision.
        is_open: whether the revision speaks of the time from now on, too.
    """

    valid_from: datetime
    valid_until: datetime
    is_open: bool

    def text(self, said: str, holds: bool) -> str:
        """Write a saying: that a fact or a value held, or that a fact or fluent did not."""
        begin, end = map(time_text, self[:2])
        return f'(:{"held" if holds else "not-held"} {said} :from "{begin}" :until "{end}")'


class OfPeriod(Protocol):
    """What was said of the time from its beginning to its end."""

    @property
    def begin(self) -> datetime:
        """The first time."""

    @property
    def end(self) -> datetime:
        """Where it is over."""


S = TypeVar("S", bound=OfPeriod)


def last_said(begin: datetime, end: datetime, said: Iterable[S]) -> list[tuple[datetime, S | None]]:
    """Return what counts in each part of a period, with where that begins; None: nothing.

    Of what covers a time, the last counts.
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
    """Make the period that a revision speaks of; None: from now on.

    Args:
        given: where it begins, and where it ends.
        now: the time of the revision if it was committed now.
        is_observed: whether it is the time of an observation, by a clock that may be ahead.
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
        # A period that ends now is over.
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
