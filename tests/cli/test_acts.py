"""`kant-sql acts`."""

from __future__ import annotations

import json

import pytest

import kant_sql
from tests.support.processes.commands import run

DOMAIN = """
(define (domain doors) (:requirements :typing) (:types door) (:predicates (open ?d - door))
  (:action unlock :parameters (?d - door) :precondition (not (open ?d)) :effect (open ?d)))
"""
PROBLEM = "(define (problem home) (:domain doors) (:objects front back - door))"


@pytest.fixture
def url(file_url: str) -> str:
    with kant_sql.connect(file_url, knowledge_base="home", actor="executive") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        kb.apply("(unlock front)", reason="the bell rang")
        with pytest.raises(kant_sql.NotApplicableError):
            kb.apply("(unlock front)", record_refusal=True)
        dock = kb.executions.report("dock", outcome="running", arguments=["bay 4"])
        with kb.transaction(actor="safety"):
            kb.fail(dock, code="E4", text="no charger")
    return file_url


def test_what_was_done_is_shown_newest_first(url: str) -> None:
    out = run("acts", url).stdout
    lines = [line for line in out.splitlines() if line[0] != " "]
    assert [line.split("  ")[1:] for line in lines] == [
        ["(dock bay 4)", "failed"],
        ["(unlock front)", "refused"],
        ["(unlock front)", "succeeded"],
    ]
    assert "  code: E4\n  text: no charger\n" in out
    assert "  text: (not (open front)): does not hold\n" in out
    assert "  actor: executive\n  reason: the bell rang\n" in out


@pytest.mark.parametrize(
    ("words", "count"),
    [
        *((["--outcome", "refused"], 1), (["--action", "UNLOCK"], 2), (["--action", "dock"], 1)),
        *((["--object", "front", "-n", "1"], 1), (["--actor", "executive"], 3)),
        *((["--since", "4"], 2), (["--until", "3"], 1)),
    ],
)
def test_filters(url: str, words: list[str], count: int) -> None:
    lines = run("acts", url, *words, "--json").stdout.splitlines()
    found = [json.loads(line) for line in lines]
    assert len(found) == count
    assert {one["knowledge_base"] for one in found} == {"home"}


def test_statistics(url: str) -> None:
    lines = run("statistics", url).stdout.splitlines()
    assert lines.pop(8).startswith("  seconds: ")
    assert lines == [
        *("unlock: 2", "  1 succeeded, 1 refused", "  success: 100.0% (20.7% to 100.0%)"),
        *("  seconds: 0, 95 % within 0", "  unconfirmed effects: 1"),
        *("dock: 1", "  1 failed", "  success: 0.0% (0.0% to 79.3%)", "  E4: 1"),
    ]
    found = run("statistics", url, "--by", "action", "--by", "argument", "-n", "1", "--json").stdout
    document = json.loads(found)
    assert (document["action"], document["argument"], document["count"]) == ("unlock", "front", 2)
    assert (document["success_rate"], document["codes"]) == (1.0, {})
    refused = run("statistics", url, "--by", "colour")
    assert (refused.exit_code, "expected one of action" in refused.stderr) == (2, True)


def test_what_is_no_outcome_or_never_was_is_refused(url: str) -> None:
    for words, code, said in (
        (("--outcome", "done"), 2, "expected one of running"),
        (("--action", "fly"), 1, "never had the action 'fly'"),
        (("--object", "side"), 1, "never had the object 'side'"),
    ):
        result = run("acts", url, *words)
        assert (result.exit_code, result.stdout) == (code, "")
        assert said in result.stderr
