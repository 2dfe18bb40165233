"""What another process changes, and what a process that has cached the old state must do then.

Each function of the first part is run in another process; each of the second in this one, which has
read and written `world` before.
"""

from __future__ import annotations

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
from tests.support.atoms import Atoms
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
)

DOCK = PddlTypeDto("dock")
D1 = PddlObjectDto(DOCK, "d1")
ROBOT_AT_DOCK = PddlPredicateDto("robot_at", [ROBOT, DOCK])
WP1_AS_DOCK = PddlObjectDto(DOCK, "wp1")
AT_D1 = PddlPropositionDto(ROBOT_AT, [RB1, D1])


def world(kb: KnowledgeBase) -> None:
    """Fill the caches of a process: by writing, by reading, and by asking for what is not there."""
    kb.actions.save(navigation())
    kb.types.save(DOCK)
    kb.objects.save(D1)
    kb.propositions.save(robot_at())
    kb.propositions.save(robot_at(place=WP2))
    assert kb.propositions.delete(robot_at(place=WP2))
    assert not kb.goals.delete(robot_at(is_goal=True))
    for dao, name in ((kb.types, "charger"), (kb.objects, "rb2"), (kb.predicates, "free")):
        assert dao.get(name) is None


def define_more(kb: KnowledgeBase) -> None:
    charger = PddlTypeDto("charger", parent=WAYPOINT)
    kb.propositions.save(
        PddlPropositionDto(ROBOT_AT, [PddlObjectDto(ROBOT, "rb2"), PddlObjectDto(charger, "c1")])
    )
    kb.predicates.save(PddlPredicateDto("free", [charger]))


def sees_more(kb: KnowledgeBase) -> None:
    charger = kb.types.get("charger")
    assert charger is not None
    assert charger.parent == WAYPOINT
    assert [str(dto) for dto in kb.objects.get_all()][-1] == "c1 - charger"
    assert str(kb.predicates.get("free")) == "(free ?c0 - charger)"
    assert len(kb.propositions.get_by_predicate("robot_at")) == 2
    assert not kb.objects.insert(PddlObjectDto(charger, "rb2"))
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at(PddlObjectDto(WAYPOINT, "rb2")))


def put_docks_below_waypoints(kb: KnowledgeBase) -> None:
    kb.types.save(PddlTypeDto("dock", parent=WAYPOINT), cascade=True)


def lets_a_dock_be_a_waypoint(kb: KnowledgeBase) -> None:
    assert kb.propositions.insert(AT_D1)
    assert str(kb.types.get("dock")) == "dock - wp"


def redefine_an_object(kb: KnowledgeBase) -> None:
    kb.objects.save(WP1_AS_DOCK, cascade=True)


def refuses_the_old_object(kb: KnowledgeBase) -> None:
    assert str(kb.objects.get("wp1")) == "wp1 - dock"
    assert kb.propositions.get_all() == []
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at())
    with pytest.raises(TypeMismatchError):
        kb.propositions.save(robot_at(place=WP1_AS_DOCK))


def redefine_a_predicate(kb: KnowledgeBase) -> None:
    kb.predicates.save(ROBOT_AT_DOCK, cascade=True)


def refuses_the_old_predicate(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_by_predicate("robot_at") == []
    assert kb.actions.get("navigation") is None
    with pytest.raises(ConflictError):
        kb.propositions.save(robot_at())
    assert kb.propositions.save(PddlPropositionDto(ROBOT_AT_DOCK, [RB1, D1]))


def redefine_an_action(kb: KnowledgeBase) -> None:
    action = navigation()
    action.duration = 25
    kb.actions.save(action)


def sees_the_new_action(kb: KnowledgeBase) -> None:
    action = kb.actions.get("navigation")
    assert action is not None
    assert action.duration == 25
    assert kb.actions.save(navigation())
    assert kb.log(limit=1).__next__().changes[0].sign == "+"


def delete_a_type(kb: KnowledgeBase) -> None:
    kb.types.delete(WAYPOINT)


def finds_nothing_of_the_type(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_all() == kb.actions.get_all() == kb.predicates.get_all() == []
    assert kb.objects.get_all() == [D1, RB1]
    assert not kb.types.delete(WAYPOINT)
    assert not kb.propositions.delete(robot_at())
    assert kb.propositions.insert(robot_at())


def delete_and_make_again(kb: KnowledgeBase) -> None:
    kb.objects.delete(WP1)
    kb.objects.save(WP1_AS_DOCK)
    kb.predicates.delete(ROBOT_AT)
    kb.predicates.save(PddlPredicateDto("robot_at", [ROBOT]))


def goes_by_the_new_ones(kb: KnowledgeBase) -> None:
    assert kb.propositions.get_all() == []
    for dto in (robot_at(), robot_at(place=WP1_AS_DOCK)):
        with pytest.raises((ConflictError, InvalidKnowledgeError)):
            kb.propositions.save(dto)
    assert kb.propositions.insert(PddlPropositionDto(PddlPredicateDto("robot_at", [ROBOT]), [RB1]))


def delete_a_fact(kb: KnowledgeBase) -> None:
    kb.propositions.delete(robot_at())


def can_save_the_fact_again(kb: KnowledgeBase) -> None:
    assert not kb.propositions.delete(robot_at())
    assert kb.propositions.insert(robot_at())
    assert not kb.propositions.insert(robot_at())


def save_facts(kb: KnowledgeBase) -> None:
    Atoms(kb).save_all([robot_at(place=WP2), robot_at(is_goal=True)])


def knows_that_the_facts_hold(kb: KnowledgeBase) -> None:
    assert not kb.propositions.insert(robot_at(place=WP2))
    assert kb.goals.delete(robot_at(is_goal=True))
    assert kb.propositions.delete(robot_at(place=WP2))
    assert kb.propositions.get_all() == [robot_at()]


CHANGES: list[tuple[Any, Any]] = [
    (define_more, sees_more),
    (put_docks_below_waypoints, lets_a_dock_be_a_waypoint),
    (redefine_an_object, refuses_the_old_object),
    (redefine_a_predicate, refuses_the_old_predicate),
    (redefine_an_action, sees_the_new_action),
    (delete_a_type, finds_nothing_of_the_type),
    (delete_and_make_again, goes_by_the_new_ones),
    (delete_a_fact, can_save_the_fact_again),
    (save_facts, knows_that_the_facts_hold),
]
