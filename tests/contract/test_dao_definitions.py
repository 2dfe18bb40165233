"""Types and their hierarchy, objects and predicates, and what refers to them; on every backend."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import (
    ConflictError,
    DependantsError,
    InvalidKnowledgeError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import ArityError, TypeCycleError
from tests.support.parts import dao_of
from tests.support.reading import (
    facts,
    last_changes,
    nothing_changes,
    present,
    refuses,
    state,
    versions,
)
from tests.support.worlds.robots import (
    DISTANCE,
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
)

Type, Object = PddlTypeDto, PddlObjectDto
Predicate, Fact = PddlPredicateDto, PddlPropositionDto
TIAGO = Type("tiago", parent=ROBOT)
VEHICLE = Type("vehicle")
CAR = Type("car", parent=VEHICLE)
TAXI = Type("taxi", parent=CAR)


def test_a_parent_that_is_missing_is_saved_along(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(TAXI)
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle", "taxi - car"]
    assert fresh_kb.revision == 1
    found = present(fresh_kb.types.get("taxi"))
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


def test_a_type_on_which_only_definitions_depend_can_be_redefined(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(CAR)
    fresh_kb.objects.save(Object(CAR, "c1"))
    fresh_kb.predicates.save(Predicate("free", [CAR]))
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


def test_elements_are_read_in_the_order_in_which_they_were_first_known(
    fresh_kb: KnowledgeBase,
) -> None:
    fresh_kb.types.save_all([Type("b"), Type("c"), Type("a")])
    fresh_kb.types.delete(Type("b"))
    assert state(fresh_kb)["types"] == ["c", "a"]
    fresh_kb.types.save(Type("b"))
    assert state(fresh_kb)["types"] == ["b", "c", "a"]


def test_results_share_nothing_with_what_was_saved_or_read_before(fresh_kb: KnowledgeBase) -> None:
    given = Type("car", parent=Type("vehicle"))
    fresh_kb.types.save(given)
    given.name = "changed"
    found = present(fresh_kb.types.get("car"))
    found.parent = None
    found.name = "changed"
    assert str(fresh_kb.types.get("car")) == "car - vehicle"


# The hierarchy: parents that must agree, no cycles, and one root.


def test_a_reference_that_does_not_say_the_parent_agrees_with_any(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(TAXI)
    fresh_kb.objects.save(Object(Type("taxi"), "t1"))
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle", "taxi - car"]


def test_naming_the_root_as_parent_agrees_with_no_parent(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(ROBOT)
    rooted = Type("robot", parent=Type("object"))
    fresh_kb.objects.save(Object(rooted, "rb1"))
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
    refuses(fresh_kb, TypeCycleError, lambda: fresh_kb.objects.save(Object(snake, "s1")))


def test_the_root_has_no_parent(fresh_kb: KnowledgeBase) -> None:
    caught = refuses(
        fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.types.save(Type("Object", parent=VEHICLE))
    )
    assert "is the root of all types and has no parent, not 'vehicle'" in str(caught.value)
    assert fresh_kb.types.save(Type("object")) is True
    assert fresh_kb.types.save(Type("thing", parent=Type("object"))) is True


def test_the_predicate_and_the_objects_of_the_root_type_take_anything(
    fresh_kb: KnowledgeBase,
) -> None:
    thing = Predicate("seen", [Type("object")])
    taxi = Object(TAXI, "t1")
    assert fresh_kb.propositions.save(Fact(thing, [taxi])) is True
    assert fresh_kb.propositions.save(Fact(thing, [RB1])) is True
    assert state(fresh_kb)["facts"] == ["(seen t1)", "(seen rb1)"]
    assert ROBOT_AT not in fresh_kb.predicates.get_all()


def test_types_far_below_the_root_are_not_taken_for_each_other(fresh_kb: KnowledgeBase) -> None:
    above = VEHICLE
    for number in range(12):
        above = Type(f"level{number}", parent=above)
    left, right = (Type(name, parent=above) for name in ("left", "right"))
    fresh_kb.objects.save_all([Object(left, "a"), Object(right, "b")])
    assert state(fresh_kb)["objects"] == ["a - left", "b - right"]


def test_the_type_of_an_object_is_saved_along_with_its_parents(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save(Object(TIAGO, "rb1"))
    assert state(fresh_kb)["types"] == ["robot", "tiago - robot"]
    assert fresh_kb.revision == 1
    assert present(fresh_kb.objects.get("rb1")).type.parent == ROBOT


def test_an_object_without_dependants_can_change_its_type(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.objects.save(RB1)
    fresh_kb.objects.save(Object(WAYPOINT, "rb1"))
    assert last_changes(fresh_kb) == ["+ object rb1 - wp", "+ type wp", "- object rb1 - robot"]
    assert versions(fresh_kb, "object") == [("rb1 - robot", 1, 2), ("rb1 - wp", 2, None)]


def test_the_message_shows_some_dependants_and_the_error_has_all(fresh_kb: KnowledgeBase) -> None:
    robots = [Object(ROBOT, f"r{number:02}") for number in range(12)]
    fresh_kb.propositions.save_all([robot_at(robot) for robot in robots])
    caught = refuses(fresh_kb, DependantsError, lambda: fresh_kb.objects.save(Object(ROBOT, "wp1")))
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


@pytest.mark.parametrize(
    "predicate",
    [
        Predicate("raining"),
        Predicate("same", [ROBOT, ROBOT]),
        Predicate("anything", [PddlTypeDto("object")]),
        Predicate("wide", [PddlTypeDto(f"t{number % 7}") for number in range(100)]),
    ],
    ids=lambda predicate: predicate.name,
)
def test_any_number_of_parameters_is_kept_in_order(
    fresh_kb: KnowledgeBase, predicate: PddlPredicateDto
) -> None:
    fresh_kb.predicates.save(predicate)
    found = present(fresh_kb.predicates.get(predicate.name))
    assert found.types == predicate.types
    assert str(found) == str(predicate)


def test_a_predicate_has_a_hundred_parameters_at_most(fresh_kb: KnowledgeBase) -> None:
    wide = Predicate("wide", [ROBOT] * 101)
    caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.predicates.save(wide))
    assert "'wide' has 101 parameters, 100 at most" in str(caught.value)


def test_types_that_are_missing_are_saved_along(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.predicates.save(Predicate("free", [PddlTypeDto("car", parent=PddlTypeDto("vehicle"))]))
    assert state(fresh_kb)["types"] == ["vehicle", "car - vehicle"]
    assert fresh_kb.revision == 1


def test_saving_the_same_definition_is_no_redefinition(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    shouted = Predicate("ROBOT_AT", [PddlTypeDto("ROBOT"), PddlTypeDto("WP")])
    with nothing_changes(fresh_kb):
        assert fresh_kb.predicates.save(shouted) is True
        assert fresh_kb.predicates.update(shouted, cascade=True) is True
        assert fresh_kb.predicates.save_all([shouted]) == 0


SAVED: dict[str, tuple[list[Any], int, list[str]]] = {
    "types": ([CAR, CAR, VEHICLE, TAXI], 2, ["vehicle", "car - vehicle", "taxi - car"]),
    "objects": ([RB1, WP1, RB1, Object(ROBOT, "wp1")], 3, ["rb1 - robot", "wp1 - robot"]),
    "predicates": (
        [ROBOT_AT, Predicate("raining"), ROBOT_AT, Predicate("robot_at", [WAYPOINT, ROBOT])],
        3,
        ["(robot_at ?w0 - wp ?r1 - robot)", "(raining)"],
    ),
}


@pytest.mark.parametrize("kind", SAVED)
def test_save_all_counts_what_changed_and_the_last_definition_stands(
    fresh_kb: KnowledgeBase, kind: str
) -> None:
    given, changed, there = SAVED[kind]
    fresh_kb.types.save(VEHICLE)
    dao = dao_of(fresh_kb, kind)
    assert dao.save_all(iter(given)) == changed
    assert fresh_kb.revision == 2
    assert state(fresh_kb)[kind] == there
    assert {*there} == {row[0] for row in versions(fresh_kb, kind[:-1])}
    with nothing_changes(fresh_kb):
        assert dao.save_all(reversed(dao.get_all())) == 0
        assert dao.save_all([]) == 0


# What refers to something with another definition than the stored one.

ROLLING = Type("robot", parent=Type("machine"))
ROLLING_AT = Predicate("robot_at", [ROLLING, WAYPOINT])
TOY = Type("taxi", parent=Type("car", parent=Type("vehicle", parent=Type("toy"))))
R, S = Object(ROBOT, "r"), Object(WAYPOINT, "s")


def at_start(*terms: PddlObjectDto, predicate: PddlPredicateDto = ROBOT_AT) -> PddlActionDto:
    """An action with a condition, and two parameters."""
    condition = PddlConditionEffectDto(predicate, terms, PddlConditionEffectDto.AT_START)
    return PddlActionDto("go", [R, S], [condition])


# Other signatures of a predicate, and of a function, than the stored ones.
PREDICATES = [
    Predicate("robot_at", [WAYPOINT, ROBOT]),
    Predicate("robot_at", [ROBOT]),
    Predicate("robot_at"),
    Predicate("robot_at", [ROBOT, WAYPOINT, WAYPOINT]),
    Predicate("ROBOT_AT", [ROBOT, Type("place")]),
]
FUNCTIONS = [
    PddlFunctionDto("distance", [WAYPOINT]),
    PddlFunctionDto("distance", [WAYPOINT, ROBOT]),
    PddlFunctionDto("distance", [WAYPOINT, WAYPOINT], value_types=[WAYPOINT]),
]
# What is stored, what refers to it as what: by its DAO.
OTHERWISE: list[tuple[str, str, list[tuple[str, Any]]]] = [
    (
        "object 'rb1' is stored as 'rb1 - robot'",
        "'rb1 - tiago'",
        [("propositions", robot_at(Object(TIAGO, "rb1"), WP2))],
    ),
    (
        "object 'tiago1' is stored as 'tiago1 - tiago'",
        "'tiago1 - robot'",
        [("actions", at_start(Object(ROBOT, "tiago1"), S))],
    ),
    (
        "type 'robot' is stored as 'robot'",
        "'robot - machine'",
        [
            ("objects", Object(ROLLING, "rb2")),
            ("objects", Object(ROLLING, "rb1")),
            ("predicates", ROLLING_AT),
            ("propositions", robot_at(Object(ROLLING, "rb1"))),
            ("propositions", Fact(ROLLING_AT, robot_at().objects)),
            ("actions", PddlActionDto("go", [Object(ROLLING, "r")])),
        ],
    ),
    (
        "type 'car' is stored as 'car - vehicle'",
        "'car - ship'",
        [("types", Type("taxi", parent=Type("car", parent=Type("ship"))))],
    ),
    (
        "type 'vehicle' is stored as 'vehicle'",
        "'vehicle - toy'",
        [
            ("types", TOY),
            ("types", Type("uber", parent=TOY)),
            ("objects", Object(TOY, "t1")),
            ("predicates", Predicate("free", [TOY])),
        ],
    ),
    (
        "type 'wp' is stored as 'wp'",
        "'wp - robot'",
        [("functions", PddlFunctionDto("far", [Type("wp", parent=ROBOT)]))],
    ),
    *(
        (
            f"predicate {other.name!r} is stored as {ROBOT_AT}",
            str(other),
            [
                ("propositions", Fact(other, [Object(each, f"o-{each}") for each in other.types])),
                ("actions", at_start(*[R, S, S][: len(other.types)], predicate=other)),
            ],
        )
        for other in PREDICATES
    ),
    *(
        (
            f"function 'distance' is stored as {DISTANCE}",
            str(other),
            [("function_values", PddlFunctionValueDto(other, [WP1, WP2], 1))],
        )
        for other in FUNCTIONS
    ),
]


@pytest.mark.parametrize(("stored", "other", "referring"), OTHERWISE)
def test_what_refers_to_another_definition_is_refused_naming_both(
    fresh_kb: KnowledgeBase, stored: str, other: str, referring: list[tuple[str, Any]]
) -> None:
    fresh_kb.types.save(TAXI)
    fresh_kb.propositions.save(robot_at())
    fresh_kb.objects.save(Object(TIAGO, "tiago1"))
    fresh_kb.functions.save(DISTANCE)
    for dao, dto in referring:
        message = str(refuses(fresh_kb, ConflictError, dao_of(fresh_kb, dao).save, dto).value)
        assert stored in message
        assert f"refers to it as {other}" in message
