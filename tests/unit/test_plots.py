"""Figures of timelines: what is drawn where, in which colour, and with which words."""

from __future__ import annotations

import itertools
import json
import sys
from datetime import UTC, datetime, timedelta
from typing import Any
from unittest import mock

import plotly.graph_objects as go
import pytest

from kant_sql import Bar, Density, Lane, PlanBar, StepBar, Timeline, plots
from kant_sql.errors import ExtraMissingError
from kant_sql.plots.marks import COLOURS, marks

NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)
HOUR = timedelta(hours=1)


def bar(since: int, until: int | None, actor: str | None = "nav", **more: Any) -> Bar:
    """A version from one hour after noon until another."""
    ended = None if until is None else NOON + until * HOUR
    return Bar(since, until, NOON + since * HOUR, ended, actor, "moved", **more)


def timeline(*lanes: Lane, **more: Any) -> Timeline:
    """Ten hours after noon, in ten slices."""
    return Timeline("tiago", NOON, NOON + 10 * HOUR, 0, 10, 10, lanes, **more)


def drawn(made: Timeline, **options: Any) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The traces and the layout, which Plotly takes and which are JSON."""
    spec: Any = plots.timeline_spec(made, **options)
    go.Figure(spec)
    assert json.loads(json.dumps(spec)) == spec
    return spec["data"], spec["layout"]


def test_bars_are_where_a_fact_held() -> None:
    lane = Lane("fact", "(at rb1 wp1)", (bar(1, 3), bar(5, None, "arm")))
    (arm, nav), layout = drawn(timeline(lane))
    assert (nav["name"], nav["base"], nav["x"]) == ("nav", ["2026-03-02T13:00:00.000000"], [7.2e6])
    # What holds goes on to the edge.
    assert arm["base"] == ["2026-03-02T17:00:00.000000"]
    assert arm["x"] == [5.2 * 3.6e6]
    assert layout["yaxis"]["ticktext"] == ["(at rb1 wp1)"]
    assert nav["customdata"] == ["/fact?kb=tiago&text=%28at+rb1+wp1%29"]
    assert "from 2026-03-02 13:00:00 in revision 1 by nav" in nav["hovertext"][0]
    assert "until 2026-03-02 15:00:00 in revision 3" in nav["hovertext"][0]
    assert "because: moved" in nav["hovertext"][0]
    assert "still holds" in arm["hovertext"][0]


def test_facts_goals_values_and_plans_are_apart() -> None:
    step = StepBar(0, "(move)", "failed", 2, 3, NOON + 2 * HOUR, NOON + 3 * HOUR)
    plan = PlanBar(7, 1, NOON + HOUR, "planner", None, "aries", (step,))
    data, layout = drawn(
        timeline(
            Lane("fact", "(at)", (bar(1, 2),)),
            Lane("goal", "(at)", (bar(1, 2),)),
            Lane("value", "(loc)", (bar(1, 2, value="wp1"),)),
            Lane("value", "(fuel)", (bar(1, 2, value="5", number=5.0),)),
            plans=(plan,),
        )
    )
    assert [(each["type"], each["yaxis"]) for each in data] == [
        ("bar", "y"),
        ("bar", "y2"),
        ("bar", "y3"),
        ("scatter", "y4"),
        ("scatter", "y5"),
        ("bar", "y5"),
    ]
    titles = [each["text"] for each in layout["annotations"]]
    assert titles == [
        "Facts",
        "Goals",
        "Values",
        "(fuel)",
        "Plans",
    ]
    domains = [layout[f"yaxis{n}"]["domain"] for n in ("", 2, 3, 4, 5)]
    assert all(below[1] < above[0] for above, below in itertools.pairwise(domains))
    assert domains[-1][0] == pytest.approx(0)
    # An actor has one entry in the legend.
    assert [each["showlegend"] for each in data[:3]] == [True, False, False]
    gantt = data[-1]
    assert gantt["text"] == ["✗ (move)"]
    assert gantt["marker"]["pattern"]["shape"] == "x"
    assert gantt["customdata"] == ["/plan?kb=tiago&id=7"]


def test_steps_that_overlap_have_rows_of_their_own() -> None:
    steps = tuple(
        StepBar(n, f"(s{n})", "succeeded", 1, 2, NOON + begin * HOUR, NOON + end * HOUR)
        for n, (begin, end) in enumerate([(1, 4), (2, 3), (3, 5), (4, 6)])
    )
    plans = (
        PlanBar(1, 1, NOON, None, None, None, steps),
        PlanBar(2, 1, NOON, None, None, None, (StepBar(0, "(never)", None),)),
    )
    (recorded, done), layout = drawn(timeline(plans=plans))
    assert done["y"] == [0, 1, 1, 0]
    assert layout["yaxis"]["ticktext"] == ["plan 1", "", "plan 2"]
    assert [round(row) for row in recorded["y"]] == [0, 2]


def test_densities_are_cells() -> None:
    begin = NOON + 2 * HOUR
    lane = Lane(
        "fact",
        "(at)",
        (bar(5, 6),),
        (Density(begin, begin + 3 * HOUR, 12, False), Density(NOON + 9 * HOUR, NOON, 7, True)),
    )
    (_, cells), _ = drawn(timeline(lane, Lane("fact", "(on)", (bar(1, 2),))))
    assert cells["z"] == [[None, None, 4, 4, 4, None, None, None, None, 7], [None] * 10]
    assert cells["text"][0][3] == "4"
    assert cells["text"][0][9] == "at least 7"
    assert len(cells["x"]) == 11
    assert cells["meta"]["targets"] == [
        "/fact?kb=tiago&text=%28at%29",
        "/fact?kb=tiago&text=%28on%29",
    ]


def test_values_are_steps_with_gaps() -> None:
    numbers = (bar(1, 2, number=5.0), bar(2, 4, "arm", number=3.0), bar(6, None, number=9.0))
    (line,), _ = drawn(timeline(Lane("value", "(fuel)", numbers)))
    assert line["y"] == [5, 5, 3, 3, None, 9, 9]
    assert line["line"]["shape"] == "hv"
    dense = Density(NOON, NOON + HOUR, 50, False, 1.0, 8.0, 4.0)
    (line, spread), _ = drawn(timeline(Lane("value", "(fuel)", (), (dense,))))
    assert line["y"] == [4]
    assert spread["y"] == [1, 8, None]


def test_each_actor_has_a_mark_of_its_own() -> None:
    names = [f"actor{n}" for n in range(20)]
    found = marks([None, *names])
    assert len(set(found.values())) == 21
    assert marks(reversed(names)) == {name: found[name] for name in [None, *names]}
    few = marks(names[:4])
    assert {mark.pattern for mark in few.values()} == {""}
    assert {few[name].colour for name in names[:4]} <= {*COLOURS}


def test_texts_are_no_markup() -> None:
    text = "(at <b>x</b>\u202e&amp; " + 300 * "y" + ")"
    lane = Lane("fact", text, (bar(1, 2, "<a href='javascript:1'>nav</a>"),))
    (only,), layout = drawn(timeline(lane))
    said = [only["name"], *only["hovertext"], *layout["yaxis"]["ticktext"]]
    assert not any("<a" in each or "<b>" in each or "\u202e" in each for each in said)
    assert "&lt;b&gt;x&lt;/b&gt;\\u202e&amp;amp;" in only["hovertext"][0]
    assert all(len(each) < 600 for each in said)


def test_a_bar_from_long_ago_is_cut_off() -> None:
    lane = Lane("fact", "(at)", (bar(-1_000_000, 1_000_000),))
    (only,), _ = drawn(timeline(lane))
    assert only["base"] == ["2026-03-02T02:00:00.000000"]
    assert only["x"] == [30 * 3.6e6]


@pytest.mark.parametrize("moment", [datetime.min, datetime.max])
def test_the_ends_of_time_can_be_drawn(moment: datetime) -> None:
    moment = moment.replace(tzinfo=UTC)
    made = Timeline("tiago", moment, moment, 0, 1, 1, (Lane("fact", "(at)", (bar(1, None),)),))
    drawn(made)


def test_a_figure_is_for_a_light_or_a_dark_page() -> None:
    _, light = drawn(timeline())
    _, dark = drawn(timeline(), dark=True)
    assert light["font"]["color"] != dark["font"]["color"]
    assert light["height"] == dark["height"]


def test_without_plotly_it_is_said_what_to_install() -> None:
    with (
        mock.patch.dict(sys.modules, {"plotly.graph_objects": None}),
        pytest.raises(ExtraMissingError, match=r"kant-sql\[web\]"),
    ):
        plots.timeline_figure(timeline())
    assert plots.timeline_spec(timeline())["data"] == []
