"""Checks that two stores hold the same history, so that their times can be compared."""

from __future__ import annotations

from typing import Any

from sqlalchemy import create_engine, select

from kant_sql import Dto, KnowledgeBase, LogEntry, PddlPropositionDto
from kant_sql.sql.tables import Base

# What no two runs have in common.
OWN = {"committed_at", "hash", "form", "seed"}


def compare_results(library: list[Any], bare: list[Any]) -> None:
    for mine, theirs in zip(library, bare, strict=True):
        if isinstance(theirs, list):
            assert _texts(mine) == sorted(tuple(row) for row in theirs), (mine, theirs)


def _texts(result: Any) -> list[tuple[object, ...]]:
    """Give what a read of the library gave in the form of the bare driver's rows."""
    if isinstance(result, Dto):
        return [(str(result),)]
    propositions: list[PddlPropositionDto] = result or []
    return sorted((proposition.is_goal, str(proposition)) for proposition in propositions)


def compare_histories(library: KnowledgeBase, bare: KnowledgeBase) -> None:
    """Check that both hold the same revisions, each with a hash that recomputes."""
    mine, theirs = [*library.log()][::-1], [*bare.log()][::-1]
    assert [*map(_content, mine)] == [*map(_content, theirs)]
    for kb in (library, bare):
        assert kb.store.verify().is_intact


def _content(entry: LogEntry) -> tuple[object, ...]:
    revision = entry.revision
    return revision.number, revision.actor, revision.reason, revision.source, entry.changes


def compare_tables(*urls: str) -> None:
    """Check that all tables of two databases have the same rows."""
    stores = [_rows(url) for url in urls]
    for table, rows in stores[0].items():
        assert rows == stores[1][table], f"the rows of {table} differ"


def _rows(url: str) -> dict[str, list[tuple[Any, ...]]]:
    engine = create_engine(url)
    rows = {}
    with engine.connect() as connection:
        for table in Base.metadata.sorted_tables:
            columns = [column for column in table.c if column.name not in OWN]
            found = connection.execute(select(*columns).order_by(*table.primary_key))
            rows[table.name] = [tuple(row) for row in found]
    engine.dispose()
    return rows
