"""The questions about the values of functions, now and in the past.

Each row of an answer has the fluent's id, its function's, the ids of its objects separated by
spaces, and the number as text or the id of the object that it is.
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Text,
    bindparam,
    cast,
    literal_column,
    null,
    select,
)

from ..knowledge.loading import KB
from ..knowledge.past import ANY_FUNCTION, held_then
from ..tables import FunctionValueRow, FunctionValueVersionRow
from .reading import Reading

_ARGUMENTS = (
    select(FunctionValueRow.arguments)
    .where(FunctionValueRow.kb_id == FunctionValueVersionRow.kb_id)
    .where(FunctionValueRow.id == FunctionValueVersionRow.function_value_id)
    .scalar_subquery()
)
_ROWS = select(
    FunctionValueVersionRow.function_value_id,
    FunctionValueVersionRow.function_id,
    _ARGUMENTS,
    FunctionValueVersionRow.value,
    FunctionValueVersionRow.object_id,
).where(FunctionValueVersionRow.kb_id == KB)


def _reading(*conditions: ColumnElement[bool]) -> Reading:
    now = _ROWS.where(FunctionValueVersionRow.until.is_(None), *conditions)
    then = _ROWS.where(held_then(FunctionValueVersionRow), *(conditions or (ANY_FUNCTION,)))
    return Reading(now, then, literal_column("''"), cast(null(), Text), cast(null(), BigInteger))


_FLUENT = (
    select(FunctionValueRow.id)
    .where(FunctionValueRow.kb_id == KB)
    .where(FunctionValueRow.function_id == bindparam("function"))
    .where(FunctionValueRow.arguments == bindparam("arguments"))
    .correlate(None)
    .scalar_subquery()
)
ALL = _reading()
OF_FUNCTION = _reading(FunctionValueVersionRow.function_id == bindparam("function"))
OF_FLUENT = _reading(FunctionValueVersionRow.function_value_id == _FLUENT)
