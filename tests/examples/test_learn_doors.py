"""The robot learns to go around the door that fails every third time."""

from __future__ import annotations

import importlib.util

import pytest

import kant_sql
from tests.support.processes.commands import run_example


@pytest.mark.more
@pytest.mark.skipif(
    importlib.util.find_spec("up_fast_downward") is None, reason="Fast Downward is not installed"
)
def test_the_choice_changes_and_success_rises(file_url: str) -> None:
    done = run_example("learn_doors.py", file_url, "40")
    assert (done.returncode, done.stderr) == (0, "")
    before, after, *_, last = done.stdout.splitlines()
    assert before.startswith("40 missions by front fire_door: ")
    assert after.startswith("40 missions by gate arch side: ")
    assert last == "Learning helped."
    with kant_sql.connect(file_url, knowledge_base="building") as kb:
        shortest, learned = kb.plans.get_all()
        assert "cost-of-pass" not in shortest.problem_pddl()
        assert "(= (cost-of-pass fire_door hall store) " in learned.problem_pddl()
        # What was known then gives the same costs again.
        again = kb.at(learned.revision).plan("fast-downward-opt", costs="history", timeout=120)
        assert again.problem_hash == learned.problem_hash
        assert kb.store.verify().is_intact
