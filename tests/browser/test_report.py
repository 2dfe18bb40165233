"""A report, opened from disk in a browser: without a server, a network, or even a script."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import expect

import kant_sql
from kant_sql.web.report import write_report
from tests.browser.conftest import Visit
from tests.support.browsing import LOOKS, NARROW, WIDE, WIDTHS, Scheme, Visitor
from tests.support.worlds.hostile import KNOWLEDGE_BASE, NAMES, record_hostile

Open = Callable[..., Visitor]


def reported(url: str, folder: Path) -> Path:
    with kant_sql.connect(url, knowledge_base="courier", read_only=True) as kb:
        return write_report(kb, folder / "day.html", objects=["rb1"])


@pytest.fixture(scope="session")
def report(sqlite_story: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return reported(sqlite_story, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="session", params=["sqlite", "postgresql"])
def each_report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the story, on each dialect in turn."""
    url = request.getfixturevalue(f"{request.param}_story")
    return reported(url, tmp_path_factory.mktemp("report"))


@pytest.fixture(scope="session")
def hostile_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a store whose every text would like to be a script."""
    folder = tmp_path_factory.mktemp("hostile")
    url = record_hostile(f"sqlite:///{folder / 'hostile.db'}")
    with kant_sql.connect(url, knowledge_base=KNOWLEDGE_BASE) as kb:
        return write_report(kb, folder / "day.html", objects=NAMES)


def opened(visit: Visit, path: Path, **options: object) -> Visitor:
    visitor = visit(path.as_uri(), **options)
    visitor.page.goto(path.as_uri())
    visitor.settle()
    return visitor


def test_it_opens_from_disk_with_its_drawing(each_report: Path, visit: Visit) -> None:
    visitor = opened(visit, each_report)
    assert visitor.page.title() == "Report of courier · kant_sql"
    assert visitor.page.locator("#timeline .pinned + svg").bounding_box()["height"] > 200  # type: ignore[index]
    visitor.page.get_by_role("link", name="Log", exact=True).click()
    expect(visitor.page).to_have_url(each_report.as_uri() + "#log")


@pytest.mark.parametrize(("width", "scheme"), LOOKS)
def test_it_is_for_everybody(report: Path, visit: Visit, width: int, scheme: Scheme) -> None:
    visitor = opened(visit, report, width=width, scheme=scheme)
    assert visitor.violations() == []
    assert visitor.overflow() == []


def test_it_is_read_without_scripts(report: Path, visit: Visit) -> None:
    # The browser's own tools for a page are scripts, too: only what is seen can be looked at.
    visitor = visit(report.as_uri(), java_script_enabled=False, width=NARROW)
    visitor.page.goto(report.as_uri())
    expect(visitor.page.locator("#periods table")).to_be_visible()
    expect(visitor.page.locator("#timeline .pinned + svg")).to_be_visible()
    expect(visitor.page.locator("td", has_text="blocked by a chair").first).to_be_visible()


def test_printed_it_has_the_drawing_and_the_table(report: Path, visit: Visit) -> None:
    visitor = opened(visit, report, width=WIDE, scheme="dark")
    visitor.page.emulate_media(media="print", color_scheme="dark")
    back = "getComputedStyle(document.body).backgroundColor"
    assert visitor.page.evaluate(back) == "rgb(255, 255, 255)"
    expect(visitor.page.locator("#periods table")).to_be_visible()
    expect(visitor.page.locator("#timeline .pinned + svg")).to_be_visible()
    assert visitor.page.pdf(format="A4").startswith(b"%PDF")


def test_it_is_used_by_keyboard(report: Path, visit: Visit) -> None:
    visitor = opened(visit, report)
    visitor.page.locator("#periods summary").focus()
    visitor.page.keyboard.press("Enter")
    expect(visitor.page.locator("#periods table")).to_be_hidden()
    visitor.page.keyboard.press("Enter")
    expect(visitor.page.locator("#periods table")).to_be_visible()
    visitor.page.keyboard.press("Tab")
    focused = visitor.page.evaluate("document.activeElement.getAttribute('aria-label')")
    assert focused == "What held when"


@pytest.mark.parametrize("width", WIDTHS)
def test_no_text_of_the_store_becomes_anything_else(
    hostile_report: Path, visit: Visit, width: int
) -> None:
    visitor = opened(visit, hostile_report, width=width)
    assert visitor.page.locator("img, iframe, object, embed").count() == 0
    assert visitor.page.evaluate("document.scripts.length") == 0
    assert visitor.overflow() == []
    assert visitor.page.evaluate("typeof hacked") == "undefined"
    assert "<script>hacked=1</script>" in visitor.text()
