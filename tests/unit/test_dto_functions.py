"""Functions, their values, either types and named parameters: text, identity and numbers."""

from __future__ import annotations

import copy
import pickle
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import (
    Dto,
    InvalidKnowledgeError,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlTypeDto,
)
from kant_sql.dto.formulas import Number
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, WP1, WP2, assigned

DISTANCE = PddlFunctionDto("distance", [WAYPOINT, WAYPOINT])
LOCATION = PddlFunctionDto("loc", [ROBOT], value_types=[WAYPOINT])
EITHER = PddlEitherTypeDto([ROBOT, PddlTypeDto("human")])


@pytest.mark.parametrize(
    ("dto", "text"),
    [
        (DISTANCE, "(distance ?w0 - wp ?w1 - wp)"),
        (PddlFunctionDto("total-cost"), "(total-cost)"),
        (LOCATION, "(loc ?r0 - robot) - wp"),
        (PddlFunctionDto("next", value_types=[WAYPOINT, ROBOT]), "(next) - (either wp robot)"),
        (PddlFunctionDto("next", value_types=[EITHER]), "(next) - (either robot human)"),
        (
            PddlFunctionDto("d", [WAYPOINT, WAYPOINT], parameter_names=["from", "to"]),
            "(d ?from - wp ?to - wp)",
        ),
        (PddlFunctionDto("age", [EITHER]), "(age ?r0 - (either robot human))"),
        (
            PddlPredicateDto("near", [EITHER, WAYPOINT]),
            "(near ?r0 - (either robot human) ?w1 - wp)",
        ),
        (
            PddlPredicateDto("same", [ROBOT, ROBOT], parameter_names=["x", "x"]),
            "(same ?x - robot ?x - robot)",
        ),
        (
            PddlPredicateDto("p", [ROBOT, ROBOT], parameter_names=["x"]),
            "(p ?x - robot ?r1 - robot)",
        ),
        (EITHER, "(either robot human)"),
        (PddlObjectDto(EITHER, "rb1"), "rb1 - (either robot human)"),
        (PddlFunctionValueDto(DISTANCE, [WP1, WP2], 10), "(= (distance wp1 wp2) 10)"),
        (PddlFunctionValueDto(PddlFunctionDto("total-cost")), "(= (total-cost) 0)"),
        (PddlFunctionValueDto(LOCATION, [RB1], WP2), "(= (loc rb1) wp2)"),
    ],
)
def test_a_dto_prints_as_pddl(dto: Dto, text: str) -> None:
    assert str(dto) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (-3, "-3"),
        (2**80, "1208925819614629174706176"),
        (10.0, "10.0"),
        (-0.0, "0.0"),
        (2.5, "2.5"),
        (0.1, "0.1"),
        (1e-7, "0.0000001"),
        (1e23, "100000000000000000000000.0"),
        (5e-324, f"0.{'0' * 323}5"),
        (Decimal("10.50"), "10.50"),
        (Decimal("-0"), "0"),
        (Decimal("1E+3"), "1000"),
        (Decimal("1E-3"), "0.001"),
        (Decimal(10) ** 399, f"1{'0' * 399}"),
    ],
)
def test_a_number_is_printed_exactly_and_without_an_exponent(
    value: int | float | Decimal, text: str
) -> None:
    assert (
        str(PddlFunctionValueDto(DISTANCE, [WP1, WP2], value)) == f"(= (distance wp1 wp2) {text})"
    )


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_is_read_back_from_its_text(value: float) -> None:
    text = str(PddlFunctionValueDto(PddlFunctionDto("f"), [], value))
    assert "e" not in text.lower()
    assert float(text.removeprefix("(= (f) ").removesuffix(")")) == value


@pytest.mark.parametrize(
    "value",
    [
        float("nan"),
        float("inf"),
        Decimal("NaN"),
        Decimal("sNaN"),
        Decimal("-Infinity"),
        Decimal("1E+1000000"),
        Decimal("1E-1000000"),
        Decimal("0E-1000000"),
        10**400,
    ],
    ids=repr,
)
def test_what_no_text_carries_is_refused(value: int | float | Decimal) -> None:
    with pytest.raises(InvalidKnowledgeError, match="is a finite number of at most 400 digits"):
        PddlFunctionValueDto(PddlFunctionDto("f"), [], value)
    with pytest.raises(InvalidKnowledgeError, match="is a finite number of at most 400 digits"):
        Number(value)
    wrong = assigned(PddlFunctionValueDto(PddlFunctionDto("f")), value=value)
    with pytest.raises(InvalidKnowledgeError, match="give a finite number of at most 400 digits"):
        str(wrong)


def test_a_function_is_known_by_its_name_and_a_value_by_its_fluent() -> None:
    assert PddlFunctionDto("LOC") == LOCATION
    assert PddlPredicateDto("loc") != LOCATION
    ten, twenty = (PddlFunctionValueDto(DISTANCE, [WP1, WP2], value) for value in (10, 20))
    assert ten == twenty
    assert hash(ten) == hash(twenty)
    assert ten != PddlFunctionValueDto(DISTANCE, [WP2, WP1], 10)
    assert ten != PddlFunctionValueDto(LOCATION, [WP1, WP2], 10)
    assert ten == PddlFunctionValueDto(PddlFunctionDto("Distance"), [WP1, WP2])


def test_the_name_of_several_types_follows_them() -> None:
    either = PddlEitherTypeDto([ROBOT])
    assert either.name == "robot"
    either.set_types([WAYPOINT, ROBOT])
    assert (either.name, either.get_types()) == ("(either wp robot)", [WAYPOINT, ROBOT])
    for twin in (copy.deepcopy(either), pickle.loads(pickle.dumps(either))):
        assert twin == either
        assert twin.types == either.types
