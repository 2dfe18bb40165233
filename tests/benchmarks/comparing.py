"""Checks that two stores hold the same history, so that their times can be compared."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from sqlalchemy import create_engine, select

from kant_sql import Dto, KnowledgeBase, LogEntry, PddlPropositionDto
from kant_sql.sql.tables import Base

# What no two runs have in common.
OWN = {"committed_at", "hash"}


def compare_results(library: list[Any], bare: list[Any]) -> None:
    """Check that every read gave the same."""
    for mine, theirs in zip(library, bare, strict=True):
        if isinstance(theirs, list):
            assert _texts(mine) == sorted(tuple(row) for row in theirs), (mine, theirs)


def _texts(result: Any) -> list[tuple[object, ...]]:
    """Give what a read of the library gave in the form of the bare driver's rows."""
    if isinstance(result, Dto):
        return [(str(result),)]
    propositions: list[PddlPropositionDto] = result or []
    return sorted((proposition.is_goal, str(proposition)) for proposition in propositions)


def compare_histories(library: KnowledgeBase, bare: KnowledgeBase, name: str) -> None:
    """Check that both hold the same revisions, each with a hash that recomputes."""
    mine, theirs = [*library.log()][::-1], [*bare.log()][::-1]
    assert [*map(_content, mine)] == [*map(_content, theirs)]
    for log in (mine, theirs):
        check_chain(log, name)


def _content(entry: LogEntry) -> tuple[object, ...]:
    revision = entry.revision
    return revision.number, revision.actor, revision.reason, revision.source, entry.changes


def check_chain(log: list[LogEntry], name: str) -> None:
    """Recompute the hash of each revision, oldest first."""
    previous = None
    for entry in log:
        revision = entry.revision
        moment = revision.committed_at.isoformat(timespec="microseconds").replace("+00:00", "Z")
        document = {
            "actor": revision.actor,
            "changes": sorted(entry.changes),
            "committed_at": moment,
            "form": 1,
            "knowledge_base": name,
            "number": revision.number,
            "observed_at": revision.observed_at,
            "plan_step": revision.plan_step,
            "previous": previous,
            "reason": revision.reason,
            "source": revision.source,
        }
        text = json.dumps(document, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
        previous = hashlib.sha256(text.encode()).hexdigest()
        assert revision.hash == previous, f"revision {revision.number} does not recompute"


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
