"""A door closes in front of the robot: it goes around, and reaches the kitchen."""

from __future__ import annotations

import importlib.util

import pytest

import kant_sql
from tests.support.processes.commands import run_example

DONE = """\
plan 1, the rest is valid
plan 1, the rest needs nothing that changed
driving: (go hall corridor front)
driving: (go corridor hall front)
driving: (go hall garden gate)
driving: (go garden terrace path)
driving: (go terrace kitchen back)
plan 1 broke: step 1 of plan 1, (go corridor kitchen near_door), needs (open near_door): \
does not hold
plan 2 succeeded, 4 of 4 steps done
"""


@pytest.mark.more
@pytest.mark.skipif(
    importlib.util.find_spec("up_pyperplan") is None, reason="pyperplan is not installed"
)
def test_the_robot_goes_around(file_url: str) -> None:
    done = run_example("replan_door.py", file_url)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", DONE)
    with kant_sql.connect(file_url, knowledge_base="house") as kb:
        assert kb.holds("(at kitchen)")
        assert kb.store.verify().is_intact
