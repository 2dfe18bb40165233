"""The base of the tables' classes, column types, and shared parts of similar tables.

Every table starts with `kb_id`, the first column of each primary key, foreign key and index, except
for the index of open propositions and those of names and texts: a knowledge base is the unit of
tenancy and of sharding.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    ColumnClause,
    DateTime,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    text,
)

T = TypeVar("T")

# The collation "C" sorts by code point, like SQLite and the hash of a revision.
ShortText = String(255).with_variant(String(255, collation="C"), "postgresql")
LongText = Text().with_variant(Text(collation="C"), "postgresql")


class UtcTime(TypeDecorator[datetime]):
    """A time in UTC: `timestamptz` on PostgreSQL, ISO 8601 text elsewhere."""

    impl = String(27).with_variant(DateTime(timezone=True), "postgresql")
    cache_ok = True


# The text that was hashed: `json` on PostgreSQL keeps it, `jsonb` does not. SQLite has no JSON
# type, and would read a lone number in a column of an unknown type as a number.
CanonicalJson = Text().with_variant(JSON(none_as_null=True), "postgresql")


NAMING_CONVENTION = {
    "pk": "pk_%(table_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
}

# The table in which Alembic keeps the last migration.
VERSION_TABLE = "kant_sql_version"

LIVE = "until IS NULL"
CLOSED = "until IS NOT NULL"
# Checked at commit: the row of a revision has the hash of its changes, so it is written last.
AT_COMMIT: dict[str, Any] = {"deferrable": True, "initially": "DEFERRED"}
REVISION = ["revision.kb_id", "revision.number"]
ASSERTED = "asserted in this revision"
RETRACTED = "retracted in this revision; NULL: holds now"


# The default type of a column.
_KINDS: dict[type[Any], Any] = {
    int: BigInteger(),
    str: LongText,
    bool: Boolean(),
    bytes: LargeBinary(),
    datetime: UtcTime(),
}


class _Field(NamedTuple):
    """A column without name and table yet: several tables may share it."""

    order: int
    make: Callable[[str], Column[Any]]


class Base:
    """The base of the tables' classes: `HeadRow` is the table `head`, `HeadRow.hash` its column.

    SQLAlchemy's ORM could map them, but nothing else of it is needed, and importing it and mapping
    takes longer than opening a store.
    """

    metadata: ClassVar[MetaData] = MetaData(naming_convention=NAMING_CONVENTION)
    __tablename__: ClassVar[str]
    __table_args__: ClassVar[tuple[Any, ...]] = ()
    __table__: ClassVar[Table]
    # SQLite stores these tables in one tree: their keys and rows are short.
    __has_rowid__: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        fields = {
            name: field
            for each in reversed(cls.__mro__)
            for name, field in vars(each).items()
            if isinstance(field, _Field)
        }
        named = sorted(fields.items(), key=lambda item: item[1].order)
        columns = {name: field.make(name) for name, field in named}
        parts = (*columns.values(), *cls.__table_args__)
        info = {} if cls.__has_rowid__ else {"sqlite_with_rowid": False}
        cls.__table__ = Table(cls.__tablename__, cls.metadata, *parts, info=info)
        for name, column in columns.items():
            setattr(cls, name, column)

    @classmethod
    def __clause_element__(cls) -> Table:
        """Return the table, for statements."""
        return cls.__table__


def column(
    of: type[T], kind: Any = None, *, order: int = 0, nullable: bool = False, **options: Any
) -> ColumnClause[T]:
    """Make a column of a class; `order` places it among those of the table."""
    made = partial(Column, type_=_KINDS[of] if kind is None else kind, nullable=nullable, **options)
    # `Base` makes the column of it.
    return cast("ColumnClause[T]", _Field(order, made))


def optional(of: type[T], kind: Any = None, *, order: int = 0, **options: Any) -> ColumnClause[T]:
    """Make a column that may be NULL."""
    return column(of, kind, order=order, nullable=True, **options)


def key_column(order: int, comment: str | None = None, kind: Any = BigInteger) -> ColumnClause[int]:
    """Make a column of a primary key."""
    return column(int, kind, order=order, primary_key=True, autoincrement=False, comment=comment)


def kb_column() -> ColumnClause[int]:
    """Make the first column of every table and key."""
    return key_column(-100)


def owner_column() -> ColumnClause[int]:
    """Make the part of a primary key that names the element."""
    return key_column(-90)


def position_column(order: int = -60, comment: str | None = "from 0") -> ColumnClause[int]:
    """Make the part of a primary key that is a position in a list."""
    return key_column(order, comment, Integer)


class VersionRow:
    """A version of an element from one revision until another."""

    kb_id = kb_column()
    since = key_column(-80, ASSERTED)
    until = optional(int, order=-70, comment=RETRACTED)


class Interval(VersionRow):
    """A version among millions, found by its fork; see `sql/intervals.py`."""

    fork = column(
        int,
        order=10,
        server_default=text("0"),
        comment="the revision from since to before until that the highest power of two divides; "
        "0: holds now",
    )


def reference(column: str, table: str) -> ForeignKeyConstraint:
    """Make the reference of a column to the identity of an element."""
    return ForeignKeyConstraint(["kb_id", column], [f"{table}.kb_id", f"{table}.id"])


def lookup_index(table: str, column: str) -> Index:
    """Make the index by which the views find a name or a text.

    On PostgreSQL it is a hash index: a text may exceed the size limit of a b-tree entry, and in a
    small table without statistics, the planner would use an index that begins with `kb_id` for
    other queries.
    """
    return Index(f"ix_{table}_{column}", column, info={"postgresql_using": "hash"})


def partial_index(name: str, *columns: str, where: str, unique: bool = False) -> Index:
    """Make a partial index that both dialects have."""
    return Index(name, *columns, unique=unique, info=where_both(where, where))


def where_both(sqlite: str, postgresql: str) -> dict[str, Any]:
    """Return the condition of a partial index, as its `info`: see `with_dialects`."""
    return {"sqlite_where": text(sqlite), "postgresql_where": text(postgresql)}


def with_dialects() -> MetaData:
    """Return the tables with everything that the migrations make except views.

    Only Alembic needs the dialects' additions to tables and indexes: naming a dialect there makes
    SQLAlchemy import it with all its drivers.
    """
    for table in Base.metadata.tables.values():
        table.dialect_kwargs.update(table.info)
        for index in table.indexes:
            index.dialect_kwargs.update(index.info)
    return Base.metadata


def version_args(
    table: str, *owner: str, has_lists: bool = False, live: tuple[str, ...] | None = ()
) -> tuple[Any, ...]:
    """Return the constraints and indexes that all version tables have.

    Args:
        table: the name of the table.
        owner: the columns that name the element.
        has_lists: whether it has tables below it.
        live: the columns of the index of open versions, in another order than that of the key;
            None for no such index: the key finds the few versions of an element.
    """
    return (
        ForeignKeyConstraint(["kb_id", "since"], REVISION, **AT_COMMIT),
        ForeignKeyConstraint(["kb_id", "until"], REVISION, **AT_COMMIT),
        CheckConstraint("since < until", name="since_before_until"),
        *(
            ()
            if live is None
            else (
                partial_index(
                    f"uq_{table}_live", *(live or ("kb_id", *owner)), where=LIVE, unique=True
                ),
            )
        ),
        # These two find the changes of a revision, and the rows that its deferred foreign keys
        # check. The owner is included because PostgreSQL may use the index to look up the version
        # of an entry of a list, and one revision may add thousands.
        Index(f"ix_{table}_since", "kb_id", "since", *(owner if has_lists else ())),
        partial_index(f"ix_{table}_until", "kb_id", "until", where=CLOSED),
    )
