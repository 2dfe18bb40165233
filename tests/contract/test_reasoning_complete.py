"""Names that may be meant by their beginning."""

from __future__ import annotations

import pytest

from kant_sql import InvalidArgumentError, KnowledgeBase
from tests.support.statements import recorded
from tests.support.worlds.robots import robot_at


def found(kb: KnowledgeBase, beginning: str, **options: int) -> list[tuple[str, str]]:
    return [(one.kind, one.name) for one in kb.pddl.complete(beginning, **options)]


def test_names_that_begin_so_come_before_those_that_contain_it(kb: KnowledgeBase) -> None:
    kb.load_domain("""
        (define (domain d) (:requirements :typing :fluents) (:types robot wp)
          (:constants Rob1 - robot at_rob - wp)
          (:predicates (robot_at ?r - robot ?w - wp) (near_robot ?r - robot))
          (:functions (rob_battery ?r - robot))
          (:action rob_move :parameters (?r - robot) :precondition () :effect ()))
    """)
    assert found(kb, "ROB") == [
        *(("predicate", "robot_at"), ("function", "rob_battery"), ("object", "Rob1")),
        *(("action", "rob_move"), ("type", "robot"), ("object", "at_rob")),
        ("predicate", "near_robot"),
    ]
    assert found(kb, "rob", limit=2) == [("predicate", "robot_at"), ("function", "rob_battery")]
    assert found(kb, "nothing") == []
    assert [one.text for one in kb.pddl.complete("robot_at")] == ["(robot_at ?r - robot ?w - wp)"]


def test_names_are_those_of_the_state(kb: KnowledgeBase) -> None:
    assert found(kb, "") == []
    kb.propositions.save(robot_at())
    assert ("object", "rb1") in found(kb, "rb")
    assert found(kb.at(0), "rb") == []
    with kb.transaction():
        kb.objects.delete_all()
        assert found(kb, "rb") == []


def test_what_is_no_beginning_is_refused(kb: KnowledgeBase) -> None:
    for wrong in (None, 3, b"rob"):
        with pytest.raises(InvalidArgumentError):
            kb.pddl.complete(wrong)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError):
        kb.pddl.complete("rob", limit=-1)


def test_one_statement_finds_names(kb: KnowledgeBase) -> None:
    kb.propositions.save(robot_at())
    kb.pddl.complete("rb")
    with recorded() as statements:
        kb.pddl.complete("ro")
    assert len(statements) == 1
