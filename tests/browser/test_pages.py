"""Each page in a browser: it opens, for everybody, at each width, in each scheme, on paper."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.browser.addresses import ADDRESSES, ALL, FIRST, address
from tests.browser.conftest import Visit
from tests.support.browsing import LOOKS, NARROW, PAPER, Serving
from tests.support.crawling import PATHS

# Words of tables that are on two lines; hashes may be.
BROKEN_WORDS = """() => {
  const found = [], range = document.createRange();
  for (const cell of document.querySelectorAll("td, th")) {
    const texts = document.createTreeWalker(cell, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
      const node = texts.currentNode;
      for (const word of node.data.matchAll(/[A-Za-z0-9_]+/g)) {
        range.setStart(node, word.index);
        range.setEnd(node, word.index + word[0].length);
        const lines = new Set([...range.getClientRects()].map((one) => one.top));
        if (lines.size > 1) found.push(word[0]);
      }
    }
  }
  return found;
}"""


def test_every_page_is_visited() -> None:
    assert set(PATHS) == set(ADDRESSES), "say in addresses.py at which address a page is tested"


@pytest.mark.parametrize("path", FIRST)
def test_a_page_opens_and_is_the_same_when_loaded_again_and_gone_back_to(
    served: Serving, visit: Visit, path: str
) -> None:
    visitor = visit(served.address)
    visitor.open(path)
    assert visitor.page.title().endswith("kant_sql")
    headings = visitor.page.locator("h1")
    assert headings.count() == 1
    first = visitor.text()
    assert first.startswith(headings.inner_text())
    visitor.page.reload()
    visitor.settle()
    assert visitor.text() == first
    visitor.open(address("/revision", number=1))
    visitor.page.go_back()
    visitor.settle()
    assert visitor.page.url.removeprefix(served.address) == path
    assert visitor.text() == first
    assert {status for status, _ in visitor.answers} <= {200, 304}


@pytest.mark.parametrize("path", ALL)
def test_a_page_is_for_everybody(sqlite_served: Serving, visit: Visit, path: str) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(path)
    for width, scheme in LOOKS:
        visitor.look(width, scheme)
        assert (width, scheme, visitor.violations()) == (width, scheme, [])
        assert (width, visitor.overflow()) == (width, [])


@pytest.mark.parametrize("path", ALL)
def test_a_page_is_used_by_keyboard(sqlite_served: Serving, visit: Visit, path: str) -> None:
    visitor = visit(sqlite_served.address, width=NARROW)
    visitor.open(path)
    visitor.page.keyboard.press("Tab")
    assert visitor.page.evaluate("document.activeElement.className") == "skip"
    visitor.page.keyboard.press("Enter")
    expect(visitor.page.locator("#content")).to_be_focused()
    visitor.open(path)
    visited, expected = visitor.tab_through(400)
    assert visited == expected


@pytest.mark.parametrize("path", FIRST)
def test_a_page_can_be_printed(sqlite_served: Serving, visit: Visit, path: str) -> None:
    visitor = visit(sqlite_served.address, width=PAPER, scheme="dark")
    visitor.open(path)
    visitor.page.emulate_media(media="print")
    assert visitor.overflow() == []
    colour = "getComputedStyle(document.body).backgroundColor"
    assert visitor.page.evaluate(colour) == "rgb(255, 255, 255)"
    assert visitor.page.pdf(format="A4").startswith(b"%PDF")


def test_times_are_local_too_and_tables_sort(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address)
    visitor.open(address("/state", kind="fact", at=9))
    near = visitor.page.locator("td time").first.get_attribute("data-near") or ""
    assert "local" in near
    assert near.endswith("ago")
    table = visitor.page.locator("table.elements")

    def column(number: int) -> list[str]:
        return table.locator(f"tbody td:nth-child({number})").all_inner_texts()

    head = table.get_by_role("columnheader", name="Element")
    head.click()
    expect(head).to_have_attribute("aria-sort", "ascending")
    assert column(2) == sorted(column(2), key=str.lower)
    visitor.page.keyboard.press("Tab")
    head.press("Enter")
    expect(head).to_have_attribute("aria-sort", "descending")
    assert column(2) == sorted(column(2), key=str.lower, reverse=True)


def test_filters_fold_away_on_a_narrow_page_only(sqlite_served: Serving, visit: Visit) -> None:
    for path in ("/log", "/state", "/timeline"):
        wide, narrow = visit(sqlite_served.address), visit(sqlite_served.address, width=NARROW)
        for visitor in (wide, narrow):
            visitor.open(address(path))
        field = "form.screen input[name=since], form.screen input[name=object]"
        expect(wide.page.locator(field).first).to_be_visible()
        expect(narrow.page.locator(field).first).to_be_hidden()
        narrow.page.get_by_label("Filters").check()
        expect(narrow.page.locator(field).first).to_be_visible()


def test_no_word_is_broken_in_the_middle(sqlite_served: Serving, visit: Visit) -> None:
    visitor = visit(sqlite_served.address, width=1280)
    for path in ALL:
        visitor.open(path)
        broken = visitor.page.evaluate(BROKEN_WORDS)
        assert (path, broken) == (path, [])
