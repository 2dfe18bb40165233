"""Rows of one database as another takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from typing import Any

from sqlalchemy import Boolean, ColumnElement, Table, Text, cast

from ..backends import Row, Session
from ..knowledge.rows import table_of
from ..tables import RevisionRow
from ..tables.types import UtcTime

BATCH = 5_000

_REVISION = table_of(RevisionRow)


def columns_of(table: Table) -> tuple[ColumnElement[Any], ...]:
    """Give the columns of a table as they are read, in order.

    Args:
        table: the table.

    Returns:
        The columns.
    """
    # As text: what a driver makes of a JSON document is not the text that was hashed.
    is_json = {_REVISION.c.source}
    return tuple(cast(column, Text) if column in is_json else column for column in table.columns)


def converters(
    columns: Iterable[ColumnElement[Any]], source: Session, target: Session
) -> dict[int, Callable[[Any], Any]]:
    """Tell what is to be done to the values of some columns.

    Args:
        columns: the columns.
        source: the session that values are read from.
        target: the session that they are written to.

    Returns:
        By the index of a column, what makes the value that the target takes.
    """
    found: dict[int, Callable[[Any], Any]] = {}
    for index, column in enumerate(columns):
        if isinstance(column.type, Boolean):
            found[index] = bool
        elif isinstance(column.type, UtcTime):
            found[index] = lambda raw: (
                None if raw is None else target.from_time(source.to_time(raw))
            )
    return found


def converted(row: Row, convert: Mapping[int, Callable[[Any], Any]]) -> Row:
    """Convert a row.

    Args:
        row: the row.
        convert: what `converters` gave for its columns.

    Returns:
        The row as the target takes it.
    """
    if not convert:
        return row
    values = list(row)
    for index, change in convert.items():
        values[index] = change(values[index])
    return tuple(values)


def batches(rows: Iterable[Row], size: int = BATCH) -> Iterator[list[Row]]:
    """Cut a stream into lists.

    Args:
        rows: the rows.
        size: how many rows are dealt with at once.

    Yields:
        So many of them.
    """
    iterator = iter(rows)
    while batch := list(islice(iterator, size)):
        yield batch
