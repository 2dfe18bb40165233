"""The robot plans, is surprised, plans anew from the store, and everything is on record.

With actions that take no time, with durations, and with fuel.
"""

from __future__ import annotations

import importlib.util
import shutil
from decimal import Decimal

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


FUEL = """\
What became of the fuel:
  1 operator, the tour: (= (fuel blue) 20)
  2 executive, (drive blue depot village) succeeded: (= (fuel blue) 13.5)
  3 gauge, the tank leaks: (= (fuel blue) 3.5)
  4 executive, (drive blue village garage) succeeded: (= (fuel blue) 2.0)
  5 executive, (refuel blue garage) succeeded: (= (fuel blue) 20)
  6 executive, (drive blue garage village) succeeded: (= (fuel blue) 18.5)
  7 executive, (drive blue village farm) succeeded: (= (fuel blue) 10.5)
"""


def missing(module: str) -> bool:
    return importlib.util.find_spec(module) is None


@pytest.mark.more
def test_it_delivers_the_letter_in_spite_of_the_surprise(file_url: str) -> None:
    done = run_example("plan_and_act.py", file_url)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Plan of revision 1, by " in done.stdout
    assert "Plan of revision 3, by " in done.stdout
    assert "(pick letter hall) cannot be applied: (parcel_at letter hall): " in done.stdout
    assert "The goals are reached." in done.stdout
    assert done.stdout.endswith(STORY)
    with kant_sql.connect(file_url, knowledge_base="delivery") as kb:
        before = {str(fact) for fact in kb.at(1).propositions.get_all()}
        assert "(parcel_at letter hall)" in before
        now = {str(fact) for fact in kb.propositions.get_all()}
        assert {"(parcel_at letter office)", "(robot_at dock)", "(gripper_free)"} <= now


@pytest.mark.more
@pytest.mark.skipif(missing("up_aries"), reason="aries is not installed")
def test_a_door_that_slips_breaks_an_invariant_and_is_planned_for_anew(file_url: str) -> None:
    done = run_example("plan_and_act_temporal.py", file_url)
    assert (done.returncode, done.stderr) == (0, "")
    assert "(open hall room): does not hold, since revision 5 by camera" in done.stdout
    assert "The goals are reached." in done.stdout
    with kant_sql.connect(file_url, knowledge_base="ward") as kb:
        first, second = kb.plans.get_all()
        # The drive is lost, the robot at the door goes on holding it, and nothing else begins.
        assert {step.action: step.outcome for step in first.steps} == {
            "hold_door": "succeeded",
            "drive": "aborted",
            "disinfect": None,
        }
        assert {step.outcome for step in second.steps} == {"succeeded"}
        assert kb.validate(second, at=second.revision).valid
        # While one robot drives, the other one holds the door.
        [held] = kb.when("(open hall room)", since=second.recorded_in)
        [drove] = kb.when("(not (at ?r hall))", since=second.recorded_in)
        assert held.since is not None
        assert drove.since is not None
        assert held.since.number < drove.since.number


@pytest.mark.skipif(
    missing("up_enhsp") or shutil.which("java") is None,
    reason="ENHSP, or the Java that runs it, is not installed",
)
@pytest.mark.more
def test_a_leaking_tank_is_noticed_and_refilled_on_the_way(file_url: str) -> None:
    done = run_example("plan_and_act_numeric.py", file_url)
    assert (done.returncode, done.stderr) == (0, "")
    needed = "(drive blue village farm) needs (>= (fuel blue) (length village farm)), "
    assert f"{needed}which is 3.5 and 8.\n" in done.stdout
    assert "The goals are reached.\n" in done.stdout
    assert done.stdout.endswith(FUEL)
    with kant_sql.connect(file_url, knowledge_base="courier") as kb:
        values = [kb.at(number).function_values.get("fuel", objects=["blue"]) for number in (2, 3)]
        assert values == [Decimal("13.5"), Decimal("3.5")]
