"""Verifying in the browser: started, followed, and compared with an anchor from a file."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import expect

from tests.browser.addresses import address
from tests.browser.conftest import Serve, Visit


def test_a_reader_verifies_and_keeps_an_anchor(
    sqlite_story: str, serve: Serve, visit: Visit, tmp_path: Path
) -> None:
    visitor = visit(serve(sqlite_story).address)
    page = visitor.page
    visitor.open(address("/verify"))
    page.get_by_role("button", name="Verify now").click()
    expect(page.get_by_text("Intact.")).to_be_visible()
    assert visitor.violations() == []
    with page.expect_download() as downloading:
        page.get_by_role("link", name="Download an anchor").click()
    anchor = tmp_path / "anchor.json"
    downloading.value.save_as(anchor)
    page.get_by_text("Compare with an anchor").click()
    page.get_by_label("A file").set_input_files(anchor)
    expect(page.get_by_label("Its text")).to_have_value(anchor.read_text())
    page.get_by_role("button", name="Verify now").click()
    expect(page.get_by_text("Compared with the anchor")).to_be_visible()
    visitor.open("/")
    expect(page.get_by_role("link", name="intact at 36")).to_be_visible()
