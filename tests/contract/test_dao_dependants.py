"""What depends on a type, an object or a predicate: named where that changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from kant_sql import DependantsError, KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlTypeDto
from tests.support.parts import dao_of
from tests.support.reading import refuses
from tests.support.worlds.robots import ROBOT, WAYPOINT

ACTION = "(:durative-action {} :parameters ({}) :duration (= ?duration 10) :effect (at end {}))"
FACTS = ["(drives t1)", "(robot_at rb1 wp1)", "(robot_at rb1 wp2)", "(raining)"]


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Facts, goals and actions that depend on definitions, and some that do not; at revision 1."""
    with fresh_kb.transaction():
        fresh_kb.types.save(["vehicle", "car - vehicle", "taxi - car", "robot", "wp"])
        fresh_kb.objects.save(["t1 - taxi", "rb1 - robot", "wp1 - wp", "wp2 - wp"])
        fresh_kb.predicates.save(["(drives ?v0 - vehicle)", "(robot_at ?r0 - robot ?w1 - wp)"])
        fresh_kb.predicates.save("(raining)")
        fresh_kb.propositions.save(FACTS)
        fresh_kb.goals.save(FACTS[:2])
        fresh_kb.actions.save(ACTION.format("start", "?c - car", "(drives ?c)"))
        fresh_kb.actions.save(ACTION.format("go_home", "?r - robot", "(robot_at ?r wp1)"))
    return fresh_kb


class Case(NamedTuple):
    """A definition, others of its name, what depends on it as the log has it, and a new one."""

    stored: str
    others: list[Any]
    dependants: list[str]
    new: str


CASES = {
    "types": Case(
        "car - vehicle",
        [PddlTypeDto("car"), PddlTypeDto("car", parent=PddlTypeDto("toy"))],
        ["action start", "fact (drives t1)", "goal (drives t1)"],
        "ship",
    ),
    "objects": Case(
        "wp1 - wp",
        [PddlObjectDto(ROBOT, "wp1")],
        ["action go_home", "fact (robot_at rb1 wp1)", "goal (robot_at rb1 wp1)"],
        "wp3 - wp",
    ),
    "predicates": Case(
        "(robot_at ?r0 - robot ?w1 - wp)",
        [PddlPredicateDto("robot_at", [WAYPOINT, ROBOT])],
        ["action go_home", *(f"fact {fact}" for fact in FACTS[1:3]), "goal (robot_at rb1 wp1)"],
        "(snowing)",
    ),
}


@pytest.mark.parametrize("kind", CASES)
def test_redefining_it_is_refused_with_the_list(kb: KnowledgeBase, kind: str) -> None:
    dao, case = dao_of(kb, kind), CASES[kind]
    for other in case.others:
        for call in (dao.save, dao.update, lambda dto: dao.save_all([case.new, dto])):
            caught = refuses(kb, DependantsError, call, other)
            assert [*caught.dependants] == case.dependants
            message, shown = str(caught), str(other)
            shown = shown if kind == "predicates" else repr(shown)
            assert f"{kind[:-1]} {case.stored} cannot become {shown}" in message
            assert f"{', '.join(case.dependants)} depend on it" in message
            assert "cascade=True" in message
