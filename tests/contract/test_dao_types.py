"""Types and their hierarchy, on every backend."""

from __future__ import annotations

from kant_sql import (
    KnowledgeBase,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from tests.support.reading import last_changes, nothing_changes, state, versions
from tests.support.worlds.robots import WAYPOINT, navigation, robot_at

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
