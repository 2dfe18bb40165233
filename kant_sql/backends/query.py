"""Statements: built once with SQLAlchemy Core, compiled once for each dialect.

One Core execution costs about 65 us of Python and one on the bare driver about 5, so a statement
is compiled to its text when it is first used, and the text goes to the driver with its parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import cache
from typing import Any, TypeVar

from sqlalchemy import (
    Boolean,
    ColumnElement,
    CompoundSelect,
    Delete,
    Dialect,
    FromClause,
    Select,
    String,
    Table,
    Text,
    Update,
    bindparam,
    literal_column,
    text,
)
from sqlalchemy.dialects.postgresql.base import PGDialect
from sqlalchemy.sql.expression import Executable
from sqlalchemy.sql.functions import FunctionElement

from ..tables.types import UtcTime

_Rows = TypeVar("_Rows", Select[Any], CompoundSelect[Any])

# Gives what must be true of the rows of a table.
Conditions = Callable[[FromClause], tuple[ColumnElement[bool], ...]]


class Query:
    """A statement with named parameters, compiled once for each dialect."""

    __slots__ = ("_statement", "_texts")

    def __init__(self, statement: Executable) -> None:
        self._statement = statement
        self._texts: dict[str, str] = {}

    def text(self, dialect: Dialect) -> str:
        """Give the statement's SQL.

        Args:
            dialect: the dialect, with the driver's parameter style.

        Returns:
            The SQL text.
        """
        text = self._texts.get(dialect.name)
        if text is None:
            compiled = self._statement.compile(dialect=dialect)  # type: ignore[attr-defined]
            constants = {key for key, value in compiled.params.items() if value is not None}
            # Only the text is kept: a constant must be a named parameter, or literal SQL.
            assert not constants, f"constants in {compiled}: {constants}"
            text = self._texts[dialect.name] = str(compiled)
        return text


def raw(sql: str) -> Query:
    """Make a statement of a text, which no parameter is in.

    Args:
        sql: the text; a colon in it is one.

    Returns:
        The statement.
    """
    return Query(text(sql.replace(":", r"\:")))


class InList(FunctionElement[bool]):
    """`column` is among the values of one list parameter: a text that no list length changes."""

    type = Boolean()
    inherit_cache = True
    name = "in_list"
    # Else SQLite's dialect writes `= 1` behind it, which keeps the database from using an index.
    _is_implicitly_boolean = True


class InRows(FunctionElement[bool]):
    """`column` is among the rows of a subquery, which is run once and drives an index.

    A join would do the same; but before PostgreSQL has statistics it takes every table for one
    row, and joins 30,000 propositions with nested loops over all pairs.
    """

    type = Boolean()
    inherit_cache = True
    name = "in_rows"
    _is_implicitly_boolean = True


class RowsOfIds(ColumnElement[bool]):
    """The row is one that is found for an id of the list parameter `ids`.

    Each id is looked for by itself. That the column is among the list would say the same; but
    before PostgreSQL has statistics it may read all rows that fulfil the other conditions.

    Attributes:
        found: the table, under another name.
        conditions: what must be true of a row that is found for the id `wanted.id`.
    """

    inherit_cache = False
    type = Boolean()
    _is_implicitly_boolean = True

    def __init__(self, table: FromClause, id_: ColumnElement[int], conditions: Conditions) -> None:
        """Say what is looked for.

        Args:
            table: the table.
            id_: its column of the ids.
            conditions: gives what must be true of its rows besides.
        """
        self.found = table.alias("found")
        wanted = self.found.c[str(id_.key)] == literal_column("wanted.id")
        self.conditions = (*conditions(self.found), wanted)


class StoreClock(FunctionElement[datetime]):
    """The store's own clock; NULL where the store has none finer than a millisecond."""

    type = UtcTime()
    inherit_cache = True
    name = "store_clock"


class StorePlace(FunctionElement[str]):
    """What tells a database from all others, whatever URL names it; empty for one in memory."""

    type = Text()
    inherit_cache = True
    name = "store_place"


def in_list(column: ColumnElement[Any] | Any, parameter: str) -> ColumnElement[bool]:
    """Tell whether a column is among the values of a list.

    Args:
        column: the column.
        parameter: the name of the parameter that takes `Session.list_value(values)`.

    Returns:
        The condition.
    """
    return InList(column, bindparam(parameter))


def in_rows(column: ColumnElement[Any] | Any, rows: Select[Any]) -> ColumnElement[bool]:
    """Tell whether a column is among the rows of a subquery.

    Args:
        column: the column.
        rows: the subquery, of one column.

    Returns:
        The condition.
    """
    return InRows(column, rows.correlate(None).scalar_subquery())


def first_rows(rows: _Rows, number: ColumnElement[Any]) -> _Rows:
    """Take only the first rows of a query.

    Args:
        rows: the query, with its order.
        number: how many: a parameter, or a literal column.

    Returns:
        The query.
    """
    # Said, for SQLAlchemy would else write it for SQLite as a constant.
    return rows.limit(number).offset(literal_column("0"))


class IdsQuery:
    """A change of the rows of some ids, as a statement for one of them and one for a list.

    `Session.run_for` takes the one that its database is quicker at.
    """

    __slots__ = ("each", "listed")

    def __init__(
        self, change: Update | Delete, id_: ColumnElement[int], conditions: Conditions
    ) -> None:
        """Make both statements.

        Args:
            change: what is changed of the rows, whichever they are.
            id_: the column of the ids, each of which has one such row at most.
            conditions: gives what must be true of the rows of the table besides.
        """
        table = change.table
        self.each = Query(change.where(*conditions(table), id_ == bindparam("id")))
        self.listed = Query(change.where(RowsOfIds(table, id_, conditions)))


@cache
def insert_text(table: Table, placeholder: str) -> str:
    """Write the statement that inserts one whole row.

    Args:
        table: the table.
        placeholder: the driver's sign for a positional parameter.

    Returns:
        The SQL text.
    """
    names = [column.name for column in table.columns]
    values = ", ".join(placeholder for _ in names)
    return f"INSERT INTO {table.name} ({', '.join(names)}) VALUES ({values})"


@cache
def unnest_text(table: Table) -> str:
    """Write PostgreSQL's statement that inserts many whole rows, one list for each column.

    Args:
        table: the table.

    Returns:
        The SQL text.
    """
    dialect: Dialect = PGDialect()  # type: ignore[no-untyped-call]
    types = [column.type.dialect_impl(dialect) for column in table.columns]
    # A text is compiled with its collation, which no array has.
    names = ["text" if isinstance(type_, String) else type_.compile(dialect) for type_ in types]
    lists = ", ".join(f"%s::{name}[]" for name in names)
    columns = ", ".join(column.name for column in table.columns)
    return f"INSERT INTO {table.name} ({columns}) SELECT * FROM unnest({lists})"
