"""Rows that are of no knowledge base, and values that are of no type."""

from __future__ import annotations

from itertools import product
from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    bindparam,
    exists,
    func,
    literal_column,
    select,
    union_all,
)

from ..backends import Query, Session
from ..backends.structure import wrong_values
from ..knowledge.loading import KB
from ..knowledge.rows import table_of
from ..tables import Base, KnowledgeBaseRow
from .findings import Report

_KB = table_of(KnowledgeBaseRow).c
_TABLES = tuple(Base.metadata.sorted_tables)


def _strays(has_low: bool, has_high: bool) -> Query:
    """Find the tables that have rows of a range of knowledge bases, its ends apart.

    What no number is, SQLite has behind all numbers.
    """
    tables = [table for table in _TABLES if "kb_id" in table.c]
    low, high = (bindparam(name, type_=BigInteger) for name in ("low", "high"))

    def within(kb_id: Any) -> list[ColumnElement[bool]]:
        bounds = [kb_id > low] * has_low + [kb_id < high] * has_high
        return bounds or [kb_id.is_not(None)]

    return Query(
        union_all(
            *(
                select(literal_column(f"'{table.name}'")).where(
                    exists(select(table.c.kb_id).where(*within(table.c.kb_id)))
                )
                for table in tables
            )
        )
    )


_STRAYS = {bounds: _strays(*bounds) for bounds in product((False, True), repeat=2)}
_NEXT = select(func.min(_KB.id)).where(_KB.id > KB).scalar_subquery()
_AROUND = Query(select(select(func.min(_KB.id)).scalar_subquery(), _NEXT))


def check_strays(session: Session, kb_id: int | None, report: Report) -> None:
    """Find rows that are of no knowledge base, next to those of one.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base; None when there is none.
        report: takes what is wrong.
    """
    first, following = session.rows(_AROUND, kb=0 if kb_id is None else kb_id)[0]
    ranges: list[tuple[int | None, int | None]] = []
    if kb_id is not None:
        ranges.append((kb_id, following))
    if first is None or kb_id == first:
        ranges.append((None, kb_id))
    for bounds in ranges:
        query = _STRAYS[bounds[0] is not None, bounds[1] is not None]
        for (table,) in session.rows(query, low=bounds[0], high=bounds[1]):
            report.add(None, table, f"{table} has rows of a knowledge base that there is not")


def check_types(session: Session, kb_id: int, report: Report) -> None:
    """Find values of another type than that of their column: SQLite keeps any in any column.

    Args:
        session: the session, in a transaction.
        kb_id: the knowledge base.
        report: takes what is wrong.
    """
    for table, column, count in wrong_values(session, _TABLES, kb_id):
        values = "1 value" if count == 1 else f"{count} values"
        report.add(None, table, f"column {column} has {values} that are not of its type")
