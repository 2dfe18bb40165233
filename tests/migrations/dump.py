"""A schema as text, in one canonical form for each dialect, from what the live database says."""

from __future__ import annotations

import re
from collections.abc import Collection

from sqlalchemy import Connection, text

_TABLES = """
SELECT c.oid, c.relname, quote_literal(obj_description(c.oid, 'pg_class')) FROM pg_class AS c
WHERE c.relkind IN ('r', 'p') AND c.relnamespace = 'public'::regnamespace
ORDER BY c.relname COLLATE "C"
"""
_COLUMNS = """
SELECT quote_ident(a.attname), format_type(a.atttypid, a.atttypmod),
    CASE WHEN a.attcollation <> t.typcollation THEN l.collname END,
    pg_get_expr(d.adbin, d.adrelid), a.attnotnull, concat(a.attidentity, a.attgenerated),
    quote_literal(col_description(a.attrelid, a.attnum))
FROM pg_attribute AS a
JOIN pg_type AS t ON t.oid = a.atttypid
LEFT JOIN pg_collation AS l ON l.oid = a.attcollation
LEFT JOIN pg_attrdef AS d ON d.adrelid = a.attrelid AND d.adnum = a.attnum
WHERE a.attrelid = :table AND a.attnum > 0 AND NOT a.attisdropped
ORDER BY a.attnum
"""
# NOT NULL is a constraint of its own in new versions of PostgreSQL only: the columns say it.
_CONSTRAINTS = """
SELECT conname, pg_get_constraintdef(oid) FROM pg_constraint
WHERE conrelid = :table AND contype <> 'n' ORDER BY conname COLLATE "C"
"""
_INDEXES = """
SELECT pg_get_indexdef(i.indexrelid) FROM pg_index AS i
JOIN pg_class AS c ON c.oid = i.indexrelid
WHERE i.indrelid = :table AND i.indexrelid NOT IN (
    SELECT conindid FROM pg_constraint WHERE conrelid = :table
)
ORDER BY c.relname COLLATE "C"
"""
_VIEWS = """
SELECT c.oid, c.relname, pg_get_viewdef(c.oid, true), quote_literal(c.reloptions::text)
FROM pg_class AS c
WHERE c.relkind = 'v' AND c.relnamespace = 'public'::regnamespace
ORDER BY c.relname COLLATE "C"
"""
_OTHERS = """
SELECT relkind::text || ' ' || relname FROM pg_class
WHERE relnamespace = 'public'::regnamespace AND relkind NOT IN ('r', 'p', 'i', 'I', 'v')
UNION ALL SELECT 'trigger ' || tgname FROM pg_trigger WHERE NOT tgisinternal
UNION ALL SELECT 'function ' || proname FROM pg_proc WHERE pronamespace = 'public'::regnamespace
ORDER BY 1
"""


def dump(connection: Connection, without: Collection[str] = ()) -> str:
    """Write a schema down.

    Args:
        connection: the database.
        without: tables to leave out, or `views` for all views.

    Returns:
        Statements in the order of their names; no two schemas that differ have the same.
    """
    dumper = _dump_sqlite if connection.dialect.name == "sqlite" else _dump_postgresql
    return "\n".join(dumper(connection, without)) + "\n"


def _dump_sqlite(connection: Connection, without: Collection[str]) -> list[str]:
    rows = connection.execute(
        text(
            "SELECT type, tbl_name, sql FROM sqlite_master WHERE sql IS NOT NULL "
            "ORDER BY tbl_name, type = 'table' DESC, type, name"
        )
    )
    return [
        f"{_sqlite_statement(kind, sql)};"
        for kind, table, sql in rows
        if table not in without and not (kind == "view" and "views" in without)
    ]


def _sqlite_statement(kind: str, sql: str) -> str:
    if kind == "table":
        return _sqlite_table(sql)
    return sql if kind == "view" else " ".join(sql.split())


def _sqlite_table(sql: str) -> str:
    """Put columns in their own order first, then constraints in the order of their names."""
    name, _, body = sql.partition("(")
    parts = _split(body.rpartition(")")[0])
    columns = [part for part in parts if not part.startswith("CONSTRAINT")]
    constraints = sorted(part for part in parts if part.startswith("CONSTRAINT"))
    return _table(" ".join(name.split()), [*columns, *constraints])


def _split(body: str) -> list[str]:
    parts, depth, start = [], 0, 0
    for match in re.finditer(r"'[^']*'|[(),]", body):
        depth += {"(": 1, ")": -1}.get(match[0], 0)
        if match[0] == "," and depth == 0:
            parts.append(body[start : match.start()])
            start = match.end()
    return [" ".join(part.split()) for part in [*parts, body[start:]]]


def _table(head: str, parts: list[str]) -> str:
    lines = ",\n".join(f"    {part}" for part in parts)
    return f"{head} (\n{lines}\n)"


def _dump_postgresql(connection: Connection, without: Collection[str]) -> list[str]:
    statements = []
    for oid, table, comment in connection.execute(text(_TABLES)).all():
        if table not in without:
            statements += _postgresql_table(connection, oid, table, comment)
    if "views" not in without:
        for oid, view, definition, options in connection.execute(text(_VIEWS)).all():
            columns = [
                f"{name} {type_}" + (f' COLLATE "{collation}"' if collation else "")
                for name, type_, collation, *_ in connection.execute(text(_COLUMNS), {"table": oid})
            ]
            with_ = f" WITH {options}" if options else ""
            statements.append(f"{_table(f'CREATE VIEW {view}', columns)}{with_} AS\n{definition}")
    return statements + [f"-- {row[0]}" for row in connection.execute(text(_OTHERS))]


def _postgresql_table(
    connection: Connection, oid: int, table: str, comment: str | None
) -> list[str]:
    parts, comments = [], [] if comment is None else [f"COMMENT ON TABLE {table} IS {comment};"]
    for row in connection.execute(text(_COLUMNS), {"table": oid}):
        name, type_, collation, default, not_null, generated, column_comment = row
        parts.append(
            f"{name} {type_}"
            + (f' COLLATE "{collation}"' if collation else "")
            + (f" DEFAULT {default}" if default else "")
            + (f" GENERATED {generated}" if generated else "")
            + (" NOT NULL" if not_null else "")
        )
        if column_comment is not None:
            comments.append(f"COMMENT ON COLUMN {table}.{name} IS {column_comment};")
    constraints = connection.execute(text(_CONSTRAINTS), {"table": oid})
    parts += [f"CONSTRAINT {name} {definition}" for name, definition in constraints]
    indexes = [f"{row[0]};" for row in connection.execute(text(_INDEXES), {"table": oid})]
    return [f"{_table(f'CREATE TABLE {table}', parts)};", *indexes, *comments]
