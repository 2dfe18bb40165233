"""A table of requests over HTTP that were written, so that their repetitions write nothing."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger()
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")


def upgrade() -> None:
    """Bring the tables to this version."""
    op.create_table(
        "request",
        sa.Column("kb_id", NUMBER, primary_key=True, autoincrement=False),
        sa.Column(
            "key",
            LONG_TEXT,
            primary_key=True,
            comment="SHA-256 of the token's id and of the key that the client chose",
        ),
        sa.Column("number", NUMBER, nullable=False, comment="the revision that it made"),
        sa.Column(
            "digest", LONG_TEXT, nullable=False, comment="SHA-256 of the client's key and request"
        ),
        sa.Column(
            "results",
            LONG_TEXT,
            nullable=False,
            comment="what its changes returned, as JSON: no names",
        ),
        sa.PrimaryKeyConstraint("kb_id", "key", name="pk_request"),
        sa.ForeignKeyConstraint(
            ["kb_id", "number"],
            ["revision.kb_id", "revision.number"],
            name="fk_request_kb_id_number",
        ),
    )
    op.create_index("ix_request_number", "request", ["kb_id", "number"])


def downgrade() -> None:
    """Bring the tables back to the version before; what is repeated later is written twice."""
    op.drop_table("request")
