"""Another writer changes the store between two reads of one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from kant_sql import KnowledgeBase, Plan
from kant_sql.acts import statistics
from kant_sql.documents.exchange import read_task
from kant_sql.errors import ArchivedError, PlanError, UnknownNameError
from kant_sql.history import diff, element_pages, merge, state_parts
from kant_sql.history.erasure import retention
from kant_sql.history.replication import push
from kant_sql.knowledge_base import state_of
from kant_sql.pddl import write
from kant_sql.planning import problem_hash
from kant_sql.plans import dao
from kant_sql.reasoning import act, durative, execute, links, replan, search, stale, validate
from kant_sql.sql.changes import Change as Line
from kant_sql.store.state import State
from tests.support.reading import as_actor, loaded, store_of

DOMAIN = """
(define (domain ward) (:requirements :typing :durative-actions) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (lit ?p - place) (seen ?p - place))
  (:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)
    :effect (and (at start (at ?r ?p)) (when (at start (lit ?p)) (at end (seen ?p)))
      (forall (?q - place) (when (at start (lit ?q)) (at start (seen ?q)))))))
"""
PROBLEM = """
(define (problem night) (:domain ward) (:objects r1 - robot hall room - place)
  (:init (lit room)) (:goal (seen room)))
"""
Change = Callable[[KnowledgeBase], object]


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A ward with a robot."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def archived(to: Path) -> Change:
    """Archive all but the last revision."""

    def archive(other: KnowledgeBase) -> None:
        other.propositions.save("(lit hall)")
        other.propositions.delete("(lit hall)")
        other.propositions.save("(lit hall)")
        other.store.archive(other.revision, to=f"sqlite:///{to / 'archive.db'}")

    return archive


def skip_in_memory(kb: KnowledgeBase) -> None:
    """Skip where other threads wait for the one connection, which the reading one holds."""
    if store_of(kb).backend.has_one_connection:
        pytest.skip("other threads wait for the one connection")


@pytest.fixture
def after(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Let another writer change the store once, right after a function has returned."""

    def interfere(module: object, function: str, change: Change) -> None:
        call, changes = getattr(module, function), [change]

        def called(*given: Any, **named: Any) -> Any:
            found = call(*given, **named)
            if changes:
                changes.pop()(as_actor(kb, "camera"))
            return found

        monkeypatch.setattr(module, function, called)

    return interfere


@pytest.mark.parametrize(
    "change",
    [
        lambda other: other.objects.save("bath - place"),
        lambda other: other.predicates.save("(warm ?p - place)"),
        lambda other: other.erase("hall", reason="asked"),
    ],
    ids=["object", "predicate", "erasure"],
)
def test_a_definition_that_changes_leaves_the_effects_at_the_end(
    change: Change, kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    kb.propositions.delete("(seen room)")
    step = kb.start("(visit r1 room)")
    kb.propositions.delete_all(["(seen room)", "(lit room)"])
    after(durative, "_running", change)
    assert kb.end(step).outcome == "succeeded"
    assert kb.holds("(seen room)")


def test_a_name_that_is_erased_stays_among_what_an_abort_takes_back(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    kb.propositions.save("(lit hall)")
    step = kb.start("(visit r1 room)")
    after(durative, "_running", lambda other: other.erase("hall", reason="asked"))
    found = kb.abort(step, undo=True)
    assert {str(each.text) for each in found.undone} == {
        "(at r1 room)",
        "(seen erased-1)",
        "(seen room)",
    }
    assert not kb.holds("(exists (?p - place) (seen ?p))")


def test_an_erased_name_does_not_come_back_with_a_plan(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    after(dao, "check_steps", lambda other: other.erase("hall", reason="asked"))
    made = kb.plans.record(Plan.read("(visit r1 room)\n"))
    assert (made.revision, made.recorded_in) == (kb.revision - 1, kb.revision)
    after(dao, "check_steps", lambda other: other.erase("room", reason="asked"))
    with pytest.raises(PlanError, match="object 'room' is not known"):
        kb.plans.record(Plan.read("(visit r1 room)\n"))
    assert kb.store.verify().is_intact


def test_an_action_may_need_what_its_start_did_not_know(kb: KnowledgeBase) -> None:
    kb.propositions.delete("(seen room)")
    step = kb.start("(visit r1 room)")
    kb.propositions.delete("(seen room)")
    kb.predicates.save("(warm ?p - place)")
    kb.propositions.save("(warm room)")
    kb.actions.save(
        "(:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)"
        " :effect (when (at start (exists (?q - place) (warm ?q))) (at end (seen ?p))))"
    )
    assert kb.end(step).outcome == "succeeded"
    assert not kb.holds("(seen room)")  # Nothing was warm then.


@pytest.mark.parametrize("function", ["read_any_plan", "read_task"])
def test_a_plan_is_validated_with_the_names_of_its_state(
    kb: KnowledgeBase, after: Callable[..., None], function: str
) -> None:
    made = kb.plans.record(Plan.read("0: (visit r1 room) [5]\n"))
    after(validate, function, lambda other: other.erase("room", reason="asked"))
    assert kb.validate(made.id).valid
    after(links, function, lambda other: other.erase("r1", reason="asked"))
    assert kb.pddl.causal_links(made.id)


@pytest.mark.parametrize("function", ["state_lines", "states_at"])
def test_states_are_compared_by_one_name_of_each_object(
    kb: KnowledgeBase, after: Callable[..., None], function: str
) -> None:
    revision = kb.revision
    kb.propositions.save("(lit hall)")
    after(diff, function, lambda other: other.erase("hall", reason="asked"))
    [change] = kb.diff(kb.at(revision), kb)
    assert change in (Line("+", "fact", "(lit hall)"), Line("+", "fact", "(lit erased-1)"))
    assert len(kb.diff(kb, kb.at(revision))) == 1


def test_steps_are_those_of_one_state(kb: KnowledgeBase, after: Callable[..., None]) -> None:
    skip_in_memory(kb)
    for name in ("clean", "leave"):
        kb.actions.save(f"(:action {name} :parameters () :precondition (lit room))")
    after(act, "asked", lambda other: other.propositions.delete("(lit room)"))
    expected = ["(clean)", "(leave)"]
    assert [str(step) for step in kb.applicable_actions() if not step.arguments] == expected


def test_stale_facts_are_those_of_one_state(kb: KnowledgeBase, after: Callable[..., None]) -> None:
    skip_in_memory(kb)
    after(stale, "_needed", lambda other: other.propositions.delete("(lit room)"))
    assert [fact.text for fact in kb.stale("(lit ?p)", than=0)] == ["(lit room)"]
    assert kb.stale("(lit ?p)", than=0) == []


def test_a_planner_is_asked_again_if_a_name_was_erased_while_it_worked(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = kb.plans.record(Plan.read("(visit r1 hall)\n"))
    asked = []

    def plan(state: State, **options: Any) -> Plan:
        task = read_task(state)
        asked.append(task.revision)
        given = write(task.domain), write(task.problem)
        if len(asked) == 1:
            as_actor(kb, "camera").erase("hall", reason="asked")
        digest = problem_hash(given[0], problem=given[1])
        return replace(Plan.read("(visit r1 room)\n"), revision=task.revision, problem_hash=digest)

    monkeypatch.setattr(search, "plan", plan)
    found = kb.replan(made.id)
    assert len(asked) == 2
    assert [*map(str, found.plan.steps)] == ["(visit r1 room)"]
    assert kb.store.verify().is_intact


def test_an_archive_leaves_a_running_plan(
    kb: KnowledgeBase, after: Callable[..., None], tmp_path: Path
) -> None:
    after(execute, "running_executions", archived(tmp_path))
    found = kb.execute("(visit r1 hall) [5]\n(visit r1 room) [5]\n", lambda step: None)
    assert found.outcome == "failed"  # Its end depends on the state at its start.
    assert "was moved to an archive" in str(found.unsatisfied[0].unsatisfied)
    kb.actions.save(
        "(:durative-action visit :parameters (?r - robot ?p - place) :duration (= ?duration 5)"
        " :effect (at end (seen ?p)))"
    )
    after(execute, "running_executions", archived(tmp_path))
    found = kb.execute("(visit r1 hall) [5]\n(visit r1 room) [5]\n", lambda step: None)
    assert found.outcome == "succeeded"


def test_a_change_that_is_archived_at_once_touches_a_plan(
    kb: KnowledgeBase, after: Callable[..., None], tmp_path: Path
) -> None:
    plan = kb.plans.record(Plan.read("0: (visit r1 room) [5]\n"))
    remaining = replan.Remaining(plan.id)
    assert remaining.look(state_of(kb), plan) == (None, True)
    kb.propositions.delete("(lit room)")
    after(replan, "head_revision", archived(tmp_path))
    broken, is_judged = remaining.look(state_of(kb), plan)
    assert (broken, is_judged) == ("the goal (seen room): does not hold", True)


def test_statistics_have_one_name_of_each_object(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    kb.end(kb.start("(visit r1 room)"))
    after(statistics, "attrgetter", lambda other: other.erase("room", reason="asked"))
    found = {one.argument: one.unconfirmed for one in kb.statistics(by=["argument"])}
    assert found == {"r1": 2, "erased-1": 2}


def test_a_push_counts_only_what_it_sent(
    kb: KnowledgeBase, after: Callable[..., None], tmp_path: Path
) -> None:
    to = f"sqlite:///{tmp_path / 'copy.db'}"
    after(push._Push, "_retrying", lambda other: other.store.push(to))
    pushed = kb.store.push(to)
    assert (pushed.before, pushed.revisions, pushed.versions) == (kb.revision, 0, 0)


def test_a_text_is_erased_once_by_two_retentions(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    with kb.transaction(reason="a guest"):
        kb.propositions.save("(lit hall)")
    rules, revision = retention.read_rules(["* 0s reason"]), kb.revision
    after(retention, "Wanted", lambda other: other.store.retain(rules))
    assert (kb.store.retain(rules).revision, kb.revision) == (None, revision + 1)
    assert kb.store.verify().is_intact


@pytest.mark.parametrize("is_branch", [False, True])
def test_a_merge_refuses_changes_that_go_to_an_archive(
    kb: KnowledgeBase, after: Callable[..., None], tmp_path: Path, is_branch: bool
) -> None:
    with kb.branch(f"trial {is_branch}") as trial:
        for each in (kb, trial):
            each.propositions.delete("(lit room)")
            each.propositions.save_all(["(seen hall)", "(lit hall)"])
        moving, to = trial if is_branch else kb, f"sqlite:///{tmp_path / 'archive.db'}"
        after(merge, "_find", lambda other: moving.store.archive(moving.revision, to=to))
        with pytest.raises(ArchivedError, match="was moved to an archive"):
            kb.merge(trial)


def test_a_page_of_an_object_that_is_erased_says_so(
    kb: KnowledgeBase, after: Callable[..., None]
) -> None:
    after(element_pages, "read_state", lambda other: other.erase("room", reason="asked"))
    with pytest.raises(UnknownNameError, match="'room'"):
        element_pages.read_object_page(state_of(kb), "room")
    assert element_pages.read_object_page(state_of(kb), "erased-1").held


def test_a_page_of_a_state_is_of_its_revision(
    kb: KnowledgeBase, after: Callable[..., None], tmp_path: Path
) -> None:
    everything = state_parts.StateFilter()

    def facts(when: int | None) -> tuple[int, set[str]]:
        page = state_parts.read_state(state_of(kb), when, everything, "fact")
        return page.number, {each.text for part in page.parts for each in part.elements}

    kb.propositions.save("(seen hall)")
    revision, known = kb.revision, facts(kb.revision)
    after(state_parts, "state_at", lambda other: other.propositions.save("(seen room)"))
    assert facts(revision) == known
    assert facts(None)[0] == revision + 1
    after(state_parts, "state_at", archived(tmp_path))
    with pytest.raises(ArchivedError, match="was moved to an archive"):
        facts(revision)
