"""What a transaction records beside knowledge: plans, and what was moved to an archive."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from sqlalchemy import Table

from .backends import Row
from .knowledge.changes import Change

if TYPE_CHECKING:
    from .transaction import Transaction


class PendingRecords:
    """The records of a transaction: rows that are only ever added.

    Attributes:
        pending: the rows of each record that is not written yet, with their tables, parents first.
    """

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        self._lines: dict[Change, None] = {}
        self.pending: dict[Change, tuple[tuple[Table, Row], ...]] = {}

    def add(self, change: Change, rows: Iterable[tuple[Table, Row]]) -> None:
        """Record something.

        Args:
            change: the line that the revision's hash covers; its text is in one of the rows.
            rows: its rows, each with its table, parents first.
        """
        self._transaction.assign(self._lines, change, None)
        self._transaction.assign(self.pending, change, tuple(rows))

    def changes(self) -> Iterator[Change]:
        """Give what the transaction has recorded so far.

        Yields:
            The lines, in no order.
        """
        yield from self._lines

    def write(self) -> None:
        """Write what is pending."""
        tables: dict[Table, list[Row]] = {}
        for rows in self.pending.values():
            for table, row in rows:
                tables.setdefault(table, []).append(row)
        for table, all_rows in tables.items():
            self._transaction.session.insert(table, all_rows)
        self.pending.clear()

    def state(self) -> list[dict[Any, Any]]:
        """Give the parts of the state, for the transaction to undo."""
        return [self._lines, self.pending]
