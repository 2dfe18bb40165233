"""Each view for auditors on SQLite has one query: DuckDB passes queries on to SQLite instead."""

from __future__ import annotations

from types import ModuleType

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Bring the tables to this version; on PostgreSQL, the views are as they should be."""
    if _is_sqlite():
        in_sqlite = _module("0005")._in_sqlite
        for name, query in _module("0006")._queries().items():
            op.execute(f"DROP VIEW {name}")
            op.execute(f"CREATE VIEW {name} AS{in_sqlite(query)}")


def downgrade() -> None:
    """Bring the tables back to the version before."""
    if _is_sqlite():
        before = _module("0006")
        for name, query in before._queries().items():
            op.execute(f"DROP VIEW {name}")
            before._create_view("CREATE", name, query)


def _is_sqlite() -> bool:
    return op.get_context().dialect.name == "sqlite"


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module
