"""`kant-sql db`: the tables and their migrations; plain Alembic too."""

from __future__ import annotations

import os
import sqlite3
import sys
from pathlib import Path

import psycopg
import pytest

import kant_sql
from kant_sql import schema
from tests.cli.running import child, one_line, run
from tests.warm import MODULES, python
from tests.worlds import robot_at

pytestmark = pytest.mark.usefixtures("real_migrations")

HEAD = schema.VERSIONS[-1]
ALEMBIC = [sys.executable, "-m", "alembic"]


def run_sql(url: str, sql: str) -> None:
    """Run a script with the bare driver."""
    if url.startswith("sqlite"):
        connection = sqlite3.connect(url.removeprefix("sqlite:///"))
        connection.executescript(sql)
        connection.close()
    else:
        with psycopg.connect(url) as server:
            server.execute(sql)


def test_upgrade_creates_the_tables_and_downgrade_drops_them(new_url: str) -> None:
    for command, code, output in (
        (["check", new_url], 1, ""),
        (["upgrade", new_url], 0, f"{HEAD}\n"),
        (["upgrade", new_url], 0, f"{HEAD}\n"),
        (["current", new_url], 0, f"{HEAD}\n"),
        (["check", new_url], 0, f"{HEAD}\n"),
        (["downgrade", new_url, "base"], 0, "none\n"),
        (["check", new_url], 1, ""),
    ):
        result = run("db", *command)
        assert (result.exit_code, result.stdout) == (code, output), (command, result.stderr)
        assert code == 0 or one_line(result.stderr)


def test_check_fails_while_migrations_are_pending(
    new_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("db", "upgrade", new_url)
    monkeypatch.setattr(schema, "VERSIONS", (HEAD, "9999"))
    result = run("db", "check", new_url)
    assert f"of version {HEAD}, this library needs 9999" in one_line(result.stderr)
    assert result.exit_code == 1


def test_tables_of_a_newer_version_are_refused(new_url: str) -> None:
    run("db", "upgrade", new_url)
    run_sql(new_url, f"UPDATE {schema.VERSION_TABLE} SET version_num = '9999'")
    for words in (
        ["show"],
        ["log"],
        ["db", "check"],
        ["db", "upgrade"],
        ["db", "downgrade", "base"],
    ):
        result = run(*words, url=new_url)
        assert "version 9999" in one_line(result.stderr)
        assert "install a newer kant-sql" in result.stderr
        assert result.exit_code == 1


def test_one_back_is_a_version_to_go_back_to(new_url: str) -> None:
    run("db", "upgrade", new_url)
    assert run("db", "downgrade", "-1", url=new_url).stdout == f"{schema.VERSIONS[-2]}\n"


@pytest.mark.parametrize(
    ("revision", "code", "message"),
    [
        ("0007", 1, "Can't locate revision identified by '0007'"),
        ("-7", 1, "didn't produce 7 migrations"),
        ("", 2, "give a URL"),
    ],
)
def test_a_version_that_does_not_exist_is_refused(
    store: str, revision: str, code: int, message: str
) -> None:
    result = run("db", "downgrade", store, revision)
    assert message in one_line(result.stderr)
    assert result.exit_code == code
    assert schema.current(store) == HEAD


def test_one_argument_of_downgrade_is_the_version_when_the_url_is_known(new_url: str) -> None:
    run("db", "upgrade", url=new_url)
    assert run("db", "downgrade", "base", url=new_url).stdout == "none\n"


def test_downgrade_needs_just_a_url_and_a_version(new_url: str) -> None:
    run("db", "upgrade", new_url)
    for known in (new_url, None):
        for words in ([new_url], [], [new_url, "base", "more"]):
            result = run("db", "downgrade", *words, url=known)
            one_line(result.stderr)
            assert result.exit_code == 2
    assert schema.current(new_url) == HEAD


def test_downgrade_of_what_has_no_tables_is_an_error(new_url: str) -> None:
    if new_url.startswith("sqlite"):
        Path(new_url.removeprefix("sqlite:///")).touch()
    result = run("db", "downgrade", new_url, "base")
    assert "db upgrade" in one_line(result.stderr)
    assert result.exit_code == 1


def test_the_offline_sql_makes_a_store_that_opens(new_url: str) -> None:
    result = run("db", "sql", new_url)
    assert result.exit_code == 0, result.stderr
    assert schema.current(new_url) is None
    run_sql(new_url, result.stdout)
    assert run("db", "check", new_url).exit_code == 0
    with kant_sql.connect(new_url) as kb:
        kb.propositions.save(robot_at())


def test_the_offline_sql_needs_no_server() -> None:
    result = run("db", "sql", "postgresql://nobody@127.0.0.1:1/nothing")
    assert "CREATE TABLE knowledge_base" in result.stdout


def test_plain_alembic_migrates_from_a_clone(new_url: str) -> None:
    option = ["-x", f"url={new_url}"]
    for command, version in ((["upgrade", "head"], HEAD), (["downgrade", "base"], None)):
        done = child(*command, program=ALEMBIC, KANT_SQL_URL=new_url)
        assert (done.returncode, schema.current(new_url)) == (0, version), done.stderr
    for command, version in ((["upgrade", "head"], HEAD), (["downgrade", "base"], None)):
        done = child(*option, *command, program=[str(python(*MODULES)), "-m", "alembic"])
        assert (done.returncode, schema.current(new_url)) == (0, version), done.stderr


def test_plain_alembic_without_a_url_says_how_to_give_one() -> None:
    done = child("upgrade", "head", program=ALEMBIC)
    assert "set KANT_SQL_URL, or run alembic -x url=URL" in done.stderr
    assert done.returncode != 0
    assert "Traceback" not in done.stderr


READING = [
    ["show"],
    ["log"],
    ["dump"],
    ["plan"],
    ["watch"],
    ["verify"],
    ["anchor"],
    ["views"],
    ["diff", "1", "2"],
    ["history", "rb1"],
    ["blame", "rb1"],
    ["restore", "1"],
    ["archive", "--before", "1", "--to", "sqlite:///archive.db"],
    ["load", "problem.pddl"],
    ["db", "current"],
    ["db", "check"],
    ["db", "downgrade", "base"],
]


@pytest.mark.parametrize("words", READING)
def test_a_file_that_does_not_exist_is_said_to_be_missing_and_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    problem = tmp_path / "problem.pddl"
    problem.write_text("(define (problem p) (:domain d) (:goal (and)))")
    result = run(*words, url="sqlite:///missing.db")
    assert os.listdir(tmp_path) == [problem.name]
    line = one_line(result.stderr)
    # Not that it needs an upgrade, which would make an empty store of a mistyped path.
    assert f"there is no such file, {tmp_path}/missing.db; check the path" in line
    assert "upgrade" not in line
    assert (result.exit_code, result.stdout) == (1, "")


def test_the_version_of_a_database_without_tables_is_none(new_url: str) -> None:
    if new_url.startswith("sqlite"):
        Path(new_url.removeprefix("sqlite:///")).touch()
    result = run("db", "current", new_url)
    assert (result.exit_code, result.stdout) == (0, "none\n")


def test_an_empty_file_is_left_empty_by_those_who_read(tmp_path: Path) -> None:
    path = tmp_path / "empty.db"
    path.touch()
    result = run("show", f"sqlite:///{path}")
    assert "there are no kant_sql tables" in one_line(result.stderr)
    assert path.read_bytes() == b""
