"""The schema of a PostgreSQL store: a description, a check of its indexes, generated views.

A query that the server answers by an index does not find rows that are missing in that index. If
each index agrees with its table, it does not matter which one answers. Plugins of extensions put
tables on several servers (nodes).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple, Protocol

from sqlalchemy import Connection, text
from sqlalchemy.dialects.postgresql.base import PGDialect

from ...errors import StoreError
from ...plugins import Plugins
from ..tables.base import VERSION_TABLE
from .base import Row, Session
from .structure import (
    MARK,
    MARKED,
    IndexFault,
    Mark,
    Rows,
    Statement,
    ViewDialect,
    parenthesized,
    parse_statement,
)

# The schema of the version table, or that of new tables.
_SCHEMA = (
    f"coalesce((SELECT relnamespace FROM pg_class WHERE oid = to_regclass('{VERSION_TABLE}')),"
    " current_schema()::regnamespace)"
)
_SCHEMA_OF_TABLES = text(
    "SELECT n.nspname FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace "
    f"WHERE c.oid = to_regclass('{VERSION_TABLE}')"
)
# Where the search path has another view of that name first, a view names the schema of those it
# reads.
_RELATIONS = """
SELECT c.relname, c.relkind::text, quote_literal(obj_description(c.oid, 'pg_class')),
    CASE WHEN c.relkind = 'v' THEN replace(
        pg_get_viewdef(c.oid, true), concat(' ', c.relnamespace::regnamespace, '.audit_'), ' audit_'
    ) END,
    quote_literal(c.reloptions::text)
FROM pg_class AS c
WHERE c.relkind IN ('r', 'p', 'v', 'm', 'f') AND {which}
ORDER BY c.relname COLLATE "C"
"""
_COLUMNS = """
SELECT c.relname, quote_ident(a.attname), format_type(a.atttypid, a.atttypmod),
    CASE WHEN a.attcollation <> t.typcollation THEN l.collname END,
    pg_get_expr(d.adbin, d.adrelid), a.attnotnull, concat(a.attidentity, a.attgenerated),
    quote_literal(col_description(a.attrelid, a.attnum))
FROM pg_attribute AS a
JOIN pg_class AS c ON c.oid = a.attrelid
JOIN pg_type AS t ON t.oid = a.atttypid
LEFT JOIN pg_collation AS l ON l.oid = a.attcollation
LEFT JOIN pg_attrdef AS d ON d.adrelid = a.attrelid AND d.adnum = a.attnum
WHERE c.relkind IN ('r', 'p', 'v', 'm', 'f') AND {which}
    AND a.attnum > 0 AND NOT a.attisdropped
ORDER BY c.relname COLLATE "C", a.attnum
"""
# NOT NULL is a constraint only in new versions of PostgreSQL: the columns show it.
_CONSTRAINTS = """
SELECT c.relname, k.conname, pg_get_constraintdef(k.oid)
FROM pg_constraint AS k JOIN pg_class AS c ON c.oid = k.conrelid
WHERE {which} AND k.contype <> 'n' ORDER BY c.relname COLLATE "C", k.conname COLLATE "C"
"""
# WITH is about storage only. An index that is not valid is not used.
_INDEXES = """
SELECT c.relname, x.relname, regexp_replace(
    regexp_replace(
        pg_get_indexdef(i.indexrelid), ' ON (ONLY )?("[^"]*"|[^".]*)[.]', ' ON \\1public.'
    ), ' WITH [(][^)]*[)]', ''
) || CASE WHEN i.indisvalid AND i.indisready AND i.indislive THEN '' ELSE ' -- not valid' END
FROM pg_index AS i
JOIN pg_class AS c ON c.oid = i.indrelid
JOIN pg_class AS x ON x.oid = i.indexrelid
WHERE {which} AND NOT EXISTS (
    SELECT FROM pg_constraint AS k WHERE k.conindid = i.indexrelid AND k.conrelid = i.indrelid
)
ORDER BY c.relname COLLATE "C", x.relname COLLATE "C"
"""
# Objects that no migration creates, with their table or view. Auditors of one knowledge base may
# find their own views before those of all.
_OTHERS = """
SELECT c.relname, 'trigger ' || t.tgname || ' on ' || c.relname
FROM pg_trigger AS t JOIN pg_class AS c ON c.oid = t.tgrelid WHERE NOT t.tgisinternal AND {which}
UNION ALL
SELECT c.relname, 'disabled check of a foreign key of ' || c.relname
FROM pg_trigger AS t JOIN pg_class AS c ON c.oid = t.tgrelid
WHERE t.tgisinternal AND t.tgenabled <> 'O' AND {which} GROUP BY c.relname
UNION ALL
SELECT c.relname, 'rule ' || r.rulename || ' on ' || c.relname
FROM pg_rewrite AS r JOIN pg_class AS c ON c.oid = r.ev_class
WHERE NOT (r.rulename = '_RETURN' AND c.relkind IN ('v', 'm')) AND {which}
UNION ALL
SELECT c.relname, 'policy ' || p.polname || ' on ' || c.relname
FROM pg_policy AS p JOIN pg_class AS c ON c.oid = p.polrelid
WHERE NOT starts_with(p.polname, 'kant_sql_') AND {which}
UNION ALL
SELECT c.relname, 'forced row security on ' || c.relname
FROM pg_class AS c WHERE c.relforcerowsecurity AND {which}
UNION ALL
SELECT c.relname, 'table ' || h.inhrelid::regclass || ', whose rows are read as those of '
    || c.relname
FROM pg_inherits AS h JOIN pg_class AS c ON c.oid = h.inhparent WHERE c.relkind <> 'i' AND {which}
UNION ALL
SELECT c.relname, 'table without a log, which loses its rows in a crash: ' || c.relname
FROM pg_class AS c WHERE c.relpersistence <> 'p' AND c.relkind IN ('r', 'p') AND {which}
UNION ALL
SELECT c.relname, 'relation that statements find in its place: ' || n.nspname || '.' || c.relname
FROM pg_class AS c JOIN pg_class AS found ON found.oid = to_regclass(quote_ident(c.relname))
JOIN pg_namespace AS n ON n.oid = found.relnamespace
WHERE c.relkind IN ('r', 'v') AND found.oid <> c.oid AND {which} AND NOT (
    c.relkind = 'v' AND starts_with(n.nspname, 'kant_sql_') AND found.relkind = 'v' AND EXISTS (
        SELECT FROM pg_rewrite AS r JOIN pg_depend AS d ON d.objid = r.oid
            AND d.classid = 'pg_rewrite'::regclass AND d.refclassid = 'pg_class'::regclass
        WHERE r.ev_class = found.oid AND d.refobjid = c.oid
    )
)
UNION ALL
SELECT c.relname, 'relation that statements find in its place: none' FROM pg_class AS c
WHERE c.relkind IN ('r', 'v') AND to_regclass(quote_ident(c.relname)) IS NULL AND {which}
ORDER BY 2
"""
# Schemas before pg_catalog in the search path can replace the system's functions.
_BEFORE_SYSTEM = """
SELECT name FROM unnest(current_schemas(true)) WITH ORDINALITY AS s (name, place)
WHERE place < array_position(current_schemas(true), 'pg_catalog')
    AND NOT starts_with(name, 'pg_temp')
"""
# Other objects in the schema of the tables.
_LOOSE = f"""
SELECT c.relkind::text || ' ' || c.relname FROM pg_class AS c
WHERE c.relnamespace = {_SCHEMA} AND c.relkind NOT IN ('r', 'p', 'i', 'I', 'v')
UNION ALL SELECT 'function ' || proname FROM pg_proc WHERE pronamespace = {_SCHEMA}
ORDER BY 1
"""
_WORD = re.compile(r"'(?:[^']|'')*'::character varying")
# A list in which each word is converted, as constraints and as views show it, and what stood there.
_LISTS = (
    (
        re.compile(rf"\(ARRAY\[((?:\({_WORD.pattern}\)::text(?:, (?=\())?)+)\]\)"),
        *("((ARRAY[", "])::text[])"),
    ),
    (
        re.compile(rf"ARRAY\[((?:{_WORD.pattern}::text(?:, (?='))?)+)\]"),
        *("ARRAY[", "]::text[]"),
    ),
)
_KINDS = {"r": "TABLE", "p": "PARTITIONED TABLE", "m": "MATERIALIZED VIEW", "f": "FOREIGN TABLE"}


def describe(rows: Rows, names: Collection[str] | None = None) -> Iterator[Statement]:
    """Describe a schema, or some tables and views with all that belongs to them."""
    which = f"c.relnamespace = {_SCHEMA}"
    if names is not None:
        listed = ", ".join(f"'{name}'" for name in sorted(names))
        which += f" AND c.relname IN ({listed})"

    def grouped(sql: str) -> dict[str, list[Row]]:
        found = groupby(rows(sql.replace("{which}", which)), key=lambda row: str(row[0]))
        return {name: [row[1:] for row in group] for name, group in found}

    relations = rows(_RELATIONS.replace("{which}", which))
    columns, constraints, indexes = map(grouped, (_COLUMNS, _CONSTRAINTS, _INDEXES))
    for name, kind, comment, *_ in relations:
        if kind != "v":
            of = columns.get(name, []), constraints.get(name, []), indexes.get(name, [])
            yield from (parse_statement(part, name) for part in _table(name, kind, comment, *of))
    for name, kind, _, definition, options in relations:
        if kind == "v":
            yield parse_statement(_view(name, columns.get(name, []), definition, options), name)
    for relation, what in rows(_OTHERS.replace("{which}", which)):
        yield parse_statement(f"-- {what}", relation)
    if names is None:
        yield from (parse_statement(f"-- {row[0]}") for row in rows(_LOOSE))
    for (schema,) in rows(_BEFORE_SYSTEM):
        yield parse_statement(
            f"-- schema {schema}, which the search path has before the system's own"
        )


def as_created(definition: str) -> str:
    """Write lists of words as a migration creates them, also after pg_restore.

    pg_dump writes `IN ('a', 'b')` with a conversion of the list; restored, each word is converted.
    """
    for each_word, before, after in _LISTS:
        definition = each_word.sub(
            lambda found, before=before, after=after: (  # type: ignore[misc]
                f"{before}{', '.join(_WORD.findall(found[1]))}{after}"
            ),
            definition,
        )
    return definition


def _view(name: str, columns: list[Row], definition: str, options: str | None) -> str:
    shown = [
        f"{column} {type_}" + (f' COLLATE "{collation}"' if collation else "")
        for column, type_, collation, *_ in columns
    ]
    with_ = f" WITH {options}" if options else ""
    return f"{parenthesized(f'CREATE VIEW {name}', shown)}{with_} AS\n{as_created(definition)}"


def _table(
    table: str,
    kind: str,
    comment: str | None,
    columns: list[Row],
    constraints: list[Row],
    indexes: list[Row],
) -> Iterator[str]:
    parts, comments = [], [] if comment is None else [f"COMMENT ON TABLE {table} IS {comment};"]
    for name, type_, collation, default, not_null, generated, column_comment in columns:
        parts.append(
            f"{name} {type_}"
            + (f' COLLATE "{collation}"' if collation else "")
            + (f" DEFAULT {default}" if default else "")
            + (f" GENERATED {generated}" if generated else "")
            + (" NOT NULL" if not_null else "")
        )
        if column_comment is not None:
            comments.append(f"COMMENT ON COLUMN {table}.{name} IS {column_comment};")
    parts += [f"CONSTRAINT {name} {as_created(definition)}" for name, definition in constraints]
    yield f"{parenthesized(f'CREATE {_KINDS[kind]} {table}', parts)};"
    yield from (f"{definition};" for _, definition in indexes)
    yield from comments


# Settings that make the server read only tables, or only indexes.
_TABLES_ONLY = ("enable_indexscan", "enable_indexonlyscan", "enable_bitmapscan")
_INDEXES_ONLY = ("enable_seqscan", "enable_bitmapscan", "enable_sort", "enable_incremental_sort")
# The keys of a sorted index are read without its table; a hash index has no keys to read.
_WAYS = {"btree": (*_INDEXES_ONLY, "enable_indexscan"), "hash": _INDEXES_ONLY}
_PLAIN = {"jit": "off", "max_parallel_workers_per_gather": "0"}

_CHECKED_INDEXES = """
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
# The extension amcheck reads an index page by page, where it is installed and permitted.
_CHECKER = """
SELECT p.oid::regproc::text FROM pg_proc AS p
WHERE p.proname = 'bt_index_check' AND pg_function_is_visible(p.oid)
    AND pg_get_function_identity_arguments(p.oid) ~ '^[^,]*regclass, [^,]*boolean$'
    AND has_function_privilege(p.oid, 'EXECUTE')
"""

# By the number of an index: its rows, and the sum of their keys' hashes.
_Found = dict[int, tuple[int, Any]]


class _Index(NamedTuple):
    number: int
    oid: int
    name: str
    table: str
    method: str
    condition: str | None
    columns: list[str]
    nodes: Nodes | None

    def counts(self) -> tuple[str, str]:
        """Write the count of the table's rows and the sum of their keys' hashes."""
        where = "" if self.condition is None else f" FILTER (WHERE {self.condition})"
        digest = self.digest() if self.method == "btree" else "NULL::numeric"
        return f"count(*){where}", f"{digest}{where if self.method == 'btree' else ''}"

    def digest(self) -> str:
        return f"sum(hash_record_extended(ROW({', '.join(self.columns)}), 0))"

    def reading(self) -> str:
        """Write the query that computes the same numbers by the index."""
        columns = ", ".join(self.columns)
        if self.method == "btree":
            where = "" if self.condition is None else f" WHERE {self.condition}"
            keys = f"SELECT {columns} FROM {self.table}{where} ORDER BY {columns}"
            return f"SELECT {self.number}, count(*), {self.digest()} FROM ({keys}) AS keys"
        # It is not sorted: look up each value and count the rows, in each shard of a distributed
        # table.
        key, own = ("kb_id, ", "t.kb_id = wanted.kb_id AND ") if self.nodes else ("", "")
        return (
            f"SELECT {self.number}, coalesce(sum(found), 0), NULL::numeric "
            f"FROM (SELECT DISTINCT {key}{columns} AS value FROM {self.table}) AS wanted "
            f"CROSS JOIN LATERAL (SELECT count(*) AS found FROM {self.table} AS t "
            f"WHERE {own}t.{columns} = wanted.value) AS looked_up"
        )


_TABLE = attrgetter("table")


def index_faults(
    session: Session, tables: Sequence[str], nodes: Nodes | None
) -> Iterator[IndexFault]:
    """Compare the indexes of some tables with the tables, in constant memory."""
    indexes = _indexes_of(session, tables, nodes)
    if indexes:
        rows = _rows(session, _TABLES_ONLY, _by_tables(indexes), nodes)
        had = _found(each for arrays in rows for each in zip(*arrays, strict=True))
        found = _by_indexes(session, indexes, nodes)
        for index in indexes:
            # An index that is unused even now is used by no other query.
            if index.number in found and found[index.number] != had[index.number]:
                yield IndexFault(index.table, _difference(index, had, found))
        yield from _amcheck(session, indexes)


def _indexes_of(session: Session, tables: Sequence[str], nodes: Nodes | None) -> list[_Index]:
    names = ", ".join(f"to_regclass('{table}')" for table in tables)
    rows = session.rows_of(_CHECKED_INDEXES.replace("{tables}", names))
    return [_Index._make((*row, nodes)) for row in rows]


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
    """Write the query that computes the numbers of each index, reading each table once."""
    parts = []
    for table, group in groupby(sorted(indexes, key=_TABLE), _TABLE):
        of_table = [*group]
        numbers = [str(index.number) for index in of_table]
        arrays = (numbers, *zip(*(index.counts() for index in of_table), strict=True))
        lists = ", ".join(f"ARRAY[{', '.join(values)}]" for values in arrays)
        parts.append(f"SELECT {lists} FROM {table}")
    return " UNION ALL ".join(parts)


def _by_indexes(session: Session, indexes: list[_Index], nodes: Nodes | None) -> _Found:
    """Compute the numbers of the indexes that the server can be made to use."""
    numbers: _Found = {}
    for method, off in _WAYS.items():
        chosen = [index for index in indexes if index.method == method]
        if chosen:
            query = " UNION ALL ".join(index.reading() for index in chosen)
            explain = f"EXPLAIN (FORMAT JSON, COSTS OFF) {query}"
            ((plan,),) = _rows(session, off, explain, nodes)
            used = {nodes.whole_index(name) if nodes else name for name in _used(plan)}
            found = _found(_rows(session, off, query, nodes))
            numbers |= {each.number: found[each.number] for each in chosen if each.name in used}
    return numbers


def _used(plan: Any) -> Iterator[str]:
    """Yield the indexes that a plan uses."""
    if isinstance(plan, dict):
        if "Index Name" in plan:
            yield plan["Index Name"]
        plan = [*plan.values()]
    if isinstance(plan, list):
        for part in plan:
            yield from _used(part)


def _found(rows: Iterable[Sequence[Any]]) -> _Found:
    return {number: (int(count), digest) for number, count, digest in rows}


def _rows(session: Session, off: Iterable[str], query: str, nodes: Nodes | None) -> list[Row]:
    """Run a query with some planner settings switched off."""
    savepoint = session.savepoint()
    settings = {**(nodes.settings() if nodes else {}), **_PLAIN, **dict.fromkeys(off, "off")}
    try:
        session.define("; ".join(f"SET LOCAL {name} = '{settings[name]}'" for name in settings))
        return session.rows_of(query)
    finally:
        session.rollback_to(savepoint)


def _amcheck(session: Session, indexes: list[_Index]) -> Iterator[IndexFault]:
    """Run the extension amcheck on each index, where it is available."""
    for (function,) in session.rows_of(_CHECKER)[:1]:
        for index in (each for each in indexes if each.method == "btree"):
            savepoint, fault = session.savepoint(), None
            try:
                session.rows_of(f"SELECT {function}({index.oid}::regclass, true)")
            except StoreError as error:
                # Subclasses are errors of the connection.
                if type(error) is not StoreError:
                    raise
                fault = IndexFault(index.table, f"index {index.name}: {error}")
            session.rollback_to(savepoint)
            if fault is not None:
                yield fault


# Who may read the views of all knowledge bases may read the views of one.
_READERS = """
SELECT CASE a.grantee WHEN 0 THEN 'PUBLIC' ELSE quote_ident(pg_get_userbyid(a.grantee)) END
FROM pg_class AS c, aclexplode(c.relacl) AS a WHERE c.oid = to_regclass('audit_fact')
    AND a.privilege_type = 'SELECT' AND a.grantee <> c.relowner
ORDER BY 1
"""


class PostgresqlViews(ViewDialect):
    """Generated views on PostgreSQL: the mark is the view's comment."""

    relations = (
        "SELECT c.relname, CASE c.relkind WHEN 'v' THEN obj_description(c.oid, 'pg_class') END "
        "FROM pg_class AS c WHERE pg_table_is_visible(c.oid) UNION ALL "
        "SELECT typname, NULL FROM pg_type WHERE typrelid = 0 AND pg_type_is_visible(oid)"
    )
    marked = re.compile(rf"{MARKED.pattern}\Z")
    columns = (
        "SELECT attname FROM pg_attribute WHERE attrelid = to_regclass('{0}') "
        "AND attnum > 0 AND NOT attisdropped ORDER BY attnum"
    )
    is_goal = "v.is_goal"
    epoch = "CAST(extract(epoch FROM {0}) AS double precision)"
    seconds = "CAST(extract(epoch FROM {1} - {0}) AS double precision)"
    # This parameter style does not double percent signs.
    preparer = PGDialect(paramstyle="named").identifier_preparer  # type: ignore[no-untyped-call]

    def create(self, name: str, definition: str, mark: Mark, readers: Sequence[str]) -> list[str]:
        """Write the statements that create a view and grant others to read it."""
        quoted = self.preparer.quote(name)
        statements = [
            f"CREATE VIEW {quoted} AS\n{definition}",
            f"COMMENT ON VIEW {quoted} IS '{MARK.format(*mark)}'",
        ]
        if readers:
            statements.append(f"GRANT SELECT ON TABLE {quoted} TO {', '.join(readers)}")
        return statements

    def list_readers(self, rows: Rows) -> list[str]:
        """List who may read the views of all knowledge bases."""
        return [row[0] for row in rows(_READERS)]


class Qualifier:
    """Quotes identifiers, and qualifies them by the schema of the tables."""

    def __init__(self, schema: str) -> None:
        self.schema = schema

    @classmethod
    def of(cls, connection: Connection) -> Qualifier:
        """Read the schema of the tables; before there are any, it is the one of new databases."""
        return cls(connection.scalar(_SCHEMA_OF_TABLES) or "public")

    @staticmethod
    def quote(identifier: str) -> str:
        """Quote an identifier."""
        return str(PostgresqlViews.preparer.quote(identifier))

    def relation(self, name: str, schema: str | None = None) -> str:
        """Qualify the name of a table or view."""
        return f"{self.quote(self.schema if schema is None else schema)}.{self.quote(name)}"


# The extensions of this database, except the default one.
EXTENSIONS = "SELECT extname FROM pg_extension WHERE extname <> 'plpgsql'"


class Nodes(Protocol):
    """The work of a connection to one node for the others."""

    def settings(self, *, is_durable: bool = False) -> dict[str, str]:
        """Return the settings of a writing transaction."""

    def replanning(self, is_other: bool) -> str:
        """Write the statement that makes a node plan again."""

    def committing(self, synchronous_commit: str) -> Nodes:
        """Return these with another `synchronous_commit`."""

    def whole_index(self, name: str) -> str:
        """Return the name of the index that an index of a part of a table belongs to."""


class ClusterExtension(Protocol):
    """A plugin of the group `kant_sql.postgresql_extensions`, by the name of the extension.

    It is asked only in databases that have the extension. Each statement of the library names one
    knowledge base by `kb_id`, so one node can answer it.
    """

    def nodes(self, connection: Any) -> Nodes:
        """Examine a new connection of the driver."""

    def is_distributed(self, connection: Connection, schema: str) -> bool:
        """Return whether the tables of a schema are on several nodes."""

    def fault(self, connection: Connection, label: str) -> str | None:
        """Return which tables are not distributed like the others, or None."""

    def use_one_connection(self, connection: Connection) -> None:
        """Let a transaction of schema changes use one connection to each node."""

    def migrating(self, connection: Connection, label: str) -> AbstractContextManager[None]:
        """Let migrations create tables where those of the store are."""

    def of_one_shard(self, query: str, schema: str, kb_id: int) -> str:
        """Restrict each table of a view's query to one knowledge base."""

    def has_lost_a_node(self, state: str, message: str) -> bool:
        """Return whether an error is that of a connection between nodes."""


CLUSTERS: Plugins[ClusterExtension] = Plugins("kant_sql.postgresql_extensions")


def cluster_among(extensions: Iterable[str]) -> ClusterExtension | None:
    """Find the plugin of an extension."""
    found = map(CLUSTERS.get, extensions)
    return next((cluster for cluster in found if cluster is not None), None)


def cluster_of(connection: Connection) -> ClusterExtension | None:
    """Find the plugin of an extension of a database."""
    return cluster_among(connection.exec_driver_sql(EXTENSIONS).scalars().all())
