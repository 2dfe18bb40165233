"""`kant-sql db roles`: what it prints, and what it leaves alone."""

from __future__ import annotations

import json

import psycopg
import pytest

import kant_sql
from tests.support.processes.commands import complaint, run
from tests.support.servers import Server
from tests.support.worlds.robots import robot_at

ROLES = {
    "writer": "kant_sql_writer",
    "reader": "kant_sql_reader",
    "auditor": "kant_sql_auditor",
    "eraser": "kant_sql_eraser",
}


@pytest.fixture
def url(server: Server) -> str:
    """The URL of a store on the server with the knowledge base tiago."""
    url = server.new_store()
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save(robot_at())
    return url


def policies(url: str) -> int:
    with psycopg.connect(url) as owner:
        row = owner.execute("SELECT count(*) FROM pg_policy").fetchone()
    assert row is not None
    return int(row[0])


def test_it_prints_the_names_of_the_roles(url: str) -> None:
    result = run("db", "roles", url)
    lines = [f"{key:8} {name}" for key, name in ROLES.items()]
    assert (result.exit_code, result.stdout.splitlines()) == (0, lines)
    result = run("db", "roles", "--kb", "tiago", url=url)
    limited = [*(f"{line}_tiago" for line in lines), "schema   kant_sql_tiago"]
    assert (result.exit_code, result.stdout.splitlines()) == (0, limited)
    assert policies(url) > 100


def test_json_has_the_same(url: str) -> None:
    result = run("db", "roles", url, "--json")
    assert json.loads(result.stdout) == {
        **ROLES,
        "schema": None,
        "knowledge_base": None,
        "remaining": [],
    }
    result = run("db", "roles", url, "--json", "--kb", "tiago", "--dry-run")
    document = json.loads(result.stdout)
    assert document["schema"] == "kant_sql_tiago"
    assert document["knowledge_base"] == "tiago"
    assert "CREATE SCHEMA IF NOT EXISTS kant_sql_tiago" in document["statements"]


def test_a_dry_run_prints_what_would_be_run(url: str) -> None:
    result = run("db", "roles", url, "--dry-run")
    assert result.exit_code == 0
    assert policies(url) == 0
    with psycopg.connect(url) as owner:
        owner.execute(result.stdout.encode())
    made = policies(url)
    assert made > 100
    assert run("db", "roles", url).exit_code == 0
    assert policies(url) == made


def test_a_knowledge_base_that_is_not_there_is_an_error(url: str) -> None:
    for name in ("tiagi", ""):
        assert "there are: 'tiago'" in complaint("db", "roles", url, "--kb", name)
    assert policies(url) == 0


def test_sqlite_has_no_roles() -> None:
    assert "SQLite has no roles" in complaint("db", "roles", "sqlite:///nowhere.db")
