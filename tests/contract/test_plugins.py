"""What another package joins by an entry point is found on first need; what is broken is named."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psycopg
import pytest

import kant_sql
from kant_sql import SchemaError
from kant_sql.errors import ConnectionLostError, ExtraMissingError
from kant_sql.plugins import Plugins, _entries
from kant_sql.sql import schema
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects.postgresql_structure import ClusterExtension
from kant_sql_plugins.citus import cluster
from tests.support.processes.commands import run
from tests.support.stores import Connect
from tests.support.worlds.robots import robot_at

Join = Callable[[str, str], None]
# An extension that the wheel's server has, in the place of one that puts tables on several nodes.
EXTENSION = "vector"
CLUSTER = '''
    from contextlib import contextmanager

    asked = []
    error = None

    class Nodes:
        def settings(self, *, is_durable=False):
            return {"application_name": "joined"}

        def replanning(self, is_other):
            return "SET LOCAL application_name = 'replanned'"

        def committing(self, synchronous_commit):
            return self

        def whole_index(self, name):
            return name

    def nodes(connection):
        return Nodes()

    def is_distributed(connection, schema):
        return True

    def fault(connection, label):
        return error

    def use_one_connection(connection):
        asked.append("one connection")

    @contextmanager
    def migrating(connection, label):
        asked.append("migrating")
        yield

    def of_one_shard(query, schema, kb_id):
        return f"{schema}, {kb_id}: {query}"

    def has_lost_a_node(state, message):
        return "zero" in message

    def greet(name: str):
        """Greet somebody."""
        print("hello", name)
'''


@pytest.fixture
def join(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Join:
    """Install a package, the module `joined`, with one entry point of a group."""

    def install(group: str, entry: str) -> None:
        folder = tmp_path / "joined-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: joined\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[{group}]\n{entry}\n")
        (tmp_path / "joined.py").write_text(textwrap.dedent(CLUSTER))
        # The folder of an earlier test may have had the same path.
        _entries.cache_clear()
        monkeypatch.syspath_prepend(str(tmp_path))
        monkeypatch.delitem(sys.modules, "joined", raising=False)

    return install


def test_a_plugin_is_found_by_its_group_and_name(join: Join) -> None:
    assert Plugins[Any]("joined.parts").names() == ()
    join("joined.parts", "nodes = joined:Nodes")
    parts: Plugins[Any] = Plugins("joined.parts")
    assert parts.names() == ("nodes",)
    found = parts.get("nodes")
    assert found is sys.modules["joined"].Nodes
    assert parts.get("others") is Plugins[Any]("joined.others").get("nodes") is None


@pytest.mark.parametrize("place", ["joined:nothing", "joined.nothing", "joined_not"])
def test_a_plugin_that_cannot_be_imported_is_named(join: Join, place: str) -> None:
    join("joined.parts", f"nodes = {place}")
    message = rf"^the plugin 'nodes' of the group joined.parts cannot be imported from {place}: "
    with pytest.raises(ExtraMissingError, match=message):
        Plugins[Any]("joined.parts").get("nodes")


@pytest.mark.parametrize("group", [[], ["db"]])
def test_a_command_joins_those_of_its_group(join: Join, group: list[str]) -> None:
    join(".".join(["kant_sql.commands", *group]), "greet = joined:greet")
    assert run(*group, "greet", "tiago").stdout == "hello tiago\n"
    assert "Greet somebody." in run(*group, "--help").stdout
    assert run(*group, "greet").exit_code == 2


@pytest.mark.usefixtures("real_migrations")
def test_an_extension_of_postgresql_joins_where_a_database_has_it(
    server: Any, join: Join, connect: Connect
) -> None:
    join("kant_sql.postgresql_extensions", f"{EXTENSION} = joined")
    url = server.new_database()
    with psycopg.connect(url, autocommit=True) as connection:
        found = connection.execute("SELECT name FROM pg_available_extensions").fetchall()
        if (EXTENSION,) not in found:
            pytest.skip(f"this server has no extension {EXTENSION}")
        connection.execute(f"CREATE EXTENSION {EXTENSION}")
    kant_sql.upgrade(url)
    joined: Any = sys.modules["joined"]
    assert joined.asked == ["one connection", "migrating"]
    with connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save(robot_at())
        assert kb.store.verify().findings == ()
    backend = create_backend(url)
    with backend.open_session() as session:
        session.begin(write=True)
        assert session.rows_of("SHOW application_name") == [("joined",)]
        assert str(session.query_of_view("audit_fact", 7)).startswith("public, 7:  SELECT")
        with pytest.raises(ConnectionLostError):
            session.rows_of("SELECT 1 / 0")
        session.rollback()
    backend.close()
    assert schema.create_roles(url, dry_run=True).writer is None
    schema.check_placement(url)
    joined.error = "head is elsewhere"
    with pytest.raises(SchemaError, match="head is elsewhere"):
        schema.check_placement(url)
    server.drop_database(url)


def test_no_extension_is_asked_where_a_database_has_none(server: Any, join: Join) -> None:
    join("kant_sql.postgresql_extensions", f"{EXTENSION} = joined")
    url = server.new_store()
    schema.check_placement(url)
    assert schema.create_roles(url, dry_run=True).writer == "kant_sql_writer"
    assert "joined" not in sys.modules
    server.drop_database(url)


def test_citus_is_such_an_extension() -> None:
    found: ClusterExtension = cluster
    assert Plugins[ClusterExtension]("kant_sql.postgresql_extensions").get("citus") is found
