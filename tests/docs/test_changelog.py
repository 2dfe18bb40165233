"""The changelog begins with the version of the package, and with its date."""

from __future__ import annotations

import re
from datetime import date

import kant_sql
from tests.docs.test_docs import ROOT


def test_the_top_of_the_changelog_is_the_version_of_the_package() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    tops = re.findall(r"^## (\S+) \((\S+)\)$", text, re.MULTILINE)
    assert tops, "no section such as `## 0.1.0 (2026-11-22)`"
    version, day = tops[0]
    assert version == kant_sql.__version__
    assert date.fromisoformat(day) >= date(2026, 11, 22)
