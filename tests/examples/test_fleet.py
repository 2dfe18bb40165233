"""The fleet of the example: each history on the server is its robot's, whoever was killed."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from importlib import import_module
from pathlib import Path

import pytest

import kant_sql
from tests.support.chain import check_chain
from tests.support.processes.commands import EXAMPLES, run_example
from tests.support.profile import PROFILE

pytestmark = pytest.mark.more

ROBOTS, KILLS = 6, 2


def numbers(output: str) -> dict[str, int]:
    """Read the numbers that the example prints."""
    found = re.findall(r"([\d,]+) (robots|revisions|changes|pushes|bytes|processes)", output)
    return {what: int(number.replace(",", "")) for number, what in found}


def check(url: str, robots: int, kills: int) -> None:
    """Run the example, and compare what it says with what the server has."""
    words = ("--robots", str(robots), "--kills", str(kills))
    done = run_example("fleet.py", url, *words, timeout=60 + 3 * robots)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("every history on the server is its robot's\n")
    found = numbers(done.stdout)
    assert (found["robots"], found["processes"]) == (robots, kills)
    kept = kant_sql.operations.knowledge_bases(url)
    assert len(kept) == robots
    revisions = [one.revision or 0 for one in kept]
    assert sum(revisions) == found["revisions"]
    assert {one.behind for one in kept} == {0}
    # Each robot loads two documents, works, and pushes when it has a connection.
    assert min(revisions) > 3
    assert found["pushes"] >= 2 * robots - kills


def test_every_history_on_the_server_is_its_robots(shared_url: str) -> None:
    check(shared_url, ROBOTS, KILLS)
    assert len(check_chain(shared_url)) == ROBOTS
    # A server can be used again.
    words = ("--robots", "1", "--minutes", "15", "--kills", "0")
    done = run_example("fleet.py", shared_url, *words)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(kant_sql.operations.knowledge_bases(shared_url)) == ROBOTS + 1


def test_a_history_that_is_not_its_robots_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    fleet = import_module("fleet")
    server = f"sqlite:///{tmp_path / 'server.db'}"
    made = fleet.Fleet(server, tmp_path, 10, 1)
    names = [f"robot{number}" for number in range(4)]
    for name in names:
        with made.open(name) as kb:
            kb.load_domain(fleet.DOMAIN)
            kb.store.push(server)
            if name == "robot1":
                # This was not sent.
                kb.load_problem(fleet.problem(name))
    assert fleet.compare(made, names)[2] == ["robot1"]
    with closing(sqlite3.connect(tmp_path / "server.db")) as store:
        store.execute(
            "UPDATE revision SET actor = 'nobody' "
            "WHERE kb_id = (SELECT id FROM knowledge_base WHERE name = 'robot2')"
        )
        store.commit()
    assert fleet.compare(made, names)[2] == ["robot1", "robot2"]


def test_without_a_url_the_server_is_a_file() -> None:
    done = run_example("fleet.py", "--robots", "2", "--minutes", "12", "--kills", "1")
    assert (done.returncode, done.stderr) == (0, "")
    assert "every history on the server is its robot's" in done.stdout


@pytest.mark.skipif(not PROFILE.is_whole, reason="the whole fleet takes minutes: profile long")
def test_a_thousand_robots(shared_url: str) -> None:
    check(shared_url, 1_000, 10)
