"""Going through states by the slider, and finding who put a fact there."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.browser.addresses import address
from tests.browser.conftest import Visit
from tests.support.browsing import NARROW, Serving


def test_the_slider_opens_states_by_keyboard(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    visitor.open(address("/state", at=9, object="rb1"))
    slider = visitor.page.locator("#slider")
    slider.focus()
    for _ in range(3):
        visitor.page.keyboard.press("ArrowRight")
    expect(visitor.page.locator("output")).to_have_text("12")
    visitor.page.wait_for_url("**at=12**")
    visitor.settle()
    expect(visitor.page.locator("h1")).to_have_text("State at revision 12")
    # What was asked for stays, and so does the focus.
    assert "object=rb1" in visitor.page.url
    expect(visitor.page.locator("#slider")).to_be_focused()
    expect(visitor.page.locator("tr.went")).to_contain_text("(robot_at rb1 t1)")
    visitor.page.go_back()
    expect(visitor.page.locator("h1")).to_have_text("State at revision 9")


def test_a_state_is_chosen_without_scripts(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address, java_script_enabled=False, width=NARROW)
    visitor.page.goto(served.address + address("/state"))
    visitor.page.get_by_label("Filters").check()
    visitor.page.get_by_label("Time or revision").fill("2026-03-02 14:03")
    visitor.page.get_by_label("Predicate or function").fill("robot_at")
    visitor.page.get_by_role("button", name="Show").click()
    expect(visitor.page.locator("h1")).to_have_text("State at revision 30")
    expect(visitor.page.locator("tr.came")).to_contain_text("(robot_at rb1 t3)")
    visitor.page.get_by_role("link", name="← 29").click()
    expect(visitor.page.locator("h1")).to_have_text("State at revision 29")


def test_who_put_a_fact_there_is_found_from_any_page(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    visitor.open(address("/plans"))
    visitor.page.get_by_label("Find an object").fill("rb2 t4")
    visitor.page.keyboard.press("Enter")
    visitor.page.get_by_role("link", name="(robot_at rb2 t4)").click()
    lead = visitor.page.locator(".lead")
    for said in ("Fact holds", "perception", "2026-03-02 14:00:00", "seen by camera 4"):
        expect(lead).to_contain_text(said)


def test_two_states_are_compared_and_swapped(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    visitor.open(address("/difference", a=9, b=30))
    sides = visitor.page.locator(".sides > section")
    expect(sides.nth(0)).to_contain_text("(waiting t1)")
    expect(sides.nth(1)).to_contain_text("(robot_at rb1 t3)")
    visitor.page.get_by_role("link", name="Swap").click()
    expect(sides.nth(0)).to_contain_text("(robot_at rb1 t3)")
    visitor.page.get_by_role("link", name="State at 9").click()
    expect(visitor.page.locator("h1")).to_have_text("State at revision 9")
