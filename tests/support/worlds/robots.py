"""Robots and places: the small PDDL world that most tests share."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from typing import TypeVar

from kant_sql import (
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
from kant_sql.dto.formulas import Node

D = TypeVar("D")

ROBOT = PddlTypeDto("robot")
WAYPOINT = PddlTypeDto("wp")
ROBOT_AT = PddlPredicateDto("robot_at", [ROBOT, WAYPOINT])
RB1 = PddlObjectDto(ROBOT, "rb1")
WP1 = PddlObjectDto(WAYPOINT, "wp1")
WP2 = PddlObjectDto(WAYPOINT, "wp2")


def robot_at(
    robot: PddlObjectDto = RB1, place: PddlObjectDto = WP1, is_goal: bool = False
) -> PddlPropositionDto:
    """The fact, or the goal, that a robot is at a place."""
    return PddlPropositionDto(ROBOT_AT, [robot, place], is_goal)


def waypoint(number: int) -> PddlObjectDto:
    """A place of the given number."""
    return PddlObjectDto(WAYPOINT, f"wp{number}")


def navigation() -> PddlActionDto:
    """The paper's action: a robot goes from a source to a destination."""
    r, s, d = (
        PddlObjectDto(ROBOT, "r"),
        PddlObjectDto(WAYPOINT, "s"),
        PddlObjectDto(WAYPOINT, "d"),
    )
    literal = PddlConditionEffectDto
    return PddlActionDto(
        "navigation",
        [r, s, d],
        [literal(ROBOT_AT, [r, s], literal.AT_START)],
        [
            literal(ROBOT_AT, [r, s], literal.AT_START, is_negative=True),
            literal(ROBOT_AT, [r, d], literal.AT_END),
        ],
    )


def literals(parts: Iterable[PddlConditionEffectDto | Node]) -> list[PddlConditionEffectDto]:
    """What an action needs or does, when literals are all of it."""
    found = [part for part in parts if isinstance(part, PddlConditionEffectDto)]
    assert found == list(parts)
    return found


def assigned(dto: D, **fields: object) -> D:
    """Give a DTO with fields that its constructor would refuse: they are public, and unchecked."""
    for name, value in fields.items():
        setattr(dto, name, value)
    return dto


BATTERY = PddlFunctionDto("battery", [ROBOT])
DISTANCE = PddlFunctionDto("distance", [WAYPOINT, WAYPOINT])
LOCATION = PddlFunctionDto("loc", [ROBOT], value_types=[WAYPOINT])
STEP = Decimal("0.1")


def distance(number: int, value: int = 1) -> PddlFunctionValueDto:
    """How far it is to the place of a number."""
    return PddlFunctionValueDto(DISTANCE, [WP1, waypoint(number)], value)


def charge(kb: KnowledgeBase, times: int) -> None:
    """Charge, each time by one step more than the step back that follows."""
    for _ in range(times):
        kb.function_values.increase("battery", objects=["rb1"], by=2 * STEP)
        with kb.transaction(reason="used"):
            kb.function_values.decrease(BATTERY, objects=[RB1], by=STEP)


def charge_often(kb: KnowledgeBase) -> None:
    """What a process does."""
    charge(kb, 10)
