"""`kant-sql consequences` and `kant-sql origins`."""

from __future__ import annotations

import pytest

import kant_sql
from tests.support.processes.commands import documents, run

DOMAIN = """
(define (domain doors) (:requirements :typing :derived-predicates) (:types door)
  (:predicates (open ?d - door) (seen ?d - door) (shut ?d - door))
  (:derived (shut ?d - door) (not (open ?d)))
  (:action look :parameters (?d - door) :precondition (open ?d) :effect (seen ?d)))
"""
PROBLEM = "(define (problem home) (:domain doors) (:objects front - door))"


@pytest.fixture
def url(file_url: str) -> str:
    with kant_sql.connect(file_url, knowledge_base="home", actor="executive") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        with kb.transaction(actor="camera", reason="frame\n8"):
            kb.propositions.save_all(["(open front)"])
        for _ in range(2):
            kb.apply("(look front)", reason="the bell rang")
    return file_url


def test_what_a_fact_led_to(url: str) -> None:
    second, first = documents("consequences", url, "(open front)")
    text = run("consequences", url, "(open front)").stdout
    assert text == (
        f"execution {second['id']} (look front)\n"
        "  revision 5: executive, the bell rang\n"
        "  used: (open front)\n"
        f"execution {first['id']} (look front)\n"
        "  revision 4: executive, the bell rang\n"
        "  used: (open front)\n"
        "  made: (seen front)\n"
    )
    cut = run("consequences", url, "(open front)", "-n", "1").stdout.splitlines()
    assert cut[-1] == "there are more; see --limit"
    assert run("consequences", url, "(open front)", "-n", "9" * 30).stdout == text
    assert run("consequences", url, "(open front)", "--at", "3").stdout == ""
    [derived] = documents("consequences", url, "(not (open front))", "--at", "2")
    assert (derived["kind"], derived["made"]) == ("derived fact", ["(shut front)"])


def test_what_a_fact_goes_back_to(url: str) -> None:
    lines = run("origins", url, "(seen front)").stdout.splitlines()
    assert lines[0].startswith("execution ")
    assert lines[1:] == [
        "  revision 4: executive, the bell rang",
        "  used: (open front)",
        "  made: (seen front)",
        "  observation (open front)",
        r"    revision 3: camera, frame\n8",
        "    made: (open front)",
    ]
    assert run("origins", url, "(seen front)", "--depth", "1").stdout.splitlines() == lines[:4]
    depths = [(one["depth"], one["kind"]) for one in documents("origins", url, "(seen front)")]
    assert depths == [(1, "execution"), (2, "observation")]
    refused = run("origins", url, "(seen back)")
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "back" in refused.stderr
