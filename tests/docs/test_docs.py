"""Every code block of the README and the docs is executed."""

from __future__ import annotations

import gc
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from sybil import Document, Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser
from typer.main import get_command

import kant_sql
from kant_sql.cli.common import CommandGroup
from kant_sql.cli.main import app
from tests.ros.running import PREFIX, environment, node
from tests.support.clusters import free_port, install_programs, stop_servers
from tests.support.processes.commands import command, run
from tests.support.processes.warm import PLANNING, python
from tests.support.servers import system_user

ROOT = Path(__file__).parents[2]
ROS = ROOT / "docs" / "ros.md"
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
# A command line that begins with `kant-sql`, and what its output goes to.
OWN = re.compile(
    r"(?P<fails>! )?kant-sql (?P<words>(?:'[^']*'|[^|&;<>$`'])+?)(?P<both> 2>&1)?"
    r"(?P<onward>(?: \| (?!.*kant-sql)| > ).*|)"
)
EXTRAS = set(
    tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
)
# These start servers, or repeat on the command line what other pages and `tests/cli/` check.
LONG = {"CHANGELOG.md", "cli.md", "fleet.md"}
PAGES = [
    pytest.param(path, marks=pytest.mark.more if path.name in LONG else ()) for path in DOCUMENTS
]
KNOWN_LANGUAGES = {"python", "console", "sql", "text", "json", "ini"}


def run_console(example: Example) -> None:
    """Run the `$` lines of a console block, and compare what they print with what stands there."""
    command = ""
    expected: list[str] = []
    for line in [*example.parsed.splitlines(), "$ true"]:
        if line.startswith("$ "):
            if command:
                check_command(command, "\n".join(expected))
            command, expected = line[2:], []
        else:
            expected.append(line)


def check_command(command: str, expected: str) -> None:
    if command.startswith("make "):
        # The tests are what make runs: only see that it has the target.
        subprocess.run([*shlex.split(command), "-n"], cwd=ROOT, check=True, capture_output=True)
        return
    if command.startswith("pip install "):
        # An install takes minutes: only see that pyproject.toml has the extras.
        (extras,) = re.findall(r"^pip install '?\.(?:\[([\w,]+)\])?'?$", command)
        assert set(filter(None, extras.split(","))) <= EXTRAS, command
        return
    if command.startswith("ros2 ") and not PREFIX:
        pytest.skip("the rest of the page needs ROS 2: KANT_SQL_TEST_ROS names its prefix")
    if match := OWN.fullmatch(command):
        failed, output = run_here(**match.groupdict())
    else:
        done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
        failed, output = bool(done.returncode), done.stdout
        assert not failed, f"$ {command}\n{output}{done.stderr}"
    assert not failed, f"$ {command}\n{output}"
    if expected.strip():
        assert output.strip() == expected.strip(), command


def run_here(fails: str | None, words: str, both: str | None, onward: str) -> tuple[bool, str]:
    """Run `kant-sql` in this process and the rest in a shell: whether it fails, and what it says.

    A process of its own takes ten times as long.
    """
    with mock.patch.object(sys, "executable", str(python(*PLANNING))):
        result = run(*shlex.split(words))
    has_failed = bool(result.exit_code) != bool(fails)
    output = result.output if both else result.stdout
    if not onward:
        return has_failed, output if not has_failed else result.output
    done = subprocess.run(
        f"cat {onward}", shell=True, input=output, capture_output=True, text=True, check=False
    )
    is_piped = onward.lstrip().startswith("|")
    return bool(done.returncode) if is_piped else has_failed, done.stdout


def parse(path: Path) -> Document:
    sybil = Sybil(
        parsers=[PythonCodeBlockParser(), CodeBlockParser("console", run_console)],
        path=str(path.parent),
    )
    return sybil.parse(path)


@pytest.fixture(scope="session")
def command_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("commands")
    program = folder / "kant-sql"
    program.write_text(f'#!/bin/sh\nexec {shlex.join(command())} "$@"\n')
    program.chmod(0o755)
    return folder


@pytest.fixture
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command_folder: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("KANT_SQL_URL", raising=False)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    monkeypatch.setenv("PATH", str(command_folder), prepend=os.pathsep)


@pytest.fixture
def fleet_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_migrations: None
) -> Iterator[Path]:
    """The page that starts servers, on free ports, and a folder that they may write to."""
    folder = Path(tempfile.mkdtemp(prefix="kantdocs"))
    if (user := system_user()) is not None:
        shutil.chown(folder, user)
    install_programs(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.chdir(folder)
    ports = {port: str(free_port()) for port in ("5432", "5433")}
    text = (ROOT / "docs" / "fleet.md").read_text()
    page = tmp_path / "fleet.md"
    page.write_text(re.sub("|".join(ports), lambda found: ports[found[0]], text))
    yield page
    stop_servers(folder)
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def ros_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The page whose node runs while its blocks do, if ROS 2 is there."""
    if not PREFIX:
        yield ROS
        return
    for name, value in environment().items():
        monkeypatch.setenv(name, value)
    kant_sql.connect("sqlite:///robot.db").close()
    with node("sqlite:///robot.db", tmp_path / "node.log"):
        yield ROS


@pytest.mark.usefixtures("empty_folder")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_code_blocks_run_in_order_in_an_empty_folder(
    path: Path,
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if path.name == "fleet.md":
        path = request.getfixturevalue("fleet_page")
    if path == ROS:
        path = request.getfixturevalue("ros_page")
    if path.name == "tools.md":
        from tests.audit.duck import install_sqlite_extension

        # DuckDB would download its extension.
        monkeypatch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        install_sqlite_extension()
    document = parse(path)
    for example in document.examples():
        example.evaluate()
    # What a page leaves open is freed here, and not in the middle of another test.
    document.namespace.clear()
    for _ in range(2):
        gc.collect()


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_block_says_its_language_and_some_test_runs_it(path: Path) -> None:
    inside = False
    for number, line in enumerate(path.read_text().splitlines(), start=1):
        if line.startswith("```"):
            if not inside:
                assert line[3:] in KNOWN_LANGUAGES, f"{path.name}:{number}: {line}"
            inside = not inside


def named_commands(group: Any, *path: str) -> Iterator[tuple[str, Any]]:
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if isinstance(command, CommandGroup):
            yield from named_commands(command, *path, name)
        else:
            yield " ".join([*path, name]), command


def sections_of(name: str) -> list[str]:
    """The sections of the command line's page that show the usage of a command."""
    usage = re.compile(rf"`{name} \[?(?:URL|SOURCE|FILE|NAME)")
    text = (ROOT / "docs" / "cli.md").read_text()
    return [*filter(usage.search, re.split(r"^## ", text, flags=re.MULTILINE))]


@pytest.mark.parametrize(("name", "command"), [*named_commands(get_command(app))])
def test_every_option_is_in_the_section_or_the_page_of_its_command(name: str, command: Any) -> None:
    texts = [path.read_text() for path in DOCUMENTS]
    found = sections_of(name) or [text for text in texts if f"kant-sql {name}" in text]
    for option in (each for each in command.params if each.param_type_name == "option"):
        words = {word for word in option.opts if word.startswith("--")} - {"--help"}
        assert not words or any(word in text for word in words for text in found), words


@pytest.fixture(scope="module")
def visited_store(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A store with an act, a plan that waits for its execution, and a branch."""
    url = f"sqlite:///{tmp_path_factory.mktemp('visited')}/store.db"
    with kant_sql.connect(url, actor="executive") as kb:
        kb.load_domain("""(define (domain tour) (:types place) (:predicates (at ?p - place))
            (:action go :parameters (?a ?b - place) :precondition (at ?a)
              :effect (and (not (at ?a)) (at ?b))))""")
        kb.load_problem("""(define (problem day) (:domain tour) (:objects hall lab - place)
            (:init (at hall)) (:goal (at lab)))""")
        kb.apply("(go hall lab)")
        kb.plans.record(kant_sql.Plan.read("(go lab hall)"))
        kb.branch("trial").close()
    return url


@pytest.mark.parametrize(
    "words",
    [
        *("show", "kbs", "log", "diff 1", "acts", "statistics", "history hall"),
        *("consequences '(at hall)'", "verify", "archive --before 3 --to sqlite:// --dry-run"),
        *("views --sql", "plans", "holds '(at lab)'", "goals", "applicable", "validate --plan 1"),
        *("why-not '(go lab hall)'", "when '(at ?p)'", "rules '(always (at lab))'"),
        *("merge trial", "dump", "db current"),
    ],
)
def test_every_field_of_a_document_is_in_the_section_of_its_command(
    words: str, visited_store: str
) -> None:
    name, *rest = shlex.split(words.replace("db current", "'db current'"))
    kb = [] if name in ("kbs", "db current") else ["--kb", "default"]
    result = run(*name.split(), visited_store, *rest, *kb, "--json")
    document = json.loads(result.stdout.splitlines()[0])
    missing = {key for key in document if not any(f"`{key}`" in text for text in sections_of(name))}
    assert not missing
