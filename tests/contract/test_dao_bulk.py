"""`save_all`: one revision, whole or not at all, however many elements and however they come."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from kant_sql import (
    ConflictError,
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
from kant_sql.errors import TypeMismatchError
from kant_sql.store import transaction as propositions
from tests.support import reading
from tests.support.atoms import Atoms
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


def texts(*numbers: int) -> list[str]:
    return sorted(f"(near wp{number} wp0)" for number in numbers)


def fails_after(count: int) -> Iterator[PddlPropositionDto]:
    """Facts, and then an error of the caller's own."""
    yield from many(count)
    raise reading.Undone


def fact_versions(kb: KnowledgeBase) -> list[tuple[str, int, int | None]]:
    return sorted(reading.versions(kb, "proposition"))


def test_a_generator_is_saved_in_one_revision(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.propositions.save_all(many()) == COUNT
    assert fresh_kb.revision == 1
    assert reading.facts(fresh_kb) == texts(*range(COUNT))
    with reading.nothing_changes(fresh_kb):
        assert fresh_kb.propositions.save_all(many()) == 0
        assert fresh_kb.propositions.save_all(iter([])) == 0


def test_duplicates_count_once(fresh_kb: KnowledgeBase, tight: None) -> None:
    shouted = PddlPropositionDto(PddlPredicateDto("NEAR", NEAR.types), near(1).objects)
    given = [near(1), shouted, near(2), near(1), near(3), near(2), *many(6), near(0)]
    assert Atoms(fresh_kb).save_all(given) == 6
    assert reading.facts(fresh_kb) == texts(*range(6))
    assert len(reading.last_changes(fresh_kb)) == 6 + 6 + 1 + 1


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


@pytest.mark.parametrize("position", [0, 5, COUNT - 1])
@pytest.mark.usefixtures("tight")
def test_one_bad_fact_and_nothing_is_stored(fresh_kb: KnowledgeBase, position: int) -> None:
    fresh_kb.propositions.save_all([robot_at(), near(1)])
    for bad, error in (
        (PddlPropositionDto(NEAR, [RB1, WP1]), TypeMismatchError),
        (PddlPropositionDto(NEAR, [PddlObjectDto(ROBOT, "wp1"), WP2]), ConflictError),
        (None, InvalidKnowledgeError),
    ):
        given: list[PddlPropositionDto | None] = [*many()]
        given.insert(position, bad)
        reading.refuses(fresh_kb, error, fresh_kb.propositions.save_all, given)
        reading.refuses(fresh_kb, error, fresh_kb.propositions.save_all, iter(given))
    reading.refuses(fresh_kb, reading.Undone, fresh_kb.propositions.save_all, fails_after(position))
    assert fresh_kb.propositions.save_all(many()) == COUNT - 1
    assert reading.facts(fresh_kb) == sorted([*texts(*range(COUNT)), "(robot_at rb1 wp1)"])


@pytest.mark.usefixtures("tight")
def test_within_a_transaction_more_follows_after_a_spill(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save_all([robot_at(), near(1), near(2)])
    with fresh_kb.transaction():
        fresh_kb.propositions.delete(robot_at())
        fresh_kb.propositions.delete(near(1))
        assert fresh_kb.propositions.save_all(many()) == COUNT - 1
        assert fresh_kb.propositions.delete(near(3)) is True
        assert fresh_kb.propositions.delete(near(4)) is True
        assert fresh_kb.propositions.insert(near(4)) is True
        assert fresh_kb.propositions.insert(near(4)) is False
        assert fresh_kb.propositions.delete(near(2)) is True
        assert fresh_kb.propositions.insert(robot_at()) is True
        assert fresh_kb.propositions.save_all([near(3), near(5)]) == 1
        assert fresh_kb.propositions.delete(near(3)) is True
    left = [number for number in range(COUNT) if number not in (2, 3)]
    assert reading.facts(fresh_kb) == sorted([*texts(*left), "(robot_at rb1 wp1)"])
    new = [number for number in left if number != 1]
    objects = [f"+ object wp{number} - wp" for number in range(COUNT) if number not in (0, 1, 2)]
    assert reading.last_changes(fresh_kb) == [
        *(f"+ fact {text}" for text in texts(*new)),
        *sorted(objects),
        "- fact (near wp2 wp0)",
    ]
    assert fact_versions(fresh_kb) == sorted(
        [
            ("(robot_at rb1 wp1)", 1, None),
            ("(near wp1 wp0)", 1, None),
            ("(near wp2 wp0)", 1, 2),
            *((text, 2, None) for text in texts(*new)),
        ]
    )


@pytest.mark.usefixtures("tight")
def test_a_spill_that_is_taken_back_leaves_no_version_and_no_revision(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.propositions.save_all([near(1), near(2)])
    fresh_kb.objects.save_all(waypoint(number) for number in range(COUNT))
    before = fact_versions(fresh_kb)
    for _ in range(2):
        with reading.nothing_changes(fresh_kb), fresh_kb.transaction():
            assert fresh_kb.propositions.save_all(many()) == COUNT - 2
            assert fresh_kb.propositions.delete_all() == COUNT
            assert fresh_kb.propositions.save_all([near(1), near(2)]) == 2
        assert fact_versions(fresh_kb) == before
    assert fresh_kb.propositions.save_all(many()) == COUNT - 2
    assert fresh_kb.propositions.delete(near(1)) is True
    assert reading.facts(fresh_kb) == texts(0, *range(2, COUNT))


@pytest.mark.usefixtures("tight")
def test_a_nested_transaction_that_fails_after_a_spill_is_undone_alone(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.propositions.save_all([robot_at(), near(1), near(2)])
    with fresh_kb.transaction():
        fresh_kb.propositions.save(near(3))
        fresh_kb.propositions.delete(near(1))
        for _ in range(2):
            with reading.undone(fresh_kb):
                fresh_kb.propositions.save_all(many())
                fresh_kb.propositions.delete(near(2))
                with reading.undone(fresh_kb):
                    fresh_kb.propositions.delete_all()
                    fresh_kb.propositions.save_all(many(5))
                assert reading.facts(fresh_kb) == sorted(
                    [*texts(0, 1, *range(3, COUNT)), "(robot_at rb1 wp1)"]
                )
            assert reading.facts(fresh_kb) == sorted([*texts(2, 3), "(robot_at rb1 wp1)"])
        with pytest.raises(reading.Undone):
            fresh_kb.propositions.save_all(fails_after(10))
        assert fresh_kb.propositions.insert(near(3)) is False
        assert fresh_kb.propositions.insert(near(1)) is True
        assert fresh_kb.propositions.delete(near(2)) is True
    assert reading.last_changes(fresh_kb) == [
        "+ fact (near wp3 wp0)",
        "+ object wp3 - wp",
        "- fact (near wp2 wp0)",
    ]
    assert fact_versions(fresh_kb) == sorted(
        [
            ("(robot_at rb1 wp1)", 1, None),
            ("(near wp1 wp0)", 1, None),
            ("(near wp2 wp0)", 1, 2),
            ("(near wp3 wp0)", 2, None),
        ]
    )
    assert fresh_kb.propositions.insert(near(7)) is True


@pytest.mark.usefixtures("tight")
def test_a_transaction_that_fails_after_a_spill_has_not_happened(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save_all([near(1), near(2)])
    for _ in range(2):
        with reading.nothing_changes(fresh_kb), reading.undone(fresh_kb):
            fresh_kb.propositions.save_all(many())
            fresh_kb.propositions.delete(near(1))
    assert fresh_kb.propositions.insert(near(1)) is False
    assert fresh_kb.propositions.insert(near(3)) is True
    assert reading.facts(fresh_kb) == texts(1, 2, 3)


@pytest.mark.usefixtures("tight")
def test_definitions_may_change_before_and_after_a_spill(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    with fresh_kb.transaction():
        fresh_kb.types.save(PddlTypeDto("early"))
        fresh_kb.objects.delete(WP1)
        fresh_kb.propositions.save_all(many())
        assert fresh_kb.predicates.delete(NEAR) is True
        fresh_kb.predicates.save(PddlPredicateDto("near", [WAYPOINT]))
        fresh_kb.propositions.save_all(
            PddlPropositionDto(PddlPredicateDto("near", [WAYPOINT]), [waypoint(number)])
            for number in range(6)
        )
        fresh_kb.types.delete(PddlTypeDto("early"))
        fresh_kb.types.save(PddlTypeDto("late"))
    assert reading.facts(fresh_kb) == [f"(near wp{number})" for number in range(6)]
    assert reading.state(fresh_kb)["types"] == ["robot", "wp", "late"]
    assert reading.last_changes(fresh_kb) == [
        *(f"+ fact (near wp{number})" for number in range(6)),
        *sorted(f"+ object wp{number} - wp" for number in range(COUNT) if number != 1),
        "+ predicate (near ?w0 - wp)",
        "+ type late",
        "- fact (robot_at rb1 wp1)",
    ]
    assert reading.state(fresh_kb.at(1))["facts"] == ["(robot_at rb1 wp1)"]


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


@pytest.mark.usefixtures("tight")
def test_facts_of_many_predicates_and_goals_can_be_mixed(fresh_kb: KnowledgeBase) -> None:
    predicates = [PddlPredicateDto(f"p{number}", [WAYPOINT]) for number in range(5)]
    given = [
        PddlPropositionDto(predicate, [waypoint(number)], is_goal)
        for number in range(4)
        for predicate in predicates
        for is_goal in (False, True)
    ]
    assert Atoms(fresh_kb).save_all(given) == 40
    assert len(fresh_kb.goals.get_propositions()) == len(fresh_kb.propositions.get_all()) == 20
    assert Atoms(fresh_kb).save_all(reversed(given)) == 0
    assert fresh_kb.predicates.delete(predicates[0]) is True
    assert Atoms(fresh_kb).save_all(given) == 8
    assert Atoms(fresh_kb).get_all() == sorted(given, key=lambda dto: dto.is_goal)


@pytest.mark.usefixtures("tight")
def test_many_named_elements_are_saved_whole_or_not_at_all(fresh_kb: KnowledgeBase) -> None:
    def objects() -> Iterator[PddlObjectDto]:
        for number in range(10):
            yield waypoint(number)
        raise reading.Undone

    reading.refuses(fresh_kb, reading.Undone, fresh_kb.objects.save_all, objects())
    bad: list[PddlObjectDto | None] = [*map(waypoint, range(10)), None]
    reading.refuses(fresh_kb, InvalidKnowledgeError, fresh_kb.objects.save_all, bad)
    assert fresh_kb.objects.save_all(map(waypoint, range(10))) == 10
    assert fresh_kb.revision == 1
    assert len(reading.rows(fresh_kb, "SELECT * FROM object_version WHERE kb_id = :kb")) == 10


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
