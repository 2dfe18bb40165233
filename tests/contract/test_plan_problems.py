"""A recorded plan gives, byte for byte, what its planner was given, whatever happened since.

KANT_SQL_TEST_EXAMPLES=1000 hunts for longer, each time from another seed.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given

from kant_sql import KnowledgeBase
from kant_sql.errors import PlanError
from kant_sql.pddl import write
from kant_sql.pddl.document import Domain, Problem
from kant_sql.planning import Plan, problem_hash
from kant_sql.plans import RecordedPlan
from tests.support.generators.documents import domains_and_problems
from tests.support.profile import PROFILE, hunting
from tests.support.reading import documents, loaded, present, rows
from tests.support.stores import Everywhere
from tests.support.worlds.depot import again
from tests.support.worlds.missions import PROBLEM, TOUR, arrive, begin, plan_of, recorded

Texts = tuple[str, str]
Documents = tuple[Domain, Problem]
FOREIGN = "; von Hand, für 🤖\r\n(define (problem p)\t(:domain tour)\n\n(:goal (and)))"
KEPT = "SELECT domain_pddl, problem_pddl FROM plan WHERE kb_id = :kb ORDER BY id"


def given_to(plan: RecordedPlan) -> Texts:
    return plan.domain_pddl(), plan.problem_pddl()


def found_in(kb: KnowledgeBase, plan_id: int) -> RecordedPlan:
    return present(kb.plans.get(plan_id))


def test_what_the_store_writes_is_not_kept_but_written_again(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    texts = documents(fresh_kb)
    plans = [
        fresh_kb.plans.record(TOUR),
        fresh_kb.plans.record(TOUR, domain_pddl=texts[0], problem_pddl=texts[1]),
    ]
    fresh_kb.load_problem(PROBLEM.replace("(at rb1 wp1)", "(at rb1 wp2)"))
    fresh_kb.objects.delete_all()
    fresh_kb.actions.delete_all()
    assert documents(fresh_kb) != texts
    for plan in plans:
        assert plan.problem_hash == problem_hash(texts[0], problem=texts[1])
        assert given_to(plan) == given_to(found_in(again(fresh_kb), plan.id)) == texts
    assert rows(fresh_kb, KEPT) == [(None, None)] * 2


def test_what_the_store_does_not_write_is_kept(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    domain, problem = documents(fresh_kb)
    plans = {
        (domain, FOREIGN): fresh_kb.plans.record(TOUR, problem_pddl=FOREIGN),
        (FOREIGN, problem): fresh_kb.plans.record(TOUR, domain_pddl=FOREIGN),
        ("", "."): fresh_kb.plans.record(TOUR, domain_pddl="", problem_pddl="."),
    }
    assert rows(fresh_kb, KEPT) == [(None, FOREIGN), (FOREIGN, None), ("", ".")]
    for texts, plan in plans.items():
        assert plan.problem_hash == problem_hash(texts[0], problem=texts[1])
        assert given_to(plan) == given_to(found_in(again(fresh_kb), plan.id)) == texts
        (line,) = next(fresh_kb.at(plan.recorded_in).log(limit=1)).changes
        for role, text, written in zip(
            ("domain", "problem"), texts, (domain, problem), strict=True
        ):
            shown = "null" if text == written else f'"{problem_hash(text, problem="")}"'
            assert f":{role}-pddl {shown} " in line.text


def test_a_plan_in_a_transaction_gives_it_too(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    texts = documents(fresh_kb)
    with fresh_kb.transaction():
        arrive(fresh_kb, "wp2")
        plan = fresh_kb.plans.record(TOUR, problem_pddl=FOREIGN)
        assert given_to(plan) == (texts[0], FOREIGN)
        assert given_to(fresh_kb.plans.record(TOUR)) == texts


def test_a_text_that_is_not_the_one_given_is_never_passed_off_as_it(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = recorded(fresh_kb)
    kept = fresh_kb.plans.record(TOUR, domain_pddl="a", problem_pddl="b")
    monkeypatch.setattr("kant_sql.documents.exchange.write_domain", lambda domain: "(define)")
    for read in (plan.domain_pddl, plan.problem_pddl):
        with pytest.raises(PlanError, match=f"plan {plan.id}: the stored problem, at") as caught:
            read()
        assert plan.problem_hash in str(caught.value)
    assert given_to(kept) == ("a", "b")


@pytest.fixture
def planner(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planner that takes no time and knows one plan."""
    monkeypatch.setattr("kant_sql.planning.solve", lambda *_, **__: plan_of(*TOUR.steps[3:]))


@pytest.mark.usefixtures("planner")
def test_a_plan_knows_what_it_was_made_from(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    plan, texts = fresh_kb.plan(), documents(fresh_kb)
    assert (plan.revision, plan.problem_hash) == (1, problem_hash(texts[0], problem=texts[1]))
    arrive(fresh_kb, "wp2")
    made = fresh_kb.plans.record(plan)
    assert (made.revision, given_to(made)) == (1, texts)
    assert fresh_kb.at(1).plan().problem_hash == made.problem_hash
    with pytest.raises(PlanError, match="differ from the planner's input, by its SHA-256"):
        fresh_kb.plans.record(plan, problem_pddl=FOREIGN)


@pytest.mark.usefixtures("planner")
def test_a_plan_of_what_is_pending_is_recorded_with_its_texts(fresh_kb: KnowledgeBase) -> None:
    begin(fresh_kb)
    with fresh_kb.transaction():
        arrive(fresh_kb, "wp2")
        plan, texts = fresh_kb.plan(), documents(fresh_kb)
        with pytest.raises(PlanError, match=r"not given revision 1 .* the uncommitted state of a"):
            fresh_kb.plans.record(plan)
        made = fresh_kb.plans.record(plan, domain_pddl=texts[0], problem_pddl=texts[1])
    assert (made.revision, given_to(made)) == (1, texts)
    assert rows(fresh_kb, KEPT) == [(None, texts[1])]


@pytest.mark.usefixtures("planner")
@pytest.mark.parametrize("is_beyond", [True, False])
def test_a_plan_of_a_branch_is_refused_as_such(fresh_kb: KnowledgeBase, is_beyond: bool) -> None:
    """Revisions of a branch count from 1, and may go beyond the head."""
    begin(fresh_kb)
    with fresh_kb.branch() as trial:
        for kb in (trial,) if is_beyond else (trial, fresh_kb):
            kb.propositions.delete_all()
            arrive(kb, "wp2" if kb is trial else "wp1")
        plan = trial.plan()
        with pytest.raises(PlanError, match=r"the plan is of a branch.*; record it where it was"):
            fresh_kb.plans.record(plan)
        assert trial.plans.record(plan).revision == plan.revision


def episode(kb: KnowledgeBase, states: list[Documents]) -> None:
    """Plan in each state, and check in the end what was given in each."""
    plan = Plan((), "hand", "")
    begun: list[tuple[int, Texts]] = []
    made: list[tuple[Texts, RecordedPlan]] = []
    for state in states:
        with kb.transaction():
            loaded(kb, write(state[0]), write(state[1]))
        texts = documents(kb)
        begun.append((kb.revision, texts))
        made.append((texts, kb.plans.record(plan)))
        kb.propositions.delete_all()
    for revision, texts in begun:
        late = replace(plan, revision=revision)
        made.append((texts, kb.plans.record(late, domain_pddl=texts[0], problem_pddl=texts[1])))
    for texts, one in made:
        assert given_to(one) == given_to(found_in(again(kb), one.id)) == texts
    assert {*rows(kb, KEPT)} == {(None, None)}


@pytest.mark.more
def test_nothing_that_comes_later_changes_what_a_planner_was_given(everywhere: Everywhere) -> None:
    @hunting(PROFILE.histories)
    @given(domains_and_problems(repeats=True), domains_and_problems())
    def hold(first: Documents, second: Documents) -> None:
        everywhere(lambda kb: episode(kb, [first, second, first]))

    hold()


WISHES = """
(define (problem wishes) (:domain tour)
  (:objects rb1 - robot wp1 wp2 wp3 - wp)
  (:init (at rb1 wp1) (road wp1 wp2) (road wp2 wp3))
  (:goal (and (preference far (at rb1 wp3)) (preference near (at rb1 wp2))))
  (:constraints (preference soon (within 5 (at rb1 wp3))))
  (:metric minimize (+ (* 3 (is-violated far)) (* 0.5 (is-violated near)) (is-violated soon))))
"""
TOURED = """
(define (domain tour) (:types robot wp)
  (:predicates (at ?r - robot ?w - wp) (road ?a ?b - wp))
  (:action move :parameters (?r - robot ?a ?b - wp)
    :precondition (and (at ?r ?a) (road ?a ?b))
    :effect (and (not (at ?r ?a)) (at ?r ?b))))
"""


@pytest.mark.more
def test_what_the_planner_was_really_given_is_kept(fresh_kb: KnowledgeBase) -> None:
    pytest.importorskip("unified_planning")
    loaded(fresh_kb, TOURED, WISHES)
    found = fresh_kb.plan("fast-downward-opt", timeout=120)
    ignored = "(preference soon (within 5 (at rb1 wp3))) in the constraints: "
    assert [text.startswith(ignored) for text in found.ignored] == [True]
    assert [step.arguments for step in found.steps] == [
        ("rb1", "wp1", "wp2"),
        ("rb1", "wp2", "wp3"),
    ]
    plan = fresh_kb.plans.record(found)
    assert given_to(plan) == given_to(found_in(again(fresh_kb), plan.id))
    assert given_to(plan) == (found.domain_pddl, found.problem_pddl)
    assert plan.problem_hash == found.problem_hash
    assert plan.problem_hash != problem_hash(fresh_kb.domain_pddl(), problem=WISHES)
    assert plan.objective == "minimize (total-cost)"
    for texts in (given_to(plan), rows(fresh_kb, KEPT)[0]):
        assert "forgo-near" in texts[0]
        assert "within" not in texts[1]
    # Without a part that is left out, the objective is the state's.
    fresh_kb.load_problem(WISHES.replace("(within 5 (at rb1 wp3))", "(sometime (at rb1 wp3))"))
    whole = fresh_kb.plan("fast-downward-opt", timeout=120, strict=True)
    assert whole.ignored == ()
    assert fresh_kb.plans.record(whole).objective == (
        "minimize (+ (* 3 (is-violated far)) (* 0.5 (is-violated near)) (is-violated soon))"
    )
