"""The view of statistics counts the effects that no other actor has confirmed."""

from __future__ import annotations

from types import ModuleType

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

VIEW = "audit_statistics"
ACTS = "FROM audit_execution AS v"
# Each part of the query before, and what stands there instead.
CHANGED = {
    ACTS: f"""{ACTS}
        LEFT JOIN (
            SELECT e.kb_id, e.plan_id, e.position, count(*) AS unconfirmed
            FROM audit_effect AS e
            WHERE e.until IS NULL AND e.confirmed IS NULL
            GROUP BY e.kb_id, e.plan_id, e.position
        ) AS u ON u.kb_id = v.kb_id AND u.plan_id = v.plan_id AND u.position = v.position""",
    "v.outcome, v.code,": "v.outcome, v.code, u.unconfirmed,",
    "AS codes,": "AS codes,\n            CAST(COALESCE(sum(p.unconfirmed), 0) AS bigint)"
    " AS unconfirmed,",
    # Last, because `CREATE OR REPLACE VIEW` adds columns at the end only.
    "    s.kb_id\n": "    s.kb_id,\n    s.unconfirmed\n",
}


def upgrade() -> None:
    """Bring the view to this version; on PostgreSQL, in place, so that views of users stay."""
    query = before = _before()[VIEW]
    for old, new in CHANGED.items():
        assert old in query
        query = query.replace(old, new)
    verb = "CREATE" if _module("0008")._is_sqlite() else "CREATE OR REPLACE"
    _module("0008")._replace_views({VIEW: query}, verb, {VIEW: before})


def downgrade() -> None:
    """Bring the view back to the version before."""
    op.execute(f"DROP VIEW {VIEW}")
    _module("0008")._replace_views({VIEW: _before()[VIEW]}, "CREATE", {})


def _before() -> dict[str, str]:
    queries: dict[str, str] = _module("0008")._queries()
    return queries


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module
