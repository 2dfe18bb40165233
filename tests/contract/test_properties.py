"""Any sequence of calls has the same results on every backend as on a plain model of the rules.

KANT_SQL_TEST_EXAMPLES=5000 hunts for longer, each time from another seed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import given

from kant_sql import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.generators.programs import Block, Call, Items, Program, Step, check, programs
from tests.support.profile import PROFILE, hunting
from tests.support.stores import Everywhere
from tests.support.worlds.depot import again
from tests.support.worlds.robots import (
    RB1,
    ROBOT,
    ROBOT_AT,
    WAYPOINT,
    WP1,
    WP2,
    navigation,
    robot_at,
)

# What is meant for large amounts, and how little of it the programs have.
TIGHT = {
    "kant_sql.store.transaction.SPILL_AT": 1,
    "kant_sql.store.caches.CACHED_ATOMS": 1,
    "kant_sql.dao.base.BATCH": 2,
    "kant_sql.store.caches.CACHED_PASTS": 1,
    "kant_sql.history.log.LOG_PAGE": 2,
    "kant_sql.sql.dialects.sqlite.FETCH_SIZE": 1,
    "kant_sql.sql.dialects.postgresql.COPY_FROM_ROWS": 2,
}


@contextmanager
def tight(program: Program) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in TIGHT.items() if program.is_tight else ():
            patch.setattr(name, value)
        yield


def check_everywhere(everywhere: Everywhere, program: Program) -> None:
    with tight(program):
        everywhere(lambda kb: check([again(kb), again(kb)], program))


NAMELESS = PddlObjectDto(ROBOT, "\ud800")
UNKNOWN_ABOVE = PddlTypeDto("wp", parent=PddlTypeDto("place", parent=PddlTypeDto("thing")))
ACROSS = PddlPropositionDto(PddlPredicateDto("robot_at", [WAYPOINT]), [RB1, WP1])
STAY = PddlActionDto("stay", [], [PddlConditionEffectDto(ROBOT_AT, [RB1, WP1], "at start")])
NEAR_IT = PddlConditionEffectDto(
    PddlPredicateDto("near", [WAYPOINT]), [PddlObjectDto(UNKNOWN_ABOVE, "wp1")], "at start"
)


def save(*dtos: Any) -> Call:
    return Call("propositions", "save_all", (Items([*dtos]),))


def on(dao: str, method: str, *arguments: Any) -> Call:
    return Call(dao, method, arguments)


READ = on("propositions", "get_all")
HERE, THERE = robot_at(), robot_at(place=WP2)

# Each of these once had other results, or lost a write.
REGRESSIONS: dict[str, list[Step]] = {
    "retracted, read and asserted again": [
        save(HERE),
        Block([on("propositions", "delete", HERE), READ, save(HERE)]),
        on("propositions", "delete", HERE),
    ],
    "asserted, read and retracted again": [
        save(HERE),
        on("objects", "save", WP2),
        Block([save(THERE), READ, on("propositions", "delete", THERE)]),
        # Now another one has its id.
        save(robot_at(is_goal=True)),
        save(THERE),
    ],
    "retracted and asserted around a spill": [
        save(HERE),
        Block([on("propositions", "delete", HERE), save(THERE), save(HERE)]),
    ],
    "actions with parameters after one without": [
        save(HERE),
        on("actions", "save_all", [STAY, navigation()]),
    ],
    "names that no driver sends": [
        on("objects", "save_all", [NAMELESS]),
        save(robot_at(NAMELESS), HERE),
        on("types", "save_all", [PddlTypeDto("a\0b")]),
    ],
    "a grandparent that is not the stored one": [
        on("types", "save", PddlTypeDto("wp", parent=PddlTypeDto("place"))),
        on("objects", "save", PddlObjectDto(UNKNOWN_ABOVE, "wp1")),
    ],
    "a term's type with a parent that is not the stored one": [
        on("actions", "save", PddlActionDto("stay", [WP1], [NEAR_IT]))
    ],
    "what holds, with another definition of its predicate": [
        save(HERE),
        on("propositions", "insert", ACROSS),
        on("propositions", "update", ACROSS),
    ],
}


@pytest.mark.parametrize("is_tight", [False, True], ids=["loose", "tight"])
@pytest.mark.parametrize("steps", REGRESSIONS.values(), ids=REGRESSIONS)
def test_a_program_that_once_failed(
    everywhere: Everywhere, steps: list[Step], is_tight: bool
) -> None:
    check_everywhere(everywhere, Program([(0, step) for step in steps], is_tight))


def test_any_program_has_the_results_of_the_model(everywhere: Everywhere) -> None:
    @hunting(PROFILE.programs)
    @given(programs())
    def holds_for(program: Program) -> None:
        check_everywhere(everywhere, program)

    holds_for()
