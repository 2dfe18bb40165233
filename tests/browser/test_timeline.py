"""The timeline in a browser: the window is the address, with and without a script."""

from __future__ import annotations

from typing import Any
from urllib.parse import parse_qs, unquote_plus, urlsplit

import pytest
from playwright.sync_api import expect

import kant_sql
from tests.browser.addresses import address
from tests.browser.conftest import Serve, Visit
from tests.support.browsing import NARROW, WIDE, Serving, Visitor

DAY = address("/timeline")
NOON = address("/timeline", since="2026-03-02 14:00", until="2026-03-02 14:30")


def window(visitor: Visitor) -> str:
    """What the axis says is shown."""
    return visitor.page.locator(".pinned svg text").first.text_content() or ""


def asked(visitor: Visitor) -> dict[str, Any]:
    """What the address asks for."""
    return {name: value for name, (value,) in parse_qs(urlsplit(visitor.page.url).query).items()}


@pytest.mark.parametrize("has_script", [True, False])
def test_links_and_keys_change_the_window_and_the_address(
    sqlite_served: Serving, visit: Visit, has_script: bool
) -> None:
    visitor = visit(sqlite_served.address, java_script_enabled=has_script)
    visitor.page.goto(sqlite_served.address + NOON)
    assert window(visitor) == "2026-03-02 14:00:00 to 14:30:00 UTC"
    with visitor.page.expect_navigation():
        if has_script:
            visitor.page.keyboard.press("+")
        else:
            visitor.page.get_by_role("link", name="Zoom in").click()
    assert asked(visitor)["since"] == "2026-03-02T14:07:30.000000Z"
    assert window(visitor) == "2026-03-02 14:07:30 to 14:22:30 UTC"
    with visitor.page.expect_navigation():
        visitor.page.get_by_role("link", name="Later →").click()
    assert window(visitor) == "2026-03-02 14:15:00 to 14:30:00 UTC"
    visitor.page.go_back()
    assert window(visitor) == "2026-03-02 14:07:30 to 14:22:30 UTC"
    with visitor.page.expect_navigation():
        visitor.page.get_by_role("link", name="Everything").click()
    assert asked(visitor) == {"kb": "courier"}
    with visitor.page.expect_navigation():
        visitor.page.locator('a[aria-label^="Zoom to 2026-03-02 12:00:00"]').click()
    assert window(visitor) == "2026-03-02 12:00:00 to 18:00:00 UTC"


@pytest.mark.parametrize("width", [NARROW, WIDE])
def test_the_axis_stays_in_view_and_a_lane_leads_to_its_fact(
    served: Serving, visit: Visit, width: int
) -> None:
    visitor = visit(served.address, width=width, height=500)
    visitor.open(NOON)
    visitor.page.evaluate("window.scrollTo(0, 400)")
    visitor.page.wait_for_function("() => scrollY > 300")
    box = visitor.page.locator(".pinned svg").bounding_box()
    assert box is not None
    assert 0 <= box["y"] < 200
    bar = visitor.page.locator('svg a[href*="rb1+t3"]').first
    said = bar.locator("title").first.text_content() or ""
    assert said.startswith("(robot_at rb1 t3)\nfrom 2026-03-02 14:01:00")
    assert "by executive: arrived" in said
    with visitor.page.expect_navigation():
        bar.click()
    assert unquote_plus(visitor.page.url).endswith("/fact?kb=courier&text=(robot_at rb1 t3)")


@pytest.mark.smoke
def test_names_are_completed_and_lanes_are_chosen(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(DAY)
    field = visitor.page.get_by_label("Predicate or function")
    field.press_sequentially("rob")
    options = visitor.page.locator("#predicates option")
    expect(options).to_have_count(1)
    expect(options).to_have_attribute("value", "robot_at")
    field.fill("robot_at")
    with visitor.page.expect_navigation():
        visitor.page.get_by_role("button", name="Show").click()
    assert asked(visitor) == {"clock": "committed", "kb": "courier", "predicate": "robot_at"}
    labels = visitor.page.locator(".pinned + svg text").all_text_contents()
    assert "robot_at rb1: dock, t1, t3, kitchen" in labels
    assert not any("waiting" in label for label in labels)


def test_the_drawing_has_the_colours_of_its_page(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(DAY)
    colour = "getComputedStyle(document.querySelector('.pinned svg text')).fill"
    found = []
    for media, scheme in (("screen", "light"), ("screen", "dark"), ("print", "dark")):
        visitor.page.emulate_media(media=media, color_scheme=scheme)  # type: ignore[arg-type]
        found.append(visitor.page.evaluate(colour))
    assert found == ["rgb(27, 33, 38)", "rgb(230, 234, 237)", "rgb(0, 0, 0)"]


def test_a_window_without_an_end_follows_what_happens(
    own_story: str, serve: Serve, visit: Visit
) -> None:
    serving = serve(own_story)
    visitor, other = visit(serving.address), visit(serving.address)
    visitor.open(DAY)
    other.open(NOON)
    with kant_sql.connect(own_story, knowledge_base="courier", actor="night") as kb:
        kb.propositions.save("(waiting t3)")
    visitor.page.wait_for_selector(".pinned + svg a[href*='waiting+t3']")
    visitor.page.wait_for_selector("#shown table :text('(waiting t3)')")
    assert asked(visitor) == {"kb": "courier"}
    assert window(other) == "2026-03-02 14:00:00 to 14:30:00 UTC"
