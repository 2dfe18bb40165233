"""`make docs` builds the site of docs/ without a warning, and the README suits a package index."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.test_docs import ROOT

PAGES = sorted((ROOT / "docs" / "api").glob("*.md"))
MODULE = re.compile(r"^::: (\S+)$", re.MULTILINE)
MEMBERS = re.compile(r"^ +members: \[(.*)\]$", re.MULTILINE)
# What a browser fetches when it shows a page.
FETCHED = re.compile(r'<(?:script|img|iframe|link)\b[^>]*(?:src|href)="((?:https?:)?//[^"]+)"')
RELATIVE_LINK = re.compile(r"\]\((?!\w+:)")


def run(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    remedy = "the tools come with: python -m pip install --editable '.[test]'"
    assert done.returncode == 0, f"{done.stdout}{done.stderr}\n{remedy}"
    return done.stdout


def public_names(page: str) -> set[str]:
    """The names that a page of the reference promises."""
    (module,) = MODULE.findall(page)
    members = MEMBERS.search(page)
    names = members[1].split(", ") if members else importlib.import_module(module).__all__
    return {f"{module}.{name}" for name in names}


@pytest.mark.more
@pytest.mark.timeout(900)
def test_the_site_builds_strictly_with_every_public_name_and_fetches_nothing(
    tmp_path: Path,
) -> None:
    run("-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path))

    documented = set()
    for page in PAGES:
        if page.name != "index.md":
            names = public_names(page.read_text(encoding="utf-8"))
            html = (tmp_path / "api" / page.with_suffix(".html").name).read_text(encoding="utf-8")
            assert names - set(re.findall(r'id="([^"]+)"', html)) == set(), page.name
            documented |= names
    index = json.loads((tmp_path / "search" / "search_index.json").read_text(encoding="utf-8"))
    found = {entry["location"].rpartition("#")[2] for entry in index["docs"]}
    assert documented - found == set()

    fetched = {
        url for path in tmp_path.rglob("*.html") for url in FETCHED.findall(path.read_text("utf-8"))
    }
    assert fetched == set()


def test_every_public_module_is_listed_and_has_a_page() -> None:
    (index,) = [page for page in PAGES if page.name == "index.md"]
    listed = dict(re.findall(r"^\| \[`([\w.]+)`\]\((\w+\.md)\)", index.read_text("utf-8"), re.M))
    modules = {
        MODULE.findall(page.read_text("utf-8"))[0]: page.name for page in PAGES if page != index
    }
    assert listed == modules


def test_the_readme_of_a_package_index_has_no_relative_link() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert RELATIVE_LINK.search(readme)  # which an index could not follow
    text = run("-m", "hatch_fancy_pypi_readme")
    assert not RELATIVE_LINK.search(text)
    assert "[KANT](https://doi.org/" in text
    assert "- `docs/index.md`: " in text
