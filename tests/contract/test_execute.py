"""Whole plans are executed: in their order, side by side, until a step fails, whoever breaks it."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import CancelledError
from contextlib import asynccontextmanager
from multiprocessing import get_context
from pathlib import Path
from threading import Event
from typing import Any

import pytest

import kant_sql
from kant_sql import ExecutedPlan, Execution, KnowledgeBase, Plan, PlanStep, aio
from kant_sql.errors import (
    InvalidArgumentError,
    InvalidTimeoutError,
    PddlError,
    PlanError,
    ReadOnlyError,
    TransactionOpenError,
)
from kant_sql.reasoning import Step, execute
from kant_sql.reasoning.durative import BrokenInvariant, end_running, find_broken
from tests.support.reading import as_actor, loaded, nothing_changes, present
from tests.support.stores import Connect

DOMAIN = """
(define (domain ward) (:requirements :typing :durative-actions) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (lit ?p - place) (moving ?r - robot) (clean ?p - place))
  (:action switch :parameters (?p - place) :precondition (not (lit ?p)) :effect (lit ?p))
  (:durative-action move :parameters (?r - robot ?a ?b - place) :duration (= ?duration 5)
    :condition (and (at start (at ?r ?a)) (over all (lit ?b)))
    :effect (and (at start (not (at ?r ?a))) (at start (moving ?r))
      (at end (not (moving ?r))) (at end (at ?r ?b))))
  (:durative-action clean :parameters (?p - place) :duration (= ?duration 4)
    :effect (at end (clean ?p))))
"""
PROBLEM = """
(define (problem night) (:domain ward) (:objects r1 r2 - robot hall room - place)
  (:init (at r1 hall) (at r2 hall) (lit hall)) (:goal (at r1 room)))
"""
PLAN = """
0: (switch room)
0.01: (move r1 hall room) [5]
0.01: (clean hall) [4]
5.02: (clean room) [4]
"""
FAST = 1000.0
# What waits longer than this fails the test; a process may take long to start.
LONG = 90


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A ward with two robots in the hall."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def outcomes(found: ExecutedPlan) -> list[str | None]:
    return [step.outcome for step in found.plan.steps]


def do_nothing(step: Execution) -> None:
    pass


def test_steps_run_in_their_order_and_side_by_side(kb: KnowledgeBase) -> None:
    both = threading.Barrier(2, timeout=LONG)
    done: list[str] = []

    def dispatch(step: Execution) -> str:
        assert present(kb.executions.get(step.id)).outcome == "running"
        if str(step) in ("(move r1 hall room)", "(clean hall)"):
            both.wait()
        assert kb.holds("(moving r1)") == (str(step) == "(move r1 hall room)") or "hall" in str(
            step
        )
        done.append(str(step))
        return "whatever"

    found = kb.execute(PLAN, dispatch, speed=FAST, reason="the nurse called")
    assert (found.outcome, found.step, found.unsatisfied) == ("succeeded", None, ())
    assert str(found) == f"plan {found.plan.id} succeeded, 4 of 4 steps done"
    assert (done[0], {*done[1:3]}, done[3]) == (
        "(switch room)",
        {"(move r1 hall room)", "(clean hall)"},
        "(clean room)",
    )
    assert kb.holds("(and (at r1 room) (lit room) (clean hall) (clean room) (not (moving r1)))")
    assert {step.reason for step in found.plan.steps} == {"the nurse called"}
    assert found.plan == kb.plans.get(found.plan.id)
    assert kb.store.verify().is_intact


def test_a_step_begins_when_its_time_has_come(kb: KnowledgeBase) -> None:
    begun: list[float] = []
    zero = time.monotonic()
    steps: list[Step] = [PlanStep(None, "switch", ("room",)), "(clean room)"]
    kb.execute(steps, lambda step: begun.append(time.monotonic() - zero))
    kb.execute("0: (clean hall) [4]\n40: (clean room) [4]\n", do_nothing, speed=200)
    assert begun[1] >= begun[0]
    assert time.monotonic() - zero >= 40 / 200
    # A plan that goes on does so at once, with what is left.
    plan = kb.plans.record(Plan.read("0: (clean hall) [4]\n5000: (clean room) [4]\n"))
    kb.apply(plan.steps[0])
    found = kb.execute(plan.id, do_nothing)
    assert outcomes(found) == ["succeeded"] * 2


class BumpError(Exception):
    """An error with a code of its own."""

    code = "E4"


class MuteError(Exception):
    """An error that cannot say what it is."""

    def __str__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize(
    ("how", "outcome", "code", "text"),
    [
        (SystemExit(3), "failed", "3", "3"),
        (KeyboardInterrupt(), "failed", "KeyboardInterrupt", None),
        (MuteError(), "failed", "MuteError", None),
        (ValueError("half \0 of \ud800"), "failed", "ValueError", "half \ufffd of \ufffd"),
        (BumpError("a chair"), "failed", "E4", "a chair"),
        (ValueError(), "failed", "ValueError", None),
        (CancelledError(), "aborted", None, None),
        (False, "failed", None, "dispatch returned False"),
    ],
)
def test_a_step_that_fails_ends_the_plan(
    kb: KnowledgeBase, how: BaseException | bool, outcome: str, code: str | None, text: str | None
) -> None:
    running, called_off = Event(), Event()

    def dispatch(step: Execution) -> bool | None:
        if step.action == "move":
            assert running.wait(LONG)
            if isinstance(how, BaseException):
                raise how
            return how
        if step.action == "clean":
            running.set()
            assert called_off.wait(LONG)
        return None

    found = kb.execute(PLAN, dispatch, cancel=lambda step: called_off.set(), speed=FAST)
    assert outcomes(found) == ["succeeded", outcome, "aborted", None]
    assert found.step == found.plan.steps[1]
    assert (found.outcome, found.step.code, found.step.text) == (outcome, code, text)
    aborted = found.plan.steps[2]
    assert aborted.text == "(move r1 hall room) did not succeed"
    assert aborted.revision == found.step.revision == kb.revision
    # What its start changed stays; nothing else was written.
    assert kb.holds("(and (moving r1) (not (at r1 room)) (not (clean hall)))")
    with pytest.raises(PlanError, match=f"is {outcome}; only steps that were not begun"):
        kb.execute(found.plan, dispatch)
    assert kb.store.verify().is_intact


def test_an_invariant_that_another_breaks_is_found_while_the_step_runs(kb: KnowledgeBase) -> None:
    running, called_off = Event(), Event()
    calls: list[str] = []

    def dispatch(step: Execution) -> None:
        if step.action == "move":
            running.set()
            assert called_off.wait(LONG)

    def cancel(step: Execution) -> None:
        calls.append(str(step))
        called_off.set()

    def interfere() -> None:
        assert running.wait(LONG)
        as_actor(kb, "nurse").propositions.delete("(lit room)")

    other = threading.Thread(target=interfere)
    other.start()
    found = kb.execute("(switch room)\n(move r1 hall room)", dispatch, cancel=cancel)
    other.join()
    assert calls == ["(move r1 hall room)"]
    assert found.step == found.plan.steps[1]
    [broken] = found.unsatisfied
    assert broken.since is not None
    assert (broken.unsatisfied.condition, broken.since.actor) == ("(lit room)", "nurse")
    assert found.step.text == str(broken).removeprefix("(move r1 hall room): ")
    assert str(found).endswith(f"since revision {broken.since.number} by nurse")


def test_an_invariant_that_is_broken_and_mended_fails_the_step(kb: KnowledgeBase) -> None:
    def flicker(step: Execution) -> None:
        if step.action == "move":
            as_actor(kb, "nurse").propositions.delete("(lit room)")
            kb.propositions.save("(lit room)")

    found = kb.execute("(switch room)\n(move r1 hall room)", flicker)
    assert outcomes(found) == ["succeeded", "failed"]
    [broken] = found.unsatisfied
    assert (broken.unsatisfied.condition, kb.holds("(lit room)")) == ("(lit room)", True)
    assert present(broken.since).actor == "nurse"


def test_an_invariant_that_is_broken_and_mended_in_the_last_moment_fails_the_step(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raced(*given: Any, **how: Any) -> Execution:
        as_actor(kb, "nurse").propositions.delete("(lit room)")
        kb.propositions.save("(lit room)")
        return end_running(*given, **how)

    monkeypatch.setattr(execute, "end_running", raced)
    found = kb.execute("(switch room)\n(move r1 hall room)", do_nothing)
    assert outcomes(found) == ["succeeded", "failed"]
    [broken] = found.unsatisfied
    assert (present(broken.since).actor, kb.holds("(at r1 room)")) == ("nurse", False)


@pytest.mark.parametrize("breaks", [False, True])
def test_confirmations_are_passed_over(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, breaks: bool
) -> None:
    camera, written, looked = as_actor(kb, "nurse"), Event(), list[int | None]()

    def find(store: Any, running: Any, at: int | None = None) -> list[BrokenInvariant]:
        assert written.wait(LONG)
        looked.append(at)
        return find_broken(store, running, at)

    def dispatch(step: Execution) -> None:
        for number in range(30):
            if breaks and number == 15:
                camera.propositions.delete("(lit hall)")
                camera.propositions.save("(lit hall)")
            camera.propositions.confirm("(lit hall)")
        written.set()

    monkeypatch.setattr(execute, "find_broken", find)
    found = kb.execute("(move r1 hall hall)", dispatch)
    assert (outcomes(found), len(looked) < 15) == (["failed" if breaks else "succeeded"], True)


def test_a_condition_is_waited_for_and_refused_in_the_end(kb: KnowledgeBase) -> None:
    start = time.monotonic()
    found = kb.execute("(move r1 hall room)", do_nothing, timeout=0.2)
    assert time.monotonic() - start >= 0.2
    assert (found.outcome, outcomes(found)) == ("refused", [None])
    assert found.step is not None
    assert found.step.text == "(lit room): does not hold right after the start"
    assert kb.executions.get(found.step.id) == found.step
    other = threading.Timer(0.1, lambda: as_actor(kb, "nurse").propositions.save("(lit room)"))
    other.start()
    # It is not done, so it can be executed yet.
    found = kb.execute(found.plan.id, do_nothing, timeout=LONG)
    other.join()
    assert outcomes(found) == ["succeeded"]


def test_a_duration_that_no_state_allows_is_broken_by_nobody(kb: KnowledgeBase) -> None:
    found = kb.execute("0: (clean hall) [9]", do_nothing)
    said = "(= ?duration 4): the sides are 9 and 4; a duration may deviate by 0.01"
    assert (present(found.step).text, found.unsatisfied[0].since) == (said, None)


def test_a_condition_at_the_end_that_does_not_hold_fails_the_step(kb: KnowledgeBase) -> None:
    # The step without duration is judged again when it is done.
    found = kb.execute("(switch room)", lambda step: kb.propositions.save("(lit room)"))
    assert found.outcome == "failed"
    assert found.step is not None
    assert str(found.step.text).startswith("(not (lit room)): does not hold, since revision")


def test_a_step_whose_effects_a_rule_refuses_ends_the_plan(kb: KnowledgeBase) -> None:
    kb.rules.save("dirty", "(always (not (clean hall)))", on_violation="refuse")
    said = "(always (not (clean hall))): rule 'dirty' refuses the effects"
    found = kb.execute("(clean room)\n(clean hall)\n(switch room)", do_nothing)
    assert outcomes(found) == ["succeeded", "failed", None]
    assert (present(found.step).text, found.unsatisfied[0].since) == (said, None)
    kb.rules.save("dark", "(always (imply (lit room) (clean hall)))", on_violation="refuse")
    kb.rules.save("still", "(always (not (moving r1)))", on_violation="refuse")
    found = kb.execute("(move r1 hall hall)", do_nothing)
    assert (found.outcome, outcomes(found)) == ("refused", [None])


@pytest.mark.parametrize("name", ["hall", "clean"])
def test_a_step_whose_names_are_gone_fails(kb: KnowledgeBase, name: str) -> None:
    def delete(step: Execution) -> None:
        assert kb.objects.delete(name) or kb.actions.delete(name)

    found = kb.execute("(clean hall)\n(clean room)", delete)
    assert (found.outcome, outcomes(found)) == ("failed", ["failed", None])
    assert (f"{name!r}" in str(found), found.unsatisfied[0].since) == (True, None)
    assert kb.pddl.broken_invariants() == []
    assert kb.store.verify().is_intact


def test_a_step_whose_names_are_gone_before_it_begins_is_refused(kb: KnowledgeBase) -> None:
    stop = Event()

    def delete(step: Execution) -> None:
        if str(step) == "(clean hall)":
            assert kb.objects.delete("room")
        else:
            assert stop.wait(LONG)

    plan = "0: (clean hall) [4]\n0: (move r1 hall hall) [5]\n4.1: (clean room) [4]"
    found = kb.execute(plan, delete, cancel=lambda step: stop.set(), speed=FAST)
    assert (found.outcome, outcomes(found)) == ("refused", ["succeeded", "aborted", None])
    assert "'room'" in present(present(found.step).text)
    assert (str(found.step), found.unsatisfied[0].since) == ("(clean room)", None)
    assert kb.executions.get(present(found.step).id) == found.step
    refused = present(found.step)
    named = [one.execution for one in kb.store.revisions() if one.number == refused.revision]
    assert named == [(found.plan.id, 2)]
    assert kb.store.verify().is_intact


def test_a_step_whose_name_is_erased_goes_on(kb: KnowledgeBase) -> None:
    def erase(step: Execution) -> None:
        if "erased-1" not in str(step):
            kb.erase("room", reason="asked")

    found = kb.execute("(clean room)\n(switch room)", erase)
    assert outcomes(found) == ["succeeded"] * 2
    assert kb.holds("(and (clean erased-1) (lit erased-1))")


@pytest.fixture
def erased_before(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Let another writer erase a name right before a function reads."""

    def interfere(function: str) -> None:
        read = getattr(execute, function)

        def erased(*given: Any) -> Any:
            if kb.objects.get("room") is not None:
                as_actor(kb, "nurse").erase("room", reason="asked")
            return read(*given)

        monkeypatch.setattr(execute, function, erased)

    return interfere


@pytest.mark.parametrize("function", ["find_broken", "ground"])
def test_a_step_whose_name_is_erased_between_two_reads_goes_on(
    kb: KnowledgeBase, erased_before: Callable[[str], None], function: str
) -> None:
    erased_before(function)
    found = kb.execute("(clean room)\n(switch room)", do_nothing)
    assert outcomes(found) == ["succeeded"] * 2
    assert kb.holds("(and (clean erased-1) (lit erased-1))")


def test_a_step_whose_name_is_erased_while_it_is_refused_says_why(
    kb: KnowledgeBase, erased_before: Callable[[str], None]
) -> None:
    kb.propositions.save("(lit room)")
    erased_before("broken_since")
    found = kb.execute("(clean room)\n(switch room)", do_nothing)
    [broken] = found.unsatisfied
    assert str(broken.unsatisfied) == "(not (lit erased-1)): does not hold"
    assert present(broken.since).reason is None


def test_what_broke_before_an_archive_ends_the_plan(kb: KnowledgeBase, tmp_path: Path) -> None:
    running = kb.start("(move r1 hall hall)")
    kb.propositions.delete("(lit hall)")
    kb.propositions.save("(clean room)")
    kb.store.archive(kb.revision, to=f"sqlite:///{tmp_path / 'archive.db'}")
    found = kb.execute("(move r2 hall hall)", do_nothing)
    assert (found.outcome, outcomes(found)) == ("refused", [None])
    assert str(found.unsatisfied[0].unsatisfied).startswith("(lit hall): does not hold")
    [broken] = kb.pddl.broken_invariants()
    assert (broken.step.id, broken.since) == (running.id, None)
    kb.propositions.save("(lit hall)")
    as_actor(kb, "nurse").propositions.delete("(lit hall)")
    [broken] = kb.pddl.broken_invariants()
    assert present(broken.since).actor == "nurse"


def die(url: str) -> None:
    """Execute a plan in a process that is killed while its second step runs."""

    def dispatch(step: Execution) -> None:
        if step.action == "move":
            os.kill(os.getpid(), signal.SIGKILL)

    with kant_sql.connect(url, actor="executive") as kb:
        kb.execute(kb.plans.get_all()[0], dispatch)


def test_a_killed_process_leaves_what_ran_to_another(shared_url: str, connect: Connect) -> None:
    kb = loaded(connect(shared_url, actor="operator"), DOMAIN, PROBLEM)
    plan = kb.plans.record(Plan.read("(switch room)\n(move r1 hall room)\n(clean room)\n"))
    process = get_context("spawn").Process(target=die, args=(shared_url,))
    process.start()
    process.join(LONG)
    assert process.exitcode == -signal.SIGKILL
    steps = present(kb.plans.get(plan.id))
    assert [step.outcome for step in steps.steps] == ["succeeded", "running", None]
    [running] = kb.executions.get_all(outcome="running")
    assert (str(running), running.actor) == ("(move r1 hall room)", "executive")
    with (
        nothing_changes(kb),
        pytest.raises(PlanError, match="is running; only steps that were not begun"),
    ):
        kb.execute(plan.id, do_nothing)
    # The robot has arrived all the same.
    kb.end(running)
    assert outcomes(kb.execute(plan.id, do_nothing)) == ["succeeded"] * 3
    assert kb.store.verify().is_intact


def test_whoever_ends_a_step_ends_the_plan(kb: KnowledgeBase) -> None:
    found = kb.execute("(clean hall)\n(clean room)", kb.abort)
    assert (found.outcome, outcomes(found)) == ("aborted", ["aborted", None])
    found = kb.execute("(clean hall)\n(clean room)", lambda step: kb.fail(step, code="E7"))
    assert (found.outcome, present(found.step).code) == ("failed", "E7")
    assert kb.execute("(clean hall)", kb.end).outcome == "succeeded"
    found = kb.execute("(switch room)", kb.abort)
    assert (outcomes(found), kb.holds("(lit room)")) == (["aborted"], False)
    # One that another ends is noticed while it runs.
    stop = Event()

    def aborted(step: Execution) -> None:
        as_actor(kb, "nurse").executions.report(step, outcome="aborted")
        assert stop.wait(LONG)

    found = kb.execute("(clean hall)", aborted, cancel=lambda step: stop.set())
    assert found.outcome == "aborted"


def test_a_recorded_plan_goes_on_from_its_present_outcomes(kb: KnowledgeBase) -> None:
    plan = kb.plans.record(Plan.read("(switch room)\n(clean hall)"))
    kb.apply(plan.steps[0])
    assert outcomes(kb.execute(plan, do_nothing)) == ["succeeded"] * 2
    with kant_sql.connect("sqlite://") as other, pytest.raises(PlanError, match="another store"):
        other.execute(plan, do_nothing)


def test_a_step_that_another_ends_in_the_last_moment_is_done(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raced(*given: Any, **how: Any) -> Execution:
        end_running(*given, **how)
        return end_running(*given, **how)

    monkeypatch.setattr(execute, "end_running", raced)
    assert outcomes(kb.execute("(clean hall)\n(clean room)", do_nothing)) == ["succeeded"] * 2


def test_what_cannot_be_executed_is_refused_before_anything_is_written(kb: KnowledgeBase) -> None:
    with nothing_changes(kb):
        for plan, error in (("(fly r1)", PlanError), ("fly", PddlError), (99, PlanError)):
            with pytest.raises((error, OSError)):
                kb.execute(plan, do_nothing)
        wrong: list[dict[str, Any]] = [{"speed": 0}, {"speed": "1"}, {"timeout": -1}, {"cancel": 3}]
        for options in wrong:
            with pytest.raises((InvalidArgumentError, InvalidTimeoutError)):
                kb.execute("(switch room)", do_nothing, **options)
        with pytest.raises(InvalidArgumentError, match="dispatch"):
            kb.execute("(switch room)", None)  # type: ignore[arg-type]
        for coroutines in ({"dispatch": later}, {"dispatch": do_nothing, "cancel": later}):
            with pytest.raises(InvalidArgumentError, match="is a coroutine function"):
                kb.execute("(switch room)", **coroutines)
        with pytest.raises(ReadOnlyError):
            kb.at(1).execute("(switch room)", do_nothing)
    with pytest.raises((ReadOnlyError, TransactionOpenError)), kb.transaction():
        kb.execute("(switch room)", do_nothing)


def test_what_must_be_awaited_does_no_step(url: str) -> None:
    with kant_sql.connect(url) as kb:
        loaded(kb, DOMAIN, PROBLEM)
        found = kb.execute("(switch room)", lambda step: asyncio.sleep(0, step))
        assert found.outcome == "failed"
        assert "nobody awaits" in str(found)
        assert not kb.holds("(lit room)")


async def later(step: Execution) -> None:
    """Would have to be awaited."""


@asynccontextmanager
async def opened(url: str) -> AsyncIterator[aio.AsyncKnowledgeBase]:
    async with aio.connect(url, actor="executive") as kb, asyncio.timeout(LONG):
        await kb.load_domain(DOMAIN)
        await kb.load_problem(PROBLEM)
        yield kb


async def test_coroutines_are_dispatched_side_by_side_and_cancelled(url: str) -> None:
    ended: list[str] = []

    async with opened(url) as kb:
        moving = asyncio.Event()

        async def dispatch(step: Execution) -> None:
            try:
                if step.action == "move":
                    moving.set()
                    await asyncio.sleep(LONG)
                if str(step) == "(clean hall)":
                    await moving.wait()
                    raise BumpError("a chair")
            finally:
                ended.append(str(step))

        found = await kb.execute(PLAN, dispatch, speed=FAST)
        assert outcomes(found) == ["succeeded", "aborted", "failed", None]
        assert ended == ["(switch room)", "(clean hall)", "(move r1 hall room)"]


async def test_a_plan_is_cancelled_with_its_task(url: str) -> None:
    async with opened(url) as kb:
        with pytest.raises(InvalidArgumentError, match="cancel is a coroutine function"):
            await kb.execute("(clean hall)", do_nothing, cancel=later)
        running = asyncio.Event()

        async def dispatch(step: Execution) -> None:
            running.set()
            await asyncio.sleep(LONG)

        task = asyncio.create_task(kb.execute("(clean hall)\n(clean room)", dispatch))
        await running.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        [plan] = await kb.plans.get_all()
        assert [step.outcome for step in plan.steps] == ["aborted", None]
        assert plan.steps[0].text == "the plan was cancelled"
