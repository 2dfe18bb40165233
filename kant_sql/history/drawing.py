"""The drawing of a timeline: one SVG of rectangles and text, for pages, reports, notebooks, paper.

Horizontal positions are shares of the width, so that one drawing fits a telephone and a wall. Text
has the colour of the surrounding text, so that it is legible in light, dark and print; the colours
of bars have a contrast of 4.5:1 with the white text in them, and of 3:1 with both backgrounds.
"""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from html import escape
from itertools import pairwise
from typing import NamedTuple
from zlib import crc32

from .. import html
from .moments import MICROSECOND
from .window import Bar, Density, Lane, PlanBar, StepBar

# Heights in pixels: of a lane's text, its bar, a numeric fluent, a line of text, and the axis.
LABEL, BAR, PLOT, LINE, AXIS = 15, 16, 36, 18, 40
# The longest text, the most items in a bar's title, and the actors in the legend.
LENGTH, TITLED, NAMED, VALUES = 120, 600, 8, 6
# Neighbouring bars thinner than this, in percent, are drawn as one.
THIN = 0.35
# Facts of a predicate whose ends differ by less than this, in percent, share a lane, from this
# number on.
ALIKE, MANY = 2.0, 4
_COLOURS = ("#0072b2", "#b84f00", "#007f5f", "#7a5fd0", "#b5447f", "#86690f")
_NOBODY, _INK = "#68717a", "currentColor"
# The sign and colour of each status of a step.
_OUTCOMES = {
    "succeeded": ("✓", "#007f5f"),
    "failed": ("✗", "#b84f00"),
    "aborted": ("■", "#68717a"),
    "refused": ("✗", "#68717a"),
    "running": ("▶", "#0072b2"),
}
_SECTIONS = {"fact": "Facts", "goal": "Goals", "value": "Values"}
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_SECOND, _DAY = 10**6, 86_400 * 10**6
# The steps of the axis, in microseconds.
_STEPS = (
    *(n * 10**power for power in range(6) for n in (1, 2, 5)),
    *(n * _SECOND for n in (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800)),
    *(n * 3600 * _SECOND for n in (1, 2, 3, 6, 12)),
    *(n * _DAY for n in (1, 2, 4, 7, *(7 << power for power in range(1, 18)))),
)
_MOST_TICKS = 5
# Characters that XML forbids.
_NO_XML = re.compile("[\ufffe\uffff]")
_STYLE = (
    "<style>svg{color:#1b2126;background:#fff}@media(prefers-color-scheme:dark)"
    "{svg{color:#e6eaed;background:#14181c}}</style>"
)

Link = Callable[..., str]


def no_link(path: str, /, **query: object) -> str:
    """Return no address, for a drawing outside of the pages."""
    return ""


@dataclass(frozen=True, slots=True)
class Timeline:
    """Facts, goals, values and plans in a window of time; a notebook shows it as a drawing.

    Attributes:
        knowledge_base: the name of the knowledge base.
        since: the beginning of the window, in UTC.
        until: its end.
        first: the revision of the initial state; 0 before the first.
        last: its last revision.
        slices: the number of slices of equal length for densities.
        lanes: the lanes, in a fixed order: facts, goals and values, by predicate or function.
        next: the value of `after` for the following lanes; None after the last.
        plans: the recorded plans that were made or executed in the window, oldest first.
        has_more_plans: whether earlier plans or steps are omitted.
        archived_until: versions that ended up to this time are in an archive, and missing here;
            None if the window begins later.
        folded: the number of omitted unchanged lanes, counted with the first lanes only; None with
            `unchanged`.
        has_more_folded: whether there are more of these, beyond the count.
    """

    knowledge_base: str
    since: datetime
    until: datetime
    first: int
    last: int
    slices: int
    lanes: tuple[Lane, ...] = ()
    next: str | None = None
    plans: tuple[PlanBar, ...] = ()
    has_more_plans: bool = False
    archived_until: datetime | None = None
    folded: int | None = None
    has_more_folded: bool = False

    def svg(self) -> str:
        """Draw it as SVG, for a file or a browser.

        Facts that differ only in the last argument share a lane with this argument as its value, if
        no two of them visibly hold at once. Facts of a predicate that come and go together also
        share a lane, except with `unchanged`.

        Examples:
            >>> kb.timeline(object="rb1").svg().startswith("<svg")
            True
        """
        made = draw(self)
        return made.together('xmlns="http://www.w3.org/2000/svg" width="960"', _STYLE)

    def _repr_svg_(self) -> str:
        return self.svg()

    def _repr_html_(self) -> str:
        made = draw(self).together('width="100%"')
        return f"<div>{made}</div>"


class Drawing(NamedTuple):
    """A drawing in two parts: a page keeps the first part in view."""

    axis: str  # the element of the axis
    body: str  # the element of everything below the axis
    height: int  # the height of the body, in pixels

    def together(self, attributes: str, style: str = "") -> str:
        """Write both parts in one element."""
        body = self.body.replace("<svg ", f'<svg y="{AXIS}" ', 1)
        return (
            f'<svg {attributes} height="{AXIS + self.height}" font-family="system-ui, sans-serif"'
            f' font-size="12">{style}{self.axis}{body}</svg>'
        )


class _Span(NamedTuple):
    """A bar of a row: its ends in percent, its versions, and the text in it."""

    begin: float
    end: float
    lane: Lane
    bar: Bar
    text: str = ""


class _Row(NamedTuple):
    """A row of bars: its text, its link, and the number of its lanes."""

    text: str
    address: str
    spans: list[_Span]
    densities: Sequence[Density] = ()
    lanes: int = 1


def draw(shown: Timeline, link: Link = no_link) -> Drawing:
    """Draw a timeline."""
    # `link` makes the address of a page from its path and parameters; an empty one is no link.
    return _Pen(shown, link).draw()


class _Pen:
    """Draws one timeline, from top to bottom."""

    def __init__(self, shown: Timeline, link: Link) -> None:
        self._shown = shown
        self._link = link
        # Bars without an end extend to the edge, a little beyond the end.
        self._length = max(shown.until - shown.since, timedelta(milliseconds=1)) * 1.02
        self._marks = _marks(shown.lanes)
        self._parts: list[str] = []
        self._ends: list[str] = []
        self._y = 0
        self._titled = 0

    def draw(self) -> Drawing:
        shown = self._shown
        ticks = list(_ticks(shown.since, shown.until))
        self._legend()
        for kind, title in _SECTIONS.items():
            lanes = sorted((one for one in shown.lanes if one.kind == kind), key=_natural)
            if lanes:
                self._heading(title)
                for row in self._rows(lanes):
                    self._row(row)
        if shown.plans:
            self._heading("Plans")
            for plan in shown.plans:
                self._plan(plan)
        self._left()
        height = self._y + 6
        lines = "".join(self._line(tick, height) for tick, _ in ticks)
        ends = "".join(self._ends)
        ends = f'<g transform="translate(-3)" stroke="#fff" stroke-width="0.6">{ends}</g>'
        name = f"Timeline of {_said(shown.knowledge_base)}, {self._window()}"
        # Acts without a plan stand beside the plans.
        plans = sum(one.id is not None for one in shown.plans)
        counts = ((len(shown.lanes), "lane"), (plans, "plan"))
        count = " and ".join(f"{each:,} {noun}{'s' * (each != 1)}" for each, noun in counts)
        about = f"<title>{name}</title><desc>{count}: what held when, and who said so.</desc>"
        body = _svg(height, about + lines + "".join(self._parts) + ends, 'role="group"')
        return Drawing(self._axis(ticks), body, height)

    # The axis.

    def _window(self) -> str:
        since, until = _time(self._shown.since), _time(self._shown.until)
        # On the same day, the end shows only the time.
        return f"{since} to {until.removeprefix(since[:11])} UTC"

    def _axis(self, ticks: Sequence[tuple[datetime, str]]) -> str:
        parts = [_text(13, self._window(), "600")]
        edges = [self._shown.since, *(moment for moment, _ in ticks), self._shown.until]
        labels = ["", *(said for _, said in ticks)]
        for (begin, end), label in zip(pairwise(edges), labels, strict=True):
            if begin < end:
                parts.append(self._part(begin, end, label))
        parts += [self._line(tick, AXIS, 18) for tick, _ in ticks]
        parts.append(f'<line x2="100%" y1="{AXIS - 1}" y2="{AXIS - 1}" stroke="{_INK}"/>')
        return _svg(AXIS, "".join(parts), 'role="group" aria-label="Time"')

    def _part(self, begin: datetime, end: datetime, label: str) -> str:
        """Write a part of the axis, which links to its own timeline."""
        address = self._link("/timeline", since=begin, until=end)
        x, name = self._x(begin), f"Zoom to {_time(begin)} until {_time(end)}"
        return _a(
            address,
            f'<rect x="{x:.2f}%" y="18" width="{self._x(end) - x:.2f}%" height="{AXIS - 18}"'
            f' fill="{_INK}" fill-opacity="{0.08 if address else 0}"/>'
            f'<text x="{x:.2f}%" dx="4" y="34" fill="{_INK}">{label}</text>',
            f'aria-label="{name}"',
        )

    def _line(self, moment: datetime, height: int, y: int = 0) -> str:
        x = self._x(moment)
        return (
            f'<line x1="{x:.2f}%" x2="{x:.2f}%" y1="{y}" y2="{height}" stroke="{_INK}"'
            ' stroke-opacity="0.18"/>'
        )

    def _x(self, moment: datetime) -> float:
        return min(max((moment - self._shown.since) / self._length, 0.0), 1.0) * 100

    # Lines of text.

    def _say(self, text: str, address: str = "", weight: str = "400", room: int = LINE) -> None:
        self._parts.append(_a(address, _text(self._y + room - 5, text, weight, bool(address))))
        self._y += room

    def _heading(self, title: str) -> None:
        self._say(title, weight="700", room=26)

    def _left(self) -> None:
        """Write what the drawing omits."""
        shown = self._shown
        if shown.next is not None:
            self._say("More lanes follow.", room=24)
        if shown.folded:
            more = "at least " * shown.has_more_folded
            said = f"{more}{shown.folded:,} more never changed in this time"
            self._say(said + ".", self._link("/timeline", unchanged=True), room=24)
        if not shown.lanes and not shown.plans:
            self._say("Nothing of this held in this time.", room=24)

    def _legend(self) -> None:
        """Write the actors, and how often each asserted and retracted."""
        bars = [bar for lane in self._shown.lanes for bar in lane.bars]
        asserted = Counter(bar.actor for bar in bars)
        retracted = Counter(bar.ended_by for bar in bars if bar.until is not None)
        busiest = (asserted + retracted).most_common()
        if not busiest:
            return
        self._say("A bar: who asserted it. Its end: who retracted it.")
        for n, (actor, _) in enumerate(busiest[:NAMED]):
            x, y, name = 50 * (n % 2), self._y + LINE * (n // 2), _said(_actor(actor))
            more, less = f"+{asserted[actor]:,}", f"\u2212{retracted[actor]:,}"
            swatch = f'<rect x="{x}%" y="{y + 3}" width="12" height="12" {self._fill(actor)}/>'
            text = f'<text x="{x}%" dx="18" y="{y + 13}" fill="{_INK}">{name} {more} {less}</text>'
            about = f"{name} asserted {asserted[actor]:,} and retracted {retracted[actor]:,}"
            self._parts.append(f"<g><title>{about}</title>{swatch}{text}</g>")
        self._y += LINE * ((min(len(busiest), NAMED) + 1) // 2)
        if len(busiest) > NAMED:
            self._say(f"and {len(busiest) - NAMED:,} more who wrote less")

    def _fill(self, actor: str | None) -> str:
        return f'fill="{self._marks[actor]}"'

    # Facts, goals and values.

    def _rows(self, lanes: Sequence[Lane]) -> Iterator[_Row]:
        """Yield the rows of the lanes of a kind: exclusive facts share one."""
        groups: defaultdict[tuple[str, ...], list[Lane]] = defaultdict(list)
        for lane in lanes:
            groups[lane_key(lane)].append(lane)
        single: list[_Row] = []
        for key, members in groups.items():
            if len(members) > 1 and _are_exclusive(members):
                yield from self._alike(single)
                single = []
                yield self._shared(key[1:], members)
            else:
                single += [self._own(lane) for lane in members]
        yield from self._alike(single)

    def _own(self, lane: Lane) -> _Row:
        spans = [self._span(lane, bar, bar.value or "") for bar in lane.bars]
        return _Row(lane.text, self._fact(lane), spans, lane.densities)

    def _shared(self, key: tuple[str, ...], lanes: Sequence[Lane]) -> _Row:
        spans = [self._span(lane, bar, _words(lane)[-1]) for lane in lanes for bar in lane.bars]
        spans.sort(key=lambda span: span.bar.since)
        densities = [density for lane in lanes for density in lane.densities]
        address = self._link("/timeline", predicate=key[0], object=key[1])
        values = [*dict.fromkeys(span.text for span in spans)]
        more = ", ..." * (len(values) > VALUES)
        text = f"{' '.join(key)}: {', '.join(values[:VALUES])}{more}"
        return _Row(text, address, spans, densities, len(lanes))

    def _alike(self, rows: Iterable[_Row]) -> Iterator[_Row]:
        """Yield rows; merge rows of a predicate that come and go together."""
        if self._shown.folded is None:
            yield from rows
            return
        clusters: list[list[_Row]] = []
        # The groups that a row may join, each with the edges of its first row.
        near: defaultdict[tuple[object, ...], list[tuple[list[float], list[_Row]]]]
        near = defaultdict(list)
        for row in rows:
            edges = [edge for span in row.spans for edge in (span.begin, span.end)]
            similar = near[_look(row)] if edges and not row.densities else []
            found = next((of for first, of in similar if _are_near(first, edges)), None)
            if found is None:
                found = []
                clusters.append(found)
                similar.append((edges, found))
            found.append(row)
        for each in clusters:
            yield from each if len(each) < MANY else [self._merged(each)]

    def _merged(self, rows: Sequence[_Row]) -> _Row:
        spans = [
            one[0]._replace(begin=min(s.begin for s in one), end=max(s.end for s in one))
            for one in zip(*(row.spans for row in rows), strict=True)
        ]
        name = _words(spans[0].lane)[0]
        address = self._link("/timeline", predicate=name, unchanged=True)
        return _Row(f"({name} ...) {len(rows)} facts", address, spans, lanes=len(rows))

    def _span(self, lane: Lane, bar: Bar, text: str) -> _Span:
        end = 100.0 if bar.until_at is None else self._x(bar.until_at)
        return _Span(self._x(bar.since_at), end, lane, bar, text)

    def _fact(self, lane: Lane) -> str:
        return self._link("/fact", text=lane.text)

    def _row(self, row: _Row) -> None:
        if _is_number(row):
            self._numbers(row)
            return
        self._say(_said(row.text), row.address, room=LABEL + 2)
        for density in row.densities:
            self._density(density)
        for run in _runs(row.spans):
            if len(run) > 1:
                self._crowd(run)
            else:
                self._bar(run[0], row)
        self._y += BAR + 5

    def _crowd(self, run: Sequence[_Span]) -> None:
        """Draw thin bars as one."""
        actors = {self._marks[span.bar.actor] for span in run}
        colour = actors.pop() if len(actors) == 1 else _NOBODY
        times = f"from {_time(run[0].bar.since_at)} to {_time(run[-1].bar.until_at)}"
        about = f"{len(run):,} periods {times}; zoom in to see each"
        span = run[0].begin, run[-1].end
        self._parts.append(_box(span, self._y, colour, "", "", self._title(about)))

    def _bar(self, span: _Span, row: _Row) -> None:
        bar, is_ended = span.bar, span.bar.until_at is not None
        ended_by = _actor(bar.ended_by) if is_ended else ""
        colour, title = self._marks[bar.actor], self._title(_about(span, row))
        made = _box((span.begin, span.end), self._y, colour, span.text, ended_by, title)
        if row.lanes > 1 and span.text:
            made = _a(self._fact(span.lane), made, 'tabindex="-1"')
        self._parts.append(made)
        if bar.until_at is not None and bar.until_at <= self._shown.until:
            place = f'x="{span.end:.2f}%" y="{self._y - 2}" width="4" height="{BAR + 4}"'
            self._ends.append(f"<rect {place} {self._fill(bar.ended_by)}/>")

    def _title(self, text: str) -> str:
        """Return the title of a bar; with many bars, only the first ones get one."""
        self._titled += 1
        return f"<title>{text}</title>" if self._titled <= TITLED else ""

    def _density(self, density: Density) -> None:
        x, end = self._x(density.begin), self._x(density.end)
        self._parts.append(
            f'<rect x="{x:.2f}%" y="{self._y + 3}" width="{end - x:.2f}%" height="{BAR - 6}"'
            f' fill="{_INK}" fill-opacity="0.45">{self._title(_counted(density))}</rect>'
        )

    def _numbers(self, row: _Row) -> None:
        """Draw numbers as steps, above a line that shows who set them."""
        scale = _Scale.of(row)
        self._say(f"{_said(row.text)} = {scale}", row.address, room=LABEL + 2)
        path, before = [], -1.0
        for one in row.densities:
            if one.least is not None and one.largest is not None:
                low, high = scale.y(one.least), scale.y(one.largest)
                a, b = self._x(one.begin) * 10, self._x(one.end) * 10
                path.append(f"M{a:.1f} {low:.1f}H{b:.1f}V{high:.1f}H{a:.1f}Z")
        for span in row.spans:
            move = "V" if span.begin == before else f"M{span.begin * 10:.1f} "
            path.append(f"{move}{scale.y(span.bar.number or 0):.1f}H{span.end * 10:.1f}")
            before = span.end
        self._parts.append(
            f'<svg y="{self._y}" width="100%" height="{PLOT}" viewBox="0 0 1000 {PLOT}"'
            f' preserveAspectRatio="none"><path d="{"".join(path)}" fill="none" stroke="{_INK}"'
            ' stroke-width="1.5" vector-effect="non-scaling-stroke"/></svg>'
        )
        for span in row.spans:
            self._base(span.begin, span.end, self._marks[span.bar.actor], _about(span, row))
        for one in row.densities:
            self._base(self._x(one.begin), self._x(one.end), _NOBODY, _counted(one))
        self._y += PLOT + 5

    def _base(self, begin: float, end: float, colour: str, about: str) -> None:
        """Draw below a number who set it; the title covers both."""
        place, title = f'x="{begin:.2f}%" width="{end - begin:.2f}%"', self._title(about)
        self._parts.append(
            f'<rect {place} y="{self._y + PLOT - 4}" height="4" fill="{colour}"/>'
            + f'<rect {place} y="{self._y}" height="{PLOT}" fill-opacity="0">{title}</rect>'
            * bool(title)
        )

    # Plans.

    def _plan(self, plan: PlanBar) -> None:
        """Draw the executed steps of a plan; overlapping ones get another row."""
        done = sorted((one for one in plan.steps if one.status is not None), key=_order_of)
        left = len(plan.steps) - len(done)
        planner = "" if plan.planner is None else f" by {_said(plan.planner)}"
        never = f", {left:,} not started" if left else ""
        said = f"plan {plan.id}{planner}: {html.counted(len(plan.steps), 'step')}{never}"
        place = self._link("/plan", id=plan.id)
        if plan.id is None:
            said, place = html.counted(len(plan.steps), "execution"), self._link("/acts")
        self._say(said, place, room=LABEL + 2)
        if plan.recorded_at and self._shown.since <= plan.recorded_at <= self._shown.until:
            about = f"recorded {_time(plan.recorded_at)} in revision {plan.recorded_in}"
            by = _who(plan.actor, plan.reason, plan.source)
            self._parts.append(
                f'<text x="{self._x(plan.recorded_at):.2f}%" y="{self._y}" text-anchor="middle"'
                f' fill="{_INK}">▾<title>{about}{by}</title></text>'
            )
        ends: list[float] = []
        for step in done:
            begin = self._x(step.since_at or step.until_at or self._shown.until)
            end = 100.0 if step.until_at is None else self._x(step.until_at)
            n = next((n for n, used in enumerate(ends) if used <= begin), len(ends))
            ends[n:] = [end, *ends[n + 1 :]]
            self._step(plan, step, (begin, end), self._y + n * (BAR + 2))
        self._y += len(ends) * (BAR + 2) + 5

    def _step(self, plan: PlanBar, step: StepBar, span: tuple[float, float], y: int) -> None:
        name = step.status or "running"
        sign, colour = _OUTCOMES[name]
        place = f"step {step.position} of plan {plan.id}"
        if plan.id is None:
            place = f"execution {step.position}"
        title = self._title("\n".join([f"{_said(step.text)} {name}", place, *_ends(step)]))
        self._parts.append(_box(span, y, colour, f"{sign} {step.text}", "", title))


def _box(span: tuple[float, float], y: int, colour: str, text: str, at_end: str, title: str) -> str:
    """Write a bar between two ends in percent, with the texts that fit."""
    width = max(span[1] - span[0], 0.0)
    first = _fitting(text, width)
    last = _fitting(at_end, width, len(first) + 3)
    place = f'x="{span[0]:.2f}%" y="{y}" width="{width:.2f}%" height="{BAR}"'
    if not first and not last:
        # The outline keeps the shortest bar visible.
        return f'<rect {place} fill="{colour}" stroke="{colour}">{title}</rect>'
    texts = f'<text x="5" y="12" fill="#fff">{_said(first)}</text>' if first else ""
    if last:
        texts += f'<text x="100%" dx="-8" y="12" text-anchor="end" fill="#fff">{_said(last)}</text>'
    rect = f'<rect width="100%" height="{BAR}" fill="{colour}"/>'
    return f"<svg {place}>{rect}{texts}{title}</svg>"


def _svg(height: int, content: str, attributes: str) -> str:
    return f'<svg width="100%" height="{height}" font-size="12" {attributes}>{content}</svg>'


def _text(y: int, text: str, weight: str, is_link: bool = False) -> str:
    line = ' text-decoration="underline"' if is_link else ""
    return f'<text x="0" y="{y}" fill="{_INK}" font-weight="{weight}"{line}>{text}</text>'


def _a(address: str, content: str, attributes: str = "") -> str:
    return f'<a href="{escape(address)}" {attributes}>{content}</a>' if address else content


class _Scale(NamedTuple):
    """The range of the numbers in a row."""

    least: float
    largest: float

    @classmethod
    def of(cls, row: _Row) -> _Scale:
        """Find them."""
        found = [span.bar.number for span in row.spans]
        found += [n for one in row.densities for n in (one.least, one.largest, one.last)]
        numbers = [number for number in found if number is not None]
        return cls(min(numbers), max(numbers))

    def y(self, number: float) -> float:
        """Return the distance of a number from the top of the plot."""
        room, length = PLOT - 8, self.largest - self.least
        return 2 + room * ((self.largest - number) / length if length else 0.5)

    def __str__(self) -> str:
        both = self.least, self.largest
        return " to ".join(dict.fromkeys(f"{number:g}" for number in both))


def _runs(spans: Iterable[_Span]) -> Iterator[list[_Span]]:
    """Yield groups of bars: neighbouring thin ones together."""
    run: list[_Span] = []
    for span in spans:
        is_thin = span.bar.until_at is not None and span.end - span.begin < THIN
        if run and not (is_thin and span.begin - run[-1].end < THIN):
            yield run
            run = []
        run.append(span)
        if not is_thin:
            yield run
            run = []
    if run:
        yield run


def _is_number(row: _Row) -> bool:
    if row.spans:
        return all(span.bar.number is not None for span in row.spans)
    return any(density.last is not None for density in row.densities)


def _words(lane: Lane) -> list[str]:
    return lane.text.strip("()").split()


def lane_key(lane: Lane) -> tuple[str, ...]:
    """Return the key of facts that may exclude each other: all words but the last."""
    words = _words(lane)
    is_atom = lane.kind != "value" and len(words) > 2 and lane.text.count("(") == 1
    return (lane.kind, *words[:-1]) if is_atom else (lane.kind, lane.text)


def _are_exclusive(lanes: Sequence[Lane]) -> bool:
    """Return whether no two of these facts visibly hold at once."""
    bars = sorted((bar for lane in lanes for bar in lane.bars), key=lambda bar: bar.since)
    return sum(bool(lane.bars) for lane in lanes) > 1 and all(
        one.until is not None and one.until <= other.since for one, other in pairwise(bars)
    )


def _look(row: _Row) -> tuple[object, ...]:
    """Return the key of rows that may come and go together: facts of one predicate."""
    lane = row.spans[0].lane
    own = _words(lane)[0] if lane.kind == "fact" else (lane.kind, lane.text)
    return own, *(span.bar.until is None for span in row.spans)


def _are_near(some: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether edges are visibly at the same positions."""
    return all(abs(a - b) <= ALIKE for a, b in zip(some, others, strict=True))


def _natural(lane: Lane) -> tuple[tuple[str, int, str], ...]:
    """Return the sort key of a lane, in which `wp2` comes before `wp10`."""
    names = [(word.rstrip("0123456789"), word) for word in _words(lane)]
    return tuple((name, len(word) - len(name), word) for name, word in names)


def _order_of(step: StepBar) -> tuple[datetime, int]:
    moment = step.since_at or step.until_at
    assert moment is not None
    return moment, step.position


def _marks(lanes: Iterable[Lane]) -> dict[str | None, str]:
    """Assign a colour to each actor, a unique one while there are any."""
    # An actor keeps the colour in the next window, unless another one there takes it first.
    found: dict[str | None, str] = {None: _NOBODY}
    free = list(_COLOURS)
    actors = {who for lane in lanes for bar in lane.bars for who in (bar.actor, bar.ended_by)}
    for name in sorted(who for who in actors if who is not None):
        free = free or list(_COLOURS)
        found[name] = free.pop(crc32(name.encode("utf-8", "replace")) % len(free))
    return found


def _ticks(since: datetime, until: datetime) -> Iterator[tuple[datetime, str]]:
    """Yield the times of the axis with their texts."""
    begin, end = (since - _EPOCH) // MICROSECOND, (until - _EPOCH) // MICROSECOND
    step = next((one for one in _STEPS if (end - begin) / one <= _MOST_TICKS), _STEPS[-1])
    for n in range(begin // step + 1, end // step + 1):
        moment = _EPOCH + n * step * MICROSECOND
        # The edge has no room for its text.
        if moment - since < (until - since) * 0.97:
            yield moment, _tick(moment, step)


def _tick(moment: datetime, step: int) -> str:
    if step < _SECOND:
        return f"{moment:%S.%f} s" if step % 1000 else f"{moment:%S.%f}"[:-3] + " s"
    if step < 60 * _SECOND:
        return f"{moment:%H:%M:%S}"
    if step < _DAY and (moment.hour or moment.minute):
        return f"{moment:%H:%M}"
    return f"{moment.day} {moment:%b}" if step < 100 * _DAY else f"{moment:%Y-%m-%d}"


# Texts.


def _said(text: str) -> str:
    """Return a text escaped, visible and bounded."""
    shown = html.visible(" ".join(text.split()))
    return escape(_NO_XML.sub("\ufffd", html.cut(shown, LENGTH)))


def _fitting(text: str, width: float, taken: int = 0) -> str:
    """Return a text if it fits a bar, in a drawing of usual width; else nothing."""
    return text if text and (len(text) + taken) * 0.75 + 1 < width else ""


def _actor(name: str | None) -> str:
    return "nobody named" if name is None else name


def _time(moment: datetime | None) -> str:
    if moment is None:
        return "now"
    text = moment.replace(tzinfo=None).isoformat(" ")
    return text.rstrip("0") if "." in text else text


def _who(actor: str | None, reason: str | None, source: object) -> str:
    """Return who did something, why, and from which source."""
    by = "" if actor is None else f" by {_said(actor)}"
    why = "" if reason is None else f": {_said(reason)}"
    given = "" if source is None else f" {_said(json.dumps(source, ensure_ascii=False))}"
    return by + why + given


def _about(span: _Span, row: _Row) -> str:
    """Return the description of a bar."""
    lane, bar = span.lane, span.bar
    is_merged = row.lanes > 1 and not span.text
    named = row.text if is_merged else lane.text
    value = "" if bar.value is None else f" = {bar.value}"
    holds = ["holds"] if bar.until_at is None else []
    return "\n".join([_said(f"{named}{value}"), *_ends(bar), *holds])


def _ends(one: Bar | StepBar) -> Iterator[str]:
    """Return the beginning and end, and who reported them."""
    if one.since_at is not None:
        by = _who(one.actor, one.reason, one.source)
        yield f"from {_time(one.since_at)} in revision {one.since}{by}"
    if one.until_at is not None:
        by = _who(one.ended_by, one.ended_reason, one.ended_source)
        yield f"until {_time(one.until_at)} in revision {one.until}{by}"


def _counted(density: Density) -> str:
    least = "at least " * density.is_capped
    return f"{least}{density.count:,} changes too short to be drawn; zoom in to see them"
