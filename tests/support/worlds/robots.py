"""Robots and places: the small PDDL world that most tests share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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
from tests.support.atoms import Atoms

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
    """Return the fact, or the goal, that a robot is at a place."""
    return PddlPropositionDto(ROBOT_AT, [robot, place], is_goal)


def waypoint(number: int) -> PddlObjectDto:
    """Return the place with a number."""
    return PddlObjectDto(WAYPOINT, f"wp{number}")


def navigation() -> PddlActionDto:
    """Return the paper's action: a robot goes from a source to a destination."""
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


def changed(change: Callable[[PddlActionDto], object]) -> PddlActionDto:
    """Return the same action, changed."""
    action = navigation()
    change(action)
    return action


def literals(parts: Iterable[PddlConditionEffectDto | Node]) -> list[PddlConditionEffectDto]:
    """Return the parts of an action's condition or effect, which must all be literals."""
    found = [part for part in parts if isinstance(part, PddlConditionEffectDto)]
    assert found == list(parts)
    return found


def assigned(dto: D, **fields: object) -> D:
    """Set fields of a DTO that its constructor would refuse: they are public and unchecked."""
    for name, value in fields.items():
        setattr(dto, name, value)
    return dto


BATTERY = PddlFunctionDto("battery", [ROBOT])
DISTANCE = PddlFunctionDto("distance", [WAYPOINT, WAYPOINT])
LOCATION = PddlFunctionDto("loc", [ROBOT], value_types=[WAYPOINT])
STEP = Decimal("0.1")


def distance(number: int, value: int = 1) -> PddlFunctionValueDto:
    """Return the distance to the place with a number."""
    return PddlFunctionValueDto(DISTANCE, [WP1, waypoint(number)], value)


def charge(kb: KnowledgeBase, times: int) -> None:
    """Charge, each time by one step more than the following step back."""
    for _ in range(times):
        kb.function_values.increase("battery", objects=["rb1"], by=2 * STEP)
        with kb.transaction(reason="used"):
            kb.function_values.decrease(BATTERY, objects=[RB1], by=STEP)


def charge_often(kb: KnowledgeBase) -> None:
    """Charge as one process of several."""
    charge(kb, 10)


# One element of each kind, by its DAO.
ELEMENTS = {
    "types": ROBOT,
    "objects": RB1,
    "predicates": ROBOT_AT,
    "functions": DISTANCE,
    "propositions": robot_at(),
    "actions": navigation(),
    "function_values": PddlFunctionValueDto(BATTERY, [RB1], 1),
}

# Each makes a revision: facts and definitions come and go, in several ways.
STORY: list[Callable[[KnowledgeBase], object]] = [
    lambda kb: kb.propositions.save(robot_at()),
    lambda kb: kb.actions.save(navigation()),
    lambda kb: Atoms(kb).save_all([robot_at(is_goal=True), robot_at(RB1, WP2)]),
    lambda kb: kb.function_values.set(BATTERY, objects=[RB1], value=Decimal("10.0")),
    lambda kb: kb.propositions.delete(robot_at()),
    lambda kb: kb.function_values.set(BATTERY, objects=[RB1], value=5),
    lambda kb: kb.types.save(PddlTypeDto("robot", parent=PddlTypeDto("machine")), cascade=True),
    lambda kb: kb.predicates.save(PddlPredicateDto("robot_at", [WAYPOINT])),
    lambda kb: kb.objects.save(PddlObjectDto(WAYPOINT, "rb1")),
    lambda kb: kb.types.delete(WAYPOINT),
    lambda kb: kb.types.delete_all(),
    lambda kb: kb.propositions.save(robot_at()),
    lambda kb: kb.propositions.delete(robot_at()),
    lambda kb: kb.propositions.save(robot_at()),
    lambda kb: kb.actions.save(navigation()),
    lambda kb: kb.function_values.set(BATTERY, objects=[RB1], value=10),
    lambda kb: kb.objects.delete(WP1),
    lambda kb: kb.objects.save(PddlObjectDto(WAYPOINT, "wp3")),
    lambda kb: kb.function_values.set(LOCATION, objects=[RB1], value=WP2),
    lambda kb: kb.function_values.unset(BATTERY, objects=[RB1]),
]
