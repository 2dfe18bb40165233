"""`str()` of a DTO is its PDDL text, in exactly the shapes that other programs parse."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import (
    Dto,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, navigation, robot_at

Literal = PddlConditionEffectDto

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
    ("duration", "text"),
    [
        (0, "0"),
        (7, "7"),
        (2**80, "1208925819614629174706176"),
        (10.0, "10.0"),
        (2.5, "2.5"),
        (1e-7, "0.0000001"),
        (1e16, "10000000000000000.0"),
        (1e23, "100000000000000000000000.0"),
    ],
)
def test_a_duration_is_printed_in_digits(duration: int | float, text: str) -> None:
    action = PddlActionDto("a", duration=duration)
    assert f"\t:duration (= ?duration {text})\n" in str(action)


@given(st.floats(min_value=0, allow_nan=False, allow_infinity=False))
def test_a_float_duration_is_printed_exactly_and_without_an_exponent(duration: float) -> None:
    found = re.search(r"\?duration (\d+\.\d+)\)", str(PddlActionDto("a", duration=duration)))
    assert found is not None
    assert float(found[1]) == duration


def test_a_subclass_of_float_is_printed_as_a_float() -> None:
    class Seconds(float):
        def __repr__(self) -> str:
            return f"{float(self)} s"

    assert "(= ?duration 2.5)" in str(PddlActionDto("a", duration=Seconds(2.5)))
