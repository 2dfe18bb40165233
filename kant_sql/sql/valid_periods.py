"""The periods in which facts were true, as known at a revision: versions overlaid by sayings.

A version holds from the time of the revision that asserted it to that of the one that ended it.
If sayings cover a time, the latest of them decides. A change has the revision of the version or the
saying that begins or ends there; of two, the later one.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache
from operator import attrgetter, itemgetter
from typing import NamedTuple

from sqlalchemy import text

from ..errors import reading_rows
from .dialects.base import Session
from .dialects.words import NestedLoops
from .periods import PARTS, Subjects, Touch, parameters_of, state_of, stream_timed_touches, touch_of
from .query import Query


class ValidRange(NamedTuple):
    """A range of times, as known at a revision.

    Attributes:
        since: its first time.
        until: its last time.
        before: the last revision that was committed before its first time; 0 for none.
        high: the last known revision up to its last time.
        known: the revision at which it is known.
    """

    since: datetime
    until: datetime
    before: int
    high: int
    known: int


class Instant(NamedTuple):
    """The time of a change, and the revision that recorded it."""

    time: datetime
    revision: int


# A fact (True) or a fluent: its predicate or function, and its objects.
Key = tuple[bool, int, tuple[int, ...]]
# For a fact, that it holds; for a fluent, its value as in `Touch`; None: it does not hold.
Content = str | int | None


class Saying(NamedTuple):
    """A saying of a revision about a period of a fact or a fluent."""

    revision: int
    begin: datetime
    end: datetime
    content: Content


def key_of(touch: Touch) -> Key:
    """Return the fact or the fluent that changes."""
    return touch.is_fact, touch.owner, touch.objects


def content_of(touch: Touch) -> Content:
    """Return the new content."""
    return None if touch.is_end else 1 if touch.is_fact else touch.value


_SAID = {True: "NOT v.holds", False: "v.value IS NULL AND v.object_id IS NULL"}


@cache
def _sayings(loops: NestedLoops, places: tuple[int, ...]) -> Query:
    parts = []
    for place in places:
        part, wanted = PARTS[place], f"{loops.rows(f'which{place}', 1)} AS wanted"
        is_end = f"CASE WHEN {_SAID[part.identity == 'proposition']} THEN 1 ELSE 0 END AS is_end"
        rest = f", v.valid_from, v.valid_until, v.{part.id} AS id"
        which = (
            f"v.kb_id = :kb AND v.{part.key} = wanted.c0 AND v.since <= :known"
            " AND v.valid_from <= :until AND v.valid_until >= :since"
        )
        table = f"{part.identity}_saying"
        leading = part.select(f"v.since AS revision, {is_end}", rest)
        parts.append(f"{leading} FROM {wanted}{loops.loop('v', table, which)}")
    return Query(text(" UNION ALL ".join(parts)))


def _read_sayings(
    session: Session, kb_id: int, which: Subjects, span: ValidRange
) -> tuple[dict[Key, list[Saying]], Subjects]:
    """Read the sayings about a range, with the ids of their elements, in one statement."""
    places, values = parameters_of(kb_id, which)
    values.pop("is_goal", None)
    if not places:
        return {}, Subjects()
    ends = {name: session.from_time(getattr(span, name)) for name in ("since", "until")}
    query = _sayings(session.loops, places)
    found: defaultdict[Key, list[Saying]] = defaultdict(list)
    ids: dict[bool, set[int]] = {True: set(), False: set()}
    for row in session.rows(query, **values, **ends, known=span.known):
        touch = touch_of(row[:7])
        with reading_rows("saying", f"revision {touch.revision!r}"):
            begin, end = map(session.to_time, row[7:9])
        found[key_of(touch)].append(Saying(touch.revision, begin, end, content_of(touch)))
        ids[touch.is_fact].add(row[9])
    facts, fluents = (tuple(sorted(ids[is_fact])) for is_fact in (True, False))
    return found, Subjects(facts=facts, values=fluents)


def read_valid(
    session: Session, kb_id: int, which: Subjects, span: ValidRange
) -> tuple[list[Touch], Iterator[tuple[Instant, Touch]]]:
    """Read the true state right before a range, and the changes in it.

    It takes four statements at most. It streams elements without sayings, in constant memory.
    """
    said, ids = _read_sayings(session, kb_id, which, span)
    state = [*state_of(session, kb_id, which, span.before)] if span.before else []
    bounds = span.before, span.high
    if not said:
        return state, _instants(stream_timed_touches(session, kb_id, which, *bounds))
    before = {
        key: (touch.revision, content_of(touch))
        for touch in state
        if (key := key_of(touch)) in said
    }
    state = [touch for touch in state if key_of(touch) not in said]
    plain: defaultdict[Key, dict[datetime, tuple[int, Content]]] = defaultdict(dict)
    for time, touch in stream_timed_touches(session, kb_id, ids, *bounds):
        # Of revisions at one time, the last one stays.
        plain[key_of(touch)][time] = touch.revision, content_of(touch)
    changes: list[tuple[Instant, Touch]] = []
    for key, sayings in said.items():
        last: Content = None
        flattened = _flattened(before.get(key, (0, None)), plain[key], sayings, span)
        for begin, number, content in flattened:
            for is_end, value in ((True, last), (False, content)):
                if value is not None:
                    touch = Touch(number, is_end, *key, None if key[0] else value)
                    if begin is None:
                        state.append(touch)
                    else:
                        changes.append((Instant(begin, number), touch))
            last = content
    changes.sort(key=itemgetter(0))
    rest = _instants(stream_timed_touches(session, kb_id, which, *bounds))
    others = (each for each in rest if key_of(each[1]) not in said)
    return state, heapq.merge(others, changes, key=itemgetter(0))


def _instants(
    touches: Iterable[tuple[datetime, Touch]],
) -> Iterator[tuple[Instant, Touch]]:
    return ((Instant(time, touch.revision), touch) for time, touch in touches)


def _flattened(
    plain: tuple[int, Content],
    changes: Mapping[datetime, tuple[int, Content]],
    sayings: Sequence[Saying],
    span: ValidRange,
) -> Iterator[tuple[datetime | None, int, Content]]:
    """Yield the true state right before a range, and each change in it, with time and revision.

    Args:
        plain: the versions right before the range, and their revisions.
        changes: the changes of versions in the range.
        sayings: the sayings about times in it, or until its beginning.
    """
    times = {*changes}.union(time for one in sayings for time in one[1:3])
    rest = sorted(sayings, key=attrgetter("begin"), reverse=True)
    # The latest saying first.
    active: list[tuple[int, Saying]] = []
    while rest and rest[-1].begin < span.since:
        heapq.heappush(active, (-rest[-1].revision, rest.pop()))
    rules = active[0][1] if active else None
    content = plain[1] if rules is None else rules.content
    yield None, plain[0] if rules is None else rules.revision, content
    for time in sorted(time for time in times if span.since <= time <= span.until):
        plain = changes.get(time, (0, plain[1]))
        while rest and rest[-1].begin <= time:
            heapq.heappush(active, (-rest[-1].revision, rest.pop()))
        while active and active[0][1].end <= time:
            heapq.heappop(active)
        left, rules = rules, active[0][1] if active else None
        now = plain[1] if rules is None else rules.content
        if now == content:
            continue
        said = [plain[0]] if left is None or rules is None else []
        said += [left.revision] if left is not None and left.end == time else []
        said += [rules.revision] if rules is not None and rules.begin == time else []
        yield time, max(said), now
        content = now
