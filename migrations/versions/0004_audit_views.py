"""The views for whoever audits a store in SQL: `docs/audit.md` describes them."""

from __future__ import annotations

import re
from collections.abc import Iterator

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# What the two dialects have to say differently. Times in seconds are exact: the microseconds since
# 1970, and those between two times, are whole numbers that a double has.
SQLITE = {
    "EPOCH": "(strftime('%s', substr({0}, 1, 19)) * 1000000 + substr({0}, 21, 6)) / 1000000.0",
    "SECONDS": "((strftime('%s', substr({1}, 1, 19)) - strftime('%s', substr({0}, 1, 19)))"
    " * 1000000 + substr({1}, 21, 6) - substr({0}, 21, 6)) / 1000000.0",
    "HOUR": "substr({0}, 1, 13)",
    "TEXT": "{0}",
    "WORD": "'{0}'",
    "DOUBLE": "CAST({0} AS REAL)",
    # SQLite uses a partial index only where a query repeats its very condition.
    "IS": "{0} = 1",
    # Without statistics SQLite takes all of a knowledge base for ten rows, and would read that
    # rather than begin at what a question is about. Of the shares that were tried, these give every
    # condition its index, with statistics and without; revisions need none.
    "OF": "likelihood({0}, 0.05)",
    "ONE": "likelihood({0}, 0.01)",
}
POSTGRESQL = {
    "EPOCH": "CAST(extract(epoch FROM {0}) AS double precision)",
    "SECONDS": "CAST(extract(epoch FROM {1} - {0}) AS double precision)",
    "HOUR": "to_char({0} AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24') COLLATE \"C\"",
    "TEXT": 'CAST({0} AS text) COLLATE "C"',
    "WORD": "CAST('{0}' AS text) COLLATE \"C\"",
    "DOUBLE": "CAST({0} AS double precision)",
    "IS": "{0}",
    "OF": "{0}",
    "ONE": "{0}",
}
FRAGMENT = re.compile(rf"\b({'|'.join(SQLITE)})\(([^()]*)\)")

# A view is about the rows of one table, `v`, and looks up what they mention. That is there, by
# foreign keys. Yet the joins are left joins: so both databases leave out those that a question does
# not ask for, begin at the other end only where a condition is on that, and need no statistics.
KNOWLEDGE_BASE = "LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)"
REVISION = """
    r.committed_at,
    EPOCH(r.committed_at) AS committed_epoch,
    HOUR(r.committed_at) AS committed_hour,
    r.observed_at,
    EPOCH(r.observed_at) AS observed_epoch,
    SECONDS(r.observed_at, r.committed_at) AS delay,
    r.actor,
    r.reason,
    TEXT(r.source) AS source,
    x.plan_id,
    x.position AS plan_step"""
ASSERTED = """
    v.since,
    s.committed_at AS since_at,
    EPOCH(s.committed_at) AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason"""
INTERVAL = f"""{ASSERTED},
    v.until,
    u.committed_at AS until_at,
    EPOCH(u.committed_at) AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    SECONDS(s.committed_at, u.committed_at) AS duration"""
SINCE = f"""{KNOWLEDGE_BASE}
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since"""
ENDS = f"""{SINCE}
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until"""

AUDIT_REVISION = f"""
SELECT
    k.name AS knowledge_base,
    r.number AS revision,{REVISION},
    r.form,
    r.hash
FROM revision AS r
LEFT JOIN knowledge_base AS k ON OF(k.id = r.kb_id)
LEFT JOIN revision_plan_step AS x ON x.kb_id = r.kb_id AND x.number = r.number
"""

# What revisions change: a table, its rows' kind, the id of their element, their text, and which.
CHANGED = (
    ("type_version", "WORD(type)", "v.type_id", "v.text", ""),
    ("object_version", "WORD(object)", "v.object_id", "v.text", ""),
    ("predicate_version", "WORD(predicate)", "v.predicate_id", "v.text", ""),
    ("function_version", "WORD(function)", "v.function_id", "v.text", ""),
    ("action_version", "WORD(action)", "v.action_id", "v.text", ""),
    ("formula_version", "TEXT(v.section)", "v.formula_id", "v.text", ""),
    ("document_version", "WORD(document)", "v.document_id", "v.text", ""),
    ("proposition_version", "WORD(fact)", "v.proposition_id", "p.text", "NOT v.is_goal"),
    ("proposition_version", "WORD(goal)", "v.proposition_id", "p.text", "IS(v.is_goal)"),
    ("function_value_version", "WORD(value)", "v.function_value_id", "v.text", ""),
    ("plan", "WORD(plan)", "v.id", "v.text", ""),
    ("plan_step_version", "WORD(plan step)", "v.plan_id", "v.text", ""),
    ("archive", "WORD(archive)", "v.id", "v.text", ""),
)
NEVER_RETRACTED = ("plan", "archive")
PROPOSITION = "\nLEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND ONE(p.id = v.proposition_id)"


def _changes() -> Iterator[str]:
    """Give what selects the ends of the rows of each table."""
    for sign, end in (("+", "since"), ("-", "until")):
        for table, kind, element, text, which in CHANGED:
            if sign == "-" and table in NEVER_RETRACTED:
                continue
            conditions = [part for part in (which, "v.until IS NOT NULL" * (sign == "-")) if part]
            where = f"\nWHERE {' AND '.join(conditions)}" if conditions else ""
            yield f"""
SELECT
    k.name AS knowledge_base,
    v.{end} AS revision,
    WORD({sign}) AS sign,
    {kind} AS kind,
    {text} AS text,
    {element} AS element_id,{REVISION}
FROM {table} AS v
{KNOWLEDGE_BASE}{PROPOSITION if text == "p.text" else ""}
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.{end}
LEFT JOIN revision_plan_step AS x ON x.kb_id = v.kb_id AND x.number = v.{end}{where}
"""


AUDIT_FACT = f"""
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN WORD(goal) ELSE WORD(fact) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,{INTERVAL}
FROM proposition_version AS v{PROPOSITION}
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.predicate_id)
{ENDS}
"""
AUDIT_GOAL = f"""{AUDIT_FACT}WHERE IS(v.is_goal)
"""
AUDIT_FACT_ARGUMENT = f"""
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN WORD(goal) ELSE WORD(fact) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    p.text,
    a.position,
    (
        SELECT m.name
        FROM predicate_version AS w
        JOIN predicate_parameter AS m ON m.kb_id = w.kb_id
            AND m.predicate_id = w.predicate_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.predicate_id = v.predicate_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,{INTERVAL}
FROM proposition_version AS v
JOIN proposition_argument AS a ON a.kb_id = v.kb_id AND ONE(a.proposition_id = v.proposition_id)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND ONE(o.id = a.object_id){PROPOSITION}
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.predicate_id)
{ENDS}
"""

AUDIT_VALUE = f"""
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(f.text, length(d.name) + 3), ')') AS arguments,
    f.text AS fluent,
    COALESCE(v.value, o.name) AS value,
    v.number,
    v.text,{INTERVAL}
FROM function_value_version AS v
LEFT JOIN function_value AS f ON f.kb_id = v.kb_id AND ONE(f.id = v.function_value_id)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.function_id)
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
{ENDS}
"""
AUDIT_VALUE_ARGUMENT = f"""
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    v.text,
    a.position,
    (
        SELECT m.name
        FROM function_version AS w
        JOIN function_parameter AS m ON m.kb_id = w.kb_id
            AND m.function_id = w.function_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.function_id = v.function_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,{INTERVAL}
FROM function_value_version AS v
JOIN function_value_argument AS a ON a.kb_id = v.kb_id
    AND ONE(a.function_value_id = v.function_value_id)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND ONE(o.id = a.object_id)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.function_id)
{ENDS}
"""

# Of `rb1 - robot`, or of `(:constants rb1 - robot)`, what comes last.
AUDIT_OBJECT = f"""
SELECT
    k.name AS knowledge_base,
    o.name AS object,
    v.object_id,
    CASE WHEN v.is_constant
        THEN substr(v.text, length(o.name) + 16, length(v.text) - length(o.name) - 16)
        ELSE substr(v.text, length(o.name) + 4) END AS type,
    v.is_constant,
    v.text,{INTERVAL}
FROM object_version AS v
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
{ENDS}
"""


def _definitions() -> Iterator[str]:
    """Give what selects the definitions of each kind."""
    for table, kind, element, text, _ in CHANGED[:7]:
        yield f"""
SELECT
    k.name AS knowledge_base,
    {kind} AS kind,
    n.name,
    {element} AS element_id,
    {text},{INTERVAL}
FROM {table} AS v
LEFT JOIN {table.removesuffix("_version")} AS n ON n.kb_id = v.kb_id AND ONE(n.id = {element})
{ENDS}
"""


AUDIT_ACTION = f"""
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    v.action_id,
    TEXT(v.kind) AS kind,
    v.text,{INTERVAL}
FROM action_version AS v
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND ONE(a.id = v.action_id)
{ENDS}
"""

# From a leaf of a tree up to its root. `asserted` and `denied` say whether the leaf is one of
# several cases, given that the nodes above deny an even or an odd number of times: under a denial,
# `and` is what `or` is else. The first node below another is the one that comes next in preorder.
TREE = "{0}.kb_id = n.kb_id AND {0}.action_id = n.action_id AND {0}.since = n.since"
WALK = f"""(
        WITH RECURSIVE walk (position, above, is_denied, asserted, denied, time, is_need) AS (
            SELECT n.position, n.parent, 0, 0, 0, CAST(NULL AS varchar(32)),
                CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END
            UNION ALL
            SELECT m.position, m.parent,
                CASE WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN 1 - walk.is_denied ELSE walk.is_denied END,
                CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference')
                    THEN 1 WHEN m.operator = 'not' THEN walk.denied ELSE walk.asserted END,
                CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
                    WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN walk.asserted ELSE walk.denied END,
                CASE WHEN m.operator IN ('at start', 'over all', 'at end')
                    THEN m.operator ELSE walk.time END,
                CASE WHEN m.operator = 'when' AND walk.position = m.position + 1
                    THEN 1 ELSE walk.is_need END
            FROM walk
            JOIN action_node AS m ON {TREE.format("m")} AND m.section = n.section
                AND m.position = walk.above
        )
        SELECT {{0}} FROM walk WHERE above IS NULL
    )"""
ROLE = WALK.format(
    """CASE WHEN is_need = 1
            THEN CASE WHEN is_denied = 0 THEN WORD(needs) ELSE WORD(needs not) END
            ELSE CASE WHEN is_denied = 0 THEN WORD(adds) ELSE WORD(deletes) END END"""
)
# A literal's text, term by term: down into the fluents among its terms, and out of them again.
SPELL = f"""(
        WITH RECURSIVE spell (position, term, text) AS (
            SELECT n.position, 0, '(' || d.name
            UNION ALL
            SELECT
                CASE WHEN t.child IS NOT NULL THEN t.child
                    WHEN t.term IS NULL THEN o.position ELSE spell.position END,
                CASE WHEN t.child IS NOT NULL THEN 0
                    WHEN t.term IS NULL THEN o.term + 1 ELSE spell.term + 1 END,
                spell.text || CASE WHEN t.term IS NULL THEN ')'
                    WHEN t.child IS NOT NULL THEN ' (' || (
                        SELECT f.name FROM action_node AS c
                        JOIN function AS f ON f.kb_id = c.kb_id AND f.id = c.function_id
                        WHERE {TREE.format("c")} AND c.section = n.section AND c.position = t.child
                    )
                    WHEN t.object_id IS NOT NULL THEN ' ' || (
                        SELECT e.name FROM object AS e
                        WHERE e.kb_id = n.kb_id AND e.id = t.object_id
                    )
                    WHEN t.parameter IS NOT NULL THEN ' ?' || (
                        SELECT q.name FROM action_parameter AS q
                        WHERE {TREE.format("q")} AND q.position = t.parameter
                    )
                    ELSE ' ?' || (
                        SELECT b.name FROM action_variable AS b
                        WHERE {TREE.format("b")} AND b.section = n.section
                            AND b.position = t.quantifier AND b.variable = t.variable
                    ) END
            FROM spell
            LEFT JOIN action_term AS t ON {TREE.format("t")} AND t.section = n.section
                AND t.position = spell.position AND t.term = spell.term
            LEFT JOIN action_term AS o ON t.term IS NULL AND {TREE.format("o")}
                AND o.section = n.section AND o.child = spell.position
            WHERE spell.position IS NOT NULL
        )
        SELECT text FROM spell WHERE position IS NULL
    )"""
AUDIT_ACTION_LITERAL = f"""
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    n.action_id,
    TEXT(v.kind) AS kind,
    TEXT(n.section) AS section,
    n.position,
    {ROLE} AS role,
    d.name AS predicate,
    {SPELL} AS literal,
    {WALK.format("TEXT(time)")} AS time,
    {WALK.format("asserted = 1")} AS is_conditional,{INTERVAL}
FROM action_node AS n
JOIN action_version AS v ON v.kb_id = n.kb_id AND v.action_id = n.action_id AND v.since = n.since
LEFT JOIN action AS a ON a.kb_id = n.kb_id AND a.id = n.action_id
LEFT JOIN predicate AS d ON d.kb_id = n.kb_id AND d.id = n.predicate_id
{ENDS}
WHERE n.predicate_id IS NOT NULL
"""


def _count(status: str, name: str) -> str:
    """Give what counts the steps of a plan that are at a status."""
    return f"""(
        SELECT count(*) FROM plan_step_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.status = '{status}'
    ) AS steps_{name}"""


AUDIT_PLAN = f"""
SELECT
    k.name AS knowledge_base,
    v.id AS plan_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.problem_hash,
    v.planner,
    v.planner_version,
    v.objective,
    v.value,
    DOUBLE(v.value) AS number,
    v.status,
    (
        SELECT count(*) FROM plan_step AS w WHERE w.kb_id = v.kb_id AND w.plan_id = v.id
    ) AS steps,
    {_count("started", "running")},
    {_count("succeeded", "succeeded")},
    {_count("failed", "failed")},
    {_count("aborted", "aborted")},{ASSERTED},
    v.text,
    v.domain_pddl,
    v.problem_pddl
FROM plan AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
{SINCE}
"""
AUDIT_PLAN_STEP = f"""
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    a.name AS action,
    rtrim(substr(v.text, length(a.name) + 3), ')') AS arguments,
    v.text,
    DOUBLE(v.start) AS planned_start,
    DOUBLE(v.duration) AS planned_duration,
    TEXT(w.status) AS status,
    b.since AS started,
    s.committed_at AS started_at,
    EPOCH(s.committed_at) AS started_epoch,
    s.actor AS started_by,
    u.number AS ended,
    u.committed_at AS ended_at,
    EPOCH(u.committed_at) AS ended_epoch,
    u.actor AS ended_by,
    u.reason AS ended_reason,
    SECONDS(s.committed_at, u.committed_at) AS duration,
    (
        SELECT count(*) FROM revision_plan_step AS x
        WHERE x.kb_id = v.kb_id AND x.plan_id = v.plan_id AND x.position = v.position
    ) AS revisions
FROM plan_step AS v
{KNOWLEDGE_BASE}
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND ONE(a.id = v.action_id)
LEFT JOIN plan_step_version AS w ON w.kb_id = v.kb_id AND w.plan_id = v.plan_id
    AND w.position = v.position AND w.until IS NULL
LEFT JOIN plan_step_version AS b ON b.kb_id = v.kb_id AND b.plan_id = v.plan_id
    AND b.position = v.position AND b.since = (
        SELECT max(c.since) FROM plan_step_version AS c
        WHERE c.kb_id = v.kb_id AND c.plan_id = v.plan_id AND c.position = v.position
            AND c.status = 'started'
    )
LEFT JOIN revision AS s ON s.kb_id = b.kb_id AND s.number = b.since
LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.since AND w.status <> 'started'
"""
AUDIT_PLAN_STEP_STATUS = f"""
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    TEXT(v.status) AS status,
    v.text,{INTERVAL}
FROM plan_step_version AS v
{ENDS}
"""
AUDIT_PLAN_STEP_ARGUMENT = """
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    p.text,
    v.argument,
    o.name AS object,
    v.object_id
FROM plan_step_argument AS v
LEFT JOIN plan_step AS p ON p.kb_id = v.kb_id AND p.plan_id = v.plan_id AND p.position = v.position
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
"""
AUDIT_ARCHIVE = f"""
SELECT
    k.name AS knowledge_base,
    v.id AS archive_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.target,
    v.versions,
    v.rest,{ASSERTED},
    v.text
FROM archive AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
{SINCE}
"""

VIEWS = {
    "audit_revision": AUDIT_REVISION,
    "audit_change": "UNION ALL".join(_changes()),
    "audit_fact": AUDIT_FACT,
    "audit_goal": AUDIT_GOAL,
    "audit_fact_argument": AUDIT_FACT_ARGUMENT,
    "audit_value": AUDIT_VALUE,
    "audit_value_argument": AUDIT_VALUE_ARGUMENT,
    "audit_object": AUDIT_OBJECT,
    "audit_definition": "UNION ALL".join(_definitions()),
    "audit_action": AUDIT_ACTION,
    "audit_action_literal": AUDIT_ACTION_LITERAL,
    "audit_plan": AUDIT_PLAN,
    "audit_plan_step": AUDIT_PLAN_STEP,
    "audit_plan_step_status": AUDIT_PLAN_STEP_STATUS,
    "audit_plan_step_argument": AUDIT_PLAN_STEP_ARGUMENT,
    "audit_archive": AUDIT_ARCHIVE,
}


# What is asked for by name, as it was first spelt, or by text. A hash on PostgreSQL: a text may be
# longer than what a b-tree takes, and one that began with `kb_id` would be taken for others'
# questions, too, while a table without statistics is small.
LOOKUPS = {
    "object": "name",
    "predicate": "name",
    "function": "name",
    "proposition": "text",
    "function_value": "text",
}


def upgrade() -> None:
    """Bring the tables to this version."""
    for table, column in LOOKUPS.items():
        op.create_index(f"ix_{table}_{column}", table, [column], postgresql_using="hash")
    fragments = SQLITE if op.get_context().dialect.name == "sqlite" else POSTGRESQL
    for name, query in VIEWS.items():
        op.execute(f"CREATE VIEW {name} AS{_in_dialect(query, fragments).rstrip()}")


def downgrade() -> None:
    """Bring the tables back to the version before."""
    for name in reversed(VIEWS):
        op.execute(f"DROP VIEW {name}")
    for table, column in LOOKUPS.items():
        op.drop_index(f"ix_{table}_{column}", table_name=table)


def _in_dialect(query: str, fragments: dict[str, str]) -> str:
    """Write a query as one dialect has it."""
    return FRAGMENT.sub(
        lambda found: fragments[found[1]].format(*found[2].split(", ")),
        query,
    )
