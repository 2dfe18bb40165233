"""The declarative base, column types, and what tables of one sort have in common.

Every table starts with `kb_id`, the first column of each primary key, foreign key and index: a
knowledge base is the unit of tenancy and of sharding.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    Dialect,
    ForeignKeyConstraint,
    Index,
    MetaData,
    String,
    Text,
    TypeDecorator,
    UniqueConstraint,
    text,
)
from sqlalchemy.dialects.postgresql import TIMESTAMP
from sqlalchemy.orm import DeclarativeBase, Mapped, MappedColumn, mapped_column

from ...knowledge.canonical import time_text

# The collation "C" sorts by code point, as SQLite does and as the hash of a revision demands.
ShortText = String(255).with_variant(String(255, collation="C"), "postgresql")
LongText = Text().with_variant(Text(collation="C"), "postgresql")


def text_time(text: str) -> datetime:
    """Read a moment back from `time_text`."""
    return datetime.fromisoformat(text).astimezone(UTC)


class UtcTime(TypeDecorator[datetime]):
    """A moment in UTC: `timestamptz` on PostgreSQL, ISO 8601 text elsewhere."""

    impl = String(27).with_variant(TIMESTAMP(timezone=True), "postgresql")
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> Any:
        """Return the driver's form of a moment."""
        if value is None or not isinstance(self.impl_instance, String):
            return value
        return time_text(value)

    def process_result_value(self, value: Any, dialect: Dialect) -> datetime | None:
        """Read the driver's form of a moment."""
        if value is None:
            return None
        return text_time(value) if isinstance(value, str) else value.astimezone(UTC)


# The very text that was hashed: `json` on PostgreSQL keeps it, `jsonb` does not. SQLite has no JSON
# type, and would read a lone number in a column of one that it does not know.
CanonicalJson = Text().with_variant(JSON(none_as_null=True), "postgresql")


NAMING_CONVENTION = {
    "pk": "pk_%(table_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
}

# Alembic keeps here which migration was the last.
VERSION_TABLE = "kant_sql_version"

LIVE = "until IS NULL"
CLOSED = "until IS NOT NULL"


class Base(DeclarativeBase):
    """The base of all mapped classes."""

    metadata = MetaData(naming_convention=NAMING_CONVENTION)


def kb_column() -> MappedColumn[int]:
    """Make the column that every table and every key starts with."""
    return mapped_column(BigInteger, primary_key=True, autoincrement=False, sort_order=-100)


def owner_column() -> MappedColumn[int]:
    """Make the part of a primary key that names the element."""
    return mapped_column(BigInteger, primary_key=True, autoincrement=False, sort_order=-90)


def since_column() -> MappedColumn[int]:
    """Make the part of a primary key that names the version of the element."""
    return mapped_column(
        BigInteger,
        primary_key=True,
        autoincrement=False,
        sort_order=-80,
        comment="asserted in this revision",
    )


def fork_column() -> MappedColumn[int]:
    """Make the column by which a past state is found; `sql/intervals.py` explains it."""
    return mapped_column(
        BigInteger,
        server_default=text("0"),
        comment="the revision from since to before until that the highest power of two divides; "
        "0: holds now",
    )


class Identity:
    """A named element for ever, apart from what held of it when."""

    kb_id: Mapped[int] = kb_column()
    id: Mapped[int] = owner_column()
    name: Mapped[str] = mapped_column(ShortText, comment="in its first spelling")
    key: Mapped[str] = mapped_column(LongText, comment="the name as compared: case folded")


class Version:
    """What held of an element from one revision until another."""

    kb_id: Mapped[int] = kb_column()
    since: Mapped[int] = since_column()
    until: Mapped[int | None] = mapped_column(
        BigInteger, sort_order=-70, comment="retracted in this revision; NULL: holds now"
    )


def identity_args() -> tuple[Any, ...]:
    """Return the constraints of an identity table."""
    return (
        ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"]),
        UniqueConstraint("kb_id", "key"),
    )


def lookup_index(table: str, column: str) -> Index:
    """Make the index by which the views find what they are asked for: a name, or a text.

    It is a hash on PostgreSQL: a text may be longer than what a b-tree takes, and one that began
    with `kb_id` would be taken for others' questions, too, while a table without statistics is
    small.
    """
    return Index(f"ix_{table}_{column}", column, postgresql_using="hash")


def partial_index(name: str, *columns: str, where: str, unique: bool = False) -> Index:
    """Make a partial index that both dialects have."""
    return Index(
        name, *columns, unique=unique, sqlite_where=text(where), postgresql_where=text(where)
    )


def version_args(element: str, has_parts: bool = True) -> tuple[Any, ...]:
    """Return the constraints and indexes of an element's version table.

    The two references to `revision` are checked at commit: the revision's row holds the hash of
    all that changed, so it is written last.
    """
    table, owner = f"{element}_version", f"{element}_id"
    at_commit: dict[str, Any] = {"deferrable": True, "initially": "DEFERRED"}
    revision = ["revision.kb_id", "revision.number"]
    return (
        ForeignKeyConstraint(["kb_id", owner], [f"{element}.kb_id", f"{element}.id"]),
        ForeignKeyConstraint(["kb_id", "since"], revision, **at_commit),
        ForeignKeyConstraint(["kb_id", "until"], revision, **at_commit),
        CheckConstraint("since < until", name="since_before_until"),
        partial_index(f"uq_{table}_live", "kb_id", owner, where=LIVE, unique=True),
        # What a revision changed is found by these two, and so are the rows that a new revision's
        # deferred foreign keys have to be checked against.
        # With the owner: PostgreSQL may take this index to look up the version of a part, and one
        # revision may make thousands.
        Index(f"ix_{table}_since", "kb_id", "since", *([owner] if has_parts else [])),
        partial_index(f"ix_{table}_until", "kb_id", "until", where=CLOSED),
    )
