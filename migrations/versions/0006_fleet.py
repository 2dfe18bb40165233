"""Replicas know their origin, verifications are kept, and each view for auditors has `kb_id`."""

from __future__ import annotations

import re
from types import ModuleType
from typing import Any

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger()
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")

# A writer locks this row, and so knows without another statement that it must not write.
ORIGIN: tuple[tuple[str, Any, str], ...] = (
    (
        "origin",
        LONG_TEXT,
        "the store that it is replicated from: a URL without its password; NULL: written here",
    ),
    ("origin_revision", NUMBER, "the origin's last revision, as last heard of"),
    ("origin_committed_at", UTC_TIME, "UTC, of the origin's last revision"),
    ("heard_at", UTC_TIME, "UTC, when the origin was last heard of"),
)

AUDIT_PROMOTION = """
SELECT
    k.name AS knowledge_base,
    v.id AS promotion_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.origin,
    v.since,
    s.committed_at AS since_at,
    EPOCH(s.committed_at) AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason,
    v.text
FROM promotion AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since
"""
COMMITTED_EPOCH = "    EPOCH(h.committed_at) AS committed_epoch"
VERIFIED_AT = "    c.verified_at"
FLEET_COLUMNS = f"""{COMMITTED_EPOCH},
    h.origin,
    c.revision AS verified_revision,
{VERIFIED_AT}"""
VERIFIED = "LEFT JOIN verification AS c ON c.kb_id = h.kb_id\n"
# The rows of a view are of the table that its query begins with: subqueries are indented.
FROM = re.compile(r"\nFROM (\w+) AS (\w)\n")
# Last, because `CREATE OR REPLACE VIEW` adds columns at the end only.
WITH_KB_ID = r",\n    \2.kb_id\nFROM \1 AS \2\n"


def upgrade() -> None:
    """Bring the tables to this version."""
    for name, kind, comment in ORIGIN:
        op.add_column("head", sa.Column(name, kind, nullable=True, comment=comment))
    _create_promotion()
    _create_verification()
    for name, query in _queries().items():
        if _is_sqlite():
            op.execute(f"DROP VIEW IF EXISTS {name}")
        _create_view("CREATE" if _is_sqlite() else "CREATE OR REPLACE", name, query)


def downgrade() -> None:
    """Bring the tables back to the version before; the origins of replicas are lost."""
    if context.get_revision_argument() is not None:
        _refuse_to_lose()
    for name in _queries():
        op.execute(f"DROP VIEW {name}")
    # Before the columns: SQLite drops none while a view is about what is not there.
    for name, query in _module("0005")._queries().items():
        _create_view("CREATE", name, query)
    op.drop_table("verification")
    op.drop_table("promotion")
    for name, *_ in reversed(ORIGIN):
        op.drop_column("head", name)


def _refuse_to_lose() -> None:
    """Refuse where the hash of a revision covers what the version before has no place for."""
    if context.is_offline_mode():
        raise CommandError("a downgrade below 0006 looks for promotions: run it without --sql")
    count = op.get_bind().scalar(sa.text("SELECT count(*) FROM promotion"))
    if count:
        raise CommandError(
            f"version {down_revision} has no place for promotions ({count}), whose revisions could "
            "not be verified any more; nothing was changed"
        )


def _create_promotion() -> None:
    op.create_table(
        "promotion",
        _key("kb_id"),
        _key("id"),
        sa.Column("since", NUMBER, nullable=False, comment="recorded in this revision"),
        sa.Column("revision", NUMBER, nullable=False, comment="the last one that was replicated"),
        sa.Column(
            "origin",
            LONG_TEXT,
            nullable=False,
            comment="where it was replicated from: a URL without its password",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="all of it in canonical form"),
        sa.PrimaryKeyConstraint("kb_id", "id", name="pk_promotion"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name="fk_promotion_kb_id"),
        _to_revision("since", "fk_promotion_kb_id_since", deferrable=True, initially="DEFERRED"),
        _to_revision("revision", "fk_promotion_last"),
    )
    for column in ("since", "revision"):
        op.create_index(f"ix_promotion_{column}", "promotion", ["kb_id", column])


def _create_verification() -> None:
    op.create_table(
        "verification",
        _key("kb_id"),
        sa.Column("revision", NUMBER, nullable=False, comment="verified up to this revision"),
        sa.Column("hash", LONG_TEXT, nullable=False, comment="of that revision, at that time"),
        sa.Column("verified_at", UTC_TIME, nullable=False, comment="UTC, when that was"),
        sa.Column(
            "complete_at",
            UTC_TIME,
            nullable=True,
            comment="UTC, when a verification that began at revision 1 last ended; NULL: none did",
        ),
        sa.PrimaryKeyConstraint("kb_id", name="pk_verification"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name="fk_verification_kb_id"),
    )


def _key(name: str) -> sa.Column[Any]:
    return sa.Column(name, NUMBER, autoincrement=False, nullable=False)


def _to_revision(column: str, name: str, **when: Any) -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint(
        ["kb_id", column], ["revision.kb_id", "revision.number"], name=name, **when
    )


def _is_sqlite() -> bool:
    return op.get_context().dialect.name == "sqlite"


def _module(version: str) -> ModuleType:
    script = op.get_context().script
    assert script is not None
    return script.get_revision(version).module


def _queries() -> dict[str, str]:
    """Give the queries of the views, in the words of no dialect."""
    queries: dict[str, str] = {**_module("0005")._queries(), "audit_promotion": AUDIT_PROMOTION}
    knowledge_base = queries["audit_knowledge_base"]
    queries["audit_knowledge_base"] = (
        f"{knowledge_base.replace(COMMITTED_EPOCH, FLEET_COLUMNS)}{VERIFIED}"
    )
    changes = queries["audit_change"].split("UNION ALL")
    (archived,) = (part for part in changes if "FROM archive AS" in part)
    changes.append(archived.replace("archive", "promotion"))
    queries["audit_change"] = "UNION ALL".join(changes)
    return {name: FROM.sub(WITH_KB_ID, query) for name, query in queries.items()}


def _create_view(verb: str, name: str, query: str) -> None:
    """Create a view, on SQLite in DuckDB's words as well."""
    if _is_sqlite():
        wrap = _module("0005")
        written = (
            f"{wrap.BEGIN}{wrap._in_sqlite(query)}{wrap.TURN}{_in_duckdb(name, query)}{wrap.END}"
        )
    else:
        views = _module("0001")
        written = views._in_dialect(query, views.POSTGRESQL).rstrip()
    op.execute(f"{verb} VIEW {name} AS{written}")


def _in_duckdb(name: str, query: str) -> str:
    wrap = _module("0005")
    typed = f"    CAST({VERIFIED_AT.strip()} AS TIMESTAMPTZ) AS verified_at"
    written: str = wrap._in_duckdb(name, query.replace(VERIFIED_AT, typed))
    return written
