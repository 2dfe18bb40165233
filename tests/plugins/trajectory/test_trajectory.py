"""Trajectories have the executions that changed the state alone; a learner finds their effects."""

from __future__ import annotations

import json
import os
import random
import subprocess
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.dto import formulas as f
from kant_sql.errors import InvalidArgumentError
from kant_sql.knowledge_base import state_of
from kant_sql.pddl import read_domain
from kant_sql_plugins.trajectory import export_trajectories
from tests.support.processes.commands import run

DOMAIN = """
(define (domain doors) (:requirements :typing :durative-actions :numeric-fluents) (:types door)
  (:predicates (open ?d - door) (busy)) (:functions (times ?d - door) - number (last) - door)
  (:action unlock :parameters (?d - door) :precondition (not (open ?d))
    :effect (and (open ?d) (increase (times ?d) 1)))
  (:durative-action paint :parameters (?d - door) :duration (= ?duration 5)
    :effect (and (at start (busy)) (at end (not (busy))))))
"""
PROBLEM = """
(define (problem home) (:domain doors) (:objects front back side - door)
  (:init (= (times front) 0) (= (times back) 0) (= (last) side)))
"""
SHARED = Path(__file__).parents[4].parent / "shared" / "pddl"
LEARNER = os.environ.get("KANT_SQL_TEST_LEARNER")
LEARN = Path(__file__).with_name("learn.py")


def trajectories(kb: KnowledgeBase, url: str, folder: Path, **window: Any) -> list[str]:
    """Export what was done, and read it; without late reports both clocks say the same."""
    window |= {"knowledge_base": state_of(kb).store.name, "replace": True}
    late = export_trajectories(url, to=folder, clock="valid", **window)
    done = export_trajectories(url, to=folder, **window)
    assert late.files == done.files
    texts = [folder / file.path for file in done.files if file.content == "executions"]
    assert [file.rows for file in done.files if file.content == "executions"] == [
        path.read_text().count("(operator:") for path in texts
    ]
    return [path.read_text() for path in texts]


@pytest.fixture
def url(scratch_url: str) -> str:
    return scratch_url


@pytest.fixture
def kb(url: str, request: pytest.FixtureRequest) -> Any:
    name = request.node.originalname
    with kant_sql.connect(url, knowledge_base=name, actor="executive") as made:
        made.load_domain(DOMAIN)
        made.load_problem(PROBLEM)
        yield made


def test_states_and_actions_in_turn(kb: KnowledgeBase, url: str, tmp_path: Path) -> None:
    kb.apply("(unlock front)")
    running = kb.start("(paint front)")
    kb.end(running)
    [text] = trajectories(kb, url, tmp_path / "out")
    assert text == (
        "((:init (= (times back) 0) (= (times front) 0))\n"
        "(operator: (unlock front))\n"
        "(:state (= (times back) 0) (= (times front) 1) (open front))\n"
        "(operator: (paint front))\n"
        "(:state (= (times back) 0) (= (times front) 1) (open front))\n"
        ")\n"
    )
    [folder] = (tmp_path / "out").glob("knowledge_base=*")
    assert (folder / "domain.pddl").read_text() == kb.domain_pddl()
    assert (folder / "problem.pddl").read_text() == kb.problem_pddl()


def test_another_begins_where_something_else_changed_the_state(
    kb: KnowledgeBase, url: str, tmp_path: Path
) -> None:
    kb.apply("(unlock front)")
    kb.propositions.delete("(open front)")
    kb.apply("(unlock front)")
    kb.apply("(unlock back)")
    texts = trajectories(kb, url, tmp_path / "out")
    assert [text.count("operator") for text in texts] == [1, 2]
    low = kb.revision - 1
    [last] = trajectories(kb, url, tmp_path / "out", since=low)
    assert last == texts[1]


def test_what_cannot_be_told_apart_is_left_out(kb: KnowledgeBase, url: str, tmp_path: Path) -> None:
    with kb.transaction():
        kb.apply("(unlock front)")
        kb.apply("(unlock back)")
    disturbed = kb.start("(paint front)")
    kb.propositions.delete("(open back)")
    kb.end(disturbed)
    kb.fail(kb.start("(paint back)"), code="E1")
    kb.executions.report("wave", arguments=["front"], outcome="succeeded")
    with pytest.raises(kant_sql.NotApplicableError):
        kb.apply("(unlock front)", record_refusal=True)
    cut = kb.start("(paint side)")
    low = kb.revision + 1
    kb.end(cut)
    assert trajectories(kb, url, tmp_path / "all") != []
    assert trajectories(kb, url, tmp_path / "cut", since=low) == []
    [text] = trajectories(kb, url, tmp_path / "out")
    assert [line for line in text.splitlines() if "operator" in line] == [
        "(operator: (paint side))"
    ]


def test_what_an_executive_writes_itself_is_of_its_execution(
    kb: KnowledgeBase, url: str, tmp_path: Path
) -> None:
    act = kb.executions.report("unlock", arguments=["front"], outcome="running")
    with kb.transaction(execution=act):
        kb.propositions.save("(open front)")
    kb.executions.report(act, outcome="succeeded")
    [text] = trajectories(kb, url, tmp_path / "out")
    assert text.count("(operator: (unlock front))") == 1
    assert text.count("(open front)") == 1


def test_at_the_prompt(kb: KnowledgeBase, url: str, tmp_path: Path) -> None:
    kb.apply("(unlock front)")
    done = run("export", url, "--to", str(tmp_path / "out"), "--format", "trajectory")
    assert (done.exit_code, done.stderr) == (0, "")
    with pytest.raises(InvalidArgumentError, match="whole states"):
        export_trajectories(url, to=tmp_path / "out", names=["open"])
    words = "--to", str(tmp_path / "out"), "--format", "trajectory", "--replace", "--json"
    late = run("export", url, *words, "--clock", "valid")
    assert (late.exit_code, json.loads(late.stdout)["clock"]) == (0, "valid")


def walk(url: str, pair: str, steps: int) -> None:
    """Execute random steps of a problem."""
    dice = random.Random(3)
    folder = SHARED / pair
    [problem] = [path for path in folder.glob("*.pddl") if path.name != "domain.pddl"]
    with kant_sql.connect(url, knowledge_base="x") as kb:
        kb.load_domain(folder / "domain.pddl")
        kb.load_problem(problem)
        begin = kb.revision
        done = 0
        while done < steps:
            choice = [*kb.applicable_actions()]
            if choice:
                kb.apply(dice.choice(choice))
                done += 1
            else:
                kb.restore(begin)


def effects(path: Path) -> dict[str, set[str]]:
    """The effects of a domain's actions, as the learner writes them."""
    return {
        action.name.lower(): {
            str(part).lower()
            for effect in action.effect
            for part in (effect.formulas if isinstance(effect, f.And) else (effect,))
            if not isinstance(part, f.Assign)
        }
        for action in read_domain(path).actions
    }


PAIRS = [
    "ipc2000-blocks-strips-typed",
    "ipc2014-child-snack-sequential-optimal",
    "ipc2014-hiking-sequential-optimal",
    "ipc2011-visit-all-sequential-optimal",
]


@pytest.mark.more
@pytest.mark.skipif(
    LEARNER is None, reason="KANT_SQL_TEST_LEARNER names no Python that has the package n-sam"
)
@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared is absent")
@pytest.mark.parametrize("pair", PAIRS)
def test_a_learner_finds_the_effects_of_a_domain(pair: str, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'walk.db'}"
    walk(url, pair, 200)
    done = export_trajectories(url, to=tmp_path / "out")
    assert sum(file.rows for file in done.files) == 200
    folder = tmp_path / "out" / "knowledge_base=x"
    assert LEARNER is not None
    learned = subprocess.run(
        [LEARNER, str(LEARN), str(folder)], capture_output=True, text=True, check=True
    )
    found = json.loads(learned.stdout.splitlines()[-1])
    assert found
    expected = effects(SHARED / pair / "domain.pddl")
    assert {name: set(each) for name, each in found.items()} == {
        name: expected[name] for name in found
    }
