"""All knowledge bases of a store, verified as the library does it."""

from __future__ import annotations

import kant_sql
from kant_sql.catalog import every_name
from kant_sql.history import Finding


def findings(url: str) -> list[Finding]:
    """What verification finds wrong in a store: nothing, when nobody has tampered with it."""
    found: list[Finding] = []
    for name in every_name(url):
        with kant_sql.connect(url, knowledge_base=name) as kb:
            found += kb.verify().findings
    return found
