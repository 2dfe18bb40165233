"""Column types that mean the same on every dialect."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, Dialect, String, Text, TypeDecorator
from sqlalchemy.dialects.postgresql import TIMESTAMP

from ..canonical import time_text

# The collation "C" sorts by code point, as SQLite does and as the hash of a revision demands.
ShortText = String(255).with_variant(String(255, collation="C"), "postgresql")
LongText = Text().with_variant(Text(collation="C"), "postgresql")


def text_time(text: str) -> datetime:
    """Read a moment back from `time_text`.

    Args:
        text: the text.

    Returns:
        The moment, in UTC.
    """
    return datetime.fromisoformat(text).astimezone(UTC)


class UtcTime(TypeDecorator[datetime]):
    """A moment in UTC: `timestamptz` on PostgreSQL, ISO 8601 text elsewhere."""

    impl = String(27)
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> Any:
        """Choose the dialect's own type where it has one."""
        if dialect.name == "postgresql":
            return dialect.type_descriptor(TIMESTAMP(timezone=True))
        return dialect.type_descriptor(String(27))

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> Any:
        """Give the driver's form of a moment."""
        if value is None or dialect.name == "postgresql":
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
