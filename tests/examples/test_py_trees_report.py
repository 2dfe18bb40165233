"""A visitor of behaviour trees reports what three demos of py_trees do."""

from __future__ import annotations

import runpy

import pytest

import kant_sql
from tests.support.processes.commands import EXAMPLES, run_example

py_trees = pytest.importorskip("py_trees", reason="needs py_trees: pip install py_trees")

SAID = """
selector (FFS) failed
selector (FFS) failed
selector (FFS) succeeded
selector (Running) aborted
selector (FFS) succeeded
sequence (Action 1) succeeded
sequence (Action 2) succeeded
sequence (Action 3) succeeded
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (High Priority) aborted
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (High Priority) aborted
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (Task 1) succeeded
pick_up_where_you_left_off (Mark
task_1_done) succeeded
pick_up_where_you_left_off (Done?) failed
pick_up_where_you_left_off (High Priority) aborted
pick_up_where_you_left_off (High Priority) succeeded
pick_up_where_you_left_off (Task 2) aborted
"""


def test_three_demos_are_executions(url: str) -> None:
    done = run_example("py_trees_report.py", url)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == SAID.strip()


def test_each_tick_of_a_leaf_is_an_execution() -> None:
    reporter = runpy.run_path(str(EXAMPLES / "py_trees_report.py"))["Reporter"]
    root = py_trees.composites.Sequence("root", memory=False)
    leaves = [py_trees.behaviours.Success("look"), py_trees.behaviours.Failure("")]
    root.add_children(leaves)
    with kant_sql.connect("sqlite://", actor="tree") as kb:
        tree = py_trees.trees.BehaviourTree(root)
        tree.add_visitor(reporter(kb))
        for _ in range(3):
            tree.tick()
        done = [f"{one} {one.outcome}" for one in kb.executions.get_all()]
    assert sorted(done) == ["(Failure) failed"] * 3 + ["(look) succeeded"] * 3
