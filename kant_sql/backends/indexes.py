"""Whether each index of a table has what the table has: read in full, one beside the other.

What an index leaves out, no query finds that the database answers by it. Once each index has what
its table has, it does not matter which of them a query is answered by.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import Any, NamedTuple

from ..errors import StoreError
from .query import raw
from .session import Session

# By these settings the server reads the tables themselves, by the others nothing but the indexes.
_TABLES_ONLY = ("enable_indexscan", "enable_indexonlyscan", "enable_bitmapscan")
_INDEXES_ONLY = ("enable_seqscan", "enable_bitmapscan", "enable_sort", "enable_incremental_sort")
# What a sorted index has as its keys is read without a look at the table. In a hash there are no
# keys to read.
_WAYS = {"btree": (*_INDEXES_ONLY, "enable_indexscan"), "hash": _INDEXES_ONLY}
_PLAIN = "SET LOCAL jit = off; SET LOCAL max_parallel_workers_per_gather = 0"

_INDEXES = """
SELECT row_number() OVER (), x.oid, x.relname, c.relname, a.amname,
    pg_get_expr(i.indpred, i.indrelid), ARRAY(
    SELECT pg_get_indexdef(i.indexrelid, n, true)
    FROM generate_series(1, i.indnkeyatts) AS n ORDER BY n
)
FROM pg_index AS i
JOIN pg_class AS c ON c.oid = i.indrelid
JOIN pg_class AS x ON x.oid = i.indexrelid
JOIN pg_am AS a ON a.oid = x.relam
WHERE c.oid = ANY(ARRAY[{tables}]::regclass[]) AND c.relkind = 'r'
    AND i.indisvalid AND i.indisready AND i.indislive
    AND a.amname IN ('btree', 'hash') AND i.indexprs IS NULL
"""
# The extension amcheck reads an index page by page, where it is installed and may be used.
_CHECKER = """
SELECT p.oid::regproc::text FROM pg_proc AS p
WHERE p.proname = 'bt_index_check' AND pg_function_is_visible(p.oid)
    AND pg_get_function_identity_arguments(p.oid) ~ '^[^,]*regclass, [^,]*boolean$'
    AND has_function_privilege(p.oid, 'EXECUTE')
"""


class IndexFault(NamedTuple):
    """What is wrong with an index, or with the table under it.

    Attributes:
        table: the table.
        message: what is wrong.
    """

    table: str
    message: str


# Of each index, by its number: how many rows it has, and the sum of what is hashed of their keys.
_Found = dict[int, tuple[int, Any]]


class _Index(NamedTuple):
    number: int
    oid: int
    name: str
    table: str
    method: str
    condition: str | None
    columns: list[str]

    def counts(self) -> str:
        """Write what is counted of the table, and the sum of what is hashed of each key."""
        where = "" if self.condition is None else f" FILTER (WHERE {self.condition})"
        digest = self.digest() if self.method == "btree" else "NULL::numeric"
        return f"count(*){where}, {digest}{where if self.method == 'btree' else ''}"

    def digest(self) -> str:
        return f"sum(hash_record_extended(ROW({', '.join(self.columns)}), 0))"

    def reading(self) -> str:
        """Write the query that gives the same numbers by the index."""
        columns = ", ".join(self.columns)
        if self.method == "btree":
            where = "" if self.condition is None else f" WHERE {self.condition}"
            keys = f"SELECT {columns} FROM {self.table}{where} ORDER BY {columns}"
            return f"SELECT {self.number}, count(*), {self.digest()} FROM ({keys}) AS keys"
        # It is not sorted: each value is looked up, and the rows are counted that are found.
        return (
            f"SELECT {self.number}, coalesce(sum(found), 0), NULL::numeric "
            f"FROM (SELECT DISTINCT {columns} AS value FROM {self.table}) AS wanted "
            f"CROSS JOIN LATERAL (SELECT count(*) AS found FROM {self.table} AS t "
            f"WHERE t.{columns} = wanted.value) AS looked_up"
        )


def index_faults(session: Session, tables: Sequence[str]) -> Iterator[IndexFault]:
    """Compare the indexes of some tables with the tables.

    It takes a time that grows with what the tables hold, of all knowledge bases, and no memory.

    Args:
        session: the session, in a transaction.
        tables: the tables; those that there are not are left out.

    Yields:
        What is wrong.
    """
    check = _sqlite if session.backend.dialect.name == "sqlite" else _postgresql
    yield from check(session, tables)


def _run(session: Session, sql: str) -> list[Any]:
    return session.rows(raw(sql))


def _sqlite(session: Session, tables: Sequence[str]) -> Iterator[IndexFault]:
    there = {row[0] for row in _run(session, "SELECT name FROM sqlite_master WHERE type = 'table'")}
    for table in tables:
        if table in there:
            for (message,) in _run(session, f'PRAGMA integrity_check("{table}")'):
                if message != "ok":
                    yield IndexFault(table, f"the database itself finds: {message}")


def _postgresql(session: Session, tables: Sequence[str]) -> Iterator[IndexFault]:
    indexes = _indexes_of(session, tables)
    if indexes:
        had = _numbers(session, _TABLES_ONLY, _by_tables(indexes))
        found = _by_indexes(session, indexes)
        for index in indexes:
            # What the server does not use even now, it uses for no other question.
            if index.number in found and found[index.number] != had[index.number]:
                yield IndexFault(index.table, _difference(index, had, found))
        yield from _amcheck(session, indexes)


def _indexes_of(session: Session, tables: Sequence[str]) -> list[_Index]:
    names = ", ".join(f"to_regclass('{table}')" for table in tables)
    return [_Index(*row) for row in _run(session, _INDEXES.replace("{tables}", names))]


def _difference(index: _Index, had: _Found, found: _Found) -> str:
    in_table, in_index = had[index.number][0], found[index.number][0]
    what = (
        f"has {in_index} of the {in_table} rows that the table has for it"
        if in_table != in_index
        else f"has other keys than the {in_table} rows that the table has for it"
    )
    return (
        f"index {index.name} {what}, so questions that are answered by it have wrong answers; make "
        f"it again with: REINDEX INDEX {index.name}"
    )


def _by_tables(indexes: list[_Index]) -> str:
    """Write the query that gives the numbers of each index by reading its table once."""
    parts = []
    for table, group in groupby(sorted(indexes, key=lambda each: each.table), _table_of):
        of_table = [*group]
        counts = ", ".join(index.counts() for index in of_table)
        names = ", ".join(f"n{n}, s{n}" for n in range(len(of_table)))
        values = ", ".join(f"({index.number}, n{n}, s{n})" for n, index in enumerate(of_table))
        parts.append(
            f"SELECT v.* FROM (SELECT {counts} FROM {table}) AS t ({names}) "
            f"CROSS JOIN LATERAL (VALUES {values}) AS v"
        )
    return " UNION ALL ".join(parts)


def _table_of(index: _Index) -> str:
    return index.table


def _by_indexes(session: Session, indexes: list[_Index]) -> _Found:
    """Give the numbers of those indexes by which the server can be made to answer."""
    numbers: _Found = {}
    for method, off in _WAYS.items():
        chosen = [index for index in indexes if index.method == method]
        if chosen:
            query = " UNION ALL ".join(index.reading() for index in chosen)
            with _settings(session, off):
                ((plan,),) = _run(session, f"EXPLAIN (FORMAT JSON, COSTS OFF) {query}")
            used, found = {*_used(plan)}, _numbers(session, off, query)
            numbers |= {each.number: found[each.number] for each in chosen if each.name in used}
    return numbers


def _used(plan: Any) -> Iterator[str]:
    """Find the indexes that a plan names."""
    if isinstance(plan, dict):
        if "Index Name" in plan:
            yield plan["Index Name"]
        plan = [*plan.values()]
    if isinstance(plan, list):
        for part in plan:
            yield from _used(part)


def _numbers(session: Session, off: Iterable[str], query: str) -> _Found:
    with _settings(session, off):
        return {number: (int(count), digest) for number, count, digest in _run(session, query)}


@contextmanager
def _settings(session: Session, off: Iterable[str]) -> Iterator[None]:
    """Switch off ways to answer a question, for a while."""
    savepoint = session.savepoint()
    try:
        session.define("; ".join([_PLAIN, *(f"SET LOCAL {name} = off" for name in off)]))
        yield
    finally:
        session.rollback_to(savepoint)


def _amcheck(session: Session, indexes: list[_Index]) -> Iterator[IndexFault]:
    """Let the extension amcheck read each index, where it may."""
    for (function,) in _run(session, _CHECKER)[:1]:
        for index in (each for each in indexes if each.method == "btree"):
            savepoint, fault = session.savepoint(), None
            try:
                _run(session, f"SELECT {function}({index.oid}::regclass, true)")
            except StoreError as error:
                # The others are of the connection.
                if type(error) is not StoreError:
                    raise
                fault = IndexFault(index.table, f"index {index.name}: {error}")
            session.rollback_to(savepoint)
            if fault is not None:
                yield fault
