"""Where a version is found by what a past state asks for: its fork."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# Tables of versions: what their index of the past begins and ends with.
TABLES = {
    "proposition_version": ("predicate_id", "proposition_id"),
    "function_value_version": ("function_id", "function_value_id"),
}


def upgrade() -> None:
    """Bring the tables to this version."""
    for table, (owner, element) in TABLES.items():
        op.add_column(
            table,
            sa.Column(
                "fork",
                sa.BigInteger(),
                server_default=sa.text("0"),
                nullable=False,
                comment="the revision from since to before until that the highest power of two "
                "divides; 0: holds now",
            ),
        )
        _find_forks(table)
        _index_past(table, [owner, "fork"], element)
    _index_goals(["kb_id", "fork", "since", "until", "proposition_id"])


def downgrade() -> None:
    """Bring the tables back to the version before."""
    _index_goals(["kb_id", "since", "until", "proposition_id"])
    for table, (owner, element) in TABLES.items():
        _index_past(table, [owner], element)
        op.drop_column(table, "fork")


def _find_forks(table: str) -> None:
    """Tell of each version that has ended where it is found."""
    before, last = "(since - 1)", "(until - 1)"
    bits = f"SELECT ({before} | {last}) - ({before} & {last}) AS bits"
    for shift in (1, 2, 4, 8, 16, 32):
        bits = f"SELECT bits | (bits >> {shift}) AS bits FROM ({bits}) AS bits_{shift}"
    op.execute(
        f"UPDATE {table} SET fork = (SELECT {last} - ({last} & (bits >> 1)) FROM ({bits}) AS bits)"
        " WHERE until IS NOT NULL"
    )
    if op.get_context().dialect.name == "postgresql":
        # A table with checks that are still to be made at commit cannot be altered.
        op.execute("SET CONSTRAINTS ALL IMMEDIATE")


def _index_past(table: str, begin: list[str], element: str) -> None:
    """Make the index of the past anew, with other columns than before."""
    name = f"ix_{table}_history"
    op.drop_index(name, table_name=table)
    op.create_index(name, table, ["kb_id", *begin, "since", "until", element], unique=False)


def _index_goals(columns: list[str]) -> None:
    """Make the index of past goals anew, with other columns than before."""
    name, table = "ix_proposition_version_goal_history", "proposition_version"
    on_sqlite, on_postgresql = sa.text("is_goal = 1"), sa.text("is_goal")
    op.drop_index(name, table_name=table, sqlite_where=on_sqlite, postgresql_where=on_postgresql)
    op.create_index(
        name,
        table,
        columns,
        unique=False,
        sqlite_where=on_sqlite,
        postgresql_where=on_postgresql,
    )
