"""Statements: built with SQLAlchemy Core once, and compiled once for each dialect.

An execution through Core costs about 29 us of Python, one on the bare driver about 4. So a
statement is compiled to text on first use, and the text goes to the driver with its parameters.
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
    Double,
    FromClause,
    Select,
    Table,
    Text,
    Update,
    bindparam,
    column,
    literal_column,
    select,
    text,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.expression import Executable
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeEngine

from .tables.base import UtcTime

_Rows = TypeVar("_Rows", Select[Any], CompoundSelect[Any])

# Returns the condition on the rows of a table.
Conditions = Callable[[FromClause], tuple[ColumnElement[bool], ...]]


class Query:
    """A statement with named parameters, compiled once for each dialect.

    A long statement is given as its builder: most processes never use it.

    Attributes:
        texts: its SQL, by the names of the dialects that it was compiled for.
    """

    __slots__ = ("_statement", "texts")

    def __init__(self, statement: Executable | Callable[[], Executable]) -> None:
        self._statement = statement
        self.texts: dict[str, str] = {}

    def text(self, dialect: Dialect) -> str:
        """Return the statement's SQL."""
        text = self.texts.get(dialect.name)
        if text is None:
            given: Any = self._statement
            statement: Any = given if isinstance(given, Executable) else given()
            compiled = statement.compile(dialect=dialect)
            constants = {key for key, value in compiled.params.items() if value is not None}
            # Only the text is kept: a constant must be a named parameter, or literal SQL.
            assert not constants, f"constants in {compiled}: {constants}"
            text = self.texts[dialect.name] = str(compiled)
        return text


def raw(sql: str) -> Query:
    """Build a statement from a text without parameters."""
    return Query(text(sql.replace(":", r"\:")))


class Condition(FunctionElement[bool]):
    """A condition on a row."""

    type = Boolean()
    inherit_cache = True
    # Otherwise SQLite's dialect appends `= 1`, which keeps the database from using an index.
    _is_implicitly_boolean = True


class InList(Condition):
    """`column` is among the values of one list parameter, in a text for lists of any length."""

    inherit_cache = True
    name = "in_list"


class InRows(Condition):
    """`column` is among the rows of a subquery, which runs once and drives an index.

    A join would do the same, but without statistics PostgreSQL assumes one row for every table, and
    joins 30,000 propositions by nested loops over all pairs.
    """

    inherit_cache = True
    name = "in_rows"


class AtKey(Condition):
    """`column` has a value; together with an order by it, the index in that order is used."""

    inherit_cache = True
    name = "at_key"


class Unsought(FunctionElement[Any]):
    """A column that must not choose an index: SQLite expects few rows in a range of revisions."""

    inherit_cache = True
    name = "unsought"


class InRange(Condition):
    """`column` is a whole number from a lower to an upper bound."""

    inherit_cache = True
    name = "in_range"


class Listed(FunctionElement[Any]):
    """The values of a list parameter, as a relation with the column `value`."""

    inherit_cache = False
    name = "listed"

    def __init__(self, parameter: str, kind: TypeEngine[Any]) -> None:
        super().__init__(bindparam(parameter))
        self.kind = kind


class FoundRows(FunctionElement[Any]):
    """The rows for the values of a list parameter, as a relation.

    Attributes:
        listed: the rows for which a column is among the values.
        each: the rows for the value `wanted.wanted`.
    """

    inherit_cache = False
    name = "found_rows"

    def __init__(
        self, rows: Select[*tuple[Any, ...]], column: ColumnElement[Any], parameter: str
    ) -> None:
        super().__init__()
        self.listed = rows.where(in_list(column, parameter))
        wanted: ColumnElement[Any] = literal_column("wanted.wanted")
        self.each = rows.where(AtKey(column, wanted)).order_by(column)
        self.values = Listed(parameter, column.type)


class Fork(FunctionElement[int]):
    """The fork of a version, of its `since` and its `until`; see `sql/intervals.py`."""

    type = BigInteger()
    inherit_cache = True
    name = "fork"


class RowsOfIds(ColumnElement[bool]):
    """The row belongs to an id of the list parameter `ids`.

    Each id is looked up by itself. `InList` would do the same, but without statistics PostgreSQL
    may read all rows that fulfil the other conditions.

    Attributes:
        each: the places of the rows of the id `wanted.wanted`.
    """

    inherit_cache = False
    type = Boolean()
    _is_implicitly_boolean = True

    def __init__(self, table: FromClause, id_: ColumnElement[int], conditions: Conditions) -> None:
        found = table.alias("found")
        own = found.c[str(id_.key)]
        # Equality, and no order: the index of open versions has no past ones to skip.
        wanted = own == literal_column("wanted.wanted")
        rows: Select[Any] = select(literal_column("found.ctid")).select_from(found)
        self.each = rows.where(*conditions(found), wanted)
        self.ids = Listed("ids", BigInteger())


class StoreClock(FunctionElement[datetime]):
    """The store's own clock; NULL if it has no clock finer than a millisecond."""

    type = UtcTime()
    inherit_cache = True
    name = "store_clock"


class Seconds(FunctionElement[float]):
    """The seconds from one time to another, with their fraction."""

    type = Double()
    inherit_cache = True
    name = "seconds"


class StorePlace(FunctionElement[str]):
    """Identifies a database independently of its URL; empty for one in memory."""

    type = Text()
    inherit_cache = True
    name = "store_place"


def write_as(element: type[FunctionElement[Any]], template: str, *dialects: str) -> None:
    """Let a dialect, or each without its own words, write the clauses into a template."""

    def write(found: FunctionElement[Any], compiler: Any, **options: Any) -> str:
        return template.format(*(compiler.process(each, **options) for each in found.clauses))

    compiles(element, *dialects)(write)


write_as(AtKey, "{0} = {1}")
write_as(Unsought, "{0}")
write_as(InRange, "{0} BETWEEN {1} AND {2}")


def text_literal(text: str) -> str:
    """Write a text as an SQL literal."""
    return "'" + text.replace("'", "''") + "'"


def constant(value: str | int) -> ColumnElement[Any]:
    """Write a text, a number or a truth value into the text of a statement."""
    if isinstance(value, str):
        return literal_column(text_literal(value))
    return literal_column(str(value).upper())


def integer(name: str) -> ColumnElement[int]:
    """Write a parameter that is a revision, an id or a count."""
    return bindparam(name, type_=BigInteger)


def in_list(
    column: ColumnElement[Any] | Any, parameter: str, bounded: Any = None
) -> ColumnElement[bool]:
    """Write the condition that a column is among the values of a list.

    Args:
        parameter: the name of the list.
        bounded: the column of revisions that follows in an index, if it has an upper bound.
    """
    return InList(column, bindparam(parameter), *(() if bounded is None else (bounded,)))


def each_of(parameter: str, kind: type[TypeEngine[Any]]) -> ColumnElement[Any]:
    """Write the values of a list parameter, as the column that a query reads."""
    values: TypeEngine[Any] = kind()
    return Listed(parameter, values).table_valued(column("value", values), name="value").c.value


def found_rows(
    rows: Select[*tuple[Any, ...]], key: ColumnElement[Any], parameter: str
) -> FromClause:
    """Write the relation of the rows of a query for the values of a list, with its columns.

    Each value is looked up by itself: of a list, PostgreSQL without statistics reads all rows that
    fulfil the other conditions, and compares each of them with all values if the plan is kept.
    """
    columns = [column(str(one.key), one.type) for one in rows.selected_columns]
    return FoundRows(rows, key, parameter).table_valued(*columns, name="found")


def in_rows(
    column: ColumnElement[Any] | Any, rows: Select[Any], bounded: Any = None
) -> ColumnElement[bool]:
    """Write the condition that a column is among the rows of a subquery; `bounded` as above."""
    among = rows.correlate(None).scalar_subquery()
    return InRows(column, among, *(() if bounded is None else (bounded,)))


def first_rows(rows: _Rows, number: ColumnElement[Any] | int) -> _Rows:
    """Limit a query to its first rows."""
    most = constant(number) if isinstance(number, int) else number
    # Explicit: for SQLite, SQLAlchemy would write it as a parameter.
    return rows.limit(most).offset(constant(0))


class IdsQuery:
    """A change of the rows of some ids, as a statement for one id and one for a list.

    `Session.run_for` runs the faster one.
    """

    __slots__ = ("each", "listed")

    def __init__(
        self, change: Update | Delete, id_: ColumnElement[int], conditions: Conditions
    ) -> None:
        table = change.table
        self.each = Query(lambda: change.where(*conditions(table), id_ == bindparam("id")))
        # A cluster also looks here for the knowledge base.
        self.listed = Query(
            lambda: change.where(table.c.kb_id == integer("kb"), RowsOfIds(table, id_, conditions))
        )


class Insert:
    """The columns of a table that inserted rows fill, in order."""

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
    """Insert rows with a value for every column, as from a SELECT of the table."""
    return Insert(table, *table.c.keys())


@cache
def insert_text(insert: Insert, placeholder: str, rows: int = 1) -> str:
    """Write the statement that inserts one row, or so many."""
    values = f"({', '.join(placeholder for _ in insert.columns)})"
    return f"INSERT INTO {insert.into} VALUES {', '.join(values for _ in range(rows))}"


@cache
def insert_texts(inserts: tuple[tuple[Insert, int], ...], placeholder: str) -> str:
    """Write the statement of several inserts, each with its number of rows."""
    *before, last = (insert_text(into, placeholder, rows) for into, rows in inserts)
    among = ", ".join(f"i{n} AS ({each})" for n, each in enumerate(before))
    return f"WITH {among} {last}" if before else last
