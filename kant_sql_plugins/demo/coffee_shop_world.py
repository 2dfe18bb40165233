"""The coffee shop's initial PDDL: what the robot knows before its first task."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from kant_sql import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)

ROBOT = PddlTypeDto("robot")
PLACE = PddlTypeDto("place")
TABLE = PddlTypeDto("table", parent=PLACE)
PERSON = PddlTypeDto("person")
ITEM = PddlTypeDto("item")
ORDER = PddlTypeDto("order")
STATUS = PddlTypeDto("status")
TYPES = [ROBOT, PLACE, TABLE, PERSON, ITEM, ORDER, STATUS]

RB1 = PddlObjectDto(ROBOT, "rb1")
CHARGER, ENTRANCE, COUNTER, KITCHEN = PLACES = [
    PddlObjectDto(PLACE, name) for name in ("charger", "entrance", "counter", "kitchen")
]
TABLES = [PddlObjectDto(TABLE, f"table{number}") for number in range(1, 7)]
BARISTA = PddlObjectDto(PERSON, "dario")
GUESTS = [PddlObjectDto(PERSON, name) for name in ("ana", "bruno", "carla")]
MENU = [
    PddlObjectDto(ITEM, name)
    for name in ("espresso", "latte", "tea", "water", "croissant", "muffin", "toast", "soup")
]
ORDERS = [PddlObjectDto(ORDER, f"order{number}") for number in range(1, 4)]
UNKNOWN, FREE, OCCUPIED, DIRTY = STATUSES = [
    PddlObjectDto(STATUS, name) for name in ("unknown", "free", "occupied", "dirty")
]
OBJECTS = [RB1, *PLACES, *TABLES, BARISTA, *GUESTS, *MENU, *ORDERS, *STATUSES]

ROBOT_AT = PddlPredicateDto("robot_at", [ROBOT, PLACE])
CONNECTED = PddlPredicateDto("connected", [PLACE, PLACE])
HANDS_FREE = PddlPredicateDto("hands_free", [ROBOT])
HOLDING = PddlPredicateDto("holding", [ROBOT, ITEM])
BATTERY_OK = PddlPredicateDto("battery_ok", [ROBOT])
TABLE_IS = PddlPredicateDto("table_is", [TABLE, STATUS])
CHECKED = PddlPredicateDto("checked", [TABLE])
BY_WINDOW = PddlPredicateDto("by_window", [TABLE])
ON_MENU = PddlPredicateDto("on_menu", [ITEM])
HOT = PddlPredicateDto("hot", [ITEM])
MADE_AT = PddlPredicateDto("made_at", [ITEM, PLACE])
GOES_WITH = PddlPredicateDto("goes_with", [ITEM, ITEM])
READY = PddlPredicateDto("ready", [ITEM, PLACE])
ORDER_OF = PddlPredicateDto("order_of", [ORDER, TABLE])
ORDERED = PddlPredicateDto("ordered", [ORDER, ITEM])
DELIVERED = PddlPredicateDto("delivered", [ORDER, ITEM])
PERSON_AT = PddlPredicateDto("person_at", [PERSON, PLACE])
WORKS_AT = PddlPredicateDto("works_at", [PERSON, PLACE])
PREPARES = PddlPredicateDto("prepares", [PERSON, ITEM])
WAITING = PddlPredicateDto("waiting", [PERSON])
GREETED = PddlPredicateDto("greeted", [PERSON])
SEATED = PddlPredicateDto("seated", [PERSON, TABLE])
PREDICATES = [
    *(ROBOT_AT, CONNECTED, HANDS_FREE, HOLDING, BATTERY_OK, TABLE_IS, CHECKED, BY_WINDOW),
    *(ON_MENU, HOT, MADE_AT, GOES_WITH, READY, ORDER_OF, ORDERED, DELIVERED),
    *(PERSON_AT, WORKS_AT, PREPARES, WAITING, GREETED, SEATED),
]


def fact(predicate: PddlPredicateDto, *objects: PddlObjectDto) -> PddlPropositionDto:
    """Return a fact."""
    return PddlPropositionDto(predicate, objects)


def goal(predicate: PddlPredicateDto, *objects: PddlObjectDto) -> PddlPropositionDto:
    """Return a goal."""
    return PddlPropositionDto(predicate, objects, is_goal=True)


def _facts() -> list[PddlPropositionDto]:
    window, wall = TABLES[:3], TABLES[3:]
    ways = [(CHARGER, ENTRANCE), (ENTRANCE, COUNTER), (COUNTER, KITCHEN), (COUNTER, CHARGER)]
    ways += [(COUNTER, table) for table in TABLES] + [(ENTRANCE, table) for table in window]
    ways += [*zip(window, wall, strict=True), *pairwise(window), *pairwise(wall)]
    kitchen_made = {"croissant", "toast", "soup"}
    return [
        fact(ROBOT_AT, RB1, CHARGER),
        fact(HANDS_FREE, RB1),
        fact(BATTERY_OK, RB1),
        *(fact(CONNECTED, *way) for way in ways),
        *(fact(CONNECTED, there, here) for here, there in ways),
        *(fact(TABLE_IS, table, UNKNOWN) for table in TABLES),
        *(fact(BY_WINDOW, table) for table in window),
        *(fact(ON_MENU, item) for item in MENU),
        *(fact(HOT, item) for item in MENU if item.name in {"espresso", "latte", "tea", "soup"}),
        *(fact(MADE_AT, item, KITCHEN if item.name in kitchen_made else COUNTER) for item in MENU),
        *(fact(GOES_WITH, drink, food) for drink in MENU[:3] for food in MENU[4:6]),
        fact(PERSON_AT, BARISTA, COUNTER),
        fact(WORKS_AT, BARISTA, COUNTER),
        *(fact(PREPARES, BARISTA, item) for item in MENU),
    ]


FACTS = _facts()


def _at(time: str, is_negative: bool = False) -> Callable[..., PddlConditionEffectDto]:
    return lambda predicate, *terms: PddlConditionEffectDto(predicate, terms, time, is_negative)


_before, _ends = _at(PddlConditionEffectDto.AT_START), _at(PddlConditionEffectDto.AT_START, True)
_throughout, _then = _at(PddlConditionEffectDto.OVER_ALL), _at(PddlConditionEffectDto.AT_END)


def _moves() -> list[PddlActionDto]:
    r, p = PddlObjectDto(ROBOT, "r"), PddlObjectDto(PERSON, "p")
    here, there, t = PddlObjectDto(PLACE, "s"), PddlObjectDto(PLACE, "d"), PddlObjectDto(TABLE, "t")
    return [
        PddlActionDto(
            "navigation",
            [r, here, there],
            [
                *(_before(ROBOT_AT, r, here), _before(CONNECTED, here, there)),
                _throughout(BATTERY_OK, r),
            ],
            [_ends(ROBOT_AT, r, here), _then(ROBOT_AT, r, there)],
            duration=20,
        ),
        PddlActionDto(
            "dock", [r], [_throughout(ROBOT_AT, r, CHARGER)], [_then(BATTERY_OK, r)], duration=60
        ),
        PddlActionDto(
            "greet_person",
            [r, p],
            [_throughout(ROBOT_AT, r, ENTRANCE), _before(WAITING, p)],
            [_then(GREETED, p)],
            duration=5,
        ),
        PddlActionDto(
            "guide_person",
            [r, p, here, t],
            [
                *(_before(ROBOT_AT, r, here), _before(PERSON_AT, p, here)),
                *(_before(GREETED, p), _before(TABLE_IS, t, FREE)),
            ],
            [
                *(_ends(ROBOT_AT, r, here), _ends(PERSON_AT, p, here)),
                *(_then(ROBOT_AT, r, t), _then(PERSON_AT, p, t)),
                *(_ends(WAITING, p), _then(SEATED, p, t)),
                *(_ends(TABLE_IS, t, FREE), _then(TABLE_IS, t, OCCUPIED)),
            ],
            duration=30,
        ),
    ]


def _services() -> list[PddlActionDto]:
    r, t = PddlObjectDto(ROBOT, "r"), PddlObjectDto(TABLE, "t")
    i, o = PddlObjectDto(ITEM, "i"), PddlObjectDto(ORDER, "o")
    place, status = PddlObjectDto(PLACE, "p"), PddlObjectDto(STATUS, "s")
    return [
        PddlActionDto(
            "check_table",
            [r, t, status],
            [_throughout(ROBOT_AT, r, t)],
            [_ends(TABLE_IS, t, UNKNOWN), _then(TABLE_IS, t, status), _then(CHECKED, t)],
            duration=5,
        ),
        PddlActionDto(
            "take_order",
            [r, o, i, t],
            [_throughout(ROBOT_AT, r, t), _before(ON_MENU, i)],
            [_then(ORDER_OF, o, t), _then(ORDERED, o, i)],
            duration=15,
        ),
        PddlActionDto(
            "pick_item",
            [r, i, place],
            [_throughout(ROBOT_AT, r, place), _before(READY, i, place), _before(HANDS_FREE, r)],
            [_ends(READY, i, place), _ends(HANDS_FREE, r), _then(HOLDING, r, i)],
            duration=8,
        ),
        PddlActionDto(
            "deliver_item",
            [r, i, o, t],
            [_throughout(ROBOT_AT, r, t), _before(HOLDING, r, i), _before(ORDERED, o, i)],
            [_ends(HOLDING, r, i), _then(HANDS_FREE, r), _then(DELIVERED, o, i)],
            duration=8,
        ),
    ]


ACTIONS = [*_moves(), *_services()]
