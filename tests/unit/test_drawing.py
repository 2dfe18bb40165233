"""The drawing of timelines: what is drawn where, in which colour, and with which words."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from kant_sql import Bar, Density, Lane, PlanBar, StepBar, Timeline
from kant_sql.history.drawing import _COLOURS, _NOBODY, _OUTCOMES, draw
from tests.support.notebooks import check_harmless

NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)
HOUR = timedelta(hours=1)
SVG = "{http://www.w3.org/2000/svg}"
# Ten hours are this share of the width.
WHOLE = 100 / 1.02


def bar(since: int, until: int | None, actor: str | None = "nav", **more: Any) -> Bar:
    """A version from one hour after noon until another."""
    ended = None if until is None else NOON + until * HOUR
    by = {} if until is None else {"ended_by": actor}
    return Bar(since, until, NOON + since * HOUR, ended, actor, "moved", **by | more)


def timeline(*lanes: Lane, **more: Any) -> Timeline:
    """Ten hours after noon, in ten slices."""
    return Timeline("tiago", NOON, NOON + 10 * HOUR, 0, 10, 10, lanes, **{"folded": 0} | more)


def drawn(made: Timeline) -> ET.Element:
    """The document, which XML can read."""
    return ET.fromstring(made.svg())


def texts(made: Timeline) -> list[str]:
    return [each.text or "" for each in drawn(made).iter(f"{SVG}text")]


def titled(made: Timeline, text: str) -> list[ET.Element]:
    """The elements whose title has a text."""
    return [
        each
        for each in drawn(made).iter()
        for title in each.findall(f"{SVG}title")
        if text in (title.text or "") and each.get("height") != "100%"
    ]


def place(element: ET.Element) -> tuple[float, float]:
    return tuple(float(element.attrib[name].rstrip("%")) for name in ("x", "width"))  # type: ignore[return-value]


def test_a_bar_is_where_a_fact_held_and_says_who() -> None:
    lane = Lane("fact", "(at rb1 wp1)", (bar(1, 3, ended_by="arm"), bar(5, None, "arm")))
    made = timeline(lane)
    (first,) = titled(made, "until 2026-03-02 15:00:00 in revision 3 by arm")
    (second,) = titled(made, "holds")
    assert place(first) == pytest.approx((WHOLE / 10, WHOLE / 5), abs=0.01)
    # What holds goes on to the edge.
    assert sum(place(second)) == pytest.approx(100, abs=0.01)
    title = first.findtext(f"{SVG}title") or ""
    assert title.startswith("(at rb1 wp1)\nfrom 2026-03-02 13:00:00 in revision 1 by nav: moved")
    # Who retracted it stands at its end, and in the legend.
    assert "arm" in [each.text for each in first.iter(f"{SVG}text")]
    assert {"nav +1 \u22120", "arm +1 \u22121"} <= {*texts(made)}
    (end,) = (each for each in drawn(made).iter() if each.get("width") == "4")
    (rect,) = second.iter(f"{SVG}rect") if second.tag == f"{SVG}svg" else [second]
    assert end.get("fill") == rect.get("fill")


def test_facts_that_exclude_each_other_share_a_lane() -> None:
    def shown(*spans: tuple[str, int, int | None]) -> list[str]:
        lanes = (Lane("fact", f"(at rb1 {to})", (bar(a, b),)) for to, a, b in spans)
        return texts(timeline(*lanes))

    both = shown(("hall", 1, 3), ("ward", 3, 6), ("lab", 7, None))
    assert "at rb1: hall, ward, lab" in both
    assert {"hall", "ward", "lab"} <= {*both}
    apart = shown(("hall", 1, 3), ("ward", 2, 6))
    assert {"(at rb1 hall)", "(at rb1 ward)"} <= {*apart}
    assert {"(at rb1 hall)", "(at rb1 ward)"} <= {*shown(("hall", 1, None), ("ward", 2, 6))}
    one = Lane("fact", "(waiting t1)", (bar(1, 2),)), Lane("fact", "(waiting t2)", (bar(3, 4),))
    assert {"(waiting t1)", "(waiting t2)"} <= {*texts(timeline(*one))}


def test_facts_that_come_and_go_together_share_a_lane_unless_all_are_asked_for() -> None:
    lanes = [Lane("fact", f"(connected a{n} b)", (bar(2, None),)) for n in range(40)]
    assert "(connected ...) 40 facts" in texts(timeline(*lanes))
    assert len(titled(timeline(*lanes), "connected")) == 1
    assert "(connected a7 b)" in texts(timeline(*lanes, folded=None))
    few = texts(timeline(*lanes[:3]))
    assert "(connected a2 b)" in few
    other = Lane("fact", "(connected c b)", (bar(5, None),))
    assert "(connected c b)" in texts(timeline(*lanes, other))


def test_what_is_left_out_is_said() -> None:
    said = texts(timeline(folded=1_234, has_more_folded=True, next="fact:1:2"))
    assert "at least 1,234 more never changed in this time." in said
    assert "More lanes follow." in said
    assert "Nothing of this held in this time." in said
    assert not any("changed" in each for each in texts(timeline(folded=None)))


def test_facts_goals_values_and_plans_are_apart() -> None:
    steps = [
        StepBar(n, f"(s{n})", "succeeded", 1, 2, NOON + begin * HOUR, NOON + end * HOUR)
        for n, (begin, end) in enumerate([(1, 4), (2, 3), (3, 5), (4, 6)])
    ]
    steps[1] = StepBar(1, "(s1)", "failed", 2, 3, NOON + 2 * HOUR, NOON + 3 * HOUR)
    steps.append(StepBar(4, "(never)", None))
    plan = PlanBar(7, 1, NOON + HOUR, "planner", None, "aries", tuple(steps))
    made = timeline(
        Lane("fact", "(at)", (bar(1, 2),)),
        Lane("goal", "(at)", (bar(1, 2),)),
        Lane("value", "(loc)", (bar(1, 2, value="wp1"),)),
        Lane("value", "(fuel)", (bar(1, 2, value="5", number=5.0),)),
        plans=(plan,),
    )
    said = texts(made)
    assert [one for one in said if one in ("Facts", "Goals", "Values", "Plans")] == [
        *("Facts", "Goals", "Values", "Plans")
    ]
    assert "(fuel) = 5" in said
    assert "wp1" in said
    assert "plan 7 by aries: 5 steps, 1 not started" in said
    rows = [float(titled(made, f"(s{n})")[0].attrib["y"]) for n in range(4)]
    assert rows[0] == rows[3] < rows[1] == rows[2]
    (failed,) = titled(made, "(s1) failed")
    assert "\u2717 (s1)" in [each.text for each in failed.iter(f"{SVG}text")]
    assert titled(made, "recorded 2026-03-02 13:00:00 in revision 1 by planner")


def test_what_is_too_short_is_grey_and_counted() -> None:
    begin = NOON + 2 * HOUR
    densities = (
        Density(begin, begin + 3 * HOUR, 12, False),
        Density(begin + 6 * HOUR, NOON, 7, True),
    )
    made = timeline(Lane("fact", "(at)", (), densities))
    (cell,) = titled(made, "12 changes too short")
    assert place(cell) == pytest.approx((WHOLE / 5, WHOLE * 0.3), abs=0.01)
    assert titled(made, "at least 7 changes")


def test_values_are_steps_with_gaps() -> None:
    numbers = (bar(1, 2, number=5.0), bar(2, 4, "arm", number=3.0), bar(6, None, number=9.0))
    made = timeline(Lane("value", "(fuel)", numbers))
    assert "(fuel) = 3 to 9" in texts(made)
    (path,) = drawn(made).iter(f"{SVG}path")
    commands = path.attrib["d"]
    # The first and the second are joined; before the third there is none.
    assert commands.count("M") == 2
    assert commands.endswith("H1000.0")
    dense = Density(NOON, NOON + HOUR, 50, False, 1.0, 8.0, 4.0)
    made = timeline(Lane("value", "(fuel)", (), (dense,)))
    assert "(fuel) = 1 to 8" in texts(made)
    (path,) = drawn(made).iter(f"{SVG}path")
    assert path.attrib["d"].endswith("Z")


def test_values_are_drawn_with_what_else_was_given() -> None:
    lane = Lane("value", "(battery rb1)", (bar(1, 2, number=9.0, source={"camera": 7}),))
    assert titled(timeline(lane), '"camera": 7')


def luminance(colour: str) -> float:
    parts = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [
        each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in parts
    ]
    return sum(weight * each for weight, each in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


@pytest.mark.parametrize("colour", [*_COLOURS, _NOBODY, *(each[1] for each in _OUTCOMES.values())])
def test_colours_are_read_on_both_pages_and_with_white_text(colour: str) -> None:
    def contrast(other: str) -> float:
        low, high = sorted((luminance(colour), luminance(other)))
        return (high + 0.05) / (low + 0.05)

    assert contrast("#ffffff") >= 4.5
    assert contrast("#14181c") >= 3


def test_actors_have_colours_of_their_own_as_long_as_there_are_any() -> None:
    lanes = [Lane("fact", f"(p o{n})", (bar(1, 2, f"actor{n}"),)) for n in range(6)]
    shapes = drawn(timeline(*lanes, folded=None)).iter(f"{SVG}rect")
    assert len({rect.get("fill") for rect in shapes}) == 6 + 1
    many = [Lane("fact", f"(p o{n})", (bar(1, 2, f"actor{n}"),)) for n in range(30)]
    assert "and 22 more who wrote less" in texts(timeline(*many))


HOSTILE = "(at <b>x</b>\u202e&amp;\x00\uffff\ud800]]> " + 300 * "y" + ")"


def test_texts_are_data() -> None:
    name = "<script>alert(1)</script><a href='javascript:1' onclick=\"1\">nav</a>"
    lanes = (
        Lane("fact", HOSTILE, (bar(1, 9, name, source={name: name}),)),
        Lane("value", HOSTILE, (bar(1, 9, name, value=HOSTILE),)),
    )
    step = StepBar(0, HOSTILE, "failed", 1, 2, NOON, NOON + 9 * HOUR, name, name)
    plans = (PlanBar(1, 1, NOON, name, name, name, (step,), name),)
    made = Timeline(f"tia{name}go", NOON, NOON + 10 * HOUR, 0, 9, 9, lanes, plans=plans)
    tags = {element.tag.removeprefix(SVG) for element in drawn(made).iter()}
    assert tags <= {"svg", "style", "title", "desc", "rect", "text", "line", "g"}
    for element in drawn(made).iter():
        assert not any(key.startswith("on") or key == "href" for key in element.attrib)
    check_harmless(made._repr_html_())
    assert "(at <b>x</b>\\u202e&amp;\\u0000" in "".join(texts(made))
    assert "\u202e" not in made.svg()
    linked = draw(made, lambda path, **query: f"{path}?\"'><b>&c=")
    ET.fromstring(f"<svg>{linked.axis}{linked.body}</svg>")


def test_addresses_lead_to_facts_plans_and_windows() -> None:
    step = StepBar(0, "(go)", "succeeded", 1, 2, NOON, NOON + HOUR)
    plans = (PlanBar(3, 1, NOON, None, None, None, (step,)),)
    lanes = [
        *(Lane("fact", f"(at rb1 wp{n})", (bar(n, n + 1),)) for n in range(3)),
        *(Lane("fact", f"(on t{n})", (bar(2, None),)) for n in range(5)),
        Lane("fact", "(open)", (bar(1, 2),)),
    ]
    asked: list[tuple[str, dict[str, object]]] = []

    def link(path: str, /, **query: object) -> str:
        asked.append((path, query))
        return path

    draw(timeline(*lanes, plans=plans, folded=4), link)
    assert ("/fact", {"text": "(open)"}) in asked
    assert ("/fact", {"text": "(at rb1 wp1)"}) in asked
    assert ("/plan", {"id": 3}) in asked
    assert ("/timeline", {"predicate": "at", "object": "rb1"}) in asked
    assert ("/timeline", {"predicate": "on", "unchanged": True}) in asked
    assert ("/timeline", {"unchanged": True}) in asked
    windows = [query for path, query in asked if "since" in query]
    assert windows[0]["since"] == NOON
    assert windows[-1]["until"] == NOON + 10 * HOUR
    assert all(a["until"] == b["since"] for a, b in itertools.pairwise(windows))


@pytest.mark.parametrize(
    ("length", "labels"),
    [
        (timedelta(microseconds=3_000), ["00.001 s", "00.002 s"]),
        (timedelta(seconds=20), ["12:00:05", "12:00:10", "12:00:15"]),
        (5 * HOUR, ["13:00", "14:00", "15:00", "16:00"]),
        (timedelta(days=2), ["3 Mar", "12:00", "4 Mar"]),
        (timedelta(days=400), ["2026-06-04", "2026-09-24", "2027-01-14"]),
    ],
)
def test_the_axis_has_round_times(length: timedelta, labels: list[str]) -> None:
    said = texts(Timeline("tiago", NOON, NOON + length, 0, 1, 1))
    assert [each for each in said[1:] if each in labels] == labels


@pytest.mark.parametrize("moment", [datetime.min, datetime.max, datetime(2026, 1, 1)])
def test_an_instant_and_the_ends_of_time_can_be_drawn(moment: datetime) -> None:
    moment = moment.replace(tzinfo=UTC)
    drawn(Timeline("tiago", moment, moment, 0, 1, 1, (Lane("fact", "(at)", (bar(1, None),)),)))
    drawn(Timeline("tiago", moment, moment, 0, 0, 1))
    everything = Timeline(
        "tiago", datetime.min.replace(tzinfo=UTC), datetime.max.replace(tzinfo=UTC), 0, 1, 1
    )
    assert len(texts(everything)) > 3


def test_a_thousand_lanes_are_drawn_and_bounded() -> None:
    lanes = [
        Lane("fact", f"(p{n} a b)", tuple(bar(k, k + 1) for k in range(4))) for n in range(1_000)
    ]
    made = timeline(*lanes)
    assert len(made.svg()) < 1_200_000
    assert "(p999 a b)" in texts(made)


def test_acts_without_a_plan_are_no_plan() -> None:
    step = StepBar(0, "(go)", "succeeded", 1, 2, NOON, NOON + HOUR)
    plans = (PlanBar(3, 1, NOON, None, None, None, (step,)),)
    acts = (PlanBar(None, None, None, None, None, None, (step,)),)
    lane = Lane("fact", "(open)", (bar(1, 2),))
    assert "0 lanes and 0 plans:" in timeline(plans=acts).svg()
    assert "1 lane and 1 plan:" in timeline(lane, plans=plans + acts).svg()
