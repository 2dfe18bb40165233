"""DuckDB reads the audit's views of an SQLite file, with types.

DuckDB binds the query of a view itself, and then has the types of its own tables. Where it does not
know a function, as `likelihood`, it passes the query on to SQLite instead: then every column is a
text, and `UNION ALL` comes back in a form that SQLite refuses. So each view on SQLite says
the same to DuckDB in its own words: what the two take for a comment differs.
"""

from __future__ import annotations

import re
from types import ModuleType

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# Comments nest in DuckDB, not in SQLite: where this one ends for SQLite, it goes on for DuckDB.
# The dashes end SQLite's query there, and for DuckDB they are a part of the comment. The last line
# is for the semicolon of a script, which would else be a part of SQLite's comment.
BEGIN = " /* DuckDB nests comments, and reads the last line but one only. /* */"
TURN = "\n    -- */ "
END = "\n/* the end */"

TIME = "CAST({0} AS TIMESTAMPTZ)"
DUCKDB = {
    "EPOCH": f"epoch_us({TIME}) / 1e6",
    "SECONDS": "(epoch_us(CAST({1} AS TIMESTAMPTZ)) - epoch_us(CAST({0} AS TIMESTAMPTZ))) / 1e6",
    "HOUR": "substr({0}, 1, 13)",
    "TEXT": "{0}",
    "WORD": "'{0}'",
    "DOUBLE": "CAST({0} AS DOUBLE)",
    "IS": "{0} = 1",
    "OF": "{0}",
    "ONE": "{0}",
}
# Columns that are of another type in DuckDB than in the tables of SQLite.
TIMES = re.compile(r"^(    )(\w\.(?:committed|observed)_at)( AS \w+)?(?=,?$)", re.MULTILINE)
FLAGS = re.compile(r"^(    )(\w\.(is_constant))(?=,$)", re.MULTILINE)

# DuckDB has no recursion within a subquery of a row: both walks are made once, for all literals.
LITERAL = "{0}.kb_id = n.kb_id AND {0}.action_id = n.action_id AND {0}.since = n.since"
SECTION = f"{LITERAL} AND {{0}}.section = n.section"
KEY = "n.kb_id, n.action_id, n.since, n.section"
WALKS = f"""
WITH RECURSIVE walk AS (
    SELECT {KEY}, n.position AS leaf, n.position, n.parent AS above, 0 AS is_denied,
        0 AS asserted, 0 AS denied, CAST(NULL AS varchar) AS time,
        CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END AS is_need
    FROM action_node AS n
    WHERE n.predicate_id IS NOT NULL
    UNION ALL
    SELECT {KEY}, n.leaf, m.position, m.parent,
        CASE WHEN m.operator = 'not' OR m.operator = 'imply' AND n.position = m.position + 1
            THEN 1 - n.is_denied ELSE n.is_denied END,
        CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference') THEN 1
            WHEN m.operator = 'not' THEN n.denied ELSE n.asserted END,
        CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
            WHEN m.operator = 'not' OR m.operator = 'imply' AND n.position = m.position + 1
            THEN n.asserted ELSE n.denied END,
        CASE WHEN m.operator IN ('at start', 'over all', 'at end') THEN m.operator
            ELSE n.time END,
        CASE WHEN m.operator = 'when' AND n.position = m.position + 1 THEN 1 ELSE n.is_need END
    FROM walk AS n
    JOIN action_node AS m ON {SECTION.format("m")} AND m.position = n.above
), spell AS (
    SELECT {KEY}, n.position AS leaf, n.position, 0 AS term, '(' || d.name AS text
    FROM action_node AS n
    JOIN predicate AS d ON d.kb_id = n.kb_id AND d.id = n.predicate_id
    UNION ALL
    SELECT {KEY}, n.leaf,
        CASE WHEN t.child IS NOT NULL THEN t.child
            WHEN t.term IS NULL THEN o.position ELSE n.position END,
        CASE WHEN t.child IS NOT NULL THEN 0
            WHEN t.term IS NULL THEN o.term + 1 ELSE n.term + 1 END,
        n.text || CASE WHEN t.term IS NULL THEN ')'
            WHEN t.child IS NOT NULL THEN ' (' || f.name
            WHEN t.object_id IS NOT NULL THEN ' ' || e.name
            WHEN t.parameter IS NOT NULL THEN ' ?' || q.name
            ELSE ' ?' || b.name END
    FROM spell AS n
    LEFT JOIN action_term AS t ON {SECTION.format("t")}
        AND t.position = n.position AND t.term = n.term
    LEFT JOIN action_term AS o ON t.term IS NULL AND {SECTION.format("o")}
        AND o.child = n.position
    LEFT JOIN action_node AS c ON {SECTION.format("c")} AND c.position = t.child
    LEFT JOIN function AS f ON f.kb_id = c.kb_id AND f.id = c.function_id
    LEFT JOIN object AS e ON e.kb_id = n.kb_id AND e.id = t.object_id
    LEFT JOIN action_parameter AS q ON {LITERAL.format("q")} AND q.position = t.parameter
    LEFT JOIN action_variable AS b ON {SECTION.format("b")}
        AND b.position = t.quantifier AND b.variable = t.variable
    WHERE n.position IS NOT NULL
)"""
ROLE = """CASE WHEN w.is_need = 1
        THEN CASE WHEN w.is_denied = 0 THEN 'needs' ELSE 'needs not' END
        ELSE CASE WHEN w.is_denied = 0 THEN 'adds' ELSE 'deletes' END END"""
FOUND = f"""
JOIN walk AS w ON {SECTION.format("w")} AND w.leaf = n.position AND w.above IS NULL
JOIN spell AS z ON {SECTION.format("z")} AND z.leaf = n.position AND z.position IS NULL
WHERE n.predicate_id"""


def upgrade() -> None:
    """Bring the tables to this version."""
    if _is_sqlite():
        for name, query in _queries().items():
            _replace(name, f"{BEGIN}{_in_sqlite(query)}{TURN}{_in_duckdb(name, query)}{END}")


def downgrade() -> None:
    """Bring the tables back to the version before."""
    if _is_sqlite():
        for name, query in _queries().items():
            _replace(name, _in_sqlite(query))


def _is_sqlite() -> bool:
    return op.get_context().dialect.name == "sqlite"


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module


def _queries() -> dict[str, str]:
    """Give the queries of the views as they are since version 0002, in the words of no dialect."""
    changed = _module("0002")
    before = {"audit_knowledge_base": changed.AUDIT_KNOWLEDGE_BASE, **_module("0001").VIEWS}
    return {name: changed._changed(query) for name, query in before.items()}


def _replace(name: str, body: str) -> None:
    op.execute(f"DROP VIEW {name}")
    op.execute(f"CREATE VIEW {name} AS{body}")


def _in_sqlite(query: str) -> str:
    views = _module("0001")
    words = {**views.SQLITE, "WORD": _module("0002").WORD_ON_SQLITE}
    written: str = views._in_dialect(query, words)
    return written.rstrip()


def _in_duckdb(name: str, query: str) -> str:
    views = _module("0001")
    if name == "audit_action_literal":
        parts = {
            views.ROLE: ROLE,
            views.SPELL: "z.text",
            views.WALK.format("TEXT(time)"): "w.time",
            views.WALK.format("asserted = 1"): "w.asserted = 1",
            "\nWHERE n.predicate_id": FOUND,
        }
        for part, instead in parts.items():
            query = query.replace(part, instead)
        query = f"{WALKS}{query}"
    query = TIMES.sub(lambda found: _typed(found, TIME.format(found[2])), query)
    query = FLAGS.sub(lambda found: _typed(found, f"CAST({found[2]} AS BOOLEAN)"), query)
    return " ".join(views._in_dialect(query, DUCKDB).split())


def _typed(found: re.Match[str], value: str) -> str:
    name = found[3] if found[3] and found[3].startswith(" AS ") else f" AS {found[2][2:]}"
    return f"{found[1]}{value}{name}"
