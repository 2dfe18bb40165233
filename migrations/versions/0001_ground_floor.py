"""The ground floor: knowledge bases, revisions and the five PDDL elements."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import TIMESTAMP

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

# Spelt out here, not imported: a migration that has landed never changes with the library.
SHORT_TEXT = sa.String(255).with_variant(sa.String(255, collation="C"), "postgresql")
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
CANONICAL_JSON = sa.Text().with_variant(sa.JSON(none_as_null=True), "postgresql")
UTC_TIME = sa.String(27).with_variant(TIMESTAMP(timezone=True), "postgresql")


def upgrade() -> None:
    """Bring the tables to this version."""
    op.create_table(
        "knowledge_base",
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_knowledge_base")),
        sa.UniqueConstraint("name", name=op.f("uq_knowledge_base_name")),
    )
    op.create_table(
        "action",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_action_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_action")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_action_kb_id_key")),
    )
    op.create_table(
        "head",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "revision", sa.BigInteger(), nullable=False, comment="the last revision; 0: none yet"
        ),
        sa.Column(
            "definition_revision",
            sa.BigInteger(),
            nullable=False,
            comment="the last revision that changed anything but propositions",
        ),
        sa.Column(
            "next_id", sa.BigInteger(), nullable=False, comment="the id that the next element gets"
        ),
        sa.Column("hash", LONG_TEXT, nullable=True, comment="of the last revision"),
        sa.Column("committed_at", UTC_TIME, nullable=True, comment="of the last revision"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_head_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", name=op.f("pk_head")),
    )
    op.create_table(
        "object",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_object_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_object")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_object_kb_id_key")),
    )
    op.create_table(
        "predicate",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_predicate_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_predicate")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_predicate_kb_id_key")),
    )
    op.create_table(
        "revision",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "number",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="1, 2, 3 ... without gaps",
        ),
        sa.Column("committed_at", UTC_TIME, nullable=False, comment="UTC, never going back"),
        sa.Column("actor", LONG_TEXT, nullable=True, comment="the component that wrote"),
        sa.Column("reason", LONG_TEXT, nullable=True),
        sa.Column(
            "source",
            CANONICAL_JSON,
            nullable=True,
            comment="what the caller knows: sensor, plan step ...",
        ),
        sa.Column(
            "form", sa.Integer(), nullable=False, comment="version of the form that was hashed"
        ),
        sa.Column(
            "hash", LONG_TEXT, nullable=False, comment="SHA-256, chained to the revision before"
        ),
        sa.CheckConstraint("number > 0", name=op.f("ck_revision_number_positive")),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_revision_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "number", name=op.f("pk_revision")),
    )
    op.create_index("ix_revision_committed_at", "revision", ["kb_id", "committed_at"], unique=False)
    op.create_table(
        "type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_type_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_type")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_type_kb_id_key")),
    )
    op.create_table(
        "action_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("durative", sa.Boolean(), nullable=False),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.CheckConstraint("since < until", name=op.f("ck_action_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id"],
            ["action.kb_id", "action.id"],
            name=op.f("fk_action_version_kb_id_action_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_action_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_action_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "action_id", "since", name=op.f("pk_action_version")),
    )
    op.create_index("ix_action_version_since", "action_version", ["kb_id", "since"], unique=False)
    op.create_index(
        "ix_action_version_until",
        "action_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_action_version_live",
        "action_version",
        ["kb_id", "action_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "object_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("object_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.CheckConstraint("since < until", name=op.f("ck_object_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_object_version_kb_id_object_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_object_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_object_version_kb_id_type_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_object_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "object_id", "since", name=op.f("pk_object_version")),
    )
    op.create_index("ix_object_version_since", "object_version", ["kb_id", "since"], unique=False)
    op.create_index(
        "ix_object_version_until",
        "object_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_object_version_live",
        "object_version",
        ["kb_id", "object_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "predicate_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("predicate_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.CheckConstraint("since < until", name=op.f("ck_predicate_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_predicate_version_kb_id_predicate_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_predicate_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_predicate_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "predicate_id", "since", name=op.f("pk_predicate_version")
        ),
    )
    op.create_index(
        "ix_predicate_version_since", "predicate_version", ["kb_id", "since"], unique=False
    )
    op.create_index(
        "ix_predicate_version_until",
        "predicate_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_predicate_version_live",
        "predicate_version",
        ["kb_id", "predicate_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "proposition",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("predicate_id", sa.BigInteger(), nullable=False),
        sa.Column("is_goal", sa.Boolean(), nullable=False),
        sa.Column(
            "arguments",
            LONG_TEXT,
            nullable=False,
            comment="the ids of its objects in order, by spaces: the key that interns it",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_proposition_kb_id_predicate_id"),
        ),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_proposition")),
        sa.UniqueConstraint(
            "kb_id", "is_goal", "predicate_id", "arguments", name="uq_proposition_atom"
        ),
    )
    op.create_table(
        "type_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("type_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
            "parent_id",
            sa.BigInteger(),
            nullable=True,
            comment="the type above it; NULL: right under the root",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.CheckConstraint("since < until", name=op.f("ck_type_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "parent_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_type_version_kb_id_parent_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_type_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_type_version_kb_id_type_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_type_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "type_id", "since", name=op.f("pk_type_version")),
    )
    op.create_index("ix_type_version_since", "type_version", ["kb_id", "since"], unique=False)
    op.create_index(
        "ix_type_version_until",
        "type_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_type_version_live",
        "type_version",
        ["kb_id", "type_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "action_expression",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column(
            "section", sa.String(length=16), nullable=False, comment="duration, condition or effect"
        ),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column(
            "parent",
            sa.Integer(),
            nullable=True,
            comment="the position of the node above; NULL: the root",
        ),
        sa.Column(
            "operator",
            sa.String(length=32),
            nullable=False,
            comment="and, not, at start, over all, at end, =, predicate, variable, number",
        ),
        sa.Column("predicate_id", sa.BigInteger(), nullable=True),
        sa.Column(
            "value",
            LONG_TEXT,
            nullable=True,
            comment="a number as exact decimal text, or a variable's name",
        ),
        sa.CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)",
            name=op.f("ck_action_expression_predicate_given"),
        ),
        sa.CheckConstraint(
            "section IN ('duration', 'condition', 'effect')",
            name=op.f("ck_action_expression_section"),
        ),
        sa.CheckConstraint(
            "(parent IS NULL) = (position = 0)", name=op.f("ck_action_expression_one_root")
        ),
        sa.CheckConstraint("parent < position", name=op.f("ck_action_expression_preorder")),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "parent"],
            [
                "action_expression.kb_id",
                "action_expression.action_id",
                "action_expression.since",
                "action_expression.section",
                "action_expression.position",
            ],
            name=op.f("fk_action_expression_kb_id_action_id_since_section_parent"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since"],
            ["action_version.kb_id", "action_version.action_id", "action_version.since"],
            name=op.f("fk_action_expression_kb_id_action_id_since"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_action_expression_kb_id_predicate_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "action_id", "since", "section", "position", name=op.f("pk_action_expression")
        ),
    )
    op.create_index(
        "ix_action_expression_predicate",
        "action_expression",
        ["kb_id", "predicate_id"],
        unique=False,
    )
    op.create_table(
        "action_parameter",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="without its question mark"),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since"],
            ["action_version.kb_id", "action_version.action_id", "action_version.since"],
            name=op.f("fk_action_parameter_kb_id_action_id_since"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "action_id", "since", "position", name=op.f("pk_action_parameter")
        ),
    )
    op.create_table(
        "predicate_parameter",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("predicate_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="without its question mark"),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id", "since"],
            [
                "predicate_version.kb_id",
                "predicate_version.predicate_id",
                "predicate_version.since",
            ],
            name=op.f("fk_predicate_parameter_kb_id_predicate_id_since"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "predicate_id", "since", "position", name=op.f("pk_predicate_parameter")
        ),
    )
    op.create_table(
        "proposition_argument",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("proposition_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("object_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_proposition_argument_kb_id_object_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "proposition_id"],
            ["proposition.kb_id", "proposition.id"],
            name=op.f("fk_proposition_argument_kb_id_proposition_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "proposition_id", "position", name=op.f("pk_proposition_argument")
        ),
    )
    op.create_index(
        "ix_proposition_argument_object",
        "proposition_argument",
        ["kb_id", "object_id", "proposition_id"],
        unique=False,
    )
    op.create_table(
        "proposition_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("proposition_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("predicate_id", sa.BigInteger(), nullable=False),
        sa.CheckConstraint("since < until", name=op.f("ck_proposition_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_proposition_version_kb_id_predicate_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "proposition_id"],
            ["proposition.kb_id", "proposition.id"],
            name=op.f("fk_proposition_version_kb_id_proposition_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_proposition_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_proposition_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "proposition_id", "since", name=op.f("pk_proposition_version")
        ),
    )
    op.create_index(
        "ix_proposition_version_history",
        "proposition_version",
        ["kb_id", "predicate_id", "since", "until", "proposition_id"],
        unique=False,
    )
    op.create_index(
        "ix_proposition_version_now",
        "proposition_version",
        ["kb_id", "predicate_id", "proposition_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_index(
        "ix_proposition_version_since", "proposition_version", ["kb_id", "since"], unique=False
    )
    op.create_index(
        "ix_proposition_version_until",
        "proposition_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_proposition_version_live",
        "proposition_version",
        ["kb_id", "proposition_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "action_expression_term",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=16), nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("term", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column(
            "parameter",
            sa.Integer(),
            nullable=True,
            comment="the position of the action's parameter",
        ),
        sa.Column("object_id", sa.BigInteger(), nullable=True, comment="the constant"),
        sa.CheckConstraint(
            "(parameter IS NULL) <> (object_id IS NULL)",
            name=op.f("ck_action_expression_term_parameter_or_object"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "parameter"],
            [
                "action_parameter.kb_id",
                "action_parameter.action_id",
                "action_parameter.since",
                "action_parameter.position",
            ],
            name="fk_action_expression_term_parameter",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "position"],
            [
                "action_expression.kb_id",
                "action_expression.action_id",
                "action_expression.since",
                "action_expression.section",
                "action_expression.position",
            ],
            name="fk_action_expression_term_node",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_action_expression_term_kb_id_object_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "action_id",
            "since",
            "section",
            "position",
            "term",
            name=op.f("pk_action_expression_term"),
        ),
    )
    op.create_index(
        "ix_action_expression_term_object",
        "action_expression_term",
        ["kb_id", "object_id"],
        unique=False,
    )
    op.create_table(
        "action_parameter_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column(
            "alternative",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0: several for either",
        ),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "position"],
            [
                "action_parameter.kb_id",
                "action_parameter.action_id",
                "action_parameter.since",
                "action_parameter.position",
            ],
            name=op.f("fk_action_parameter_type_kb_id_action_id_since_position"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_action_parameter_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "action_id",
            "since",
            "position",
            "alternative",
            name=op.f("pk_action_parameter_type"),
        ),
    )
    op.create_index(
        "ix_action_parameter_type_type", "action_parameter_type", ["kb_id", "type_id"], unique=False
    )
    op.create_table(
        "predicate_parameter_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("predicate_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column(
            "alternative",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0: several for either",
        ),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id", "since", "position"],
            [
                "predicate_parameter.kb_id",
                "predicate_parameter.predicate_id",
                "predicate_parameter.since",
                "predicate_parameter.position",
            ],
            name=op.f("fk_predicate_parameter_type_kb_id_predicate_id_since_position"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_predicate_parameter_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "predicate_id",
            "since",
            "position",
            "alternative",
            name=op.f("pk_predicate_parameter_type"),
        ),
    )
    op.create_index(
        "ix_predicate_parameter_type_type",
        "predicate_parameter_type",
        ["kb_id", "type_id"],
        unique=False,
    )


def downgrade() -> None:
    """Bring the tables back to the version before."""
    op.drop_index("ix_predicate_parameter_type_type", table_name="predicate_parameter_type")
    op.drop_table("predicate_parameter_type")
    op.drop_index("ix_action_parameter_type_type", table_name="action_parameter_type")
    op.drop_table("action_parameter_type")
    op.drop_index("ix_action_expression_term_object", table_name="action_expression_term")
    op.drop_table("action_expression_term")
    op.drop_index(
        "uq_proposition_version_live",
        table_name="proposition_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index("ix_proposition_version_since", table_name="proposition_version")
    op.drop_index(
        "ix_proposition_version_until",
        table_name="proposition_version",
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.drop_index(
        "ix_proposition_version_now",
        table_name="proposition_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index("ix_proposition_version_history", table_name="proposition_version")
    op.drop_table("proposition_version")
    op.drop_index("ix_proposition_argument_object", table_name="proposition_argument")
    op.drop_table("proposition_argument")
    op.drop_table("predicate_parameter")
    op.drop_table("action_parameter")
    op.drop_index("ix_action_expression_predicate", table_name="action_expression")
    op.drop_table("action_expression")
    op.drop_index(
        "uq_type_version_live",
        table_name="type_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index(
        "ix_type_version_until",
        table_name="type_version",
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.drop_index("ix_type_version_since", table_name="type_version")
    op.drop_table("type_version")
    op.drop_table("proposition")
    op.drop_index(
        "uq_predicate_version_live",
        table_name="predicate_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index(
        "ix_predicate_version_until",
        table_name="predicate_version",
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.drop_index("ix_predicate_version_since", table_name="predicate_version")
    op.drop_table("predicate_version")
    op.drop_index(
        "uq_object_version_live",
        table_name="object_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index(
        "ix_object_version_until",
        table_name="object_version",
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.drop_index("ix_object_version_since", table_name="object_version")
    op.drop_table("object_version")
    op.drop_index(
        "uq_action_version_live",
        table_name="action_version",
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.drop_index(
        "ix_action_version_until",
        table_name="action_version",
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.drop_index("ix_action_version_since", table_name="action_version")
    op.drop_table("action_version")
    op.drop_table("type")
    op.drop_index("ix_revision_committed_at", table_name="revision")
    op.drop_table("revision")
    op.drop_table("predicate")
    op.drop_table("object")
    op.drop_table("head")
    op.drop_table("action")
    op.drop_table("knowledge_base")
