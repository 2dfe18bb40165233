"""Facts that held in the past are found by their first two arguments, as those that hold now."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

TABLE = "proposition_version"
HISTORY = "ix_proposition_version_history"
BY_SECOND = "ix_proposition_version_second_history"
FORK = ("kb_id", "predicate_id", "fork")
ENDS = ("since", "until")
FIRST, SECOND = "first_object_id", "second_object_id"


def upgrade() -> None:
    """Bring the tables to this version."""
    op.drop_index(HISTORY, table_name=TABLE)
    op.create_index(HISTORY, TABLE, (*FORK, FIRST, *ENDS, "proposition_id"))
    where = sa.text(f"{SECOND} IS NOT NULL")
    options: dict[str, Any] = {"sqlite_where": where, "postgresql_where": where}
    op.create_index(BY_SECOND, TABLE, (*FORK, SECOND, *ENDS), **options)


def downgrade() -> None:
    """Bring the tables back to the version before."""
    op.drop_index(BY_SECOND, table_name=TABLE)
    op.drop_index(HISTORY, table_name=TABLE)
    op.create_index(HISTORY, TABLE, (*FORK, *ENDS, "proposition_id"))
