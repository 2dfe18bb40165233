"""Objects and their types, on every backend."""

from __future__ import annotations

from kant_sql import ConflictError, DependantsError, KnowledgeBase, PddlObjectDto, PddlTypeDto
from tests.support.reading import facts, last_changes, refuses, state, versions
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, WP1, WP2, robot_at

TIAGO = PddlTypeDto("tiago", parent=ROBOT)


def test_the_type_of_an_object_is_saved_along_with_its_parents(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save(PddlObjectDto(TIAGO, "rb1"))
    assert state(fresh_kb)["types"] == ["robot", "tiago - robot"]
    assert fresh_kb.revision == 1
    found = fresh_kb.objects.get("rb1")
    assert found is not None
    assert found.type.parent == ROBOT


def test_an_object_without_dependants_can_change_its_type(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save(RB1)
    fresh_kb.objects.save(PddlObjectDto(WAYPOINT, "rb1"))
    assert last_changes(fresh_kb) == [
        "+ object rb1 - wp",
        "+ type wp",
        "- object rb1 - robot",
    ]
    assert versions(fresh_kb, "object") == [("rb1 - robot", 1, 2), ("rb1 - wp", 2, None)]


def test_what_refers_to_an_object_with_another_type_is_refused_naming_both(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.types.save(TIAGO)
    other = PddlObjectDto(TIAGO, "rb1")
    caught = refuses(
        fresh_kb, ConflictError, lambda: fresh_kb.propositions.save(robot_at(other, WP2))
    )
    assert "object 'rb1' is stored as 'rb1 - robot'" in str(caught.value)
    assert "refers to it as 'rb1 - tiago'" in str(caught.value)


def test_what_refers_to_a_type_with_another_parent_is_refused_naming_both(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.objects.save(RB1)
    rolling = PddlTypeDto("robot", parent=PddlTypeDto("machine"))
    for call in (
        lambda: fresh_kb.objects.save(PddlObjectDto(rolling, "rb2")),
        lambda: fresh_kb.objects.save(PddlObjectDto(rolling, "rb1")),
        lambda: fresh_kb.propositions.save(robot_at(PddlObjectDto(rolling, "rb1"))),
    ):
        caught = refuses(fresh_kb, ConflictError, call)
        assert "type 'robot' is stored as 'robot'" in str(caught.value)
        assert "'robot - machine'" in str(caught.value)


def test_the_message_shows_some_dependants_and_the_error_has_all(
    fresh_kb: KnowledgeBase,
) -> None:
    robots = [PddlObjectDto(ROBOT, f"r{number:02}") for number in range(12)]
    fresh_kb.propositions.save_all([robot_at(robot) for robot in robots])
    caught = refuses(
        fresh_kb, DependantsError, lambda: fresh_kb.objects.save(PddlObjectDto(ROBOT, "wp1"))
    )
    assert isinstance(caught.value, DependantsError)
    assert len(caught.value.dependants) == 12
    assert "(robot_at r09 wp1) and 2 more depend on it" in str(caught.value)


def test_a_deleted_object_does_not_bring_its_old_facts_back(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.objects.delete(WP1)
    fresh_kb.objects.save(WP1)
    assert facts(fresh_kb) == []
    assert fresh_kb.propositions.save(robot_at()) is True
    assert facts(fresh_kb) == ["(robot_at rb1 wp1)"]
    assert versions(fresh_kb, "object") == [
        ("rb1 - robot", 1, None),
        ("wp1 - wp", 1, 2),
        ("wp1 - wp", 3, None),
    ]


def test_save_all_counts_what_changed_and_the_last_definition_stands(
    fresh_kb: KnowledgeBase,
) -> None:
    assert fresh_kb.objects.save_all(iter([RB1, WP1, RB1, PddlObjectDto(ROBOT, "wp1")])) == 3
    assert fresh_kb.revision == 1
    assert state(fresh_kb)["objects"] == ["rb1 - robot", "wp1 - robot"]
    assert [row[0] for row in versions(fresh_kb, "object")] == ["rb1 - robot", "wp1 - robot"]
