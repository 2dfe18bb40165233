"""The audit's views find the last of many changes, and DuckDB reads two more of them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from types import ModuleType
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

# SQLite passes ORDER BY, LIMIT and bounds that are subqueries on to the parts of a UNION ALL only
# where a column has one affinity in all of them. A bare literal has none, and a column has its own.
WORD_ON_SQLITE = "CAST('{0}' AS TEXT)"
# A join with such a view is passed on as well. It begins at the step of a plan where it names one.
STEP_OF = re.compile(r"\b(x\.number = v\.(?:since|until))\b")
# DuckDB reads this as `count_star()`, which SQLite does not have.
COUNT_ALL = re.compile(r"count\(\*\) FROM (\w+) AS (\w)\b")
COUNT_ROWS = r"count(\2.kb_id) FROM \1 AS \2"
# SQLite uses the index of all that ended where it may; this condition leaves it the one of goals.
ENDED_GOAL = ("IS(v.is_goal) AND v.until IS NOT NULL", "IS(v.is_goal) AND COALESCE(v.until, 0) > 0")

# The number of the last revision is in one row. PostgreSQL reads all revisions of a knowledge base
# to find the greatest: the name in the condition is in another table than the number.
AUDIT_KNOWLEDGE_BASE = """
SELECT
    k.name AS knowledge_base,
    h.revision,
    h.committed_at,
    EPOCH(h.committed_at) AS committed_epoch
FROM head AS h
JOIN knowledge_base AS k ON k.id = h.kb_id
"""

# Goals are few among many facts: a search for the last goals must not read the facts.
GOALS = "ix_proposition_version_goal_since"
WHERE: dict[str, Any] = {
    "sqlite_where": sa.text("is_goal = 1"),
    "postgresql_where": sa.text("is_goal"),
}


def upgrade() -> None:
    """Bring the tables to this version."""
    views = _views_before()
    _drop(views.VIEWS)
    op.create_index(GOALS, "proposition_version", ["kb_id", "since"], unique=False, **WHERE)
    queries = {"audit_knowledge_base": AUDIT_KNOWLEDGE_BASE, **views.VIEWS}
    words = {"WORD": WORD_ON_SQLITE} if _is_sqlite() else {}
    _create(views, {name: _changed(query) for name, query in queries.items()}, words)


def downgrade() -> None:
    """Bring the tables back to the version before."""
    views = _views_before()
    _drop(["audit_knowledge_base", *views.VIEWS])
    op.drop_index(GOALS, table_name="proposition_version", **WHERE)
    _create(views, views.VIEWS, {})


def _views_before() -> ModuleType:
    """Find the migration that has the views as they were before."""
    script = op.get_context().script
    assert script is not None
    return script.get_revision("0001").module


def _changed(query: str) -> str:
    """Change the query of a view."""
    query = COUNT_ALL.sub(COUNT_ROWS, query.replace(*ENDED_GOAL))
    return STEP_OF.sub(r"ONE(\1)", query)


def _drop(names: Iterable[str]) -> None:
    for name in names:
        op.execute(f"DROP VIEW {name}")


def _create(views: ModuleType, queries: dict[str, str], words: dict[str, str]) -> None:
    """Create views, in the words of the dialect."""
    fragments = {**(views.SQLITE if _is_sqlite() else views.POSTGRESQL), **words}
    for name, query in queries.items():
        op.execute(f"CREATE VIEW {name} AS{views._in_dialect(query, fragments).rstrip()}")


def _is_sqlite() -> bool:
    return op.get_context().dialect.name == "sqlite"
