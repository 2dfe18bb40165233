"""Checks notebook HTML: only tables and text, however hostile the stored data is."""

from __future__ import annotations

import re
from html.parser import HTMLParser

UNSEEN = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2066-\u2069]"
)
_HARMLESS = {"div", "table", "thead", "tbody", "tr", "th", "td", "p", "strong", "bdi", "br", "pre"}
_DRAWN = {"svg", "rect", "text", "line", "g", "path", "title", "desc"}
_GEOMETRY = re.compile(
    r"x[12]?|y[12]?|d[xy]?|width|height|viewbox|preserveaspectratio|transform|vector-effect|"
    r"(fill|stroke|font|text)(-[a-z]+)?|role|aria-label"
)


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, list[tuple[str, str | None]]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, attrs))


def check_harmless(made: str, *, most: int = 300_000) -> None:
    """Check that HTML for notebooks has only our own tags, nothing hidden, and is bounded."""
    parser = _Tags()
    parser.feed(made)
    parser.close()
    for tag, attributes in parser.found:
        assert tag in _HARMLESS | _DRAWN, tag
        names = {name for name, _ in attributes}
        if tag in _DRAWN:
            assert all(_GEOMETRY.fullmatch(name) for name in names), attributes
        else:
            assert names <= {"style"}, attributes
    assert UNSEEN.search(made) is None
    assert len(made) <= most
