"""Plans are goals of the node, and their steps goals of the robot's own action servers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from tests.ros.running import client, needs_ros, node
from tests.support.processes.workers import PATIENCE, wait_for

pytestmark = [needs_ros, pytest.mark.more]

DOMAIN = """
(define (domain yard) (:requirements :typing :durative-actions) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (off ?r - robot))
  (:durative-action go-to :parameters (?r - robot ?p - place) :duration (= ?duration 5)
    :effect (at end (at ?r ?p)))
  (:action fly :parameters (?r - robot)))
"""
PROBLEM = """
(define (problem day) (:domain yard) (:objects r1 - robot hut ditch swamp - place)
  (:init) (:goal (at r1 hut)))
"""
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


@pytest.fixture
def kb(tmp_path: Path) -> Iterator[KnowledgeBase]:
    """The store of a node that runs beside the robot's skill `go_to`."""
    with kant_sql.connect(f"sqlite:///{tmp_path / 'robot.db'}") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        url = f"sqlite:///{tmp_path / 'robot.db'}"
        with node(url, tmp_path / "log"), client(tmp_path / "skill", "skill", "go_to"):
            yield kb


def executed(tmp_path: Path, *words: str) -> list[str]:
    """Have a plan executed, and return what is said of it."""
    output = tmp_path / "said"
    output.unlink(missing_ok=True)
    with client(output, "execute", *words) as process:
        process.wait(PATIENCE)
    return [line for line in output.read_text().splitlines() if "[rcl]" not in line]


def test_steps_are_goals_and_tell_what_they_do(kb: KnowledgeBase, tmp_path: Path) -> None:
    said = executed(tmp_path, "(go-to r1 hut) [5]\n(go-to r1 ditch)\n(go-to r1 hut)")
    # Feedback may come late, and the last of it after the result.
    assert {
        "1.0 (go-to r1 hut) running  0.00",
        "1.0 (go-to r1 hut) succeeded  0.33",
        "1.1 (go-to r1 ditch) running  0.33",
    } <= {*said}
    assert any("running heading for hut" in line for line in said)
    assert said[-1] == f"{ABORTED}|failed|1.1|E4|it is deep"
    failed = kb.executions.get("1.1")
    assert failed is not None
    assert (failed.outcome, failed.code, failed.text) == ("failed", "E4", "it is deep")
    assert kb.holds("(at r1 hut)")
    plan = kb.plans.record(kant_sql.Plan.read("(go-to r1 hut)"))
    assert executed(tmp_path, str(plan.id))[-1] == f"{SUCCEEDED}|succeeded|||"


def test_what_is_cancelled_is_aborted(kb: KnowledgeBase, tmp_path: Path) -> None:
    said = executed(tmp_path, "(go-to r1 swamp)", "heading for")
    assert said[-1].startswith(f"{CANCELED}|aborted|")
    [step] = kb.executions.get_all()
    assert (step.outcome, step.text) == ("aborted", "the plan was cancelled")


def test_what_nobody_does_or_knows_is_said(kb: KnowledgeBase, tmp_path: Path) -> None:
    [*_, said] = executed(tmp_path, "(fly r1)")
    assert said == f"{ABORTED}|failed|1.0|no server|nobody serves the action fly"
    [said] = executed(tmp_path, "/etc/passwd")
    assert said.startswith(f"{ABORTED}|refused|||")
    assert "expected a step" in said
    # An operator ends a plan from elsewhere.
    output = tmp_path / "other"
    with client(output, "execute", "(go-to r1 swamp)") as process:
        wait_for(lambda: output.exists() and "heading" in output.read_text())
        [step] = kb.executions.get_all(outcome="running")
        kb.fail(step, code="E9", text="stop")
        process.wait(PATIENCE)
    assert output.read_text().splitlines()[-1] == f"{ABORTED}|failed|{step.id}|E9|stop"
