"""How commands begin and end: the URL, errors on one line, closed pipes, Ctrl-C, terminals."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

import kant_sql
from kant_sql import PddlTypeDto
from kant_sql.cli.common import CommandGroup
from kant_sql.cli.main import app, without_passwords
from tests.cli.conftest import write_history
from tests.support.processes import commands
from tests.support.stores import new_file_store
from tests.support.worlds.robots import robot_at

SECRET = "hunter2"
FILES = Path(__file__).parent / "files"
WITH_URL = [
    words.split()
    for words in (
        *("show", "log", "dump", "plan", "load", "goals", "query", "holds", "when", "rules"),
        *("db upgrade", "db downgrade", "db current", "db check"),
        *("why-not", "applicable", "apply", "validate", "branch"),
    )
]
# What follows the URL; commands that take it from the words see whether it is one.
MORE = {
    "load": [str(FILES / "delivery.pddl")],
    "query": ["(at ?r ?w)"],
    "holds": ["(at ?r ?w)"],
    "when": ["(at ?r ?w)"],
    "rules": [],
    "why-not": ["(move rb1 wp1)"],
    "applicable": [],
    "apply": ["(move rb1 wp1)"],
    "validate": ["sas_plan"],
    "branch": ["monday"],
}


def with_url(words: list[str], url: str) -> list[str]:
    more = {"downgrade": ["base"], **MORE}
    return [*words, url, *more.get(words[-1], [])]


@pytest.mark.parametrize("words", [["show"], ["log"], ["dump"], ["db", "current"], ["db", "check"]])
def test_the_environment_gives_the_default_url(store: str, words: list[str]) -> None:
    result = commands.run(*words, url=store)
    assert result.exit_code == 0
    assert result.stdout == commands.run(*words, store).stdout


@pytest.mark.parametrize(
    "words",
    [
        *(["show"], ["log", "-n1"], ["history", "rb1"], ["diff", "1"]),
        *(["restore", "1", "--actor", "me"], ["load", str(FILES / "kitchen.pddl")]),
        *(["db", "check"], ["verify"]),
    ],
)
def test_the_path_of_a_file_is_its_url(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_history("sqlite:///hospital.db")
    ways: list[tuple[str, str | None]] = [
        ("sqlite:///hospital.db", None),
        ("hospital.db", None),
        (str(tmp_path / "hospital.db"), "sqlite:///other.db"),
        ("", "hospital.db"),
    ]
    written = set()
    for number, (url, default) in enumerate(ways):
        shutil.copy("hospital.db", f"{number}.db")
        named = [word.replace("hospital", str(number)) for word in (url, default or "")]
        result = commands.run(*_place(words, named[0]), url=named[1] or None)
        written.add((result.exit_code, result.stdout, result.stderr))
    assert len(written) == 1, written
    assert written.pop()[0] == 0


def _place(words: list[str], url: str) -> list[str]:
    """Put the URL, if there is one, behind the command."""
    place = 2 if words[0] == "db" else 1
    return [*words[:place], *[url][: bool(url)], *words[place:]]


def test_a_file_that_is_no_store_is_no_url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(FILES / "kitchen.pddl", "kitchen.pddl")
    os.mkfifo("pipe")
    for words in ("load kitchen.pddl", "history pipe", "log missing.db", "log pipe"):
        result = commands.run(*words.split())
        assert result.exit_code in (1, 2)
        assert "sqlite:///robot.db" in commands.one_line(result.stderr)
    assert commands.run("load", "kitchen.pddl", url="sqlite:///new.db").exit_code == 0
    # An empty file is an empty store, where no variable has another.
    Path("empty.db").touch()
    assert commands.run("load", "empty.db", "kitchen.pddl").exit_code == 0
    assert commands.run("load", "missing.db", "kitchen.pddl").exit_code == 2
    assert not Path("missing.db").exists()


@pytest.mark.parametrize("name", ["robot.db", "a?b.db", "100%25#.db", "ü ö.db"])
def test_python_takes_the_path_of_a_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_history("sqlite:///first.db")
    Path("first.db").rename(name)
    for path in (name, str(tmp_path / name)):
        with kant_sql.open_store(path) as store:
            assert store.knowledge_bases()[0].revision == 3
        with kant_sql.connect(path, knowledge_base="tiago") as kb:
            assert kb.revision == 3
        assert [one.revision for one in kant_sql.operations.knowledge_bases(path)] == [3]


WRONG = (
    *("", "db", "nonsense", "show", "log", "db upgrade", "db sql", "show --nonsense"),
    *("show sqlite:///a.db sqlite:///b.db", "show sqlite:///a.db --kb"),
    "log sqlite:///a.db --json=yes",
)


@pytest.mark.parametrize("words", [words.split() for words in WRONG])
def test_wrong_usage_is_one_line_that_names_the_help(words: list[str]) -> None:
    result = commands.run(*words)
    assert commands.one_line(result.stderr).endswith(" --help")
    assert (result.exit_code, result.stdout) == (2, "")


@pytest.mark.parametrize("words", WITH_URL)
def test_an_unreachable_server_is_one_line_without_the_password(words: list[str]) -> None:
    for url in (
        f"postgresql://robot:{SECRET}@127.0.0.1:1/fleet",
        f"postgresql://robot@127.0.0.1:1/fleet?password={SECRET}",
    ):
        result = commands.run(*with_url(words, url))
        line = commands.one_line(result.stderr)
        assert "no connection" in line
        assert SECRET not in line
        assert result.exit_code == 1


@pytest.mark.parametrize("words", [*WITH_URL, ["db", "sql"]])
@pytest.mark.parametrize(
    "url",
    ["nonsense", "mysql://robot:hunter2@host/fleet", "postgresql://robot:hun@ter2@host/fleet"],
)
def test_what_is_no_url_of_a_store_is_one_line(words: list[str], url: str) -> None:
    result = commands.run(*with_url(words, url))
    line = commands.one_line(result.stderr)
    assert "ter2" not in line
    # What has no scheme could be a file that was to be loaded.
    is_word = words[-1] in {*MORE, "show", "downgrade"} and url == "nonsense"
    code = 2 if is_word else 1
    assert (result.exit_code, result.stdout) == (code, "")


@pytest.mark.parametrize("words", WITH_URL)
def test_a_file_that_is_no_database_is_one_line(words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "letter.txt"
    path.write_text("Dear robot, " * 1000)
    assert "file is not a database" in commands.complaint(*with_url(words, f"sqlite:///{path}"))


@pytest.mark.parametrize(
    "url",
    [
        "postgresql://robot:hunter2@host/fleet",
        "postgresql://robot:hunt@er2@host/fleet",
        "postgresql://robot:hunt/er2:hunter2@host/fleet",
        "postgresql://robot:my hunter2 @host/fleet",
        "postgresql://host/fleet?user=robot&password=hunter2",
        "--kb=postgresql://robot:hunter2@host/fleet",
    ],
)
def test_no_message_repeats_a_password_of_the_command_line(url: str) -> None:
    hidden = without_passwords(f"cannot make sense of ({url})", [url])
    assert "er2" not in hidden
    assert "robot" in hidden
    assert "host" in hidden
    for words in (["show", "sqlite:///a.db", url], ["db", "downgrade", "sqlite:///a.db", "1", url]):
        assert "er2" not in commands.run(*words).stderr


def test_errors_of_a_process_are_one_line_and_no_traceback(file_url: str) -> None:
    for words, code in ((["show", file_url], 1), (["nonsense"], 2)):
        done = commands.child(*words, program=commands.PROGRAM)
        commands.one_line(done.stderr)
        assert (done.returncode, done.stdout) == (code, "")


def test_the_version_is_that_of_the_package() -> None:
    assert (
        commands.child("--version", program=commands.PROGRAM).stdout
        == f"kant-sql {importlib.metadata.version('kant-sql')}\n"
    )


def _commands(command: Any, *path: str) -> Iterator[list[str]]:
    for name in command.list_commands(None) if isinstance(command, CommandGroup) else ():
        yield [*path, name]
        yield from _commands(command.get_command(None, name), *path, name)


@pytest.mark.parametrize("words", [[], *_commands(get_command(app))])
def test_help_is_short_to_ask_for_and_has_no_python_in_it(words: list[str]) -> None:
    result = commands.run(*words, "-h")
    assert result.exit_code == 0
    assert result.stdout == commands.run(*words, "--help").stdout
    assert result.stdout.startswith(" ".join(["Usage: kant-sql", *words]))
    assert not re.search(r"[{}]|<\w", result.stdout), result.stdout
    assert "FILE......" not in result.stdout
    assert "and none." not in result.stdout


@pytest.mark.parametrize(
    "words", [["show"], ["show", "--json"], ["log"], ["log", "--json"], ["dump"]]
)
def test_a_reader_that_stops_ends_the_command_quietly(words: list[str], sqlite_store: str) -> None:
    process = commands.start(*words, sqlite_store)
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.read(10)
    process.stdout.close()
    assert process.wait(commands.CHILD_TIMEOUT) == 0
    assert process.stderr.read() == b""
    process.stderr.close()


@pytest.mark.more
def test_ctrl_c_ends_the_command_without_a_traceback(sqlite_store: str) -> None:
    process = commands.start("log", sqlite_store, program=commands.PROGRAM)
    assert process.stdout is not None
    assert process.stderr is not None
    # From here on it waits for a reader: the pipe is full.
    assert process.stdout.read(10)
    process.send_signal(signal.SIGINT)
    assert process.wait(commands.CHILD_TIMEOUT) == 130
    assert process.stderr.read().strip() == b""
    process.stdout.close()
    process.stderr.close()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="Linux has a device that is full")
def test_output_that_cannot_be_written_is_an_error(sqlite_store: str) -> None:
    with open("/dev/full", "wb") as full:
        process = commands.start("log", sqlite_store, stdout=full)
        _, error = process.communicate(timeout=commands.CHILD_TIMEOUT)
    assert "No space left on device" in commands.one_line(error.decode())
    assert process.returncode == 1


@pytest.mark.more
@pytest.mark.parametrize("words", [["--help"], ["show"], ["log", "--json"]])
def test_closed_output_is_no_error(words: list[str], tmp_path: Path) -> None:
    url = new_file_store(tmp_path / "store.db")
    write_history(url)
    line = shlex.join([*commands.PROGRAM, *words, *([] if "--help" in words else [url])])
    done = commands.child("-c", f"{line} >&-", program=["sh"])
    assert (done.returncode, done.stderr) == (0, "")


def test_a_terminal_gets_boxes_and_styles_and_data_is_never_markup(file_url: str) -> None:
    long_name = "x" * 100
    with kant_sql.connect(file_url, actor="[red]:smile:[/red]") as kb:
        kb.propositions.save(robot_at())
        kb.types.save_all([PddlTypeDto("[red]robot[/red]"), PddlTypeDto(long_name)])
    shown, _ = commands.in_terminal("show", file_url, width=60)
    assert "\x1b[1m" in shown
    assert "│ (robot_at rb1 wp1) │" in shown
    assert "[red]robot[/red]" in shown
    assert max(len(line) for line in shown.splitlines() if "│" in line) <= 60
    assert shown.count("x") == len(long_name)
    log, _ = commands.in_terminal("log", file_url, width=60)
    assert "\x1b[32m  + fact (robot_at rb1 wp1)" in log
    assert "actor: [red]:smile:[/red]" in log
    assert f"  + type {long_name}" in log


MARKING = "sed s/^/paged:/"


@pytest.mark.parametrize(
    ("words", "variables", "is_paged"),
    [
        (["show"], {"KANT_SQL_PAGER": MARKING, "PAGER": "false"}, True),
        (["log"], {"KANT_SQL_PAGER": MARKING}, True),
        (["dump"], {"KANT_SQL_PAGER": MARKING}, True),
        (["kbs"], {"KANT_SQL_PAGER": MARKING}, True),
        (["--no-pager", "show"], {"KANT_SQL_PAGER": MARKING}, False),
        (["show", "--json"], {"KANT_SQL_PAGER": MARKING}, False),
        (["db", "current"], {"KANT_SQL_PAGER": MARKING}, False),
        (["show"], {"KANT_SQL_PAGER": "", "PAGER": MARKING}, False),
        (["show"], {"KANT_SQL_PAGER": "cat"}, False),
        (["show"], {"KANT_SQL_PAGER": "there-is-no-such-pager -R"}, False),
    ],
)
def test_a_terminal_gets_long_output_through_a_pager(
    store: str, words: list[str], variables: dict[str, str], is_paged: bool
) -> None:
    if store.startswith("postgresql"):
        pytest.skip("the pager does not depend on the database")
    shown, _ = commands.in_terminal(*words, store, width=100, variables=variables)
    lines = shown.splitlines()
    assert len(lines) >= 1
    assert {line.startswith("paged:") for line in lines} == {is_paged}
    if words == ["show"]:
        # Through a pager, too, there are styles and boxes.
        assert "\x1b[1m" in shown
        assert "│ rb1" in shown


@pytest.mark.skipif(shutil.which("less") is None, reason="less is not installed")
def test_less_gets_the_options_that_git_gives_it_and_quits_on_one_screen(
    sqlite_store: str, store: str
) -> None:
    wanted = {"KANT_SQL_PAGER": "printenv LESS"}
    assert commands.in_terminal("log", store, variables=wanted)[0] == "FRX\n"
    assert commands.in_terminal("log", store, variables={**wanted, "LESS": "-S"})[0] == "-S\n"
    # Ends by itself: nobody presses q.
    shown, _ = commands.in_terminal(
        "kbs", sqlite_store, width=100, variables={"KANT_SQL_PAGER": "less", "LINES": "50"}
    )
    assert "default" in shown


def test_who_quits_the_pager_has_read_enough(sqlite_store: str) -> None:
    shown, _ = commands.in_terminal("log", sqlite_store, variables={"KANT_SQL_PAGER": "head -n 2"})
    assert len(shown.splitlines()) == 2


def test_a_pipe_has_no_pager(sqlite_store: str) -> None:
    done = commands.child("kbs", sqlite_store, KANT_SQL_PAGER=MARKING)
    assert done.stdout == commands.run("kbs", sqlite_store).stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_written_for_each_shell(shell: str) -> None:
    done = commands.child(
        "--show-completion", shell, _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1"
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "_KANT_SQL_COMPLETE" in done.stdout
    if program := shutil.which(shell):
        checked = subprocess.run(
            [program, "-n"], input=done.stdout, text=True, capture_output=True, check=False
        )
        assert (checked.returncode, checked.stderr) == (0, "")


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"COMP_WORDS": "kant-sql sh", "COMP_CWORD": "1"}, "show\n"),
        ({"COMP_WORDS": "kant-sql db up", "COMP_CWORD": "2"}, "upgrade\n"),
        ({"COMP_WORDS": "kant-sql show --pr", "COMP_CWORD": "2"}, "--predicate\n"),
    ],
)
def test_commands_and_options_are_completed(
    variables: dict[str, str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"_KANT_SQL_COMPLETE": "complete_bash", **variables}.items():
        monkeypatch.setenv(name, value)
    done = commands.child()
    assert (done.returncode, done.stdout, done.stderr) == (0, expected, "")


def test_completion_is_installed_for_the_shell_that_is_named(tmp_path: Path) -> None:
    done = commands.child(
        "--install-completion", "bash", HOME=str(tmp_path),
        _TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION="1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / ".bash_completions" / "kant-sql.sh").exists()
    assert "kant-sql.sh" in (tmp_path / ".bashrc").read_text()


def test_importing_the_library_imports_neither_drivers_nor_alembic_nor_the_command_line() -> None:
    heavy = ["typer", "click", "rich", "alembic", "psycopg", "unified_planning", "kant_sql.cli"]
    program = f"""
import sys, kant_sql
from kant_sql import *
from kant_sql.knowledge_base import KnowledgeBase
assert kant_sql.KnowledgeBase is KnowledgeBase
print([name for name in {heavy} if name in sys.modules])
"""
    assert commands.child(program=[sys.executable, "-c", program]).stdout == "[]\n"


@pytest.mark.more
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--help"], "Usage: kant-sql"),
        (["load", "--help"], "Usage: kant-sql load"),
        (["db", "--help"], "Usage: kant-sql db"),
        (["--version"], "kant-sql "),
        (["check", "domain.pddl"], "domain.pddl: domain d"),
    ],
    ids=" ".join,
)
def test_help_and_check_import_neither_sqlalchemy_nor_a_driver(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], said: str
) -> None:
    for name in [*os.environ]:
        # What records coverage in a child imports sqlite3.
        if name.startswith(("COVERAGE_", "COV_CORE_")):
            monkeypatch.delenv(name)
    (tmp_path / "domain.pddl").write_text("(define (domain d))")
    program = [sys.executable, "-X", "importtime", "-m", "kant_sql.cli.main"]
    done = commands.child(*words, program=program, cwd=tmp_path)
    assert (done.returncode, done.stdout[: len(said)]) == (0, said)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "kant_sql.errors" in imported
    heavy = {"sqlalchemy", "sqlite3", "psycopg", "alembic", "unified_planning", "asyncio"}
    assert not imported & heavy
