"""Types and their hierarchy, on every backend."""

from __future__ import annotations

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
from kant_sql.errors import TypeCycleError
from tests.support.reading import last_changes, nothing_changes, refuses, state, versions
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, navigation, robot_at

Type = PddlTypeDto
VEHICLE = Type("vehicle")
CAR = Type("car", parent=VEHICLE)
TAXI = Type("taxi", parent=CAR)


def test_a_parent_that_is_missing_is_saved_along(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(TAXI)
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle", "taxi - car"]
    assert fresh_kb.revision == 1
    found = fresh_kb.types.get("taxi")
    assert found is not None
    assert found.parent == CAR
    assert found.parent.parent == VEHICLE
    assert found.parent.parent.parent is None


def test_saving_a_type_without_a_parent_puts_it_under_the_root(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(CAR)
    fresh_kb.types.save(Type("car"))
    assert state(fresh_kb)["types"] == ["vehicle", "car"]
    assert last_changes(fresh_kb) == ["+ type car", "- type car - vehicle"]
    assert versions(fresh_kb, "type") == [
        ("car - vehicle", 1, 2),
        ("vehicle", 1, None),
        ("car", 2, None),
    ]


def test_a_type_on_which_only_definitions_depend_can_be_redefined(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.types.save(CAR)
    fresh_kb.objects.save(PddlObjectDto(CAR, "c1"))
    fresh_kb.predicates.save(PddlPredicateDto("free", [CAR]))
    assert fresh_kb.types.save(Type("car")) is True
    assert state(fresh_kb)["types"] == ["vehicle", "car"]


def test_deleting_the_type_of_a_parameter_deletes_predicates_and_actions(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.actions.save(navigation())
    fresh_kb.types.delete(WAYPOINT)
    assert state(fresh_kb) == {
        "types": ["robot"],
        "objects": ["rb1 - robot"],
        "predicates": [],
        "actions": [],
        "facts": [],
        "goals": [],
    }


def test_save_all_counts_what_changed(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(VEHICLE)
    assert fresh_kb.types.save_all(iter([CAR, CAR, VEHICLE, TAXI])) == 2
    assert fresh_kb.revision == 2
    with nothing_changes(fresh_kb):
        assert fresh_kb.types.save_all([TAXI, CAR]) == 0
        assert fresh_kb.types.save_all([]) == 0


def test_elements_are_read_in_the_order_in_which_they_were_first_known(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.types.save_all([Type("b"), Type("c"), Type("a")])
    fresh_kb.types.delete(Type("b"))
    assert state(fresh_kb)["types"] == ["c", "a"]
    fresh_kb.types.save(Type("b"))
    assert state(fresh_kb)["types"] == ["b", "c", "a"]


def test_results_share_nothing_with_what_was_saved_or_read_before(
    fresh_kb: KnowledgeBase,
) -> None:
    given = Type("car", parent=Type("vehicle"))
    fresh_kb.types.save(given)
    given.name = "changed"
    found = fresh_kb.types.get("car")
    assert found is not None
    found.parent = None
    found.name = "changed"
    assert str(fresh_kb.types.get("car")) == "car - vehicle"


# The hierarchy: parents that must agree, no cycles, and one root.


def test_a_parent_that_is_stored_with_another_parent_is_refused(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(CAR)
    ship = Type("ship")
    other_car = Type("car", parent=ship)
    caught = refuses(
        fresh_kb, ConflictError, lambda: fresh_kb.types.save(Type("taxi", parent=other_car))
    )
    assert "'car - vehicle'" in str(caught.value)
    assert "'car - ship'" in str(caught.value)


def test_a_grandparent_that_disagrees_is_refused_too(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(TAXI)
    wrong = Type("taxi", parent=Type("car", parent=Type("vehicle", parent=Type("toy"))))
    for call in (
        lambda: fresh_kb.objects.save(PddlObjectDto(wrong, "t1")),
        lambda: fresh_kb.predicates.save(PddlPredicateDto("free", [wrong])),
        lambda: fresh_kb.types.save(Type("uber", parent=wrong)),
        lambda: fresh_kb.types.save(wrong),
    ):
        caught = refuses(fresh_kb, ConflictError, call)
        assert "'vehicle'" in str(caught.value)
        assert "'vehicle - toy'" in str(caught.value)


def test_a_reference_that_does_not_say_the_parent_agrees_with_any(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.types.save(TAXI)
    fresh_kb.objects.save(PddlObjectDto(Type("taxi"), "t1"))
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle", "taxi - car"]


def test_naming_the_root_as_parent_agrees_with_no_parent(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(ROBOT)
    rooted = Type("robot", parent=Type("object"))
    fresh_kb.objects.save(PddlObjectDto(rooted, "rb1"))
    assert state(fresh_kb)["types"] == ["robot"]


@pytest.mark.parametrize(
    "loop",
    [
        Type("vehicle", parent=Type("vehicle")),
        Type("vehicle", parent=Type("VEHICLE")),
        Type("vehicle", parent=TAXI),
        Type("vehicle", parent=Type("taxi")),
        Type("vehicle", parent=Type("new", parent=Type("taxi"))),
        Type("a", parent=Type("b", parent=Type("c", parent=Type("A")))),
    ],
    ids=["itself", "itself in capitals", "its grandchild", "by name", "by a new one", "all new"],
)
def test_a_type_cannot_be_its_own_ancestor(fresh_kb: KnowledgeBase, loop: PddlTypeDto) -> None:
    fresh_kb.types.save(TAXI)
    for call in (
        lambda: fresh_kb.types.save(loop),
        lambda: fresh_kb.types.save(loop, cascade=True),
        lambda: fresh_kb.types.save_all([ROBOT, loop]),
    ):
        caught = refuses(fresh_kb, TypeCycleError, call)
        assert "would be its own ancestor" in str(caught.value)


def test_a_dto_that_contains_itself_is_refused(fresh_kb: KnowledgeBase) -> None:
    snake = Type("snake")
    snake.parent = snake
    refuses(fresh_kb, TypeCycleError, lambda: fresh_kb.types.save(snake))
    refuses(fresh_kb, TypeCycleError, lambda: fresh_kb.objects.save(PddlObjectDto(snake, "s1")))


def test_the_root_has_no_parent(fresh_kb: KnowledgeBase) -> None:
    caught = refuses(
        fresh_kb,
        InvalidKnowledgeError,
        lambda: fresh_kb.types.save(Type("Object", parent=VEHICLE)),
    )
    assert "is the root of all types and has no parent, not 'vehicle'" in str(caught.value)
    assert fresh_kb.types.save(Type("object")) is True
    assert fresh_kb.types.save(Type("thing", parent=Type("object"))) is True


def test_the_predicate_and_the_objects_of_the_root_type_take_anything(
    fresh_kb: KnowledgeBase,
) -> None:
    thing = PddlPredicateDto("seen", [Type("object")])
    taxi = PddlObjectDto(TAXI, "t1")
    assert fresh_kb.propositions.save(PddlPropositionDto(thing, [taxi])) is True
    assert fresh_kb.propositions.save(PddlPropositionDto(thing, [RB1])) is True
    assert state(fresh_kb)["facts"] == ["(seen t1)", "(seen rb1)"]
    assert ROBOT_AT not in fresh_kb.predicates.get_all()


def test_types_far_below_the_root_are_not_taken_for_each_other(fresh_kb: KnowledgeBase) -> None:
    above = VEHICLE
    for number in range(12):
        above = Type(f"level{number}", parent=above)
    left, right = (Type(name, parent=above) for name in ("left", "right"))
    fresh_kb.objects.save_all([PddlObjectDto(left, "a"), PddlObjectDto(right, "b")])
    assert state(fresh_kb)["objects"] == ["a - left", "b - right"]
