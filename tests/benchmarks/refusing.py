"""What a rule that refuses adds to writes.

    python -m tests.benchmarks.refusing [--rounds 300] [--backend sqlite]

Calls alternate between two stores, one of which keeps a rule; the table has medians.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import kant_sql
from tests.benchmarks.support import NewStore, alternate, print_table, read_options, stores

ROBOTS, STEPS = 2_000, 10
DOMAIN = """(define (domain rounds) (:requirements :typing) (:types robot place)
 (:predicates (at ?r - robot ?p - place) (free ?p - place)))"""
RULE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"
# A write that the rule does not mention, and one that it judges.
FACTS = {"touches no rule": "(free spare)", "touches the rule": "(at idle spare)"}


def measure(new: NewStore, fact: str, rounds: int) -> list[list[float]]:
    """Time rounds of writes with a rule, and without."""

    def writing(has_rule: bool) -> Callable[[int], Callable[[], Any]]:
        kb = kant_sql.connect(new(), knowledge_base="robot", actor="perception")
        kb.load_domain(DOMAIN)
        robots = [f"r{n} - robot" for n in range(ROBOTS)]
        kb.objects.save([*robots, "idle - robot", "p - place", "spare - place"])
        kb.propositions.save([f"(at r{n} p)" for n in range(ROBOTS)])
        if has_rule:
            kb.rules.save("one-place", RULE, on_violation="refuse")

        def work() -> None:
            for _ in range(STEPS // 2):
                kb.propositions.save(fact)
                kb.propositions.delete(fact)

        return lambda _: work

    return alternate(rounds, writing(True), writing(False))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print how many times the time is that writes without a rule take."""
    options = read_options(__doc__, argv, rounds=300)
    rows = []
    with stores(options.backend) as found:
        for backend, new in found.items():
            for name, fact in FACTS.items():
                ruled, bare = (median(one) / STEPS for one in measure(new, fact, options.rounds))
                figures = f"{1e6 * ruled:.0f} us", f"{1e6 * bare:.0f} us", f"{ruled / bare:.2f}"
                rows.append((f"{backend}, {name}", *figures))
    print_table("One write", ("", "with a rule", "without", "ratio"), rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
