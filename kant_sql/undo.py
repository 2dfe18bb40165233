"""Undoing a part of a transaction: a call, or a nested transaction.

What a transaction has not written yet is undone in memory, entry by entry. Once it writes within a
scope, the database undoes its part by a savepoint, and memory goes back to how it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from .backends import Session

_MISSING: Any = object()
_Part = dict[Any, Any]


class _Scope:
    """What it takes to undo what happened since the scope was entered."""

    __slots__ = ("image", "savepoint", "start")

    def __init__(self, start: int) -> None:
        self.start = start
        self.savepoint: str | None = None
        self.image: list[tuple[_Part, _Part]] = []


class Undo:
    """The scopes that a transaction has open, and the changes made to its state in them."""

    def __init__(
        self,
        session: Session,
        state: Callable[[], list[_Part]],
        undone: Callable[[], None],
    ) -> None:
        """Make it for one transaction.

        Args:
            session: the transaction's session.
            state: gives all parts of the transaction's state.
            undone: called when a scope was undone.
        """
        self._undone = undone
        self._session = session
        self._state = state
        self._journal: list[tuple[_Part, Any, Any]] = []
        self._scopes: list[_Scope] = []

    def assign(self, part: _Part, key: Any, value: Any) -> None:
        """Set an entry of the state, so that a failing scope can undo it.

        Args:
            part: the part of the state.
            key: the entry.
            value: its new value.
        """
        # A scope with a savepoint has an image, and so have those around it.
        if self._scopes and self._scopes[-1].savepoint is None:
            self._journal.append((part, key, part.get(key, _MISSING)))
        part[key] = value

    def assign_all(self, part: _Part, entries: Mapping[Any, Any]) -> None:
        """Set many entries of the state, so that a failing scope can undo it.

        Args:
            part: the part of the state.
            entries: the entries, each with its new value.
        """
        if self._scopes and self._scopes[-1].savepoint is None:
            self._journal += [(part, key, part.get(key, _MISSING)) for key in entries]
        part.update(entries)

    @contextmanager
    def scope(self) -> Iterator[None]:
        """Make what happens within undoable: it happens whole or not at all.

        Yields:
            Nothing.
        """
        scope = _Scope(len(self._journal))
        self._scopes.append(scope)
        try:
            yield
        except BaseException:
            self._undo(scope)
            raise
        else:
            if scope.savepoint is not None:
                self._session.release(scope.savepoint)
        finally:
            self._scopes.pop()
            if not self._scopes:
                self._journal.clear()

    def before_write(self) -> None:
        """Prepare the open scopes for a write: memory alone cannot undo it."""
        for scope in self._scopes:
            if scope.savepoint is None:
                scope.savepoint = self._session.savepoint()
                # Nothing was written since the scope began, so the savepoint stands for its start.
                parts = self._state()
                copies = {id(part): dict(part) for part in parts}
                for part, key, before in reversed(self._journal[scope.start :]):
                    _restore(copies[id(part)], key, before)
                scope.image = [(part, copies[id(part)]) for part in parts]
            scope.start = 0
        self._journal.clear()

    def _undo(self, scope: _Scope) -> None:
        if scope.savepoint is None:
            for part, key, before in reversed(self._journal[scope.start :]):
                _restore(part, key, before)
        elif self._session.in_transaction():
            self._session.rollback_to(scope.savepoint)
            for part, image in scope.image:
                part.clear()
                part.update(image)
        del self._journal[scope.start :]
        self._undone()


def _restore(part: _Part, key: Any, before: Any) -> None:
    if before is _MISSING:
        part.pop(key, None)
    else:
        part[key] = before
