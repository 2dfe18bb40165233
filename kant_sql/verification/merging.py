"""Reading several tables side by side, each in the order of the same key, in constant memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from operator import itemgetter
from typing import Any

from sqlalchemy import Table, select

from ..backends import Query, Row, Session
from ..knowledge.loading import KB

_END: Any = object()


class Side:
    """The rows of one table, to be taken key by key.

    Keys are the first columns of a row, and must come in ascending order.
    """

    def __init__(self, rows: Iterator[Row], width: int, stray: Callable[[Row], None]) -> None:
        """Make it.

        Args:
            rows: the rows, by key.
            width: how many columns are the key.
            stray: called with each row whose key nobody asks for.
        """
        self._groups = groupby(rows, key=itemgetter(*range(width)))
        self._stray = stray
        self._key: Any = _END
        self._rows: Iterator[Row] = iter(())
        self._next()

    def take(self, key: Any) -> Iterator[Row]:
        """Give the rows of a key, which is larger than those that were asked for before.

        Args:
            key: the key: one value, or a tuple of several.

        Returns:
            Its rows, to be read before the next are taken.
        """
        # A key that is NULL can be compared with none: that is an error, and not the end.
        while self._key is not _END and self._key < key:
            self._pass()
        if self._key != key:
            return iter(())
        return self._taken()

    def end(self) -> None:
        """Let what is left be strays."""
        while self._key is not _END:
            self._pass()

    def _taken(self) -> Iterator[Row]:
        yield from self._rows
        self._next()

    def _pass(self) -> None:
        for row in self._rows:
            self._stray(row)
        self._next()

    def _next(self) -> None:
        self._key, self._rows = next(self._groups, (_END, iter(())))


def in_order(table: Table, *names: str, key: int) -> Query:
    """Make the query that reads the rows of one knowledge base in the order of the first columns.

    Args:
        table: the table.
        *names: the columns that are read; when none are given, all but the knowledge base's.
        key: how many of them are the key.

    Returns:
        The query.
    """
    columns = [table.c[name] for name in names or [*table.c.keys()][1:]]
    return Query(select(*columns).where(table.c.kb_id == KB).order_by(*columns[:key]))


def side(
    session: Session, kb_id: int, query: Query, width: int, stray: Callable[[Row], None]
) -> Side:
    """Begin to read a table.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        query: what `in_order` has made.
        width: how many columns are the key.
        stray: called with each row whose key nobody asks for.

    Returns:
        The side.
    """
    return Side(session.stream(query, kb=kb_id), width, stray)
