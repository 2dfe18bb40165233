"""What the README, the docs and the code name in the tree is there, and every page is listed."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from tests.docs.test_docs import DOCUMENTS, ROOT

FOLDERS = ("kant_sql", "kant_sql_plugins", "migrations", "tests", "docs", "examples")
PLACES = [
    *(f"/{path.name}" for path in ROOT.iterdir()),
    *(f"/{path.relative_to(ROOT)}" for folder in FOLDERS for path in (ROOT / folder).rglob("*")),
]
# A path in backticks; NAME stands for any name.
PATH = re.compile(r"`((?:[\w*.-]+/)*[\w*-]+(?:\.(?:py|md|toml|ini)|/))`")
LINK = re.compile(r"\]\((?!\w+:)([^)#]+)")


ATTRIBUTE = re.compile(r"\bkb((?:\.[a-z_]+)+)")
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


def missing(text: str) -> list[str]:
    """The attributes of `kb`, as far as the first call, that a text names and nothing has."""
    named = ((name, name.strip(".").split(".")) for name in ATTRIBUTE.findall(text))
    with kant_sql.connect("sqlite://", knowledge_base="kb") as kb:
        return [name for name, parts in named if not is_there(kb, parts)]


def is_there(value: Any, parts: list[str]) -> bool:
    for part in parts:
        if callable(value):
            break
        if not hasattr(value, part):
            return False
        value = getattr(value, part)
    return True


def test_every_call_of_a_knowledge_base_that_is_named_is_there() -> None:
    # The changes also name what is gone.
    paths = [path for path in DOCUMENTS if path.name != "CHANGELOG.md"]
    paths += [path for path in MODULES if "tests" not in path.parts]
    assert missing("\n".join(path.read_text(encoding="utf-8") for path in paths)) == []
    gone = ".timed_initial_literals.save"
    assert missing(f"kb{gone}('(at 10 (open))'), or kb.pddl{gone}(...)") == [gone]


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
