"""Rows that are of no knowledge base."""

from __future__ import annotations

from sqlalchemy import BigInteger, bindparam, exists, func, literal_column, select, union_all

from ..backends import Query, Session
from ..knowledge.loading import KB
from ..knowledge.rows import table_of
from ..tables import Base, KnowledgeBaseRow
from .checkpoints import LARGEST, SMALLEST
from .findings import Report

_KB = table_of(KnowledgeBaseRow).c


def _strays() -> Query:
    """Find the tables that have rows of a range of knowledge bases: by their indexes."""
    tables = [table for table in Base.metadata.sorted_tables if "kb_id" in table.c]
    low, high = (bindparam(name, type_=BigInteger) for name in ("low", "high"))
    return Query(
        union_all(
            *(
                select(literal_column(f"'{table.name}'")).where(
                    exists(select(table.c.kb_id).where(table.c.kb_id.between(low, high)))
                )
                for table in tables
            )
        )
    )


_STRAYS = _strays()
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
    ranges = []
    if kb_id is not None:
        ranges.append((kb_id + 1, LARGEST if following is None else following - 1))
    if first is None or kb_id == first:
        ranges.append((SMALLEST, LARGEST if kb_id is None else kb_id - 1))
    for low, high in ranges:
        for (table,) in session.rows(_STRAYS, low=low, high=high) if low <= high else ():
            report.add(None, table, f"{table} has rows of a knowledge base that there is not")
