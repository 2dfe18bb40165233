"""Plotly's script, as its own package brings it, and what it would write into a page."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import plotly

SCRIPT = Path(plotly.__file__).parent / "package_data" / "plotly.min.js"
# The script adds a style sheet for maps unless the page has an element of this id.
_STYLE_ID = re.compile(r'document\.getElementById\("([0-9a-f]{64})"\)')


@cache
def style_ids() -> list[str]:
    """Return the ids of style sheets that the script adds to a page that lacks them.

    The policy of the pages forbids that, and no figure here is a map.
    """
    return sorted(set(_STYLE_ID.findall(SCRIPT.read_text(encoding="utf-8"))))
