"""The rollback journal of a transaction's memory.

A failed scope is rolled back alone. Until the transaction writes, the journal restores memory entry
by entry. Once it writes within a scope, a savepoint rolls back the database, and memory is restored
from a copy made at the savepoint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..sql.dialects.base import Session

_MISSING: Any = object()
_Table = dict[Any, Any]


class Journal:
    """Journaled assignment to the tables of a transaction: its dictionaries."""

    __slots__ = ("_entries", "_scopes", "_session", "_tables", "when_rolled_back")

    def __init__(self, session: Session) -> None:
        self._session = session
        self._tables: list[_Table] = []
        self._entries: list[tuple[_Table, Any, Any]] = []
        self._scopes: list[JournalScope] = []
        self.when_rolled_back: Callable[[], None] | None = None

    def track(self, *tables: _Table) -> None:
        """Also restore these tables when a scope is rolled back."""
        self._tables += tables

    def assign(self, table: _Table, key: Any, value: Any) -> None:
        """Set an entry of a tracked table."""
        # A scope with a savepoint has a copy, and so have its outer scopes.
        if self._scopes and self._scopes[-1].savepoint is None:
            self._entries.append((table, key, table.get(key, _MISSING)))
        table[key] = value

    def assign_all(self, table: _Table, entries: Mapping[Any, Any]) -> None:
        """Set many entries of a tracked table."""
        if self._scopes and self._scopes[-1].savepoint is None:
            self._entries += [(table, key, table.get(key, _MISSING)) for key in entries]
        table.update(entries)

    def scope(self) -> JournalScope:
        """Open a scope, which is atomic."""
        return JournalScope(self)

    def before_write(self) -> None:
        """Set the savepoints of the open scopes: memory alone cannot roll back a write."""
        for scope in self._scopes:
            if scope.savepoint is None:
                scope.savepoint = self._session.savepoint()
                # Nothing was written since the scope began, so a savepoint now equals one set then.
                copies = {id(table): dict(table) for table in self._tables}
                for table, key, before in reversed(self._entries[scope.start :]):
                    _restore(copies[id(table)], key, before)
                scope.copies = copies
            scope.start = 0
        self._entries.clear()

    def _roll_back(self, scope: JournalScope) -> None:
        if scope.savepoint is None:
            for table, key, before in reversed(self._entries[scope.start :]):
                _restore(table, key, before)
        elif self._session.in_transaction():
            self._session.rollback_to(scope.savepoint)
            for table in self._tables:
                # A table that is younger than the savepoint was empty at the savepoint.
                before = scope.copies.get(id(table), {})
                table.clear()
                table.update(before)
        del self._entries[scope.start :]
        if self.when_rolled_back is not None:
            self.when_rolled_back()


class JournalScope:
    """A part of a transaction that is rolled back alone if it fails.

    The first write within it sets the savepoint and copies the tables.
    """

    __slots__ = ("_journal", "copies", "savepoint", "start")

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self.start = 0
        self.savepoint: str | None = None
        self.copies: dict[int, _Table] = {}

    def __enter__(self) -> None:
        journal = self._journal
        self.start = len(journal._entries)
        journal._scopes.append(self)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        journal = self._journal
        try:
            if kind is not None:
                journal._roll_back(self)
            elif self.savepoint is not None:
                journal._session.release(self.savepoint)
        finally:
            journal._scopes.pop()
            if not journal._scopes:
                journal._entries.clear()


def _restore(table: _Table, key: Any, before: Any) -> None:
    if before is _MISSING:
        table.pop(key, None)
    else:
        table[key] = before
