"""`kant-sql db distribute`: what it moves, what it leaves as it was, and what it refuses."""

from __future__ import annotations

import json
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql import StoreError
from kant_sql.sql.schema import check_placement
from kant_sql.sql.tables import Base
from kant_sql.sql.tables.base import VERSION_TABLE
from kant_sql_plugins.citus import cluster as citus
from kant_sql_plugins.citus import distribute
from tests.migrations.stores import rows_of
from tests.migrations.test_golden import dump_of
from tests.plugins.citus.conftest import NewDatabase
from tests.support.citus import SHARDS as DEFAULT_SHARDS
from tests.support.citus import Cluster
from tests.support.processes.commands import one_line, run
from tests.support.reading import findings
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at
from tests.support.worlds.story import NAME

TABLES = {*Base.metadata.tables, VERSION_TABLE}
SHARDS = 2

pytestmark = pytest.mark.usefixtures("real_migrations")


def places(cluster: Cluster, url: str) -> dict[str, tuple[str, int]]:
    """How each distributed table is distributed, and over how many shards."""
    rows = cluster.run(
        "SELECT table_name::text, citus_table_type, distribution_column, shard_count "
        "FROM citus_tables",
        url,
    )
    return {name: (f"{kind} {column}", shards) for name, kind, column, shards in rows}


def distributed(shards: int = SHARDS) -> dict[str, tuple[str, int]]:
    """What `places` finds in a distributed store."""
    whole = dict.fromkeys(["knowledge_base", VERSION_TABLE], ("reference <none>", 1))
    return {**dict.fromkeys(TABLES, ("distributed kb_id", shards)), **whole}


def execute(url: str, script: str) -> None:
    """Run statements one after the other, as psql does."""
    with psycopg.connect(url, autocommit=True) as connection:
        for statement in script.split(";\n"):
            connection.execute(statement.encode())


def drop_foreign_keys(connection: psycopg.Connection[Any], table: str) -> None:
    keys = connection.execute(
        "SELECT conname FROM pg_constraint WHERE conrelid = %s::regclass AND contype = 'f'", [table]
    )
    for (name,) in keys.fetchall():
        connection.execute(f"ALTER TABLE {table} DROP CONSTRAINT {name}".encode())


def refusal(url: str, **options: bool) -> str:
    """Why a store cannot be distributed, which changes nothing."""
    before = rows_of(url), dump_of(url)
    with pytest.raises(StoreError) as caught:
        distribute(url, **options)
    assert (rows_of(url), dump_of(url)) == before
    return str(caught.value)


def test_all_tables_are_distributed_and_brought_back_as_they_were(
    cluster: Cluster, story_url: str, connect: Connect
) -> None:
    assert len(kant_sql.operations.update_views(story_url)) > 0
    rows, dump = rows_of(story_url), dump_of(story_url)
    done = distribute(story_url, shards=SHARDS)
    assert {*done.tables} == TABLES
    assert (done.shards, len(done.nodes)) == (SHARDS, len(cluster.nodes) - 1)
    assert places(cluster, story_url) == distributed()
    assert rows_of(story_url) == rows
    assert dump_of(story_url) == dump
    check_placement(story_url)
    assert findings(story_url) == []
    kb = connect(story_url, knowledge_base=NAME)
    kb.propositions.save(robot_at())
    kb.close()
    rows = rows_of(story_url)
    assert distribute(story_url, shards=SHARDS).statements == ()
    assert {*distribute(story_url, undo=True).tables} == TABLES
    assert places(cluster, story_url) == {}
    assert rows_of(story_url) == rows
    # The new predicate has no view yet.
    assert dump_of(story_url) != dump
    kant_sql.operations.drop_views(story_url)
    kant_sql.operations.update_views(story_url)
    assert distribute(story_url, undo=True).statements == ()
    assert findings(story_url) == []


def test_the_structure_is_the_same_after_each_step(story_url: str) -> None:
    kant_sql.operations.update_views(story_url)
    dump = dump_of(story_url)
    for undo in (False, True, False):
        distribute(story_url, shards=None if undo else SHARDS, undo=undo)
        assert dump_of(story_url) == dump


def test_no_row_stays_out_of_sight_on_the_coordinator(cluster: Cluster, story_url: str) -> None:
    distribute(story_url, shards=SHARDS)
    query = "SELECT sum(pg_relation_size(oid)) FROM pg_class WHERE relname = ANY('{{{}}}')"
    coordinator = query.format(",".join(Base.metadata.tables.keys() - {"knowledge_base"}))
    assert cluster.run(coordinator, story_url) == [(0,)]


def test_the_printed_sql_does_the_same(cluster: Cluster, story_url: str) -> None:
    kant_sql.operations.update_views(story_url)
    rows, dump = rows_of(story_url), dump_of(story_url)
    for words, expected in ((["--shards", str(SHARDS)], distributed()), (["--undo"], {})):
        before = places(cluster, story_url)
        printed = run("db", "distribute", story_url, *words, "--sql")
        assert printed.exit_code == 0, printed.stderr
        assert places(cluster, story_url) == before
        assert printed.stdout.startswith("-- Make a backup first.\nBEGIN;\n")
        execute(story_url, printed.stdout)
        assert places(cluster, story_url) == expected
        assert (rows_of(story_url), dump_of(story_url)) == (rows, dump)


def test_the_command_says_what_it_did(local_url: str) -> None:
    done = run("db", "distribute", local_url, "--shards", "2")
    assert f"{len(TABLES)} tables distributed over 2 shards on " in done.stdout
    again = run("db", "distribute", local_url, "--json")
    assert json.loads(again.stdout)["tables"] == []
    assert json.loads(again.stdout)["shards"] == 2
    other = run("db", "distribute", local_url, "--shards", "3")
    assert "over 2 shards already, not 3; bring them back with --undo" in one_line(other.stderr)
    undone = run("db", "distribute", local_url, "--undo")
    assert undone.stdout == f"{len(TABLES)} tables brought back\n"
    assert run("db", "check", local_url).exit_code == 0


def test_what_fails_in_the_end_has_changed_nothing(cluster: Cluster, story_url: str) -> None:
    with psycopg.connect(story_url) as connection:
        connection.execute("SET session_replication_role = replica")
        connection.execute("DELETE FROM object")
    message = refusal(story_url)
    assert "violates foreign key constraint" in message
    assert places(cluster, story_url) == {}


def test_a_writer_in_the_way_is_named(distributed_url: str, local_url: str) -> None:
    for url, undo in ((local_url, False), (distributed_url, True)):
        with psycopg.connect(url, application_name="a long report") as reader:
            reader.execute("SELECT count(*) FROM knowledge_base")
            with pytest.raises(kant_sql.StoreBusyError, match="a long report"):
                distribute(url, undo=undo)


def test_a_worker_refuses(cluster: Cluster, distributed_url: str) -> None:
    (_, host, port), *_ = (node for node in cluster.nodes if node[0] == 0)
    for undo in (False, True):
        with pytest.raises(StoreError, match="this is a worker node") as caught:
            distribute(cluster.at_node(distributed_url, 1), undo=undo)
        assert f"connect to the coordinator, {host}:{port}" in str(caught.value)


def test_a_database_without_the_extension_refuses(server_url: str) -> None:
    assert "has no extension citus; CREATE EXTENSION citus, version 13.1" in refusal(server_url)


@pytest.fixture
def server_url(cluster: Cluster) -> str:
    """The URL of a store in a database that does not have the extension."""
    name = "kant_sql_test_without_citus"
    cluster.run(f"DROP DATABASE IF EXISTS {name} WITH (FORCE)")
    cluster.run(f"CREATE DATABASE {name}")
    url = cluster.url.set(database=name).render_as_string(hide_password=False)
    kant_sql.upgrade(url)
    return url


def test_an_old_version_refuses(local_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(citus, "OLDEST", (99, 0))
    assert "; install 99.0 or later" in refusal(local_url)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("DELETE FROM pg_dist_node WHERE groupid = 0", "citus_set_coordinator_host('HOST', PORT)"),
        ("UPDATE pg_dist_node SET isactive = false WHERE groupid = 1", "are not active: "),
        ("UPDATE pg_dist_node SET metadatasynced = false WHERE groupid = 2", "are not active: "),
        ("UPDATE pg_dist_node SET shouldhaveshards = false", "no node may hold shards; "),
        (
            "CREATE TABLE mine (kb_id bigint REFERENCES knowledge_base (id))",
            "foreign key mine_kb_id_fkey of table mine",
        ),
        (
            "CREATE TRIGGER mine BEFORE UPDATE ON head FOR EACH ROW "
            "EXECUTE FUNCTION suppress_redundant_updates_trigger()",
            "trigger mine on table head",
        ),
        ("CREATE VIEW mine AS SELECT * FROM audit_fact", "view mine"),
        ("CREATE POLICY mine ON head USING (true)", "policy mine on table head"),
        ("CREATE TABLE mine () INHERITS (head)", "table mine, which inherits from head"),
    ],
)
def test_what_is_in_the_way_is_named(local_url: str, change: str, reason: str) -> None:
    with psycopg.connect(local_url) as connection:
        connection.execute(change.encode())
    assert reason in refusal(local_url)


def test_another_user_is_refused(cluster: Cluster, local_url: str) -> None:
    user = "kant_sql_test_stranger"
    cluster.run(f"DROP ROLE IF EXISTS {user}")
    cluster.run(f"CREATE ROLE {user} LOGIN SUPERUSER")
    try:
        url = make_url(local_url).set(username=user).render_as_string(hide_password=False)
        owner = cluster.url.username
        assert f"the tables are not yours; connect as {owner}" in refusal(url)
    finally:
        cluster.run(f"DROP ROLE {user}")


def test_outdated_tables_are_refused(new_database: NewDatabase) -> None:
    url = new_database()
    with pytest.raises(kant_sql.errors.SchemaMissingError):
        distribute(url)
    kant_sql.upgrade(url, revision="0005")
    with pytest.raises(kant_sql.errors.SchemaOutdatedError, match="kant-sql db upgrade"):
        distribute(url)


def test_tables_that_others_distributed_are_refused_and_brought_back(
    cluster: Cluster, local_url: str
) -> None:
    with psycopg.connect(local_url, autocommit=True) as connection:
        drop_foreign_keys(connection, "document_item")
        connection.execute("SELECT create_distributed_table('document_item', 'since')")
    assert "in another way: document_item" in refusal(local_url)
    checked = run("db", "check", local_url)
    assert checked.exit_code == 1
    assert "in another way than head: document_item; " in one_line(checked.stderr)
    assert distribute(local_url, undo=True).tables == ("document_item",)
    assert places(cluster, local_url) == {}


def test_a_store_of_which_a_part_is_local_is_named_and_completed(
    cluster: Cluster, distributed_url: str
) -> None:
    with psycopg.connect(distributed_url) as connection:
        connection.execute(citus.SEQUENTIAL)
        drop_foreign_keys(connection, "archive")
        connection.execute("SELECT undistribute_table('archive')")
    checked = run("db", "check", distributed_url)
    assert checked.exit_code == 1
    assert "not distributed, though other tables are: archive; distribute them with: " in one_line(
        checked.stderr
    )
    assert distribute(distributed_url).tables == ("archive",)
    assert places(cluster, distributed_url) == distributed(DEFAULT_SHARDS)
    assert run("db", "check", distributed_url).exit_code == 0
