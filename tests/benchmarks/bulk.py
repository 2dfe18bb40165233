"""How fast `save_all` is beside the bare driver, and that its memory does not grow with the facts.

    python -m tests.benchmarks.bulk [--facts 100000] [--repeat 5] [--backend sqlite]

Both insert the same rows into the same tables with the same indexes, in one transaction: the
library from DTOs, the bare driver (executemany on SQLite, COPY on PostgreSQL) from rows that lie
ready. Each round has new stores, the two take turns, and the table has medians. Aim: at most 2
times the bare driver. Peak memory is that of a process of its own, which is given the facts by a
generator.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Sequence
from itertools import islice, product

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.documents import Change, compare
from tests.benchmarks.support import (
    NewStore,
    figures_of,
    print_table,
    read_options,
    seconds,
    status,
    stores,
)

SIDE = 1_000
MEMORY = (50_000, 100_000, 200_000)
PLACE = PddlTypeDto("place")
NEAR = PddlPredicateDto("near", [PLACE, PLACE])


def define(kb: KnowledgeBase) -> None:
    """Save what the facts are made of."""
    kb.objects.save_all(PddlObjectDto(PLACE, f"p{number}") for number in range(SIDE))
    kb.predicates.save(NEAR)


def facts(number: int) -> Iterator[PddlPropositionDto]:
    """Give so many facts, as a reader of a file would: each with DTOs of its own."""
    for one, other in islice(product(range(SIDE), repeat=2), number):
        objects = [PddlObjectDto(PLACE, f"p{one}"), PddlObjectDto(PLACE, f"p{other}")]
        yield PddlPropositionDto(NEAR, objects)


def saves(number: int) -> Change:
    """Make the facts, and give the call that saves them."""
    dtos = list(facts(number))
    return lambda kb: kb.propositions.save_all(dtos)


def compare_saving(new: NewStore, number: int, repeat: int) -> list[str]:
    """Give a line of the table."""
    _, (library, driver) = compare(new, define, lambda: saves(number), repeat)
    return [f"{library:.2f} s", f"{driver:.2f} s", f"{library / driver:.2f}x"]


def measure_here(url: str, number: int) -> None:
    """Save facts from a generator in this process, and print what it took."""
    with kant_sql.connect(url) as kb:
        kb.propositions.get_all()
        gc.collect()
        before = status("VmRSS")
        taken = seconds(lambda: kb.propositions.save_all(facts(number)))
        print(before, status("VmHWM"), taken)


def memory(new: NewStore, number: int) -> list[str]:
    """Give a line of the table of memory."""
    url = new()
    with kant_sql.connect(url) as kb:
        define(kb)
    before, peak, taken = figures_of("tests.benchmarks.bulk", "--here", url, str(number))
    used = (f"{each:.0f} MB" for each in (before, peak, peak - before))
    return [f"{number:,}", *used, f"{taken:.2f} s"]


def main(argv: Sequence[str] | None = None) -> int:
    words = sys.argv[1:] if argv is None else argv
    if [*words[:1]] == ["--here"]:
        measure_here(words[1], int(words[2]))
        return 0
    options = read_options(__doc__, argv, facts=100_000, repeat=5)
    with stores(options.backend) as places:
        lines = [
            [name, *compare_saving(new, options.facts, options.repeat)]
            for name, new in places.items()
        ]
        title = f"save_all of {options.facts:,} new facts of two arguments"
        print_table(title, ["", "library", "bare driver", "ratio"], lines)
        print_table(
            "Memory of a process that saves facts from a generator",
            ["", "facts", "before", "peak", "growth", "time"],
            [[name, *memory(new, number)] for name, new in places.items() for number in MEMORY],
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
