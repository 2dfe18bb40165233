"""Every public callable is called with junk: only errors of the library come of it.

The profile `long` makes all calls, some tens of thousands, instead of a sample.
"""

from __future__ import annotations

import asyncio
import inspect
import itertools
import random
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from kant_sql import (
    KantSqlError,
    KnowledgeBase,
    NoPlanError,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    aio,
)
from kant_sql.errors import InvalidKnowledgeError, InvalidTimeoutError, PlanError, UnknownNameError
from kant_sql.planning import solving
from tests.support.generators.junk import SLOW, Calling, Case, World, cases, sample, signature
from tests.support.parts import part
from tests.support.profile import PROFILE
from tests.support.stores import Connect


def test_only_errors_of_the_library_come_of_nonsense(
    url: str, connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A backup may have any name.
    monkeypatch.chdir(tmp_path)
    numbers = iter(range(1_000_000))

    def make() -> World:
        return World(connect(url, knowledge_base=f"robot {next(numbers)}", actor="test"), tmp_path)

    calling = Calling(make)
    found = cases(make())
    assert len(found) > 10_000
    # No planner is started: what is wrong is refused before.
    refused = NoPlanError("no planner here", "internal_error")
    with mock.patch.object(solving, "_race", side_effect=refused):
        for case in sample(found, PROFILE.junk, seed=8):
            calling.call(case)
    assert calling.faults == [], "\n".join(calling.faults)


WATCHING = ("watch", "watch_rules")


def asynchronous_cases(world: World) -> list[Case]:
    """Choose calls of the asynchronous front door: some for each parameter that must be given."""
    chooser, found = random.Random(8), []
    known = [case for case in cases(world) if case.owner.startswith("kb") and case.parameter]
    for of, own in itertools.groupby(known, key=lambda case: (case.owner, case.method)):
        taken = signature(getattr(world.subjects()[of[0]](), of[1]))
        names = {one.name: one.default is one.empty for one in taken}
        given = {name for name, is_asked in names.items() if is_asked}
        quick = [case for case in own if case.junk not in SLOW]
        for name in sorted(given | {"reason", "limit", "timeout", "after"} & {*names}):
            found += chooser.sample([case for case in quick if case.parameter == name], 3)
    # An infinite timeout is none, and those who watch wait.
    return [case for case in found if not (case.method in WATCHING and case.junk == "inf")]


async def use(made: Any) -> None:
    """Use what an asynchronous call gives."""
    if inspect.isawaitable(made):
        await made
    elif hasattr(made, "__aenter__"):
        async with made:
            pass
    else:
        await anext(made, None)


async def test_the_asynchronous_front_door_refuses_nonsense(
    tmp_path: Path, connect: Connect
) -> None:
    where: dict[str, Any] = {"knowledge_base": "tiago", "actor": "test"}
    url = f"sqlite:///{tmp_path / 'nonsense.db'}"
    world = World(connect(url, **where), tmp_path)
    calling = Calling(lambda: world)

    async def call(kb: aio.AsyncKnowledgeBase, case: Case) -> None:
        taken = signature(getattr(world.subjects()[case.owner](), case.method))
        positional, keywords = calling.arguments(case, taken)
        path = case.owner.removeprefix("kb").lstrip(".")
        await use(getattr(part(kb, path), case.method)(*positional, **keywords))

    with mock.patch.object(solving, "_race", side_effect=NoPlanError("none", "internal_error")):
        async with aio.connect(url, **where) as kb:
            found = asynchronous_cases(world)
            assert len(found) > 300
            for case in found:
                before = world.kb.revision
                try:
                    await asyncio.wait_for(call(kb, case), 20)
                except KantSqlError as error:
                    calling._judge_error(case, error)
                except Exception as error:
                    calling._judge_other(case, error)
                calling._check_store(case, before)
    assert calling.faults == [], "\n".join(calling.faults)


@pytest.mark.parametrize(
    "timeout",
    [-1, -0.5, float("nan"), float("-inf"), "soon", True, [], object()],
    ids=lambda value: type(value).__name__,
)
def test_a_planner_is_given_a_sensible_time(timeout: float, connect: Connect) -> None:
    kb = connect("sqlite://", knowledge_base="tiago", actor="test")
    kb.load_domain("(define (domain d) (:predicates (p)))")
    kb.load_problem("(define (problem e) (:domain d) (:goal (p)))")
    with (
        mock.patch.object(solving, "_race", side_effect=AssertionError("a planner was started")),
        pytest.raises(InvalidTimeoutError),
    ):
        kb.plan(timeout=timeout)


MANY = f"(p {' '.join(f'a{n}' for n in range(900))})"


@pytest.mark.parametrize("text", ["(" * 500 + "p" + ")" * 500, MANY, f"(= {MANY} 3)"])
def test_hostile_elements_are_refused(fresh_kb: KnowledgeBase, text: str) -> None:
    fresh_kb.predicates.save(PddlPredicateDto("p", []))
    for ask in (fresh_kb.history, fresh_kb.blame, lambda text: [*fresh_kb.log(element=text)]):
        with pytest.raises((InvalidKnowledgeError, UnknownNameError)):
            ask(text)


def test_what_is_nested_or_wide_is_found(fresh_kb: KnowledgeBase) -> None:
    kind = PddlTypeDto("t")
    wide = PddlPredicateDto("wide", [kind] * 100)
    fresh_kb.propositions.save(
        PddlPropositionDto(wide, [PddlObjectDto(kind, f"a{n}") for n in range(100)])
    )
    names = " ".join(f"a{n}" for n in range(100))
    for text in (f"(wide {names})", "(and " * 500 + f"(wide {names})" + ")" * 500):
        assert [one.text for one in fresh_kb.history(text)] == [f"(wide {names})"]
        assert fresh_kb.blame(text) is not None
        assert len([*fresh_kb.log(element=text)]) == 1


def test_numbers_beyond_all_bounds(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.predicates.save(PddlPredicateDto("p", []))
    assert [one.name for one in fresh_kb.pddl.complete("p", limit=2**64)] == ["p"]
    assert [*fresh_kb.query("(p)", limit=2**64)] == []
    assert [*fresh_kb.applicable_actions(limit=2**64)] == []
    anything: Any = fresh_kb
    for step in (10**5000, [10**5000]):
        with pytest.raises(PlanError, match="an integer of 16610 bits"):
            anything.apply(step)


def test_messages_are_bounded_and_can_be_written(fresh_kb: KnowledgeBase) -> None:
    for text in (f"({'x' * 50_000})", "(p \ud800)", "(\ud800)"):
        for ask in (fresh_kb.holds, fresh_kb.when, fresh_kb.apply):
            with pytest.raises(KantSqlError) as caught:
                ask(text)
            assert len(str(caught.value).encode()) <= 2_000
    with pytest.raises(KantSqlError) as caught:
        fresh_kb.pddl.check_rules("(always (\ud800))")
    assert "\\ud800" in str(caught.value)
