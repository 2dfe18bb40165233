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
BY_SECOND = "ix_proposition_version_history_second"
FORK = ("kb_id", "predicate_id", "fork")
ENDS = ("since", "until")
FIRST, SECOND = "first_object_id", "second_object_id"


def upgrade() -> None:
    """Bring the tables to this version."""
    _replace_history(*FORK, FIRST, *ENDS, "proposition_id")
    where = sa.text(f"{SECOND} IS NOT NULL")
    options: dict[str, Any] = {"sqlite_where": where, "postgresql_where": where}
    op.create_index(BY_SECOND, TABLE, (*FORK, SECOND, *ENDS, "proposition_id"), **options)
    _replace_present()


def downgrade() -> None:
    """Bring the tables back to the version before."""
    op.drop_index(BY_SECOND, table_name=TABLE)
    _replace_history(*FORK, *ENDS, "proposition_id")
    _replace_present()


def _replace_history(*columns: str) -> None:
    op.drop_index(HISTORY, table_name=TABLE)
    op.create_index(HISTORY, TABLE, columns)


def _replace_present() -> None:
    """Create the indexes of the present again, after those of the past.

    Of indexes that cost the same, SQLite takes the last: it would read the past for the present.
    """
    script = op.get_context().script
    assert script is not None
    third = script.get_revision("0003").module
    third._drop(third.NOW, third.BY_SECOND)
    third._create(third.NOW, "kb_id", *third.KIND, FIRST, SECOND, *third.ATOM)
    has_second = f"{third.LIVE} AND {SECOND} IS NOT NULL"
    third._create(
        third.BY_SECOND, "kb_id", *third.KIND, SECOND, FIRST, *third.ATOM, where=has_second
    )
