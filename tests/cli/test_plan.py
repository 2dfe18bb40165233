"""`kant-sql plan`: a plan from what is known, now and then."""

from __future__ import annotations

import json
from decimal import Decimal
from pathlib import Path
from unittest.mock import Mock

import pytest

import kant_sql
from kant_sql import KnowledgeBase, NoPlanError
from kant_sql.errors import PlannerMissingError
from kant_sql.planning import Plan, PlanStep
from tests.support.processes.commands import child, one_line, run

FILES = Path(__file__).parent / "files"
STEPS = [
    "(move rb1 table1 kitchen)",
    "(take rb1 cup kitchen)",
    "(move rb1 kitchen table1)",
    "(put rb1 cup table1)",
]


@pytest.fixture
def url(file_url: str) -> str:
    """The URL of a store of two revisions: from the second no plan leads to the goal."""
    with kant_sql.connect(file_url) as kb:
        with kb.transaction():
            kb.load_domain(FILES / "delivery.pddl")
            kb.load_problem(FILES / "coffee.pddl")
        lies = next(fact for fact in kb.propositions.get_all() if fact.predicate.name == "lies")
        kb.propositions.delete(lies)
    return file_url


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    """What the knowledge base is asked for; it answers with a plan that takes time."""
    calls: list[dict[str, object]] = []

    def plan(kb: KnowledgeBase, **words: object) -> Plan:
        calls.append({"revision": kb.revision, **words})
        steps = (
            PlanStep(Decimal("0.000"), "move", ("rb1", "kitchen"), Decimal("2.50")),
            PlanStep(Decimal("1E+1"), "wait"),
        )
        return Plan(steps, "aries", "solved_optimally", kb.revision)

    monkeypatch.setattr(KnowledgeBase, "plan", plan)
    return calls


@pytest.mark.more
def test_a_plan_is_found_in_a_process_of_its_own(url: str) -> None:
    pytest.importorskip("up_pyperplan", reason="needs the extra planning")
    done = child("plan", url, "--at", "1", "--engine", "pyperplan", "--timeout", "50")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == ["; revision 1", "; solved_satisficing by pyperplan", *STEPS]


def test_no_plan_is_one_line(url: str) -> None:
    pytest.importorskip("up_pyperplan", reason="needs the extra planning")
    result = run("plan", url, "--engine", "pyperplan", "--timeout", "50")
    one_line(result.stderr)
    assert (result.exit_code, result.stdout) == (1, "")


def test_the_plan_has_the_format_of_the_validator(url: str, asked: list[dict[str, object]]) -> None:
    result = run("plan", url)
    assert result.stdout == (
        "; revision 2\n; solved_optimally by aries\n0.000: (move rb1 kitchen) [2.50]\n10: (wait)\n"
    )
    assert asked == [{"revision": 2, "engine": None, "timeout": None, "strict": False}]


def test_engine_time_and_moment_can_be_chosen(url: str, asked: list[dict[str, object]]) -> None:
    words = ["--at", "1", "--engine", "enhsp", "--timeout", "1.5", "--kb", "default"]
    assert run("plan", *words, url=url).exit_code == 0
    assert asked == [{"revision": 1, "engine": "enhsp", "timeout": 1.5, "strict": False}]


@pytest.mark.usefixtures("asked")
def test_json_says_all_of_the_plan(url: str) -> None:
    assert json.loads(run("plan", url, "--json").stdout) == {
        "knowledge_base": "default",
        "revision": 2,
        "engine": "aries",
        "status": "solved_optimally",
        "ignored": [],
        "steps": [
            {
                "start": "0.000",
                "action": "move",
                "arguments": ["rb1", "kitchen"],
                "duration": "2.50",
            },
            {"start": "10", "action": "wait", "arguments": [], "duration": None},
        ],
    }


@pytest.mark.parametrize(
    "error",
    [
        PlannerMissingError('run pip install "kant-sql[planning]"'),
        NoPlanError("no plan was found within 5 seconds", "timeout"),
    ],
)
@pytest.mark.parametrize("words", [[], ["--json"]])
def test_what_keeps_from_planning_is_one_line(
    url: str, monkeypatch: pytest.MonkeyPatch, error: Exception, words: list[str]
) -> None:
    monkeypatch.setattr(KnowledgeBase, "plan", Mock(side_effect=error))
    result = run("plan", url, *words)
    if words:
        document = {"error": str(error), "type": type(error).__name__, "exit_code": 1}
        assert json.loads(result.stderr) == document
    else:
        assert one_line(result.stderr) == f"kant-sql: {error}"
    assert (result.exit_code, result.stdout) == (1, "")


def test_a_plan_is_recorded_and_listed_with_what_became_of_its_steps(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plan(kb: KnowledgeBase, **words: object) -> Plan:
        steps = (
            PlanStep(None, "move", ("rb1", "table1", "kitchen")),
            PlanStep(None, "move", ("rb1", "kitchen", "table1")),
        )
        return Plan(steps, "pyperplan", "solved_satisficing", kb.revision)

    monkeypatch.setattr(KnowledgeBase, "plan", plan)
    assert run("plans", url).stdout == "\nplans (0)\n"
    words = "--at", "1", "--record", "--actor", "operator", "--reason", "to see"
    document = json.loads(run("plan", url, *words, "--json").stdout)
    assert (document["revision"], document["recorded_in"]) == (1, 3)
    with kant_sql.connect(url) as kb:
        (revision,) = kb.store.revisions(after=2)
        assert (revision.actor, revision.reason) == ("operator", "to see")
        (recorded,) = kb.plans.get_all()
        assert recorded.id == document["plan"]
        kb.plans.set_status(recorded.steps[0], status="running")
    assert "1 running, 1 not started" in run("plans", url).stdout
    (line,) = run("plans", url, "--json").stdout.splitlines()
    one = json.loads(line)
    assert (one["knowledge_base"], one["plan"], one["planner"]) == (
        "default",
        recorded.id,
        "pyperplan",
    )
    assert [(step["action"], step["outcome"]) for step in one["steps"]] == [
        ("move", "running"),
        ("move", None),
    ]
    text = run("plans", url, "--plan", str(recorded.id)).stdout
    assert run("plans", url, str(recorded.id)).stdout == text
    assert f"plan {recorded.id}, recorded in revision 3, planned from revision 1" in text
    assert "0     (move rb1 table1 kitchen)  running" in text
    assert "1     (move rb1 kitchen table1)  not started" in text
    assert f"; plan {recorded.id}" not in run("plan", url, "--at", "1").stdout
    assert run("plans", url, "--at", "2").stdout == "\nplans (0)\n"


def test_what_a_planner_was_not_given_is_printed(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []

    def plan(kb: KnowledgeBase, **words: object) -> Plan:
        calls.append(words["strict"])
        return Plan((), "aries", "solved_satisficing", kb.revision, ignored=("(total-time)\nso",))

    monkeypatch.setattr(KnowledgeBase, "plan", plan)
    assert "; ignored: (total-time)\\nso\n" in run("plan", url).stdout
    assert json.loads(run("plan", url, "--json", "--strict").stdout)["ignored"] == [
        "(total-time)\nso"
    ]
    assert calls == [False, True]


def test_the_plan_of_another_planner_is_read_and_recorded(url: str, tmp_path: Path) -> None:
    file = tmp_path / "sas_plan"
    text = "(MOVE rb1 table1 kitchen)\r\n(move rb1 kitchen table1)\r\n; cost = 2 (unit cost)"
    file.write_text(text)
    words = "--read", str(file), "--at", "1", "--record", "--actor", "operator"
    document = json.loads(run("plan", url, *words, "--json").stdout)
    assert (document["revision"], document["engine"]) == (1, "fast-downward")
    with kant_sql.connect(url) as kb:
        (recorded,) = kb.plans.get_all()
    assert [str(step) for step in recorded.steps] == [
        "(move rb1 table1 kitchen)",
        "(move rb1 kitchen table1)",
    ]
    # What is printed is read again.
    printed = run("plan", url, "--read", str(file)).stdout
    file.write_text(printed)
    assert run("plan", url, "--read", str(file)).stdout == printed
    file.write_text("(mov rb1 table1 kitchen)")
    wrong = run("plan", url, "--read", str(file), "--record")
    assert "action 'mov' is not known at revision" in one_line(wrong.stderr)
    assert "(did you mean move?)" in wrong.stderr
    file.write_text("(move rb1 table1 kitchen)\nmove rb1")
    wrong = run("plan", url, "--read", str(file))
    assert "sas_plan:2:1: in the plan: found 'move rb1', expected a step as" in wrong.stderr
    assert wrong.exit_code == 1
    assert run("plan", url, "--read", str(file), "--strict").exit_code == 2
