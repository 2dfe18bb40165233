"""The pictures of the docs are of the pages as they are made now."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from tests.browser.screenshots import FOLDER, HEIGHT, LARGEST, PICTURES, WIDTH, take
from tests.support.browsing import Serving


def size(path: Path) -> tuple[int, int]:
    """Read width and height of a PNG file."""
    beginning = path.read_bytes()[:24]
    assert beginning.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", beginning[16:])
    return width, height


def test_the_pictures_can_be_taken(
    browser: Browser, sqlite_served: Serving, tmp_path: Path
) -> None:
    take(browser, sqlite_served.address, tmp_path)
    for name in PICTURES:
        assert size(tmp_path / f"{name}.png") == (WIDTH, HEIGHT)
        assert (tmp_path / f"{name}.png").stat().st_size < LARGEST


@pytest.mark.parametrize("name", PICTURES)
def test_the_docs_have_them(name: str) -> None:
    picture = FOLDER / f"{name}.png"
    assert size(picture) == (WIDTH, HEIGHT)
    assert picture.stat().st_size < LARGEST
    assert f"](images/{name}.png)" in (FOLDER.parent / "web.md").read_text(encoding="utf-8")
