"""Which values of functions depend on what: for deletes that cascade, and redefinitions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sqlalchemy import Select, select, union_all

from ..backends import Query, in_list, in_rows
from ..fluents import Fluent, FluentKey, HeldValue, read_value
from ..knowledge.function_value import VALUE_COLUMNS
from ..knowledge.loading import KB
from ..knowledge.tree import Mentioned
from ..tables import FunctionValueArgumentRow, FunctionValueRow, FunctionValueVersionRow
from ..transaction import Transaction

_LIVE = select(FunctionValueVersionRow.function_value_id).where(
    FunctionValueVersionRow.kb_id == KB, FunctionValueVersionRow.until.is_(None)
)
_MENTIONING = select(FunctionValueArgumentRow.function_value_id).where(
    FunctionValueArgumentRow.kb_id == KB, in_list(FunctionValueArgumentRow.object_id, "ids")
)


def _values(versions: Select[Any]) -> Select[Any]:
    return select(
        FunctionValueRow.id,
        FunctionValueRow.function_id,
        FunctionValueRow.arguments,
        FunctionValueRow.text,
        *VALUE_COLUMNS,
    ).where(FunctionValueRow.kb_id == KB, in_rows(FunctionValueRow.id, versions))


_ALL = Query(_values(_LIVE))
_OF_FUNCTIONS = Query(_values(_LIVE.where(in_list(FunctionValueVersionRow.function_id, "ids"))))
_OF_OBJECTS = Query(
    union_all(
        # With those that have no value now, which are few: SQLite would go through all live ones.
        _values(_MENTIONING),
        _values(_LIVE.where(in_list(FunctionValueVersionRow.object_id, "ids"))),
    )
)


def function_values_on(transaction: Transaction, scope: Mentioned | None) -> list[HeldValue]:
    """Find the live values that mention something.

    Args:
        transaction: the transaction.
        scope: the functions, and the objects as arguments or values, that they may mention; None
            for all values.

    Returns:
        The values, each once, in the order in which their fluents were first known.
    """
    if next(iter(transaction.definitions.functions), None) is None:
        return []
    transaction.flush()
    session, kb = transaction.session, transaction.kb_id
    rows = session.rows(_ALL, kb=kb) if scope is None else []
    if scope is not None:
        for query, ids in ((_OF_FUNCTIONS, scope.functions), (_OF_OBJECTS, scope.objects)):
            if ids:
                rows += session.rows(query, kb=kb, ids=session.list_value(sorted(ids)))
    found = {
        id_: HeldValue(
            Fluent(id_, FluentKey(function_id, arguments), text), read_value(text, held, object_id)
        )
        for id_, function_id, arguments, text, held, object_id in rows
        if held is not None
    }
    return [found[id_] for id_ in sorted(found)]


def retract_function_values(transaction: Transaction, held: Iterable[HeldValue]) -> None:
    """Let fluents have no value any more.

    Args:
        transaction: the transaction.
        held: the fluents with their values, as `function_values_on` found them.
    """
    transaction.values.unset(held)
