"""What a fact led to, goes back to, and nobody has seen, in a knowledge base of many acts.

    python -m tests.benchmarks.causing [--acts 500000] [--backend sqlite]

A hundred robots move. Each act is a revision with two changes, so that 500,000 make a million.
Aim: below 50 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import cycle, islice
from statistics import median

import kant_sql
from tests.benchmarks.drivers import bare
from tests.benchmarks.support import print_table, read_options, seconds, stores

ROBOTS, ROUNDS = 100, 9
DOMAIN = """(define (domain rounds) (:requirements :typing) (:types robot place)
 (:predicates (at ?r - robot ?p - place) (door ?a ?b - place) (power))
 (:action move :parameters (?r - robot ?a ?b - place)
  :precondition (and (at ?r ?a) (door ?a ?b) (power))
  :effect (and (not (at ?r ?a)) (at ?r ?b))))"""
NAMES = [f"rb{number}" for number in range(ROBOTS)]
PROBLEM = f"""(define (problem day) (:domain rounds)
 (:objects {" ".join(NAMES)} - robot a b - place)
 (:init {" ".join(f"(at {name} a)" for name in NAMES)} (door a b) (door b a) (power))
 (:goal (and)))"""
STEPS = [f"(move {name} {way})" for way in ("a b", "b a") for name in NAMES]
ASKED = "(power)", "(door a b)", "(at rb1 b)"


def main(argv: Sequence[str] | None = None) -> int:
    """Record the acts, and print medians of the questions."""
    options = read_options(__doc__, argv, acts=500_000)
    rows = []
    with stores(options.backend) as found:
        for backend, new in found.items():
            url = new()
            with kant_sql.connect(url, knowledge_base="robot", actor="executive") as kb:
                kb.load_domain(DOMAIN)
                kb.load_problem(PROBLEM)
                for step in islice(cycle(STEPS), options.acts):
                    kb.apply(step)
                store = bare(url)
                store.settle()
                store.close()
                assert len(kb.unconfirmed()) == min(options.acts, ROBOTS)
                questions = {"what nobody has seen": kb.unconfirmed} | {
                    f"what {fact} {name}": partial(ask, fact)
                    for fact in ASKED
                    for name, ask in (("led to", kb.consequences), ("goes back to", kb.origins))
                }
                for name, call in questions.items():
                    taken = median(seconds(call) for _ in range(ROUNDS))
                    rows.append((f"{backend}, {name}", f"{1e3 * taken:.1f} ms"))
    print_table("Because of what", ("", "median"), rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
