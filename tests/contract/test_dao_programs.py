"""Calls, alone and in transactions, beside the model: on every backend and front door."""

from __future__ import annotations

from typing import Any

import pytest

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.contract.test_properties import HERE, READ, THERE, TIGHT, on, save
from tests.support.generators.programs import DAOS, Block, Call, Items, Program, Step, check
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    changed,
    literals,
    navigation,
    robot_at,
    waypoint,
)

READS = [on(dao, "get_all") for dao in DAOS]
GOAL, LATER = robot_at(is_goal=True), robot_at(place=waypoint(3))
SWAPPED = PddlPredicateDto("robot_at", [WAYPOINT, ROBOT])
OTHER, PLACE, VEHICLE = map(PddlTypeDto, ("other", "place", "vehicle"))
CAR = PddlTypeDto("car", parent=VEHICLE)
NAVIGATION = on("actions", "save", navigation())
WORLD = Block([save(HERE), on("objects", "save", WP2), on("types", "save", VEHICLE)])
ELEMENTS: dict[str, Any] = {
    "types": CAR,
    "objects": PddlObjectDto(CAR, "c1"),
    "predicates": PddlPredicateDto("near", [WAYPOINT, WAYPOINT]),
    "propositions": THERE,
    "actions": navigation(),
}


def facts(method: str, *dtos: PddlPropositionDto) -> list[Call]:
    return [on("propositions", method, dto) for dto in dtos]


def undone(*steps: Step) -> Block:
    return Block([*steps], fails=True)


GONE, NONE = on("propositions", "delete", HERE), on("propositions", "delete_all")


def come_and_go(kind: str, element: Any) -> list[Step]:
    """An element comes and goes within transactions, and goes and comes: unread, and read."""
    steps: list[Step] = [WORLD]
    for there, back in (("insert", "delete"), ("delete", "insert")):
        for reads in ([], READS):
            calls = [on(kind, there, element), *reads, on(kind, back, element), *reads]
            steps += [Block([*calls, on(kind, back, element)])] * 2
        steps += [on(kind, each, element) for each in (back, there, "save")]
    return steps


# What may stand between two calls of a transaction: nothing, reads, and nested transactions.
NARROW_AT = on("predicates", "save", PddlPredicateDto("robot_at", [OTHER]))
FREE = PddlPropositionDto(PddlPredicateDto("free", [PLACE]), [PddlObjectDto(PLACE, "p1")])
NESTED = undone(on("types", "delete", OTHER), *READS)
SHORT = on("actions", "save", PddlActionDto("navigation"))
FREED = [save(FREE), on("propositions", "get_by_predicate", "free"), on("types", "delete", PLACE)]
BETWEEN: dict[str, list[Step]] = {
    "unread": [],
    "read": [*READS],
    "failing": [undone(on("types", "delete_all"), *READS, NARROW_AT, NESTED, *READS, SHORT)],
    "joining": [Block([*FREED])],
}


def redefined(calls: list[Call], between: list[Step]) -> list[Step]:
    return [WORLD, NAVIGATION, Block([each for call in calls for each in (call, *between)])]


# A definition that is deleted and created otherwise; and definitions that change there and back.
CREATED = [
    on("predicates", "delete", ROBOT_AT),
    on("predicates", "insert", PddlPredicateDto("ROBOT_AT", [ROBOT])),
    on("predicates", "delete", ROBOT_AT),
    on("predicates", "insert", SWAPPED),
]
CHANGED = [
    Call("types", "save", (PddlTypeDto("robot", parent=VEHICLE),), cascade=True),
    on("objects", "save", PddlObjectDto(WAYPOINT, "rb1")),
    on("predicates", "save", SWAPPED),
    on("types", "save", ROBOT),
    on("predicates", "save", ROBOT_AT),
    on("objects", "save", RB1),
    *(save(HERE), NAVIGATION),
]
DURATIONS = [on("actions", "save", PddlActionDto("navigation", duration=n)) for n in range(5)]


def levels(read: int) -> Block:
    """Nested transactions that fail, level by level; one of them is read."""
    reads: list[list[Step]] = [[*READS] if read == level else [] for level in range(4)]
    one, two = (on("types", "save", PddlTypeDto(name)) for name in ("one", "two"))
    four, five = (on("objects", "save", waypoint(number)) for number in (4, 5))
    inner = undone(save(THERE), *reads[2], undone(GONE, *reads[3]), four)
    return Block([save(LATER), *reads[0], undone(one, *reads[1], inner, two), five])


# Definitions: what is missing is saved along, what is there must agree.
ROOT = PddlTypeDto("object")
TAXI, TIAGO = PddlTypeDto("taxi", parent=CAR), PddlTypeDto("tiago", parent=ROBOT)
BARE_CAR, FREE_CAR = PddlTypeDto("car"), PddlPredicateDto("free", [CAR])
ROOTED = PddlTypeDto("robot", parent=ROOT)
DEEP = VEHICLE
for _number in range(12):
    DEEP = PddlTypeDto(f"level{_number}", parent=DEEP)
SEEN = PddlPredicateDto("seen", [ROOT])
WIDE = PddlPredicateDto("wide", [PddlTypeDto(f"t{number % 7}") for number in range(100)])
NEAR, NARROW = (PddlPredicateDto("near", [WAYPOINT] * arity) for arity in (2, 1))
RAINING = PddlPropositionDto(PddlPredicateDto("raining"))
LOUD_AT = PddlPredicateDto("ROBOT_AT", [PddlTypeDto("Robot"), PddlTypeDto("WP")])
LOUD = PddlPropositionDto(
    LOUD_AT, [PddlObjectDto(PddlTypeDto("ROBOT"), "RB1"), PddlObjectDto(PddlTypeDto("Wp"), "Wp1")]
)
TURNED = PddlPropositionDto(SWAPPED, [RB1, WP1])
NO_ONE = PddlPropositionDto(PddlPredicateDto("unknown"))
OF_TWO = {each: PddlPropositionDto(NEAR, [*each]) for each in ((WP1, WP1), (WP1, WP2), (WP2, WP1))}


def thing(type_: PddlTypeDto, name: str) -> PddlObjectDto:
    return PddlObjectDto(type_, name)


# Actions of every shape, and what may change in one.
Literal = PddlConditionEffectDto
R, S, ANY = thing(ROBOT, "r"), thing(WAYPOINT, "s"), thing(ROOT, "x")
IDLE = PddlPredicateDto("idle", [ROBOT])


def at_start(*terms: PddlObjectDto) -> PddlConditionEffectDto:
    return Literal(ROBOT_AT, terms, Literal.AT_START)


WAIT = PddlActionDto("wait", [R], [Literal(IDLE, [R])], [Literal(IDLE, [R], None, True)], False)
SHAPES = [
    PddlActionDto("empty"),
    PddlActionDto("constants", [], [at_start(RB1, WP1)]),
    PddlActionDto("mixed", [S], [at_start(RB1, S)], [at_start(RB1, WP1)]),
    navigation(),
    WAIT,
    PddlActionDto("nullary", [], [Literal(RAINING.predicate, time=Literal.OVER_ALL)]),
    PddlActionDto("twice", [R, S], [at_start(R, S), at_start(R, S)]),
    PddlActionDto("tiago", [thing(TIAGO, "r"), S], [at_start(thing(TIAGO, "r"), S)]),
    PddlActionDto("any", [ANY, S], [at_start(ANY, S)]),
]
OTHERS = [
    changed(lambda action: action.parameters.append(thing(ROBOT, "x"))),
    changed(lambda action: action.conditions.clear()),
    changed(lambda action: action.effects.reverse()),
    changed(lambda action: literals(action.effects)[0].set_is_negative(False)),
    changed(lambda action: literals(action.effects)[0].set_time(Literal.AT_END)),
    changed(lambda action: action.set_duration(10.0)),
    changed(lambda action: action.set_durative(False)),
    PddlActionDto("navigation", [R], WAIT.conditions, WAIT.effects, durative=False),
]
TIMES = [
    # A time, not a period, has effects (PDDL 2.1, section 5).
    PddlActionDto("a", [R, S], [literal], [literal] if time != Literal.OVER_ALL else [])
    for time in (Literal.AT_START, Literal.AT_END, Literal.OVER_ALL)
    for literal in (Literal(ROBOT_AT, [R, S], time, is_negative) for is_negative in (False, True))
]


def renamed(name: str) -> PddlActionDto:
    return PddlActionDto("go", [thing(ROBOT, name), S], [at_start(thing(ROBOT, name), S)])


# What goes with a definition.
DRIVES = PddlPredicateDto("drives", [VEHICLE])
DRIVEN = Literal(DRIVES, [thing(CAR, "c")], Literal.AT_END)
START = PddlActionDto("start", [thing(CAR, "c")], [], [DRIVEN])
GO_HOME = PddlActionDto("go_home", [R], [], [Literal(ROBOT_AT, [R, WP1], Literal.AT_END)])
DRIVING = [PddlPropositionDto(DRIVES, [thing(TAXI, "t1")], is_goal) for is_goal in (False, True)]
ACTS = on("actions", "save_all", [START, GO_HOME])
DEPENDING = [save(*DRIVING, HERE, GOAL, THERE, RAINING), ACTS]
DEPENDED: dict[str, tuple[Any, Any]] = {
    "types": (PddlTypeDto("car", parent=PddlTypeDto("toy")), PddlTypeDto("CAR")),
    "objects": (thing(ROBOT, "wp1"), thing(PddlTypeDto("any"), "WP1")),
    "predicates": (SWAPPED, PddlPredicateDto("Robot_At")),
}


# Many facts, of which few are kept in memory.
MANY = [PddlPropositionDto(NEAR, [waypoint(number), waypoint(0)]) for number in range(12)]
ONE, TWO, THREE, FOUR = MANY[1:5]
SHOUTED = PddlPropositionDto(PddlPredicateDto("NEAR", NEAR.types), ONE.objects)
BAD = [
    PddlPropositionDto(NEAR, [RB1, WP1]),
    PddlPropositionDto(NEAR, [PddlObjectDto(ROBOT, "wp1"), WP2]),
]
NARROWS = [PddlPropositionDto(NARROW, [waypoint(number)]) for number in range(6)]
MIXED = [
    PddlPropositionDto(PddlPredicateDto(name, [WAYPOINT]), [waypoint(number)], is_goal)
    for number in range(4)
    for name in ("p0", "p1", "p2")
    for is_goal in (False, True)
]


def breaking(*dtos: Any, dao: str = "propositions") -> Call:
    """A generator that gives some elements, and then raises an error of its own."""
    return on(dao, "save_all", Items([*dtos], breaks=True))


# Calls that are refused. Each would first save this, which is missing.
NEW = PddlTypeDto("new", parent=PddlTypeDto("newer"))
BRAND_NEW = PddlObjectDto(NEW, "brand_new")
CARRIES = PddlPredicateDto("carries", [ROBOT, NEW])


def carries(*objects: PddlObjectDto) -> PddlPropositionDto:
    return PddlPropositionDto(CARRIES, objects)


def go(*parameters: PddlObjectDto, time: str | None = None) -> PddlActionDto:
    return PddlActionDto(
        "go", parameters, [PddlConditionEffectDto(CARRIES, [RB1, BRAND_NEW], time)]
    )


CYCLE = PddlTypeDto("robot", parent=PddlTypeDto("fresh", parent=ROBOT))
REFUSED = {
    "cycle": on("types", "save", CYCLE),
    "name": on("objects", "save", PddlObjectDto(NEW, "two words")),
    "type in use": on("types", "save", PddlTypeDto("wp", parent=NEW)),
    "object in use": on("objects", "save", PddlObjectDto(NEW, "wp2")),
    "predicate in use": on("predicates", "save", PddlPredicateDto("robot_at", [NEW])),
    "object refers": on("objects", "save", PddlObjectDto(PddlTypeDto("wp", parent=NEW), "wp9")),
    "fact refers": on("propositions", "save", carries(PddlObjectDto(NEW, "rb1"), BRAND_NEW)),
    "arity": on("propositions", "save", carries(RB1)),
    "mismatch": on("propositions", "save", carries(BRAND_NEW, BRAND_NEW)),
    "last of many": save(robot_at(place=waypoint(5)), robot_at(WP1, RB1)),
    "time": on("actions", "save", go(BRAND_NEW)),
    "unknown constant": on("actions", "save", go(time="at end")),
    "the caller's own error": breaking(robot_at(place=waypoint(7)), carries(RB1, BRAND_NEW)),
}


def refused(call: Call) -> list[Step]:
    """A call that is refused: alone, and in transactions, which go on without it."""
    all_ = [save(HERE, robot_at(place=WP2, is_goal=True)), NAVIGATION]
    forgotten = [on("types", "delete_all"), READ, on("objects", "save_all", [RB1, WP1]), *all_]
    return [
        *(Block([*all_]), call, call, Block([call])),
        Block([on("objects", "save", waypoint(8)), undone(*forgotten, call), READ]),
        Block([GONE, save(LATER), call, on("objects", "save", waypoint(4))]),
        Block([save(HERE), *facts("delete", LATER), *READS, call, *READS]),
        # What it would have saved can be saved.
        Block([call, save(carries(RB1, BRAND_NEW)), save(robot_at(place=waypoint(5)))]),
    ]


PROGRAMS: dict[str, list[Step]] = {
    # What single calls do.
    "missing types": [
        *(on("types", "save", TAXI), on("types", "get", "taxi"), on("types", "save", BARE_CAR)),
        *(on("objects", "save", thing(TIAGO, "rb1")), on("predicates", "save", DRIVES)),
    ],
    "types that definitions depend on": [
        *(on("types", "save", CAR), on("objects", "save", thing(CAR, "c1"))),
        *(on("predicates", "save", FREE_CAR), on("types", "save", BARE_CAR)),
    ],
    "the type of a parameter": [save(HERE), NAVIGATION, on("types", "delete", WAYPOINT)],
    "the order of what is first known": [
        *(on("types", "save_all", [OTHER, VEHICLE, PLACE]), on("types", "delete", OTHER)),
        *(on("types", "save", OTHER), save(THREE, TWO, ONE), *facts("delete", THREE), save(THREE)),
    ],
    "references without parents": [
        *(on("types", "save", TAXI), on("objects", "save", thing(PddlTypeDto("taxi"), "t1"))),
        *(on("types", "save", ROBOT), on("objects", "save", thing(ROOTED, "rb1"))),
    ],
    "the root": [save(*(PddlPropositionDto(SEEN, [each]) for each in (thing(TAXI, "t1"), RB1)))],
    "far below the root": [
        on("objects", "save_all", [thing(PddlTypeDto(name, parent=DEEP), name) for name in "ab"])
    ],
    "another type of an object": [
        *(on("objects", "save", RB1), on("objects", "save", thing(WAYPOINT, "rb1")))
    ],
    "a deleted object": [
        *(save(HERE), on("objects", "delete", WP1), on("objects", "save", WP1), save(HERE))
    ],
    "parameters": [on("predicates", "save_all", [RAINING.predicate, WIDE, NEAR, SEEN])],
    "the same definition": [
        *(save(HERE), on("predicates", "save", LOUD_AT), on("predicates", "save_all", [LOUD_AT])),
        Call("predicates", "update", (LOUD_AT,), cascade=True),
    ],
    "the last definition": [
        *(on("types", "save", VEHICLE), on("types", "save_all", Items([CAR, CAR, VEHICLE, TAXI]))),
        on("objects", "save_all", [RB1, WP1, RB1, thing(ROBOT, "wp1")]),
        on("predicates", "save_all", [ROBOT_AT, RAINING.predicate, ROBOT_AT, SWAPPED]),
    ],
    "facts that are there and that are not": [
        *(*facts("update", HERE), *READS, *facts("insert", HERE), *facts("update", THERE), *READS),
        *(*facts("insert", HERE), *facts("update", HERE, LOUD), *facts("insert", LOUD)),
        *facts("delete", GOAL, NO_ONE, MANY[9], PddlPropositionDto(ROBOT_AT, [RB1]), LOUD),
    ],
    "goals and other definitions": [
        *facts("insert", GOAL, GOAL, PddlPropositionDto(SWAPPED, [RB1, WP1], is_goal=True), HERE),
        *facts("update", TURNED),
    ],
    "few arguments, and the same twice": [
        *(save(RAINING, RAINING), *facts("insert", RAINING), *facts("delete", RAINING)),
        *(save(*OF_TWO.values()), *facts("delete", *OF_TWO.values()), save(*OF_TWO.values())),
        on("objects", "delete", WP2),
    ],
    "subtypes and supertypes": [
        save(PddlPropositionDto(ROBOT_AT, [thing(TIAGO, "tiago1"), WP1])),
        save(PddlPropositionDto(ROBOT_AT, [thing(PddlTypeDto("machine"), "m1"), WP1])),
    ],
    "all facts, and all goals": [*(save(HERE, GOAL, RAINING), *[NONE] * 2)],
    "actions that are there and that are not": [
        *(on("actions", "update", navigation()), *READS, on("actions", "insert", navigation())),
        *(on("actions", "insert", PddlActionDto("NAVIGATION")), NAVIGATION),
        *(on("actions", "save_all", [navigation()] * 2), on("actions", "update", OTHERS[5])),
    ],
    "actions of every shape": [save(HERE), *(on("actions", "save", each) for each in SHAPES)],
    "actions of every shape together": [
        *(save(HERE), on("actions", "save_all", SHAPES[:-1]), on("actions", "delete_all"))
    ],
    "times of literals": [on("actions", "save", action) for action in TIMES],
    "names of parameters": [on("actions", "save", renamed(name)) for name in ("r", "bot")],
    "what changes in an action": [
        *(on("actions", "save_all", [each]) for other in OTHERS for each in (navigation(), other))
    ],
    "a parameter called like an object": [
        *(on("objects", "save", thing(WAYPOINT, "r")), NAVIGATION),
        on("objects", "delete", thing(WAYPOINT, "r")),
    ],
    **{
        f"{kind} that something depends on": [
            *(*DEPENDING, Call(kind, "save", (other,)), Call(kind, "update", (other,))),
            *(Call(kind, "save", (other,), cascade=True), *DEPENDING, on(kind, "delete", called)),
            *(*DEPENDING, on(kind, "delete_all"), on(kind, "delete_all"), *DEPENDING),
            Call(kind, "update", (other,), cascade=True),
        ]
        for kind, (other, called) in DEPENDED.items()
    },
    # What many leave behind.
    "undone": [
        *(WORLD, undone(on("types", "delete_all"), save(LATER))),
        undone(on("types", "delete_all"), *READS, save(LATER), *READS),
    ],
    **{f"{kind} come and go": come_and_go(kind, each) for kind, each in ELEMENTS.items()},
    "coming and going beside another change": [
        WORLD,
        Block([GONE, save(THERE), READ, save(HERE), *facts("delete", THERE), READ, save(GOAL)]),
        *facts("insert", HERE, THERE),
    ],
    **{f"created otherwise, {name}": redefined(CREATED, each) for name, each in BETWEEN.items()},
    **{f"changed and back, {name}": redefined(CHANGED, each) for name, each in BETWEEN.items()},
    "redefined often": [WORLD, Block([*DURATIONS, *READS, NAVIGATION, *READS])],
    **{
        f"levels, {read}": [WORLD, levels(read), on("objects", "insert", waypoint(4))]
        for read in range(4)
    },
    "a sibling that fails": [
        WORLD,
        Block([Block([save(THERE), *READS]), undone(NONE, *READS), Block([GONE])]),
    ],
    "after some that failed": [
        WORLD,
        *[undone(undone(GONE, *READS))] * 3,
        *(GONE, *facts("insert", HERE)),
    ],
    "more after a spill": [
        save(HERE, ONE, TWO),
        Block(
            [
                *(GONE, *facts("delete", ONE), save(*MANY), *facts("delete", THREE, FOUR)),
                *(*facts("insert", FOUR, FOUR), *facts("delete", TWO), *facts("insert", HERE)),
                *(save(THREE, MANY[5]), *facts("delete", THREE)),
            ]
        ),
    ],
    "a spill taken back": [
        *(save(ONE, TWO), on("objects", "save_all", [*map(waypoint, range(12))])),
        *[Block([save(*MANY), NONE, save(ONE, TWO)])] * 2,
        *(save(*MANY), *facts("delete", ONE)),
    ],
    "a nested spill undone": [
        save(HERE, ONE, TWO),
        Block(
            [
                *(*facts("save", THREE), *facts("delete", ONE)),
                *[undone(save(*MANY), *facts("delete", TWO), undone(NONE, save(*MANY[:5])), READ)]
                * 2,
                *(READ, breaking(*MANY), *facts("insert", THREE, ONE), *facts("delete", TWO)),
            ]
        ),
        *facts("insert", MANY[7]),
    ],
    "a spill undone": [
        save(ONE, TWO),
        *[undone(save(*MANY), *facts("delete", ONE))] * 2,
        *facts("insert", ONE, THREE),
    ],
    "definitions around a spill": [
        save(HERE),
        Block(
            [
                *(on("types", "save", OTHER), on("objects", "delete", WP1), save(*MANY)),
                *(on("predicates", "delete", NEAR), on("predicates", "save", NARROW)),
                *(save(*NARROWS), on("types", "delete", OTHER), on("types", "save", PLACE)),
            ]
        ),
    ],
    "facts and goals": [
        *(save(*MIXED), on("predicates", "delete", PddlPredicateDto("p0")), save(*MIXED[::-1]))
    ],
    "one bad fact": [
        save(HERE, ONE),
        *(save(*MANY[:place], bad, *MANY[place:]) for place in (0, 5, 11) for bad in BAD),
        *(breaking(*MANY[:5]), breaking(*map(waypoint, range(10)), dao="objects")),
        save(ONE, SHOUTED, *MANY, *MANY[::-1]),
    ],
    **{f"refused: {name}": refused(call) for name, call in REFUSED.items()},
}


@pytest.mark.parametrize("is_tight", [False, True], ids=["loose", "tight"])
@pytest.mark.parametrize("steps", PROGRAMS.values(), ids=PROGRAMS)
def test_a_program_has_the_results_of_the_model(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, steps: list[Step], is_tight: bool
) -> None:
    for name, value in TIGHT.items() if is_tight else ():
        monkeypatch.setattr(name, value)
    check([fresh_kb], Program([(0, step) for step in steps], is_tight))
