"""A call that is refused stores nothing, wherever it is made, and the rest goes on without it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pytest

from kant_sql import (
    ConflictError,
    DependantsError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeCycleError, TypeMismatchError
from tests.support.atoms import Atoms
from tests.support.reading import Undone, last_changes, nothing_changes, refuses, state, versions
from tests.support.worlds.robots import RB1, ROBOT, WP1, WP2, navigation, robot_at, waypoint

Type, Literal = PddlTypeDto, PddlConditionEffectDto
# Each refused call below would first save this, which is missing.
NEW = Type("new", parent=Type("newer"))
NEW_OBJECT = PddlObjectDto(NEW, "brand_new")
CARRIES = PddlPredicateDto("carries", [ROBOT, NEW])


class Refused(NamedTuple):
    call: Callable[[KnowledgeBase], object]
    error: type[Exception]


def refused_generator(kb: KnowledgeBase) -> object:
    def facts() -> object:
        yield robot_at(RB1, waypoint(7))
        yield PddlPropositionDto(CARRIES, [RB1, NEW_OBJECT])
        raise Undone

    return kb.propositions.save_all(facts())  # type: ignore[arg-type]


REFUSED = {
    "cycle": Refused(
        lambda kb: kb.types.save(Type("robot", parent=Type("fresh", parent=Type("robot")))),
        TypeCycleError,
    ),
    "name": Refused(lambda kb: kb.objects.save(PddlObjectDto(NEW, "two words")), InvalidNameError),
    "type in use": Refused(lambda kb: kb.types.save(Type("wp", parent=NEW)), DependantsError),
    "object in use": Refused(
        lambda kb: kb.objects.save(PddlObjectDto(NEW, "wp2")), DependantsError
    ),
    "predicate in use": Refused(
        lambda kb: kb.predicates.save(PddlPredicateDto("robot_at", [NEW])), DependantsError
    ),
    "object refers": Refused(
        lambda kb: kb.objects.save(PddlObjectDto(Type("wp", parent=NEW), "wp9")), ConflictError
    ),
    "fact refers": Refused(
        lambda kb: kb.propositions.save(
            PddlPropositionDto(CARRIES, [PddlObjectDto(NEW, "rb1"), NEW_OBJECT])
        ),
        ConflictError,
    ),
    "arity": Refused(
        lambda kb: kb.propositions.save(PddlPropositionDto(CARRIES, [RB1])), ArityError
    ),
    "mismatch": Refused(
        lambda kb: kb.propositions.save(PddlPropositionDto(CARRIES, [NEW_OBJECT, NEW_OBJECT])),
        TypeMismatchError,
    ),
    "last of many": Refused(
        lambda kb: kb.propositions.save_all([robot_at(RB1, waypoint(5)), robot_at(WP1, RB1)]),
        TypeMismatchError,
    ),
    "no dto among many": Refused(
        lambda kb: kb.objects.save_all([waypoint(5), None, waypoint(6)]),  # type: ignore[list-item]
        InvalidKnowledgeError,
    ),
    "time": Refused(
        lambda kb: kb.actions.save(
            PddlActionDto("go", [NEW_OBJECT], [Literal(CARRIES, [RB1, NEW_OBJECT])])
        ),
        InvalidKnowledgeError,
    ),
    "unknown constant": Refused(
        lambda kb: kb.actions.save(
            PddlActionDto("go", [], [Literal(CARRIES, [RB1, NEW_OBJECT], Literal.AT_END)])
        ),
        InvalidKnowledgeError,
    ),
    "the caller's own error": Refused(refused_generator, Undone),
}
ALL = pytest.mark.parametrize("refused", REFUSED.values(), ids=REFUSED)


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with a fact, a goal and an action that use its definitions."""
    with fresh_kb.transaction():
        Atoms(fresh_kb).save_all([robot_at(), robot_at(RB1, WP2, is_goal=True)])
        fresh_kb.actions.save(navigation())
    return fresh_kb


@ALL
def test_a_refused_call_stores_nothing(kb: KnowledgeBase, refused: Refused) -> None:
    refuses(kb, refused.error, refused.call, kb)
    refuses(kb, refused.error, refused.call, kb)
    with nothing_changes(kb), kb.transaction(), pytest.raises(refused.error):
        refused.call(kb)
    assert len(kb.store.revisions()) == 1


@ALL
@pytest.mark.parametrize("reads", [False, True], ids=["unseen", "seen"])
def test_a_refused_call_in_a_transaction_leaves_the_rest_of_it(
    kb: KnowledgeBase, refused: Refused, reads: bool
) -> None:
    with kb.transaction():
        kb.propositions.delete(robot_at())
        kb.propositions.save(robot_at(RB1, waypoint(3)))
        if reads:
            # What is read was written before: now only the database can undo.
            before = state(kb)
            with pytest.raises(refused.error):
                refused.call(kb)
            assert state(kb) == before
        else:
            with pytest.raises(refused.error):
                refused.call(kb)
        kb.objects.save(waypoint(4))
    assert kb.revision == 2
    assert last_changes(kb) == [
        "+ fact (robot_at rb1 wp3)",
        "+ object wp3 - wp",
        "+ object wp4 - wp",
        "- fact (robot_at rb1 wp1)",
    ]
    assert state(kb)["facts"] == ["(robot_at rb1 wp3)"]
    assert state(kb)["types"] == ["robot", "wp"]
    assert [row for row in versions(kb, "object") if row[1] == 2] == [
        ("wp3 - wp", 2, None),
        ("wp4 - wp", 2, None),
    ]


@ALL
def test_what_a_refused_call_would_have_saved_can_be_saved_afterwards(
    kb: KnowledgeBase, refused: Refused
) -> None:
    with kb.transaction():
        with pytest.raises(refused.error):
            refused.call(kb)
        kb.propositions.save(PddlPropositionDto(CARRIES, [RB1, NEW_OBJECT]))
        kb.propositions.save(robot_at(RB1, waypoint(5)))
    assert kb.revision == 2
    assert "(carries rb1 brand_new)" in state(kb)["facts"]
    assert state(kb)["types"] == ["robot", "wp", "newer", "new - newer"]


@ALL
def test_a_refused_call_that_ends_a_nested_transaction_undoes_only_that(
    kb: KnowledgeBase, refused: Refused
) -> None:
    with kb.transaction():
        kb.objects.save(waypoint(3))
        with pytest.raises(refused.error), kb.transaction():
            forget_all_and(kb, refused.call)
        assert state(kb)["facts"] == ["(robot_at rb1 wp1)"]
        kb.objects.save(waypoint(4))
    assert last_changes(kb) == ["+ object wp3 - wp", "+ object wp4 - wp"]


def forget_all_and(kb: KnowledgeBase, call: Callable[[KnowledgeBase], object]) -> None:
    """Retract everything, see that it is gone, put the definitions back, and make a call."""
    kb.types.delete_all()
    assert kb.propositions.get_all() == []
    kb.objects.save_all([RB1, WP1])
    Atoms(kb).save_all([robot_at(), robot_at(RB1, WP2, is_goal=True)])
    kb.actions.save(navigation())
    call(kb)
