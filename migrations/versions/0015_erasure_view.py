"""A view of erasures: by whom, when and why, and what is there now."""

from __future__ import annotations

from types import ModuleType

from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

NAME = "audit_erasure"
QUERY = """
SELECT
    k.name AS knowledge_base,
    v.id AS erasure_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.kind,
    v.element_id,
    v.pseudonym,
    v.parts,
    v.digest,
    v.since,
    s.committed_at AS since_at,
    EPOCH(s.committed_at) AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text,
    v.kb_id
FROM erasure AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
"""


def upgrade() -> None:
    """Create the view."""
    _module("0008")._replace_views({NAME: QUERY}, "CREATE", {})


def downgrade() -> None:
    """Bring the views back to the version before."""
    op.execute(f"DROP VIEW {NAME}")


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module
