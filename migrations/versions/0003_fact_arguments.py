"""Facts that hold now are found by their first two arguments, without a join."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

TABLE = "proposition_version"
FIRST, SECOND = "first_object_id", "second_object_id"
COMMENTS = {
    FIRST: "its first argument; NULL: it has none",
    SECOND: "its second argument; NULL: it has fewer",
}
NOW = "ix_proposition_version_now"
BY_SECOND = "ix_proposition_version_second"
OPEN = "uq_proposition_version_live"
GOALS = "ix_proposition_version_goal"
KIND = ("predicate_id", "is_goal")
ATOM = ("proposition_id", "until")
GOAL = ("kb_id", "until", "since", "proposition_id")
LIVE = "until IS NULL"

# Two lookups in the primary key for each row, whatever statistics say.
FILL = f"""
UPDATE {TABLE} SET
    {FIRST} = (
        SELECT a.object_id FROM proposition_argument AS a
        WHERE a.kb_id = {TABLE}.kb_id
        AND a.proposition_id = {TABLE}.proposition_id AND a.position = 0
    ),
    {SECOND} = (
        SELECT a.object_id FROM proposition_argument AS a
        WHERE a.kb_id = {TABLE}.kb_id
        AND a.proposition_id = {TABLE}.proposition_id AND a.position = 1
    )
"""


def upgrade() -> None:
    """Bring the tables to this version."""
    _drop(NOW, GOALS, OPEN)
    for name, comment in COMMENTS.items():
        op.add_column(TABLE, sa.Column(name, sa.BigInteger(), nullable=True, comment=comment))
    op.execute(FILL)
    _create(NOW, "kb_id", *KIND, FIRST, SECOND, *ATOM)
    has_second = f"{LIVE} AND {SECOND} IS NOT NULL"
    _create(BY_SECOND, "kb_id", *KIND, SECOND, FIRST, *ATOM, where=has_second)
    # Without statistics PostgreSQL takes any index that begins with `kb_id` for as good as another,
    # and the smallest for the best: this one, among 20,000 facts.
    _create(OPEN, "proposition_id", "kb_id", unique=True)
    # The index of all that holds now covers a search for goals, and SQLite prefers an index that
    # covers: the one of goals, which are few, has to cover it, too.
    _goal_index(*GOAL, "is_goal")


def downgrade() -> None:
    """Bring the tables back to the version before."""
    _drop(NOW, GOALS, BY_SECOND, OPEN)
    for name in COMMENTS:
        op.drop_column(TABLE, name)
    _create(NOW, "kb_id", "predicate_id", "proposition_id", "until")
    _create(OPEN, "kb_id", "proposition_id", unique=True)
    _goal_index(*GOAL)


def _goal_index(*columns: str) -> None:
    _create(GOALS, *columns, where="is_goal", on_sqlite="is_goal = 1")


def _create(
    name: str, *columns: str, where: str = LIVE, on_sqlite: str = "", unique: bool = False
) -> None:
    options: dict[str, Any] = {
        "sqlite_where": sa.text(on_sqlite or where),
        "postgresql_where": sa.text(where),
    }
    op.create_index(name, TABLE, columns, unique=unique, **options)


def _drop(*names: str) -> None:
    for name in names:
        op.drop_index(name, table_name=TABLE)
