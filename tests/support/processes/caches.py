"""Changes by another process, and how a process with the old state in its caches must react.

Each function runs in this process, which has read and written `world` before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from kant_sql import (
    ConflictError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import TypeMismatchError
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, navigation, robot_at

DOCK = PddlTypeDto("dock")
D1 = PddlObjectDto(DOCK, "d1")
ROBOT_AT_DOCK = PddlPredicateDto("robot_at", [ROBOT, DOCK])
WP1_AS_DOCK = PddlObjectDto(DOCK, "wp1")


def world(kb: KnowledgeBase) -> None:
    """Fill the caches of a process: by writing, by reading, and by asking for missing elements."""
    kb.actions.save(navigation())
    kb.types.save(DOCK)
    kb.objects.save(D1)
    kb.propositions.save(robot_at())
    kb.objects.save("wp2 - wp")
    kb.propositions.save("(robot_at rb1 wp2)")
    assert kb.propositions.delete("(robot_at rb1 wp2)")
    assert not kb.goals.delete(robot_at(is_goal=True))
    for dao, name in ((kb.types, "charger"), (kb.objects, "rb2"), (kb.predicates, "free")):
        assert dao.get(name) is None


def sees_more(kb: KnowledgeBase) -> None:
    charger = kb.types.get("charger")
    assert charger is not None
    assert charger.parent == WAYPOINT
    assert [str(dto) for dto in kb.objects.get_all()][-1] == "c1 - charger"
    assert str(kb.predicates.get("free")) == "(free ?c - charger)"
    assert len(kb.propositions.get_by_predicate("robot_at")) == 2
    assert not kb.objects.insert(PddlObjectDto(charger, "rb2"))
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at(PddlObjectDto(WAYPOINT, "rb2")))


def lets_a_dock_be_a_waypoint(kb: KnowledgeBase) -> None:
    assert kb.propositions.insert("(robot_at rb1 d1)")
    assert str(kb.types.get("dock")) == "dock - wp"


def refuses_the_old_object(kb: KnowledgeBase) -> None:
    assert str(kb.objects.get("wp1")) == "wp1 - dock"
    assert kb.propositions.get_all() == []
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at())
    with pytest.raises(TypeMismatchError):
        kb.propositions.save(robot_at(place=WP1_AS_DOCK))


def refuses_the_old_predicate(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_by_predicate("robot_at") == []
    assert kb.actions.get("navigation") is None
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at())
    assert kb.propositions.save(PddlPropositionDto(ROBOT_AT_DOCK, [RB1, D1]))


def sees_the_new_action(kb: KnowledgeBase) -> None:
    action = kb.actions.get("navigation")
    assert action is not None
    assert action.duration == 25
    assert kb.actions.save(navigation())
    assert kb.log(limit=1).__next__().changes[0].sign == "+"


def finds_nothing_of_the_type(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_all() == kb.actions.get_all() == kb.predicates.get_all() == []
    assert kb.objects.get_all() == [D1, RB1]
    assert not kb.types.delete(WAYPOINT)
    assert not kb.propositions.delete(robot_at())
    assert kb.propositions.insert(robot_at())


def goes_by_the_new_ones(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_all() == []
    for dto in (robot_at(), robot_at(place=WP1_AS_DOCK)):
        with pytest.raises((ConflictError, InvalidKnowledgeError)):
            kb.propositions.save(dto)
    assert kb.propositions.insert(PddlPropositionDto(PddlPredicateDto("robot_at", [ROBOT]), [RB1]))


def can_save_the_fact_again(kb: KnowledgeBase) -> None:
    assert not kb.propositions.delete(robot_at())
    assert kb.propositions.insert(robot_at())
    assert not kb.propositions.insert(robot_at())


def knows_that_the_facts_hold(kb: KnowledgeBase) -> None:
    assert not kb.propositions.insert("(robot_at rb1 wp2)")
    assert kb.goals.delete(robot_at(is_goal=True))
    assert kb.propositions.delete("(robot_at rb1 wp2)")
    assert kb.propositions.get_all() == [robot_at()]


# A DAO, its method, the arguments, and `cascade`.
Call = tuple[Any, ...]
LONGER = navigation()
LONGER.duration = 25


def make(calls: Iterable[Call], kb: KnowledgeBase) -> None:
    """Make the calls of `CHANGES` in another process."""
    for dao, method, dto, *cascade in calls:
        getattr(getattr(kb, dao), method)(dto, **({"cascade": True} if cascade else {}))


CHANGES: list[tuple[list[Call], Callable[[KnowledgeBase], None]]] = [
    (
        [
            ("types", "save", "charger - wp"),
            ("objects", "save_all", ["rb2 - robot", "c1 - charger"]),
            ("propositions", "save", "(robot_at rb2 c1)"),
            ("predicates", "save", "(free ?c - charger)"),
        ],
        sees_more,
    ),
    ([("types", "save", "dock - wp", "cascade")], lets_a_dock_be_a_waypoint),
    ([("objects", "save", "wp1 - dock", "cascade")], refuses_the_old_object),
    ([("predicates", "save", ROBOT_AT_DOCK, "cascade")], refuses_the_old_predicate),
    ([("actions", "save", LONGER)], sees_the_new_action),
    ([("types", "delete", WAYPOINT)], finds_nothing_of_the_type),
    (
        [
            ("objects", "delete", "wp1"),
            ("objects", "save", "wp1 - dock"),
            ("predicates", "delete", "robot_at"),
            ("predicates", "save", PddlPredicateDto("robot_at", [ROBOT])),
        ],
        goes_by_the_new_ones,
    ),
    ([("propositions", "delete", "(robot_at rb1 wp1)")], can_save_the_fact_again),
    (
        [("propositions", "save", "(robot_at rb1 wp2)"), ("goals", "save", "(robot_at rb1 wp1)")],
        knows_that_the_facts_hold,
    ),
]
