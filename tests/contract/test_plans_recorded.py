"""Plans on record: what is kept of them, what is refused, and what the past knew of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import Any

import pytest

from kant_sql import (
    InvalidArgumentError,
    InvalidKnowledgeError,
    KnowledgeBase,
    ReadOnlyError,
    UnknownRevisionError,
)
from kant_sql.errors import ArchivedError, PlanError
from kant_sql.planning import Plan, PlanStep, problem_hash
from tests.support.chain import check_chain
from tests.support.reading import documents, last_changes, nothing_changes, present, rows, undone
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.worlds.depot import again
from tests.support.worlds.missions import (
    PROBLEM,
    STEPS,
    TOUR,
    arrive,
    begin,
    beside_of,
    plan_of,
    recorded,
    step,
)


def refuses(
    kb: KnowledgeBase, *arguments: Any, error: type[Exception] = PlanError, **said: Any
) -> str:
    """What a plan is refused for, of which nothing is recorded."""
    with nothing_changes(kb), pytest.raises(error) as caught:
        kb.plans.record(*arguments, **said)
    assert type(caught.value) is error
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_plan_is_read_as_it_was_recorded(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    begin(kb)
    made = kb.plans.record(
        replace(TOUR, revision=1),
        planner="aries",
        planner_version="1.2 (build 7)",
        objective='minimize "time"',
        value=Decimal("11.10"),
    )
    assert (made.recorded_in, made.revision, kb.revision) == (2, 1, 2)
    assert (made.planner, made.planner_version) == ("aries", "1.2 (build 7)")
    assert (made.objective, str(made.value)) == ('minimize "time"', "11.10")
    assert made.status == "solved_satisficing"
    # Names are those of the store, in their first spelling.
    assert [str(one) for one in made.steps] == [
        *("(Move rb1 Wp1 wp2)", "(Move rb1 wp2 Home)", "(charge rb1 Home)", "(rest)")
    ]
    assert [str(one.start) for one in made.steps] == ["0.000", "5.010", "10.1", "11"]
    assert [one.duration and str(one.duration) for one in made.steps] == ["5.000"] * 2 + [None] * 2
    assert [one.position for one in made.steps] == [0, 1, 2, 3]
    assert {(one.plan_id, one.outcome, one.outcomes, one.revisions) for one in made.steps} == {
        (made.id, None, (), ())
    }
    newcomer = again(kb)
    assert newcomer.plans.get(made.id) == made == kb.plans.get(made.id)
    assert newcomer.plans.get_all() == [made]
    for strange in (made.id + 1, made.id - 1, 0, -1, 10**30):
        assert newcomer.plans.get(strange) is None
    nonsense: list[Any] = ["1", None, True, 1.0]
    for strange in nonsense:
        with pytest.raises(InvalidArgumentError, match="the id of a plan is a whole number, not"):
            newcomer.plans.get(strange)


def test_what_is_not_said_is_taken_from_the_plan_and_the_state(fresh_kb: KnowledgeBase) -> None:
    made = recorded(fresh_kb)
    assert (made.planner, made.planner_version) == ("hand", None)
    assert (made.objective, made.value) == ("minimize (total-cost)", None)
    assert made.revision == 1
    fresh_kb.pddl.metric.set(None)
    assert fresh_kb.plans.record(TOUR).objective is None
    assert fresh_kb.plans.record(replace(TOUR, revision=1)).objective == "minimize (total-cost)"
    assert fresh_kb.plans.record(Plan((), "", "")).planner is None


def test_the_change_line_says_all_of_it(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    domain, problem = documents(fresh_kb)
    made = fresh_kb.plans.record(plan_of(*STEPS[1:3]), objective='a "b"\n', value=-3)
    assert made.problem_hash == problem_hash(domain, problem=problem)
    assert last_changes(fresh_kb) == [
        f"+ plan (:plan {made.id} :revision 1 "
        f':problem-hash "{made.problem_hash}" :planner "hand" :planner-version null '
        ':objective "a \\"b\\"\\n" :value -3 :status "solved_satisficing" '
        ":domain-pddl null :problem-pddl null "
        ":steps ((5.010 (Move rb1 wp2 Home) 5.000) (10.1 (charge rb1 Home) null)))"
    ]


def test_rows_refer_to_actions_and_objects_by_id(fresh_kb: KnowledgeBase) -> None:
    made = recorded(fresh_kb)
    found = rows(
        fresh_kb,
        "SELECT position, argument, name FROM execution_argument AS a JOIN object "
        "ON object.kb_id = a.kb_id AND object.id = object_id "
        f"WHERE a.kb_id = :kb AND plan_id = {made.id} ORDER BY position, argument",
    )
    assert found == [
        *((0, 0, "rb1"), (0, 1, "Wp1"), (0, 2, "wp2")),
        *((1, 0, "rb1"), (1, 1, "wp2"), (1, 2, "Home")),
        *((2, 0, "rb1"), (2, 1, "Home")),
    ]
    names = rows(
        fresh_kb,
        "SELECT action.name FROM execution AS s JOIN action ON action.kb_id = s.kb_id "
        f"AND action.id = action_id WHERE s.kb_id = :kb AND plan_id = {made.id} ORDER BY position",
    )
    assert names == [("Move",), ("Move",), ("charge",), ("rest",)]


def test_a_plan_without_steps_or_without_times_is_one(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    empty = fresh_kb.plans.record(plan_of())
    assert (empty.steps, fresh_kb.plans.get(empty.id)) == ((), empty)
    timeless = fresh_kb.plans.record(plan_of(PlanStep(None, "rest")))
    assert (timeless.steps[0].start, timeless.steps[0].duration) == (None, None)
    assert [plan.id for plan in fresh_kb.plans.get_all()] == [empty.id, timeless.id]


def test_a_plan_outlives_what_it_speaks_of(fresh_kb: KnowledgeBase) -> None:
    made = recorded(fresh_kb)
    with fresh_kb.transaction():
        fresh_kb.actions.delete_all()
        fresh_kb.objects.delete_all()
    assert fresh_kb.plans.get(made.id) == made
    # Later plans from that state go on record all the same, for a state is what it was.
    assert fresh_kb.plans.record(replace(TOUR, revision=1)).steps[0].action == "Move"
    assert "action 'MOVE' is not known at revision 4" in refuses(fresh_kb, TOUR)


WRONG: list[tuple[PlanStep, str]] = [
    (step("fly", "rb1"), "action 'fly' is not known at revision 1"),
    (step("spill", "wp1"), "'spill' is of kind event"),
    (step("move", "rb1", "wp1"), "has 2 arguments, expected 3 as in (:durative-action Move"),
    (step("rest", "rb1"), "has 1 arguments, expected 0 as in (:action rest"),
    (step("move", "rb1", "wp1", "wp9"), "object 'wp9' is not known at revision 1"),
    (step("mov", "rb1"), "the state that it was planned from (did you mean Move?); give the plan"),
    (step("move", "rb1", "wp1", "homer"), "planned from (did you mean Home?); give the plan"),
    (step("charge", "rb1", "wp1"), "argument 2, 'Wp1', is 'Wp1 - place' at revision 1, expected a"),
    (step("charge", "wp1", "home"), "argument 1, 'Wp1', is 'Wp1 - place'"),
    (step("rest", start="-1"), "its start is -1, expected 0 seconds or more"),
    (step("rest", duration="-0.001"), "its duration is -0.001, expected 0 seconds or more"),
]


def test_steps_that_do_not_go_with_the_state_are_refused(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    for wrong, what in WRONG:
        message = refuses(fresh_kb, plan_of(STEPS[0], wrong))
        assert message.startswith("step 1 of the plan")
        assert what in message
    assert fresh_kb.plans.get_all() == []


def test_what_cannot_be_kept_is_refused(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    assert "the planner's name 'a\\x00b' has a NUL" in refuses(fresh_kb, TOUR, planner="a\0b")
    assert "the planner's version" in refuses(fresh_kb, TOUR, planner_version="\ud800")
    assert "the objective is a string or None" in refuses(fresh_kb, TOUR, objective=3)
    assert "the plan's status" in refuses(fresh_kb, replace(TOUR, status="\0"))
    refusal = refuses(fresh_kb, TOUR, value=Decimal("NaN"))
    assert "the objective's value: " in refusal
    assert " NaN; " in refusal
    assert "domain_pddl" in refuses(fresh_kb, TOUR, domain_pddl="\0")
    assert "problem_pddl" in refuses(fresh_kb, TOUR, problem_pddl="\udfff")
    assert "as Plan.read(text) returns it, not 'a plan'" in refuses(fresh_kb, "a plan")


def test_a_plan_is_of_a_state_that_there_is(fresh_kb: KnowledgeBase) -> None:
    assert "before its first revision" in refuses(fresh_kb, plan_of())
    begin(fresh_kb)
    assert "before its first revision" in refuses(fresh_kb, plan_of(revision=0))
    for revision in (2, 10**30):
        refuses(fresh_kb, plan_of(revision=revision), error=UnknownRevisionError)
    nonsense: list[Any] = ["1", -1, True, 1.0]
    for revision in nonsense:
        with pytest.raises(InvalidKnowledgeError, match="the revision of a Plan is a whole number"):
            plan_of(revision=revision)


def test_what_a_transaction_has_not_committed_is_no_state_yet(fresh_kb: KnowledgeBase) -> None:
    with undone(fresh_kb):
        begin(fresh_kb)
        with pytest.raises(PlanError, match="before its first revision"):
            fresh_kb.plans.record(plan_of())
    begin(fresh_kb)
    with fresh_kb.transaction():
        assert fresh_kb.actions.delete(fresh_kb.actions.get("rest"))  # type: ignore[arg-type]
        made = fresh_kb.plans.record(TOUR)
        assert (made.revision, made.recorded_in) == (1, 2)
        assert fresh_kb.plans.get(made.id) == made
    assert fresh_kb.plans.get(made.id) == made


def test_a_recorded_plan_is_gone_with_what_was_to_record_it(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    with undone(fresh_kb):
        lost = fresh_kb.plans.record(TOUR)
    assert fresh_kb.plans.get_all() == []
    with pytest.raises(PlanError, match=f"has no plan {lost.id}: the transaction that recorded it"):
        lost.problem_pddl()
    with fresh_kb.transaction():
        kept = fresh_kb.plans.record(TOUR)
        for read in (True, False):
            with undone(fresh_kb):
                fresh_kb.plans.record(plan_of())
                assert not read or len(fresh_kb.plans.get_all()) == 2
        assert fresh_kb.plans.get_all() == [kept]
    assert fresh_kb.plans.get_all() == [kept]
    assert len(last_changes(fresh_kb)) == 1


def test_a_view_of_the_past_knows_the_plans_of_then(fresh_kb: KnowledgeBase) -> None:
    first = recorded(fresh_kb)
    second = fresh_kb.plans.record(plan_of())
    assert fresh_kb.at(1).plans.get_all() == []
    assert fresh_kb.at(2).plans.get_all() == [first]
    assert fresh_kb.at(2).plans.get(second.id) is None
    assert fresh_kb.at(3).plans.get_all() == [first, second]
    past = fresh_kb.at(2)
    with pytest.raises(ReadOnlyError):
        past.plans.record(TOUR)
    with pytest.raises(ReadOnlyError):
        past.plans.set_status(first.steps[0], status="running")


def test_plans_of_two_knowledge_bases_do_not_mix(fresh_kb: KnowledgeBase) -> None:
    made = recorded(fresh_kb)
    other = beside_of(fresh_kb)
    assert (other.plans.get_all(), other.plans.get(made.id)) == ([], None)
    twin = recorded(other)
    assert twin.id == made.id
    assert twin != made
    assert fresh_kb.plans.get_all() == [made]


def test_the_hash_covers_a_plan_in_a_transaction_that_is_too_large_to_keep(
    shared_url: str, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kant_sql.store.transaction.SPILL_AT", 10)
    kb = connect(shared_url)
    begin(kb)
    with kb.transaction():
        made = kb.plans.record(TOUR)
        kb.plans.set_status(made.steps[0], status="running")
        kb.objects.save_all(f"p{number} - place" for number in range(30))
        kb.propositions.save_all(f"(dirty p{number})" for number in range(30))
        kb.plans.set_status(made.steps[0], status="failed")
        kb.plans.record(plan_of())
    assert check_chain(shared_url) == {"default": 2}
    kinds = [change.kind for change in next(kb.log(limit=1)).changes]
    assert [kind for kind in kinds if kind in ("plan", "execution")] == [
        "execution",
        "plan",
        "plan",
    ]
    assert kinds.count("fact") == 30


READ = 6


def test_reading_takes_as_many_statements_for_any_number_of_plans(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    made = recorded(kb)
    kb.plans.set_status(made.steps[0], status="running")
    with kb.transaction(execution=made.steps[0]):
        arrive(kb, "wp2")
    few = {count(kb.plans.get_all), count(partial(kb.plans.get, made.id))}
    for _ in range(20):
        other = kb.plans.record(TOUR)
        for one in other.steps[:3]:
            kb.plans.set_status(one, status="running")
            kb.plans.set_status(one, status="failed")
    assert few == {count(kb.plans.get_all), count(partial(kb.plans.get, made.id))} == {READ}
    past = kb.at(kb.revision)
    past.plans.get_all()
    assert count(past.plans.get_all) <= READ


def test_writing_takes_as_many_statements_however_long_the_plan_is(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    begin(kb)
    calls: list[Callable[[], Any]] = [
        partial(kb.plans.record, plan_of(*[*STEPS] * times, revision=1)) for times in (1, 50, 200)
    ]
    calls[1]()
    # PostgreSQL writes a few rows of two tables in one statement, and copies many.
    few, *many = map(count, calls)
    assert few in (many[0], many[0] - 1)
    assert len({*many}) == 1
    one = kb.plans.get_all()[0].steps[0]
    # The head, the step, the revision, its version, the head; and one that closes the one before.
    # PostgreSQL writes some of these in one.
    assert count(partial(kb.plans.set_status, one, status="running")) <= 5
    assert count(partial(kb.plans.set_status, one, status="running")) == 2
    assert count(partial(kb.plans.set_status, one, status="failed")) <= 6
    with kb.transaction(execution=one):
        assert count(partial(arrive, kb, "wp2")) <= 2


def test_a_plan_stays_when_the_state_that_it_was_made_from_is_archived(
    kb: KnowledgeBase, file_url: str, connect: Connect
) -> None:
    made = recorded(kb)
    texts = made.domain_pddl(), made.problem_pddl()
    kept = kb.plans.record(plan_of(revision=1), domain_pddl="a", problem_pddl="b")
    with kb.transaction():
        kb.propositions.delete_all()
        kb.actions.delete_all()
    arrive(kb, "wp2")
    kb.store.archive(kb.revision, to=file_url)
    assert kb.plans.get_all() == [made, kept]
    assert kept.problem_pddl() == "b"
    with pytest.raises(ArchivedError, match=r"file\.db"):
        made.problem_pddl()
    refuses(kb, plan_of(revision=1), error=ArchivedError)
    moved = present(connect(file_url, knowledge_base="tiago").plans.get(made.id))
    assert moved == made
    assert (moved.domain_pddl(), moved.problem_pddl()) == texts


def test_a_plan_that_was_read_is_recorded(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    text = "\n".join(str(each) for each in TOUR.steps).upper()
    made = fresh_kb.plans.record(Plan.read(f"; Plan found with metric 7.50\n{text}\n"))
    kept = fresh_kb.plans.record(TOUR)
    assert [(one.start, one.action, one.arguments, one.duration) for one in made.steps] == [
        (one.start, one.action, one.arguments, one.duration) for one in kept.steps
    ]
    assert (made.planner, made.status) == (None, "solved_satisficing")
    assert (made.objective, made.value) == ("minimize (total-cost)", Decimal("7.50"))
    assert fresh_kb.plans.record(replace(TOUR, value=Decimal(3)), value=8).value == 8
    # Without an objective, there is nothing that the number is the value of.
    fresh_kb.load_problem(PROBLEM.replace("(:metric minimize (total-cost))", ""))
    bare = fresh_kb.plans.record(Plan.read(";;;; Solution Found\n; Cost: 7.50\n"))
    assert (bare.objective, bare.value) == (None, None)


def test_plans_are_numbered_from_one(kb: KnowledgeBase) -> None:
    kb.load_domain("(define (domain d) (:predicates (p)) (:action a :effect (p)))")
    plan = Plan((PlanStep(None, "a"),), "by hand", "unknown")
    numbers = [kb.plans.record(plan).id]
    with kb.transaction():
        numbers += [kb.plans.record(plan).id, kb.plans.record(plan).id]
        with undone(kb):
            kb.plans.record(plan)
        kb.propositions.save("(p)")
        numbers += [kb.plans.record(plan).id]
    numbers += [kb.plans.record(plan).id for _ in range(40)]
    assert numbers == [*range(1, 45)]
    assert kb.store.verify().is_intact
