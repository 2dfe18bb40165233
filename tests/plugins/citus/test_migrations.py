"""Migrations of a distributed store: what they create is distributed, what they drop is not."""

from __future__ import annotations

from pathlib import Path

import psycopg
import pytest

import kant_sql
from kant_sql import SchemaError
from kant_sql.sql import schema
from kant_sql_plugins.citus import distribute
from tests.migrations.extra import VERSION, add_migration
from tests.migrations.stores import rows_of
from tests.support.citus import SHARDS, Cluster
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at

pytestmark = pytest.mark.usefixtures("real_migrations")

# A table that refers to a distributed and to a reference table, and one that refers to it.
TABLES = """
def upgrade():
    op.add_column("head", sa.Column("colour", sa.Text(), nullable=True, comment="of the robot"))
    op.execute("UPDATE head SET colour = 'red'")
    op.create_table(
        "charge",
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("since", sa.BigInteger(), nullable=False, comment="measured in this revision"),
        sa.PrimaryKeyConstraint("kb_id", "id", name="pk_charge"),
        sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"], name="fk_charge_kb_id"),
        sa.ForeignKeyConstraint(
            ["kb_id", "since"], ["revision.kb_id", "revision.number"], name="fk_charge_since",
            deferrable=True, initially="DEFERRED",
        ),
    )
    op.create_index("ix_charge_since", "charge", ["kb_id", "since"])
    op.execute(sa.schema.CreateTable(cell()))
    op.execute("INSERT INTO charge SELECT kb_id, 1, number FROM revision")


def cell():
    charge = sa.Table("charge", metadata := sa.MetaData(), sa.Column("kb_id"), sa.Column("id"))
    return sa.Table(
        "cell", metadata,
        sa.Column("kb_id", sa.BigInteger(), autoincrement=False, primary_key=True),
        sa.Column("id", sa.BigInteger(), autoincrement=False, primary_key=True),
        sa.ForeignKeyConstraint(["kb_id", "id"], [charge.c.kb_id, charge.c.id], name="fk_cell"),
    )


def downgrade():
    op.drop_column("head", "colour")
    op.execute(sa.schema.DropTable(cell()))
    op.drop_table("charge")
"""
KEYS = (
    "SELECT conname, condeferrable, pg_get_constraintdef(oid) FROM pg_constraint "
    "WHERE contype = 'f' AND conrelid IN ('charge'::regclass, 'cell'::regclass) ORDER BY 1"
)
PLACES = (
    "SELECT table_name::text, distribution_column, shard_count, "
    "colocation_id = (SELECT colocation_id FROM citus_tables WHERE table_name = 'head'::regclass) "
    "FROM citus_tables WHERE table_name::text IN ('charge', 'cell') ORDER BY 1"
)


def test_a_later_migration_leaves_the_store_distributed(
    cluster: Cluster,
    distributed_url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    connect: Connect,
) -> None:
    kb = connect(distributed_url, knowledge_base="tiago")
    kb.propositions.save(robot_at())
    kb.close()
    before = schema.VERSIONS[-1]
    add_migration(monkeypatch, tmp_path, TABLES)
    kant_sql.upgrade(distributed_url)
    assert schema.current(distributed_url) == VERSION
    assert cluster.run(PLACES, distributed_url) == [
        ("cell", "kb_id", SHARDS, True),
        ("charge", "kb_id", SHARDS, True),
    ]
    keys = cluster.run(KEYS, distributed_url)
    assert [(name, deferrable) for name, deferrable, _ in keys] == [
        ("fk_cell", False),
        ("fk_charge_kb_id", False),
        ("fk_charge_since", True),
    ]
    rows = rows_of(distributed_url)
    assert (len(rows["charge"]), rows["head"][0]["colour"]) == (1, "red")
    with (
        psycopg.connect(distributed_url) as connection,
        pytest.raises(psycopg.errors.ForeignKeyViolation),
    ):
        connection.execute("INSERT INTO cell VALUES (1, 77)")
    with pytest.raises(SchemaError, match="distributed table is not dropped") as caught:
        kant_sql.operations.downgrade(distributed_url, revision=before)
    assert "kant-sql db distribute '" in str(caught.value)
    assert str(caught.value).endswith("--undo")
    assert rows_of(distributed_url) == rows
    kb = connect(distributed_url, knowledge_base="tiago")
    kb.propositions.delete_all()
    assert kb.store.verify(structure=False).is_intact


def test_the_tables_are_dropped_after_they_were_brought_back(
    distributed_url: str, connect: Connect
) -> None:
    connect(distributed_url).propositions.save(robot_at())
    with pytest.raises(SchemaError, match="--undo"):
        kant_sql.operations.downgrade(distributed_url, revision="base")
    distribute(distributed_url, undo=True)
    kant_sql.operations.downgrade(distributed_url, revision="base")
    assert schema.current(distributed_url) is None
