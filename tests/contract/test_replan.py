"""A plan is kept while what is left of it works, and planned again when a change broke it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import kant_sql
from kant_sql import Execution, KnowledgeBase, Plan, RecordedPlan, aio
from kant_sql.documents.exchange import PlanningTask, read_task
from kant_sql.errors import (
    InvalidArgumentError,
    NoPlanError,
    PlanError,
    QuestionCancelledError,
    ReadOnlyError,
)
from kant_sql.knowledge_base import state_of
from kant_sql.reasoning import replan, search
from kant_sql.reasoning.execute import Executive
from kant_sql.reasoning.replan import Remaining
from kant_sql.store.state import State
from tests.support.profile import PROFILE, hunting
from tests.support.reading import as_actor, loaded, present, undone

HOUSE = """
(define (domain house) (:requirements :adl :durative-actions :fluents :derived-predicates)
  (:types room door)
  (:predicates (at ?r - room) (joins ?d - door ?a ?b - room) (open ?d - door) (lit ?r - room)
    (dark) (counted ?r - room))
  (:functions (battery) (visits ?r - room) (humidity))
  (:derived (dark) (forall (?r - room) (not (lit ?r))))
  (:action go :parameters (?a ?b - room ?d - door)
    :precondition (and (at ?a) (joins ?d ?a ?b) (open ?d) (>= (battery) 1))
    :effect (and (not (at ?a)) (at ?b) (decrease (battery) 1)
      (when (counted ?b) (increase (visits ?b) 1))))
  (:durative-action sweep :parameters (?r - room) :duration (= ?duration 5)
    :condition (and (at start (at ?r)) (over all (lit ?r)) (at end (> (battery) 0)))
    :effect (at end (assign (visits ?r) 3)))
  (:action leave :parameters () :precondition (not (dark))
    :effect (forall (?r - room) (not (lit ?r)))))
"""
TEA = """
(define (problem tea) (:domain house)
  (:objects hall kitchen yard office - room d1 d2 d3 d4 d5 - door)
  (:init (at hall) (= (battery) 9) (= (visits kitchen) 0) (= (visits hall) 0) (lit hall)
    (joins d1 hall kitchen) (joins d2 kitchen office) (joins d3 hall yard) (joins d4 yard office)
    (joins d5 kitchen hall) (open d1) (open d2) (open d3) (open d4) (open d5) (= (humidity) 5))
  (:goal (at office)))
"""
NEAR = "(go hall kitchen d1)\n(go kitchen office d2)\n"
FAR = "(go hall yard d3)\n(go yard office d4)\n"
BACK = "(go kitchen hall d5)\n" + FAR


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A robot in a house, on its way by `NEAR`, which is plan 1."""
    loaded(fresh_kb, HOUSE, TEA)
    fresh_kb.plans.record(Plan.read(NEAR))
    return fresh_kb


@pytest.fixture
def knows(tmp_path: Path) -> Callable[..., list[str]]:
    """Make planners that each know one plan; what is not valid is not taken."""

    def make(*plans: str) -> list[str]:
        engines = []
        for number, plan in enumerate(plans):
            (tmp_path / f"{number}.plan").write_text(plan)
            answers = tmp_path / f"{number}.sh"
            answers.write_text(f"cat '{tmp_path}/{number}.plan' > \"$3\"\n")
            engines.append(f"knows{number}: sh {answers} {{domain}} {{problem}} {{plan}}")
        return engines

    return make


def look(kb: KnowledgeBase, remaining: Remaining) -> tuple[str | None, bool]:
    """Look at a plan as it is now."""
    plan = present(kb.plans.get(remaining.plan_id))
    return remaining.look(state_of(kb), plan)


def fact(text: str, holds: bool = True) -> Callable[[KnowledgeBase], object]:
    return lambda kb: kb.propositions.save(text) if holds else kb.propositions.delete(text)


def value(fluent: str, number: int) -> Callable[[KnowledgeBase], object]:
    return lambda kb: kb.function_values.set(fluent, value=number)


APART: dict[str, Callable[[KnowledgeBase], object]] = {
    "another door": fact("(open d3)", False),
    "an effect": fact("(at office)"),
    "what only others read": value("(visits yard)", 7),
    "what nothing reads": value("(humidity)", 6),
    "an act": lambda kb: kb.executions.report("(wave left)", outcome="succeeded"),
    "a light": fact("(lit kitchen)"),
}
NEEDED: dict[str, Callable[[KnowledgeBase], object]] = {
    "a door": fact("(open d2)", False),
    "where it is": fact("(at hall)", False),
    "a number": value("(battery)", 1),
    "the condition of an effect": fact("(counted kitchen)"),
    "the number of an effect": value("(visits kitchen)", 7),
    "the goal": lambda kb: kb.goals.save("(lit hall)"),
    "an object": lambda kb: kb.objects.save("attic - room"),
}


@pytest.mark.parametrize("change", [*APART, *NEEDED])
def test_only_what_touches_the_plan_is_looked_at(change: str, kb: KnowledgeBase) -> None:
    if change == "an effect":
        # It is of the goal, too.
        kb.goals.delete("(at office)")
    first = kb.replan()
    assert (first.plan.id, first.broken, first.is_validated) == (1, None, True)
    assert not kb.replan().is_validated
    {**APART, **NEEDED}[change](as_actor(kb, "camera"))
    broken, _ = look(kb, Remaining(1))
    if change not in ("a door", "where it is", "a number"):
        assert broken is None
        found = kb.replan(1)
        assert (found.plan.id, found.broken) == (1, None)
        assert found.is_validated == (change in NEEDED)
    else:
        with pytest.raises(NoPlanError):
            kb.replan(1, engine=f"none: sh -c 'echo unsolvable' {'{domain}'} {'{problem}'}")
        assert broken is not None


def test_a_name_that_is_erased_after_the_plan_was_read_breaks_nothing(kb: KnowledgeBase) -> None:
    plan = present(kb.plans.get(1))
    assert "kitchen" in str(plan.steps)
    as_actor(kb, "camera").erase("kitchen", reason="asked")
    assert Remaining(1).look(state_of(kb), plan) == (None, True)


def test_what_derived_predicates_follow_from_is_needed(kb: KnowledgeBase) -> None:
    remaining = Remaining(kb.plans.record(Plan.read("(leave)\n")).id)
    look(kb, remaining)
    kb.propositions.save("(counted hall)")
    assert not look(kb, remaining)[1]
    kb.propositions.save("(lit kitchen)")
    assert look(kb, remaining)[1]


def test_what_was_archived_since_is_looked_at(kb: KnowledgeBase, tmp_path: Path) -> None:
    assert kb.replan().is_validated
    kb.propositions.delete("(open d2)")
    kb.propositions.save("(lit yard)")
    kb.store.archive(kb.revision, to=f"sqlite:///{tmp_path / 'archive.db'}")
    # It is known to be broken, and there is no other.
    with pytest.raises(NoPlanError):
        kb.replan(engine="pyperplan")


def test_another_plan_takes_the_place_of_one_that_broke(
    kb: KnowledgeBase, knows: Callable[..., list[str]]
) -> None:
    head = kb.revision
    kb.propositions.delete("(open d2)")
    found = kb.replan(engines=knows(NEAR, FAR))
    assert str(found) == (
        "plan 2, as the one before broke: step 1 of plan 1, (go kitchen office d2), needs "
        "(open d2): does not hold"
    )
    assert (kb.revision, found.plan) == (head + 2, kb.plans.get(2))
    old = present(kb.plans.get(1))
    assert {(step.outcome, step.text) for step in old.steps} == {
        ("aborted", "plan 2 took its place")
    }
    assert next(kb.log()).revision.reason == f"plan 1 broke: {found.broken}"
    # It is the last one now, and works.
    assert kb.replan().plan.id == 2
    # An old plan is over, whatever the world is like: the one that took its place counts.
    kb.propositions.save("(open d2)")
    again = kb.replan(1, engines=knows(NEAR))
    assert (again.plan.id, again.broken) == (2, None)
    kb.propositions.delete("(open d4)")
    for _ in range(2):
        assert kb.replan(1, engines=knows(NEAR)).plan.id == 3
    assert kb.store.verify().is_intact


def test_a_transaction_that_broke_the_plan_is_committed_first(
    kb: KnowledgeBase, knows: Callable[..., list[str]]
) -> None:
    def plan_within() -> None:
        with kb.transaction():
            kb.propositions.delete("(open d2)")
            kb.replan(engines=knows(FAR))

    with pytest.raises(PlanError, match=r"broke: .*; commit this transaction, and then plan again"):
        plan_within()
    kb.propositions.delete("(open d2)")
    with kb.transaction():
        assert kb.replan(engines=knows(FAR)).plan.id == 2


def test_it_is_validated_from_where_the_robot_is(kb: KnowledgeBase) -> None:
    plan = present(kb.plans.get(1))
    kb.plans.set_status(plan.steps[0], status="running")
    kb.apply(plan.steps[0])
    # The first step is done: its door does not matter any more.
    assert kb.replan().broken is None
    kb.propositions.delete("(open d1)")
    found = kb.replan()
    assert (found.broken, found.is_validated) == (None, False)


def test_a_step_that_succeeded_without_its_effects_breaks_the_plan(kb: KnowledgeBase) -> None:
    first, last = present(kb.plans.get(1)).steps
    assert kb.replan().broken is None
    running = kb.executions.report(first, outcome="running")
    kb.executions.report(running, outcome="succeeded")
    with pytest.raises(NoPlanError):
        kb.replan(engine="none: sh -c 'exit 0' {domain} {problem}")
    kb.propositions.save("(at kitchen)")
    assert kb.replan().broken is None
    kb.apply(last)
    assert kb.replan().broken is None


@pytest.mark.parametrize("change", ["(lit hall)", "(battery)", "(at hall)"])
def test_a_step_that_runs_needs_what_it_needs_until_its_end(change: str, kb: KnowledgeBase) -> None:
    kb.goals.delete("(at office)")
    kb.goals.save("(= (visits hall) 3)")
    plan = kb.plans.record(Plan.read("0: (sweep hall) [5]"))
    running = kb.start(plan.steps[0])
    assert kb.replan().broken is None
    if change == "(battery)":
        kb.function_values.set(change, value=0)
    else:
        kb.propositions.delete(change)
    if change == "(at hall)":
        # That was needed at its start.
        assert kb.replan().broken is None
    else:
        with pytest.raises(PlanError, match=r"plan 2 broke while step 0 of plan 2, \(sweep hall\)"):
            kb.replan()
        kb.abort(running)
        with pytest.raises(NoPlanError):
            kb.replan(engine="none: sh -c 'exit 0' {domain} {problem}")


def test_what_a_start_has_decided_is_judged_after_the_end(kb: KnowledgeBase) -> None:
    kb.load_domain(
        HOUSE.replace(
            "(at end (assign (visits ?r) 3))",
            "(and (at end (assign (visits ?r) 3))"
            " (forall (?d - door) (when (at start (open ?d)) (at end (counted ?r)))))",
        )
    )
    kb.goals.delete("(at office)")
    kb.goals.save("(lit hall)")
    plan = kb.plans.record(Plan.read("0: (sweep hall) [5]"))
    kb.start(plan.steps[0])
    assert not kb.replan().is_validated
    kb.goals.save("(lit yard)")
    assert kb.replan().broken is None
    kb.end(plan.steps[0])
    with pytest.raises(NoPlanError):
        kb.replan(engine="none: sh -c 'exit 0' {domain} {problem}")


def test_what_is_asked_of_is_a_recorded_plan(fresh_kb: KnowledgeBase) -> None:
    with pytest.raises(PlanError, match="has no plan; record one"):
        fresh_kb.replan()
    with pytest.raises(PlanError, match="has no plan 7"):
        fresh_kb.replan(7)
    with pytest.raises(PlanError, match="recorded plan"):
        fresh_kb.replan("(go)")  # type: ignore[arg-type]
    for options in ({"planner": "lama"}, {1: 2}, "lama"):
        with pytest.raises(InvalidArgumentError, match=r"arguments of kb\.plan \("):
            fresh_kb.execute("(go)", print, replan=options)  # type: ignore[arg-type]
    fresh_kb.types.save("room")
    with pytest.raises(ReadOnlyError):
        fresh_kb.at(1).replan()


def test_what_is_not_committed_is_not_remembered(kb: KnowledgeBase) -> None:
    assert kb.replan().broken is None
    with undone(kb):
        kb.propositions.delete("(open d2)")
        assert look(kb, Remaining(1))[0] is not None
        with pytest.raises(NoPlanError):
            kb.replan(engine="none: sh -c 'exit 0' {domain} {problem}")
    assert kb.replan().broken is None


# While it is executed.


def test_a_door_closes_and_the_robot_goes_around(
    kb: KnowledgeBase, knows: Callable[..., list[str]]
) -> None:
    done: list[str] = []

    def drive(step: Execution) -> None:
        if not done:
            as_actor(kb, "camera").propositions.delete("(open d2)")
        done.append(str(step))

    found = kb.execute(1, drive, replan={"engines": knows(NEAR, BACK)})
    # What ran when it broke came to its end.
    assert done == [NEAR.splitlines()[0], *BACK.splitlines()]
    assert (found.outcome, found.plan.id, len(found.broken)) == ("succeeded", 2, 1)
    assert str(found).splitlines() == [
        "plan 1 broke: step 1 of plan 1, (go kitchen office d2), needs (open d2): does not hold",
        "plan 2 succeeded, 3 of 3 steps done",
    ]
    old = present(kb.plans.get(1))
    assert [step.outcome for step in old.steps] == ["succeeded", "aborted"]
    assert kb.holds("(at office)")


def test_a_goal_that_is_undone_is_reached_again(
    kb: KnowledgeBase, knows: Callable[..., list[str]]
) -> None:
    count = 0

    def drive(step: Execution) -> None:
        nonlocal count
        count += 1
        if count == 2:
            as_actor(kb, "camera").goals.save("(lit office)")

    light = "(:action light :parameters (?r - room) :effect (lit ?r))"
    kb.load_domain(HOUSE.replace("(:action leave", f"{light} (:action leave"))
    found = kb.execute(1, drive, replan={"engines": knows("(light office)\n")})
    assert (found.outcome, count) == ("succeeded", 3)
    assert found.broken == ("plan 1 broke: the goal (lit office): does not hold",)


def test_without_another_plan_it_ends_and_what_was_done_is_on_record(kb: KnowledgeBase) -> None:
    def drive(step: Execution) -> None:
        kb.propositions.delete("(open d2)")

    with pytest.raises(NoPlanError):
        kb.execute(1, drive, replan={"engine": "none: sh -c 'exit 0' {domain} {problem}"})
    plan = present(kb.plans.get(1))
    assert [step.outcome for step in plan.steps] == ["succeeded", None]


def test_without_replan_nothing_is_planned(kb: KnowledgeBase) -> None:
    found = kb.execute(1, lambda _: kb.propositions.delete("(open d2)"))
    assert (found.outcome, found.broken) == ("refused", ())


async def test_tasks_replan_too_and_cancel_planners(
    common_url: str, knows: Callable[..., list[str]], tmp_path: Path
) -> None:
    async with aio.connect(common_url, knowledge_base="replanning") as kb:
        await kb.load_domain(HOUSE)
        await kb.load_problem(TEA)
        await kb.propositions.delete("(open d1)")
        await kb.plans.record(Plan.read(NEAR))
        found = await kb.replan(engines=knows(FAR))
        assert found.plan.id == 2

        async def drive(step: Execution) -> None:
            await kb.propositions.delete("(open d4)")

        sign = tmp_path / "plans"
        slow = f"slow: sh -c 'touch {sign}; sleep 600' {{domain}} {{problem}}"
        task = asyncio.create_task(kb.execute(2, drive, replan={"engine": slow}))
        while not sign.exists():
            await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task


def test_a_step_that_is_done_while_its_plan_is_judged_breaks_nothing(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_later(state: State) -> PlanningTask:
        monkeypatch.undo()
        with ThreadPoolExecutor(1) as other:
            other.submit(kb.apply, present(kb.plans.get(1)).steps[0]).result(60)
        return read_task(state)

    monkeypatch.setattr(replan, "read_task", read_later)
    assert kb.replan(engine="none: sh -c 'exit 0' {domain} {problem}").broken is None


@pytest.mark.parametrize("other", ["replans", "begins a step"])
def test_what_others_do_while_the_planner_works_counts(
    other: str, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, knows: Callable[..., list[str]]
) -> None:
    plan, (engine,) = search.plan, knows(FAR)
    before = kb.plans.record(
        Plan.read("0: (sweep hall) [5]\n6: (go hall kitchen d1)\n8: (go kitchen office d2)\n")
    )

    def plan_meanwhile(state: State, **options: Any) -> Plan:
        monkeypatch.undo()
        found = plan(state, **options)
        if other == "replans":
            assert as_actor(kb, "camera").replan(engine=engine).plan.id == 3
        else:
            as_actor(kb, "camera").start(before.steps[0])
        return found

    kb.propositions.delete("(open d2)")
    monkeypatch.setattr(search, "plan", plan_meanwhile)
    if other == "replans":
        assert kb.replan(engine=engine).plan.id == 3
    else:
        with pytest.raises(PlanError, match=r"plan 2 broke while .*\(sweep hall\).* runs"):
            kb.replan(engine=engine)
    assert kb.plans.get(4) is None


def test_a_plan_that_is_given_up_just_before_it_is_made_again_is_not(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, planner = Remaining.look, "none: sh -c 'exit 0' {domain} {problem}"
    executive = Executive(state_of(kb), 1, print, replan={"engine": planner})

    def given_up(*given: Any) -> tuple[str | None, bool]:
        executive.give_up()
        return look(*given)

    kb.propositions.delete("(open d1)")
    monkeypatch.setattr(Remaining, "look", given_up)
    with pytest.raises(QuestionCancelledError):
        executive.run()


WORLD = """
(define (domain world) (:requirements :adl :fluents :derived-predicates)
  (:predicates (p ?x) (q ?x) (r ?x) (s ?x) (d ?x) (e) (done))
  (:functions (n ?x) (m))
  (:derived (d ?x) (or (p ?x) (exists (?y) (and (s ?y) (not (r ?x))))))
  (:derived (e) (forall (?x) (d ?x)))
  (:action a :parameters (?x) :precondition (and (p ?x) (or (not (q ?x)) (> (m) 1)))
    :effect (and (r ?x) (forall (?y) (when (and (q ?y) (d ?x)) (not (p ?y))))
      (when (not (e)) (increase (n ?x) (m)))))
  (:action b :parameters (?x) :precondition (forall (?y) (imply (p ?y) (r ?y)))
    :effect (and (done) (when (>= (n ?x) 1) (assign (m) (+ (n ?x) 1))))))
"""
START = """
(define (problem start) (:domain world) (:objects o1 o2 o3)
  (:init (p o1) (p o2) (= (n o1) 0) (= (n o2) 0) (= (n o3) 0) (= (m) 1))
  (:goal (and (done) (>= (+ (n o1) (n o2)) 1))))
"""
OBJECTS = ("o1", "o2", "o3")
FLIPS = [f"({name} {one})" for name in "pqrs" for one in OBJECTS] + ["(done)"]
FLUENTS = ["(m)", *(f"(n {one})" for one in OBJECTS)]
CHANGES = st.one_of(
    st.tuples(st.sampled_from(FLIPS), st.booleans()),
    st.tuples(st.sampled_from(FLUENTS), st.integers(0, 2)),
)
ACTS = [f"({name} {one})" for name in "ab" for one in OBJECTS]


@hunting(PROFILE.tasks)
@given(steps=st.lists(st.sampled_from(ACTS), max_size=4), changes=st.lists(CHANGES, max_size=12))
@pytest.mark.more
def test_a_verdict_that_is_kept_is_that_of_a_new_look(
    steps: list[str], changes: list[tuple[str, int]]
) -> None:
    with kant_sql.connect("sqlite://") as kb:
        loaded(kb, WORLD, START)
        plan: RecordedPlan = kb.plans.record(Plan.read("\n".join(["(a o1)", *steps])))
        remembers = Remaining(plan.id)
        look(kb, remembers)
        for text, change in changes:
            if text in FLUENTS:
                kb.function_values.set(text, value=change)
            else:
                fact(text, bool(change))(kb)
            assert look(kb, remembers)[0] == look(kb, Remaining(plan.id))[0]
