"""What the README and the docs name in the tree is there."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path

import pytest

from tests.docs.test_docs import DOCUMENTS, ROOT

FOLDERS = ("kant_sql", "migrations", "tests", "docs", "examples")
PLACES = [
    *(f"/{path.name}" for path in ROOT.iterdir()),
    *(f"/{path.relative_to(ROOT)}" for folder in FOLDERS for path in (ROOT / folder).rglob("*")),
]
# A path in backticks; NAME stands for any name.
PATH = re.compile(r"`((?:[\w*.-]+/)*[\w*-]+(?:\.(?:py|md|toml|ini)|/))`")
LINK = re.compile(r"\]\((?!\w+:)([^)#]+)")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_path_and_every_link_leads_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    links = [link for link in LINK.findall(text) if not (path.parent / link).exists()]
    named = {name.removesuffix("/").replace("NAME", "*") for name in PATH.findall(text)}
    lost = [name for name in named if not any(fnmatch(place, f"*/{name}") for place in PLACES)]
    assert (links, lost) == ([], [])
