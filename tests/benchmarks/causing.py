"""What a fact led to, and goes back to, in a knowledge base of many acts.

    python -m tests.benchmarks.causing [--acts 500000] [--backend sqlite]

Each act is a revision with two changes, so that 500,000 make a million. Aim: below 50 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle, islice
from statistics import median

import kant_sql
from tests.benchmarks.support import print_table, read_options, seconds, stores

ROUNDS = 9
DOMAIN = """(define (domain rounds) (:requirements :typing) (:types robot place)
 (:predicates (at ?r - robot ?p - place) (door ?a ?b - place) (power))
 (:action move :parameters (?r - robot ?a ?b - place)
  :precondition (and (at ?r ?a) (door ?a ?b) (power))
  :effect (and (not (at ?r ?a)) (at ?r ?b))))"""
PROBLEM = """(define (problem day) (:domain rounds) (:objects rb1 - robot a b - place)
 (:init (at rb1 a) (door a b) (door b a) (power)) (:goal (and)))"""
ASKED = "(power)", "(door a b)", "(at rb1 b)"


def main(argv: Sequence[str] | None = None) -> int:
    """Record the acts, and print medians of the questions."""
    options = read_options(__doc__, argv, acts=500_000)
    rows = []
    with stores(options.backend) as found:
        for backend, new in found.items():
            with kant_sql.connect(new(), knowledge_base="robot", actor="executive") as kb:
                kb.load_domain(DOMAIN)
                kb.load_problem(PROBLEM)
                for step in islice(cycle(("(move rb1 a b)", "(move rb1 b a)")), options.acts):
                    kb.apply(step)
                for fact in ASKED:
                    for name, ask in (("led to", kb.consequences), ("goes back to", kb.origins)):
                        call = partial(ask, fact)
                        taken = median(seconds(call) for _ in range(ROUNDS))
                        rows.append((f"{backend}, what {fact} {name}", f"{1e3 * taken:.1f} ms"))
    print_table("Because of what", ("", "median"), rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
