"""`kant-sql db`: the tables and their migrations; plain Alembic too."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import psycopg
import pytest

import kant_sql
from kant_sql import PddlFunctionDto, SchemaError
from kant_sql.cli.common import leaving_nothing
from kant_sql.sql import schema
from kant_sql.sql.predicate_views import update_views
from kant_sql.sql.tables.base import VERSION_TABLE
from tests.migrations.extra import add_migration
from tests.support.processes import commands
from tests.support.processes.warm import MODULES, python
from tests.support.worlds.robots import robot_at

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
        result = commands.run("db", *command)
        assert (result.exit_code, result.stdout) == (code, output), (command, result.stderr)
        assert code == 0 or commands.one_line(result.stderr)


def test_check_fails_while_migrations_are_pending(
    new_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands.run("db", "upgrade", new_url)
    monkeypatch.setattr(schema, "VERSIONS", (HEAD, "9999"))
    assert f"of version {HEAD}, this library needs 9999" in commands.complaint(
        "db", "check", new_url
    )


def test_tables_of_a_newer_version_are_refused(new_url: str) -> None:
    commands.run("db", "upgrade", new_url)
    run_sql(new_url, f"UPDATE {VERSION_TABLE} SET version_num = '9999'")
    for words in (
        *(["show"], ["log"], ["db", "check"], ["db", "upgrade"], ["db", "downgrade", "base"]),
    ):
        result = commands.run(*words, url=new_url)
        assert "version 9999" in commands.one_line(result.stderr)
        assert "install a newer kant-sql" in result.stderr
        assert result.exit_code == 1


def test_one_back_is_a_version_to_go_back_to(new_url: str) -> None:
    commands.run("db", "upgrade", new_url)
    assert commands.run("db", "downgrade", "-1", url=new_url).stdout == f"{schema.VERSIONS[-2]}\n"


@pytest.mark.parametrize(
    ("revision", "code", "message"),
    [
        ("9999", 1, "there is no version '9999' to go back to, only base, 0001, "),
        ("-77", 1, "there is no version '-77' to go back to"),
        ("000", 1, "there is no version '000' to go back to"),
        ("head", 1, "there is no version 'head' to go back to"),
        ("", 2, "give a URL"),
    ],
)
def test_a_version_that_does_not_exist_is_refused(
    store: str, revision: str, code: int, message: str
) -> None:
    assert message in commands.complaint("db", "downgrade", store, revision, code=code)
    assert schema.current(store) == HEAD


def test_a_later_version_is_not_gone_back_to(new_url: str) -> None:
    commands.run("db", "upgrade", new_url)
    assert commands.run("db", "downgrade", new_url, "0001").stdout == "0001\n"
    assert commands.run("db", "downgrade", new_url, "0001").stdout == "0001\n"
    assert "of version 0001, which is before 0002; nothing was changed" in commands.complaint(
        "db", "downgrade", new_url, "0002"
    )


def test_a_version_that_does_not_exist_drops_no_view_and_says_nothing_of_views(
    own_store: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert len(update_views(own_store)) == 2
    for change, revision in (
        (schema.downgrade, "9999"),
        (schema.downgrade, "-99"),
        (schema.upgrade, "9999"),
        (schema.upgrade, "+1"),
    ):
        with pytest.raises(SchemaError, match="there is no version"):
            change(own_store, revision=revision)
    assert [record for record in caplog.records if "dropped" in record.getMessage()] == []
    assert [view.change for view in update_views(own_store)] == ["unchanged"] * 2


# It refuses to go back while there is a function.
REFUSING = """
def upgrade():
    pass


def downgrade():
    query = "SELECT count(*) FROM function_version WHERE until IS NULL"
    if op.get_bind().scalar(sa.text(query)):
        raise CommandError("an earlier version has no place for functions")
"""


def test_a_downgrade_that_fails_does_not_say_that_it_has_dropped_views(
    own_store: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    add_migration(monkeypatch, tmp_path, REFUSING)
    schema.upgrade(own_store)
    update_views(own_store)
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        kb.functions.save(PddlFunctionDto("fuel", []))
    for revision in (schema.VERSIONS[-2], "0001"):
        with pytest.raises(SchemaError, match="has no place for functions"):
            schema.downgrade(own_store, revision=revision)
    assert [record for record in caplog.records if "dropped" in record.getMessage()] == []
    assert [view.change for view in update_views(own_store)] == ["unchanged"] * 2
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        kb.functions.delete_all()
    schema.downgrade(own_store, revision=schema.VERSIONS[-2])
    assert "2 views of predicates are dropped" in caplog.text


LOST = "this drops all tables and 3 revisions of 1 knowledge base: tiago (3)"


def test_what_would_destroy_revisions_is_refused_where_nobody_can_be_asked(own_store: str) -> None:
    for words in (["base"], ["base", "--json"]):
        result = commands.run("db", "downgrade", own_store, *words)
        assert f"{LOST}; nothing was changed; add --yes to do it" in (result.stderr)
        assert (result.exit_code, result.stdout) == (1, "")
    with kant_sql.connect(own_store, knowledge_base="tiago") as kb:
        assert kb.revision == 3
    result = commands.run("db", "downgrade", own_store, "base", "--yes", "--json")
    assert json.loads(result.stdout) == {"version": None, "newest": HEAD, "lost_revisions": 3}


def test_one_back_from_the_first_version_is_base_and_asks(own_store: str) -> None:
    assert schema.earlier_version(own_store, revision=f"-{len(schema.VERSIONS)}") == "base"
    result = commands.run("db", "downgrade", own_store, f"-{len(schema.VERSIONS)}")
    assert LOST in commands.one_line(result.stderr)


@pytest.mark.parametrize(("answer", "code"), [("y", 0), ("n", 1), ("", 1), ("\x03", 130)])
def test_in_a_terminal_it_asks(own_store: str, answer: str, code: int) -> None:
    import pty

    if code and own_store.startswith("postgresql"):
        pytest.skip("the question does not depend on the database")
    controller, terminal = pty.openpty()
    # The signal is for the program itself: nothing that stands for it passes it on.
    process = commands.start(
        "db", "downgrade", own_store, "base", stdin=terminal, stderr=terminal,
        start_new_session=True, program=commands.PROGRAM if answer == "\x03" else (),
    )  # fmt: skip
    os.close(terminal)
    asked = b""
    while b"[y/N]" not in asked:
        asked += os.read(controller, 4096)
    assert LOST in asked.decode()
    if answer == "\x03":
        # Between the question and the read, Python notes a signal and goes on waiting for a line.
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout=2)
    else:
        os.write(controller, f"{answer}\n".encode())
    output, _ = process.communicate(timeout=commands.CHILD_TIMEOUT)
    os.close(controller)
    assert (process.returncode, output) == (code, b"" if code else b"none\n")
    assert schema.current(own_store) == (HEAD if code else None)


def test_every_command_writes_json(new_url: str) -> None:
    version = {"version": HEAD, "newest": HEAD}
    for words, document in (
        (["upgrade"], version),
        (["current"], version),
        (["check"], version),
        (["downgrade", "base"], {"version": None, "newest": HEAD, "lost_revisions": 0}),
        (["current"], {"version": None, "newest": HEAD}),
    ):
        result = commands.run("db", *words, "--json", url=new_url)
        assert json.loads(result.stdout) == document, result.stderr
    result = commands.run("db", "check", "--json", url=new_url)
    error = json.loads(result.stderr)
    assert "db upgrade" in error.pop("error")
    assert error == {"type": "SchemaMissingError", "exit_code": 1}
    assert (result.exit_code, result.stdout) == (1, "")
    sql = json.loads(commands.run("db", "sql", "--json", url=new_url).stdout)
    assert sql == {"version": HEAD, "sql": commands.run("db", "sql", url=new_url).stdout}


def test_an_upgrade_that_fails_leaves_no_new_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> None:
        raise RuntimeError("the disk is full")

    monkeypatch.setattr(schema, "report_dropped_views", fail)
    with pytest.raises(RuntimeError), leaving_nothing(f"sqlite:///{tmp_path}/new.db"):
        schema.upgrade(f"sqlite:///{tmp_path}/new.db")
    assert os.listdir(tmp_path) == []


def test_an_error_is_told_though_the_new_file_cannot_be_opened_any_more(tmp_path: Path) -> None:
    path = tmp_path / "new.db"

    def fail() -> None:
        # A folder takes no connection, as a file whose folder is closed to its owner.
        path.mkdir()
        raise RuntimeError("the first fault")

    with pytest.raises(RuntimeError, match="first"), leaving_nothing(f"sqlite:///{path}"):
        fail()


def test_downgrade_needs_just_a_url_and_a_version(new_url: str) -> None:
    commands.run("db", "upgrade", new_url)
    for known in (new_url, None):
        for words in ([new_url], [], [new_url, "base", "more"]):
            result = commands.run("db", "downgrade", *words, url=known)
            commands.one_line(result.stderr)
            assert result.exit_code == 2
    assert schema.current(new_url) == HEAD


def test_downgrade_of_what_has_no_tables_is_an_error(new_url: str) -> None:
    if new_url.startswith("sqlite"):
        Path(new_url.removeprefix("sqlite:///")).touch()
    assert "db upgrade" in commands.complaint("db", "downgrade", new_url, "base")


def test_the_offline_sql_makes_a_store_that_opens(new_url: str) -> None:
    result = commands.run("db", "sql", new_url)
    assert result.exit_code == 0, result.stderr
    assert schema.current(new_url) is None
    run_sql(new_url, result.stdout)
    assert commands.run("db", "check", new_url).exit_code == 0
    with kant_sql.connect(new_url) as kb:
        kb.propositions.save(robot_at())


def test_the_offline_sql_needs_no_server() -> None:
    result = commands.run("db", "sql", "postgresql://nobody@127.0.0.1:1/nothing")
    assert "CREATE TABLE knowledge_base" in result.stdout


@pytest.mark.more
def test_plain_alembic_migrates_from_a_clone(new_url: str) -> None:
    option = ["-x", f"url={new_url}"]
    for command, version in ((["upgrade", "head"], HEAD), (["downgrade", "base"], None)):
        done = commands.child(*command, program=ALEMBIC, KANT_SQL_URL=new_url)
        assert (done.returncode, schema.current(new_url)) == (0, version), done.stderr
    for command, version in ((["upgrade", "head"], HEAD), (["downgrade", "base"], None)):
        done = commands.child(*option, *command, program=[str(python(*MODULES)), "-m", "alembic"])
        assert (done.returncode, schema.current(new_url)) == (0, version), done.stderr


def test_plain_alembic_without_a_url_says_how_to_give_one() -> None:
    done = commands.child("upgrade", "head", program=ALEMBIC)
    assert "set KANT_SQL_URL, or run alembic -x url=URL" in done.stderr
    assert done.returncode != 0
    assert "Traceback" not in done.stderr


READING = [
    words.split()
    for words in (
        *("show", "log", "dump", "plan", "watch", "verify", "anchor", "views", "diff 1 2"),
        *("history rb1", "blame rb1", "restore 1", "load problem.pddl"),
        *("archive --before 1 --to sqlite:///archive.db", "db current", "db check"),
        "db downgrade base",
    )
]


@pytest.mark.parametrize("words", READING)
def test_a_file_that_does_not_exist_is_said_to_be_missing_and_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    problem = tmp_path / "problem.pddl"
    problem.write_text("(define (problem p) (:domain d) (:goal (and)))")
    result = commands.run(*words, url="sqlite:///missing.db")
    assert os.listdir(tmp_path) == [problem.name]
    line = commands.one_line(result.stderr)
    # Not that it needs an upgrade, which would make an empty store of a mistyped path.
    assert f"no such file: {tmp_path}/missing.db; check the path" in line
    assert "upgrade" not in line
    assert (result.exit_code, result.stdout) == (1, "")


def test_the_version_of_a_database_without_tables_is_none(new_url: str) -> None:
    if new_url.startswith("sqlite"):
        Path(new_url.removeprefix("sqlite:///")).touch()
    result = commands.run("db", "current", new_url)
    assert (result.exit_code, result.stdout) == (0, "none\n")


def test_an_empty_file_is_left_empty_by_those_who_read(tmp_path: Path) -> None:
    path = tmp_path / "empty.db"
    path.touch()
    result = commands.run("show", f"sqlite:///{path}")
    assert "there are no kant_sql tables" in commands.one_line(result.stderr)
    assert path.read_bytes() == b""
