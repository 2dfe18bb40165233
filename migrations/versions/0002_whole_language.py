"""The whole language: functions, formulas of any form, processes and events, documents."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

# Spelt out here, not imported: a migration that has landed never changes with the library.
SHORT_TEXT = sa.String(255).with_variant(sa.String(255, collation="C"), "postgresql")
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")

ONE_OF_FOUR = (
    "CASE WHEN parameter IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN variable IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1"
)

ACTION_OF_PARAMETER = "fk_action_parameter_kb_id_action_id_since"

# What both versions have of a node and of a term.
NODE = "kb_id, action_id, since, section, position, parent, operator, predicate_id, value"
TERM = "kb_id, action_id, since, section, position, term, parameter, object_id"

# What version 0001 knows of trees: conjunctions of literals, and one fixed duration. In a tree of a
# kind, below a node (none: the root), a node; times are one operator here.
KNOWN_NODES = """
    ('action', '', 'and'), ('action', 'and', 'not'), ('action', 'and', 'predicate'),
    ('action', 'not', 'predicate'),
    ('durative-action', '', 'and'), ('durative-action', 'and', 'time'),
    ('durative-action', 'time', 'not'), ('durative-action', 'time', 'predicate'),
    ('durative-action', 'not', 'predicate'),
    ('duration', '', '='), ('duration', '=', 'variable'), ('duration', '=', 'number')
"""
TIMES = "('at start', 'over all', 'at end')"
OF_VERSION = "{0}.kb_id = v.kb_id AND {0}.action_id = v.action_id AND {0}.since = v.since"
# Three nodes of a duration that all differ are `=`, `variable` and `number`.
STRANGE_ACTIONS = f"""
    SELECT count(*) FROM action_version AS v
    WHERE kind IN ('action', 'durative-action') AND (
        EXISTS (
            SELECT 1 FROM action_node AS n
            LEFT JOIN action_node AS p ON p.kb_id = n.kb_id AND p.action_id = n.action_id
                AND p.since = n.since AND p.section = n.section AND p.position = n.parent
            WHERE {OF_VERSION.format("n")} AND (
                CASE WHEN n.section = 'duration' THEN n.section ELSE v.kind END,
                CASE WHEN p.operator IN {TIMES} THEN 'time' ELSE COALESCE(p.operator, '') END,
                CASE WHEN n.operator IN {TIMES} THEN 'time' ELSE n.operator END
            ) NOT IN (VALUES {KNOWN_NODES})
        )
        OR EXISTS (
            SELECT 1 FROM action_term AS t
            WHERE {OF_VERSION.format("t")} AND parameter IS NULL AND object_id IS NULL
        )
        OR (
            SELECT count(*) + count(DISTINCT operator) FROM action_node AS n
            WHERE {OF_VERSION.format("n")} AND section = 'duration'
        ) <> CASE kind WHEN 'durative-action' THEN 6 ELSE 0 END
    )
"""
# What version 0001 has no place for, and how much of it was ever there.
STRANGE = {
    "functions": "SELECT count(*) FROM function",
    "values of functions": "SELECT count(*) FROM function_value",
    "formulas": "SELECT count(*) FROM formula",
    "documents": "SELECT count(*) FROM document",
    "further parents of types": "SELECT count(*) FROM type_parent",
    "further types of objects": "SELECT count(*) FROM object_type",
    "constants": "SELECT count(*) FROM object_version WHERE is_constant",
    "processes": "SELECT count(*) FROM action_version WHERE kind = 'process'",
    "events": "SELECT count(*) FROM action_version WHERE kind = 'event'",
    "actions of more than literals and a fixed duration": STRANGE_ACTIONS,
}

NEW_TABLES = [
    *("type_parent", "object_type"),
    *("function", "function_version", "function_parameter", "function_parameter_type"),
    *("function_type", "function_value", "function_value_argument", "function_value_version"),
    *("action_node", "action_variable", "action_variable_type", "action_term"),
    *("formula", "formula_version", "formula_node", "formula_variable", "formula_variable_type"),
    *("formula_term", "document", "document_version", "document_item"),
]


def upgrade() -> None:
    """Bring the tables to this version."""
    _give_actions_a_kind()
    _change_versions()
    _create_either()
    _create_functions()
    _create_action_trees()
    _create_formulas()
    _create_documents()
    op.execute(f"INSERT INTO action_node ({NODE}) SELECT {NODE} FROM action_expression")
    op.execute(f"INSERT INTO action_term ({TERM}) SELECT {TERM} FROM action_expression_term")
    op.drop_table("action_expression_term")
    op.drop_table("action_expression")
    for element in ("type", "object", "predicate", "action"):
        _index_since(element, ["kb_id", "since", f"{element}_id"])


def downgrade() -> None:
    """Bring the tables back to the version before."""
    # To go on to base is to drop all that is stored: then nothing has to find a place.
    to_base = context.get_revision_argument() is None
    if not to_base:
        _refuse_to_lose()
    for element in ("type", "object", "predicate"):
        _index_since(element, ["kb_id", "since"])
    _give_actions_a_flag()
    _change_versions_back()
    _create_action_expressions()
    if not to_base:
        op.execute(f"INSERT INTO action_expression ({NODE}) SELECT {NODE} FROM action_node")
        op.execute(f"INSERT INTO action_expression_term ({TERM}) SELECT {TERM} FROM action_term")
    for table in reversed(NEW_TABLES):
        op.drop_table(table)


def _index_since(element: str, columns: list[str]) -> None:
    """Index what a revision asserted by other columns than before."""
    name, table = f"ix_{element}_version_since", f"{element}_version"
    op.drop_index(name, table_name=table)
    op.create_index(name, table, columns, unique=False)


def _change_versions() -> None:
    """Mark constants and goals."""
    op.add_column(
        "object_version",
        sa.Column(
            "is_constant",
            sa.Boolean(),
            server_default=sa.false(),
            nullable=False,
            comment="declared in the domain, not in the problem",
        ),
    )
    op.add_column(
        "proposition_version",
        sa.Column("is_goal", sa.Boolean(), server_default=sa.false(), nullable=False),
    )
    # Facts are many, and stay as they are.
    op.execute(
        "UPDATE proposition_version SET is_goal = true WHERE EXISTS ("
        "SELECT 1 FROM proposition WHERE proposition.kb_id = proposition_version.kb_id"
        " AND proposition.id = proposition_version.proposition_id AND proposition.is_goal)"
    )
    op.create_index(
        "ix_proposition_version_goal",
        "proposition_version",
        ["kb_id", "until", "since", "proposition_id"],
        unique=False,
        # SQLite uses a partial index only where a query repeats its very condition.
        sqlite_where=sa.text("is_goal = 1"),
        postgresql_where=sa.text("is_goal"),
    )
    op.create_index(
        "ix_proposition_version_goal_history",
        "proposition_version",
        ["kb_id", "since", "until", "proposition_id"],
        unique=False,
        sqlite_where=sa.text("is_goal = 1"),
        postgresql_where=sa.text("is_goal"),
    )


def _change_versions_back() -> None:
    """Take the marks of constants and goals away."""
    op.drop_index(
        "ix_proposition_version_goal_history",
        table_name="proposition_version",
        sqlite_where=sa.text("is_goal = 1"),
        postgresql_where=sa.text("is_goal"),
    )
    op.drop_index(
        "ix_proposition_version_goal",
        table_name="proposition_version",
        sqlite_where=sa.text("is_goal = 1"),
        postgresql_where=sa.text("is_goal"),
    )
    op.drop_column("proposition_version", "is_goal")
    op.drop_column("object_version", "is_constant")


def _refuse_to_lose() -> None:
    """Refuse to drop a part of the history, whose hashes would then fit nothing."""
    if context.is_offline_mode():
        raise CommandError(
            "a downgrade to 0001 has to look at what is stored first: run it on the database, "
            "without --sql"
        )
    connection = op.get_bind()
    counts = {what: connection.scalar(sa.text(query)) for what, query in STRANGE.items()}
    found = ", ".join(f"{what} ({count})" for what, count in counts.items() if count)
    if found:
        raise CommandError(
            f"version 0001 has no place for what is or was in this store: {found}; nothing was "
            "changed: stay at 0002, or go to base, which drops all"
        )


def _give_actions_a_kind() -> None:
    """Say of each action what it is."""
    kind = sa.Column(
        "kind",
        sa.String(length=16),
        server_default="action",
        nullable=False,
        comment="action, durative-action, process or event",
    )
    _rebuild_action_version(
        [sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"), kind],
        "text, CASE WHEN durative THEN 'durative-action' ELSE 'action' END AS kind",
        ("action_expression", "fk_action_expression_kb_id_action_id_since"),
    )


def _give_actions_a_flag() -> None:
    """Say of each action whether it is durative, as version 0001 does."""
    _rebuild_action_version(
        [
            sa.Column("durative", sa.Boolean(), nullable=False),
            sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        ],
        "kind = 'durative-action' AS durative, text",
        ("action_node", "fk_action_node_version"),
    )


def _rebuild_action_version(
    columns: list[sa.Column[Any]], values: str, trees: tuple[str, str]
) -> None:
    """Make the table anew: no SQLite can put a column between others, and old ones drop none.

    Args:
        columns: the columns behind those that stay.
        values: what is in them, with their names.
        trees: a table that is about to be dropped, and its foreign key to this one.
    """
    # SQLite checks no foreign key while it migrates.
    on_server = op.get_context().dialect.name == "postgresql"
    names = ", ".join(["kb_id", "action_id", "since", "until", *(part.name for part in columns)])
    op.execute(
        "CREATE TEMPORARY TABLE kept_action_version AS"
        f" SELECT kb_id, action_id, since, until, {values} FROM action_version"
    )
    if on_server:
        op.drop_constraint(trees[1], trees[0], type_="foreignkey")
        op.drop_constraint(ACTION_OF_PARAMETER, "action_parameter", type_="foreignkey")
    op.drop_table("action_version")
    _create_action_version(columns)
    op.execute(f"INSERT INTO action_version ({names}) SELECT {names} FROM kept_action_version")
    op.execute("DROP TABLE kept_action_version")
    if on_server:
        # A table with checks that are still to be made at commit cannot be altered.
        op.execute("SET CONSTRAINTS ALL IMMEDIATE")
        key = ["kb_id", "action_id", "since"]
        op.create_foreign_key(ACTION_OF_PARAMETER, "action_parameter", "action_version", key, key)


def _create_action_version(columns: list[sa.Column[Any]]) -> None:
    """Make the table, with the columns that each of the two versions has."""
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
        *columns,
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


def _create_either() -> None:
    """Make the tables of what `either` adds to a type's parents and an object's types."""
    op.create_table(
        "type_parent",
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
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 1: the first is in the version",
        ),
        sa.Column("parent_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "parent_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_type_parent_kb_id_parent_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id", "since"],
            ["type_version.kb_id", "type_version.type_id", "type_version.since"],
            name=op.f("fk_type_parent_kb_id_type_id_since"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "type_id", "since", "position", name=op.f("pk_type_parent")
        ),
    )
    op.create_index("ix_type_parent_parent", "type_parent", ["kb_id", "parent_id"], unique=False)
    op.create_table(
        "object_type",
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
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 1: the first is in the version",
        ),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id", "since"],
            ["object_version.kb_id", "object_version.object_id", "object_version.since"],
            name=op.f("fk_object_type_kb_id_object_id_since"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_object_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "object_id", "since", "position", name=op.f("pk_object_type")
        ),
    )
    op.create_index("ix_object_type_type", "object_type", ["kb_id", "type_id"], unique=False)


def _create_functions() -> None:
    """Make the tables of functions and of what they map their arguments to."""
    op.create_table(
        "function",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_function_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_function")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_function_kb_id_key")),
    )
    op.create_table(
        "function_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.CheckConstraint("since < until", name=op.f("ck_function_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id"],
            ["function.kb_id", "function.id"],
            name=op.f("fk_function_version_kb_id_function_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_function_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_function_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "function_id", "since", name=op.f("pk_function_version")),
    )
    op.create_index(
        "ix_function_version_since",
        "function_version",
        ["kb_id", "since", "function_id"],
        unique=False,
    )
    op.create_index(
        "ix_function_version_until",
        "function_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_function_version_live",
        "function_version",
        ["kb_id", "function_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "function_parameter",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
            ["kb_id", "function_id", "since"],
            ["function_version.kb_id", "function_version.function_id", "function_version.since"],
            name=op.f("fk_function_parameter_kb_id_function_id_since"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "function_id", "since", "position", name=op.f("pk_function_parameter")
        ),
    )
    op.create_table(
        "function_parameter_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
            ["kb_id", "function_id", "since", "position"],
            [
                "function_parameter.kb_id",
                "function_parameter.function_id",
                "function_parameter.since",
                "function_parameter.position",
            ],
            name=op.f("fk_function_parameter_type_kb_id_function_id_since_position"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_function_parameter_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "function_id",
            "since",
            "position",
            "alternative",
            name=op.f("pk_function_parameter_type"),
        ),
    )
    op.create_index(
        "ix_function_parameter_type_type",
        "function_parameter_type",
        ["kb_id", "type_id"],
        unique=False,
    )
    op.create_table(
        "function_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id", "since"],
            ["function_version.kb_id", "function_version.function_id", "function_version.since"],
            name=op.f("fk_function_type_kb_id_function_id_since"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_function_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "function_id", "since", "position", name=op.f("pk_function_type")
        ),
    )
    op.create_index("ix_function_type_type", "function_type", ["kb_id", "type_id"], unique=False)
    op.create_table(
        "function_value",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_id", sa.BigInteger(), nullable=False),
        sa.Column(
            "arguments",
            LONG_TEXT,
            nullable=False,
            comment="the ids of its objects in order, by spaces: the key that interns it",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL, without the value"),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id"],
            ["function.kb_id", "function.id"],
            name=op.f("fk_function_value_kb_id_function_id"),
        ),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_function_value")),
        sa.UniqueConstraint("kb_id", "function_id", "arguments", name="uq_function_value_fluent"),
    )
    op.create_table(
        "function_value_argument",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_value_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("object_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_value_id"],
            ["function_value.kb_id", "function_value.id"],
            name=op.f("fk_function_value_argument_kb_id_function_value_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_function_value_argument_kb_id_object_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "function_value_id", "position", name=op.f("pk_function_value_argument")
        ),
    )
    op.create_index(
        "ix_function_value_argument_object",
        "function_value_argument",
        ["kb_id", "object_id", "function_value_id"],
        unique=False,
    )
    op.create_table(
        "function_value_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("function_value_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("function_id", sa.BigInteger(), nullable=False),
        sa.Column("value", LONG_TEXT, nullable=True, comment="the number, as exact decimal text"),
        sa.Column(
            "number", sa.Double(), nullable=True, comment="the number, as near as a double comes"
        ),
        sa.Column("object_id", sa.BigInteger(), nullable=True, comment="the object that it is"),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL, with the value"),
        sa.CheckConstraint(
            "(value IS NULL) <> (object_id IS NULL)",
            name=op.f("ck_function_value_version_value_or_object"),
        ),
        sa.CheckConstraint(
            "(value IS NULL) = (number IS NULL)",
            name=op.f("ck_function_value_version_number_of_value"),
        ),
        sa.CheckConstraint(
            "since < until", name=op.f("ck_function_value_version_since_before_until")
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id"],
            ["function.kb_id", "function.id"],
            name=op.f("fk_function_value_version_kb_id_function_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_value_id"],
            ["function_value.kb_id", "function_value.id"],
            name=op.f("fk_function_value_version_kb_id_function_value_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_function_value_version_kb_id_object_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_function_value_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_function_value_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "function_value_id", "since", name=op.f("pk_function_value_version")
        ),
    )
    op.create_index(
        "ix_function_value_version_history",
        "function_value_version",
        ["kb_id", "function_id", "since", "until", "function_value_id"],
        unique=False,
    )
    op.create_index(
        "ix_function_value_version_now",
        "function_value_version",
        ["kb_id", "function_id", "function_value_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_index(
        "ix_function_value_version_object",
        "function_value_version",
        ["kb_id", "object_id"],
        unique=False,
        sqlite_where=sa.text("object_id IS NOT NULL"),
        postgresql_where=sa.text("object_id IS NOT NULL"),
    )
    op.create_index(
        "ix_function_value_version_since",
        "function_value_version",
        ["kb_id", "since"],
        unique=False,
    )
    op.create_index(
        "ix_function_value_version_until",
        "function_value_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_function_value_version_live",
        "function_value_version",
        ["kb_id", "function_value_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )


def _create_action_trees() -> None:
    """Make the tables of the trees of actions."""
    op.create_table(
        "action_node",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
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
            comment="and, not, over all, increase, predicate, function, number ...",
        ),
        sa.Column("predicate_id", sa.BigInteger(), nullable=True),
        sa.Column("function_id", sa.BigInteger(), nullable=True),
        sa.Column(
            "value",
            LONG_TEXT,
            nullable=True,
            comment="a number as exact decimal text, a variable's or a preference's name",
        ),
        sa.CheckConstraint(
            "(operator = 'function') = (function_id IS NOT NULL)",
            name=op.f("ck_action_node_function_given"),
        ),
        sa.CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)",
            name=op.f("ck_action_node_predicate_given"),
        ),
        sa.CheckConstraint(
            "section IN ('duration', 'condition', 'effect')", name=op.f("ck_action_node_section")
        ),
        sa.CheckConstraint(
            "(parent IS NULL) = (position = 0)", name=op.f("ck_action_node_one_root")
        ),
        sa.CheckConstraint("parent < position", name=op.f("ck_action_node_preorder")),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "parent"],
            [
                "action_node.kb_id",
                "action_node.action_id",
                "action_node.since",
                "action_node.section",
                "action_node.position",
            ],
            name="fk_action_node_parent",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since"],
            ["action_version.kb_id", "action_version.action_id", "action_version.since"],
            name="fk_action_node_version",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id"],
            ["function.kb_id", "function.id"],
            name=op.f("fk_action_node_kb_id_function_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_action_node_kb_id_predicate_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "action_id", "since", "section", "position", name=op.f("pk_action_node")
        ),
    )
    op.create_index(
        "ix_action_node_function", "action_node", ["kb_id", "function_id"], unique=False
    )
    op.create_index(
        "ix_action_node_predicate", "action_node", ["kb_id", "predicate_id"], unique=False
    )
    op.create_table(
        "action_variable",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("variable", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="without its question mark"),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "position"],
            [
                "action_node.kb_id",
                "action_node.action_id",
                "action_node.since",
                "action_node.section",
                "action_node.position",
            ],
            name="fk_action_variable_node",
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "action_id",
            "since",
            "section",
            "position",
            "variable",
            name=op.f("pk_action_variable"),
        ),
    )
    op.create_table(
        "action_variable_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("variable", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column(
            "alternative",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0: several for either",
        ),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "position", "variable"],
            [
                "action_variable.kb_id",
                "action_variable.action_id",
                "action_variable.since",
                "action_variable.section",
                "action_variable.position",
                "action_variable.variable",
            ],
            name="fk_action_variable_type_variable",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_action_variable_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "action_id",
            "since",
            "section",
            "position",
            "variable",
            "alternative",
            name=op.f("pk_action_variable_type"),
        ),
    )
    op.create_index(
        "ix_action_variable_type_type", "action_variable_type", ["kb_id", "type_id"], unique=False
    )
    op.create_table(
        "action_term",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("action_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("term", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column(
            "parameter",
            sa.Integer(),
            nullable=True,
            comment="the position of the owner's parameter",
        ),
        sa.Column("object_id", sa.BigInteger(), nullable=True, comment="the constant"),
        sa.Column(
            "quantifier",
            sa.Integer(),
            nullable=True,
            comment="the position of the node that binds the variable",
        ),
        sa.Column(
            "variable",
            sa.Integer(),
            nullable=True,
            comment="which of the quantifier's variables it is",
        ),
        sa.Column(
            "child",
            sa.Integer(),
            nullable=True,
            comment="the position of the function node whose value it is",
        ),
        sa.CheckConstraint(
            "(quantifier IS NULL) = (variable IS NULL)", name=op.f("ck_action_term_bound")
        ),
        sa.CheckConstraint(ONE_OF_FOUR, name=op.f("ck_action_term_one_of_four")),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "parameter"],
            [
                "action_parameter.kb_id",
                "action_parameter.action_id",
                "action_parameter.since",
                "action_parameter.position",
            ],
            name="fk_action_term_parameter",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "child"],
            [
                "action_node.kb_id",
                "action_node.action_id",
                "action_node.since",
                "action_node.section",
                "action_node.position",
            ],
            name="fk_action_term_child",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "position"],
            [
                "action_node.kb_id",
                "action_node.action_id",
                "action_node.since",
                "action_node.section",
                "action_node.position",
            ],
            name="fk_action_term_node",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "action_id", "since", "section", "quantifier", "variable"],
            [
                "action_variable.kb_id",
                "action_variable.action_id",
                "action_variable.since",
                "action_variable.section",
                "action_variable.position",
                "action_variable.variable",
            ],
            name="fk_action_term_variable",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_action_term_kb_id_object_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "action_id",
            "since",
            "section",
            "position",
            "term",
            name=op.f("pk_action_term"),
        ),
    )
    op.create_index("ix_action_term_object", "action_term", ["kb_id", "object_id"], unique=False)


def _create_formulas() -> None:
    """Make the tables of formulas that stand on their own."""
    op.create_table(
        "formula",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_formula_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_formula")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_formula_kb_id_key")),
    )
    op.create_table(
        "formula_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("formula_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
            "section",
            sa.String(length=24),
            nullable=False,
            comment="the part of the domain or the problem that it stands in",
        ),
        sa.Column("text", LONG_TEXT, nullable=False, comment="canonical PDDL"),
        sa.CheckConstraint(
            "section IN ('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', "
            "'metric')",
            name=op.f("ck_formula_version_section"),
        ),
        sa.CheckConstraint("since < until", name=op.f("ck_formula_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id"],
            ["formula.kb_id", "formula.id"],
            name=op.f("fk_formula_version_kb_id_formula_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_formula_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_formula_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "formula_id", "since", name=op.f("pk_formula_version")),
    )
    op.create_index(
        "ix_formula_version_since",
        "formula_version",
        ["kb_id", "since", "formula_id"],
        unique=False,
    )
    op.create_index(
        "ix_formula_version_until",
        "formula_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_formula_version_live",
        "formula_version",
        ["kb_id", "formula_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "formula_node",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("formula_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
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
            comment="and, not, over all, increase, predicate, function, number ...",
        ),
        sa.Column("predicate_id", sa.BigInteger(), nullable=True),
        sa.Column("function_id", sa.BigInteger(), nullable=True),
        sa.Column(
            "value",
            LONG_TEXT,
            nullable=True,
            comment="a number as exact decimal text, a variable's or a preference's name",
        ),
        sa.CheckConstraint(
            "(operator = 'function') = (function_id IS NOT NULL)",
            name=op.f("ck_formula_node_function_given"),
        ),
        sa.CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)",
            name=op.f("ck_formula_node_predicate_given"),
        ),
        sa.CheckConstraint(
            "(parent IS NULL) = (position = 0)", name=op.f("ck_formula_node_one_root")
        ),
        sa.CheckConstraint("parent < position", name=op.f("ck_formula_node_preorder")),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "parent"],
            [
                "formula_node.kb_id",
                "formula_node.formula_id",
                "formula_node.since",
                "formula_node.section",
                "formula_node.position",
            ],
            name="fk_formula_node_parent",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since"],
            ["formula_version.kb_id", "formula_version.formula_id", "formula_version.since"],
            name="fk_formula_node_version",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "function_id"],
            ["function.kb_id", "function.id"],
            name=op.f("fk_formula_node_kb_id_function_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "predicate_id"],
            ["predicate.kb_id", "predicate.id"],
            name=op.f("fk_formula_node_kb_id_predicate_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "formula_id", "since", "section", "position", name=op.f("pk_formula_node")
        ),
    )
    op.create_index(
        "ix_formula_node_function", "formula_node", ["kb_id", "function_id"], unique=False
    )
    op.create_index(
        "ix_formula_node_predicate", "formula_node", ["kb_id", "predicate_id"], unique=False
    )
    op.create_table(
        "formula_variable",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("formula_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("variable", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="without its question mark"),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "position"],
            [
                "formula_node.kb_id",
                "formula_node.formula_id",
                "formula_node.since",
                "formula_node.section",
                "formula_node.position",
            ],
            name="fk_formula_variable_node",
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "formula_id",
            "since",
            "section",
            "position",
            "variable",
            name=op.f("pk_formula_variable"),
        ),
    )
    op.create_table(
        "formula_variable_type",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("formula_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("variable", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column(
            "alternative",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0: several for either",
        ),
        sa.Column("type_id", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "position", "variable"],
            [
                "formula_variable.kb_id",
                "formula_variable.formula_id",
                "formula_variable.since",
                "formula_variable.section",
                "formula_variable.position",
                "formula_variable.variable",
            ],
            name="fk_formula_variable_type_variable",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "type_id"],
            ["type.kb_id", "type.id"],
            name=op.f("fk_formula_variable_type_kb_id_type_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "formula_id",
            "since",
            "section",
            "position",
            "variable",
            "alternative",
            name=op.f("pk_formula_variable_type"),
        ),
    )
    op.create_index(
        "ix_formula_variable_type_type", "formula_variable_type", ["kb_id", "type_id"], unique=False
    )
    op.create_table(
        "formula_term",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("formula_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column("section", sa.String(length=24), nullable=False, comment="the part of its owner"),
        sa.Column(
            "position",
            sa.Integer(),
            autoincrement=False,
            nullable=False,
            comment="from 0, in preorder",
        ),
        sa.Column("term", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column(
            "parameter",
            sa.Integer(),
            nullable=True,
            comment="the position of the owner's parameter",
        ),
        sa.Column("object_id", sa.BigInteger(), nullable=True, comment="the constant"),
        sa.Column(
            "quantifier",
            sa.Integer(),
            nullable=True,
            comment="the position of the node that binds the variable",
        ),
        sa.Column(
            "variable",
            sa.Integer(),
            nullable=True,
            comment="which of the quantifier's variables it is",
        ),
        sa.Column(
            "child",
            sa.Integer(),
            nullable=True,
            comment="the position of the function node whose value it is",
        ),
        sa.CheckConstraint(
            "(quantifier IS NULL) = (variable IS NULL)", name=op.f("ck_formula_term_bound")
        ),
        sa.CheckConstraint(ONE_OF_FOUR, name=op.f("ck_formula_term_one_of_four")),
        sa.CheckConstraint("parameter IS NULL", name=op.f("ck_formula_term_no_parameter")),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "child"],
            [
                "formula_node.kb_id",
                "formula_node.formula_id",
                "formula_node.since",
                "formula_node.section",
                "formula_node.position",
            ],
            name="fk_formula_term_child",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "position"],
            [
                "formula_node.kb_id",
                "formula_node.formula_id",
                "formula_node.since",
                "formula_node.section",
                "formula_node.position",
            ],
            name="fk_formula_term_node",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "formula_id", "since", "section", "quantifier", "variable"],
            [
                "formula_variable.kb_id",
                "formula_variable.formula_id",
                "formula_variable.since",
                "formula_variable.section",
                "formula_variable.position",
                "formula_variable.variable",
            ],
            name="fk_formula_term_variable",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "object_id"],
            ["object.kb_id", "object.id"],
            name=op.f("fk_formula_term_kb_id_object_id"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id",
            "formula_id",
            "since",
            "section",
            "position",
            "term",
            name=op.f("pk_formula_term"),
        ),
    )
    op.create_index("ix_formula_term_object", "formula_term", ["kb_id", "object_id"], unique=False)


def _create_documents() -> None:
    """Make the tables of the domain and the problem as documents."""
    op.create_table(
        "document",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("name", SHORT_TEXT, nullable=False, comment="in its first spelling"),
        sa.Column("key", LONG_TEXT, nullable=False, comment="the name as compared: case folded"),
        sa.CheckConstraint(
            "key IN ('domain', 'problem')", name=op.f("ck_document_domain_or_problem")
        ),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name=op.f("fk_document_kb_id")),
        sa.PrimaryKeyConstraint("kb_id", "id", name=op.f("pk_document")),
        sa.UniqueConstraint("kb_id", "key", name=op.f("uq_document_kb_id_key")),
    )
    op.create_table(
        "document_version",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("document_id", sa.BigInteger(), autoincrement=False, nullable=False),
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
        sa.Column("title", SHORT_TEXT, nullable=False, comment="the name in its define form"),
        sa.Column("domain", SHORT_TEXT, nullable=True, comment="a problem's domain"),
        sa.Column("text", LONG_TEXT, nullable=False, comment="all of it on one line"),
        sa.CheckConstraint("since < until", name=op.f("ck_document_version_since_before_until")),
        sa.ForeignKeyConstraint(
            ["kb_id", "document_id"],
            ["document.kb_id", "document.id"],
            name=op.f("fk_document_version_kb_id_document_id"),
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_document_version_kb_id_since"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "until"],
            ["revision.kb_id", "revision.number"],
            name=op.f("fk_document_version_kb_id_until"),
            initially="DEFERRED",
            deferrable=True,
        ),
        sa.PrimaryKeyConstraint("kb_id", "document_id", "since", name=op.f("pk_document_version")),
    )
    op.create_index(
        "ix_document_version_since",
        "document_version",
        ["kb_id", "since", "document_id"],
        unique=False,
    )
    op.create_index(
        "ix_document_version_until",
        "document_version",
        ["kb_id", "until"],
        unique=False,
        sqlite_where=sa.text("until IS NOT NULL"),
        postgresql_where=sa.text("until IS NOT NULL"),
    )
    op.create_index(
        "uq_document_version_live",
        "document_version",
        ["kb_id", "document_id"],
        unique=True,
        sqlite_where=sa.text("until IS NULL"),
        postgresql_where=sa.text("until IS NULL"),
    )
    op.create_table(
        "document_item",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("document_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column(
            "since",
            sa.BigInteger(),
            autoincrement=False,
            nullable=False,
            comment="asserted in this revision",
        ),
        sa.Column(
            "section", sa.String(length=24), nullable=False, comment="requirement, type, goal ..."
        ),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False, comment="from 0"),
        sa.Column(
            "name",
            LONG_TEXT,
            nullable=False,
            comment="the element's name; for a goal that is a ground atom, its text",
        ),
        sa.ForeignKeyConstraint(
            ["kb_id", "document_id", "since"],
            ["document_version.kb_id", "document_version.document_id", "document_version.since"],
            name=op.f("fk_document_item_kb_id_document_id_since"),
        ),
        sa.PrimaryKeyConstraint(
            "kb_id", "document_id", "since", "section", "position", name=op.f("pk_document_item")
        ),
    )


def _create_action_expressions() -> None:
    """Make the tables of trees as version 0001 has them."""
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
