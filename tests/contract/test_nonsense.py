"""Every public callable is called with junk: only errors of the library come of it.

The profile `long` makes all calls, some tens of thousands, instead of a sample.
"""

from __future__ import annotations

import asyncio
import inspect
import math
import random
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

import kant_sql
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
from tests.support.generators.junk import JUNK, SLOW, Calling, Case, World, cases, sample
from tests.support.parts import PATHS, part
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


def asynchronous_cases(kb: aio.AsyncKnowledgeBase) -> list[Case]:
    """List the public calls of the asynchronous front door, each with a few kinds of junk."""
    chooser, quick = random.Random(8), sorted(set(JUNK) - SLOW)
    found = []
    for path in PATHS:
        owner, thing = f"kb.{path}".rstrip("."), part(kb, path)
        for name in dir(type(thing)):
            is_part = f"{path}.{name}".lstrip(".") in PATHS
            if not (name.startswith("_") or is_part or name in ("close", "factory")):
                found += [Case(owner, name, None, junk) for junk in chooser.sample(quick, 3)]
    return found


WATCHING = ("watch", "watch_rules")


async def asynchronous_call(kb: aio.AsyncKnowledgeBase, case: Case) -> None:
    """Call with junk where the synchronous method has its first parameter, and use the answer."""
    thing = part(kb, case.owner[3:])
    given = one_argument(kb, case)
    # What stands before keywords has no name to be given by.
    many = [given.pop(name) for name in POSITIONAL_ONLY if name in given and is_unnamed(kb, case)]
    many += [JUNK[case.junk]()] if case.method == "load_domain" else []
    made = getattr(thing, case.method)(
        *many,
        **({"reason": JUNK[case.junk]()} if case.method == "transaction" else {}),
        **({"limit": JUNK[case.junk]()} if case.method in ("log", "revisions") else {}),
        **({"timeout": JUNK[case.junk]()} if case.method in ("plan", *WATCHING) else {}),
        **({"after": JUNK[case.junk]()} if case.method == "changes" else {}),
        **given,
    )
    if inspect.isawaitable(made):
        await made
    elif hasattr(made, "__aenter__"):
        async with made:
            pass
    else:
        await anext(made, None)


POSITIONAL_ONLY = ("condition",)


def is_unnamed(kb: aio.AsyncKnowledgeBase, case: Case) -> bool:
    """Whether the first parameter is given by position alone."""
    parameters = list(inspect.signature(getattr(type(kb._kb), case.method)).parameters.values())
    return len(parameters) > 1 and parameters[1].kind is inspect.Parameter.POSITIONAL_ONLY


def one_argument(kb: aio.AsyncKnowledgeBase, case: Case) -> dict[str, object]:
    """Give junk for each parameter that must be given."""
    thing = part(kb._kb, case.owner[3:])
    found = getattr(type(thing), case.method)
    if not callable(found):
        return {}
    parameters = list(inspect.signature(found).parameters.values())[1:]
    return {
        parameter.name: JUNK[case.junk]()
        for parameter in parameters
        if parameter.default is parameter.empty
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    }


def test_the_asynchronous_front_door_refuses_nonsense(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'nonsense.db'}"
    with kant_sql.connect(url, knowledge_base="tiago", actor="test") as kb:
        calling = Calling(lambda: World(kb, tmp_path))

        async def main() -> None:
            async with aio.connect(url, knowledge_base="tiago", actor="test") as asynchronous:
                found = asynchronous_cases(asynchronous)
                assert len(found) > 300
                for case in found:
                    # An infinite timeout is none, and those who watch wait.
                    if case.method in WATCHING and JUNK[case.junk]() == math.inf:
                        continue
                    try:
                        await asyncio.wait_for(asynchronous_call(asynchronous, case), 20)
                    except kant_sql.KantSqlError as error:
                        calling._judge_error(case, error)
                    except Exception as error:
                        calling._judge_other(case, error)
                assert (await asynchronous.store.verify()).is_intact

        with mock.patch.object(solving, "_race", side_effect=NoPlanError("none", "internal_error")):
            asyncio.run(main())
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
