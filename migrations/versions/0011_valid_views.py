"""Views of what was true when, as known when; sayings and erasures are changes."""

from __future__ import annotations

from types import ModuleType

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

CHANGES = "audit_change"
# What a saying or a version says: since which revision, of which period, and whether it was so.
# Where nothing else was ever said of an element, its versions stand as they are.
RECTANGLES = """
    SELECT
        w.kb_id, w.ELEMENT_id, w.OWNER_id, {values}
        s.committed_at AS valid_from,
        u.committed_at AS valid_until,
        w.since AS known_since,
        CAST(NULL AS bigint) AS known_until
    FROM ELEMENT_version AS w
    JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
    LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE {is_one} AND COALESCE(s.committed_at < u.committed_at, w.until IS NULL) AND NOT EXISTS (
        SELECT 1 FROM ELEMENT_saying AS l
        WHERE l.kb_id = w.kb_id AND l.ELEMENT_id = w.ELEMENT_id
    )
    UNION ALL
    SELECT
        w.kb_id, w.ELEMENT_id, w.OWNER_id, {values}
        u.committed_at AS valid_from,
        NULL AS valid_until,
        w.since AS known_since,
        w.until AS known_until
    FROM ELEMENT_version AS w
    JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
    WHERE {is_one}
    UNION ALL
    SELECT
        w.kb_id, w.ELEMENT_id, w.OWNER_id, {values}
        w.valid_from,
        w.valid_until,
        w.since AS known_since,
        w.known_until
    FROM (
        SELECT
            e.*,
            g.valid_from,
            g.valid_until,
            lead(e.since) OVER (
                PARTITION BY e.kb_id, e.ELEMENT_id, g.valid_from ORDER BY e.since
            ) AS known_until
        FROM (
            SELECT
                m.kb_id,
                m.ELEMENT_id,
                m.moment AS valid_from,
                lead(m.moment) OVER (
                    PARTITION BY m.kb_id, m.ELEMENT_id ORDER BY m.moment
                ) AS valid_until
            FROM (
                SELECT l.kb_id, l.ELEMENT_id, l.valid_from AS moment FROM ELEMENT_saying AS l
                UNION
                SELECT l.kb_id, l.ELEMENT_id, l.valid_until FROM ELEMENT_saying AS l
                UNION
                SELECT n.kb_id, n.ELEMENT_id, q.committed_at
                FROM ELEMENT_version AS n
                JOIN revision AS q ON q.kb_id = n.kb_id AND q.number IN (n.since, n.until)
                WHERE EXISTS (
                    SELECT 1 FROM ELEMENT_saying AS l
                    WHERE l.kb_id = n.kb_id AND l.ELEMENT_id = n.ELEMENT_id
                )
            ) AS m
        ) AS g
        JOIN (
            SELECT
                l.kb_id, l.ELEMENT_id, l.OWNER_id, {said} l.since,
                l.valid_from AS begun, l.valid_until AS ended, {holds} AS holds
            FROM ELEMENT_saying AS l
            UNION ALL
            SELECT
                w.kb_id, w.ELEMENT_id, w.OWNER_id, {values} w.since,
                s.committed_at, u.committed_at, TRUE
            FROM ELEMENT_version AS w
            JOIN revision AS s ON s.kb_id = w.kb_id AND s.number = w.since
            LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.until
            WHERE {is_one} AND EXISTS (
                SELECT 1 FROM ELEMENT_saying AS l
                WHERE l.kb_id = w.kb_id AND l.ELEMENT_id = w.ELEMENT_id
            )
        ) AS e ON e.kb_id = g.kb_id AND e.ELEMENT_id = g.ELEMENT_id
            AND e.begun <= g.valid_from AND COALESCE(g.valid_from < e.ended, TRUE)
    ) AS w
    WHERE w.holds
"""
FACT = """
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,"""
VALUE = """
    v.function_value_id,
    d.name AS function,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text AS fluent,
    COALESCE(v.value, o.name) AS value,
    v.number,"""
VIEW = """
SELECT
    k.name AS knowledge_base,{columns}
    v.valid_from,
    EPOCH(v.valid_from) AS valid_from_epoch,
    v.valid_until,
    EPOCH(v.valid_until) AS valid_until_epoch,
    v.known_since,
    s.committed_at AS known_since_at,
    EPOCH(s.committed_at) AS known_since_epoch,
    s.actor AS known_by,
    s.reason AS known_reason,
    v.known_until,
    u.committed_at AS known_until_at,
    EPOCH(u.committed_at) AS known_until_epoch,
    u.actor AS corrected_by,
    u.reason AS corrected_reason,
    v.kb_id
FROM ({rectangles}) AS v
LEFT JOIN ELEMENT AS p ON p.kb_id = v.kb_id AND ONE(p.id = v.ELEMENT_id)
LEFT JOIN OWNER AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.OWNER_id){joined}
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.known_since
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.known_until
"""


def upgrade() -> None:
    """Create the views, and bring that of changes to this version."""
    executions = _module("0008")
    before = executions._queries()[CHANGES]
    verb = "CREATE" if executions._is_sqlite() else "CREATE OR REPLACE"
    executions._replace_views({CHANGES: _changes(before)}, verb, {CHANGES: before})
    executions._replace_views(_views(), "CREATE", {})


def downgrade() -> None:
    """Bring the views back to the version before."""
    executions = _module("0008")
    for view in (*reversed(_views()), CHANGES):
        op.execute(f"DROP VIEW {view}")
    executions._replace_views({CHANGES: executions._queries()[CHANGES]}, "CREATE", {})


def _changes(query: str) -> str:
    """Add what is written as records are: once, and with its own text."""
    parts = query.split("UNION ALL")
    [record] = [one for one in parts if " archive AS " in one]
    for table, kind, element in (
        ("proposition_saying", "saying", "proposition_id"),
        ("function_value_saying", "saying", "function_value_id"),
        ("erasure", "erasure", "id"),
    ):
        part = record.replace(" archive AS ", f" {table} AS ").replace("archive", kind)
        parts.append(part.replace("v.id AS element_id", f"v.{element} AS element_id"))
    return "UNION ALL".join(parts)


def _views() -> dict[str, str]:
    """Give the queries of the new views, in the words of no dialect."""
    value = "{0}.value, {0}.number, {0}.object_id,"
    of_fact = RECTANGLES.format(values="", said="", holds="l.holds", is_one="NOT w.is_goal")
    of_value = RECTANGLES.format(
        values=value.format("w"),
        said=value.format("l"),
        holds="(l.number IS NOT NULL OR l.object_id IS NOT NULL)",
        is_one="TRUE",
    )
    object_ = "\nLEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)"
    fact = VIEW.format(columns=FACT, rectangles=of_fact, joined="")
    values = VIEW.format(columns=VALUE, rectangles=of_value, joined=object_)
    return {
        "audit_fact_valid": _named(fact, "proposition", "predicate"),
        "audit_value_valid": _named(values, "function_value", "function"),
    }


def _named(query: str, element: str, owner: str) -> str:
    return query.replace("ELEMENT", element).replace("OWNER", owner)


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module
