"""What becomes of the steps of a plan, and which revisions each of them caused."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import Any

import pytest

import kant_sql
from kant_sql import Execution, KnowledgeBase
from kant_sql.acts import Outcome
from kant_sql.errors import PlanError
from kant_sql.planning import PlanStep
from kant_sql.sql.dialects.base import Row, Session
from tests.support.chain import check_chain
from tests.support.processes.workers import in_processes
from tests.support.reading import Undone, last_changes, nothing_changes, present, rows, undone
from tests.support.stores import Connect
from tests.support.worlds.missions import TOUR, arrive, begin, beside_of, plan_of, recorded

STATUSES: tuple[Outcome, ...] = ("running", "succeeded", "failed", "aborted")
ENDS = STATUSES[1:]
ALLOWED = {
    *((None, status) for status in ("running", "aborted")),
    *(("running", status) for status in ENDS),
}
# How a step comes to each status.
WAYS: dict[Outcome | None, tuple[Outcome, ...]] = {
    None: (),
    "running": ("running",),
    "succeeded": ("running", "succeeded"),
    "failed": ("running", "failed"),
    "aborted": ("aborted",),
}


def now(kb: KnowledgeBase, step: Execution) -> Execution:
    """A step as it is now."""
    return present(kb.executions.get(step.id))


def spans(kb: KnowledgeBase, step: Execution) -> list[tuple[str, int, int | None]]:
    """The statuses that a step had, with the numbers of the revisions between which it did."""
    return [
        (
            each.text.split()[-1].rstrip(")"),
            each.since.number,
            None if each.until is None else each.until.number,
        )
        for each in now(kb, step).outcomes
    ]


def refuses(call: Callable[..., Any], *arguments: Any, **said: Any) -> str:
    with pytest.raises(PlanError) as caught:
        call(*arguments, **said)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def open_within(kb: KnowledgeBase, step: Execution) -> None:
    with kb.transaction(execution=step):
        arrive(kb, "wp2")


def test_a_step_is_started_and_ends(fresh_kb: KnowledgeBase) -> None:
    plan = recorded(fresh_kb)
    first, second = plan.steps[:2]
    assert fresh_kb.plans.set_status(first, status="running")
    assert last_changes(fresh_kb) == [
        f"+ execution (:execution {plan.id}.0 (Move rb1 Wp1 wp2) running)"
    ]
    assert now(fresh_kb, first).outcome == "running"
    with fresh_kb.transaction(actor="executive", reason="blocked"):
        assert fresh_kb.plans.set_status(first, status="failed")
    assert last_changes(fresh_kb) == [
        f"+ execution (:execution {plan.id}.0 (Move rb1 Wp1 wp2) failed)",
        f"- execution (:execution {plan.id}.0 (Move rb1 Wp1 wp2) running)",
    ]
    assert spans(fresh_kb, first) == [("running", 3, 4), ("failed", 4, None)]
    started, failed = now(fresh_kb, first).outcomes
    assert started.kind == "execution"
    assert failed.text == f"(:execution {plan.id}.0 (Move rb1 Wp1 wp2) failed)"
    assert failed.since == started.until == fresh_kb.store.revisions()[3]
    assert (failed.since.actor, failed.since.reason) == ("executive", "blocked")
    assert now(fresh_kb, second) == second


def test_a_step_comes_only_to_what_can_follow(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    for before, way in WAYS.items():
        for status in STATUSES:
            step = fresh_kb.plans.record(plan_of(TOUR.steps[3], revision=1)).steps[0]
            for each in way:
                assert fresh_kb.plans.set_status(step, status=each)
            revision = fresh_kb.revision
            if (before, status) in ALLOWED:
                assert fresh_kb.plans.set_status(step, status=status)
                assert now(fresh_kb, step).outcome == status
                continue
            if before == status:
                assert not fresh_kb.plans.set_status(step, status=status)
            else:
                message = refuses(fresh_kb.plans.set_status, step, status=status)
                assert message.endswith(f"so it cannot be {status!r} next")
            assert (now(fresh_kb, step).outcome, fresh_kb.revision) == (before, revision)


def test_what_is_no_step_or_no_status_is_refused(fresh_kb: KnowledgeBase) -> None:
    plan = recorded(fresh_kb)
    step = plan.steps[0]
    set_status = fresh_kb.plans.set_status
    for status in ("done", "", None, 3):
        assert "expected one of running, succeeded" in refuses(set_status, step, status=status)
    for strange in (0, None, (plan.id, 0), TOUR.steps[0]):
        assert "expected an execution" in refuses(set_status, strange, status="running")
    others = {
        "is not in knowledge base": [replace(step, plan_id=plan.id + 1), replace(step, position=4)],
        "is of another store": [replace(step, arguments=("rb1", "Wp1", "Home"))],
    }
    for what, steps in others.items():
        for other in steps:
            assert what in refuses(set_status, other, status="running")
            with nothing_changes(fresh_kb):
                assert what in refuses(open_within, fresh_kb, other)
    with pytest.raises(PlanError, match="expected an execution"):
        open_within(fresh_kb, TOUR.steps[0])  # type: ignore[arg-type]


def test_a_step_of_another_knowledge_base_is_refused(fresh_kb: KnowledgeBase) -> None:
    recorded(fresh_kb)
    other = beside_of(fresh_kb)
    twin = recorded(other).steps[0]
    with nothing_changes(fresh_kb):
        message = refuses(open_within, fresh_kb, twin)
        assert f"is of knowledge base '{other.store.factory._store.name}', not of" in message  # type: ignore[attr-defined]
        refuses(fresh_kb.plans.set_status, twin, status="running")
    assert other.plans.set_status(twin, status="running")


def test_revisions_that_a_step_causes_link_to_it(fresh_kb: KnowledgeBase) -> None:
    first, second = recorded(fresh_kb).steps[:2]
    with fresh_kb.transaction(execution=first):
        fresh_kb.plans.set_status(first, status="running")
    open_within(fresh_kb, first)
    arrive(fresh_kb, "home")
    with fresh_kb.transaction(reason="nothing happens", execution=first):
        pass
    with fresh_kb.transaction(execution=first), fresh_kb.transaction(execution=second):
        fresh_kb.plans.set_status(first, status="succeeded")
    assert now(fresh_kb, first).revisions == (3, 4, 6)
    assert now(fresh_kb, second).revisions == ()
    links = [revision.execution for revision in fresh_kb.store.revisions()]
    place = (first.plan_id, 0)
    assert links == [None, None, place, place, None, place]


def test_what_is_undone_links_to_nothing(fresh_kb: KnowledgeBase) -> None:
    step = recorded(fresh_kb).steps[0]
    with suppress(Undone), fresh_kb.transaction(execution=step):
        fresh_kb.plans.set_status(step, status="running")
        raise Undone
    assert now(fresh_kb, step) == step
    assert rows(fresh_kb, "SELECT number FROM revision_execution WHERE kb_id = :kb") == []


def test_a_plan_can_be_recorded_and_started_in_one_transaction(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    with fresh_kb.transaction():
        step = fresh_kb.plans.record(TOUR).steps[1]
        assert fresh_kb.plans.set_status(step, status="running")
        with fresh_kb.transaction(execution=step):
            arrive(fresh_kb, "wp2")
        assert now(fresh_kb, step).outcome == "running"
        # The revision that says so is not made yet, and the block within another only joins it.
        assert (now(fresh_kb, step).outcomes, now(fresh_kb, step).revisions) == ((), ())
    assert spans(fresh_kb, step) == [("running", 2, None)]
    assert now(fresh_kb, step).revisions == (2,)


@pytest.mark.parametrize("flushed", [False, True])
def test_only_the_last_status_of_a_transaction_remains(
    fresh_kb: KnowledgeBase, flushed: bool
) -> None:
    first, second, third = recorded(fresh_kb).steps[:3]
    fresh_kb.plans.set_status(second, status="running")
    with fresh_kb.transaction():
        for step, status in (
            *((first, "running"), (third, "aborted")),
            *((first, "succeeded"), (second, "failed")),
        ):
            assert fresh_kb.plans.set_status(step, status=status)  # type: ignore[arg-type]
            if flushed:
                assert now(fresh_kb, step).outcome == status
        assert not fresh_kb.plans.set_status(first, status="succeeded")
        refuses(fresh_kb.plans.set_status, second, status="aborted")
    plan_id = first.plan_id
    assert last_changes(fresh_kb) == [
        f"+ execution (:execution {plan_id}.0 (Move rb1 Wp1 wp2) succeeded)",
        f"+ execution (:execution {plan_id}.1 (Move rb1 wp2 Home) failed)",
        f"+ execution (:execution {plan_id}.2 (charge rb1 Home) aborted)",
        f"- execution (:execution {plan_id}.1 (Move rb1 wp2 Home) running)",
    ]
    assert spans(fresh_kb, first) == [("succeeded", 4, None)]
    assert spans(fresh_kb, second) == [("running", 3, 4), ("failed", 4, None)]
    assert spans(fresh_kb, third) == [("aborted", 4, None)]


@pytest.mark.parametrize("outer", [False, True], ids=["", "read before"])
@pytest.mark.parametrize("inner", [False, True], ids=["", "read within"])
def test_a_part_that_fails_leaves_statuses_as_they_were(
    fresh_kb: KnowledgeBase, outer: bool, inner: bool
) -> None:
    first, second, third = recorded(fresh_kb).steps[:3]
    fresh_kb.plans.set_status(second, status="running")
    with fresh_kb.transaction():
        fresh_kb.plans.set_status(first, status="running")
        if outer:
            fresh_kb.plans.get_all()
        with undone(fresh_kb):
            for step, status in ((first, "failed"), (second, "succeeded"), (third, "running")):
                fresh_kb.plans.set_status(step, status=status)  # type: ignore[arg-type]
            with undone(fresh_kb):
                fresh_kb.plans.set_status(third, status="aborted")
                if inner:
                    assert now(fresh_kb, third).outcome == "aborted"
            if inner:
                assert now(fresh_kb, first).outcome == "failed"
                assert now(fresh_kb, third).outcome == "running"
        assert [now(fresh_kb, step).outcome for step in (first, second, third)] == [
            *("running", "running", None)
        ]
        assert fresh_kb.plans.set_status(second, status="aborted")
    plan_id = first.plan_id
    assert last_changes(fresh_kb) == [
        f"+ execution (:execution {plan_id}.0 (Move rb1 Wp1 wp2) running)",
        f"+ execution (:execution {plan_id}.1 (Move rb1 wp2 Home) aborted)",
        f"- execution (:execution {plan_id}.1 (Move rb1 wp2 Home) running)",
    ]
    assert spans(fresh_kb, second) == [("running", 3, 4), ("aborted", 4, None)]
    assert spans(fresh_kb, third) == []


def test_the_past_knows_the_statuses_of_then(fresh_kb: KnowledgeBase) -> None:
    step = recorded(fresh_kb).steps[0]
    for status in ("running", "failed"):
        with fresh_kb.transaction(execution=step):
            fresh_kb.plans.set_status(step, status=status)
    past = [fresh_kb.at(number) for number in (2, 3, 4)]
    assert [now(kb, step).outcome for kb in past] == [None, "running", "failed"]
    assert [now(kb, step).revisions for kb in past] == [(), (3,), (3, 4)]
    assert [spans(kb, step) for kb in past] == [
        [],
        [("running", 3, None)],
        [("running", 3, 4), ("failed", 4, None)],
    ]


def test_hashes_cover_statuses_and_links(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url)
    steps = recorded(kb).steps
    for step in steps:
        with kb.transaction(execution=step, reason=str(step)):
            kb.plans.set_status(step, status="running")
            kb.plans.get_all()
        with kb.transaction():
            kb.plans.set_status(step, status="aborted")
            with undone(kb):
                kb.plans.record(TOUR)
                kb.plans.get_all()
    with kb.transaction():
        step = kb.plans.record(TOUR).steps[0]
        for status in ("running", "failed"):
            assert kb.plans.set_status(step, status=status)
            kb.plans.get_all()
    assert check_chain(shared_url) == {"default": 11}


def test_one_of_two_processes_starts_a_step(shared_url: str, connect: Connect) -> None:
    kb = connect(shared_url, knowledge_base="tiago")
    plan = recorded(kb)
    answers = in_processes(*[(start, shared_url, plan.id)] * 2)
    assert [sorted(both) for both in zip(*answers, strict=True)] == [[False, True]] * 4
    assert kb.revision == 6
    check_chain(shared_url)


def start(url: str, plan_id: int) -> list[bool]:
    """Start all steps of a plan, in a process of its own; tell which it has started."""
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        plan = present(kb.plans.get(plan_id))
        return [kb.plans.set_status(step, status="running") for step in plan.steps]


def test_a_step_is_started_and_ended_without_reading_the_rest_of_its_plan(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = fresh_kb
    begin(kb)
    there = PlanStep(Decimal(0), "move", ("rb1", "wp1", "wp2"), Decimal(5))
    *_, first, second = kb.plans.record(plan_of(*[there] * 300)).steps
    fetch, lengths = Session._fetch, list[int]()

    def counted(self: Session) -> list[Row]:
        rows = fetch(self)
        lengths.append(len(rows))
        return rows

    monkeypatch.setattr(Session, "_fetch", counted)
    undo = partial(kb.abort, undo=True)
    acts = ((kb.start, first), (undo, first), (kb.start, second), (kb.end, second))
    for act, step in acts:
        lengths.clear()
        done = act(step)
        assert (done.plan_id, done.position) == (step.plan_id, step.position)
        assert done.outcomes[-1].text.endswith(f"{done.outcome})")
        # The definitions are the longest answer.
        assert max(lengths) < 20
        assert len(lengths) <= 25
