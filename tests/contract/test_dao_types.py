"""Types and their hierarchy, on every backend."""

from __future__ import annotations

import pytest

from kant_sql import (
    DependantsError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.reading import last_changes, nothing_changes, refuses, state, versions
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


def traffic(kb: KnowledgeBase) -> None:
    """A hierarchy with a fact, a goal and an action that depend on its parts."""
    kb.types.save(TAXI)
    taxi = PddlObjectDto(Type("taxi"), "t1")
    drives = PddlPredicateDto("drives", [Type("vehicle")])
    kb.propositions.save(PddlPropositionDto(drives, [taxi]))
    kb.goals.save(PddlPropositionDto(drives, [taxi], is_goal=True))
    c = PddlObjectDto(Type("car"), "c")
    effect = PddlConditionEffectDto(drives, [c], PddlConditionEffectDto.AT_END)
    kb.actions.save(PddlActionDto("start", [c], [], [effect]))


def test_redefining_a_type_with_dependants_is_refused_with_the_list(
    fresh_kb: KnowledgeBase,
) -> None:
    traffic(fresh_kb)
    for call in (
        lambda: fresh_kb.types.save(Type("car")),
        lambda: fresh_kb.types.update(Type("car", parent=Type("toy"))),
        lambda: fresh_kb.types.save_all([Type("car")]),
    ):
        caught = refuses(fresh_kb, DependantsError, call)
        assert isinstance(caught.value, DependantsError)
        assert caught.value.dependants == (
            "action start",
            "fact (drives t1)",
            "goal (drives t1)",
        )
        assert "type car - vehicle cannot become 'car" in str(caught.value)
        assert "action start, fact (drives t1), goal (drives t1) depend on it" in str(caught.value)
        assert "cascade=True" in str(caught.value)


@pytest.mark.parametrize("method", ["save", "update"])
def test_redefining_a_type_with_cascade_retracts_its_dependants_in_the_same_revision(
    fresh_kb: KnowledgeBase, method: str
) -> None:
    traffic(fresh_kb)
    fresh_kb.propositions.save(robot_at())
    before = fresh_kb.revision
    assert getattr(fresh_kb.types, method)(Type("car"), cascade=True) is True
    assert fresh_kb.revision == before + 1
    after = state(fresh_kb)
    assert after["types"][:3] == ["vehicle", "car", "taxi - car"]
    assert after["objects"][0] == "t1 - taxi"
    assert after["facts"] == ["(robot_at rb1 wp1)"]
    assert after["goals"] == after["actions"] == []
    changes = last_changes(fresh_kb)
    assert changes[0] == "+ type car"
    assert [line.splitlines()[0] for line in changes[1:]] == [
        "- action (:durative-action start",
        "- fact (drives t1)",
        "- goal (drives t1)",
        "- type car - vehicle",
    ]


def test_a_type_on_which_only_definitions_depend_can_be_redefined(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.types.save(CAR)
    fresh_kb.objects.save(PddlObjectDto(CAR, "c1"))
    fresh_kb.predicates.save(PddlPredicateDto("free", [CAR]))
    assert fresh_kb.types.save(Type("car")) is True
    assert state(fresh_kb)["types"] == ["vehicle", "car"]


def test_deleting_a_type_deletes_all_that_depends_on_it_in_one_revision(
    fresh_kb: KnowledgeBase,
) -> None:
    traffic(fresh_kb)
    fresh_kb.propositions.save(robot_at())
    before = fresh_kb.revision
    assert fresh_kb.types.delete(Type("CAR")) is True
    assert fresh_kb.revision == before + 1
    assert state(fresh_kb) == {
        "types": ["vehicle", "robot", "wp"],
        "objects": ["rb1 - robot", "wp1 - wp"],
        "predicates": ["(drives ?v0 - vehicle)", "(robot_at ?r0 - robot ?w1 - wp)"],
        "actions": [],
        "facts": ["(robot_at rb1 wp1)"],
        "goals": [],
    }
    assert [line.splitlines()[0] for line in last_changes(fresh_kb)] == [
        "- action (:durative-action start",
        "- fact (drives t1)",
        "- goal (drives t1)",
        "- object t1 - taxi",
        "- type car - vehicle",
        "- type taxi - car",
    ]


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


def test_deleting_all_types_leaves_nothing_but_what_needs_no_type(
    fresh_kb: KnowledgeBase,
) -> None:
    traffic(fresh_kb)
    fresh_kb.propositions.save(PddlPropositionDto(PddlPredicateDto("raining")))
    before = fresh_kb.revision
    assert fresh_kb.types.delete_all() == 3
    assert fresh_kb.revision == before + 1
    assert state(fresh_kb) == {
        "types": [],
        "objects": [],
        "predicates": ["(raining)"],
        "actions": [],
        "facts": ["(raining)"],
        "goals": [],
    }
    with nothing_changes(fresh_kb):
        assert fresh_kb.types.delete_all() == 0


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
