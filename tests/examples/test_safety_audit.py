"""A day is audited by its rules: one is violated, and the store says by whom, when and why."""

from __future__ import annotations

from pathlib import Path

import pytest

import kant_sql
from tests.support.chain import check_chain
from tests.support.processes.commands import run_example

AUDIT = """\
violated (always (not (and (robot_at rb1 kitchen) (child_in kitchen))))
kept     (sometime-after (stove_on) (not (stove_on)))
kept     (always-within 300 (and (stove_on) (child_in kitchen)) (not (child_in kitchen)))

(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))
  is violated by revision 9, 57 minutes on
  camera: seen at the kitchen door

The robot and a child were in the same room:
  in the hall since 08:40, by camera
    until 08:55, by executive: fetching a cup
  in the kitchen since 08:57, by camera
    until 08:59, by executive: leaving to the child
  in the hall since 09:10, by camera
"""


def test_it_names_the_revision_that_violates_a_rule(shared_url: str) -> None:
    done = run_example("safety_audit.py", shared_url)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == AUDIT
    # A second run audits the same day again.
    assert run_example("safety_audit.py", shared_url).stdout == AUDIT
    assert check_chain(shared_url) == {"house": 11}


def test_it_writes_a_report_with_the_rules(tmp_path: Path) -> None:
    path = tmp_path / "day.html"
    done = run_example("safety_audit.py", f"sqlite:///{tmp_path / 'house.db'}", str(path))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{AUDIT}\nThe report is in {path}\n"
    page = path.read_text(encoding="utf-8")
    assert "1 violated</strong> of 3" in page
    assert "seen at the kitchen door" in page


def test_without_a_url_it_runs_in_memory() -> None:
    done = run_example("safety_audit.py")
    assert (done.returncode, done.stdout, done.stderr) == (0, AUDIT, "")


@pytest.mark.parametrize("end", [8, 9])
def test_the_day_was_safe_until_the_child_came(file_url: str, end: int) -> None:
    run_example("safety_audit.py", file_url)
    rule = "(always (not (and (robot_at rb1 kitchen) (child_in kitchen))))"
    with kant_sql.connect(file_url, knowledge_base="house") as kb:
        assert kb.at(end).pddl.check_rules(rule).is_satisfied is (end < 9)
