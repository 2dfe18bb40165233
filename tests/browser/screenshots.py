"""Makes the pictures of the docs: pages of the robot's day.

python -m tests.browser.screenshots FOLDER
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.audit.story import record_store
from tests.browser.addresses import PLAN, address
from tests.support.browsing import ARGUMENTS, Serving, Visitor, chromium

# The largest that a picture may be: a page of the docs shows three.
LARGEST = 150_000
WIDTH, HEIGHT = 1040, 700
PICTURES = {
    "timeline": address(
        "/timeline", object="rb1", since="2026-03-02 08:00", until="2026-03-02 16:00"
    ),
    "state": address("/state", at="2026-03-02 14:03"),
    "plan": address("/plan", id=PLAN),
    "objects": address("/objects", at="2026-03-02 14:03"),
    "overview": address("/overview"),
}
FOLDER = Path(__file__).parents[2] / "docs" / "images"


def take(browser: Browser, served: str, folder: Path) -> None:
    """Take all pictures.

    Args:
        browser: where the pages are shown.
        served: the address of a server of the story.
        folder: where the pictures are written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    visitor = Visitor(browser, served, width=WIDTH, height=HEIGHT)
    for name, path in PICTURES.items():
        visitor.open(path)
        visitor.page.screenshot(path=folder / f"{name}.png", animations="disabled")
    visitor.close()
    assert visitor.faults == []


def main(folder: Path) -> None:
    """Record the day, serve it, and take the pictures."""
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        served = Serving(record_store(f"sqlite:///{scratch}/store.db"), Path(scratch))
        try:
            take(browser, served.address, folder)
        finally:
            served.stop()
            browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
