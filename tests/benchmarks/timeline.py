"""The first window of a timeline over a million intervals, in each shape that they may have.

    python -m tests.benchmarks.timeline [--intervals 1000000] [--backend sqlite]

The stores are filled by the bare driver. What is measured is `kb.timeline()` as the page asks for
it: over everything, 50 lanes, 600 slices; and a narrow window in the middle. Beside it stands how
long the bare driver takes to only read all intervals of those lanes, which a timeline that is not
bounded has to do. Calls alternate; the table has medians. Aim: less than 300 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

import kant_sql
from tests.benchmarks.drivers import Driver, bare
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.benchmarks.years import START, STEP, Key, Version, Writer

NAME = "robot"
REPEAT = 7
DOMAIN = """
(define (domain items) (:requirements :strips :typing :numeric-fluents) (:types item)
  (:predicates (seen ?i - item)) (:functions (level ?i - item)))
"""


class Shape(NamedTuple):
    """How intervals are spread."""

    name: str  # what it is called
    parts: int  # how many facts or fluents they are of; so many times fewer are of each
    are_values: bool = False  # whether they are of fluents


SHAPES = (
    Shape("one fact", 1),
    Shape("100 facts", 100),
    Shape("100,000 facts", 100_000),
    Shape("one fluent", 1, True),
    Shape("100 fluents", 100, True),
)


class Items(Writer):
    """Writes what items are seen, and their levels."""

    level_of = "item"

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        return key[0], [f"item{key[1]}"]


def fill(url: str, shape: Shape, intervals: int) -> int:
    """Fill a store with the intervals of one shape, and give the last revision."""
    parts = min(shape.parts, intervals)
    names = " ".join(f"item{part}" for part in range(parts))
    with kant_sql.connect(url, knowledge_base=NAME, actor="bench") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(f"(define (problem p) (:domain items) (:objects {names} - item))")
    store = bare(url)
    store.without_checks()
    store.execute("BEGIN")
    writer = Items(store, NAME)
    first = writer.revision + 1
    # What has no pause between two intervals needs one.
    pace = 2 if parts == 1 else 1

    def versions() -> Iterator[Version]:
        for n in range(intervals):
            since, part = first + pace * n, n % parts
            key = ("level", part, n * 37 % 101) if shape.are_values else ("seen", part)
            yield Version(key, since, since + max(1, parts // 2))

    last = writer.write(versions(), first + pace * intervals + parts)
    store.execute("COMMIT")
    store.settle()
    store.close()
    return last


Call = Callable[[], Any]


def by_hand(store: Driver, shape: Shape) -> Call:
    """Read all intervals of the first 50 lanes."""
    identity = "function_value" if shape.are_values else "proposition"
    sql = (
        f"SELECT v.since, v.until FROM {identity}_version AS v WHERE v.kb_id = ?"
        f" AND v.{identity}_id IN (SELECT id FROM {identity} ORDER BY arguments LIMIT 50)"
    )
    ((kb,),) = store.execute("SELECT kb_id FROM head")
    return lambda: store.execute(sql, (kb,))


def measure(url: str, shape: Shape, intervals: int) -> Sequence[float]:
    """Give the median seconds of each question."""
    last = fill(url, shape, intervals)
    middle = START + last // 2 * STEP
    store = bare(url)
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        calls: list[Call] = [
            kb.timeline,
            lambda: kb.timeline(middle, until=middle + 100 * STEP),
            by_hand(store, shape),
        ]
        for call in calls:
            call()
        taken = alternate(REPEAT, *[lambda _, call=call: call for call in calls])
    store.close()
    return [median(times) for times in taken]


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(
        __doc__, argv, intervals=1_000_000, shape=[shape.name for shape in SHAPES]
    )
    with stores(options.backend) as places:
        for backend, new in places.items():
            rows = []
            for shape in SHAPES:
                if shape.name in options.shape:
                    times = measure(new(), shape, options.intervals)
                    rows.append([shape.name, *(f"{1e3 * one:.1f}" for one in times)])
            print_table(
                f"Timeline of {options.intervals:,} intervals, {backend}, ms, median",
                ["", "everything", "100 revisions", "all intervals read"],
                rows,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
