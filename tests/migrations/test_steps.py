"""What the migrations' machinery does with any migration: shown on one more than there are."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from alembic import command
from alembic.util import CommandError
from sqlalchemy import make_url

import kant_sql
from kant_sql.errors import SchemaError, SchemaTooNewError, StoreError, StoreIntegrityError
from kant_sql.sql import schema
from kant_sql.sql.schema import alembic_config, current, earlier_version
from tests.migrations import stores
from tests.migrations.extra import VERSION, add_migration
from tests.migrations.test_golden import digest_of, dump_of
from tests.support.chain import check_chain
from tests.support.reading import findings
from tests.support.stores import Connect

pytestmark = pytest.mark.usefixtures("real_migrations")

LAST = schema.VERSIONS[-1]
TABLE = "formula_node"

# It fills a new column, and on SQLite makes a table again that others refer to.
DEPTHS = """
def upgrade():
    depth = sa.Column("depth", sa.Integer(), server_default="0", nullable=False)
    op.add_column("formula_node", depth)
    op.execute("UPDATE formula_node SET depth = 1 WHERE parent IS NOT NULL")
    rebuild()


def downgrade():
    if context.get_revision_argument() is not None:
        refuse_to_lose()
    op.drop_column("formula_node", "depth")
    rebuild()


def refuse_to_lose():
    if context.is_offline_mode():
        raise CommandError("run it on the database, without --sql")
    query = "SELECT count(*) FROM formula_node WHERE depth > 0 AND operator = 'minimize'"
    count = op.get_bind().scalar(sa.text(query))
    if count:
        raise CommandError(f"no place for nested metrics ({count}); nothing was changed")


def rebuild():
    if context.is_offline_mode() or op.get_bind().dialect.name != "sqlite":
        return
    query = "SELECT sql FROM sqlite_master WHERE tbl_name = 'formula_node' AND sql IS NOT NULL"
    statements = op.get_bind().scalars(sa.text(query + " ORDER BY type DESC")).all()
    op.execute("CREATE TEMPORARY TABLE kept AS SELECT * FROM formula_node")
    op.execute("DROP TABLE formula_node")
    for statement in statements:
        op.execute(statement)
    op.execute("INSERT INTO formula_node SELECT * FROM kept")
    op.execute("DROP TABLE kept")
"""
NESTED = "UPDATE formula_node SET operator = 'minimize' WHERE kb_id = 1 AND operator = 'not'"

Add = Callable[[str], None]


@pytest.fixture
def add(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Add:
    """Add a migration with the functions given."""
    return lambda body: add_migration(monkeypatch, tmp_path, body)


@pytest.fixture
def old_url(make: stores.Make) -> str:
    """The URL of a store with a story in it, of the last version."""
    return make(stores.write_migrated_story)


def is_sqlite(url: str) -> bool:
    return make_url(url).get_backend_name() == "sqlite"


def test_data_is_carried_up_and_down(old_url: str, add: Add) -> None:
    before = stores.rows_of(old_url)
    assert before["formula_term"]
    add(DEPTHS)
    kant_sql.upgrade(old_url)
    assert current(old_url) == VERSION
    after = stores.rows_of(old_url)
    assert {row["depth"] for row in after[TABLE]} == {0, 1}
    assert all((row["depth"] == 0) == (row["parent"] is None) for row in after[TABLE])
    for table, rows in before.items():
        assert stores.without(after[table], "depth") == rows, table
    whole = dump_of(old_url)
    kant_sql.operations.downgrade(old_url, revision=LAST)
    assert stores.rows_of(old_url) == before
    assert digest_of(old_url) == stores.record(LAST, old_url)
    kant_sql.upgrade(old_url, revision=VERSION)
    assert (stores.rows_of(old_url), dump_of(old_url)) == (after, whole)


@pytest.mark.more
def test_several_steps_at_once(old_url: str, add: Add) -> None:
    before = stores.as_before(old_url)
    add(DEPTHS)
    kant_sql.upgrade(old_url, revision="+1")
    whole = dump_of(old_url)
    first, steps = schema.VERSIONS[0], len(schema.VERSIONS) - 1
    assert earlier_version(old_url, f"-{steps}") == first
    kant_sql.operations.downgrade(old_url, revision=f"-{steps}")
    assert (current(old_url), stores.as_before(old_url)) == (first, before)
    with pytest.raises(SchemaError, match=f"only {', '.join(schema.VERSIONS)}"):
        kant_sql.upgrade(old_url, revision=f"+{steps + 1}")
    kant_sql.upgrade(old_url, revision=f"+{steps}")
    assert (current(old_url), dump_of(old_url)) == (VERSION, whole)
    assert earlier_version(old_url, f"-{steps + 1}") == "base"
    kant_sql.operations.downgrade(old_url, revision=f"-{steps + 1}")
    assert (current(old_url), stores.rows_of(old_url)) == (None, {})


def test_a_new_store_goes_through_all_of_them(empty_url: str, add: Add) -> None:
    add(DEPTHS)
    kant_sql.upgrade(empty_url)
    assert current(empty_url) == VERSION
    assert "depth" in dump_of(empty_url)


def test_what_the_older_library_wrote_goes_down_and_up_with_its_hashes(
    old_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, connect: Connect
) -> None:
    with monkeypatch.context() as patched:
        add_migration(patched, tmp_path, DEPTHS)
        kant_sql.upgrade(old_url)
        assert check_chain(old_url) == stores.REVISIONS
        kant_sql.operations.downgrade(old_url, revision=LAST)
    connect(old_url, knowledge_base="tiago").propositions.delete_all()
    assert check_chain(old_url) == {**stores.REVISIONS, "tiago": stores.REVISIONS["tiago"] + 1}
    assert findings(old_url) == []


def test_the_library_refuses_what_a_newer_one_migrated(
    old_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, connect: Connect
) -> None:
    with monkeypatch.context() as patched:
        add_migration(patched, tmp_path, DEPTHS)
        kant_sql.upgrade(old_url)
    assert schema.VERSIONS[-1] == LAST
    for refused in (
        lambda: connect(old_url),
        lambda: kant_sql.upgrade(old_url),
        lambda: kant_sql.operations.downgrade(old_url, revision="0001"),
    ):
        with pytest.raises(SchemaTooNewError, match=f"version {VERSION}.*install a newer kant-sql"):
            refused()
    assert current(old_url) == VERSION


@pytest.mark.more
def test_what_an_older_version_has_no_place_for_is_not_dropped(old_url: str, add: Add) -> None:
    add(DEPTHS)
    kant_sql.upgrade(old_url)
    stores.run_script(old_url, NESTED)
    for revision in (LAST, "0001", "-1", "-2"):
        assert stores.refusal(old_url, revision).endswith("nested metrics (1); nothing was changed")
    kant_sql.operations.downgrade(old_url, revision="base")
    assert (stores.rows_of(old_url), current(old_url)) == ({}, None)


def test_a_downgrade_as_sql_cannot_look_and_is_refused(dialect: str, add: Add) -> None:
    add(DEPTHS)
    out = io.StringIO()
    config = alembic_config(out)
    config.attributes["url"] = f"{dialect}://"
    with pytest.raises(CommandError, match="run it on the database, without --sql"):
        command.downgrade(config, f"{VERSION}:{LAST}", sql=True)
    command.downgrade(config, f"{VERSION}:base", sql=True)
    assert "DROP TABLE knowledge_base" in out.getvalue()


FAILING = {
    "sql": ('op.execute("INSERT INTO nowhere VALUES (1)")', StoreError),
    "refusal": ('raise CommandError("not today")', SchemaError),
    "program": ('raise ZeroDivisionError("a mistake")', ZeroDivisionError),
    "orphans": ("op.execute(\"DELETE FROM formula_node WHERE operator = '>'\")", StoreError),
}


@pytest.mark.parametrize("failure", FAILING)
def test_a_migration_failing_half_way_changes_nothing(old_url: str, add: Add, failure: str) -> None:
    statement, error = FAILING[failure]
    work = f"""
    op.create_table("half", sa.Column("done", sa.Integer()))
    op.execute("UPDATE revision SET actor = 'nobody'")
    op.execute("DROP VIEW audit_goal")
    {statement}
"""
    add(f"def upgrade():{work}\n\ndef downgrade():\n    pass\n")
    before = stores.rows_of(old_url), dump_of(old_url)
    with pytest.raises(error):
        kant_sql.upgrade(old_url)
    assert (stores.rows_of(old_url), dump_of(old_url)) == before
    assert current(old_url) == LAST


@pytest.mark.parametrize("failure", FAILING)
@pytest.mark.more
def test_a_migration_that_fails_half_way_down_changes_nothing(
    old_url: str, add: Add, failure: str
) -> None:
    statement, error = FAILING[failure]
    work = f"""
    op.execute("UPDATE revision SET actor = 'nobody'")
    op.execute("DROP TABLE half")
    {statement}
"""
    make = 'op.create_table("half", sa.Column("done", sa.Integer()))'
    add(f"def upgrade():\n    {make}\n\n\ndef downgrade():{work}")
    kant_sql.upgrade(old_url)
    before = stores.rows_of(old_url), dump_of(old_url)
    # Of two steps, too, whichever fails.
    for revision in (LAST, "0001"):
        with pytest.raises(error):
            kant_sql.operations.downgrade(old_url, revision=revision)
        assert (stores.rows_of(old_url), dump_of(old_url)) == before
        assert current(old_url) == VERSION


def test_rows_that_would_refer_to_nothing_are_counted_on_sqlite(file_url: str, add: Add) -> None:
    """SQLite checks no foreign key while it migrates: all of them are checked in the end."""
    stores.write_story(file_url)
    kant_sql.upgrade(file_url)
    delete = "DELETE FROM formula_node WHERE operator = '>'"
    add(f'def upgrade():\n    op.execute("{delete}")\n\n\ndef downgrade():\n    pass\n')
    with pytest.raises(StoreIntegrityError, match="would leave 2 rows that refer to nothing"):
        kant_sql.upgrade(file_url)
