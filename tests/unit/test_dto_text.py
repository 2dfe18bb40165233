"""`str()` of a DTO is its PDDL text, exactly as other programs parse it; numbers are exact."""

from __future__ import annotations

import copy
import pickle
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import (
    Dto,
    InvalidKnowledgeError,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dto.formulas import Number
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
EITHER = PddlEitherTypeDto([ROBOT, PddlTypeDto("human")])

NAVIGATION = (
    "(:durative-action navigation\n"
    "\t:parameters ( ?r - robot ?s - wp ?d - wp)\n"
    "\t:duration (= ?duration 10)\n"
    "\t:condition (and\n"
    "\t\t(at start (robot_at ?r ?s))\n"
    "\t)\n"
    "\t:effect (and\n"
    "\t\t(at start (not (robot_at ?r ?s)))\n"
    "\t\t(at end (robot_at ?r ?d))\n"
    "\t)\n"
    ")"
)
PLAIN = (
    "(:action wait\n"
    "\t:parameters ( ?r - robot)\n"
    "\t:precondition (and\n"
    "\t\t(idle ?r)\n"
    "\t)\n"
    "\t:effect (and\n"
    "\t\t(not (idle ?r))\n"
    "\t)\n"
    ")"
)
BARE = (
    "(:durative-action nothing\n"
    "\t:parameters ()\n"
    "\t:duration (= ?duration 10)\n"
    "\t:condition (and\n"
    "\t)\n"
    "\t:effect (and\n"
    "\t)\n"
    ")"
)


def literal(time: str | None, is_negative: bool) -> PddlConditionEffectDto:
    objects = [PddlObjectDto(ROBOT, "r"), PddlObjectDto(WAYPOINT, "s")]
    return Literal(ROBOT_AT, objects, time, is_negative)


def wait() -> PddlActionDto:
    robot = PddlObjectDto(ROBOT, "r")
    idle = PddlPredicateDto("idle", [ROBOT])
    effects = [Literal(idle, [robot], is_negative=True)]
    return PddlActionDto("wait", [robot], [Literal(idle, [robot])], effects, durative=False)


@pytest.mark.parametrize(
    ("dto", "text"),
    [
        (ROBOT, "robot"),
        (PddlTypeDto("robot", parent=PddlTypeDto("vehicle")), "robot - vehicle"),
        (RB1, "rb1 - robot"),
        (PddlObjectDto(PddlTypeDto("robot", parent=PddlTypeDto("v")), "rb1"), "rb1 - robot"),
        (ROBOT_AT, "(robot_at ?r0 - robot ?w1 - wp)"),
        (PddlPredicateDto("pair", [ROBOT, ROBOT]), "(pair ?r0 - robot ?r1 - robot)"),
        (PddlPredicateDto("raining"), "(raining)"),
        (PddlPredicateDto("thing", [PddlTypeDto("object")]), "(thing ?o0 - object)"),
        (robot_at(), "(robot_at rb1 wp1)"),
        (robot_at(is_goal=True), "(robot_at rb1 wp1)"),
        (PddlPropositionDto(PddlPredicateDto("raining")), "(raining)"),
        (literal(None, False), "(robot_at ?r ?s)"),
        (literal(None, True), "(not (robot_at ?r ?s))"),
        (literal(Literal.AT_START, False), "(at start (robot_at ?r ?s))"),
        (literal(Literal.AT_START, True), "(at start (not (robot_at ?r ?s)))"),
        (literal(Literal.AT_END, True), "(at end (not (robot_at ?r ?s)))"),
        (literal(Literal.OVER_ALL, False), "(over all (robot_at ?r ?s))"),
        (Literal(PddlPredicateDto("raining"), time=Literal.OVER_ALL), "(over all (raining))"),
        (navigation(), NAVIGATION),
        (wait(), PLAIN),
        (PddlActionDto("nothing"), BARE),
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


def test_a_constant_in_an_action_is_printed_without_a_question_mark() -> None:
    robot, dock = PddlObjectDto(ROBOT, "r"), PddlObjectDto(WAYPOINT, "Dock")
    effect = Literal(ROBOT_AT, [robot, dock], Literal.AT_END)
    action = PddlActionDto("go_home", [PddlObjectDto(ROBOT, "R")], [], [effect])
    assert "\t\t(at end (robot_at ?r Dock))\n" in str(action)


def test_a_variable_starts_with_the_first_letter_of_the_type_in_its_own_spelling() -> None:
    types = [PddlTypeDto("Robot"), PddlTypeDto("Ärger"), PddlTypeDto("🤖bot")]
    text = "(p ?R0 - Robot ?Ä1 - Ärger ?🤖2 - 🤖bot)"
    assert str(PddlPredicateDto("p", types)) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((0, "0"), (-3, "-3"), (2**80, "1208925819614629174706176"), (10.0, "10.0")),
        *((-0.0, "0.0"), (7, "7"), (2.5, "2.5"), (0.1, "0.1"), (1e-7, "0.0000001")),
        *((1e16, "10000000000000000.0"), (1e23, "100000000000000000000000.0")),
        *((5e-324, f"0.{'0' * 323}5"), (Decimal("10.50"), "10.50"), (Decimal("-0"), "0")),
        *((Decimal("1E+3"), "1000"), (Decimal("1E-3"), "0.001")),
        (Decimal(10) ** 399, f"1{'0' * 399}"),
    ],
)
def test_a_number_is_printed_exactly_and_without_an_exponent(
    value: int | float | Decimal, text: str
) -> None:
    printed = str(PddlFunctionValueDto(DISTANCE, [WP1, WP2], value))
    assert printed == f"(= (distance wp1 wp2) {text})"
    assert f"\t:duration (= ?duration {text})\n" in str(PddlActionDto("a", duration=value))


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_is_read_back_from_its_text(value: float) -> None:
    text = str(PddlFunctionValueDto(PddlFunctionDto("f"), [], value))
    assert "e" not in text.lower()
    assert float(text.removeprefix("(= (f) ").removesuffix(")")) == value
    found = re.search(r"\?duration (\d+\.\d+)\)", str(PddlActionDto("a", duration=abs(value))))
    assert found is not None
    assert float(found[1]) == abs(value)


def test_a_subclass_of_float_is_printed_as_a_float() -> None:
    class Seconds(float):
        def __repr__(self) -> str:
            return f"{float(self)} s"

    assert "(= ?duration 2.5)" in str(PddlActionDto("a", duration=Seconds(2.5)))


@pytest.mark.parametrize(
    "value",
    [
        *(float("nan"), float("inf"), Decimal("NaN"), Decimal("sNaN"), Decimal("-Infinity")),
        *(Decimal("1E+1000000"), Decimal("1E-1000000"), Decimal("0E-1000000"), 10**400),
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


def test_the_name_of_several_types_follows_them() -> None:
    either = PddlEitherTypeDto([ROBOT])
    assert either.name == "robot"
    either.set_types([WAYPOINT, ROBOT])
    assert (either.name, either.get_types()) == ("(either wp robot)", [WAYPOINT, ROBOT])
    for twin in (copy.deepcopy(either), pickle.loads(pickle.dumps(either))):
        assert twin == either
        assert twin.types == either.types
