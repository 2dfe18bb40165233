"""The timeline in a browser: the window is the address, and what is visible is asked for."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote_plus, urlsplit

import pytest
from sqlalchemy import make_url

import kant_sql
from tests.browser.addresses import address
from tests.browser.conftest import Visit
from tests.support.browsing import NARROW, WIDE, Serving, Visitor

DAY = address("/timeline")
NOON = address("/timeline", since="2026-03-02 14:00", until="2026-03-02 14:30")


def window(visitor: Visitor) -> list[str]:
    """What the figure shows, in the words of its axis."""
    found: list[str] = visitor.page.evaluate("document.getElementById('chart').layout.xaxis.range")
    return [each.replace("T", " ")[:19] for each in found]


def asked(visitor: Visitor) -> dict[str, Any]:
    """What the address asks for."""
    return {name: value for name, (value,) in parse_qs(urlsplit(visitor.page.url).query).items()}


def moved(visitor: Visitor, before: str) -> None:
    """Wait until the address is another one, and drawn."""
    visitor.page.wait_for_function("before => location.href !== before", arg=before)
    visitor.settle()


@pytest.mark.smoke
def test_keys_and_buttons_change_the_window_and_the_address(
    sqlite_served: Serving, visit: Visit
) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(NOON)
    assert window(visitor) == ["2026-03-02 14:00:00", "2026-03-02 14:30:00"]
    chart = visitor.page.locator("#chart")
    chart.focus()
    before = visitor.page.url
    visitor.page.keyboard.press("+")
    moved(visitor, before)
    assert asked(visitor)["since"] == "2026-03-02T14:07:30.000Z"
    assert window(visitor) == ["2026-03-02 14:07:30", "2026-03-02 14:22:30"]
    assert "14:07:30" in visitor.page.locator("#shown p").first.inner_text()
    before = visitor.page.url
    visitor.page.get_by_role("button", name="Later").click()
    moved(visitor, before)
    assert window(visitor) == ["2026-03-02 14:11:15", "2026-03-02 14:26:15"]
    # Back leads through the windows, and loading again stays.
    visitor.page.go_back()
    moved(visitor, "")
    visitor.page.wait_for_function(
        "() => document.getElementById('chart').layout.xaxis.range[0].includes('14:07:30')"
    )
    visitor.page.reload()
    visitor.settle()
    assert window(visitor) == ["2026-03-02 14:07:30", "2026-03-02 14:22:30"]
    before = visitor.page.url
    visitor.page.get_by_role("button", name="Everything").click()
    moved(visitor, before)
    assert asked(visitor) == {"kb": "courier"}


def test_a_window_may_be_of_revisions(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(address("/timeline", since=8, until=13))
    since, until = window(visitor)
    assert "2026-03-02 09:05:10" < since < "2026-03-02 09:05:20"
    assert "2026-03-02 09:09:00" < until < "2026-03-02 09:09:10"


def test_keys_pressed_in_a_row_ask_once(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(NOON)
    before, answers = visitor.page.url, len(visitor.answers)
    visitor.page.locator("#chart").focus()
    for _ in range(10):
        visitor.page.keyboard.press("+")
    moved(visitor, before)
    figures = [url for _, url in visitor.answers[answers:] if "/api/timeline/figure" in url]
    assert len(figures) <= 2
    since, until = window(visitor)
    assert since == "2026-03-02 14:14:59"
    assert until == "2026-03-02 14:15:00"


def test_a_window_is_drawn_with_the_mouse(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(NOON)
    box = visitor.page.locator("#chart .draglayer .nsewdrag").first.bounding_box()
    assert box is not None
    before = visitor.page.url
    middle = box["y"] + box["height"] / 2
    visitor.page.mouse.move(box["x"] + box["width"] * 0.25, middle)
    visitor.page.mouse.down()
    visitor.page.mouse.move(box["x"] + box["width"] * 0.75, middle, steps=5)
    visitor.page.mouse.up()
    moved(visitor, before)
    since, until = window(visitor)
    assert since.startswith("2026-03-02 14:07")
    assert until.startswith("2026-03-02 14:22")


def bar_of(visitor: Visitor, text: str) -> tuple[float, float]:
    """Where the first bar of a fact is."""
    place: list[float] = visitor.page.evaluate(
        """text => {
            const chart = document.getElementById("chart"), {xaxis, yaxis} = chart._fullLayout;
            const row = yaxis.ticktext.indexOf(text), box = chart.getBoundingClientRect();
            const trace = chart.data.find(each => each.y.includes(row));
            const n = trace.y.indexOf(row), begin = xaxis.d2p(trace.base[n]);
            const end = xaxis.d2p(xaxis.d2c(trace.base[n]) + trace.x[n]);
            const low = Math.max(begin, 0), high = Math.min(end, xaxis._length);
            return [box.left + xaxis._offset + (low + high) / 2,
                    box.top + yaxis._offset + yaxis.d2p(row)];
        }""",
        text,
    )
    return place[0], place[1]


@pytest.mark.parametrize("width", [NARROW, WIDE])
def test_a_bar_tells_who_and_why_and_leads_to_its_fact(
    served: Serving, visit: Visit, width: int
) -> None:
    visitor = visit(served.address, width=width)
    visitor.open(NOON)
    x, y = bar_of(visitor, "(robot_at rb1 t3)")
    visitor.page.mouse.move(x - 3, y)
    visitor.page.mouse.move(x, y)
    said = visitor.page.locator("#chart .hoverlayer").text_content() or ""
    assert "executive" in said
    assert "arrived" in said
    assert "2026-03-02 14:01:00" in said
    with visitor.page.expect_navigation():
        visitor.page.mouse.click(x, y)
    assert unquote_plus(visitor.page.url).endswith("/fact?kb=courier&text=(robot_at rb1 t3)")
    visitor.faults = [fault for fault in visitor.faults if "the server responded" not in fault]


def test_names_are_completed_and_lanes_are_chosen(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(DAY)
    field = visitor.page.get_by_label("Predicate or function")
    field.press_sequentially("rob")
    visitor.page.wait_for_function("() => document.querySelector('#predicates option')")
    options = visitor.page.locator("#predicates option")
    assert [option.get_attribute("value") for option in options.all()] == ["robot_at"]
    field.fill("robot_at")
    with visitor.page.expect_navigation():
        visitor.page.get_by_role("button", name="Show").click()
    visitor.settle()
    assert asked(visitor) == {"kb": "courier", "predicate": "robot_at"}
    labels = visitor.page.locator("#chart .ytick").all_text_contents()
    assert "(robot_at rb1 t3)" in labels
    assert not any("waiting" in label for label in labels)


def test_the_figure_follows_the_scheme_of_colours(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(DAY)
    colour = "document.getElementById('chart').layout.font.color"
    light = visitor.page.evaluate(colour)
    visitor.page.emulate_media(color_scheme="dark")
    visitor.page.wait_for_function(f"light => {colour} !== light", arg=light)
    visitor.settle()
    # On paper it is black, whatever the scheme.
    visitor.page.emulate_media(media="print", color_scheme="dark")
    visitor.page.wait_for_function(f"() => {colour} === '#000'")
    visitor.page.emulate_media(media="screen", color_scheme="dark")
    visitor.page.wait_for_function(f"() => {colour} !== '#000'")
    visitor.settle()


def test_a_server_that_does_not_answer_is_said(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(NOON)
    visitor.page.route("**/api/timeline/figure*", lambda route: route.abort())
    visitor.page.locator("#chart").focus()
    visitor.page.keyboard.press("-")
    visitor.page.wait_for_function("() => !document.getElementById('trouble').hidden")
    visitor.settle()
    visitor.page.unroute("**/api/timeline/figure*")
    visitor.page.keyboard.press("0")
    visitor.page.wait_for_function("() => document.getElementById('trouble').hidden")
    visitor.settle()
    visitor.faults = [fault for fault in visitor.faults if "net::ERR_FAILED" not in fault]


def test_a_window_without_an_end_follows_what_happens(
    sqlite_story: str, tmp_path: Path, visit: Visit
) -> None:
    own = shutil.copy(str(make_url(sqlite_story).database), tmp_path / "own.db")
    serving = Serving(f"sqlite:///{own}", tmp_path)
    try:
        visitor, other = visit(serving.address), visit(serving.address)
        visitor.open(DAY)
        other.open(NOON)
        with kant_sql.connect(f"sqlite:///{own}", knowledge_base="courier", actor="night") as kb:
            kb.propositions.save("(waiting t3)")
        visitor.page.wait_for_function(
            "() => JSON.stringify(document.getElementById('chart').layout).includes('(waiting t3)')"
        )
        visitor.page.wait_for_selector("#shown :text('(waiting t3)')")
        visitor.settle()
        assert asked(visitor) == {"kb": "courier"}
        assert window(other) == ["2026-03-02 14:00:00", "2026-03-02 14:30:00"]
    finally:
        serving.stop()
