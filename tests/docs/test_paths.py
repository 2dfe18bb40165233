"""What the README, the docs and the code name in the tree is there, and every page is listed."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path

import pytest

from tests.docs.test_docs import DOCUMENTS, ROOT

FOLDERS = ("kant_sql", "kant_sql_plugins", "migrations", "tests", "docs", "examples")
PLACES = [
    *(f"/{path.name}" for path in ROOT.iterdir()),
    *(f"/{path.relative_to(ROOT)}" for folder in FOLDERS for path in (ROOT / folder).rglob("*")),
]
# A path in backticks; NAME stands for any name.
PATH = re.compile(r"`((?:[\w*.-]+/)*[\w*-]+(?:\.(?:py|md|toml|ini)|/))`")
LINK = re.compile(r"\]\((?!\w+:)([^)#]+)")


MODULES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
PAGE = re.compile(r"^ +- .+: (\S+\.md)$", re.MULTILINE)


def lost(text: str) -> list[str]:
    """The paths that a text names and the tree lacks."""
    named = {name.removesuffix("/").replace("NAME", "*") for name in PATH.findall(text)}
    return [name for name in named if not any(fnmatch(place, f"*/{name}") for place in PLACES)]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_path_and_every_link_leads_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    links = [link for link in LINK.findall(text) if not (path.parent / link).exists()]
    assert (links, lost(text)) == ([], [])


def test_every_path_that_the_code_names_is_there() -> None:
    found = {path: lost(path.read_text(encoding="utf-8")) for path in MODULES}
    assert {str(path): names for path, names in found.items() if names} == {}
    gone = "sql/gone.py"
    assert lost(f"`sql/answers.py` and `{gone}`") == [gone]


def test_one_list_of_pages_begins_with_the_tutorial() -> None:
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    site = PAGE.findall((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    index = LINK.findall((ROOT / "docs" / "index.md").read_text(encoding="utf-8"))
    assert sorted(site) == sorted(pages)
    assert site[0] == index[0] == "tutorial.md"
    inner = {page for page in pages if page.startswith("api/")} - {"api/index.md"}
    assert index == [page for page in site if page not in {"index.md", *inner}]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_no_line_is_longer_than_110_columns(path: Path) -> None:
    lines = enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
    assert [number for number, line in lines if len(line) > 110] == []
