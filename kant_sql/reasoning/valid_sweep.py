"""The states of a range of valid times, as known at a revision.

A position on the valid clock is one number: a time, and the revision that stated the change. At one
time, the statements of earlier revisions come first; only the last of such states lasts.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Sequence
from datetime import datetime, timedelta
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

from typing_extensions import override

from ..dto import formulas as f
from ..history.moments import Bounds
from ..history.revisions import FIRST_MOMENT
from ..knowledge.definitions import Definitions
from ..sql.definition_rows import Lost, read_ends, with_lost, without
from ..sql.dialects.base import Session
from ..sql.periods import Subjects, Touch, fits
from ..sql.valid_periods import Instant, Key, ValidRange, key_of, read_valid
from ..store.store import Store
from .derived import world_of
from .sweep import Range, Sweep, Visit, moved, read_range

_MICROSECOND = timedelta(microseconds=1)
_REVISIONS = 64
# Later than every position.
ENDLESS = 1 << 128


def position_of(instant: Instant) -> int:
    """Return the position of an instant; 0 is before the range."""
    return (instant.time - FIRST_MOMENT) // _MICROSECOND << _REVISIONS | instant.revision


def instant_at(position: int) -> Instant:
    """Return the instant of a position."""
    time = FIRST_MOMENT + (position >> _REVISIONS) * _MICROSECOND
    return Instant(time, position & (1 << _REVISIONS) - 1)


def is_same_time(one: int, other: int) -> bool:
    """Return whether two positions are at one time."""
    return one >> _REVISIONS == other >> _REVISIONS


class ValidPast(NamedTuple):
    """A range of valid times, and the definitions in it."""

    span: ValidRange
    # All types, objects, predicates and functions that were known in it, by their last definitions;
    # other elements as known.
    definitions: Definitions
    lost: Sequence[Lost]  # the ones that have ended since, in order
    # Whether some have had other definitions, so statements may not fit: those that do not are
    # not true.
    is_redefined: bool = False

    def read(
        self, session: Session, kb_id: int, which: Subjects
    ) -> tuple[list[Touch], Iterator[tuple[Instant, Touch]]]:
        """Read the statements right before the range, and the changes in it, as far as they fit."""
        state, changes = read_valid(session, kb_id, which, self.span)
        if not self.is_redefined:
            return state, changes
        fit = partial(fits, self.definitions)
        return [*filter(fit, state)], (each for each in changes if fit(each[1]))


def read_past(store: Store, span: ValidRange) -> ValidPast:
    """Read the definitions in a range; refuse a range with an archived part."""
    definitions = store.read_definitions(lambda known: known, span.known)

    def work(session: Session, kb_id: int) -> ValidPast:
        check_range(session, kb_id, span)
        lost, redefined = read_ends(session, kb_id, span.before, span.known)
        every = definitions
        if lost:
            every = with_lost(session, kb_id, definitions, span.before, span.known)
        return ValidPast(span, every, lost, bool(redefined))

    return store.query_known(work, ValidPast(span, definitions, []))


def check_range(session: Session, kb_id: int, span: ValidRange) -> None:
    """Refuse a range with an archived part."""
    # Even before the first revision, there may be statements about objects that were moved.
    read_range(session, kb_id, Bounds(span.before + 1, max(1, span.high), 0, span.known))


class ValidSweep(Sweep):
    """Visits the states of a range of valid times after each change, by position."""

    def __init__(
        self,
        session: Session,
        kb_id: int,
        formulas: Sequence[f.Node],
        past: ValidPast,
        ranges: bool,
    ) -> None:
        """Find the relevant elements, as `Sweep`, but with the known rules."""
        known = past.span.known
        definitions = past.definitions
        super().__init__(session, kb_id, formulas, definitions, Range(known, known, 0), ranges)
        self._past = past

    @override
    def begin(self) -> Visit:
        """Read the state right before the range; it is empty before all times."""
        self._definitions, lost = self._past.definitions, self._past.lost
        self._world = world_of(self._definitions)
        span = self._past.span
        state, changes = self._past.read(self._session, self._kb_id, self._subjects)
        for touch in state:
            self._apply(touch)
        ends: list[tuple[Instant, Touch | Lost]] = [
            (Instant(one.time, one.revision), one) for one in lost if one.time <= span.until
        ]
        events = heapq.merge(ends, changes, key=itemgetter(0))
        self._events = groupby(events, key=itemgetter(0))
        self._next = next(self._events, None)
        return Visit(0, self._world, self._definitions)

    @property
    def next_time(self) -> datetime | None:
        """The time of the next state; None after the last one."""
        return None if self._next is None else self._next[0].time

    @property
    @override
    def following(self) -> int | None:
        """The position of the next state; None after the last one."""
        return None if self._next is None else position_of(self._next[0])

    @override
    def step(self) -> Visit:
        """Go to the next state."""
        assert self._next is not None
        instant, events = self._next
        lost = []
        for _, event in events:
            if isinstance(event, Lost):
                lost.append(event)
            else:
                self._apply(event)
        if lost:
            self._definitions = without(self._definitions, lost)
            self._world = moved(self._world, self._definitions)
        self._next = next(self._events, None)
        return Visit(position_of(instant), self._world, self._definitions)


Period = tuple[int, int]


def read_periods(
    session: Session, kb_id: int, which: Subjects, past: ValidPast
) -> dict[Key, list[Period]]:
    """Read when facts were true in a range: 0 and `ENDLESS` are before and after it."""
    found: dict[Key, list[Period]] = {}
    state, changes = past.read(session, kb_id, which)
    for touch in state:
        found[key_of(touch)] = [(0, ENDLESS)]
    for instant, touch in changes:
        own, position = found.setdefault(key_of(touch), []), position_of(instant)
        if touch.is_end:
            own[-1] = own[-1][0], position
        else:
            own.append((position, ENDLESS))
    return found


def common(periods: Collection[Sequence[Period]]) -> Iterator[Period]:
    """Yield the overlaps of periods of all lists; those of one list are in order and disjoint."""
    first, *others = periods
    for other in others:
        first = [*_both(first, other)]
    yield from first


def _both(left: Sequence[Period], right: Sequence[Period]) -> Iterator[Period]:
    n = m = 0
    while n < len(left) and m < len(right):
        since, until = max(left[n][0], right[m][0]), min(left[n][1], right[m][1])
        if since < until:
            yield since, until
        if left[n][1] < right[m][1]:
            n += 1
        else:
            m += 1
