"""What is large takes time in proportion, measured by the ratio of two sizes in one run."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from kant_sql import KnowledgeBase
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
    small, large = actions(form, 1_000), actions(form, 16_000)
    # Squared, that would be 256 times as long.
    assert ratio(lambda: read_domain(small), lambda: read_domain(large)) < 50


@pytest.mark.parametrize("form", [PLAIN, WARNED], ids=["plain", "warned"])
def test_loading_many_actions(fresh_kb: KnowledgeBase, form: str) -> None:
    def load(count: int) -> None:
        fresh_kb.load_domain(actions(form, count))
        fresh_kb.domain()

    load(10)
    # Squared, that would be 100 times as long.
    assert ratio(lambda: load(200), lambda: load(2_000)) < 40
