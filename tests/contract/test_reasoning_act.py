"""Explaining what does not hold, and executing steps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import pytest

from kant_sql import (
    Change,
    FailedCondition,
    InvalidArgumentError,
    InvalidKnowledgeError,
    KnowledgeBase,
    NotApplicableError,
    PddlError,
    PlanError,
    PlanStep,
    ReadOnlyError,
    UnsupportedConstructError,
)
from kant_sql.errors import ArchivedError, TypeMismatchError
from kant_sql.planning import Plan
from kant_sql.reasoning import durative
from tests.support.reading import loaded, nothing_changes, present, store_of
from tests.support.statements import count
from tests.support.stores import Connect

DOMAIN = """
(define (domain travel)
  (:requirements :typing :fluents :object-fluents :conditional-effects :durative-actions
    :preferences :negative-preconditions)
  (:types city - object aircraft person - thing)
  (:predicates (at ?x - thing ?c - city) (in ?p - person ?a - aircraft) (lit ?c - city)
    (busy ?a - aircraft) (calm))
  (:functions (fuel ?a - aircraft) - number (dist ?a ?b - city) - number (total) - number
    (last ?a - aircraft) - city)
  (:action board :parameters (?p - person ?a - aircraft ?c - city)
    :precondition (and (at ?p ?c) (at ?a ?c) (preference p (calm)))
    :effect (and (not (at ?p ?c)) (in ?p ?a)))
  (:action fly :parameters (?a - aircraft ?x ?y - city)
    :precondition (and (at ?a ?x) (>= (fuel ?a) (dist ?x ?y)))
    :effect (and (not (at ?a ?x)) (at ?a ?y) (decrease (fuel ?a) (dist ?x ?y))
      (increase (total) (* 2 (dist ?x ?y))) (assign (last ?a) ?x)
      (forall (?p - person) (when (in ?p ?a) (lit ?y)))))
  (:action swap :parameters (?x ?y - city)
    :effect (and (when (lit ?x) (and (not (lit ?x)) (lit ?y)))
      (when (lit ?y) (and (not (lit ?y)) (lit ?x)))))
  (:action stay :parameters (?a - aircraft ?x - city) :precondition (at ?a ?x)
    :effect (and (not (at ?a ?x)) (at ?a ?x)))
  (:action numbers :parameters (?a - aircraft)
    :effect (and (scale-up (total) 3) (scale-down (total) 2) (assign (fuel ?a) (total))))
  (:action twice :parameters () :effect (and (increase (total) 1) (decrease (total) 0.25)))
  (:action wrong :parameters () :effect (and (assign (total) 1) (assign (total) 2)))
  (:action lost :parameters (?a - aircraft) :effect (lit (last ?a)))
  (:durative-action long :parameters (?a - aircraft ?x ?y - city)
    :duration (= ?duration (/ (dist ?x ?y) 2))
    :condition (and (at start (at ?a ?x)) (over all (not (lit ?x))) (at end (busy ?a)))
    :effect (and (at start (not (at ?a ?x))) (at start (busy ?a)) (at end (not (busy ?a)))
      (at end (at ?a ?y)) (at end (increase (total) ?duration))
      (when (at start (lit ?y)) (at end (calm)))))
  (:durative-action free :parameters () :duration (and (>= ?duration 2) (<= ?duration 4))
    :effect (at end (increase (total) ?duration))))
"""
PROBLEM = """
(define (problem trip) (:domain travel)
  (:objects c0 c1 - city p1 - aircraft h1 h2 - person)
  (:init (at p1 c0) (at h1 c0) (at h2 c1)
    (= (fuel p1) 10) (= (dist c0 c1) 3.5) (= (dist c1 c0) 4) (= (total) 0.1))
  (:goal (and (at p1 c1) (lit c1) (preference home (at h1 c1))
    (forall (?p - person) (preference each (at ?p c0)))))
  (:metric minimize (+ (total) (+ (* 3 (is-violated home)) (is-violated each)))))
"""


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with an aircraft and two persons."""
    return loaded(fresh_kb, DOMAIN, PROBLEM)


def total(kb: KnowledgeBase) -> object:
    return kb.function_values.get("total")


def texts(steps: Iterator[PlanStep]) -> list[str]:
    return [str(step) for step in steps]


# Explain.


def test_the_parts_of_a_condition_that_fail_are_named_in_order(kb: KnowledgeBase) -> None:
    condition = """(and (at p1 c1) (at p1 c0) (forall (?p - person) (at ?p c0)) (not (at h1 c0))
      (> (fuel p1) (* 4 (dist c0 c1))) (< (fuel p1) (dist c0 c0)) (or (lit c0) (lit c1))
      (not (exists (?c - city) (at h2 ?c))) (imply (at p1 c0) (lit c0))
      (not (imply (lit c0) (lit c1))))"""
    assert kb.unsatisfied(condition) == [
        FailedCondition("(at p1 c1)", "does not hold"),
        FailedCondition("(at h2 c0)", "does not hold"),
        FailedCondition("(not (at h1 c0))", "does not hold"),
        FailedCondition(
            "(> (fuel p1) (* 4 (dist c0 c1)))", "the sides are 10 and 14", Decimal(10), Decimal(14)
        ),
        FailedCondition(
            "(< (fuel p1) (dist c0 c0))", "the sides are 10 and no value", Decimal(10), None
        ),
        FailedCondition("(or (lit c0) (lit c1))", "does not hold"),
        FailedCondition("(not (at h2 c1))", "does not hold"),
        FailedCondition("(imply (at p1 c0) (lit c0))", "does not hold"),
        FailedCondition("(lit c0)", "does not hold"),
    ]
    assert kb.unsatisfied("(and (at p1 c0) (not (lit c0)))") == []
    assert kb.unsatisfied("(at ?x c1)", x="h2") == []
    [failed] = kb.unsatisfied("(at ?x c1)", x="p1")
    assert str(failed) == "(at p1 c1): does not hold"
    [free] = kb.unsatisfied("(in ?p ?a)")
    assert free.condition == "(exists (?p ?a) (in ?p ?a))"
    with pytest.raises(PddlError, match="c0 of type city"):
        kb.unsatisfied("(at ?x c1)", x="c0")


def test_a_variable_may_be_of_a_wider_type_than_its_predicate(kb: KnowledgeBase) -> None:
    check = """(:constants p1 - aircraft) (:action check :parameters ()
      :precondition (forall (?p - thing) (in ?p p1)) :effect (calm)))"""
    kb.load_domain(f"{DOMAIN.rstrip()[:-1]} {check}")
    wanted = [f"(in {name} p1): does not hold" for name in ("p1", "h1", "h2")]
    assert [str(part) for part in kb.unsatisfied("(forall (?p - thing) (in ?p p1))")] == wanted
    assert [str(part) for part in kb.why_not("(check)")] == wanted
    with pytest.raises(NotApplicableError, match=r"\(in p1 p1\): does not hold"):
        kb.apply("(check)")


def test_a_fact_that_held_before_has_the_revision_that_retracted_it(kb: KnowledgeBase) -> None:
    held = kb.revision
    fact = "(at p1 c0)"
    with kb.transaction(actor="perception", reason="the aircraft is gone"):
        kb.propositions.delete(fact)
    [failed] = kb.unsatisfied("(and (at p1 c0) (at h1 c0))")
    assert failed.retracted is not None
    assert failed.retracted.number == kb.revision
    assert failed.retracted.actor == "perception"
    assert failed.retracted.reason == "the aircraft is gone"
    gone = kb.revision
    kb.propositions.save(fact)
    kb.propositions.delete(fact)
    assert kb.at(held).unsatisfied("(at p1 c0)") == []
    [then] = kb.at(gone).unsatisfied("(at p1 c0)")
    assert then.retracted == failed.retracted
    [now] = kb.unsatisfied("(at p1 c0)")
    assert present(now.retracted).number == kb.revision
    assert kb.unsatisfied("(and (at p1 c0) (at p1 c0))") == [now, now]


def test_many_failing_facts_take_few_statements(kb: KnowledgeBase) -> None:
    kb.holds("(calm)")
    few = "(and (at h1 c1) (in h1 p1) (lit c0))"
    many = f"(and {' '.join(f'(at {p} {c})' for p in ('p1', 'h1', 'h2') for c in ('c0', 'c1'))})"
    assert count(lambda: kb.unsatisfied(few)) <= 9
    assert count(lambda: kb.unsatisfied(many)) <= 5


def test_goals_and_metric(kb: KnowledgeBase) -> None:
    assert [failed.condition for failed in kb.unsatisfied()] == ["(at p1 c1)", "(lit c1)"]
    # (total) is 0.1; `home` is violated, and `each` for h2.
    assert kb.pddl.metric_value() == Decimal("4.1")
    kb.apply("(board h1 p1 c0)")
    kb.apply("(fly p1 c0 c1)")
    assert kb.unsatisfied() == []
    assert kb.pddl.metric_value() == Decimal("12.1")
    past = kb.at(2)
    assert (not past.unsatisfied(), past.pddl.metric_value()) == (False, Decimal("4.1"))


def test_a_metric_that_no_state_has_is_refused_by_name(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.pddl.metric_value() is None
    assert not fresh_kb.unsatisfied()
    fresh_kb.load_domain("(define (domain d) (:predicates (p)) (:functions (cost)))")
    for metric, error, message in (
        ("total-time", UnsupportedConstructError, "total-time"),
        ("(is-violated q)", UnsupportedConstructError, "preference 'q'"),
        ("(cost)", InvalidKnowledgeError, "has no value"),
    ):
        fresh_kb.load_problem(f"""(define (problem p) (:domain d) (:init) (:goal (and))
          (:constraints (preference q (always (p)))) (:metric minimize {metric}))""")
        with pytest.raises(error, match=message):
            fresh_kb.pddl.metric_value()


def test_a_metric_counts_a_cost_without_a_value_from_0(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("(define (domain d) (:predicates (p)) (:functions (Total-Cost) (load)))")
    fresh_kb.load_problem("""(define (problem p) (:domain d) (:init (= (load) 2)) (:goal (and))
      (:metric minimize (+ (load) (total-cost))))""")
    assert fresh_kb.pddl.metric_value() == fresh_kb.validate([]).metric_value == 2
    fresh_kb.function_values.set("total-cost", value=3)
    assert fresh_kb.pddl.metric_value() == fresh_kb.validate([]).metric_value == 5
    fresh_kb.function_values.delete_all()
    assert fresh_kb.validate([]).metric_value is None
    with pytest.raises(InvalidKnowledgeError, match="has no value"):
        fresh_kb.pddl.metric_value()


def test_why_a_step_cannot_be_executed(kb: KnowledgeBase) -> None:
    assert kb.why_not("(fly p1 c0 c1)") == []
    assert [str(failed) for failed in kb.why_not("(fly p1 c1 c0)")] == ["(at p1 c1): does not hold"]
    assert [str(failed) for failed in kb.why_not("(fly h1 c0 p1)")] == [
        "?a - aircraft: h1 is of type person, expected aircraft",
        "?y - city: p1 is of type aircraft, expected city",
    ]
    kb.function_values.set("fuel", objects=["p1"], value=2)
    [failed] = kb.why_not(PlanStep(None, "FLY", ("P1", "C0", "C1")))
    assert (failed.left, failed.right) == (Decimal(2), Decimal("3.5"))
    assert [failed.condition for failed in kb.why_not("(long p1 c1 c0)")] == ["(at p1 c1)"]
    for step, message in (
        ("(flyy p1 c0 c1)", "did you mean fly"),
        ("(fly p1 c0 c9)", "the object 'c9'"),
        ("(fly p1 c0", "the end of the text"),
    ):
        with pytest.raises(PddlError, match=message):
            kb.why_not(step)
    with pytest.raises(InvalidKnowledgeError, match="has 2 arguments, expected 3"):
        kb.why_not("(fly p1 c0)")
    with pytest.raises(InvalidKnowledgeError, match="'flyy' is not known"):
        kb.why_not(PlanStep(None, "flyy"))
    with pytest.raises(PlanError, match="is not a step; give text"):
        kb.why_not(3)  # type: ignore[arg-type]


# Act.


def test_applicable_actions(kb: KnowledgeBase) -> None:
    expected = ["(board h1 p1 c0)", "(fly p1 c0 c1)"]
    expected += [f"(swap {x} {y})" for x in ("c0", "c1") for y in ("c0", "c1")]
    expected += ["(stay p1 c0)", "(numbers p1)", "(twice)", "(long p1 c0 c1)"]
    assert texts(kb.applicable_actions()) == expected
    assert all(not kb.why_not(step) for step in expected)
    for step in ("(wrong)", "(lost p1)", "(long p1 c0 c0)", "(free)", "(free) [1]"):
        assert kb.why_not(step)
    assert kb.why_not("(free) [3]") == []
    assert texts(kb.applicable_actions("fly")) == ["(fly p1 c0 c1)"]
    assert texts(kb.applicable_actions(limit=3)) == expected[:3]
    assert texts(kb.applicable_actions("swap", limit=2, y="c1")) == ["(swap c0 c1)", "(swap c1 c1)"]
    assert texts(kb.applicable_actions(p="h1")) == ["(board h1 p1 c0)"]
    assert texts(kb.applicable_actions(p="h2")) == []
    kb.propositions.delete_all()
    assert "(fly p1 c0 c1)" not in texts(kb.applicable_actions())
    assert texts(kb.at(2).applicable_actions()) == expected
    with pytest.raises(InvalidArgumentError, match=r"no parameter \?z"):
        kb.applicable_actions("fly", z="p1")
    with pytest.raises(InvalidArgumentError, match="no action has parameters"):
        kb.applicable_actions(zz="p1")
    with pytest.raises(TypeMismatchError):
        kb.applicable_actions("fly", a="c0")
    with pytest.raises(InvalidKnowledgeError, match="'flies' is not known"):
        kb.applicable_actions("flies")


def test_each_action_takes_one_statement(kb: KnowledgeBase) -> None:
    # The order of a join is chosen once, by how many facts there are.
    _ = list(kb.applicable_actions())
    # One more reads the head.
    assert count(lambda: kb.applicable_actions("fly")) == 2
    assert count(lambda: kb.applicable_actions(limit=2)) == 3
    assert count(kb.applicable_actions) == 10
    assert count(lambda: kb.why_not("(fly p1 c0 c1)")) == 1


def test_a_step_is_one_revision(kb: KnowledgeBase) -> None:
    before = kb.revision
    assert kb.apply("(board h1 p1 c0)", reason="first call") == before + 1
    assert kb.apply(PlanStep(None, "fly", ("p1", "c0", "c1"))) == before + 2
    first, second = kb.store.revisions(before)
    assert (first.reason, second.reason) == ("first call", "applied (fly p1 c0 c1)")
    [entry] = kb.log(since=before + 2)
    did, *effects = [f"{change.sign}{change.text}" for change in entry.changes]
    assert did == f"+(:execution {next(kb.executions.get_all()).id} (fly p1 c0 c1) succeeded)"
    assert effects == [
        *("+(at p1 c1)", "+(lit c1)", "+(= (fuel p1) 6.5)", "+(= (last p1) c0)"),
        *("+(= (total) 7.1)", "-(at p1 c0)", "-(= (fuel p1) 10)", "-(= (total) 0.1)"),
    ]
    assert kb.store.verify().is_intact


def test_a_step_that_cannot_be_executed_writes_nothing(kb: KnowledgeBase) -> None:
    before = kb.revision
    with pytest.raises(NotApplicableError, match=r"\(fly p1 c1 c0\) cannot be applied") as caught:
        kb.apply("(fly p1 c1 c0)")
    assert caught.value.unsatisfied == (FailedCondition("(at p1 c1)", "does not hold"),)
    for step, message in (
        ("(fly h1 c0 c1)", "h1 is of type person"),
        ("(wrong)", "assigns it several values"),
        ("(free)", "duration"),
        ("(free) [5]", "the sides are 5 and 4"),
        ("(long p1 c0 c0)", "no value"),
        ("(free) [1]", r"the sides are 1 and 2; a duration may deviate by 0\.01"),
    ):
        with pytest.raises(NotApplicableError, match=message):
            kb.apply(step)
    kb.function_values.unset("total")
    with pytest.raises(NotApplicableError, match="has no value that could be changed"):
        kb.apply("(twice)")
    assert kb.revision == before + 1
    with pytest.raises(ReadOnlyError):
        kb.at(before).apply("(twice)")
    with pytest.raises(PlanError, match=r"'twice' is an action without duration, but \[5\] is"):
        kb.apply("(twice) [5]")


def test_conditions_and_values_are_those_of_the_state_before(kb: KnowledgeBase) -> None:
    kb.apply("(board h1 p1 c0)")
    kb.apply("(fly p1 c0 c1)")
    assert kb.apply("(swap c1 c0)") is not None
    assert kb.query("(lit ?c)").to_dicts() == [{"c": "c0"}]
    # Deletes before adds: nothing changes, and it was done.
    made = kb.apply("(stay p1 c1)")
    assert made == kb.revision
    assert [change.kind for change in kb.diff(made - 1, made)] == []
    assert [change.kind for change in next(kb.log()).changes] == ["execution"]
    kb.function_values.set("total", objects=[], value=Decimal("0.1"))
    kb.apply("(numbers p1)")
    assert total(kb) == Decimal("0.15")
    assert kb.function_values.get("fuel", objects=["p1"]) == Decimal("0.1")
    kb.apply("(twice)")
    assert total(kb) == Decimal("0.90")
    kb.apply("(lost p1)")
    assert len(kb.query("(lit ?c)")) == 1  # (last p1) is c0, which is lit


def test_a_step_of_a_recorded_plan_keeps_its_status(kb: KnowledgeBase) -> None:
    steps = (PlanStep(None, "board", ("h1", "p1", "c0")), PlanStep(None, "fly", ("p1", "c0", "c1")))
    plan = kb.plans.record(Plan(steps, "by hand", "solved_satisficing"))
    revision = kb.apply(plan.steps[0])
    read = present(kb.plans.get(plan.id))
    assert [step.outcome for step in read.steps] == ["succeeded", None]
    assert read.steps[0].revisions == (revision,)
    kb.apply("(fly p1 c0 c1)", execution=plan.steps[1])
    read = present(kb.plans.get(plan.id))
    assert (read.steps[1].outcome, read.steps[1].revisions) == (None, (kb.revision,))


def test_effects_of_a_step_are_written_once(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = kb.executions.report("twice", outcome="running")
    kb.apply(running)
    with nothing_changes(kb), pytest.raises(PlanError, match="'succeeded' already"):
        kb.apply(running)
    started = kb.start("(free) [3]")
    with nothing_changes(kb), pytest.raises(PlanError, match="'running' already"):
        kb.apply(started)
    # Two writers find that it runs, and both end it.
    found = durative._running(store_of(kb), started)
    monkeypatch.setattr(durative, "_running", lambda *_: found)
    kb.end(started)
    with nothing_changes(kb), pytest.raises(PlanError, match="'succeeded' already"):
        kb.end(started)


# Durative actions in two halves.


def test_a_durative_step_in_two_halves(kb: KnowledgeBase) -> None:
    step = kb.start("(long p1 c0 c1)", reason="take off")
    assert (step.outcome, step.duration) == ("running", Decimal("1.75"))
    assert step.arguments == ("p1", "c0", "c1")
    started = kb.revision
    assert [each.reason for each in kb.store.revisions(started - 1)] == ["take off"]
    assert kb.holds("(and (busy p1) (not (at p1 c0)) (not (at p1 c1)))")
    with pytest.raises(NotApplicableError, match="it is running"):
        kb.start("(long p1 c0 c1)")
    assert kb.pddl.broken_invariants() == []
    ended = kb.end("(LONG p1 c0 c1)").revision
    assert ended == started + 1
    assert kb.holds("(and (not (busy p1)) (at p1 c1))")
    assert total(kb) == Decimal("1.85")
    read = present(kb.executions.get(step.id))
    assert (read.outcome, read.revisions) == ("succeeded", (started, ended))
    with pytest.raises(PlanError, match="is not running: start it first; running are: none"):
        kb.end(step)
    assert kb.store.verify().is_intact


def test_invariants_of_running_steps(kb: KnowledgeBase) -> None:
    step = kb.start("(long p1 c0 c1)")
    with kb.transaction(actor="perception", reason="dusk"):
        kb.propositions.save("(lit c0)")
    dusk = kb.revision
    [broken] = kb.pddl.broken_invariants()
    assert (broken.step.id, broken.unsatisfied.condition) == (step.id, "(not (lit c0))")
    assert broken.since is not None
    assert (broken.since.number, broken.since.actor) == (dusk, "perception")
    assert str(broken) == (
        f"(long p1 c0 c1): (not (lit c0)): does not hold, since revision {dusk} by perception"
    )
    with pytest.raises(NotApplicableError, match=r"\(not \(lit c0\)\)"):
        kb.end(step)
    aborted = kb.abort(step, reason="lights")
    assert aborted.revision == dusk + 1
    assert str(aborted) == "(long p1 c0 c1) was aborted; it leaves +(busy p1), -(at p1 c0)"
    assert kb.pddl.broken_invariants() == []
    read = present(kb.executions.get(step.id))
    assert read.outcome == "aborted"
    with pytest.raises(PlanError, match="of the present"):
        kb.at(dusk).pddl.broken_invariants()


def test_looking_at_many_steps_takes_as_many_statements_as_at_one(fresh_kb: KnowledgeBase) -> None:
    kb = fresh_kb
    kb.load_domain(
        "(define (domain wait) (:requirements :typing :durative-actions)"
        " (:types robot) (:predicates (free ?r - robot) (lit))"
        " (:durative-action wait :parameters (?r - robot) :duration (= ?duration 9)"
        " :condition (and (over all (free ?r)) (over all (not (lit)))) :effect (and)))"
    )
    robots = [f"r{number}" for number in range(12)]
    kb.objects.save([f"{robot} - robot" for robot in robots])
    kb.propositions.save([f"(free {robot})" for robot in robots])
    kb.start("(wait r0)")
    one = count(kb.pddl.broken_invariants)
    for robot in robots[1:]:
        kb.start(f"(wait {robot})")
    assert count(kb.pddl.broken_invariants) == one
    kb.propositions.delete("(free r7)")
    kb.propositions.delete("(free r3)")
    broken = kb.pddl.broken_invariants()
    assert [(one.step.arguments, one.unsatisfied.condition) for one in broken] == [
        (("r3",), "(free r3)"),
        (("r7",), "(free r7)"),
    ]


DRIVE = """
(define (domain drive) (:requirements :durative-actions :fluents :conditional-effects)
  (:predicates (sunny) (warm)) (:functions (battery))
  (:durative-action drive :parameters () :duration (<= ?duration 9)
    :condition (over all (>= (battery) ?duration))
    :effect (and (at start (decrease (battery) 1)) (when (at start (sunny)) (at end (warm))))))
"""


def test_who_breaks_a_condition_with_a_duration_is_named(
    fresh_kb: KnowledgeBase, tmp_path: Path
) -> None:
    kb = fresh_kb
    kb.load_domain(DRIVE)
    kb.function_values.set("(battery)", value=9)
    step = kb.start("(drive) [4]")
    with kb.transaction(actor="thief"):
        kb.function_values.set("(battery)", value=3)
    [broken] = kb.pddl.broken_invariants()
    assert str(broken).endswith(f"the sides are 3 and 4, since revision {kb.revision} by thief")
    # What the end would need to know is archived; it can be aborted.
    kb.store.archive(kb.revision, to=f"sqlite:///{tmp_path / 'archive.db'}")
    with pytest.raises(ArchivedError):
        kb.end(step)
    assert str(kb.abort(step)) == "(drive) was aborted; what it leaves is not known"


def test_rules_that_use_each_other_are_judged_after_the_start(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain lights)
      (:requirements :durative-actions :derived-predicates)
      (:predicates (on) (bright) (seen))
      (:derived (bright) (or (on) (seen))) (:derived (seen) (and (bright) (on)))
      (:durative-action shine :parameters () :duration (= ?duration 1)
        :condition (over all (not (seen))) :effect (at start (on))))""")
    [failed] = fresh_kb.why_not("(shine)")
    assert str(failed) == "(not (seen)): does not hold right after the start"
    assert [*fresh_kb.applicable_actions()] == []
    with pytest.raises(NotApplicableError) as refused:
        fresh_kb.start("(shine)")
    assert refused.value.unsatisfied == (failed,)
    with pytest.raises(NotApplicableError) as refused:
        fresh_kb.state().apply("(shine)")
    assert refused.value.unsatisfied == (failed,)


def test_an_effect_at_the_end_may_depend_on_the_start(kb: KnowledgeBase) -> None:
    kb.propositions.save("(lit c1)")
    kb.start("(long p1 c0 c1)")
    kb.propositions.delete("(lit c1)")
    kb.end("(long p1 c0 c1)")
    assert kb.holds("(calm)")
    kb.start("(long p1 c1 c0)")
    kb.propositions.delete_all()
    kb.propositions.save("(lit c1)")
    with pytest.raises(NotApplicableError):
        kb.end("(long p1 c1 c0)")


@pytest.mark.parametrize("is_committed", [True, False])
def test_a_step_may_end_in_a_transaction(kb: KnowledgeBase, is_committed: bool) -> None:
    kb.propositions.save("(lit c1)")
    if is_committed:
        kb.start("(long p1 c0 c1)")
    with kb.transaction():
        if not is_committed:
            kb.start("(long p1 c0 c1)")
        kb.propositions.delete("(lit c1)")
        kb.end("(long p1 c0 c1)")
    assert kb.holds("(and (calm) (at p1 c1))")


@pytest.mark.parametrize("more", ["", "(when (at start (lit ?x)) (at end (not (at ?a ?y))))"])
def test_an_action_may_be_defined_otherwise_while_its_step_runs(
    kb: KnowledgeBase, more: str
) -> None:
    kb.propositions.save("(lit c1)")
    kb.start("(long p1 c0 c1)")
    calm = "(when (at start (lit ?y)) (at end (calm)))"
    kb.actions.save(f"""(:durative-action long :parameters (?a - aircraft ?x ?y - city)
      :duration (= ?duration 3) :condition (at end (busy ?a))
      :effect (and (at end (at ?a ?y)) {more} {calm}))""")
    kb.end("(long p1 c0 c1)")
    assert kb.holds("(and (calm) (at p1 c1))")


ROOMS = """
(define (domain rooms) (:requirements :typing :durative-actions :fluents :derived-predicates
    :conditional-effects :negative-preconditions :duration-inequalities)
  (:types room door - object) (:constants d1 - door r1 r2 - room)
  (:predicates (open ?d - door) (at ?r - room) (lit) (done) (clear) (ready) (p) (q))
  (:functions (x ?r - room) (y) (bat) (rate) (least) (most))
  (:derived (ready) (and (open d1) (lit)))
  (:durative-action cross :parameters (?d - door ?a ?b - room) :duration (= ?duration 3)
    :condition (and (at start (at ?a)) (over all (open ?d)))
    :effect (and (at start (not (at ?a))) (at end (at ?b))))
  (:durative-action light :parameters () :duration (= ?duration 3) :condition (over all (lit))
    :effect (and (at start (lit)) (at end (done))))
  (:durative-action shut :parameters (?d - door) :duration (= ?duration 3)
    :condition (over all (open ?d)) :effect (at start (not (open ?d))))
  (:durative-action wait :parameters () :duration (= ?duration 3) :condition (over all (ready))
    :effect (and (at start (lit)) (at end (done))))
  (:durative-action drop :parameters () :duration (= ?duration 3) :condition (over all (>= (y) 2))
    :effect (and (at start (decrease (y) (x r1))) (at end (done))))
  (:durative-action all :parameters () :duration (= ?duration 3)
    :condition (over all (forall (?r - room) (>= (x ?r) 2)))
    :effect (at start (forall (?r - room) (when (not (at ?r)) (decrease (x ?r) (y))))))
  (:action divide :parameters (?a - room) :effect (assign (y) (/ (x ?a) 0)))
  (:durative-action between :parameters () :duration (and (>= ?duration (least))
      (<= ?duration (most))) :condition (and) :effect (at end (done)))
  (:durative-action below :parameters () :duration (= ?duration (- (least) (most)))
    :condition (and) :effect (at end (done)))
  (:durative-action drive :parameters () :duration (and (>= ?duration 1) (<= ?duration 9))
    :condition (and (over all (> (bat) 0)) (at end (lit)))
    :effect (and (decrease (bat) (* #t (rate))) (at start (assign (rate) 2)) (at start (lit))
      (at end (assign (y) (bat)))))
  (:durative-action fill :parameters () :duration (= ?duration 2)
    :condition (over all (<= (bat) 18))
    :effect (forall (?r - room) (increase (bat) (* #t (x ?r)))))
  (:durative-action bent :parameters () :duration (= ?duration 2) :condition (and)
    :effect (increase (bat) (* #t (bat))))
  (:durative-action odd :parameters () :duration (= ?duration 2) :condition (and)
    :effect (increase (bat) (+ #t 1)))
  (:durative-action chosen :parameters () :duration (= ?duration 2)
    :condition (over all (or (< (bat) 3) (> (bat) 4))) :effect (increase (bat) (* #t 1))))
"""
FLAT = """(define (problem flat) (:domain rooms) (:init (at r1) (= (x r1) 3) (= (x r2) 1) (= (y) 4)
  (= (bat) 10) (= (least) 5) (= (most) 3)) (:goal (done)))"""


@pytest.fixture
def rooms(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """A knowledge base with durative actions of all kinds, and a door that is closed."""
    return loaded(fresh_kb, ROOMS, FLAT)


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        ("(cross d1 r1 r2)", "(open d1): does not hold right after the start"),
        ("(light)", None),
        ("(shut d1)", "(open d1): does not hold right after the start"),
        ("(wait)", "(ready): does not hold right after the start"),
        ("(drop)", "(>= (y) 2): the sides are 1 and 2 right after the start"),
        ("(all)", "(>= (x r2) 2): the sides are -3 and 2 right after the start"),
        ("(divide r1)", "(assign (y) ...): its value is undefined: a fluent in it has no value"),
        ("(between)", "(and (>= ?duration (least)) (<= ?duration (most))): no duration is from 5"),
        ("(between) [3]", "(>= ?duration (least)): the sides are 3 and 5; a duration may deviate"),
        ("(drive)", "?duration: is not given"),
        ("(drive) [10]", "(<= ?duration 9): the sides are 10 and 9; a duration may deviate by"),
        ("(drive) [4]", None),
        ("(fill)", None),
    ],
)
def test_what_is_promised_can_begin(rooms: KnowledgeBase, step: str, reason: str | None) -> None:
    """One condition decides for all that say, or find out, whether a step can begin."""
    is_durative = "divide" not in step
    listed = texts(rooms.applicable_actions(step.strip("()").split()[0].rstrip(")")))
    assert (step in listed) is (reason is None and "[" not in step)
    failed = [str(each) for each in rooms.why_not(step)]
    if reason is None:
        assert failed == []
        assert rooms.start(step).outcome == "running"
        rooms.abort(step)
        rooms.load_problem(FLAT)
        assert rooms.apply(step) is not None
        return
    assert len(failed) == 1
    assert failed[0].startswith(reason)
    before = rooms.revision
    for act in (rooms.apply, rooms.start) if is_durative else (rooms.apply,):
        with pytest.raises(NotApplicableError, match=re.escape(reason)):
            act(step)
    assert rooms.revision == before


def test_a_step_that_rules_allow_is_found(rooms: KnowledgeBase) -> None:
    """What is over all follows by a rule from what the start changes."""
    rooms.propositions.save("(open d1)")
    assert texts(rooms.applicable_actions("wait")) == ["(wait)"]
    assert not rooms.why_not("(wait)")
    assert not rooms.holds("(ready)")
    rooms.start("(wait)")
    assert rooms.holds("(ready)")
    assert rooms.end("(wait)").revision is not None


# Continuous effects.


def test_continuous_change_is_the_rate_times_the_duration(rooms: KnowledgeBase) -> None:
    def bat() -> object:
        return rooms.function_values.get("bat")

    rooms.apply("(drive) [3.5]")
    # Conditions and effects at the end see the number changed.
    assert bat() == rooms.function_values.get("y") == 3
    rooms.load_problem(FLAT)
    step = rooms.start("(drive) [4]")
    assert bat() == 10
    assert rooms.pddl.broken_invariants() == []
    rooms.function_values.set("bat", objects=[], value=9)
    rooms.end(step)
    assert bat() == 1
    # Over all ends right before the end, as in `validate`.
    rooms.load_problem(FLAT)
    rooms.apply("(drive) [5]")
    assert bat() == 0
    rooms.load_problem(FLAT)
    assert not rooms.why_not("(drive) [5.5]")
    with pytest.raises(NotApplicableError, match=r"\(> \(bat\) 0\): the sides are -1 and 0"):
        rooms.apply("(drive) [5.5]")
    assert (bat(), rooms.holds("(lit)")) == (10, False)
    rooms.apply("(fill)")
    assert bat() == 18
    with pytest.raises(NotApplicableError, match=r"the sides are 26 and 18 at the end"):
        rooms.apply("(fill)")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bent", "bent changes bat continuously at a rate that depends on bat"),
        ("odd", "the continuous effect (increase (bat) (+ #t 1)) is not a multiple of #t"),
        ("chosen", "chosen has the condition over all (or (< (bat) 3) (> (bat) 4)), which cannot"),
    ],
)
def test_change_that_is_not_linear_is_refused_by_name(
    rooms: KnowledgeBase, name: str, message: str
) -> None:
    for ask in (rooms.why_not, rooms.start, rooms.apply):
        with pytest.raises(UnsupportedConstructError, match=re.escape(message)):
            ask(f"({name})")
    assert name not in " ".join(texts(rooms.applicable_actions()))


# Aborting.


def shown(changes: tuple[Change, ...] | None) -> list[str]:
    return [f"{change.sign}{change.text}" for change in changes or ()]


def state(kb: KnowledgeBase) -> list[str]:
    return [*map(str, kb.propositions.get_all()), *map(str, kb.function_values.get_all())]


def test_a_step_whose_action_is_gone_can_be_ended_by_hand(rooms: KnowledgeBase) -> None:
    step = rooms.start("(drive) [4]")
    rooms.actions.delete("drive")
    for call in (rooms.abort, rooms.end):
        with pytest.raises(InvalidKnowledgeError, match=r"is not known.*; kb\.executions\.report"):
            call(step)
    assert rooms.executions.report(step, outcome="aborted").outcome == "aborted"


def test_an_aborted_step_is_undone_in_one_revision(rooms: KnowledgeBase) -> None:
    rooms.function_values.unset("rate")
    before, begun = state(rooms), rooms.revision
    step = rooms.start("(drive) [4]")
    done = rooms.abort(step, undo=True)
    assert done.revision == begun + 2 == rooms.revision
    assert (shown(done.undone), done.left) == (["+(lit)", "+(= (rate) 2)"], ())
    assert sorted(state(rooms)) == sorted(before)
    assert rooms.store.revisions(begun + 1)[0].reason == "aborted and undid (drive)"
    read = present(rooms.executions.get(step.id))
    assert read.outcome == "aborted"
    assert rooms.store.verify().is_intact
    # What held before the start is not an effect of it.
    rooms.function_values.set("rate", objects=[], value=2)
    assert shown(rooms.abort(rooms.start("(drive) [4]"), undo=True).undone) == ["+(lit)"]
    with pytest.raises(PlanError, match="is not running"):
        rooms.abort(step, undo=True)


def test_what_something_else_changed_is_not_undone(rooms: KnowledgeBase) -> None:
    rooms.function_values.set("x", objects=["r1"], value=1)
    rooms.start("(drop)")
    rooms.function_values.set("y", objects=[], value=7)
    before = rooms.revision
    with pytest.raises(PlanError, match=r"were overwritten .*\+\(= \(y\) 3\)"):
        rooms.abort("(drop)", undo=True)
    assert rooms.revision == before
    assert rooms.abort("(drop)").left == ()
    assert rooms.function_values.get("y") == 7
    # In the revision of the start, too.
    with rooms.transaction():
        rooms.function_values.increase("y", objects=[], by=1)
        step = rooms.start("(drop)")
        with pytest.raises(PlanError, match="not committed"):
            rooms.abort(step, undo=True)
    with pytest.raises(PlanError, match="were overwritten"):
        rooms.abort(step, undo=True)
    rooms.abort(step)


GRAB = """
(define (domain shelf)
  (:requirements :typing :durative-actions :object-fluents :conditional-effects)
  (:types box) (:predicates (busy) (seen ?b - box))
  (:functions (held) - box (nearest) - box)
  (:durative-action grab :parameters () :duration (= ?duration 3)
    :effect (and (at start (busy)) (at start (assign (held) (nearest)))
      (at start (forall (?b - box) (not (seen ?b)))))))
"""
SHELF = """
(define (problem two) (:domain shelf) (:objects a b c - box)
  (:init (seen a) (= (held) b) (= (nearest) c)) (:goal (and)))
"""


@pytest.mark.parametrize(
    ("gone", "left"),
    [
        ("a", ["+(busy)", "-(seen a)", "+(= (held) c)", "-(= (held) b)"]),
        ("b", ["+(busy)", "-(seen a)", "+(= (held) c)", "-(= (held) b)"]),
        ("c", ["+(busy)", "-(seen a)"]),
    ],
)
def test_what_a_start_changed_of_objects_that_are_gone_is_not_taken_back(
    fresh_kb: KnowledgeBase, gone: str, left: list[str]
) -> None:
    kb = loaded(fresh_kb, GRAB, SHELF)
    step = kb.start("(grab)")
    kb.objects.delete(gone)
    before = state(kb)
    with pytest.raises(PlanError, match=rf"cannot be undone: .*\b{gone}\)"):
        kb.abort(step, undo=True)
    assert state(kb) == before
    assert shown(kb.abort(step).left) == left
    assert kb.store.verify().is_intact


def test_durations(kb: KnowledgeBase) -> None:
    assert kb.start("(long p1 c0 c1) [1.755]").duration == Decimal("1.755")
    kb.abort("(long p1 c0 c1)")
    for lasts, bound in (("1.9", 2), ("4.1", 4)):
        with pytest.raises(NotApplicableError, match=f"the sides are {lasts} and {bound}"):
            kb.start(f"(free) [{lasts}]")
    before = total(kb)
    kb.start("(free) [3]")
    with pytest.raises(PlanError, match=r"was started \[3\], not \[4\]; leave it out"):
        kb.end("(free) [4]")
    kb.end("(free)")
    assert isinstance(before, Decimal)
    assert total(kb) == before + 3
    with pytest.raises(PlanError, match=r"use kb\.apply"):
        kb.start("(twice)")


def test_a_durative_step_at_once(kb: KnowledgeBase) -> None:
    before = kb.revision
    assert kb.apply("(long p1 c0 c1)") == before + 1
    assert kb.holds("(and (at p1 c1) (not (busy p1)))")
    assert total(kb) == Decimal("1.85")


def test_a_running_step_is_known_to_other_connections(shared_url: str, connect: Connect) -> None:
    one, other = connect(shared_url), connect(shared_url)
    loaded(one, DOMAIN, PROBLEM)
    one.start("(long p1 c0 c1)")
    assert other.end("(long p1 c0 c1)").revision is not None
    with pytest.raises(PlanError, match="not running"):
        one.end("(long p1 c0 c1)")


def test_names_and_actions_of_other_connections_are_known(
    shared_url: str, connect: Connect
) -> None:
    one, other = connect(shared_url), connect(shared_url)
    one.load_domain("""(define (domain d) (:types robot place) (:predicates (at ?p - place))
      (:action go :parameters (?p - place) :effect (at ?p)))""")
    one.objects.save(["r - robot", "hall - place"])
    assert not other.holds("(at hall)")
    one.objects.save("lab - place")
    one.propositions.save("(at lab)")
    assert other.holds("(at lab)")
    one.objects.save("den - place")
    assert not other.holds("(at ?p)", p="den")
    one.actions.save("(:action stay :parameters (?p - place) :effect (at ?p))")
    assert "(stay lab)" in texts(other.applicable_actions())
    one.actions.save("(:action wait :parameters (?p - place) :effect (at ?p))")
    assert other.why_not("(wait lab)") == []
    assert [each.condition for each in other.why_not("(wait r)")] == ["?p - place"]
    one.actions.save("(:action wait :parameters (?p - robot) :effect (at hall))")
    assert other.why_not("(wait r)") == []


def test_processes_and_events_are_no_steps(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain d) (:requirements :time :fluents)
      (:predicates (p)) (:functions (x))
      (:process flow :parameters () :precondition (p) :effect (increase (x) (* #t 1)))
      (:event bang :parameters () :precondition (p) :effect (not (p))))""")
    assert texts(fresh_kb.applicable_actions()) == []
    for name in ("flow", "bang"):
        with pytest.raises(UnsupportedConstructError, match="happens by itself"):
            fresh_kb.apply(PlanStep(None, name))


def test_costs_begin_at_zero(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain d) (:functions (total-cost))
      (:action pay :parameters () :effect (increase (total-cost) 2))
      (:action save :parameters () :precondition (< (total-cost) 3)))""")
    fresh_kb.load_problem("(define (problem p) (:domain d) (:init) (:goal (and)))")
    # A comparison with what has no value is false, of costs as of other fluents.
    assert fresh_kb.validate("(save)\n").failed_step is not None
    assert texts(fresh_kb.applicable_actions()) == ["(pay)"]
    fresh_kb.apply("(pay)")
    assert fresh_kb.function_values.get("total-cost") == 2
    assert texts(fresh_kb.applicable_actions()) == ["(pay)", "(save)"]


def test_only_the_cost_of_all_begins_at_zero(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.load_domain("""(define (domain d) (:functions (total-cost ?x))
      (:action pay :parameters (?x) :effect (increase (total-cost ?x) 2)))""")
    fresh_kb.load_problem("""(define (problem p) (:domain d) (:objects rb1 rb2)
      (:init (= (total-cost rb1) 0)) (:goal (and)))""")
    assert texts(fresh_kb.applicable_actions()) == ["(pay rb1)"]
    assert texts(iter(fresh_kb.state().applicable_actions())) == ["(pay rb1)"]
    with pytest.raises(NotApplicableError):
        fresh_kb.apply("(pay rb2)")
    assert len(fresh_kb.why_not("(pay rb2)")) == 1
