"""The robot plans, is surprised, plans anew from the store, and everything is on record."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import kant_sql
from tests.support.processes.commands import run_example

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("unified_planning") is None,
    reason="the extra `planning` is not installed",
)

STORY = """\
What happened:
  1 operator: Monday's mission
  2 executive: (move dock hall) succeeded
  3 perception: the letter was seen at the dock
  4 executive: (move hall dock) succeeded
  5 executive: (pick letter dock) succeeded
  6 executive: (move dock hall) succeeded
  7 executive: (move hall office) succeeded
  8 executive: (put letter office) succeeded
  9 executive: (move office hall) succeeded
  10 executive: (move hall dock) succeeded
"""


def test_it_delivers_the_letter_in_spite_of_the_surprise(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'delivery.db'}"
    done = run_example("plan_and_act.py", url)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Plan of revision 1, by " in done.stdout
    assert "Plan of revision 3, by " in done.stdout
    assert "The goals are reached." in done.stdout
    assert done.stdout.endswith(STORY)
    with kant_sql.connect(url, knowledge_base="delivery") as kb:
        before = {str(fact) for fact in kb.at(1).propositions.get_no_goals()}
        assert "(parcel_at letter hall)" in before
        now = {str(fact) for fact in kb.propositions.get_no_goals()}
        assert {"(parcel_at letter office)", "(robot_at dock)", "(gripper_free)"} <= now
        source = kb.revisions(after=1, limit=1)[0].source
        assert source == {"step": "(move dock hall)"}
