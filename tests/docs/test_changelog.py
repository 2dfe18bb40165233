"""The changelog begins with the version of the package, and its entries are one line each."""

from __future__ import annotations

import re
from datetime import date

import kant_sql
from tests.docs.test_docs import ROOT

TEXT = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_top_of_the_changelog_is_the_version_of_the_package() -> None:
    tops = re.findall(r"^## (\S+) \((\S+)\)$", TEXT, re.MULTILINE)
    assert tops, "no section such as `## 0.2.0 (2026-11-23)`"
    version, day = tops[0]
    assert version == kant_sql.__version__
    assert date.fromisoformat(day) >= date(2026, 11, 22)


def test_an_entry_is_one_line() -> None:
    _, _, sections = TEXT.partition("\n## ")
    starts = ("- ", "## ", "### ")
    lines = [line for line in sections.splitlines()[1:] if line]
    assert [line for line in lines if not line.startswith(starts)] == []
