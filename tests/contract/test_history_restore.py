"""Restoring: the state becomes what it was, as a new revision that can be undone as well.

And the difference of two states: what holds at one and not at the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import KantSqlError, KnowledgeBase, ReadOnlyError, UnknownRevisionError
from kant_sql.dao import AnyDao
from kant_sql.dto.formulas import Comparison, Derived, Exists, Metric, Modal, Not, TimedLiteral
from kant_sql.pddl import write
from kant_sql.pddl.document import Domain, Problem
from kant_sql.sql.changes import Change
from tests.contract.test_properties import tight
from tests.support.atoms import Atoms
from tests.support.chain import check_chain
from tests.support.generators.documents import domains_and_problems
from tests.support.generators.programs import Program, programs, run
from tests.support.parts import DAOS, part
from tests.support.profile import PROFILE, hunting
from tests.support.reading import last_changes, loaded, undone
from tests.support.statements import count
from tests.support.stores import Connect, Everywhere
from tests.support.worlds.depot import IDLE, PLACE, TRUCK, P, T, again, at, fuel, load, number
from tests.support.worlds.robots import BATTERY, RB1, STORY, WP2, robot_at, waypoint

REACHABLE = Derived("reachable", (PLACE,), Exists((TRUCK,), at(T, P)))


def text_of(call: Callable[[], str]) -> str:
    """What a call gives, or why it gives nothing."""
    try:
        return call()
    except KantSqlError as error:
        return type(error).__name__


def everything(kb: KnowledgeBase) -> dict[str, str]:
    """All that a knowledge base can be asked for."""
    daos = [path for path, cls in DAOS.items() if issubclass(cls, AnyDao)]
    told = {path: repr(part(kb, path).get_all()) for path in daos}
    told["metric"] = repr(kb.pddl.metric.get())
    told["domain"], told["problem"] = text_of(kb.domain_pddl), text_of(kb.problem_pddl)
    return told


def check_is_as_at(kb: KnowledgeBase, revision: int) -> None:
    """Check that the present is what a revision was, for this process and for others."""
    wanted = everything(kb.at(revision))
    assert everything(kb) == wanted
    assert everything(again(kb)) == wanted
    assert kb.diff(revision, kb.revision) == []


DEPOT_STORY: list[Callable[[KnowledgeBase], object]] = [
    load,
    lambda kb: kb.goals.save(Comparison(">", fuel(), number("2.50"))),
    lambda kb: kb.pddl.metric.set(Metric("minimize", fuel())),
    lambda kb: kb.pddl.constraints.save(Modal("always", (), (IDLE,))),
    lambda kb: kb.pddl.timed_initial_literals.save(TimedLiteral(number("5"), at())),
    lambda kb: kb.pddl.initial_literals.save(Not(IDLE)),
    lambda kb: kb.pddl.derived_predicates.save(REACHABLE),
    lambda kb: kb.pddl.metric.set(Metric("maximize", fuel())),
    *STORY,
]


def tell(kb: KnowledgeBase) -> KnowledgeBase:
    for step in DEPOT_STORY:
        step(kb)
    return kb


def test_any_state_comes_back_and_goes_again(fresh_kb: KnowledgeBase) -> None:
    tell(fresh_kb)
    head = fresh_kb.revision
    assert head >= len(DEPOT_STORY) - 2
    for revision in range(head, -1, -1):
        made = fresh_kb.restore(revision)
        assert made == (None if revision == head else fresh_kb.revision)
        check_is_as_at(fresh_kb, revision)
        if revision % 4 == 0:
            fresh_kb.restore(head)
            check_is_as_at(fresh_kb, head)


def test_it_is_a_revision_like_any_other(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.delete(robot_at())
    assert fresh_kb.restore(1) == 3
    assert fresh_kb.restore(2, reason="a mistake", actor="operator") == 4
    assert fresh_kb.restore(3, reason="") == 5
    said = [(each.actor, each.reason) for each in fresh_kb.store.revisions()[2:]]
    assert said == [("test", "restored revision 1"), ("operator", "a mistake"), ("test", "")]
    assert last_changes(fresh_kb) == ["+ fact (robot_at rb1 wp1)"]
    assert [each.since.number for each in fresh_kb.history(robot_at())] == [1, 3, 5]


def test_what_is_so_already_makes_no_revision(fresh_kb: KnowledgeBase) -> None:
    assert fresh_kb.restore(0) is None
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    fresh_kb.propositions.delete(robot_at(RB1, WP2))
    fresh_kb.objects.delete(WP2)
    assert fresh_kb.restore(4) is None
    assert fresh_kb.restore(1) is None
    assert fresh_kb.revision == 4


def test_a_value_comes_back_as_it_was_written(fresh_kb: KnowledgeBase) -> None:
    for value in (Decimal("10.0"), 5, 10):
        fresh_kb.function_values.set(BATTERY, objects=[RB1], value=value)
    assert fresh_kb.restore(1) == 4
    check_is_as_at(fresh_kb, 1)
    fresh_kb.function_values.unset(BATTERY, objects=[RB1])
    assert fresh_kb.restore(3) == 6
    check_is_as_at(fresh_kb, 3)
    # And is known to be that: the next one writes what is not so.
    assert fresh_kb.function_values.set(BATTERY, objects=[RB1], value=10) is False


def test_a_time_names_a_state(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.propositions.save(robot_at(RB1, WP2))
    first = fresh_kb.store.revisions()[0].committed_at
    fresh_kb.restore(first - timedelta(microseconds=1))
    check_is_as_at(fresh_kb, 0)
    assert fresh_kb.store.revisions()[-1].reason == "restored revision 0"


@pytest.mark.parametrize(
    "when", [2, -1, None, "2", datetime(2026, 1, 31), datetime.max.replace(tzinfo=UTC)]
)
def test_a_state_that_is_not_there_is_refused(fresh_kb: KnowledgeBase, when: Any) -> None:
    fresh_kb.propositions.save(robot_at())
    with pytest.raises(UnknownRevisionError):
        fresh_kb.restore(when)
    assert fresh_kb.revision == 1


def test_the_past_cannot_be_restored_within_the_past(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    with pytest.raises(ReadOnlyError):
        fresh_kb.at(1).restore(0)


def test_within_a_transaction_it_is_a_part_of_it(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    fresh_kb.function_values.set(BATTERY, objects=[RB1], value=5)
    fresh_kb.propositions.delete(robot_at())
    with fresh_kb.transaction(actor="operator", reason="more than that"):
        fresh_kb.propositions.save(robot_at(RB1, WP2))
        fresh_kb.function_values.set(BATTERY, objects=[RB1], value=6)
        fresh_kb.propositions.get_all()
        fresh_kb.objects.save(waypoint(7))
        assert fresh_kb.restore(2) is None
        assert fresh_kb.propositions.get_all() == [robot_at()]
        fresh_kb.objects.save(waypoint(8))
    assert fresh_kb.revision == 4
    assert fresh_kb.store.revisions()[-1].reason == "more than that"
    assert [" ".join(each) for each in fresh_kb.diff(2, 4)] == ["+ object wp8 - wp"]


def test_within_a_transaction_it_undoes_what_that_has_done(fresh_kb: KnowledgeBase) -> None:
    tell(fresh_kb)
    head = fresh_kb.revision
    with fresh_kb.transaction():
        fresh_kb.types.delete_all()
        fresh_kb.propositions.get_all()
        fresh_kb.goals.save(robot_at(RB1, WP2, is_goal=True))
        fresh_kb.restore(head)
    assert fresh_kb.revision == head
    check_is_as_at(fresh_kb, head)


def test_it_is_undone_with_the_transaction_that_it_is_part_of(fresh_kb: KnowledgeBase) -> None:
    tell(fresh_kb)
    before, head = everything(fresh_kb), fresh_kb.revision
    with undone(fresh_kb):
        fresh_kb.restore(2)
        assert fresh_kb.propositions.get_all()
    with fresh_kb.transaction():
        with undone(fresh_kb):
            fresh_kb.restore(5)
        assert everything(fresh_kb) == before
    assert (everything(fresh_kb), fresh_kb.revision) == (before, head)


@pytest.mark.parametrize("spill_at", [1, 7, 10_000])
def test_many_facts_are_written_as_they_come(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, spill_at: int
) -> None:
    monkeypatch.setattr("kant_sql.store.transaction.SPILL_AT", spill_at)
    monkeypatch.setattr("kant_sql.dao.base.BATCH", 5)
    facts = [robot_at(RB1, waypoint(each), each % 2 == 0) for each in range(20)]
    atoms = Atoms(fresh_kb)
    atoms.save_all(facts)
    atoms.delete_all()
    atoms.save_all(facts[5:10])
    fresh_kb.propositions.save_all(robot_at(RB1, waypoint(each)) for each in range(40, 60))
    for revision in (1, 2, 4, 3, 0):
        fresh_kb.restore(revision)
        check_is_as_at(fresh_kb, revision)
    with fresh_kb.transaction():
        fresh_kb.restore(4)
        fresh_kb.restore(1)
        fresh_kb.restore(2)
        atoms.save(facts[0])
        fresh_kb.restore(3)
    check_is_as_at(fresh_kb, 3)


def test_other_processes_go_on_from_it(shared_url: str, connect: Connect) -> None:
    one, other = connect(shared_url), connect(shared_url)
    one.propositions.save(robot_at())
    other.propositions.save(robot_at(RB1, WP2))
    one.restore(0)
    assert other.propositions.get_all() == []
    assert other.propositions.save(robot_at())
    one.restore(2)
    assert other.propositions.insert(robot_at(RB1, WP2)) is False
    assert other.propositions.delete(robot_at())
    assert one.propositions.get_all() == [robot_at(RB1, WP2)]


def test_the_chain_covers_it(shared_url: str, connect: Connect) -> None:
    kb = tell(connect(shared_url))
    for revision in (3, 9, 0, 12):
        kb.restore(revision)
    assert check_chain(shared_url)


@pytest.mark.parametrize("size", [10, 1_000])
def test_statements_do_not_grow_with_facts(kb: KnowledgeBase, size: int) -> None:
    kb.propositions.save_all(robot_at(RB1, waypoint(each)) for each in range(size))
    Atoms(kb).save_all(robot_at(RB1, waypoint(each), True) for each in range(size))
    Atoms(kb).delete_all()
    assert count(lambda: kb.restore(1)) <= 12
    assert count(lambda: kb.restore(2)) <= 12


# Any history.


def check_program(kb: KnowledgeBase, program: Program, places: list[float]) -> None:
    processes = [kb, again(kb)]
    for process, step in program.steps:
        run(processes[process], step)
    head = kb.revision
    for place in (*places, 1.0):
        revision = round(place * head)
        processes[revision % 2].restore(revision)
        check_is_as_at(kb, revision)
        assert everything(processes[1]) == everything(kb)
    check_differences(kb, [round(place * head) for place in places])


def check_differences(kb: KnowledgeBase, revisions: list[int]) -> None:
    """Check that the difference of two states makes the one of the other."""
    states: list[frozenset[Change]] = [frozenset()]
    for entry in kb.changes():
        states.append(changed(states[-1], entry.changes))
    way = [0, *revisions, kb.revision]
    for a, b in (*itertools.pairwise(way), *itertools.pairwise(way[::-1])):
        assert changed(states[a], kb.diff(a, b)) == states[b]


def changed(state: frozenset[Change], changes: Sequence[Change]) -> frozenset[Change]:
    """A state with what came and without what went, of which nothing was there already."""
    came = {change for change in changes if change.sign == "+"}
    went = {change._replace(sign="+") for change in changes if change.sign == "-"}
    assert went <= state
    assert not came & state
    return (state - went) | came


def test_any_state_of_any_program_is_restored(everywhere: Everywhere) -> None:
    @hunting(PROFILE.restored)
    @given(programs(), st.lists(st.floats(0, 1), min_size=1, max_size=3))
    def restored(program: Program, places: list[float]) -> None:
        with tight(program):
            everywhere(lambda kb: check_program(kb, program, places))

    restored()


@pytest.mark.more
def test_any_documents_are_restored(everywhere: Everywhere) -> None:
    @hunting(PROFILE.histories)
    @given(domains_and_problems(repeats=True), domains_and_problems())
    def restored(first: tuple[Domain, Problem], second: tuple[Domain, Problem]) -> None:
        def check(kb: KnowledgeBase) -> None:
            for domain, problem in (first, second):
                with kb.transaction():
                    loaded(kb, write(domain), write(problem))
            for revision in (1, kb.revision, 0, 1):
                kb.restore(revision)
                check_is_as_at(kb, revision)
            assert kb.domain_pddl() == write(first[0])

        everywhere(check)

    restored()


def lines(kb: KnowledgeBase, a: Any, b: Any) -> list[str]:
    return [" ".join(change) for change in kb.diff(a, b)]


def test_formulas_have_the_kind_of_their_section(fresh_kb: KnowledgeBase) -> None:
    start = load(fresh_kb)
    fresh_kb.goals.save(Comparison(">", fuel(), number("2")))
    fresh_kb.pddl.metric.set(Metric("minimize", fuel()))
    assert lines(fresh_kb, start, fresh_kb.revision) == [
        "+ goal (> (fuel t1) 2)",
        "+ metric (:metric minimize (fuel t1))",
    ]


def test_times_name_states(fresh_kb: KnowledgeBase) -> None:
    for step in STORY:
        step(fresh_kb)
    moments = [revision.committed_at for revision in fresh_kb.store.revisions()]
    before = moments[0] - timedelta(microseconds=1)
    assert fresh_kb.diff(before, moments[-1]) == fresh_kb.diff(0, len(STORY))
    assert fresh_kb.diff(moments[-1], before) == fresh_kb.diff(len(STORY), 0)
