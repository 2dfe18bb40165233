"""A timeline: the facts, goals, values and plans of a window, in bounded size.

A lane with few versions in the window has a bar for each. In a lane with many, versions that last
for a whole slice of the window are bars, and shorter ones are counted in the slice in which they
began.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import NamedTuple, cast

from ..dao.text import refuse_unknown_names
from ..knowledge.sayings import COMMITTED
from ..moment_text import Moment, When, read_when
from ..sql.dialects.base import Session
from ..sql.lanes import (
    FORMULA,
    LANE_SOURCES,
    Cell,
    FoundLane,
    FoundVersion,
    LanePlace,
    LaneReader,
    LaneSpan,
    first_said,
    revisions_at,
)
from ..sql.periods import Subjects, read_names
from ..sql.rows import FACT, VALUE
from ..sql.valid_periods import Instant, Key, ValidRange, key_of, read_valid
from ..store.state import State
from ..store.store import Store
from .drawing import Timeline
from .gantt import PlanBars
from .moments import MICROSECOND, is_valid_clock
from .revisions import FIRST_MOMENT, Revision, missing_revision, read_numbered, why_of
from .window import (
    TIMELINE_KINDS,
    Bar,
    Density,
    Lane,
    LaneKind,
    TimelineQuestion,
    Window,
    check_question,
    read_window,
)

# Limits of one answer, whatever the number of lanes: bars of lanes with few versions, slices of the
# others, and versions counted in these.
BARS, CELLS, COUNTED = 4_000, 15_000, 150_000
# A version that began within this first part of the window counts as held since its beginning; the
# number of unchanged lanes to look for.
FIRST, MOST_FOLDED = 600, 5_000


def timeline(
    state: State,
    since: When | None = None,
    *,
    until: When | None = None,
    predicate: str | None = None,
    object: str | None = None,
    text: str | None = None,
    kinds: Iterable[str] = TIMELINE_KINDS,
    lanes: int = 50,
    after: str | None = None,
    unchanged: bool = False,
    slices: int = 600,
    clock: str = COMMITTED,
) -> Timeline:
    """Read the facts, goals, values and executions in a window of time, in bounded size.

    A lane is a fact, a goal or a fluent that held at some time in the window. If it changed seldom,
    it has a bar for each version. If it changed often, versions that last for a whole slice of the
    window, about a pixel, are bars, and shorter ones are counted by slice. Lanes that held from the
    beginning of the window (its first six-hundredth) to its end are folded, unless there are no
    others.

    A notebook draws the result; `svg` is the drawing as text.

    Args:
        since: the beginning, given as for `kb.at`; None for the first revision, or, by valid time,
            for the earliest period if that began before it.
        until: the end; None for the last revision. A time in the future counts as now.
        predicate: show lanes of this predicate or function.
        object: show lanes and steps of plans with this object among the arguments.
        text: show lanes and steps of plans whose text contains this, ignoring case.
        kinds: what to show: some of `fact`, `goal`, `value` and `plan`.
        lanes: the maximum number of lanes.
        after: `next` of the previous timeline, for the following lanes. Plans come with the first
            lanes.
        unchanged: whether to show also lanes that never changed.
        slices: the number of slices of the window. There are fewer if the versions of many lanes
            must be counted.
        clock: `committed`, or `valid` for the times when facts and values were true, as known in
            this state. Then bars of elements with sayings begin no earlier than the window, and
            their revisions are those of the sayings.

    Returns:
        The timeline. It lacks archived versions, up to `archived_until`.

    Raises:
        UnknownRevisionError: there is no such revision yet, or a time has no zone.
        UnknownNameError: there never was such a predicate or object.
        InvalidArgumentError: the window ends before it begins, an argument is out of range, or
            there is no such clock.

    Examples:
        >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
        >>> for lane in kb.timeline(object="rb1").lanes:
        ...     for bar in lane.bars:
        ...         print(lane.kind, lane.text, bar.since, bar.until, bar.actor)
        fact (robot_at rb1 wp1) 1 2 perception
    """
    store, upto = state.store, state.upto
    question = check_question(kinds, predicate, object, text, lanes, slices, after, unchanged)
    is_valid, given = is_valid_clock(clock), (read_when(since), read_when(until))

    def work(session: Session, kb_id: int | None) -> Timeline:
        ends: tuple[Moment | None, Moment | None] = given
        if is_valid and kb_id is not None:
            ends = _valid_ends(session, kb_id, store, *given, upto)
        window = read_window(session, kb_id, store, ends, upto)
        if kb_id is None or not window.head:
            return Timeline(store.name, window.since, window.until, 0, 0, 1)
        valid = None
        if is_valid:
            # A change at the beginning of the window is already true then.
            begin = min(window.since + MICROSECOND, window.until)
            valid = ValidRange(begin, window.until, window.low, window.high, window.head)
        return _Reader(session, kb_id, window, question, valid).read(store.name)

    found = store.query_in_snapshot(work)
    if not (found.lanes or question.after):
        # Plans have no predicate, and may have arguments that are no objects.
        refuse_unknown_names(store, predicate, None if found.plans else object)
    return found


def _valid_ends(
    session: Session,
    kb_id: int,
    store: Store,
    since: Moment | None,
    until: Moment | None,
    upto: int | None,
) -> tuple[Moment, Moment | None]:
    """Return the ends of a window of valid times; a revision means the time of its commit."""
    end = FIRST_MOMENT if until == 0 else until
    known = read_window(session, kb_id, store, (since, None), upto)
    if since:
        return known.since, end
    begin = min(known.since, first_said(session, kb_id, known.head) or known.since)
    if end is not None:
        begin = min(begin, read_window(session, kb_id, store, (FIRST_MOMENT, end), upto).until)
    return begin, end


class _Row(NamedTuple):
    """A found lane, and its key in the source."""

    kind: str
    found: FoundLane


def _shown_kind(source: str) -> LaneKind:
    """Return the kind of the lanes of a source."""
    return "goal" if source == FORMULA else cast(LaneKind, source)


def _weight(rows: Iterable[_Row]) -> int:
    """Return the cost of counting the lanes: a number needs its row besides the index."""
    return sum(4 if row.kind == "value" else 1 for row in rows)


@dataclass(eq=False)
class _Reader:
    """Reads a timeline in a fixed number of statements."""

    _session: Session
    _kb_id: int
    _window: Window
    _question: TimelineQuestion
    _valid: ValidRange | None

    def __post_init__(self) -> None:
        question, window = self._question, self._window
        length = (window.until - window.since) // MICROSECOND
        self._slices = max(1, min(question.slices, length))
        own = question.wanted, (window.low, window.high), self._valid
        self._lanes = LaneReader(self._session, self._kb_id, *own)

    def read(self, name: str) -> Timeline:
        """Read it."""
        rows, following, folded = self._unfolded()
        said = [row for row in rows if row.found.said]
        sparse, dense = self._divide([row for row in rows if not row.found.said])
        if dense:
            self._slices = min(self._slices, max(1, CELLS // _weight(dense)))
        moments = self._moments()
        cells = self._cells(dense, moments) if dense else {}
        versions = self._versions(sparse, cells)
        periods = self._periods(said) if said else {}
        plans = PlanBars(self._session, self._kb_id, self._window, self._question)
        wanted = {one for bars, _ in periods.values() for each in bars for one in each.revisions}
        told = self._told(versions, wanted.union(plans.numbers()))
        lanes = []
        for row in rows:
            densities = tuple[Density, ...]()
            if row in periods:
                true, densities = periods[row]
                if not (true or densities):
                    continue
                made = [_bar(one.since, one.until, one.value, one.number, told) for one in true]
            else:
                bars = versions[row]
                if row in cells:
                    bars, densities = _thin_out(cells[row], bars, moments, self._window)
                made = [_known_bar(one, told, self._window.head) for one in bars]
            lanes.append(Lane(_shown_kind(row.kind), row.found.text, tuple(made), densities))
        window = self._window
        return Timeline(
            name,
            *window[:4],
            self._slices,
            tuple(lanes),
            following,
            plans.bars(told),
            plans.has_more,
            window.archived_until,
            *folded,
        )

    def _unfolded(self) -> tuple[list[_Row], str | None, tuple[int | None, bool]]:
        """Find the lanes, the position of the next ones, and the number of unchanged ones."""
        question, window = self._question, self._window
        if question.unchanged:
            return *self._find(None), (None, False)
        first = window.since + (window.until - window.since) / FIRST
        (number,) = revisions_at(self._session, self._kb_id, [first])
        settled = min(max(number, window.low), window.high)
        rows, following = self._find(settled)
        if not rows:
            return *self._find(None), (0, False)
        if question.after is not None:
            return rows, following, (0, False)
        kinds = [kind for kind in LANE_SOURCES if _shown_kind(kind) in question.kinds]
        return rows, following, self._lanes.count_unchanged(kinds, settled, MOST_FOLDED)

    def _find(self, settled: int | None) -> tuple[list[_Row], str | None]:
        """Find the lanes, and the position after which the next ones come."""
        question, sources = self._question, [*LANE_SOURCES]
        rows: list[_Row] = []
        first, place = question.after or (sources[0], LanePlace())
        for kind in sources[sources.index(first) :]:
            if _shown_kind(kind) in question.kinds and len(rows) <= question.lanes:
                after = place if kind == first else LanePlace()
                most, enough = question.lanes + 1 - len(rows), question.slices + 1
                found = self._lanes.find(kind, after, most, enough, settled)
                rows += [_Row(kind, one) for one in found]
        following = None
        if len(rows) > question.lanes:
            del rows[question.lanes :]
            kind, last = rows[-1]
            following = f"{kind}:{last.place.group}:{last.place.arguments}"
        return rows, following

    def _divide(self, rows: Sequence[_Row]) -> tuple[list[_Row], list[_Row]]:
        """Divide lanes into those with few versions, all bars, and those with too many."""
        sparse, room = [], BARS
        for row in sorted(rows, key=lambda row: row.found.began):
            room -= row.found.began + 1
            if room >= 0 and row.found.began <= self._question.slices:
                sparse.append(row)
        chosen = set(sparse)
        return sparse, [row for row in rows if row not in chosen]

    def _moments(self) -> list[datetime]:
        """Return the ends of the slices."""
        since, length = self._window.since, self._window.until - self._window.since
        return [since + length * n / self._slices for n in range(self._slices + 1)]

    def _cells(self, rows: Sequence[_Row], moments: Sequence[datetime]) -> dict[_Row, _Cells]:
        """Count the versions that began in each slice, in two statements."""
        window = self._window
        known = revisions_at(self._session, self._kb_id, moments)
        ends = [min(max(number, window.low), window.high) for number in known]
        ends[0], ends[-1] = window.low, window.high
        slices = [(n, low, high) for n, (low, high) in enumerate(pairwise(ends)) if low < high]
        enough = max(2, COUNTED // (_weight(rows) * len(slices)))
        found: dict[_Row, _Cells] = {}
        for kind in dict.fromkeys(row.kind for row in rows):
            own = [row for row in rows if row.kind == kind]
            ids, bounds = [row.found.id for row in own], [(low, high) for _, low, high in slices]
            counted = self._lanes.cells(kind, ids, bounds, enough)
            for row in own:
                found[row] = _Cells(ends, enough, [None] * self._slices)
            for cell in counted:
                if cell.began:
                    found[own[cell.lane]].cells[slices[cell.slice][0]] = cell
        return found

    def _versions(
        self, sparse: Sequence[_Row], cells: Mapping[_Row, _Cells]
    ) -> dict[_Row, list[FoundVersion]]:
        """Read the versions that may become bars, in one statement for each kind."""
        window = self._window
        spans = {row: [LaneSpan(row.found.id, window.low, window.high)] for row in sparse}
        spans |= {row: each.spans(row.found.id) for row, each in cells.items()}
        versions: dict[_Row, list[FoundVersion]] = {row: [] for row in spans}
        for kind in dict.fromkeys(row.kind for row in spans):
            asked = [(row, span) for row, own in spans.items() if row.kind == kind for span in own]
            found = self._lanes.spans(kind, [span for _, span in asked])
            for version in found:
                versions[asked[version.span][0]].append(version)
        return versions

    def _periods(self, rows: Sequence[_Row]) -> dict[_Row, _Periods]:
        """Read the valid periods of elements with sayings, in five statements."""
        span, window = self._valid, self._window
        assert span is not None
        of = {_key_of(row): row for row in rows}
        ids = [tuple(row.found.id for row in rows if row.kind == kind) for kind in (FACT, VALUE)]
        which = Subjects(facts=ids[0], values=ids[1])
        state, changes = read_valid(self._session, self._kb_id, which, span)
        # True periods; a value ends where the next one begins.
        begun = {key_of(one): (Instant(window.since, one.revision), one.value) for one in state}
        found: dict[_Row, list[_Period]] = {row: [] for row in rows}
        last: Instant | None = None
        for count, (instant, touch) in enumerate(changes):
            key = key_of(touch)
            if touch.is_end:
                found[of[key]].append(_Period(*begun.pop(key), instant))
            else:
                begun[key] = instant, touch.value
            if count >= COUNTED:
                last = instant
                break
        for key, (instant, value) in begun.items():
            found[of[key]].append(_Period(instant, value, last))
        held = {row: [one for one in own if one.lasts] for row, own in found.items()}
        objects = {one.value for own in held.values() for one in own if isinstance(one.value, int)}
        names = read_names(self._session, self._kb_id, sorted(objects)) if objects else {}
        room = max(1, min(self._question.slices, BARS // len(rows)))
        moments = self._moments()
        return {
            row: _gathered([one.named(names) for one in own], room, moments, last)
            for row, own in held.items()
        }

    def _told(
        self, versions: Mapping[_Row, Iterable[FoundVersion]], numbers: Collection[int]
    ) -> dict[int, Revision]:
        wanted = set(numbers)
        for each in versions.values():
            for version in each:
                wanted.add(version.since)
                if version.until is not None and version.until <= self._window.head:
                    wanted.add(version.until)
        found = read_numbered(self._session, self._kb_id, wanted)
        for number in wanted - found.keys():
            raise missing_revision(self._session, number)
        return found


def _key_of(row: _Row) -> Key:
    group, arguments = row.found.place
    return row.kind == FACT, group, tuple([int(one) for one in arguments.split()])


class _Period(NamedTuple):
    """A period in which a fact was true, or a fluent had a value."""

    since: Instant
    value: str | int | None
    until: Instant | None

    @property
    def lasts(self) -> bool:
        """Whether it is longer than an instant."""
        return self.until is None or self.since.time < self.until.time

    @property
    def revisions(self) -> list[int]:
        """The revisions that recorded its ends."""
        return [one.revision for one in (self.since, self.until) if one is not None]

    @property
    def number(self) -> float | None:
        """Its value, if that is a number."""
        with suppress(TypeError, ValueError):
            return None if self.value is None else float(self.value)
        return None

    def named(self, names: Mapping[int, str]) -> _Period:
        """Return it with the name of the object in place of its id."""
        return self._replace(value=names[self.value]) if isinstance(self.value, int) else self


# The periods to show as bars, and the densities of shorter ones.
_Periods = tuple[list[_Period], tuple[Density, ...]]


def _gathered(
    periods: list[_Period], room: int, moments: Sequence[datetime], last: Instant | None
) -> _Periods:
    """Make bars of periods; of too many, only of those that last for a slice."""
    # Nothing was read after the `last` instant.
    if len(periods) <= room and last is None:
        return periods, ()
    bars = []
    short: dict[int, list[_Period]] = {}
    for one in periods:
        first = bisect_left(moments, one.since.time)
        is_whole = first + 1 < len(moments) and (
            one.until is None or one.until.time >= moments[first + 1]
        )
        if is_whole:
            bars.append(one)
        else:
            short.setdefault(max(0, first - 1), []).append(one)
    densities = []
    for place, own in sorted(short.items()):
        begin, end = moments[place : place + 2]
        numbers = [number for one in own if (number := one.number) is not None]
        span = (min(numbers), max(numbers), numbers[-1]) if numbers else (None, None, None)
        densities.append(Density(begin, end, len(own), False, *span))
    if last is not None:
        densities.append(Density(last.time, moments[-1], 1, True))
    return bars, tuple(densities)


def _bar(
    since: Instant,
    until: Instant | None,
    value: str | int | None,
    number: float | None,
    told: Mapping[int, Revision],
) -> Bar:
    end, until_at = (None, None) if until is None else (until.revision, until.time)
    actor, reason, source = why_of(told[since.revision])
    ended_by, ended_reason, ended_source = why_of(None if end is None else told[end])
    said = actor, reason, ended_by, ended_reason, source, ended_source
    shown = None if value is None else str(value)
    return Bar(since.revision, end, since.time, until_at, *said, shown, number)


class _Cells(NamedTuple):
    """The versions of a lane that began in each slice."""

    ends: Sequence[int]  # the last revision before each slice, and the last revision of all
    enough: int  # the number of versions counted in a slice
    cells: list[Cell | None]  # what began in each slice; None for nothing

    def is_capped(self, place: int) -> bool:
        """Return whether counting of a slice ended at the limit."""
        cell = self.cells[place]
        return cell is not None and cell.began >= self.enough

    def spans(self, owner: int) -> list[LaneSpan]:
        """Return the slices in which no version begins: a version may last through these."""
        starts = [0]
        for n, cell in enumerate(self.cells):
            if cell is None and n and self.cells[n - 1] is not None:
                starts.append(n)
        return [LaneSpan(owner, self.ends[n], self.ends[n]) for n in starts]


def _thin_out(
    counted: _Cells,
    versions: Sequence[FoundVersion],
    moments: Sequence[datetime],
    window: Window,
) -> tuple[list[FoundVersion], tuple[Density, ...]]:
    """Make bars of versions that last for a whole slice, and densities of the others."""
    ends = counted.ends
    counts = [0 if cell is None else cell.began for cell in counted.cells]
    bars = []
    for version in versions:
        # The first slice that begins with it.
        first = bisect_left(ends, version.since)
        if first < len(counts) and (version.until is None or version.until > ends[first + 1]):
            bars.append(version)
            if version.since > ends[0] and not counted.is_capped(first - 1):
                counts[first - 1] -= 1
        elif version.since <= ends[0] and not counted.is_capped(0):
            counts[0] += 1
    return bars, tuple(_merged(counts, counted, moments))


def _merged(
    counts: Sequence[int], counted: _Cells, moments: Sequence[datetime]
) -> Iterator[Density]:
    """Yield the densities of slices; merge equal neighbouring ones of facts."""
    end = 0
    for n, count in enumerate(counts):
        if n < end or not count:
            continue
        cell, end = counted.cells[n], n + 1
        numbers = (None, None, None) if cell is None else cell[3:]
        is_capped = counted.is_capped(n)
        while (
            numbers == (None, None, None)
            and end < len(counts)
            and counts[end] == count
            and counted.is_capped(end) == is_capped
        ):
            end += 1
        total = count * (end - n)
        yield Density(moments[n], moments[end], total, is_capped, *numbers)


def _known_bar(version: FoundVersion, told: Mapping[int, Revision], head: int) -> Bar:
    since = Instant(told[version.since].committed_at, version.since)
    until = None
    if version.until is not None and version.until <= head:
        until = Instant(told[version.until].committed_at, version.until)
    return _bar(since, until, version.value, version.number, told)
