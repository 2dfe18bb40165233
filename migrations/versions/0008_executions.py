"""Steps of plans and acts without a plan are executions, of one mechanism.

Rules can be kept, and facts confirmed.

The rows of steps keep their keys, their statuses and the texts that hashes cover. A status that was
`started` is now `running`.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

POSITION = sa.Integer()
WORD = sa.String(16)
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")
WITHOUT_ROWID = {"execution", "execution_argument", "execution_version", "confirmation"}

# What the versions are called, up and down: only the column says it, not the hashed text.
UP = "CASE status WHEN 'started' THEN 'running' ELSE status END"
DOWN = "CASE outcome WHEN 'running' THEN 'started' ELSE outcome END"
KEY = "kb_id, plan_id, position"
# Each table before and the one that takes its place, the columns of both, and what only the new
# one has; `plan_step` has the revision of its plan.
CARRIED = (
    ("plan_step", "execution", f"{KEY}, start, duration, action_id, text"),
    ("plan_step_argument", "execution_argument", f"{KEY}, argument, object_id"),
    ("plan_step_version", "execution_version", f"{KEY}, since, until, text"),
    ("revision_plan_step", "revision_execution", f"{KEY}, number"),
)
ADDED = {
    "execution": {
        "since": "(SELECT p.since FROM plan AS p WHERE p.kb_id = v.kb_id AND p.id = v.plan_id)"
    },
    "execution_version": {"kind": "'plan step'", "outcome": UP},
    "plan_step_version": {"status": DOWN},
}
BEFORE = tuple(before for before, *_ in CARRIED)

AUDIT_EXECUTION = """
SELECT
    k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v.position,
    v.action,
    v.arguments,
    v.text,
    v.outcome,
    v.code,
    v.message,
    v.started,
    v.started_at,
    EPOCH(v.started_at) AS started_epoch,
    v.started_by,
    v.started_reason,
    TEXT(v.started_source) AS started_source,
    v.ended,
    v.ended_at,
    EPOCH(v.ended_at) AS ended_epoch,
    v.ended_by,
    v.ended_reason,
    SECONDS(v.started_at, v.ended_at) AS duration,
    DOUBLE(v.planned_duration) AS planned_duration,
    v.kb_id
FROM (
    SELECT
        e.kb_id,
        CASE WHEN e.plan_id = 0 THEN TEXT(e.position) || ''
            ELSE TEXT(e.plan_id) || '.' || TEXT(e.position) END AS execution,
        e.plan_id,
        e.position,
        COALESCE(a.name, e.name) AS action,
        CASE WHEN e.name IS NULL THEN rtrim(substr(e.text, length(a.name) + 3), ')') ELSE (
            SELECT JOINED(h.said)
            FROM (
                SELECT COALESCE(o.name, g.value) AS said
                FROM execution_argument AS g
                LEFT JOIN object AS o ON o.kb_id = g.kb_id AND o.id = g.object_id
                WHERE g.kb_id = e.kb_id AND g.plan_id = e.plan_id AND g.position = e.position
                ORDER BY g.argument
            ) AS h
        ) END AS arguments,
        e.text,
        TEXT(w.outcome) AS outcome,
        w.code,
        w.message,
        CASE e.plan_id WHEN 0 THEN e.since ELSE b.since END AS started,
        COALESCE(w.started_at, s.committed_at) AS started_at,
        s.actor AS started_by,
        s.reason AS started_reason,
        s.source AS started_source,
        u.number AS ended,
        CASE WHEN u.number IS NOT NULL THEN COALESCE(w.ended_at, u.committed_at) END AS ended_at,
        u.actor AS ended_by,
        u.reason AS ended_reason,
        e.duration AS planned_duration
    FROM execution AS e
    JOIN execution_version AS w ON w.kb_id = e.kb_id AND w.plan_id = e.plan_id
        AND w.position = e.position AND w.until IS NULL
    LEFT JOIN execution_version AS b ON b.kb_id = e.kb_id AND b.plan_id = e.plan_id
        AND b.position = e.position AND b.since = (
            SELECT min(c.since) FROM execution_version AS c
            WHERE c.kb_id = e.kb_id AND c.plan_id = e.plan_id AND c.position = e.position
        )
    LEFT JOIN action AS a ON a.kb_id = e.kb_id AND ONE(a.id = e.action_id)
    LEFT JOIN revision AS s ON s.kb_id = e.kb_id
        AND s.number = CASE e.plan_id WHEN 0 THEN e.since ELSE b.since END
    LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.since AND w.outcome <> 'running'
) AS v
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
"""
# What the revision of an act asserts is an effect of it; another actor may confirm that.
AUDIT_EFFECT = """
SELECT
    k.name AS knowledge_base,
    v.execution,
    v.plan_id,
    v.position,
    v.proposition_id,
    p.text,
    v.since,
    v.since_at,
    EPOCH(v.since_at) AS since_epoch,
    v.asserted_by,
    v.until,
    u.committed_at AS until_at,
    EPOCH(u.committed_at) AS until_epoch,
    u.actor AS retracted_by,
    v.confirmed,
    r.committed_at AS confirmed_at,
    EPOCH(r.committed_at) AS confirmed_epoch,
    r.actor AS confirmed_by,
    v.kb_id
FROM (
    SELECT
        w.kb_id,
        CASE WHEN w.plan_id = 0 THEN TEXT(w.position) || ''
            ELSE TEXT(w.plan_id) || '.' || TEXT(w.position) END AS execution,
        w.plan_id,
        w.position,
        f.proposition_id,
        f.since,
        f.until,
        s.committed_at AS since_at,
        s.actor AS asserted_by,
        (
            SELECT max(c.since)
            FROM confirmation AS c
            JOIN revision AS q ON q.kb_id = c.kb_id AND q.number = c.since
            WHERE c.kb_id = f.kb_id AND c.proposition_id = f.proposition_id
                AND c.since > f.since AND (f.until IS NULL OR c.since <= f.until)
                AND COALESCE(q.actor, '') <> COALESCE(s.actor, '')
        ) AS confirmed
    FROM (
        SELECT kb_id, plan_id, position, since FROM execution_version
        WHERE outcome IN ('running', 'succeeded')
        UNION
        SELECT kb_id, plan_id, position, number FROM revision_execution
    ) AS w
    JOIN proposition_version AS f ON f.kb_id = w.kb_id AND f.since = w.since
    JOIN revision AS s ON s.kb_id = f.kb_id AND s.number = f.since
    WHERE NOT f.is_goal
) AS v
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
LEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND ONE(p.id = v.proposition_id)
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.confirmed
"""
# Of each action, and of each action with its arguments. Wilson's interval: 1.96 is the quantile
# of the normal distribution, and 3.84 its square.
OF_EACH = """SELECT
            v.knowledge_base, v.kb_id, v.action, {} AS arguments, v.outcome, v.code,
            CASE WHEN v.outcome IN ('succeeded', 'failed') THEN v.duration END AS duration
        FROM audit_execution AS v"""
# By Heron's method, as not every SQLite has a function for it.
SQUARE_ROOT = """(
            WITH RECURSIVE near (step, square, root) AS (
                SELECT 1, of.square, of.square FROM (
                    SELECT DOUBLE(g.succeeded) * g.failed / NULLIF(g.succeeded + g.failed, 0)
                        + 0.960364705173531 AS square
                ) AS of
                UNION ALL
                SELECT near.step + 1, near.square, (near.root + near.square / near.root) / 2
                FROM near WHERE near.step < 40
            )
            SELECT near.root FROM near WHERE near.step = 40
        )"""
AUDIT_STATISTICS = f"""
SELECT
    k.name AS knowledge_base,
    s.action,
    s.arguments,
    s.executions,
    s.running,
    s.succeeded,
    s.failed,
    s.aborted,
    s.refused,
    DOUBLE(s.succeeded) / s.decided AS success_rate,
    CASE s.succeeded WHEN 0 THEN DOUBLE(s.failed) / s.decided - 1 ELSE
        (s.succeeded + 1.920729410347062 - 1.959963984540054 * s.spread)
        / (s.decided + 3.841458820694124) END AS success_low,
    CASE s.failed WHEN 0 THEN DOUBLE(s.succeeded) / s.decided ELSE
        (s.succeeded + 1.920729410347062 + 1.959963984540054 * s.spread)
        / (s.decided + 3.841458820694124) END AS success_high,
    s.mean,
    s.median,
    s.percentile_95,
    s.codes,
    s.kb_id
FROM (
    SELECT
        g.*,
        NULLIF(g.succeeded + g.failed, 0) AS decided,
        {SQUARE_ROOT} AS spread
    FROM (
        SELECT
            p.knowledge_base,
            p.action,
            p.arguments,
            count(*) AS executions,
            count(CASE p.outcome WHEN 'running' THEN 1 END) AS running,
            count(CASE p.outcome WHEN 'succeeded' THEN 1 END) AS succeeded,
            count(CASE p.outcome WHEN 'failed' THEN 1 END) AS failed,
            count(CASE p.outcome WHEN 'aborted' THEN 1 END) AS aborted,
            count(CASE p.outcome WHEN 'refused' THEN 1 END) AS refused,
            avg(p.duration) AS mean,
            avg(CASE WHEN p.place IN ((p.timed + 1) / 2, (p.timed + 2) / 2)
                THEN p.duration END) AS median,
            max(CASE WHEN p.place = (95 * p.timed + 99) / 100 THEN p.duration END)
                AS percentile_95,
            JOINED(p.failures) AS codes,
            p.kb_id
        FROM (
            SELECT
                e.*,
                row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.duration IS NULL
                    ORDER BY e.duration) AS place,
                count(e.duration) OVER (PARTITION BY e.kb_id, e.action, e.arguments) AS timed,
                CASE row_number() OVER (PARTITION BY e.kb_id, e.action, e.arguments, e.code)
                    WHEN 1 THEN e.code || ': ' || count(*) OVER (
                        PARTITION BY e.kb_id, e.action, e.arguments, e.code) END AS failures
            FROM (
        {OF_EACH.format("TEXT(NULL)")}
        UNION ALL
        {OF_EACH.format("COALESCE(v.arguments, '')")}
            ) AS e
        ) AS p
        GROUP BY p.kb_id, p.knowledge_base, p.action, p.arguments
    ) AS g
) AS s
LEFT JOIN knowledge_base AS k ON OF(k.id = s.kb_id)
"""
SEPARATED = {
    "sqlite": "group_concat(p.failures, ', ')",
    "postgresql": "string_agg(p.failures, ', ')",
}
JOINED = {"sqlite": "group_concat(h.said, ' ')", "postgresql": "string_agg(h.said, ' ')"}


def upgrade() -> None:
    """Bring the tables to this version."""
    for made in _tables():
        _module("0001")._create(made)
    _carry()
    _replace_views(_queries(), "CREATE" if _is_sqlite() else "CREATE OR REPLACE", _before())
    for table in reversed(BEFORE):
        op.drop_table(table)


def downgrade() -> None:
    """Bring the tables back to the version before."""
    if context.get_revision_argument() is not None:
        _refuse_to_lose()
    for table in BEFORE:
        _create_before(table)
    _carry(is_back=True)
    for view in ("audit_effect", "audit_confirmation", "audit_statistics", "audit_execution"):
        op.execute(f"DROP VIEW {view}")
    _replace_views(_before(), "CREATE" if _is_sqlite() else "CREATE OR REPLACE", _before())
    for made in reversed(_tables()):
        op.execute(sa.schema.DropTable(made))


def _refuse_to_lose() -> None:
    """Refuse where the hash of a revision covers what the version before has no place for."""
    if context.is_offline_mode():
        raise CommandError("a downgrade below 0008 looks for executions: run it without --sql")
    for what, rows in (
        ("outcomes of executions", "execution_version WHERE kind = 'execution'"),
        ("kept rules", "rule_version"),
        ("confirmations", "confirmation"),
    ):
        count = op.get_bind().scalar(sa.text(f"SELECT count(*) FROM {rows}"))
        if count:
            raise CommandError(
                f"version {down_revision} has no place for {what} ({count}), whose revisions "
                "could not be verified any more; nothing was changed"
            )


def _carry(is_back: bool = False) -> None:
    for *tables, columns in CARRIED:
        source, target = reversed(tables) if is_back else tables
        added = ADDED.get(target, {})
        # In a downgrade to `base`, what has no place there is dropped.
        where = " WHERE v.plan_id > 0" if is_back else ""
        op.execute(
            f"INSERT INTO {target} ({', '.join((columns, *added))})"
            f" SELECT {', '.join((columns, *added.values()))} FROM {source} AS v{where}"
        )
    if not _is_sqlite():
        # A table with references that are yet to be checked cannot be dropped.
        op.execute("SET CONSTRAINTS ALL IMMEDIATE")


def _tables() -> list[sa.Table]:
    """Make the new tables, as the first version makes its own."""
    first = _module("0001")
    before = {*first.METADATA.tables}
    for make in (_executions, _confirmations, _rules):
        make(first)
    made = [table for table in first.METADATA.sorted_tables if table.name not in before]
    for table in made:
        # The first version creates and drops all that are there.
        first.METADATA.remove(table)
        table.dialect_options["sqlite"]["with_rowid"] = table.name not in WITHOUT_ROWID
    return made


def _executions(first: Any) -> None:
    key, place, column, optional = first._key, first._place, first._column, first._optional
    owner = "kb_id", "plan_id", "position"

    def to_execution() -> sa.ForeignKeyConstraint:
        return sa.ForeignKeyConstraint(owner, [f"execution.{name}" for name in owner])

    first._table(
        "execution",
        key("plan_id", comment="0: it is of no plan"),
        place("position", "of a step: from 0; of no plan: the id"),
        column("since", comment="recorded in this revision, with its plan if it has one"),
        optional("start", LONG_TEXT, "seconds from the plan's beginning, as exact decimal text"),
        optional(
            *("duration", LONG_TEXT),
            "seconds, as exact decimal text; NULL: an instant, or not known",
        ),
        optional("action_id", comment="NULL: it is no action of the domain"),
        optional("name", LONG_TEXT, "what it is called that is no action of the domain"),
        first._text("action and arguments, without times; what is no PDDL is quoted"),
        first._reference("action_id", "action"),
        sa.CheckConstraint("(action_id IS NULL) <> (name IS NULL)", name="action_or_name"),
        first._index("execution", "action", "action_id"),
        first._partial("execution", "name", "name", where="name IS NOT NULL"),
    )
    first._table(
        "execution_argument",
        *(key("plan_id"), place("position"), place("argument", "from 0")),
        optional("object_id", comment="NULL: it is no object of the knowledge base"),
        optional("value", LONG_TEXT, "what was said instead of an object"),
        to_execution(),
        first._reference("object_id", "object"),
        sa.CheckConstraint("(object_id IS NULL) <> (value IS NULL)", name="object_or_value"),
        first._index("execution_argument", "object", "object_id"),
    )
    outcomes = "'running', 'succeeded', 'failed', 'aborted', 'refused'"
    *indexes, _ = first._version_items("execution_version", "plan_id", "position")
    first._table(
        "execution_version",
        *(key("plan_id"), place("position"), first._since(), first._until()),
        column("kind", WORD, "execution; plan step: written before version 0008"),
        column("outcome", WORD, "running, succeeded, failed, aborted or refused"),
        optional("code", LONG_TEXT, "of a failure"),
        optional("message", LONG_TEXT, "what is said of a failure, or did not hold"),
        optional("started_at", UTC_TIME, "UTC; NULL: when the revision was committed"),
        optional("ended_at", UTC_TIME, "UTC; NULL: when the revision was committed"),
        first._text("which execution it is, and its outcome"),
        to_execution(),
        *indexes,
        sa.CheckConstraint(f"outcome IN ({outcomes})", name="outcome"),
        sa.CheckConstraint("kind IN ('execution', 'plan step')", name="kind"),
        first._partial(
            *("execution_version", "running", "outcome", "plan_id", "position", "until"),
            where="until IS NULL AND outcome = 'running'",
        ),
    )
    first._table(
        "revision_execution",
        *(key("number", comment="the revision"), column("plan_id"), column("position", POSITION)),
        first._to_revision("number"),
        to_execution(),
        first._index("revision_execution", "execution", "plan_id", "position", "number"),
    )


def _confirmations(first: Any) -> None:
    first._table(
        "confirmation",
        first._key("proposition_id"),
        first._key("since", comment="recorded in this revision"),
        first._reference("proposition_id", "proposition"),
        first._to_revision("since", at_commit=True),
        first._index("confirmation", "since", "since"),
    )


def _rules(first: Any) -> None:
    first._identity("rule")
    first._version(
        "rule",
        first._column("on_violation", WORD, "report; refuse: the transaction fails"),
        first._text(),
        sa.CheckConstraint("on_violation IN ('report', 'refuse')", name="on_violation"),
    )
    check = sa.CheckConstraint("section = 'constraint'", name="section")
    first._trees("rule", False, check)


def _create_before(table: str) -> None:
    """Create a table of the version before, as its migrations did."""
    first = _module("0001")
    first._create(first.METADATA.tables[table])
    running = _module("0004")
    if table == running.TABLE:
        running.upgrade()


def _is_sqlite() -> bool:
    return op.get_context().dialect.name == "sqlite"


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module


def _before() -> dict[str, str]:
    """Give the queries of the views of the version before that read what is replaced."""
    queries: dict[str, str] = _module("0006")._queries()
    return {
        name: query
        for name, query in queries.items()
        if any(f" {table} AS " in query for table in (*BEFORE, "formula_version"))
    }


def _queries() -> dict[str, str]:
    """Give the queries of the views, in the words of no dialect."""
    changed = {name: _changed(query) for name, query in _before().items()}
    for name, table in (
        ("audit_plan_step", "execution"),
        ("audit_plan_step_status", "execution_version"),
        ("audit_plan_step_argument", "execution_argument"),
    ):
        assert f"FROM {table} AS v" in changed[name]
        changed[name] = f"{changed[name].rstrip()}\nWHERE v.plan_id > 0\n"
    dialect = "sqlite" if _is_sqlite() else "postgresql"
    [confirmed] = [one for one in changed["audit_change"].split("UNION ALL") if CONFIRMED in one]
    return {
        **changed,
        "audit_execution": AUDIT_EXECUTION.replace("JOINED(h.said)", JOINED[dialect]),
        "audit_statistics": AUDIT_STATISTICS.replace("JOINED(p.failures)", SEPARATED[dialect]),
        "audit_confirmation": confirmed.replace(CONFIRMED, "").replace("element", "proposition"),
        "audit_effect": AUDIT_EFFECT,
    }


CONFIRMED = "    WORD(+) AS sign,\n    WORD(confirmation) AS kind,\n"


def _changed(query: str) -> str:
    """Read the new tables in place of those before."""
    for old, new, _ in CARRIED:
        query = query.replace(f" {old} AS ", f" {new} AS ")
    parts = query.split("UNION ALL")
    # An act without a plan is found by its own id.
    own = "CAST(CASE v.plan_id WHEN 0 THEN v.position ELSE v.plan_id END AS bigint)"
    for number, part in enumerate(parts):
        if "FROM execution_version AS v" in part:
            of_kind = part.replace("WORD(plan step)", "TEXT(v.kind)")
            parts[number] = of_kind.replace("v.plan_id AS element_id", f"{own} AS element_id")
    # Confirmations are of facts, as their assertions are.
    parts += [
        one.replace("WORD(fact)", "WORD(confirmation)")
        .replace(" proposition_version AS ", " confirmation AS ")
        .replace("\nWHERE NOT v.is_goal", "")
        for one in parts
        if "WORD(+) AS sign,\n    WORD(fact) AS kind" in one
    ]
    # Kept rules are named as documents are.
    parts += [one.replace("document", "rule") for one in parts if " document_version AS " in one]
    query = "UNION ALL".join(parts)
    for alias in "vwc":
        query = query.replace(f"{alias}.status = 'started'", f"{alias}.outcome = 'running'")
        query = query.replace(f"{alias}.status <> 'started'", f"{alias}.outcome <> 'running'")
    query = query.replace("TEXT(w.status)", "TEXT(w.outcome)")
    for status in ("succeeded", "failed", "aborted"):
        query = query.replace(f"w.status = '{status}'", f"w.outcome = '{status}'")
    if "FROM execution_version AS v" in query:
        query = query.replace("TEXT(v.status)", "TEXT(v.outcome)")
    return query


def _replace_views(queries: dict[str, str], verb: str, known: dict[str, str]) -> None:
    """Create views; on PostgreSQL, in place, so that views of users stay."""
    for name, query in queries.items():
        if _is_sqlite():
            written = _module("0005")._in_sqlite(query)
            if name in known:
                op.execute(f"DROP VIEW {name}")
        else:
            views = _module("0001")
            written = views._in_dialect(query, views.POSTGRESQL).rstrip()
        op.execute(f"{verb} VIEW {name} AS{written}")
