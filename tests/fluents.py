"""A battery that several writers charge and discharge, and distances to fill a store with."""

from __future__ import annotations

from decimal import Decimal

from kant_sql import KnowledgeBase, PddlFunctionDto, PddlFunctionValueDto
from tests.worlds import RB1, ROBOT, WAYPOINT, WP1, waypoint

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
