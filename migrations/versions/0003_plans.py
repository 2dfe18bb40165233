"""Plans, when things were observed, and archives."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

# Spelt out here, not imported: a migration that has landed never changes with the library.
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")

# What version 0002 has no place for, and how much of it was ever there.
STRANGE = {
    "plans": "SELECT count(*) FROM plan",
    "archives": "SELECT count(*) FROM archive",
    "revisions that say when things were observed": (
        "SELECT count(*) FROM revision WHERE observed_at IS NOT NULL"
    ),
}

NEW_TABLES = [
    *("plan", "plan_step", "plan_step_argument", "plan_step_version", "revision_plan_step"),
    "archive",
]


def upgrade() -> None:
    """Bring the tables to this version."""
    _create_plans()
    _create_outcomes()
    _create_archives()
    _extend()


def downgrade() -> None:
    """Bring the tables back to the version before."""
    # To go on to base is to drop all that is stored: then nothing has to find a place.
    if context.get_revision_argument() is not None:
        _refuse_to_lose()
    for table in reversed(NEW_TABLES):
        op.drop_table(table)
    op.drop_column("head", "archived_revision")
    op.drop_column("revision", "observed_at")


def _refuse_to_lose() -> None:
    """Refuse to drop a part of the history, whose hashes would then fit nothing."""
    if context.is_offline_mode():
        raise CommandError(
            "a downgrade to 0002 has to look at what is stored first: run it on the database, "
            "without --sql"
        )
    connection = op.get_bind()
    counts = {what: connection.scalar(sa.text(query)) for what, query in STRANGE.items()}
    found = ", ".join(f"{what} ({count})" for what, count in counts.items() if count)
    if found:
        raise CommandError(
            f"version 0002 has no place for what is or was in this store: {found}; nothing was "
            "changed: stay at 0003, or go to base, which drops all"
        )


def _create_plans() -> None:
    """Make the tables of plans."""
    op.create_table(
        "plan",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("since", sa.BigInteger(), nullable=False, comment="recorded in this revision"),
        sa.Column(
            "revision",
            sa.BigInteger(),
            nullable=False,
            comment="the state that it was planned from",
        ),
        sa.Column(
            "problem_hash",
            LONG_TEXT,
            nullable=False,
            comment="SHA-256 of the domain and then the problem that the planner was given",
        ),
        sa.Column("planner", LONG_TEXT, nullable=True),
        sa.Column("planner_version", LONG_TEXT, nullable=True),
        sa.Column(
            "objective", LONG_TEXT, nullable=True, comment="what the plan is to make small or large"
        ),
        sa.Column(
            "value",
            LONG_TEXT,
            nullable=True,
            comment="what the objective comes to, as exact decimal text",
        ),
        sa.Column("status", LONG_TEXT, nullable=True, comment="what the planner says of it"),
        sa.Column(
            "domain_pddl",
            LONG_TEXT,
            nullable=True,
            comment="what the planner was given, if it is not what the store writes",
        ),
        sa.Column(
            "problem_pddl",
            LONG_TEXT,
            nullable=True,
            comment="what the planner was given, if it is not what the store writes",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="all of it in canonical form"),
        sa.ForeignKeyConstraint(
            ["kb_id", "revision"], ["revision.kb_id", "revision.number"], name="fk_plan_problem"
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_plan_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_plan_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_plan")),
    )
    op.create_index("ix_plan_revision", "plan", ["kb_id", "revision"], unique=False)
    op.create_index("ix_plan_since", "plan", ["kb_id", "since"], unique=False)
    op.create_table(
        "plan_step",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("plan_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column(
            "start",
            LONG_TEXT,
            nullable=True,
            comment="seconds from the plan's beginning, as exact decimal text",
        ),
        sa.Column(
            "duration",
            LONG_TEXT,
            nullable=True,
            comment="seconds, as exact decimal text; NULL: an instant",
        ),
        sa.Column("action_id", sa.BigInteger(), nullable=False),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL, without times"),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id"],
            ["action.kb_id", "action.id"],
            name=op.f("fk_plan_step_kb_id_action_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "plan_id"], ["plan.kb_id", "plan.id"], name=op.f("fk_plan_step_kb_id_plan_id")
        ),
        sa.PrimaryKeyConstraint("kb_id", "plan_id", "position", name=op.f("pk_plan_step")),
    )
    op.create_index("ix_plan_step_action", "plan_step", ["kb_id", "action_id"], unique=False)
    op.create_table(
        "plan_step_argument",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("plan_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("argument", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("object_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_plan_step_argument_kb_id_object_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "plan_id", "position"],
            ["plan_step.kb_id", "plan_step.plan_id", "plan_step.position"],
            name=op.f("fk_plan_step_argument_kb_id_plan_id_position"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "plan_id", "position", "argument", name=op.f("pk_plan_step_argument")
        ),
    )
    op.create_index(
        "ix_plan_step_argument_object", "plan_step_argument", ["kb_id", "object_id"], unique=False
    )


def _create_outcomes() -> None:
    """Make the tables of what became of them."""
    op.create_table(
        "plan_step_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("plan_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column(
            "until",
            sa.BigInteger(),
            nullable=True,
            comment="retracted in this revision; NULL: holds now",
        ),
        sa.Column(
            "status",
            sa.String(length=16),
            nullable=False,
            comment="started, succeeded, failed or aborted",
        ),
        sa.Column(
            "text", LONG_TEXT, nullable=False, comment="which step of which plan, and its status"
        ),
        sa.CheckConstraint(
            "status IN ('started', 'succeeded', 'failed', 'aborted')",
            name=op.f("ck_plan_step_version_status"),
        ),
        sa.CheckConstraint("since < until", name=op.f("ck_plan_step_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "plan_id", "position"],
            ["plan_step.kb_id", "plan_step.plan_id", "plan_step.position"],
            name=op.f("fk_plan_step_version_kb_id_plan_id_position"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_plan_step_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_plan_step_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "plan_id", "position", "since", name=op.f("pk_plan_step_version")
        ),
    )
    op.create_index(
        "ix_plan_step_version_since", "plan_step_version", ["kb_id", "since"], unique=False
    )
    op.create_index(
        "ix_plan_step_version_until",
        "plan_step_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_plan_step_version_live",
        "plan_step_version",
        ["kb_id", "plan_id", "position"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "revision_plan_step",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "number", sa.BigInteger(), autoincrement=False, nullable=False, comment="the revision"
        ),
        sa.Column("plan_id", sa.BigInteger(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False, comment="the step's"),
        sa.ForeignKeyConstraint(
            ["kb_id", "number"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_revision_plan_step_kb_id_number"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "plan_id", "position"],
            ["plan_step.kb_id", "plan_step.plan_id", "plan_step.position"],
            name=op.f("fk_revision_plan_step_kb_id_plan_id_position"),
        ),
        sa.PrimaryKeyConstraint("kb_id", "number", name=op.f("pk_revision_plan_step")),
    )
    op.create_index(
        "ix_revision_plan_step_step",
        "revision_plan_step",
        ["kb_id", "plan_id", "position", "number"],
        unique=False,
    )


def _create_archives() -> None:
    """Make the table of what was moved elsewhere."""
    op.create_table(
        "archive",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("since", sa.BigInteger(), nullable=False, comment="recorded in this revision"),
        sa.Column(
            "revision",
            sa.BigInteger(),
            nullable=False,
            comment="the versions that ended up to this revision were moved",
        ),
        sa.Column(
            "target", LONG_TEXT, nullable=False, comment="where to: a URL without its password"
        ),
        sa.Column("versions", sa.BigInteger(), nullable=False, comment="how many were moved"),
        sa.Column(
            "rest",
            LONG_TEXT,
            nullable=False,
            comment="SHA-256 of what this store keeps of the revisions up to there",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="all of it in canonical form"),
        sa.ForeignKeyConstraint(
            ["kb_id", "revision"], ["revision.kb_id", "revision.number"], name="fk_archive_upto"
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_archive_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_archive_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_archive")),
    )
    op.create_index("ix_archive_revision", "archive", ["kb_id", "revision"], unique=False)
    op.create_index("ix_archive_since", "archive", ["kb_id", "since"], unique=False)


def _extend() -> None:
    """Add columns to the tables that are there."""
    op.add_column(
        "head",
        sa.Column(
            "archived_revision",
            sa.BigInteger(),
            server_default=sa.text("0"),
            nullable=False,
            comment="what ended up to this revision is in an archive; 0: nothing is",
        ),
    )
    op.add_column(
        "revision",
        sa.Column(
            "observed_at",
            UTC_TIME,
            nullable=True,
            comment="UTC, when what it says was sensed; NULL: not said",
        ),
    )
