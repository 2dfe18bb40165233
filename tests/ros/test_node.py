"""The node as a robot meets it: processes, the program `ros2`, and whatever is killed."""

from __future__ import annotations

import random
import re
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import kant_sql
from tests.ros.running import client, ended, lines, needs_ros, node, ros2, running, wait_for_lines
from tests.support.processes.commands import PROGRAM
from tests.support.processes.workers import PATIENCE, wait_for
from tests.support.servers import MortalServer

pytestmark = [needs_ros, pytest.mark.more]

CLIENTS, BURST = 8, 2000


def wait_for_state(name: str, state: str) -> None:
    def is_so() -> bool:
        return name in ros2("node", "list") and state in ros2("lifecycle", "get", name)

    wait_for(is_so)


def test_a_node_is_renamed_looked_at_and_ended(file_url: str, tmp_path: Path) -> None:
    log, name = tmp_path / "log", "/rb1/kant_sql"
    with node(file_url, log, "--ros-args", "-r", "__ns:=/rb1") as process:
        wait_for_state(name, "active")
        assert ros2("param", "get", name, "url").endswith(file_url)
        request = "{condition: '(exists (?r) (= ?r ?r))'}"
        answer = ros2("service", "call", f"{name}/query", "kant_sql_msgs/srv/Query", request)
        assert "success=True, error_info='', holds=False" in answer
        for transition in ("deactivate", "cleanup"):
            assert "successful" in ros2("lifecycle", "set", name, transition)
        assert "query" not in ros2("service", "list")
        for transition in ("configure", "activate"):
            assert "successful" in ros2("lifecycle", "set", name, transition)
        assert f"{name}/query" in ros2("service", "list")
        assert ended(process, signal.SIGINT) == 0
    assert [each.name for each in tmp_path.glob("robot.db*")] == ["robot.db"]
    assert "Traceback" not in log.read_text()


def test_what_cannot_be_opened_is_one_line_without_a_password(tmp_path: Path) -> None:
    url, log = "postgresql://me:secret@localhost:1/store", tmp_path / "log"
    with running([*PROGRAM, "ros", url], log) as process:
        assert process.wait(PATIENCE) == 1
    [line] = [each for each in log.read_text().splitlines() if "[rcl]" not in each]
    assert "no connection" in line
    assert "secret" not in line
    with running([*PROGRAM, "ros", url, "--", "--ros-args", "-r"], log) as process:
        assert process.wait(PATIENCE) == 1
    assert "kant-sql: ROS 2 refuses its arguments" in log.read_text()
    assert "Traceback" not in log.read_text()


def test_a_node_that_cannot_be_configured_stays_unconfigured(tmp_path: Path) -> None:
    log, url = tmp_path / "log", "postgresql://me:secret@localhost:1/store"
    code = "from kant_sql.ros.node import main; main()"
    given = ["--ros-args", "-p", f"url:={url}"]
    with running([PROGRAM[0], "-c", code, *given], log) as process:
        wait_for_state("/kant_sql", "unconfigured")
        assert "successful" not in ros2("lifecycle", "set", "/kant_sql", "configure")
        assert "this one has a password" in log.read_text()
        wait_for_state("/kant_sql", "unconfigured")
        assert ended(process) == 0
    with running([PROGRAM[0], "-c", code], log, KANT_SQL_URL=url) as process:
        wait_for_state("/kant_sql", "unconfigured")
        assert "secret" not in ros2("param", "dump", "/kant_sql")
        assert ended(process) == 0
    assert "secret" not in log.read_text()


def ask_long(url: str, variables: str) -> str:
    """Make a question that tries all objects for each variable."""
    with kant_sql.connect(url) as kb:
        kb.load_domain(
            "(define (domain d) (:types spot) (:predicates (p ?a - spot) (q ?a ?b - spot)))"
        )
        names = [f"w{number}" for number in range(140)]
        kb.objects.save_all(f"{name} - spot" for name in names)
        kb.propositions.save_all(f"(p {name})" for name in names)
    *some, last = variables.split()
    known = " ".join(f"(p {each})" for each in some)
    return f"(forall ({variables} - spot) (imply (and {known}) (or (p {last}) (q ?a ?b))))"


def test_a_question_that_takes_long_holds_no_save_up(file_url: str, tmp_path: Path) -> None:
    told, condition = tmp_path / "told", ask_long(file_url, "?a ?b ?c")
    with node(file_url, tmp_path / "log"), client(told, "ask", condition) as asking:
        assert asking.wait(PATIENCE) == 0
    assert len(lines(told)) > 3


def test_a_node_ends_though_a_question_would_take_hours(file_url: str, tmp_path: Path) -> None:
    log, told = tmp_path / "log", tmp_path / "told"
    condition = ask_long(file_url, "?a ?b ?c ?d ?e")
    with node(file_url, log) as process, client(told, "ask", condition):
        wait_for_lines(told, 1)
        assert ended(process) == 0
    assert "Traceback" not in log.read_text()


@contextmanager
def saving(url: str, tmp_path: Path) -> Iterator[list[Path]]:
    """Let eight clients save; in the end, what they were told is there, and the history whole."""
    outputs = [tmp_path / f"client{number}" for number in range(CLIENTS)]
    with ExitStack() as clients:
        for number, output in enumerate(outputs):
            clients.enter_context(client(output, "save", f"rb{number}"))
        for output in outputs:
            wait_for_lines(output, 5)
        yield outputs
        for output in outputs:
            wait_for_lines(output, len(lines(output)) + 5)
    with kant_sql.connect(url) as kb:
        stored = set(map(str, kb.propositions.get_all()))
        told = {
            f"(robot_at rb{number} wp{each})"
            for number, output in enumerate(outputs)
            for each in lines(output)
        }
        assert told <= stored
        assert len(stored - told) <= CLIENTS
        assert kb.store.verify().is_intact


def test_a_killed_node_loses_nothing_that_was_acknowledged(file_url: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with ExitStack() as nodes:
        process = nodes.enter_context(node(file_url, log))
        with saving(file_url, tmp_path):
            for _ in range(2):
                time.sleep(random.uniform(0, 0.3))
                process.kill()
                process = nodes.enter_context(node(file_url, log))
        assert ended(process) == 0


def test_a_node_survives_a_killed_server(
    mortal_server: MortalServer, mortal_url: str, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    with node(mortal_url, log) as process:
        with saving(mortal_url, tmp_path):
            for _ in range(2):
                time.sleep(random.uniform(0, 0.3))
                mortal_server.crash()
        assert ended(process) == 0


def test_each_revision_is_followed_once_whatever_is_killed(file_url: str, tmp_path: Path) -> None:
    log, seen = tmp_path / "log", tmp_path / "seen"
    with ExitStack() as processes:
        first = processes.enter_context(node(file_url, log))
        follower = processes.enter_context(client(seen, "followed", "0"))
        with kant_sql.connect(file_url, actor="another process") as kb:
            for number in range(BURST):
                kb.objects.save(f"w{number} - wp")
                if number == BURST // 4:
                    first.kill()
                    processes.enter_context(node(file_url, log))
                if number == BURST // 2:
                    wait_for_lines(seen, 1)
                    follower.kill()
                    follower.wait(PATIENCE)
                    processes.enter_context(client(seen, "followed", str(len(lines(seen)))))
        wait_for_lines(seen, BURST)
    assert lines(seen) == list(range(1, BURST + 1))


def test_a_promoted_replica_is_followed_on(file_url: str, tmp_path: Path) -> None:
    replica, seen = f"sqlite:///{tmp_path / 'replica.db'}", tmp_path / "seen"
    with kant_sql.connect(file_url) as kb:
        kb.objects.save("w0 - wp")
        kb.store.push(replica)
        with node(replica, tmp_path / "log"), client(seen, "followed", "0"):
            wait_for_lines(seen, 1)
            kb.objects.save("w1 - wp")
            kb.store.push(replica)
            wait_for_lines(seen, 2)
            with kant_sql.connect(replica) as promoted:
                promoted.store.promote(actor="operator")
            with client(tmp_path / "saved", "save", "rb1", "1") as saving_:
                assert saving_.wait(PATIENCE) == 0
            wait_for_lines(seen, 4)
    assert lines(seen) == [1, 2, 3, 4]


def test_the_benchmark_compares_with_a_direct_save(tmp_path: Path) -> None:
    output = tmp_path / "output"
    words = ["--facts", "40", "--backend", "sqlite"]
    with running([PROGRAM[0], "-m", "tests.benchmarks.ros", *words], output) as process:
        assert process.wait(PATIENCE) == 0
    assert re.search(r"through the node +\d+\.\d\d ms +\d+\.\d\d x", output.read_text())
