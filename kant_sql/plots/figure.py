"""The figure of a timeline as plain data: Plotly draws it in a browser, a report, a notebook."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from typing_extensions import TypedDict

from ..history.gantt import PlanBar, StepBar
from ..history.timeline import Bar, Density, Lane, Timeline
from .marks import (
    DARK,
    LIGHT,
    OUTCOMES,
    Fill,
    Theme,
    address,
    axis_time,
    label,
    marks,
    said,
    shown_time,
    who,
)

# Heights in pixels: of a lane, of one with texts in its bars, of a numeric fluent, of the gaps
# between sections and around all.
ROW, TEXT_ROW, VALUE_ROW, GAP, ABOVE, BELOW = 24, 30, 64, 34, 56, 44
THICKNESS, TEXT_THICKNESS = 0.62, 0.76
FONT = 'system-ui, "DejaVu Sans", sans-serif'
_DENSITY = [[0, "rgba(112,122,132,0.40)"], [1, "rgba(112,122,132,1)"]]
# More points than this are drawn as a line alone.
MOST_POINTS = 300
_MILLISECOND = timedelta(milliseconds=1)

Trace = dict[str, Any]


class FigureSpec(TypedDict):
    """A figure as Plotly takes it: `Plotly.newPlot(element, data, layout)`."""

    data: list[dict[str, object]]
    layout: dict[str, object]


def timeline_spec(timeline: Timeline, *, dark: bool = False) -> FigureSpec:
    """Draw a timeline, as plain data.

    Args:
        timeline: what `KnowledgeBase.timeline` returned.
        dark: whether the figure is for a dark background.

    Returns:
        The figure's data and layout. `customdata` is the address of the fact, or of the plan, in
        the web application; that of a cell is in `meta.targets`, by its row. All texts are escaped.
    """
    return _Drawing(timeline, DARK if dark else LIGHT).spec()


class _Section(NamedTuple):
    """A part of the figure with an axis of its own.

    Attributes:
        title: what it shows.
        height: in pixels.
        labels: the names of its rows, from above.
        is_numeric: whether its axis has numbers, of one fluent.
    """

    title: str
    height: int
    labels: tuple[str, ...]
    is_numeric: bool = False


class _Drawing:
    """Draws one timeline."""

    def __init__(self, timeline: Timeline, theme: Theme) -> None:
        self._timeline = timeline
        self._theme = theme
        length = max(timeline.until - timeline.since, _MILLISECOND)
        # Far ends are cut off: a browser cannot place what is a million widths away.
        self._earliest = _moved(timeline.since, -length)
        self._latest = _moved(timeline.until, length)
        self._margin = length / 50
        bars = [bar for lane in timeline.lanes for bar in lane.bars]
        self._marks = marks(bar.actor for bar in bars)
        self._named: set[object] = set()
        self._sections: list[_Section] = []
        self._traces: list[Trace] = []

    def spec(self) -> FigureSpec:
        """Draw it."""
        lanes = sorted(self._timeline.lanes, key=lambda lane: _natural(lane.text))
        bars = [lane for lane in lanes if lane.kind == "value" and not _is_numeric(lane)]
        self._lanes("Facts", [lane for lane in lanes if lane.kind == "fact"])
        self._lanes("Goals", [lane for lane in lanes if lane.kind == "goal"])
        self._lanes("Values", bars)
        for lane in lanes:
            if lane.kind == "value" and lane not in bars:
                self._numbers(lane)
        self._plans(self._timeline.plans)
        return {"data": self._traces, "layout": self._layout()}

    # Facts and goals.

    def _lanes(self, title: str, lanes: Sequence[Lane]) -> None:
        if not lanes:
            return
        height = (TEXT_ROW if lanes[0].kind == "value" else ROW) * len(lanes)
        axis = self._open(_Section(title, height, tuple(label(lane.text) for lane in lanes)))
        by_actor: defaultdict[str | None, list[tuple[int, Lane, Bar]]] = defaultdict(list)
        for row, lane in enumerate(lanes):
            for bar in lane.bars:
                by_actor[bar.actor].append((row, lane, bar))
        for actor in sorted(by_actor, key=lambda name: (name is None, name or "")):
            self._bars(axis, actor, by_actor[actor])
        if any(lane.densities for lane in lanes):
            self._densities(axis, lanes)

    def _bars(self, axis: str, actor: str | None, drawn: Sequence[tuple[int, Lane, Bar]]) -> None:
        begins = [self._begin(bar.since_at) for _, _, bar in drawn]
        ends = [self._end(bar.until_at) for _, _, bar in drawn]
        named = said(actor, 40) if actor is not None else "nobody named"
        trace = self._bar_trace(axis, named, ("actor", actor), self._marks[actor])
        trace |= {
            "y": [row for row, _, _ in drawn],
            "base": [axis_time(begin) for begin in begins],
            "x": [_width(begin, end) for begin, end in zip(begins, ends, strict=True)],
            "hovertext": [_hover(lane, bar) for _, lane, bar in drawn],
            "customdata": [self._fact(lane) for _, lane, _ in drawn],
        }
        if any(bar.value is not None for _, _, bar in drawn):
            trace |= _inside([said(bar.value, 40) for _, _, bar in drawn])
        self._traces.append(trace)

    def _bar_trace(self, axis: str, name: str, group: object, mark: Fill) -> Trace:
        is_first = group not in self._named
        self._named.add(group)
        return {
            "type": "bar",
            "orientation": "h",
            "name": name,
            # Plotly keeps groups by name in a plain object: `__proto__` is none.
            "legendgroup": f"{name} ",
            "showlegend": is_first,
            "xaxis": "x",
            "yaxis": axis,
            "width": THICKNESS,
            "hovertemplate": "%{hovertext}<extra></extra>",
            "marker": {
                "color": mark.colour,
                # So that the shortest bar is one pixel wide.
                "line": {"width": 1, "color": mark.colour},
                "pattern": {
                    "shape": mark.pattern,
                    "fillmode": "overlay",
                    "fgcolor": "#ffffff",
                    "fgopacity": 0.5,
                    "size": 6,
                    "solidity": 0.25,
                },
            },
        }

    def _densities(self, axis: str, lanes: Sequence[Lane]) -> None:
        """Draw slices as cells: an image, however many there are."""
        timeline = self._timeline
        length = timeline.until - timeline.since
        edges = [timeline.since + length * n / timeline.slices for n in range(timeline.slices + 1)]
        counts: list[list[float | None]] = []
        texts: list[list[str]] = []
        for lane in lanes:
            row: list[float | None] = [None] * timeline.slices
            shown = [""] * timeline.slices
            for density in lane.densities:
                places = self._slices(density)
                each = density.count / len(places)
                text = f"{'at least ' if density.is_capped else ''}{round(each):,}"
                for n in places:
                    row[n], shown[n] = each, text
            counts.append(row)
            texts.append(shown)
        self._traces.append(
            {
                "type": "heatmap",
                "name": "too short to be drawn",
                "xaxis": "x",
                "yaxis": axis,
                "x": [axis_time(edge) for edge in edges],
                "y": list(range(len(lanes))),
                "z": counts,
                "text": texts,
                # By row: for each cell they would be most of the figure.
                "meta": {"targets": [self._fact(lane) for lane in lanes]},
                "zmin": 1,
                "zmax": max(2, *(count or 0 for row in counts for count in row)),
                "ygap": ROW * (1 - THICKNESS),
                "colorscale": _DENSITY,
                "showscale": False,
                "showlegend": True,
                "hoverongaps": False,
                "hovertemplate": "%{text} changes, too short to be drawn<br>from %{x}<br>zoom in to"
                " see them<extra></extra>",
            }
        )

    def _slices(self, density: Density) -> range:
        timeline = self._timeline
        step = (timeline.until - timeline.since) / timeline.slices
        first = round((density.begin - timeline.since) / step) if step else 0
        last = round((density.end - timeline.since) / step) if step else 1
        return range(first, max(last, first + 1))

    # Values.

    def _numbers(self, lane: Lane) -> None:
        """Draw the values of a numeric fluent as steps."""
        axis = self._open(_Section(label(lane.text), VALUE_ROW, (), True))
        steps = list(_steps(lane, self))
        has_points = len(steps) <= MOST_POINTS
        colours = [self._marks[step.actor].colour for step in steps]
        self._traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers" if has_points else "lines",
                "name": label(lane.text),
                "showlegend": False,
                "xaxis": "x",
                "yaxis": axis,
                "x": [step.at for step in steps],
                "y": [step.number for step in steps],
                "line": {"shape": "hv", "width": 1.5, "color": self._theme.quiet},
                "marker": {"size": 5, "color": colours},
                "connectgaps": False,
                "hovertext": [step.hover for step in steps],
                "hovertemplate": "%{hovertext}<extra></extra>",
                "customdata": [self._fact(lane)] * len(steps),
            }
        )
        if lane.densities:
            self._range(axis, lane)

    def _range(self, axis: str, lane: Lane) -> None:
        """Draw from the least to the largest number of each slice."""
        x: list[str | None] = []
        y: list[float | None] = []
        for density in lane.densities:
            if density.least is not None:
                middle = axis_time(density.begin + (density.end - density.begin) / 2)
                x += [middle, middle, None]
                y += [density.least, density.largest, None]
        self._traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "range",
                "showlegend": False,
                "xaxis": "x",
                "yaxis": axis,
                "x": x,
                "y": y,
                "line": {"width": 2, "color": "rgba(112,122,132,0.55)"},
                "hoverinfo": "skip",
            }
        )

    # Plans.

    def _plans(self, plans: Sequence[PlanBar]) -> None:
        """Draw plans as a Gantt chart: a row for each, more where steps overlap."""
        if not plans:
            return
        rows: list[str] = []
        drawn: defaultdict[str, list[tuple[int, PlanBar, StepBar]]] = defaultdict(list)
        recorded: list[tuple[int, PlanBar]] = []
        for plan in plans:
            first = len(rows)
            rows.append(said(f"plan {plan.id}"))
            recorded.append((first, plan))
            ends: list[datetime] = []
            carried_out = [step for step in plan.steps if step.status is not None]
            for step in sorted(carried_out, key=_order_of):
                begin, end = self._ends_of(step)
                row = next((n for n, used in enumerate(ends) if used <= begin), len(ends))
                ends[row:] = [end, *ends[row + 1 :]]
                drawn[str(step.status)].append((first + row, plan, step))
            rows += [""] * (len(ends) - 1)
        axis = self._open(_Section("Plans", TEXT_ROW * len(rows), tuple(rows)))
        self._recorded(axis, recorded)
        for status in OUTCOMES:
            if status in drawn:
                self._steps(axis, status, drawn[status])

    def _ends_of(self, step: StepBar) -> tuple[datetime, datetime]:
        begin = step.since_at or step.until_at or self._timeline.until
        return begin, step.until_at or self._latest

    def _steps(self, axis: str, status: str, drawn: Sequence[tuple[int, PlanBar, StepBar]]) -> None:
        outcome = OUTCOMES[status]
        named = f"{outcome.sign} {outcome.name}"
        trace = self._bar_trace(axis, named, ("status", status), outcome.mark)
        ends = [self._ends_of(step) for _, _, step in drawn]
        spans = [(self._begin(begin), self._end(end)) for begin, end in ends]
        trace |= {
            "y": [row for row, _, _ in drawn],
            "base": [axis_time(begin) for begin, _ in spans],
            "x": [_width(begin, end) for begin, end in spans],
            **_inside([f"{outcome.sign} {said(step.text, 60)}" for _, _, step in drawn]),
            "hovertext": [_step_hover(plan, step) for _, plan, step in drawn],
            "customdata": [self._plan(plan) for _, plan, _ in drawn],
        }
        self._traces.append(trace)

    def _recorded(self, axis: str, recorded: Sequence[tuple[int, PlanBar]]) -> None:
        inside = [one for one in recorded if self._earliest <= one[1].recorded_at <= self._latest]
        self._traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": "plan recorded",
                "xaxis": "x",
                "yaxis": axis,
                "x": [axis_time(plan.recorded_at) for _, plan in inside],
                "y": [row - 0.4 for row, _ in inside],
                "marker": {
                    "symbol": "triangle-down",
                    "size": 8,
                    "color": self._theme.quiet,
                    "line": {"width": 1, "color": self._theme.ink},
                },
                "hovertext": [_plan_hover(plan) for _, plan in inside],
                "hovertemplate": "%{hovertext}<extra></extra>",
                "customdata": [self._plan(plan) for _, plan in inside],
            }
        )

    # What all of them share.

    def _open(self, section: _Section) -> str:
        """Add a section below the others, and return the name of its axis."""
        self._sections.append(section)
        return _axis(len(self._sections), "y")

    def _fact(self, lane: Lane) -> str:
        return address("/fact", kb=self._timeline.knowledge_base, text=lane.text)

    def _plan(self, plan: PlanBar) -> str:
        return address("/plan", kb=self._timeline.knowledge_base, id=plan.id)

    def _begin(self, moment: datetime) -> datetime:
        return min(max(moment, self._earliest), self._latest)

    def _end(self, moment: datetime | None) -> datetime:
        # What holds goes on to the edge of the figure.
        last = _moved(self._timeline.until, self._margin)
        return last if moment is None else min(max(moment, self._earliest), self._latest)

    def _layout(self) -> dict[str, object]:
        theme, timeline = self._theme, self._timeline
        heights = sum(section.height for section in self._sections)
        inner = max(heights + GAP * max(0, len(self._sections) - 1), 2 * ROW)
        shown = [_moved(timeline.since, -self._margin / 2), _moved(timeline.until, self._margin)]
        layout: dict[str, Any] = {
            "height": inner + ABOVE + BELOW,
            "margin": {"t": ABOVE, "b": BELOW, "l": 16, "r": 16},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"color": theme.ink, "size": 12, "family": FONT},
            "barmode": "overlay",
            "hovermode": "closest",
            "uniformtext": {"mode": "hide", "minsize": 9},
            "hoverlabel": {"align": "left"},
            "dragmode": "zoom",
            "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"},
            "xaxis": {
                "type": "date",
                "range": [axis_time(moment) for moment in shown],
                "gridcolor": theme.line,
                "zeroline": False,
                "anchor": _axis(len(self._sections), "y") if self._sections else "y",
                "hoverformat": "%Y-%m-%d %H:%M:%S.%L",
            },
            "annotations": [],
        }
        top = 1.0
        for number, section in enumerate(self._sections, start=1):
            bottom = top - section.height / inner
            layout[_axis(number, "yaxis")] = self._vertical(section, max(bottom, 0.0), top)
            layout["annotations"].append(_title(section.title, top, theme))
            top = bottom - GAP / inner
        return layout

    def _vertical(self, section: _Section, bottom: float, top: float) -> dict[str, object]:
        axis: dict[str, object] = {
            "domain": [bottom, top],
            "automargin": True,
            "zeroline": False,
            "gridcolor": self._theme.line,
            "fixedrange": True,
        }
        if section.is_numeric:
            return axis | {"nticks": 4}
        rows = len(section.labels)
        return axis | {
            "range": [rows - 0.5, -0.5],
            "tickmode": "array",
            "tickvals": list(range(rows)),
            "ticktext": list(section.labels),
            "showgrid": False,
        }


class _Point(NamedTuple):
    """A point of a step plot."""

    at: str | None
    number: float | None
    actor: str | None = None
    hover: str = ""


def _steps(lane: Lane, drawing: _Drawing) -> Iterator[_Point]:
    """Yield the points of a fluent; None where it has no value."""
    parts: list[tuple[datetime, datetime, float | None, Bar | None]] = [
        (bar.since_at, drawing._end(bar.until_at), bar.number, bar) for bar in lane.bars
    ]
    parts += [(one.begin, one.end, one.last, None) for one in lane.densities]
    before: datetime | None = None
    for begin, end, number, bar in sorted(parts, key=lambda part: part[:2]):
        if before is not None and before < begin:
            yield _Point(axis_time(before), None)
        if bar is None:
            yield _Point(axis_time(end), number)
        else:
            hover = _hover(lane, bar)
            # A point at the edge, so that there is one to tell of what began before.
            first = max(begin, drawing._timeline.since)
            yield _Point(axis_time(first), number, bar.actor, hover)
            yield _Point(axis_time(end), number, bar.actor, hover)
        before = end


def _inside(texts: Sequence[str]) -> Trace:
    """Write texts into bars that have room for them."""
    return {
        "width": TEXT_THICKNESS,
        "text": texts,
        "textposition": "inside",
        "insidetextanchor": "start",
        "insidetextfont": {"color": "#ffffff", "size": 11},
        "textangle": 0,
    }


def _is_numeric(lane: Lane) -> bool:
    return all(bar.number is not None for bar in lane.bars)


def _axis(number: int, name: str) -> str:
    return name if number == 1 else f"{name}{number}"


def _title(text: str, top: float, theme: Theme) -> dict[str, object]:
    return {
        "text": text,
        "xref": "paper",
        "yref": "paper",
        "x": 0,
        "y": top,
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"color": theme.quiet, "weight": 700},
    }


def _moved(moment: datetime, by: timedelta) -> datetime:
    """Move a time, as far as times go."""
    try:
        return moment + by
    except OverflowError:
        return moment


def _width(begin: datetime, end: datetime) -> float:
    """Return a width on the axis, in milliseconds."""
    return max((end - begin) / _MILLISECOND, 0.0)


def _natural(text: str) -> tuple[tuple[str, int, str], ...]:
    """Order texts so that `wp2` comes before `wp10`."""
    words = text.replace("(", " ").replace(")", " ").split()
    names = [word.rstrip("0123456789") for word in words]
    return tuple(
        (name, len(word) - len(name), word) for name, word in zip(names, words, strict=True)
    )


def _order_of(step: StepBar) -> tuple[datetime, int]:
    moment = step.since_at or step.until_at
    assert moment is not None
    return moment, step.position


def _hover(lane: Lane, bar: Bar) -> str:
    named = lane.text if bar.value is None else f"{lane.text} = {bar.value}"
    lines = [f"{said(named)} ({lane.kind})"]
    lines.append(
        f"from {shown_time(bar.since_at)}{_in(bar.since)}{who(bar.actor, bar.reason, bar.source)}"
    )
    if bar.until is None or bar.until_at is None:
        lines.append("still holds")
    else:
        ended = who(bar.ended_by, bar.ended_reason, bar.ended_source)
        lines.append(f"until {shown_time(bar.until_at)}{_in(bar.until)}{ended}")
    return "<br>".join(lines)


def _in(revision: int | None) -> str:
    return f" in revision {revision}"


def _step_hover(plan: PlanBar, step: StepBar) -> str:
    outcome = OUTCOMES[step.status or "started"]
    lines = [f"{said(step.text)} {outcome.sign} {outcome.name}"]
    lines.append(f"step {step.position} of plan {plan.id}")
    if step.since_at is not None:
        by = who(step.actor, step.reason, step.source)
        lines.append(f"from {shown_time(step.since_at)}{_in(step.since)}{by}")
    if step.until_at is not None:
        by = who(step.ended_by, step.ended_reason, step.ended_source)
        lines.append(f"until {shown_time(step.until_at)}{_in(step.until)}{by}")
    return "<br>".join(lines)


def _plan_hover(plan: PlanBar) -> str:
    planner = f" of {said(plan.planner)}" if plan.planner is not None else ""
    at = f"{shown_time(plan.recorded_at)}{_in(plan.recorded_in)}"
    return f"plan {plan.id}{planner}<br>recorded {at}{who(plan.actor, plan.reason, plan.source)}"
