"""Two DTOs are equal when they denote the same element, and then they have the same hash."""

from __future__ import annotations

import copy
import itertools
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import (
    Dto,
    InvalidKnowledgeError,
    KantSqlError,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.errors import InvalidNameError
from tests.support.generators.junk import JUNK, SLOW, World
from tests.support.worlds.robots import (
    DISTANCE,
    LOCATION,
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    assigned,
    navigation,
    robot_at,
)

Literal = PddlConditionEffectDto
SHOUTED = PddlPredicateDto("ROBOT_AT", [ROBOT, WAYPOINT])
RB1_SHOUTED = PddlObjectDto(PddlTypeDto("Robot"), "RB1")

EQUAL: list[tuple[Dto, Dto]] = [
    (ROBOT, PddlTypeDto("ROBOT")),
    (ROBOT, PddlTypeDto("robot", parent=PddlTypeDto("vehicle"))),
    (PddlTypeDto("straße"), PddlTypeDto("STRASSE")),
    (PddlTypeDto("K\u00fcche"), PddlTypeDto("Ku\u0308che")),
    (RB1, RB1_SHOUTED),
    (RB1, PddlObjectDto(WAYPOINT, "rb1")),
    (ROBOT_AT, PddlPredicateDto("Robot_At")),
    (navigation(), PddlActionDto("NAVIGATION", durative=False)),
    (robot_at(), PddlPropositionDto(SHOUTED, [RB1_SHOUTED, WP1])),
    (robot_at(is_goal=True), PddlPropositionDto(SHOUTED, [RB1, WP1], True)),
    (Literal(ROBOT_AT, [RB1]), Literal(SHOUTED, [RB1_SHOUTED])),
    (Literal(ROBOT_AT, [RB1], Literal.AT_END, True), Literal(SHOUTED, [RB1], Literal.AT_END, True)),
]
DIFFERENT: list[tuple[object, object]] = [
    (ROBOT, WAYPOINT),
    (RB1, WP1),
    (robot_at(), robot_at(is_goal=True)),
    (robot_at(), robot_at(RB1, WP2)),
    (robot_at(), PddlPropositionDto(ROBOT_AT, [WP1, RB1])),
    (robot_at(), PddlPropositionDto(ROBOT_AT, [RB1])),
    (robot_at(), PddlPropositionDto(PddlPredicateDto("near"), [RB1, WP1])),
    (Literal(ROBOT_AT, [RB1]), Literal(ROBOT_AT, [RB1], Literal.AT_END)),
    (Literal(ROBOT_AT, [RB1]), Literal(ROBOT_AT, [RB1], is_negative=True)),
    (Literal(ROBOT_AT, [RB1]), Literal(ROBOT_AT, [WP1])),
    (Literal(ROBOT_AT, [RB1, WP1]), robot_at()),
    (ROBOT, "robot"),
    (ROBOT, None),
]
# Elements of different kinds are different, whatever their names.
SAME_NAME = [
    PddlTypeDto("x"),
    PddlObjectDto(ROBOT, "x"),
    PddlPredicateDto("x"),
    PddlActionDto("x"),
    PddlPropositionDto(PddlPredicateDto("x")),
    PddlConditionEffectDto(PddlPredicateDto("x")),
]
DIFFERENT += itertools.combinations(SAME_NAME, 2)


@pytest.mark.parametrize(("one", "other"), EQUAL, ids=str)
def test_the_same_element_is_equal_and_has_one_hash(one: Dto, other: Dto) -> None:
    assert one == other
    assert hash(one) == hash(other)
    assert len({one, other}) == 1


@pytest.mark.parametrize(("one", "other"), DIFFERENT)
def test_different_elements_are_not_equal(one: object, other: object) -> None:
    assert one != other
    assert len({one, other}) == 2


@given(st.text(min_size=1), st.text(min_size=1))
def test_equality_of_names_implies_one_hash(one: str, other: str) -> None:
    left, right = PddlTypeDto(one), PddlTypeDto(other)
    assert (left == right) == (right == left)
    assert left == PddlTypeDto(one)
    if left == right:
        assert hash(left) == hash(right)


def test_a_function_is_known_by_its_name_and_a_value_by_its_fluent() -> None:
    assert PddlFunctionDto("LOC") == LOCATION
    assert PddlPredicateDto("loc") != LOCATION
    ten, twenty = (PddlFunctionValueDto(DISTANCE, [WP1, WP2], value) for value in (10, 20))
    assert ten == twenty
    assert hash(ten) == hash(twenty)
    assert ten != PddlFunctionValueDto(DISTANCE, [WP2, WP1], 10)
    assert ten != PddlFunctionValueDto(LOCATION, [WP1, WP2], 10)
    assert ten == PddlFunctionValueDto(PddlFunctionDto("Distance"), [WP1, WP2])


def test_a_name_that_is_no_string_cannot_be_compared() -> None:
    broken = assigned(PddlTypeDto("five"), name=5)
    with pytest.raises(InvalidNameError, match="a name is a string, not int"):
        hash(broken)


def test_fields_overwritten_with_junk_give_no_raw_error() -> None:
    for made in World.dtos.values():
        for field in vars(made):
            for name, junk in JUNK.items():
                if name not in SLOW:
                    check_overwritten(assigned(copy.copy(made), **{field: junk()}), made)


def check_overwritten(dto: Dto, other: Dto) -> None:
    assert dto == dto
    assert (dto == other) in (True, False)
    for call in (str, hash):
        with suppress(KantSqlError):
            call(dto)


def test_what_is_overwritten_with_junk_equals_only_itself() -> None:
    broken = assigned(PddlTypeDto("robot"), name=None)
    assert broken == broken
    assert broken != PddlTypeDto("robot")
    assert broken != assigned(PddlTypeDto("robot"), name=None)
    for call in (str, hash):
        with pytest.raises(InvalidKnowledgeError):
            call(broken)


def test_the_text_of_a_type_above_itself_ends() -> None:
    own = PddlTypeDto("own")
    own.parent = own
    assert repr(own) == "PddlTypeDto(name='own', parent=...)"
