"""Statements: built once with SQLAlchemy Core, compiled once for each dialect.

One Core execution costs about 29 us of Python and one on the bare driver about 4, so a statement
is compiled to its text when it is first used, and the text goes to the driver with its parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import cache
from typing import Any, TypeVar

from sqlalchemy import (
    BigInteger,
    Boolean,
    ColumnElement,
    CompoundSelect,
    Delete,
    Dialect,
    FromClause,
    Select,
    Table,
    Text,
    Update,
    bindparam,
    literal_column,
    text,
)
from sqlalchemy.sql.expression import Executable
from sqlalchemy.sql.functions import FunctionElement

from .tables.base import UtcTime

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
        """Return the statement's SQL."""
        text = self._texts.get(dialect.name)
        if text is None:
            compiled = self._statement.compile(dialect=dialect)  # type: ignore[attr-defined]
            constants = {key for key, value in compiled.params.items() if value is not None}
            # Only the text is kept: a constant must be a named parameter, or literal SQL.
            assert not constants, f"constants in {compiled}: {constants}"
            text = self._texts[dialect.name] = str(compiled)
        return text


def raw(sql: str) -> Query:
    """Build a statement from a text without parameters."""
    return Query(text(sql.replace(":", r"\:")))


class InList(FunctionElement[bool]):
    """`column` is among the values of one list parameter, in a text for lists of any length."""

    type = Boolean()
    inherit_cache = True
    name = "in_list"
    # Otherwise SQLite's dialect appends `= 1`, which keeps the database from using an index.
    _is_implicitly_boolean = True


class InRows(FunctionElement[bool]):
    """`column` is among the rows of a subquery, which runs once and drives an index.

    A join would do the same, but without statistics PostgreSQL takes every table for one row, and
    joins 30,000 propositions by nested loops over all pairs.
    """

    type = Boolean()
    inherit_cache = True
    name = "in_rows"
    _is_implicitly_boolean = True


class RowsOfIds(ColumnElement[bool]):
    """The row is found for an id of the list parameter `ids`.

    Each id is looked up by itself. `InList` would do the same, but without statistics PostgreSQL
    may read all rows that fulfil the other conditions.

    Attributes:
        found: an alias of the table.
        conditions: the conditions on the row of the id `wanted.id`.
    """

    inherit_cache = False
    type = Boolean()
    _is_implicitly_boolean = True

    def __init__(self, table: FromClause, id_: ColumnElement[int], conditions: Conditions) -> None:
        self.found = table.alias("found")
        wanted = self.found.c[str(id_.key)] == literal_column("wanted.id")
        self.conditions = (*conditions(self.found), wanted)


class StoreClock(FunctionElement[datetime]):
    """The store's own clock; NULL where the store has none finer than a millisecond."""

    type = UtcTime()
    inherit_cache = True
    name = "store_clock"


class StorePlace(FunctionElement[str]):
    """Identifies a database, whatever URL names it; empty for one in memory."""

    type = Text()
    inherit_cache = True
    name = "store_place"


def integer(name: str) -> ColumnElement[int]:
    """Write a parameter that is a revision, an id or a count."""
    return bindparam(name, type_=BigInteger)


def in_list(column: ColumnElement[Any] | Any, parameter: str) -> ColumnElement[bool]:
    """Write the condition that a column is among the values of a list."""
    return InList(column, bindparam(parameter))


def in_rows(column: ColumnElement[Any] | Any, rows: Select[Any]) -> ColumnElement[bool]:
    """Write the condition that a column is among the rows of a subquery."""
    return InRows(column, rows.correlate(None).scalar_subquery())


def first_rows(rows: _Rows, number: ColumnElement[Any]) -> _Rows:
    """Limit a query to its first rows."""
    # Explicit: SQLAlchemy would write it for SQLite as a constant.
    return rows.limit(number).offset(literal_column("0"))


class IdsQuery:
    """A change of the rows of some ids, as a statement for one id and one for a list.

    `Session.run_for` runs the faster one.
    """

    __slots__ = ("each", "listed")

    def __init__(
        self, change: Update | Delete, id_: ColumnElement[int], conditions: Conditions
    ) -> None:
        table = change.table
        self.each = Query(change.where(*conditions(table), id_ == bindparam("id")))
        self.listed = Query(change.where(RowsOfIds(table, id_, conditions)))


class Insert:
    """Which columns of a table the values of inserted rows are for, in their order."""

    __slots__ = ("columns", "into", "table")

    def __init__(self, table: Table, *names: str) -> None:
        missing = [
            column.name
            for column in table.columns
            if column.name not in names and not column.nullable and column.server_default is None
        ]
        assert not missing, f"{table.name} needs {missing}"
        self.table = table
        self.columns = [table.c[name] for name in names]
        self.into = f"{table.name} ({', '.join(names)})"


@cache
def whole_rows(table: Table) -> Insert:
    """Insert rows that have a value for every column, as a SELECT of the table gives them."""
    return Insert(table, *table.c.keys())


@cache
def insert_text(insert: Insert, placeholder: str) -> str:
    """Write the statement that inserts one row."""
    values = ", ".join(placeholder for _ in insert.columns)
    return f"INSERT INTO {insert.into} VALUES ({values})"
