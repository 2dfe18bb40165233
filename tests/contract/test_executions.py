"""What was done is recorded with what came of it, found again, and covered by verification."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import Execution, KnowledgeBase, NotApplicableError, Plan, PlanStep
from kant_sql.errors import InvalidArgumentError, PlanError, ReadOnlyError, UnknownNameError
from tests.support.reading import last_changes, loaded, nothing_changes, present
from tests.support.statements import count

DOMAIN = """
(define (domain doors) (:requirements :typing :durative-actions) (:types door)
  (:predicates (open ?d - door) (busy))
  (:action unlock :parameters (?d - door) :precondition (not (open ?d)) :effect (open ?d))
  (:action knock :parameters (?d - door))
  (:durative-action paint :parameters (?d - door) :duration (= ?duration 5)
    :condition (over all (open ?d)) :effect (and (at start (busy)) (at end (not (busy))))))
"""
PROBLEM = "(define (problem home) (:domain doors) (:objects front back - door) (:goal (busy)))"


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with two doors."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def latest(kb: KnowledgeBase, **which: Any) -> Execution:
    return next(kb.executions.get_all(limit=1, **which))


def texts(kb: KnowledgeBase, **which: Any) -> list[str]:
    return [str(each) for each in kb.executions.get_all(**which)]


def test_an_act_is_recorded_in_the_revision_of_its_effects(kb: KnowledgeBase) -> None:
    with kb.transaction(actor="executive", reason="the bell rang", source={"bell": 3}):
        kb.apply("(unlock front)")
    done = latest(kb)
    [effect, change] = last_changes(kb)[::-1]
    assert effect == "+ fact (open front)"
    assert change == f"+ execution (:execution {done.id} (unlock front) succeeded)"
    revision = kb.store.revisions()[-1]
    assert (done.action, done.arguments, done.outcome) == ("unlock", ("front",), "succeeded")
    assert (done.actor, done.reason, done.source) == ("executive", "the bell rang", {"bell": 3})
    assert done.started_at == done.ended_at == revision.committed_at
    assert (done.revision, done.revisions) == (revision.number, (revision.number,))
    assert (done.plan_id, done.position, done.duration) == (None, None, None)
    assert kb.executions.get(done.id) == kb.executions.get(int(done.id)) == done
    assert kb.store.verify().is_intact


def test_an_act_without_net_effect_is_a_revision(kb: KnowledgeBase) -> None:
    before = kb.revision
    assert kb.apply("(knock front)") == before + 1
    assert kb.apply("(knock front)") == before + 2
    assert texts(kb) == ["(knock front)"] * 2
    assert kb.diff(before, before + 2) == []


def test_several_acts_are_one_revision(kb: KnowledgeBase) -> None:
    before = kb.revision
    with kb.transaction(reason="the round"):
        assert kb.apply("(unlock front)") is None
        assert kb.apply("(unlock back)") is None
        with pytest.raises(NotApplicableError):
            kb.apply("(unlock back)")
        assert latest(kb).outcome == "succeeded"
    assert kb.revision == before + 1
    assert {*texts(kb)} == {"(unlock front)", "(unlock back)"}
    assert {each.reason for each in kb.executions.get_all()} == {"the round"}
    assert kb.store.verify().is_intact


def test_a_refused_act_is_recorded_if_that_is_wanted(kb: KnowledgeBase) -> None:
    kb.apply("(unlock front)")
    with nothing_changes(kb), pytest.raises(NotApplicableError):
        kb.apply("(unlock front)")
    for _ in range(2):
        with pytest.raises(NotApplicableError, match="cannot be applied"):
            kb.apply("(unlock front)", record_refusal=True)
        refused = latest(kb)
        assert (refused.outcome, refused.text) == ("refused", "(not (open front)): does not hold")
        assert [line.split()[1] for line in last_changes(kb)] == ["execution"]
        assert refused.reason == "refused (unlock front)"
    for given in ("( UNLOCK  front)", "unlock front"):
        with pytest.raises(NotApplicableError):
            kb.apply(given, record_refusal=True)
        assert present(latest(kb).reason).startswith("refused (")
    assert len(texts(kb, outcome="refused")) == 4
    assert kb.apply("(unlock back)", record_refusal=True) == kb.revision
    # What ran before its end is refused leaves nothing.
    kb.propositions.delete("(open front)")
    with pytest.raises(NotApplicableError):
        kb.apply("(paint front) [5]", record_refusal=True)
    assert latest(kb).reason == "refused (paint front) [5]"
    assert not kb.holds("(busy)")
    assert kb.store.verify().is_intact


def test_a_refused_step_of_a_plan_stays_to_be_done(kb: KnowledgeBase) -> None:
    kb.apply("(unlock front)")
    plan = kb.plans.record(Plan((PlanStep(None, "unlock", ("front",)),), "by hand", ""))
    with pytest.raises(NotApplicableError):
        kb.apply(plan.steps[0], record_refusal=True)
    assert latest(kb).outcome == "refused"
    link = present(kb.store.revisions()[-1].execution)
    assert (link.plan, link.position) == (plan.id, 0)
    kb.propositions.delete("(open front)")
    kb.apply(plan.steps[0])
    step = latest(kb)
    assert (step.id, step.plan_id, step.position) == (f"{plan.id}.0", plan.id, 0)
    assert step.outcome == "succeeded"
    assert kb.executions.get(step.id) == step


def test_a_durative_act_runs_and_ends(kb: KnowledgeBase) -> None:
    kb.apply("(unlock front)")
    running = kb.start("(paint front)", reason="dull")
    assert (running.outcome, running.ended_at, running.plan_id) == ("running", None, None)
    assert kb.plans.get_all() == []
    begun = kb.revision
    with kb.transaction(execution=running):
        kb.propositions.save("(open back)")
    link = present(kb.store.revisions()[-1].execution)
    assert (link.plan, link.position, str(link)) == (
        None,
        int(running.id),
        f"execution {running.id}",
    )
    with pytest.raises(NotApplicableError, match=f"it is running: execution {running.id}"):
        kb.start("(paint front)")
    with pytest.raises(PlanError, match="expected an execution"):
        kb.apply("(knock front)", execution=running.id)  # type: ignore[arg-type]
    done = kb.end(running, reason="bright")
    assert (done.id, done.outcome, done.reason) == (running.id, "succeeded", "dull")
    assert done.revisions == (begun, begun + 1, begun + 2)
    assert [each.since.reason for each in done.outcomes] == ["dull", "bright"]
    assert present(done.started_at) <= present(done.ended_at)
    past = present(kb.at(begun).executions.get(running.id))
    assert (past.outcome, past.ended_at) == ("running", None)
    assert kb.at(begun - 1).executions.get(running.id) is None
    assert kb.store.verify().is_intact


def test_an_act_fails_with_a_code_and_a_text(kb: KnowledgeBase) -> None:
    kb.apply("(unlock front)")
    failed = kb.fail(kb.start("(paint front)"), code="E7", text='no "paint"\n', reason="empty")
    assert (failed.outcome, failed.code, failed.text) == ("failed", "E7", 'no "paint"\n')
    assert kb.holds("(busy)")
    assert last_changes(kb)[0] == (
        f"+ execution (:execution {failed.id} (paint front) failed :duration 5 :recorded-in "
        f'{kb.revision - 1} :code "E7" :message "no \\"paint\\"\\n")'
    )
    with pytest.raises(PlanError, match="has failed, so it cannot be 'succeeded' next"):
        kb.executions.report(failed, outcome="succeeded")
    with pytest.raises(PlanError, match="expected an execution"):
        kb.fail("(paint front)")  # type: ignore[arg-type]
    assert kb.store.verify().is_intact


def test_components_without_pddl_report(kb: KnowledgeBase) -> None:
    begun, ended = datetime(2026, 1, 31, 9, tzinfo=UTC), datetime(2026, 1, 31, 9, 1, tzinfo=UTC)
    report = partial(kb.executions.report, "Go to dock", arguments=["front", 'bay (4) "b"'])
    done = report(outcome="succeeded", started_at=begun, ended_at=ended)
    assert (done.action, done.arguments) == ("Go to dock", ("front", 'bay (4) "b"'))
    assert (done.started_at, done.ended_at) == (begun, ended)
    assert done.outcomes[0].text == (
        f'(:execution {done.id} ("Go to dock" front "bay (4) \\"b\\"") succeeded '
        ':started-at "2026-01-31T09:00:00.000000Z" :ended-at "2026-01-31T09:01:00.000000Z")'
    )
    running = report(outcome="running", started_at=begun)
    assert kb.executions.report(running, outcome="failed", code="E4").started_at == begun
    # What has the name and the arguments of an action is one.
    kb.executions.report("Unlock", arguments=["back"], outcome="failed")
    assert texts(kb, action="unlock") == ["(unlock back)"]
    assert len(texts(kb, action="Go to dock")) == 2
    assert len(texts(kb, object="front")) == 2
    # It is not an action: nothing in PDDL runs.
    report(outcome="running")
    assert kb.pddl.broken_invariants() == []
    assert kb.store.verify().is_intact


def test_what_is_no_report_is_refused(kb: KnowledgeBase) -> None:
    report: Any = kb.executions.report
    now, noon = datetime.now(UTC), datetime(2026, 1, 1, 12, tzinfo=UTC)
    last = datetime.max.replace(tzinfo=timezone(timedelta(hours=-5)))
    made = report("dock", arguments=["front"], outcome="running")
    for wrong, given, message in (
        ((3,), {"outcome": "failed"}, "the name of the act is 3"),
        (("",), {"outcome": "failed"}, "is empty"),
        (("a\0",), {"outcome": "failed"}, "NUL"),
        (("a",), {"outcome": "done"}, "expected one of running"),
        (("a",), {"outcome": "failed", "arguments": "front"}, "expected a list"),
        ((made,), {"outcome": "failed", "arguments": None}, "expected a list"),
        ((made,), {"outcome": "failed", "arguments": ["front"]}, "has its arguments already"),
        (("a",), {"outcome": "succeeded", "code": "E"}, "is the code of a failure"),
        (("a",), {"outcome": "running", "ended_at": now}, "for a running execution"),
        (("a",), {"outcome": "failed", "started_at": now, "ended_at": noon}, "before it began"),
        (("a",), {"outcome": "failed", "ended_at": 5}, "a time with its zone"),
        (("a",), {"outcome": "failed", "started_at": last}, "outside the years 1 to 9999"),
        (("a",), {"outcome": "failed", "code": "\ud800"}, "unpaired surrogate"),
    ):
        with nothing_changes(kb), pytest.raises((PlanError, InvalidArgumentError), match=message):
            report(*wrong, **given)
    with pytest.raises(ReadOnlyError):
        kb.at(1).executions.report("dock", outcome="failed")
    for strange in ("dock", "1.2.3", 0, None, True, "-1"):
        with pytest.raises(InvalidArgumentError, match="is not the id of an execution"):
            kb.executions.get(strange)  # type: ignore[arg-type]
    assert [kb.executions.get(each) for each in (99, "7.1", 2**40)] == [None] * 3


def test_the_start_that_was_reported_stays_and_the_end_is_not_before_it(kb: KnowledgeBase) -> None:
    begun = datetime(2026, 1, 1, tzinfo=UTC)
    with kb.transaction():
        one = kb.executions.report("dock", outcome="running", started_at=begun)
        one = kb.executions.report(one, outcome="succeeded")
    found = present(kb.executions.get(one.id))
    assert (found.started_at, found.outcome) == (begun, "succeeded")
    running = kb.executions.report("dock :started-at ", outcome="running", started_at=begun)
    with pytest.raises(PlanError, match="before it began at 2026-01-01"):
        kb.executions.report(running, outcome="failed", ended_at="2025-12-31T23:00:00Z")
    ended = kb.executions.report(running, outcome="failed", text=' :started-at "', ended_at=begun)
    assert (ended.started_at, ended.ended_at) == (begun, begun)
    alone = kb.executions.report("undock", outcome="succeeded", ended_at=begun)
    assert (alone.started_at, alone.ended_at) == (begun, begun)
    assert kb.store.verify().is_intact


@pytest.mark.parametrize("name", ["a\0b", "a\ud800b"])
def test_a_name_that_no_database_stores_is_refused(kb: KnowledgeBase, name: str) -> None:
    for what in ("action", "object", "actor"):
        asked: Any = {what: name}
        with pytest.raises(InvalidArgumentError, match=what):
            [*kb.executions.get_all(**asked)]
    with pytest.raises(InvalidArgumentError, match="actor"):
        kb.statistics(actor=name)


def test_executions_are_found(kb: KnowledgeBase) -> None:
    with kb.transaction(actor="anna"):
        kb.apply("(unlock front)")
    with kb.transaction(actor="bert"):
        kb.apply("(unlock back)")
    begun = kb.revision
    running = kb.start("(paint front)")
    with kb.transaction(actor="bert"):
        kb.abort(running)
    assert texts(kb) == ["(paint front)", "(unlock back)", "(unlock front)"]
    assert texts(kb, action="UNLOCK") == ["(unlock back)", "(unlock front)"]
    assert texts(kb, object="Front", action="unlock") == ["(unlock front)"]
    assert texts(kb, object=kb.objects.get("front")) == ["(paint front)", "(unlock front)"]
    assert texts(kb, outcome="aborted") == ["(paint front)"]
    assert texts(kb, actor="bert") == ["(unlock back)"]
    assert texts(kb, since=begun + 1) == ["(paint front)"]
    assert texts(kb, until=begun, limit=1) == ["(unlock back)"]
    assert [each.outcome for each in kb.at(begun + 1).executions.get_all()][:1] == ["running"]
    assert texts(kb, action="knock") == []
    for which in ({"action": "fly"}, {"object": "side"}, {"actor": "carl"}):
        with pytest.raises(UnknownNameError):
            texts(kb, **which)
    with pytest.raises(InvalidArgumentError, match="expected one of running"):
        texts(kb, outcome="started")


def test_pages_go_on_where_they_ended(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kant_sql.acts.executions.PAGE", 3)
    with kb.transaction():
        for number in range(4):
            kb.executions.report(f"act {number}", outcome="succeeded")
    for number in range(4, 8):
        kb.executions.report(f"act {number}", outcome="succeeded", arguments=["front"])
    assert texts(kb) == [
        *(f"(act {number} front)" for number in range(7, 3, -1)),
        *(f"(act {number})" for number in range(3, -1, -1)),
    ]
    # With many executions of an object, the newest are looked through.
    monkeypatch.setattr("kant_sql.acts.executions.FEW", 2)
    assert len(texts(kb, object="front", limit=3)) == 3
    assert len(texts(kb, object="front")) == 4


def test_reads_take_the_same_statements_however_many_there_are(kb: KnowledgeBase) -> None:
    counts = []
    for _ in range(3):
        for _ in range(10):
            kb.executions.report("dock", outcome="failed", arguments=["front"])
        done = latest(kb)
        counts.append(
            [
                count(partial(kb.executions.get, done.id)),
                count(lambda: [*kb.executions.get_all()]),
                count(lambda: [*kb.executions.get_all(object="front", action="dock")]),
            ]
        )
    assert counts[0] == counts[1] == counts[2]
    assert counts[0][0] <= 8, counts
    assert counts[0][2] <= 14, counts


def test_a_restored_state_has_the_same_executions(kb: KnowledgeBase) -> None:
    before = kb.revision
    kb.apply("(unlock front)")
    running = kb.start("(paint front)")
    kb.restore(before)
    assert texts(kb) == ["(paint front)", "(unlock front)"]
    assert present(kb.executions.get(running.id)).outcome == "running"
    assert not kb.holds("(open front)")


def test_replicas_and_archives_have_executions(kb: KnowledgeBase, tmp_path: Path) -> None:
    replica, archive = (f"sqlite:///{tmp_path / name}.db" for name in ("replica", "archive"))
    kb.apply("(unlock front)")
    running = kb.start("(paint front)")
    kb.store.push(replica)
    done = kb.end(running)
    kb.executions.report("say hello", outcome="failed", arguments=["you"], code="E1")
    kb.store.push(replica)
    with kant_sql.connect(replica, knowledge_base=kb.store.factory.name) as other:
        assert [each.outcomes for each in other.executions.get_all()] == [
            each.outcomes for each in kb.executions.get_all()
        ]
        assert other.store.verify().is_intact
    kb.store.archive(kb.revision, to=archive)
    # Outcomes stay, from which it is known when it began, and why.
    assert kb.executions.get(done.id) == done
    assert kb.store.verify().is_intact
    with kant_sql.connect(archive, knowledge_base=kb.store.factory.name) as other:
        assert other.executions.get(done.id) is not None
        assert other.store.verify().is_intact
