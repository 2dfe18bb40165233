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
from tests.support.reading import present, refuses
from tests.support.worlds.robots import DISTANCE, ROBOT, ROBOT_AT, WAYPOINT, WP1, WP2, robot_at

Type, Object = PddlTypeDto, PddlObjectDto
Predicate, Fact = PddlPredicateDto, PddlPropositionDto
TIAGO = Type("tiago", parent=ROBOT)
VEHICLE = Type("vehicle")
CAR = Type("car", parent=VEHICLE)
TAXI = Type("taxi", parent=CAR)


def test_results_share_nothing_with_what_was_saved_or_read_before(fresh_kb: KnowledgeBase) -> None:
    given = Type("car", parent=Type("vehicle"))
    fresh_kb.types.save(given)
    given.name = "changed"
    found = present(fresh_kb.types.get("car"))
    found.parent = None
    found.name = "changed"
    assert str(fresh_kb.types.get("car")) == "car - vehicle"


# The hierarchy: parents that must agree, no cycles, and one root.


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
        assert "would be its own ancestor" in str(caught)


def test_a_dto_that_contains_itself_is_refused(fresh_kb: KnowledgeBase) -> None:
    snake = Type("snake")
    snake.parent = snake
    refuses(fresh_kb, TypeCycleError, lambda: fresh_kb.types.save(snake))
    refuses(fresh_kb, TypeCycleError, lambda: fresh_kb.objects.save(Object(snake, "s1")))


def test_the_root_has_no_parent(fresh_kb: KnowledgeBase) -> None:
    caught = refuses(
        fresh_kb, InvalidKnowledgeError, lambda: fresh_kb.types.save(Type("Object", parent=VEHICLE))
    )
    assert "is the root of all types and has no parent, not 'vehicle'" in str(caught)
    assert fresh_kb.types.save(Type("object")) is True
    assert fresh_kb.types.save(Type("thing", parent=Type("object"))) is True


def test_the_message_shows_some_dependants_and_the_error_has_all(fresh_kb: KnowledgeBase) -> None:
    robots = [Object(ROBOT, f"r{number:02}") for number in range(12)]
    fresh_kb.propositions.save_all([robot_at(robot) for robot in robots])
    caught = refuses(fresh_kb, DependantsError, lambda: fresh_kb.objects.save(Object(ROBOT, "wp1")))
    assert len(caught.dependants) == 12
    assert "(robot_at r09 wp1) and 2 more depend on it" in str(caught)


def test_a_predicate_has_a_hundred_parameters_at_most(fresh_kb: KnowledgeBase) -> None:
    wide = Predicate("wide", [ROBOT] * 101)
    caught = refuses(fresh_kb, ArityError, lambda: fresh_kb.predicates.save(wide))
    assert "'wide' has 101 parameters, 100 at most" in str(caught)


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
        message = str(refuses(fresh_kb, ConflictError, dao_of(fresh_kb, dao).save, dto))
        assert stored in message
        assert f"refers to it as {other}" in message
