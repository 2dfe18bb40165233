"""`save_all`: one revision, whole or not at all, however many elements and however they come."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from kant_sql import (
    DependantsError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dao import base
from kant_sql.store import transaction as propositions
from tests.support import reading
from tests.support.parts import dao_of
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
    waypoint,
)

NEAR = PddlPredicateDto("near", [WAYPOINT, WAYPOINT])
COUNT = 12


@pytest.fixture
def tight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a few facts be too many to keep in memory."""
    monkeypatch.setattr(propositions, "SPILL_AT", 4)
    monkeypatch.setattr(base, "BATCH", 3)


def near(first: int, second: int = 0) -> PddlPropositionDto:
    return PddlPropositionDto(NEAR, [waypoint(first), waypoint(second)])


def many(count: int = COUNT) -> Iterator[PddlPropositionDto]:
    return (near(number) for number in range(count))


def test_a_large_number_of_facts_is_written_piece_by_piece(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(propositions, "SPILL_AT", 1_000)
    monkeypatch.setattr(base, "BATCH", 500)
    wps = [waypoint(number) for number in range(60)]
    pairs = [PddlPropositionDto(NEAR, [one, other]) for one in wps for other in wps]
    assert fresh_kb.propositions.save_all(iter(pairs)) == 3_600
    assert fresh_kb.revision == 1
    assert len(reading.last_changes(fresh_kb)) == 3_600 + 60 + 1 + 1
    assert fresh_kb.propositions.get_all() == pairs
    assert fresh_kb.at(0).propositions.get_all() == []
    assert fresh_kb.propositions.delete_all() == 3_600
    assert fresh_kb.revision == 2


@pytest.mark.usefixtures("tight")
def test_a_generator_may_read_and_write_the_same_knowledge_base(fresh_kb: KnowledgeBase) -> None:
    def facts_and_more() -> Iterator[PddlPropositionDto]:
        for number in range(COUNT):
            yield near(number)
            fresh_kb.propositions.save(robot_at(RB1, waypoint(number)))
            assert fresh_kb.propositions.insert(robot_at(RB1, waypoint(number))) is False

    assert fresh_kb.propositions.save_all(facts_and_more()) == COUNT
    assert fresh_kb.revision == 1
    assert len(reading.facts(fresh_kb)) == 2 * COUNT


# By DAO: a list to save, what the first of it is called by, and one that is not stored.
LISTS: dict[str, tuple[list[Any], Any, Any]] = {
    "types": ([PddlTypeDto("door"), PddlTypeDto("lift")], "DOOR", "never"),
    "objects": ([RB1, WP1], "RB1", PddlObjectDto(ROBOT, "rb9")),
    "predicates": ([NEAR, PddlPredicateDto("up", [])], "near", "never"),
    "functions": ([PddlFunctionDto("cost"), PddlFunctionDto("fuel")], "cost", "never"),
    "actions": ([navigation(), PddlActionDto("wait", [], [], [])], "navigation", "never"),
    "propositions": ([robot_at(), "(robot_at rb1 wp1)"], "(robot_at rb1 wp1)", robot_at(RB1, WP2)),
    "function_values": (
        [PddlFunctionValueDto(PddlFunctionDto("y"), [], 1), "(= (y) 2)"],
        "(y)",
        PddlFunctionValueDto(PddlFunctionDto("z"), [], 1),
    ),
    "goals": ([robot_at(), "(not (robot_at rb1 wp1))"], robot_at(), robot_at(RB1, WP2)),
    "constraints": (["(sometime (up))", "(always (up))"], "(sometime (up))", "(at-most-once (up))"),
}


@pytest.mark.parametrize("name", LISTS)
def test_a_list_is_saved_and_deleted_in_one_revision(fresh_kb: KnowledgeBase, name: str) -> None:
    fresh_kb.predicates.save(PddlPredicateDto("up", []))
    dao, (given, called, absent) = dao_of(fresh_kb, name), LISTS[name]
    fresh_kb.predicates.delete("up" if name == "predicates" else "never")
    before, count = fresh_kb.revision, len(dao.get_all())
    assert dao.save(given) is True
    assert fresh_kb.revision == before + 1
    saved = len(dao.get_all())
    assert saved > count
    assert dao.delete_all([]) == 0
    assert dao.delete_all([absent]) == 0
    assert fresh_kb.revision == before + 1
    assert dao.delete_all(iter([called, absent, called])) == 1
    assert fresh_kb.revision == before + 2
    assert len(dao.get_all()) == saved - 1
    assert dao.delete(called) is False
    assert dao.save((given[0],)) is True
    assert dao.delete(called) is True
    for call in (dao.delete, dao.insert):
        with pytest.raises(InvalidKnowledgeError, match=r"one element, not a list: .*delete_all"):
            call(given)


def test_a_list_redefines_with_cascade(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save([near(1), near(2)])
    wider = [PddlPredicateDto("near", [WAYPOINT]), PddlPredicateDto("far", [WAYPOINT])]
    reading.refuses(fresh_kb, DependantsError, lambda: fresh_kb.predicates.save(wider))
    assert fresh_kb.predicates.get("far") is None
    assert fresh_kb.predicates.save(wider, cascade=True)
    assert reading.facts(fresh_kb) == []
