"""What its record adds to `apply`.

    python -m tests.benchmarks.acting [--rounds 300] [--backend sqlite]

Calls alternate between two stores, one of which leaves the record out; the table has medians.
Steps repeat, as those of robots do, or are all different, which leaves nothing to caches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import cycle, islice
from statistics import median
from typing import Any
from unittest import mock

import kant_sql
from kant_sql.reasoning import durative
from tests.benchmarks.support import NewStore, alternate, print_table, read_options, stores

STEPS = 10
# With a prime number of places, a walk by each distance meets them all and ends where it began.
PLACES = {"steps repeat": 2, "all are different": 61}
DOMAIN = """(define (domain rounds) (:requirements :typing) (:types robot place)
 (:predicates (at ?r - robot ?p - place))
 (:action move :parameters (?r - robot ?a ?b - place) :precondition (at ?r ?a)
  :effect (and (not (at ?r ?a)) (at ?r ?b))))"""
PROBLEM = """(define (problem day) (:domain rounds) (:objects rb1 - robot {places} - place)
 (:init (at rb1 p0)) (:goal (and)))"""


def steps(places: int) -> Iterator[str]:
    """Yield moves between all places, each where the one before ended."""
    walks = ((step * by, by) for by in range(1, places) for step in range(places))
    return (f"(move rb1 p{at % places} p{(at + by) % places})" for at, by in walks)


def measure(new: NewStore, places: int, rounds: int) -> list[list[float]]:
    """Time rounds of steps that are recorded, and of steps that are not."""

    def acting(is_recorded: bool) -> Callable[[int], Callable[[], Any]]:
        kb = kant_sql.connect(new(), knowledge_base="robot", actor="executive")
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM.format(places=" ".join(f"p{n}" for n in range(places))))
        coming = cycle(steps(places))
        record = durative._record if is_recorded else lambda *_: None

        def work() -> None:
            with mock.patch.object(durative, "_record", record):
                for step in islice(coming, STEPS):
                    kb.apply(step)

        return lambda _: work

    return alternate(rounds, acting(True), acting(False))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print how many times the time is that steps without a record take."""
    options = read_options(__doc__, argv, rounds=300)
    rows = []
    with stores(options.backend) as found:
        for backend, new in found.items():
            for name, places in PLACES.items():
                whole, bare = (
                    median(taken) / STEPS for taken in measure(new, places, options.rounds)
                )
                figures = f"{1e6 * whole:.0f} us", f"{1e6 * bare:.0f} us", f"{whole / bare:.2f}"
                rows.append((f"{backend}, {name}", *figures))
    print_table("One apply", ("", "with its record", "without", "ratio"), rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
