"""The waypoint walk-through runs on every backend, and prints what the store says."""

from __future__ import annotations

import kant_sql
from tests.support.processes.commands import run_example

ACTION = """\
(:durative-action navigation
	:parameters ( ?r - robot ?s - wp ?d - wp)
	:duration (= ?duration 10)
	:condition (and
		(at start (robot_at ?r ?s))
	)
	:effect (and
		(at start (not (robot_at ?r ?s)))
		(at end (robot_at ?r ?d))
	)
)
"""


def lines_below(heading: str, output: str) -> list[str]:
    """The indented lines that follow a heading."""
    lines = output.splitlines()
    below = lines[lines.index(heading) + 1 :]
    end = next((n for n, line in enumerate(below) if not line.startswith("  ")), len(below))
    return [line.strip() for line in below[:end]]


def test_it_shows_the_present_and_the_past(url: str) -> None:
    done = run_example("navigation.py", url)
    assert (done.returncode, done.stderr) == (0, "")
    assert lines_below("Objects:", done.stdout) == ["rb1 - robot", "wp1 - wp", "wp2 - wp"]
    assert lines_below("Facts:", done.stdout) == ["(robot_at rb1 wp1)"]
    assert lines_below("Goals:", done.stdout) == ["(robot_at rb1 wp2)"]
    assert ACTION in done.stdout
    assert lines_below("Facts now:", done.stdout) == ["(robot_at rb1 wp2)"]
    assert lines_below("Facts at revision 3:", done.stdout) == ["(robot_at rb1 wp1)"]
    assert lines_below("All that happened:", done.stdout)[:3] == [
        "4 executive: navigation to wp2 finished",
        "+ fact (robot_at rb1 wp2)",
        "- fact (robot_at rb1 wp1)",
    ]


def test_without_a_url_it_runs_in_memory() -> None:
    done = run_example("navigation.py")
    assert (done.returncode, done.stderr) == (0, "")
    assert lines_below("Facts now:", done.stdout) == ["(robot_at rb1 wp2)"]


def test_a_second_run_on_the_same_store_ends_in_the_same_state(shared_url: str) -> None:
    outputs = [run_example("navigation.py", shared_url).stdout for _ in range(2)]
    assert lines_below("Facts now:", outputs[0]) == lines_below("Facts now:", outputs[1])
    with kant_sql.connect(shared_url, knowledge_base="waypoints") as kb:
        assert [str(fact) for fact in kb.propositions.get_all()] == ["(robot_at rb1 wp2)"]
        assert [str(goal) for goal in kb.goals.get_propositions()] == ["(robot_at rb1 wp2)"]
