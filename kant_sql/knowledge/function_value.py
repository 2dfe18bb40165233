"""The statements that find fluents, and set or unset their values."""

from __future__ import annotations

from typing import Any

from sqlalchemy import bindparam, select

from ..backends import Query, in_list
from ..tables import FunctionValueRow, FunctionValueVersionRow
from .loading import KB
from .past import IntervalTable

VERSIONS = IntervalTable(FunctionValueVersionRow, "function_value_id")


def _open_version(column: Any) -> Any:
    return (
        select(column)
        .where(FunctionValueVersionRow.kb_id == FunctionValueRow.kb_id)
        .where(FunctionValueVersionRow.function_value_id == FunctionValueRow.id)
        .where(FunctionValueVersionRow.until.is_(None))
        .scalar_subquery()
    )


# The value, as its text tells it, and the object that it is.
VALUE_COLUMNS = (
    _open_version(FunctionValueVersionRow.text),
    _open_version(FunctionValueVersionRow.object_id),
)
FIND = Query(
    select(
        FunctionValueRow.id, FunctionValueRow.arguments, FunctionValueRow.text, *VALUE_COLUMNS
    ).where(
        FunctionValueRow.kb_id == KB,
        FunctionValueRow.function_id == bindparam("function"),
        in_list(FunctionValueRow.arguments, "arguments"),
    )
)
# Each id by itself, for SQLite would rather walk all versions there ever were than sort a list.
OPEN = Query(
    select(FunctionValueRow.id, *VALUE_COLUMNS).where(
        FunctionValueRow.kb_id == KB, in_list(FunctionValueRow.id, "ids")
    )
)
