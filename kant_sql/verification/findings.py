"""What verification finds wrong, and how it is collected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

# Called with how much is done, and how much there is to do.
Progress = Callable[[int, int], None]
# More of one sort are counted, not listed: memory stays flat, whatever was done to a store.
LISTED = 100


class Finding(NamedTuple):
    """Something that is wrong.

    Attributes:
        revision: the first revision that it makes wrong; None when it belongs to none.
        table: the table; None when several may be meant.
        message: what differs.
    """

    revision: int | None
    table: str | None
    message: str


class Report:
    """Collects what is wrong with one knowledge base."""

    def __init__(self) -> None:
        self._findings: list[Finding] = []
        self._counts: Counter[str | None] = Counter()

    def add(self, revision: int | None, table: str | None, message: str) -> None:
        """Add a finding.

        Args:
            revision: the first revision that it makes wrong; None when it belongs to none.
            table: the table; None when several may be meant.
            message: what differs.
        """
        self._counts[table] += 1
        if self._counts[table] <= LISTED:
            # A database without strict types may have anything there.
            number = revision if isinstance(revision, int) else None
            self._findings.append(Finding(number, table, message))

    def findings(self) -> tuple[Finding, ...]:
        """Give all findings.

        Returns:
            The first revision first, and what belongs to none at the end.
        """
        more = [
            Finding(None, table, f"{count - LISTED} more findings in {table or 'several tables'}")
            for table, count in self._counts.items()
            if count > LISTED
        ]
        found = sorted(self._findings, key=lambda each: (each.revision is None, each.revision or 0))
        return (*found, *more)
