"""Compares indexes, constraints and views with the migrations, and finds stray rows.

With other indexes or views, the library or an auditor reads data that differs from the tables.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import product, takewhile
from typing import Any

from sqlalchemy import ColumnElement, exists, func, select, union_all

from ...sql.dialects.base import Session
from ...sql.dialects.structure import Statement
from ...sql.predicate_views import replaced_views
from ...sql.query import Query, constant, integer
from ...sql.rows import KB, table_of
from ...sql.schema import recorded
from ...sql.tables import Base, KnowledgeBaseRow
from .sides import Report

TABLES = tuple(sorted(Base.metadata.tables))
# The maximum number of a statement's characters in a message.
_SHOWN = 200


def check_structure(session: Session, report: Report) -> None:
    """Compare tables, constraints, indexes and views with those of the migrations."""
    # Other objects in the database only count if they belong to a table or view of the library.
    dialect = session.backend.dialect.name
    expected = {
        each.head: each for each in recorded(dialect) if not each.head.startswith("COMMENT")
    }
    names = {each.relation for each in expected.values() if each.relation is not None}
    live: defaultdict[str, list[Statement]] = defaultdict(list)
    for each in session.describe(names):
        if not each.head.startswith("COMMENT"):
            live[each.head].append(each)
    for head, made in expected.items():
        if head not in live:
            report.add(None, made.relation, f"{_shown(head)} is missing: the migrations create it")
    for head, found in live.items():
        for each in found if head not in expected else found[1:]:
            what = each.text if head.startswith("CREATE") else head.removeprefix("-- ")
            message = f"the migrations do not create this: {_shortened(what)}"
            report.add(None, each.relation, message)
        if head in expected and found[0].text != expected[head].text:
            message = _difference(expected[head].text, found[0].text)
            report.add(None, found[0].relation, f"{_shown(head)} was changed: {message}")


def check_generated(session: Session, kb_id: int | None, report: Report) -> None:
    """Compare generated views with their marks, and find other objects in their place."""
    for view, predicate in replaced_views(session, kb_id):
        report.add(
            None,
            view,
            f"{view} is not the view that 'kant-sql views' creates of predicate {predicate!r}; "
            "drop or rename it, and create the view again with 'kant-sql views'",
        )
    for view in session.backend.views.list_altered(session.rows_of):
        report.add(
            None,
            view,
            f"view {view} differs from the one that 'kant-sql views' created; drop it with "
            "'kant-sql views --drop', and create it again with 'kant-sql views'",
        )


def check_indexes(session: Session, report: Report) -> None:
    """Compare each index with its table."""
    for fault in session.index_faults(TABLES):
        report.add(None, fault.table, fault.message)


def _shown(head: str) -> str:
    return head.removeprefix("CREATE ").lower()


def _shortened(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _SHOWN else f"{line[:_SHOWN]} ..."


def _difference(expected: str, found: str) -> str:
    """Show the first lines in which two texts differ."""
    made, there = expected.splitlines(), found.splitlines()
    instead = [
        next((line.strip(" ,;") for line in lines if line not in others), "the same in other order")
        for lines, others in ((made, {*there}), (there, {*made}))
    ]
    # If long lines begin alike, the beginning shows nothing.
    begin = 0
    if max(map(len, instead)) > _SHOWN:
        alike = takewhile(lambda pair: pair[0] == pair[1], zip(*instead, strict=False))
        begin = instead[0].rfind(" ", 0, sum(1 for _ in alike)) + 1
    expected, found = (f"{'... ' * bool(begin)}{_shortened(line[begin:])}" for line in instead)
    return f"expected {expected!r}, found {found!r}"


_KB = table_of(KnowledgeBaseRow).c
_TABLES = tuple(Base.metadata.sorted_tables)


def _strays(has_low: bool, has_high: bool) -> Query:
    """Find the tables with rows of knowledge bases between two."""
    # SQLite sorts values that are not numbers after all numbers.
    tables = [table for table in _TABLES if "kb_id" in table.c]
    low, high = map(integer, ("low", "high"))

    def within(kb_id: Any) -> list[ColumnElement[bool]]:
        bounds = [kb_id > low] * has_low + [kb_id < high] * has_high
        return bounds or [kb_id.is_not(None)]

    return Query(
        union_all(
            *(
                select(constant(table.name)).where(
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
    """Find rows without a knowledge base, next to those of one."""
    first, following = session.rows(_AROUND, kb=0 if kb_id is None else kb_id)[0]
    ranges: list[tuple[int | None, int | None]] = []
    if kb_id is not None:
        ranges.append((kb_id, following))
    if first is None or kb_id == first:
        ranges.append((None, kb_id))
    for bounds in ranges:
        query = _STRAYS[bounds[0] is not None, bounds[1] is not None]
        for (table,) in session.rows(query, low=bounds[0], high=bounds[1]):
            report.add(None, table, f"{table} has rows of a missing knowledge base")


def check_types(session: Session, kb_id: int, report: Report) -> None:
    """Find values that do not have their column's type."""
    for table, column, count in session.wrong_values(_TABLES, kb_id):
        values = "1 value" if count == 1 else f"{count} values"
        report.add(None, table, f"column {column} has {values} that are not of its type")
