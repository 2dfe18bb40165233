"""What the views take apart: names of any kind, arguments, types, parameters."""

from __future__ import annotations

import pytest

from tests.support.pages import ask
from tests.support.stores import Connect

pytestmark = pytest.mark.every_backend

DOMAIN = """
(define (domain names)
  (:requirements :typing :object-fluents :numeric-fluents)
  (:types truck ship - object)
  (:constants depot - truck pier - (either truck ship))
  (:predicates (ready) (moves ?what - (either truck ship)))
  (:functions (speed ?of - (either truck ship)) (total) - number (leader) - truck))
"""
PROBLEM = """
(define (problem many) (:domain names)
  (:objects Otto% - truck both - (either truck ship) thing - object)
  (:init (ready) (moves Otto%) (moves BOTH) (= (speed both) 2.50) (= (total) 1e3)
    (= (leader) otto%)))
"""


@pytest.fixture
def named(scratch_url: str, connect: Connect) -> str:
    """The URL of a store with names of many kinds in the knowledge base `names`."""
    kb = connect(scratch_url, knowledge_base="names")
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM)
    return scratch_url


@pytest.mark.parametrize(
    ("query", "lines"),
    [
        (
            "predicate, arguments, text FROM audit_fact",
            ["moves | Otto% | (moves Otto%)", "moves | both | (moves both)", "ready |  | (ready)"],
        ),
        (
            "text, position, parameter, object FROM audit_fact_argument",
            ["(moves Otto%) | 0 | what | Otto%", "(moves both) | 0 | what | both"],
        ),
        (
            "function, arguments, fluent, value, number FROM audit_value",
            [
                "leader |  | (leader) | Otto% | NULL",
                "speed | both | (speed both) | 2.50 | 2.5",
                "total |  | (total) | 1000 | 1000.0",
            ],
        ),
        (
            "text, position, parameter, object FROM audit_value_argument",
            ["(= (speed both) 2.50) | 0 | of | both"],
        ),
        (
            "object, type, is_constant FROM audit_object",
            [
                *("Otto% | truck | 0", "both | (either truck ship) | 0", "thing | object | 0"),
                *("depot | truck | 1", "pier | (either truck ship) | 1"),
            ],
        ),
        ("object FROM audit_object WHERE is_constant AND", ["depot", "pier"]),
        (
            "kind, name FROM audit_definition WHERE kind <> 'object' AND",
            [
                *("document | domain", "document | problem"),
                *("function | leader", "function | speed", "function | total"),
                *("predicate | moves", "predicate | ready", "type | object", "type | ship"),
                "type | truck",
            ],
        ),
    ],
)
def test_a_row_is_taken_apart_rightly(named: str, query: str, lines: list[str]) -> None:
    where = query if query.endswith("AND") else f"{query} WHERE"
    assert sorted(ask(named, f"SELECT {where} knowledge_base = 'names'")) == sorted(lines)


def test_a_parameter_has_the_name_of_its_time(scratch_url: str, connect: Connect) -> None:
    kb = connect(scratch_url, knowledge_base="renamed")
    for number, name in enumerate(("one", "two")):
        kb.load_domain(f"(define (domain d) (:types cup) (:predicates (full ?{name} - cup)))")
        kb.objects.save(f"c{number} - cup")
        kb.propositions.save(f"(full c{number})")
    query = (
        "SELECT object, parameter, until FROM audit_fact_argument "
        "WHERE knowledge_base = 'renamed' ORDER BY since"
    )
    assert ask(scratch_url, query) == ["c0 | one | NULL", "c1 | two | NULL"]
