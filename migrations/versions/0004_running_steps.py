"""The steps that run now are found without reading what became of all others."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

TABLE = "plan_step_version"
RUNNING = "ix_plan_step_version_running"
# With the columns of its condition it covers the question, also on SQLite.
COLUMNS = ("kb_id", "status", "plan_id", "position", "until")
WHERE = "until IS NULL AND status = 'started'"


def upgrade() -> None:
    """Bring the tables to this version."""
    op.create_index(
        RUNNING, TABLE, COLUMNS, sqlite_where=sa.text(WHERE), postgresql_where=sa.text(WHERE)
    )


def downgrade() -> None:
    """Bring the tables back to the version before."""
    op.drop_index(RUNNING, table_name=TABLE)
