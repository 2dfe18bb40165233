"""What people come for, done as they do it: on each dialect, without knowing an address."""

from __future__ import annotations

from playwright.sync_api import Route, expect

from tests.browser.conftest import Visit
from tests.support.browsing import NARROW, Serving, Visitor

# Faster than a person: the names for what is typed have not been asked for when one is taken.
TYPE_AND_CHOOSE = """() => {
  const box = document.getElementById("condition");
  document.getElementById("condition-options").hidden = false;
  box.setRangeText("(ro", 0, box.value.length, "end");
  box.dispatchEvent(new Event("input"));
  for (const key of ["ArrowDown", "Enter"])
    box.dispatchEvent(new KeyboardEvent("keydown", { key, cancelable: true }));
}"""


def enter(visitor: Visitor, page: str) -> None:
    """Come to a page of the robot's knowledge base from the home page."""
    visitor.open("/")
    row, pages = (
        visitor.page.get_by_role("row"),
        visitor.page.get_by_role("navigation", name="Pages"),
    )
    for link in (row.get_by_role("link", name="courier"), pages.get_by_role("link", name=page)):
        # Until then, the page before is settled, and scripts of the next one hear no key.
        with visitor.page.expect_navigation():
            link.click()
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
    rows = answers.get_by_role("row")
    expect(rows).to_have_count(4)
    shown = [row.split() for row in rows.all_inner_texts()[1:]]
    assert shown == [["rb1", "t3"], ["rb2", "kitchen"], ["rb2", "t4"]]
    page.get_by_text("The SQL statement").click()
    expect(page.get_by_text("SELECT").first).to_be_visible()
    address = page.url
    page.get_by_role("radio", name="When did it hold").check()
    page.get_by_role("button", name="Ask").click()
    periods = page.get_by_role("region", name="Periods")
    expect(periods.get_by_role("row").filter(has_text="t4")).to_contain_text("seen by camera 4")
    page.go_back()
    expect(page).to_have_url(address)
    expect(answers).to_be_visible()


def test_a_late_answer_does_not_undo_a_choice(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open("/ask?kb=courier")
    page = visitor.page
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    page.route("**/api/names?*", hold)
    box = page.get_by_role("textbox", name="Condition, in PDDL")
    option = page.get_by_role("option", name="robot_at")

    def write(text: str) -> None:
        page.keyboard.insert_text(text)
        for _ in range(1_000):
            if held:
                return
            page.wait_for_timeout(20)

    def answer() -> None:
        with page.expect_request_finished():
            held.pop().continue_()
        page.evaluate("() => new Promise((drawn) => setTimeout(drawn, 50))")

    box.focus()
    write("(ro")
    answer()
    expect(option).to_be_visible()
    write("bo")
    box.press("ArrowDown")
    expect(option).to_have_attribute("aria-selected", "true")
    answer()
    box.press("Enter")
    expect(box).to_have_value("(robot_at")
    # Nor does what was typed before the choice, and is not asked yet.
    page.evaluate(TYPE_AND_CHOOSE)
    page.wait_for_timeout(500)
    # The choice of a clock has options of its own.
    expect(page.get_by_role("listbox").get_by_role("option")).to_have_count(0)
    assert held == []


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
    before = page.get_by_role("region", name="Only at revision 4")
    after = page.get_by_role("region", name="Only at revision 36")
    expect(before).to_contain_text("(waiting t1)")
    for fact in ("(served t1)", "(robot_at rb2 t4)", "(waiting t4)"):
        expect(after).to_contain_text(fact)
    # It went and came back between them.
    for region in (before, after):
        expect(region).not_to_contain_text("(robot_at rb1 dock)")
    visitor.settle()
    text = visitor.text()
    address = page.url
    after.get_by_role("link", name="(served t1)").first.click()
    expect(page.get_by_role("main")).to_contain_text("cup taken")
    page.go_back()
    expect(page).to_have_url(address)
    visitor.settle()
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
