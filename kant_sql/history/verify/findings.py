"""The findings of a verification."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from ... import html

# More findings of a table are only counted, to bound memory.
LISTED = 100


class Finding(NamedTuple):
    """A fault.

    Attributes:
        revision: the first revision that it makes wrong; None when it belongs to none.
        table: the table; None when several may be meant.
        message: what differs.
    """

    revision: int | None
    table: str | None
    message: str

    def _html_row_(self) -> html.Row:
        return self._asdict()


class Report:
    """Collects the findings of one knowledge base."""

    def __init__(self) -> None:
        self._findings: list[Finding] = []
        self._counts: Counter[str | None] = Counter()

    def add(self, revision: int | None, table: str | None, message: str) -> None:
        """Add a finding."""
        self._counts[table] += 1
        if self._counts[table] <= LISTED:
            # SQLite stores any value in any column.
            number = revision if isinstance(revision, int) else None
            self._findings.append(Finding(number, table, message))

    def findings(self) -> tuple[Finding, ...]:
        """Return all findings, by revision."""
        more = [
            Finding(None, table, f"{count - LISTED} more findings in {table or 'several tables'}")
            for table, count in self._counts.items()
            if count > LISTED
        ]
        found = sorted(self._findings, key=lambda each: (each.revision is None, each.revision or 0))
        return (*found, *more)
