"""What people come for, done as they do it: on each dialect, without knowing an address."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.browser.conftest import Visit
from tests.support.browsing import NARROW, Serving, Visitor


def enter(visitor: Visitor, page: str) -> None:
    """Come to a page of the robot's knowledge base from the home page."""
    visitor.open("/")
    visitor.page.get_by_role("row").get_by_role("link", name="courier").click()
    visitor.page.get_by_role("navigation", name="Pages").get_by_role("link", name=page).click()
    visitor.settle()


def test_a_condition_is_asked_in_a_state_and_over_time(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    enter(visitor, "Ask")
    page = visitor.page
    box = page.get_by_role("textbox", name="Condition, in PDDL")
    box.press_sequentially("(robo")
    option = page.get_by_role("option", name="robot_at")
    expect(option).to_be_visible()
    assert visitor.violations() == []
    box.press("ArrowDown")
    box.press("Enter")
    box.press_sequentially(" ?robot ?place)")
    expect(box).to_have_value("(robot_at ?robot ?place)")
    page.get_by_role("textbox", name="at a revision or time", exact=True).fill("2026-03-02 14:03")
    page.get_by_role("button", name="Ask").click()
    answers = page.get_by_role("region", name="Answers")
    rows = answers.get_by_role("row").all_inner_texts()
    assert [row.split() for row in rows[1:]] == [["rb1", "t3"], ["rb2", "kitchen"], ["rb2", "t4"]]
    page.get_by_text("The SQL statement").click()
    expect(page.get_by_text("SELECT").first).to_be_visible()
    address = page.url
    page.get_by_role("radio", name="When did it hold").check()
    page.get_by_role("button", name="Ask").click()
    periods = page.get_by_role("region", name="Periods")
    expect(periods.get_by_role("row").filter(has_text="t4")).to_contain_text("seen by camera 4")
    page.go_back()
    assert page.url == address
    expect(answers).to_be_visible()


def test_a_wrong_condition_is_explained_where_it_is_written(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address, width=NARROW)
    enter(visitor, "Ask")
    box = visitor.page.get_by_role("textbox", name="Condition, in PDDL")
    box.fill("(robot_at rb1")
    box.press("Control+Enter")
    expect(visitor.page.get_by_role("alert")).to_contain_text("1:")
    expect(box).to_have_value("(robot_at rb1")
    assert visitor.violations() == []
    assert visitor.overflow() == []
    visitor.forgive(400)
