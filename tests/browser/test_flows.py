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


def test_who_moved_the_robot_at_14_03_is_found(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    enter(visitor, "State")
    page = visitor.page
    page.get_by_label("Time or revision").fill("2026-03-02 14:03")
    page.get_by_role("textbox", name="Object", exact=True).fill("rb1")
    page.get_by_role("button", name="Show").click()
    row = page.get_by_role("row").filter(has_text="(robot_at rb1 t3)")
    for text in ("2026-03-02 14:01:00", "executive", "arrived"):
        expect(row).to_contain_text(text)
    # All that is known of it: who ended it, and the revision with everything that came with it.
    row.get_by_role("link", name="(robot_at rb1 t3)").click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("(robot_at rb1 t3)")
    expect(page.get_by_role("main")).to_contain_text("empty")
    page.get_by_role("main").get_by_role("link", name="30", exact=True).first.click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Revision 30")
    expect(page.get_by_role("main")).to_contain_text("executive")
    page.get_by_role("link", name="← 29").click()
    expect(page.get_by_role("main")).to_contain_text("seen by camera 4")


def test_two_states_are_compared(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address)
    enter(visitor, "State")
    page = visitor.page
    page.get_by_label("Time or revision").fill("2026-03-02 09:01")
    page.get_by_role("button", name="Show").click()
    page.get_by_role("link", name="Difference to now").click()
    visitor.settle()
    before = page.get_by_role("region", name="Only at revision 4")
    after = page.get_by_role("region", name="Only at revision 36")
    expect(before).to_contain_text("(waiting t1)")
    for fact in ("(served t1)", "(robot_at rb2 t4)", "(waiting t4)"):
        expect(after).to_contain_text(fact)
    # It went and came back between them.
    for region in (before, after):
        expect(region).not_to_contain_text("(robot_at rb1 dock)")
    text = visitor.text()
    address = page.url
    after.get_by_role("link", name="(served t1)").first.click()
    expect(page.get_by_role("main")).to_contain_text("cup taken")
    page.go_back()
    assert page.url == address
    assert visitor.text() == text


def test_a_robot_is_found_by_its_name(served: Serving, visit: Visit) -> None:
    visitor = visit(served.address, width=NARROW)
    enter(visitor, "Log")
    page = visitor.page
    page.get_by_role("searchbox").fill("rb2")
    page.get_by_role("button", name="Find").click()
    page.get_by_role("link", name="rb2", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("rb2")
    expect(page.get_by_role("main")).to_contain_text("seen by camera 4")
