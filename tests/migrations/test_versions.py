"""Up and down with knowledge in the tables, and beside tables of other people's."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from alembic.script import ScriptDirectory
from sqlalchemy import inspect, text

import kant_sql
from kant_sql.sql.schema import VERSIONS, alembic_config, migrations_folder
from kant_sql.sql.tables.base import VERSION_TABLE
from tests.migrations.test_golden import connected
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, navigation, robot_at

SCRIPTS = sorted((migrations_folder() / "versions").glob("*.py"))


def tables(url: str) -> set[str]:
    with connected(url) as connection:
        return set(inspect(connection).get_table_names())


def fill(url: str, connect: Connect) -> None:
    kb = connect(url, knowledge_base="tiago", actor="test")
    kb.actions.save(navigation())
    kb.propositions.save(robot_at())
    with kb.transaction(source={"sensor": "lidar"}):
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(place=WP2))
    kb.close()


def add_other_tables(url: str) -> None:
    """A user's own Alembic lives in the same database."""
    with connected(url) as connection:
        connection.execute(text("CREATE TABLE alembic_version (version_num VARCHAR(32))"))
        connection.execute(text("INSERT INTO alembic_version VALUES ('theirs')"))
        connection.execute(text("CREATE TABLE battery (charge INTEGER)"))
        connection.execute(text("INSERT INTO battery VALUES (80)"))


def test_versions_lists_the_migrations_in_their_order() -> None:
    scripts = ScriptDirectory.from_config(alembic_config()).walk_revisions()
    assert tuple(script.revision for script in scripts)[::-1] == VERSIONS


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_migration_imports_nothing_that_changes_with_the_library(path: Path) -> None:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    modules = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    modules += [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    assert modules
    assert [name for name in modules if name.partition(".")[0] == "kant_sql"] == []


def test_base_leaves_the_tables_of_others_and_the_way_up_makes_a_new_store(
    empty_url: str, connect: Connect
) -> None:
    add_other_tables(empty_url)
    kant_sql.upgrade(empty_url)
    fill(empty_url, connect)
    kant_sql.operations.downgrade(empty_url, revision="base")
    assert tables(empty_url) == {"alembic_version", "battery"}
    kant_sql.upgrade(empty_url)
    with connected(empty_url) as connection:
        assert connection.scalar(text("SELECT version_num FROM alembic_version")) == "theirs"
        assert connection.scalar(text("SELECT charge FROM battery")) == 80
    assert connect(empty_url, knowledge_base="tiago").revision == 0
    fill(empty_url, connect)
    kb = connect(empty_url, knowledge_base="tiago")
    assert [str(dto) for dto in kb.propositions.get_all()] == ["(robot_at rb1 wp2)"]
    assert kb.revision == 3


def test_an_upgrade_of_what_is_up_to_date_changes_nothing(empty_url: str, connect: Connect) -> None:
    kant_sql.upgrade(empty_url)
    fill(empty_url, connect)
    kant_sql.upgrade(empty_url)
    kb = connect(empty_url, knowledge_base="tiago")
    assert kb.revision == 3
    assert [dto.name for dto in kb.actions.get_all()] == ["navigation"]
    assert VERSION_TABLE in tables(empty_url)
