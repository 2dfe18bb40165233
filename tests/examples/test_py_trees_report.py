"""A visitor of behaviour trees reports what three demos of py_trees do."""

from __future__ import annotations

import pytest

from tests.support.processes.commands import run_example

pytest.importorskip("py_trees", reason="needs py_trees: pip install py_trees")

SAID = """
selector (FFS) failed
selector (FFS) succeeded
selector (Running) aborted
sequence (Action 1) succeeded
sequence (Action 2) succeeded
sequence (Action 3) succeeded
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (Task 1) succeeded
pick_up_where_you_left_off (Mark
task_1_done) succeeded
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (High Priority) succeeded
pick_up_where_you_left_off (Task 2) aborted
"""


def test_three_demos_are_executions(url: str) -> None:
    done = run_example("py_trees_report.py", url)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == SAID.strip()
