"""How many Python functions a call of the library runs at most.

Times need a quiet machine to show that a call became a tenth slower; these numbers never vary.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import cycle
from types import FrameType

import pytest

from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.adding import DOMAIN
from tests.support.stores import Connect

FACTS = 20


@pytest.fixture
def kb(file_url: str, connect: Connect) -> KnowledgeBase:
    """A knowledge base in which a robot is at one of two places, and others are parked."""
    kb = connect(file_url)
    kb.load_domain(DOMAIN)
    robots = [f"rb{number} - robot" for number in range(FACTS)]
    kb.objects.save([*robots, "hall - place", "ward - place"])
    kb.propositions.save([f"(at rb{number} hall)" for number in range(FACTS)])
    return kb


def calls(work: Callable[[], object]) -> int:
    """Count the functions that warm work runs: the least, as now and then something is due."""

    def once() -> int:
        count = 0

        def note(_: FrameType, event: str, __: object) -> None:
            nonlocal count
            count += event == "call"

        sys.setprofile(note)
        try:
            work()
        finally:
            sys.setprofile(None)
        return count

    return min(once() for _ in range(10))


def test_a_write_runs_few_functions(kb: KnowledgeBase) -> None:
    robot, place = PddlTypeDto("robot"), PddlTypeDto("place")
    objects = [PddlObjectDto(robot, "rb1"), PddlObjectDto(place, "hall")]
    given = PddlPropositionDto(PddlPredicateDto("at", [robot, place]), objects)

    def work() -> None:
        kb.propositions.delete(given)
        kb.propositions.save(given)

    assert calls(work) <= 335


def test_a_write_by_text_runs_few_functions(kb: KnowledgeBase) -> None:
    def work() -> None:
        kb.propositions.delete("(at rb1 hall)")
        kb.propositions.save("(at rb1 hall)")

    assert calls(work) <= 480


def test_a_read_runs_few_functions(kb: KnowledgeBase) -> None:
    assert calls(lambda: kb.holds("(at rb1 hall)")) <= 60
    few, many = calls(kb.types.get_all), calls(kb.propositions.get_all)
    assert few <= 60
    assert many <= few + 8 * FACTS


def test_an_act_runs_few_functions(kb: KnowledgeBase) -> None:
    steps = cycle(["(move rb0 hall ward)", "(move rb0 ward hall)"])
    assert calls(lambda: kb.apply(next(steps))) <= 275
