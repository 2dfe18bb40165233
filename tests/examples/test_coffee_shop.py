"""The coffee shop runs on stores that processes share, and what it prints is true."""

from __future__ import annotations

import os
import pty
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from tests.support.processes.commands import EXAMPLES, run_example
from tests.support.processes.warm import MODULES, python
from tests.support.stores import make_store_url

ITERATIONS = 2
TASKS = ("TtR", "TtL", "TtC", "TtS", "TtG")
NUMBER = r"\s+(\d+\.\d\d)"
STAY = re.compile(r" (\d+) - (\d+|now) +\(robot_at rb1 (\w+)\) +(\w+) +(.+?) *$", re.MULTILINE)


class Ran(NamedTuple):
    """A run of the example, and the store that it has left behind."""

    output: str
    kb: KnowledgeBase
    first: int
    last: int


class Stay(NamedTuple):
    """A stay of the robot at a place, from one revision until before another."""

    since: int
    until: int
    place: str
    actor: str
    reason: str


@pytest.fixture(scope="module", params=["sqlite-file", "postgresql"])
def ran(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ran]:
    url = make_store_url(request, request.param, tmp_path_factory.mktemp("shop"))
    done = run_example("coffee_shop.py", url, "--iterations", str(ITERATIONS))
    assert (done.returncode, done.stderr) == (0, "")
    said = re.search(r"The last iteration made revisions (\d+) to (\d+)\.", done.stdout)
    assert said is not None
    with kant_sql.connect(url, knowledge_base="coffee_shop") as kb:
        yield Ran(done.stdout, kb, int(said[1]), int(said[2]))


def times(output: str) -> dict[str, list[float]]:
    """The table of times: mean, standard deviation, minimum, maximum and sum of each row."""
    rows = re.findall(rf"^\s*(Tt.|total){NUMBER * 5}\s*$", output, re.MULTILINE)
    return {name: [float(cell) for cell in cells] for name, *cells in rows}


@pytest.mark.more
def test_the_table_has_a_row_for_each_task_and_the_total(ran: Ran) -> None:
    rows = times(ran.output)
    assert "milliseconds" in ran.output
    assert tuple(rows) == (*TASKS, "total")
    for mean, deviation, least, most, total in rows.values():
        assert 0 < least <= mean <= most
        # Each number is rounded to a hundredth: three of them are off by 0.015 at most.
        assert deviation <= most - least + 0.02
        assert total == pytest.approx(mean * ITERATIONS, abs=0.02)
    assert rows["total"][4] == pytest.approx(sum(rows[task][4] for task in TASKS), abs=0.05)


def stays(ran: Ran) -> list[Stay]:
    """Where the example says that the robot was."""
    rows = STAY.findall(ran.output)
    return [
        Stay(int(since), ran.last + 1 if until == "now" else int(until), place, actor, reason)
        for since, until, place, actor, reason in rows
    ]


def test_the_robot_was_where_it_says_at_every_revision_of_the_last_iteration(ran: Ran) -> None:
    told = {at: stay.place for stay in stays(ran) for at in range(stay.since, stay.until)}
    seen = {
        at: facts[0].objects[1].name
        for at in range(ran.first, ran.last + 1)
        if (facts := ran.kb.at(at).propositions.get_by_predicate("robot_at"))
    }
    assert ran.last == ran.kb.revision
    assert seen == told
    assert f"Before revision {min(seen)} the robot knew nothing" in ran.output


def test_it_names_the_component_that_put_the_robot_there(ran: Ran) -> None:
    revisions = {
        revision.number: revision for revision in ran.kb.store.revisions(after=ran.first - 1)
    }
    for stay in stays(ran):
        revision = revisions[stay.since]
        assert (stay.actor, stay.reason) == (revision.actor, revision.reason or "-")
    assert {stay.actor for stay in stays(ran)} == {"mission", "executive", "guidance"}


def test_the_initial_pddl_is_as_large_as_the_papers(ran: Ran) -> None:
    log = list(ran.kb.log(limit=ran.last - ran.first + 1))
    first_goal = min(
        entry.revision.number for entry in log for change in entry.changes if change.kind == "goal"
    )
    loaded = ran.kb.at(first_goal - 1)
    assert 28 <= len(loaded.objects.get_all()) <= 32
    assert sum(action.durative for action in loaded.actions.get_all()) >= 7
    assert 85 <= len(loaded.propositions.get_all()) <= 95


def test_all_tasks_are_done_in_the_end(ran: Ran) -> None:
    assert ran.kb.goals.get_propositions() == []
    done = [
        len(ran.kb.propositions.get_by_predicate(name))
        for name in ("checked", "delivered", "seated", "ordered", "waiting")
    ]
    assert done == [6, 6, 3, 0, 0]


def test_it_writes_a_report_and_says_how_to_look(ran: Ran) -> None:
    said = re.search(r"A report of the last iteration is in (\S+)$", ran.output, re.MULTILINE)
    assert said is not None
    page = Path(said[1]).read_text(encoding="utf-8")
    assert f'id="revision-{ran.last}"' in page
    assert f'id="revision-{ran.first - 1}"' not in page
    assert "kant-sql serve '" in ran.output
    again = re.search(r"kant-sql (report .*)$", ran.output, re.MULTILINE)
    assert again is not None
    words = shlex.split(again[1])
    assert words[-4:] == ["--since", str(ran.first), "--out", said[1]]


@pytest.mark.more
def test_without_the_extra_it_says_how_to_get_it(tmp_path: Path) -> None:
    # A module that cannot be imported is found first.
    (tmp_path / "jinja2.py").write_text("raise ImportError('not installed')")
    store = f"sqlite:///{tmp_path / 'shop.db'}"
    program = [sys.executable, str(EXAMPLES / "coffee_shop.py"), store, "--iterations", "1"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(program, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "pip install 'kant-sql[web]'" in done.stdout
    assert f"kant-sql serve '{store}'" in done.stdout
    assert not [*tmp_path.glob("*.html")]


def test_without_a_url_it_makes_a_new_file_and_says_where(tmp_path: Path) -> None:
    done = run_example("coffee_shop.py", "--iterations", "1", TMPDIR=str(tmp_path))
    assert done.returncode == 0
    said = re.search(r"sqlite:///(\S+\.db)", done.stdout)
    assert said is not None
    assert Path(said[1]).is_relative_to(tmp_path)
    assert Path(said[1]).stat().st_size > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sqlite://"], "a store in memory"),
        (["nonsense"], "not a database URL"),
        (["sqlite:////nowhere/shop.db"], "folder"),
        (["--iterations", "0"], "invalid positive value"),
    ],
)
def test_what_cannot_be_done_is_said_without_a_traceback(
    arguments: list[str], message: str
) -> None:
    done = run_example("coffee_shop.py", *arguments)
    assert done.returncode != 0
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_a_terminal_gets_a_progress_bar(tmp_path: Path) -> None:
    master, terminal = pty.openpty()
    program = [str(python(*MODULES)), str(EXAMPLES / "coffee_shop.py")]
    store = [f"sqlite:///{tmp_path / 'shop.db'}", "--iterations", "1"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "140"}
    with subprocess.Popen([*program, *store], stdout=terminal, env=environment) as child:
        os.close(terminal)
        shown = b""
        try:
            while chunk := os.read(master, 4096):
                shown += chunk
        except OSError:  # Linux's way to say that the other end is closed
            pass
        os.close(master)
    assert child.returncode == 0
    assert b"Serving coffee" in shown
    assert b"100%" in shown
