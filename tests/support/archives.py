"""Compares a store, its archive and its replica, row by row."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Boolean, Table, Text, bindparam, cast, select

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.intervals import fork
from kant_sql.sql.query import Query
from kant_sql.sql.tables import Base, KnowledgeBaseRow
from kant_sql.sql.tables.base import UtcTime
from tests.support.worlds import counter

Row = tuple[Any, ...]
Rows = dict[str, Counter[Row]]

TABLES = [table for table in Base.metadata.sorted_tables if "kb_id" in table.c]
VERSIONS = [table for table in TABLES if "until" in table.c]
# Names stay in the store and are copied with the rows that refer to them; atoms when needed.
IDENTITIES = {
    *("type", "object", "predicate", "function", "action", "formula", "rule", "document"),
    *("proposition", "proposition_argument", "function_value", "function_value_argument"),
}
_KB = Query(select(KnowledgeBaseRow.id).where(KnowledgeBaseRow.name == bindparam("name")))


def target_url(folder: Path, name: str = "archive.db") -> str:
    return f"sqlite:///{folder / name}"


def damage(url: str, *statements: str) -> None:
    """Change a file by hand."""
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as bare:
        for statement in statements:
            assert bare.execute(statement).rowcount > 0
        bare.commit()


def rows_of(url: str, name: str = "tiago") -> Rows:
    """Return all rows of a knowledge base, without its id, by table."""
    with closing(create_backend(url)) as backend, backend.open_session() as session:
        session.begin(write=False)
        found = session.rows(_KB, name=name)
        kb_id = found[0][0] if found else None
        rows: Rows = {}
        for table in TABLES:
            columns = [column for column in table.columns if column.name != "kb_id"]
            read = [cast(c, Text) if c.name == "source" else c for c in columns]
            query = Query(select(*read).where(table.c.kb_id == bindparam("kb")))
            rows[table.name] = Counter(
                tuple(
                    bool(value)
                    if isinstance(column.type, Boolean)
                    else session.to_time(value)
                    if isinstance(column.type, UtcTime) and value is not None
                    else value
                    for column, value in zip(columns, row, strict=True)
                )
                for row in session.rows(query, kb=kb_id)
            )
        session.rollback()
    return rows


def _place(table: Table, column: str) -> int:
    return [c.name for c in table.columns if c.name != "kb_id"].index(column)


def versions_upto(rows: Rows, upto: int) -> Rows:
    """Return the versions up to a revision, as they were at it."""
    return {
        table.name: Counter(
            _as_of(table, row, upto)
            for row in rows[table.name]
            if row[_place(table, "since")] <= upto
        )
        for table in VERSIONS
    }


def _as_of(table: Table, row: Row, upto: int) -> Row:
    values = list(row)
    until = _place(table, "until")
    if values[until] is not None and values[until] > upto:
        values[until] = None
        if "fork" in table.c:
            values[_place(table, "fork")] = fork(0, None)
    return tuple(values)


def versions_after(rows: Rows, upto: int) -> Rows:
    """Return the versions that had not ended at a revision; of executions, all outcomes."""
    return {
        table.name: Counter(
            row
            for row in rows[table.name]
            if table.name == "execution_version"
            or row[_place(table, "until")] is None
            or row[_place(table, "until")] > upto
        )
        for table in VERSIONS
    }


def versions_of(rows: Rows) -> Rows:
    return {table.name: rows[table.name] for table in VERSIONS}


class State(NamedTuple):
    """A state as documents."""

    domain: str
    problem: str


def states(kb: KnowledgeBase, revisions: Iterable[int]) -> dict[int, State]:
    """Return the states of a knowledge base at some revisions."""
    found = {}
    for revision in revisions:
        then = kb.at(revision)
        found[revision] = State(then.domain_pddl(), then.problem_pddl())
    return found


def intact(url: str, name: str = "tiago") -> None:
    """Check that a store verifies."""
    with kant_sql.connect(url, knowledge_base=name) as kb:
        verification = kb.store.verify()
    assert verification.is_intact, verification.findings


def count(kb: KnowledgeBase, upto: int) -> None:
    """Count until the knowledge base reaches a revision."""
    if not kb.revision:
        counter.start(kb)
    counter.increment(kb, upto - kb.revision)


# The head of a replica names its origin; each store has its own verification.
OWN = {"head", "verification"}
SAME = ("revision", "definition_revision", "next_id", "hash", "committed_at")


def _known(rows: Rows, table: Table) -> Counter[Row]:
    """Return the rows of a table without those of elements that never held.

    An element that one transaction asserts and retracts leaves an identity, which is not knowledge.
    """
    owner = table.name.removesuffix("_argument")
    version = next((other for other in VERSIONS if other.name == f"{owner}_version"), None)
    key = "id" if owner == table.name else f"{owner}_id"
    if version is None or key not in table.columns:
        return rows[table.name]
    place, of = _place(table, key), _place(version, f"{owner}_id")
    held = {row[of] for row in rows[version.name]}
    return Counter({row: n for row, n in rows[table.name].items() if row[place] in held})


def equal_histories(source: str, target: str, name: str = "tiago") -> None:
    """Check that a replica has the same rows of a knowledge base as its source."""
    here, there = rows_of(source, name), rows_of(target, name)
    for table in TABLES:
        if table.name not in OWN:
            assert there[table.name] == _known(here, table), table.name
    places = [_place(Base.metadata.tables["head"], column) for column in SAME]
    one, other = (
        [[row[place] for place in places] for row in rows["head"]] for rows in (here, there)
    )
    assert one == other
