"""What its record adds to `apply`, and a rule that refuses to a write.

    python -m tests.benchmarks.adding [--rounds 300] [--backend sqlite]

Calls alternate between two stores, one of which does without; the tables have medians.
Steps repeat, as those of robots do, or are all different, which leaves nothing to caches.
A rule does not mention what is written, or judges it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import cycle, islice
from statistics import median
from typing import Any
from unittest import mock

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.reasoning import durative
from tests.benchmarks.support import NewStore, alternate, print_table, read_options, stores

STEPS, ROBOTS = 10, 2_000
DOMAIN = """(define (domain rounds) (:requirements :typing) (:types robot place)
 (:predicates (at ?r - robot ?p - place) (free ?p - place))
 (:action move :parameters (?r - robot ?a ?b - place) :precondition (at ?r ?a)
  :effect (and (not (at ?r ?a)) (at ?r ?b))))"""
PROBLEM = """(define (problem day) (:domain rounds) (:objects rb1 - robot {places} - place)
 (:init (at rb1 p0)) (:goal (and)))"""
RULE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"
Work = Callable[[], object]


def steps(places: int) -> Iterator[str]:
    """Yield moves between all places, each where the one before ended."""
    walks = ((step * by, by) for by in range(1, places) for step in range(places))
    return (f"(move rb1 p{at % places} p{(at + by) % places})" for at, by in walks)


def acting(kb: KnowledgeBase, is_recorded: bool, places: int) -> Work:
    """Give what applies steps, with their record or without."""
    kb.load_problem(PROBLEM.format(places=" ".join(f"p{n}" for n in range(places))))
    coming = cycle(steps(places))
    record = durative._record if is_recorded else lambda *_: None

    def work() -> None:
        with mock.patch.object(durative, "_record", record):
            for step in islice(coming, STEPS):
                kb.apply(step)

    return work


def writing(kb: KnowledgeBase, has_rule: bool, fact: str) -> Work:
    """Give what writes a fact, with a rule or without."""
    robots = [f"r{n} - robot" for n in range(ROBOTS)]
    kb.objects.save([*robots, "idle - robot", "p - place", "spare - place"])
    kb.propositions.save([f"(at r{n} p)" for n in range(ROBOTS)])
    if has_rule:
        kb.rules.save("one-place", RULE, on_violation="refuse")

    def work() -> None:
        for _ in range(STEPS // 2):
            kb.propositions.save(fact)
            kb.propositions.delete(fact)

    return work


Prepare = Callable[[KnowledgeBase, bool], Work]
CASES: dict[str, dict[str, Prepare]] = {
    # With a prime number of places, a walk by each distance meets them all and ends where it began.
    "One apply: its record": {
        "steps repeat": partial(acting, places=2),
        "all are different": partial(acting, places=61),
    },
    "One write: a rule that refuses": {
        "touches no rule": partial(writing, fact="(free spare)"),
        "touches the rule": partial(writing, fact="(at idle spare)"),
    },
}


def measure(new: NewStore, prepare: Prepare, rounds: int) -> tuple[float, float]:
    """Give the median seconds of a call, with what is added and without."""

    def calls(kb: KnowledgeBase, is_added: bool) -> Callable[[int], Callable[[], Any]]:
        kb.load_domain(DOMAIN)
        work = prepare(kb, is_added)
        return lambda _: work

    open_kb = partial(kant_sql.connect, knowledge_base="robot", actor="executive")
    with open_kb(new()) as one, open_kb(new()) as other:
        both = alternate(rounds, calls(one, True), calls(other, False))
        whole, bare = (median(taken) / STEPS for taken in both)
    return whole, bare


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print how many times the time is that calls without it take."""
    options = read_options(__doc__, argv, rounds=300)
    with stores(options.backend) as found:
        for title, cases in CASES.items():
            rows = []
            for backend, new in found.items():
                for name, prepare in cases.items():
                    whole, bare = measure(new, prepare, options.rounds)
                    figures = f"{1e6 * whole:.0f} us", f"{1e6 * bare:.0f} us", f"{whole / bare:.2f}"
                    rows.append((f"{backend}, {name}", *figures))
            print_table(title, ("", "with it", "without", "ratio"), rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
