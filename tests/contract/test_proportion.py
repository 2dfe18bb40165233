"""What is large takes time in proportion, measured by the ratio of two sizes in one run."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable

import psycopg
import pytest

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.dto.formulas import Not
from kant_sql.errors import TypeMismatchError
from kant_sql.pddl import read_domain
from tests.support.reading import loaded, undone
from tests.support.servers import Server
from tests.support.stores import Connect
from tests.support.worlds.depot import IDLE, T, at, load
from tests.support.worlds.robots import RB1, ROBOT_AT, robot_at, waypoint


def ratio(small: Callable[[], object], large: Callable[[], object]) -> float:
    """How many times the processor time of one call another takes.

    Collecting garbage does not count: it takes as long as other tests have left objects.
    """
    times = []
    gc.collect()
    gc.disable()
    try:
        for call in (small, large):
            start = time.process_time()
            call()
            times.append(time.process_time() - start)
    finally:
        gc.enable()
    return times[1] / times[0]


def actions(form: str, count: int) -> str:
    all_ = "\n".join(form.format(number) for number in range(count))
    return (
        "(define (domain d) (:requirements :strips :typing :negative-preconditions) (:types t) "
        f"(:constants k - t) (:predicates (p ?x - t)) {all_})"
    )


PLAIN = "(:action a{0} :parameters (?x - t) :precondition (p ?x) :effect (not (p ?x)))"
# A section of its own, with a warning of its own: twice in the second.
WARNED = "(:action b{0} :precondition (p k) :effect (not (p k)))"
SPREAD = "(:predicates (q{0} ?x - t)) (:types u{0} - t) " + PLAIN


@pytest.mark.parametrize("form", [PLAIN, WARNED, SPREAD], ids=["plain", "warned", "spread"])
@pytest.mark.more
def test_reading_many_actions(form: str) -> None:
    small, large = actions(form, 200), actions(form, 6_400)
    read_domain(actions(form, 10))
    # Squared, that would be 1,024 times as long.
    assert ratio(lambda: read_domain(small), lambda: read_domain(large)) < 130


@pytest.mark.parametrize("form", [PLAIN, WARNED], ids=["plain", "warned"])
def test_loading_many_actions(fresh_kb: KnowledgeBase, form: str) -> None:
    def load(count: int) -> None:
        fresh_kb.load_domain(actions(form, count))
        fresh_kb.pddl.domain()

    load(10)
    # Squared, that would be 256 times as long.
    assert ratio(lambda: load(50), lambda: load(800)) < 64


def spread(levels: int) -> tuple[str, str]:
    """A chain of types, and a fact about an object of each."""
    types = " ".join(f"t{number + 1} - t{number}" for number in range(levels))
    objects = " ".join(f"o{number} - t{number}" for number in range(levels))
    facts = " ".join(f"(p o{number})" for number in range(levels))
    return (
        f"(define (domain d) (:requirements :typing) (:types {types}) (:predicates (p ?x - t0)))",
        f"(define (problem x) (:domain d) (:objects {objects}) (:init {facts}) (:goal (p o0)))",
    )


@pytest.mark.more
def test_facts_spread_over_a_deep_hierarchy(fresh_kb: KnowledgeBase) -> None:
    def use(levels: int) -> None:
        domain, problem = spread(levels)
        with fresh_kb.transaction():
            loaded(fresh_kb, domain, problem)
        fresh_kb.propositions.save_all(fresh_kb.propositions.get_all())
        assert fresh_kb.store.verify().is_intact
        assert f"(p o{levels - 1})" in fresh_kb.problem_pddl()

    use(10)
    # Squared, that would be 256 times as long.
    assert ratio(lambda: use(60), lambda: use(960)) < 64


def test_checks_follow_the_hierarchy_as_it_is_changed(fresh_kb: KnowledgeBase) -> None:
    top, other = PddlTypeDto("top"), PddlTypeDto("other")
    low = PddlTypeDto("low", parent=top)
    thing = PddlObjectDto(PddlTypeDto("low"), "thing")
    predicate = PddlPredicateDto("p", [PddlTypeDto("top")])
    fact = PddlPropositionDto(predicate, [thing])

    fresh_kb.types.save_all([top, other, low])
    fresh_kb.predicates.save(predicate)
    fresh_kb.propositions.save(fact)
    with fresh_kb.transaction():
        fresh_kb.propositions.delete(fact)
        fresh_kb.types.save(PddlTypeDto("low", parent=other), cascade=True)
        fresh_kb.objects.save(thing)
        with pytest.raises(TypeMismatchError):
            fresh_kb.propositions.save(fact)
        with undone(fresh_kb):
            fresh_kb.types.save(low, cascade=True)
            fresh_kb.objects.save(thing)
            fresh_kb.propositions.save(fact)
        with pytest.raises(TypeMismatchError):
            fresh_kb.propositions.save(fact)
    with pytest.raises(TypeMismatchError):
        fresh_kb.propositions.save(fact)
    fresh_kb.types.save(low, cascade=True)
    fresh_kb.objects.save(thing)
    assert fresh_kb.propositions.save(fact) is True


# PostgreSQL's plans of a bulk load.


SIZE = 3_000


def reads_per_scan(url: str, table: str) -> float:
    """How many entries of its indexes each look-up in a table has read."""
    statement = (
        "SELECT sum(idx_scan), sum(idx_tup_read) FROM pg_stat_user_indexes WHERE relname = %s"
    )
    for _ in range(100):
        with psycopg.connect(url) as connection:
            scans, reads = connection.execute(statement, [table]).fetchone() or (0, 0)
        if scans >= SIZE:
            return float(reads / scans)
        # A server process reports when it ends.
        time.sleep(0.1)
    pytest.fail(f"only {scans} scans of {table} were reported")


def test_facts_of_many_objects(server: Server, connect: Connect) -> None:
    url = server.new_store()
    with psycopg.connect(url) as connection:
        if connection.info.server_version < 170_000:
            pytest.skip("without statistics, it checks foreign keys by the last of alike indexes")
    kb = connect(url)
    # Enough for COPY, and so few that the server takes any index for as good as the other.
    kb.propositions.save_all(robot_at(place=waypoint(number)) for number in range(60))
    kb.propositions.save_all(
        PddlPropositionDto(ROBOT_AT, [RB1, waypoint(number)]) for number in range(SIZE)
    )
    kb.close()
    assert reads_per_scan(url, "object") < 10


def test_parts_of_many_actions(server: Server, connect: Connect) -> None:
    url = server.new_store()
    kb = connect(url)
    load(kb)
    truck, place = PddlTypeDto("truck"), PddlTypeDto("place")
    parameters = [PddlObjectDto(truck, "t"), PddlObjectDto(place, "p")]
    effect = at(T)
    kb.actions.save_all(
        PddlActionDto(f"act{number}", parameters, [Not(effect), IDLE], [effect], durative=False)
        for number in range(SIZE // 4)
    )
    kb.close()
    assert reads_per_scan(url, "action_version") < 10
