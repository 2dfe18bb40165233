"""What is large takes time in proportion, measured by the ratio of two sizes in one run."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from kant_sql.errors import TypeMismatchError
from kant_sql.pddl import read_domain


def ratio(small: Callable[[], object], large: Callable[[], object]) -> float:
    """How many times the processor time of one call another takes."""
    times = []
    for call in (small, large):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
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


def test_facts_spread_over_a_deep_hierarchy(fresh_kb: KnowledgeBase) -> None:
    def use(levels: int) -> None:
        domain, problem = spread(levels)
        with fresh_kb.transaction():
            fresh_kb.load_domain(domain)
            fresh_kb.load_problem(problem)
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

    def undone() -> None:
        with fresh_kb.transaction():
            fresh_kb.types.save(low, cascade=True)
            fresh_kb.objects.save(thing)
            fresh_kb.propositions.save(fact)
            raise ZeroDivisionError

    fresh_kb.types.save_all([top, other, low])
    fresh_kb.predicates.save(predicate)
    fresh_kb.propositions.save(fact)
    with fresh_kb.transaction():
        fresh_kb.propositions.delete(fact)
        fresh_kb.types.save(PddlTypeDto("low", parent=other), cascade=True)
        fresh_kb.objects.save(thing)
        with pytest.raises(TypeMismatchError):
            fresh_kb.propositions.save(fact)
        with pytest.raises(ZeroDivisionError):
            undone()
        with pytest.raises(TypeMismatchError):
            fresh_kb.propositions.save(fact)
    with pytest.raises(TypeMismatchError):
        fresh_kb.propositions.save(fact)
    fresh_kb.types.save(low, cascade=True)
    fresh_kb.objects.save(thing)
    assert fresh_kb.propositions.save(fact) is True
