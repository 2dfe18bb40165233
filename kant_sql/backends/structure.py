"""What a live database says of its tables, views and indexes, in one canonical form per dialect.

The records in `migrations/golden/` have this form: what the migrations make. A store is compared
with them when it is verified.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cache
from itertools import groupby
from typing import Any, NamedTuple

from sqlalchemy import Boolean, Column, Double, Integer, String, Table, text

from ..tables.types import UtcTime
from .cursor import Row
from .query import Query, raw
from .session import Session

# Runs a statement without parameters, and gives all its rows.
Rows = Callable[[str], Sequence[Row]]

# The schema of the tables: where the version of the store is, or where new tables would be made.
_SCHEMA = (
    "coalesce((SELECT relnamespace FROM pg_class WHERE oid = to_regclass('kant_sql_version')),"
    " current_schema()::regnamespace)"
)
_RELATIONS = """
SELECT c.relname, c.relkind::text, quote_literal(obj_description(c.oid, 'pg_class')),
    CASE WHEN c.relkind = 'v' THEN pg_get_viewdef(c.oid, true) END,
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
# NOT NULL is a constraint of its own in new versions of PostgreSQL only: the columns say it.
_CONSTRAINTS = """
SELECT c.relname, k.conname, pg_get_constraintdef(k.oid)
FROM pg_constraint AS k JOIN pg_class AS c ON c.oid = k.conrelid
WHERE {which} AND k.contype <> 'n' ORDER BY c.relname COLLATE "C", k.conname COLLATE "C"
"""
# What is behind WITH is about storage only. An index that is not valid is not used.
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
# What the migrations make none of, with the table or view that it belongs to.
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
WHERE c.relkind = 'r' AND found.oid <> c.oid AND {which}
UNION ALL
SELECT c.relname, 'relation that statements find in its place: none' FROM pg_class AS c
WHERE c.relkind = 'r' AND to_regclass(quote_ident(c.relname)) IS NULL AND {which}
ORDER BY 2
"""
# The search path of the session: what stands before the system's own functions replaces them.
_BEFORE_SYSTEM = """
SELECT name FROM unnest(current_schemas(true)) WITH ORDINALITY AS s (name, place)
WHERE place < array_position(current_schemas(true), 'pg_catalog')
    AND NOT starts_with(name, 'pg_temp')
"""
# Objects that belong to nothing of the above, in the schema of the tables.
_LOOSE = f"""
SELECT c.relkind::text || ' ' || c.relname FROM pg_class AS c
WHERE c.relnamespace = {_SCHEMA} AND c.relkind NOT IN ('r', 'p', 'i', 'I', 'v')
UNION ALL SELECT 'function ' || proname FROM pg_proc WHERE pronamespace = {_SCHEMA}
ORDER BY 1
"""
_SQLITE = """
SELECT type, name, tbl_name, sql FROM sqlite_master WHERE sql IS NOT NULL
ORDER BY tbl_name, type = 'table' DESC, type, name
"""
_SQLITE_TEMPORARY = "SELECT type || ' ' || name, name, tbl_name FROM sqlite_temp_master"
_KINDS = {"r": "TABLE", "p": "PARTITIONED TABLE", "m": "MATERIALIZED VIEW", "f": "FOREIGN TABLE"}


# What SQLite stores the values of a column as.
_STORED_AS: tuple[tuple[Any, str], ...] = (
    ((Boolean, Integer), "'integer'"),
    (Double, "'real'"),
    ((String, UtcTime), "'text'"),
)


class Statement(NamedTuple):
    """A part of a schema.

    Attributes:
        relation: the table or view that it makes or belongs to; None for neither.
        head: what it makes, which one part of a schema has; it begins the text.
        text: all of it; a comment for what has no statement of its own.
    """

    relation: str | None
    head: str
    text: str


_HEAD = re.compile(r'(CREATE [A-Z ]+ |COMMENT ON [A-Z]+ )("[^"]+"|\S+)')
_ON = re.compile(r' ON (?:ONLY )?(?:public\.)?"?(\w+)')


def read_record(record: str) -> list[Statement]:
    """Read what was recorded of a schema.

    Args:
        record: the statements, as `statements` gives them, with line feeds between.

    Returns:
        The statements.
    """
    parts = re.split(r"\n(?=CREATE |COMMENT ON |-- )", record.rstrip("\n"))
    return [_made(part) for part in parts]


def live_statements(session: Session, names: Collection[str]) -> list[Statement]:
    """Give what a store has in the place of some tables and views, and what belongs to them.

    Args:
        session: the session.
        names: the names of the tables and views.

    Returns:
        The statements.
    """
    dialect = session.backend.dialect.name
    return statements(dialect, lambda sql: session.rows(raw(sql)), names)


def statements(
    dialect_name: str, rows: Rows, names: Collection[str] | None = None
) -> list[Statement]:
    """Write a schema down.

    Args:
        dialect_name: the dialect.
        rows: runs a statement in the database.
        names: the tables and views that are written down, with what belongs to them; None for all
            of the schema in which the tables are.

    Returns:
        Statements in the order of their names; no two schemas that differ have the same.
    """
    read = _sqlite if dialect_name == "sqlite" else _postgresql
    return [*read(rows, names)]


def wrong_values(
    session: Session, tables: tuple[Table, ...], kb_id: int
) -> Iterator[tuple[str, str, int]]:
    """Find columns with values of another type than theirs, which SQLite keeps in any column.

    Args:
        session: the session.
        tables: the tables, each of which has `kb_id`, or `id` in its place.
        kb_id: the knowledge base whose rows are read.

    Yields:
        The table, the column, and how many such values it has.
    """
    if session.backend.dialect.name == "sqlite":
        for table, (_, wrong) in zip(tables, session.rows(_wrong(tables), kb=kb_id), strict=True):
            for column, count in zip(table.c, json.loads(wrong), strict=True):
                if count:
                    yield table.name, column.name, count


@cache
def _wrong(tables: tuple[Table, ...]) -> Query:
    """Make the query that counts the wrong values of each column, in the order of the tables."""
    counts = (
        f"SELECT {number}, json_array({', '.join(map(_count_of_wrong, table.c))}) "
        f"FROM {table.name} WHERE {_quoted(next(iter(table.c)))} = :kb"
        for number, table in enumerate(tables)
    )
    return Query(text(f"{' UNION ALL '.join(counts)} ORDER BY 1"))


def _count_of_wrong(column: Column[Any]) -> str:
    name, allowed = _quoted(column), ["'null'"] if column.nullable else []
    kind = next(kind for types, kind in _STORED_AS if isinstance(column.type, types))
    is_right = f"typeof({name}) IN ({', '.join([*allowed, kind])})"
    if isinstance(column.type, Boolean):
        is_right += f" AND {name} IN (0, 1)"
    return f"count(*) - coalesce(sum({is_right}), 0)"


def _quoted(column: Column[Any]) -> str:
    return f'"{column.name}"'


def _made(sql: str, relation: str | None = None) -> Statement:
    head = _HEAD.match(sql)
    if head is None:
        return Statement(relation, sql, sql)
    if relation is None:
        on = _ON.search(sql) if " INDEX " in head[1] else None
        relation = head[2].strip('"').partition(".")[0] if on is None else on[1]
    return Statement(relation, head[0].strip(), sql)


def _sqlite(rows: Rows, names: Collection[str] | None) -> Iterator[Statement]:
    wanted = None if names is None else {name.lower() for name in names}
    for kind, name, table, sql in rows(_SQLITE):
        if wanted is None or {str(name).lower(), str(table).lower()} & wanted:
            yield _made(f"{_sqlite_statement(kind, sql)};", table)
    for what, name, table in rows(_SQLITE_TEMPORARY):
        if wanted is not None and {name.lower(), table.lower()} & wanted:
            yield _made(f"-- temporary {what}", table)


def _sqlite_statement(kind: str, sql: str) -> str:
    if kind == "table" and "(" in sql:
        return _sqlite_table(sql)
    return sql if kind == "view" else " ".join(sql.split())


def _sqlite_table(sql: str) -> str:
    """Put columns in their own order first, then constraints in the order of their names."""
    name, _, rest = sql.partition("(")
    body, _, options = rest.rpartition(")")
    parts = _split(body)
    columns = [part for part in parts if not part.startswith("CONSTRAINT")]
    constraints = sorted(part for part in parts if part.startswith("CONSTRAINT"))
    return _block(" ".join(name.split()), [*columns, *constraints]) + options.rstrip()


def _split(body: str) -> list[str]:
    parts, depth, start = [], 0, 0
    for match in re.finditer(r"'[^']*'|[(),]", body):
        depth += {"(": 1, ")": -1}.get(match[0], 0)
        if match[0] == "," and depth == 0:
            parts.append(body[start : match.start()])
            start = match.end()
    return [" ".join(part.split()) for part in [*parts, body[start:]]]


def _block(head: str, parts: list[str]) -> str:
    lines = ",\n".join(f"    {part}" for part in parts)
    return f"{head} (\n{lines}\n)"


def _postgresql(rows: Rows, names: Collection[str] | None) -> Iterator[Statement]:
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
            yield from (_made(part, name) for part in _table(name, kind, comment, *of))
    for name, kind, _, definition, options in relations:
        if kind == "v":
            yield _made(_view(name, columns.get(name, []), definition, options), name)
    for relation, what in rows(_OTHERS.replace("{which}", which)):
        yield _made(f"-- {what}", relation)
    if names is None:
        yield from (_made(f"-- {row[0]}") for row in rows(_LOOSE))
    for (schema,) in rows(_BEFORE_SYSTEM):
        yield _made(f"-- schema {schema}, which the search path has before the system's own")


def _view(name: str, columns: list[Row], definition: str, options: str | None) -> str:
    shown = [
        f"{column} {type_}" + (f' COLLATE "{collation}"' if collation else "")
        for column, type_, collation, *_ in columns
    ]
    with_ = f" WITH {options}" if options else ""
    return f"{_block(f'CREATE VIEW {name}', shown)}{with_} AS\n{definition}"


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
    parts += [f"CONSTRAINT {name} {definition}" for name, definition in constraints]
    yield f"{_block(f'CREATE {_KINDS[kind]} {table}', parts)};"
    yield from (f"{definition};" for _, definition in indexes)
    yield from comments
