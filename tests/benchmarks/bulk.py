"""How fast `save_all` is beside the bare driver, and that its memory does not grow with the facts.

    python -m tests.benchmarks.bulk [--facts 100000] [--repeat 5] [--backend sqlite] [--profile]

Both insert the same rows into the same tables with the same indexes, in one transaction: the
library from DTOs, the bare driver (executemany on SQLite, COPY on PostgreSQL) from rows that lie
ready. Each round has new stores, the two take turns, and the table has medians. Aim: at most 2
times the bare driver. Peak memory is that of a process of its own, which is given the facts by a
generator.
"""

from __future__ import annotations

import argparse
import cProfile
import gc
import json
import pstats
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import islice, product
from pathlib import Path
from statistics import median
from typing import Any

import kant_sql
from kant_sql import KnowledgeBase, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
from tests.benchmarks.support import NewStore, Row, alternate, bare, print_table, seconds, stores

ROOT = Path(__file__).resolve().parents[2]
SIDE = 1_000
# One COPY of all rows takes PostgreSQL twice as long: it checks foreign keys at the end of each.
BATCH = 10_000
MEMORY = (50_000, 100_000, 200_000)
PLACE = PddlTypeDto("place")
NEAR = PddlPredicateDto("near", [PLACE, PLACE])
TABLES = ("proposition", "proposition_argument", "proposition_version")


def define(kb: KnowledgeBase) -> None:
    """Save what the facts are made of."""
    kb.objects.save_all(PddlObjectDto(PLACE, f"p{number}") for number in range(SIDE))
    kb.predicates.save(NEAR)


def facts(number: int) -> Iterator[PddlPropositionDto]:
    """Give so many facts, as a reader of a file would: each with DTOs of its own."""
    for one, other in islice(product(range(SIDE), repeat=2), number):
        objects = [PddlObjectDto(PLACE, f"p{one}"), PddlObjectDto(PLACE, f"p{other}")]
        yield PddlPropositionDto(NEAR, objects)


def by_library(url: str, number: int) -> Any:
    """Prepare the library's side: a knowledge base with the definitions, and the DTOs."""
    with kant_sql.connect(url) as kb:
        define(kb)
    kb = kant_sql.connect(url)
    kb.propositions.get_all()
    dtos = list(facts(number))

    def insert() -> None:
        kb.propositions.save_all(dtos)
        kb.close()

    return insert


def by_driver(url: str, number: int) -> Any:
    """Prepare the bare driver's side: the same definitions, and the rows."""
    with kant_sql.connect(url) as kb:
        define(kb)
    store = bare(url)
    ((kb_id, revision, first),) = store.execute("SELECT kb_id, revision, next_id FROM head")
    ((predicate,),) = store.execute("SELECT id FROM predicate")
    ((moment, digest),) = store.execute("SELECT committed_at, hash FROM head")
    places = store.execute("SELECT id, name FROM object ORDER BY id")
    propositions: list[Row] = []
    arguments: list[Row] = []
    versions: list[Row] = []
    pairs = islice(product(places, places), number)
    for id_, ((a, one), (b, other)) in enumerate(pairs, first):
        text = f"(near {one} {other})"
        propositions.append((kb_id, id_, predicate, False, f"{a} {b}", text))
        arguments += [(kb_id, id_, 0, a), (kb_id, id_, 1, b)]
        versions.append((kb_id, id_, revision + 1, None, predicate, False, 0, a, b))

    def insert() -> None:
        store.execute("BEGIN")
        row = (kb_id, revision + 1, moment, None, None, None, 1, digest, None)
        store.insert("revision", len(row), [row])
        for start in range(0, number, BATCH):
            end = start + BATCH
            store.insert("proposition", 6, propositions[start:end])
            store.insert("proposition_argument", 4, arguments[2 * start : 2 * end])
            store.insert("proposition_version", 9, versions[start:end])
        store.execute("UPDATE head SET revision = ?, next_id = ?", (revision + 1, first + number))
        store.execute("COMMIT")
        store.close()

    return insert


def check_same(*urls: str) -> None:
    """Check that two stores hold the same facts, row for row."""
    contents = []
    for url in urls:
        store = bare(url)
        contents.append(
            [sorted(store.execute(f"SELECT * FROM {name}"), key=repr) for name in TABLES]
        )
        store.close()
    assert contents[0] == contents[1], "library and bare driver did not insert the same rows"


def compare(new: NewStore, number: int, repeat: int) -> list[str]:
    """Give a line of the table."""
    urls: list[str] = []

    def prepare(side: Any) -> Any:
        def make(_: int) -> Any:
            urls.append(new())
            return side(urls[-1], number)

        return make

    library, driver = map(
        median, alternate(repeat, prepare(by_library), prepare(by_driver), clean=True)
    )
    check_same(*urls[-2:])
    return [f"{library:.2f} s", f"{driver:.2f} s", f"{library / driver:.2f}x"]


def status(field: str) -> int:
    """Read a field of this process's memory, in kB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1])
    raise KeyError(field)


def measure_here(url: str, number: int) -> None:
    """Save facts from a generator in this process, and print what it took."""
    with kant_sql.connect(url) as kb:
        kb.propositions.get_all()
        gc.collect()
        before = status("VmRSS")
        taken = seconds(lambda: kb.propositions.save_all(facts(number)))
        print(json.dumps({"before": before, "peak": status("VmHWM"), "seconds": taken}))


def memory(new: NewStore, number: int) -> list[str]:
    """Give a line of the table of memory."""
    url = new()
    with kant_sql.connect(url) as kb:
        define(kb)
    command = [sys.executable, "-m", "tests.benchmarks.bulk", "--here", url, "--facts", str(number)]
    run = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    result = json.loads(run.stdout)
    grown = (result["peak"] - result["before"]) / 1024
    return [
        f"{number:,}",
        f"{result['before'] / 1024:.0f} MB",
        f"{result['peak'] / 1024:.0f} MB",
        f"{grown:.0f} MB",
        f"{result['seconds']:.2f} s",
    ]


def profile(new: NewStore, number: int) -> None:
    """Print where the time of `save_all` goes."""
    insert = by_library(new(), number)
    profiler = cProfile.Profile()
    profiler.runcall(insert)
    pstats.Stats(profiler).sort_stats("tottime").print_stats(30)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--facts", type=int, default=100_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--backend", choices=["sqlite", "postgresql"], action="append")
    parser.add_argument("--profile", action="store_true", help="print only a profile")
    parser.add_argument("--here", metavar="URL", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.here:
        measure_here(options.here, options.facts)
        return 0
    with stores(options.backend or ["sqlite", "postgresql"]) as places:
        if options.profile:
            for new in places.values():
                profile(new, options.facts)
            return 0
        print_table(
            f"save_all of {options.facts:,} new facts of two arguments",
            ["", "library", "bare driver", "ratio"],
            [[name, *compare(new, options.facts, options.repeat)] for name, new in places.items()],
        )
        print_table(
            "Memory of a process that saves facts from a generator",
            ["", "facts", "before", "peak", "growth", "time"],
            [[name, *memory(new, number)] for name, new in places.items() for number in MEMORY],
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
