"""Sayings about facts are found by their first two arguments, as the facts that held."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

TABLE = "proposition_saying"
# The column of each index.
BY_ARGUMENT = {f"ix_{TABLE}_{place}": f"{place}_object_id" for place in ("first", "second")}


def upgrade() -> None:
    """Bring the tables to this version."""
    for name, column in BY_ARGUMENT.items():
        where = sa.text(f"{column} IS NOT NULL")
        columns = ("kb_id", "predicate_id", column, "fork", "valid_from")
        op.create_index(name, TABLE, columns, sqlite_where=where, postgresql_where=where)


def downgrade() -> None:
    """Bring the tables back to the version before."""
    for name in BY_ARGUMENT:
        op.drop_index(name, table_name=TABLE)
