"""The first window of a timeline over a million intervals, in each shape that they may have.

    python -m tests.benchmarks.timeline [--intervals 1000000] [--backend sqlite]

The stores are filled by the bare driver. What is measured is `kb.timeline()` as the page asks for
it: over everything, 50 lanes, 600 slices; and a narrow window in the middle. Beside it stands how
long the bare driver takes to only read all intervals of those lanes, which a timeline that is not
bounded has to do. Calls alternate; the table has medians. Aim: less than 300 ms.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from statistics import median
from typing import Any, NamedTuple

import kant_sql
from kant_sql import (
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from kant_sql.knowledge.canonical import time_text
from kant_sql.sql.intervals import fork
from tests.benchmarks.support import Bare, Row, alternate, bare, print_table, stores

NAME = "robot"
REPEAT = 7
START, STEP = datetime(2024, 1, 1, tzinfo=UTC), timedelta(seconds=30)
ITEM = PddlTypeDto("item")
SEEN, LEVEL = PddlPredicateDto("seen", [ITEM]), PddlFunctionDto("level", [ITEM])


class Shape(NamedTuple):
    """How intervals are spread.

    Attributes:
        name: what it is called.
        parts: how many facts or fluents they are of; so many times fewer are of each.
        are_values: whether they are of fluents.
    """

    name: str
    parts: int
    are_values: bool = False


SHAPES = (
    Shape("one fact", 1),
    Shape("100 facts", 100),
    Shape("100,000 facts", 100_000),
    Shape("one fluent", 1, True),
    Shape("100 fluents", 100, True),
)


class Filling:
    """Fills a store with the intervals of one shape."""

    def __init__(self, url: str, shape: Shape, intervals: int) -> None:
        with kant_sql.connect(url, knowledge_base=NAME, actor="bench") as kb:
            first = PddlObjectDto(ITEM, "item0")
            kb.propositions.save(PddlPropositionDto(SEEN, [first]))
            kb.propositions.delete_all()
            kb.function_values.set(LEVEL, objects=[first], value=1)
            kb.function_values.delete_all()
        self.store, self.shape = bare(url), shape
        self.parts = min(shape.parts, intervals)
        self.intervals = intervals
        self.kb, head, self.next = self.store.execute("SELECT kb_id, revision, next_id FROM head")[
            0
        ]
        self.head = int(head)
        group = "function" if shape.are_values else "predicate"
        ((self.group,),) = self.store.execute(f"SELECT id FROM {group}")
        ((self.object,),) = self.store.execute("SELECT id FROM object")

    def run(self) -> int:
        """Write the rows, and give the last revision."""
        store, shape = self.store, self.shape
        # What has no pause between two intervals needs one.
        last = self.head + (2 if self.parts == 1 else 1) * self.intervals + self.parts
        store.without_checks()
        store.execute("BEGIN")
        store.execute("DELETE FROM revision")
        store.insert(
            "revision (kb_id, number, committed_at, actor, reason, form, hash)",
            7,
            self.revisions(last),
        )
        identity = "function_value" if shape.are_values else "proposition"
        group = "function_id" if shape.are_values else "predicate_id, is_goal"
        own: Row = (self.group,) if shape.are_values else (self.group, False)
        columns = f"{identity} (kb_id, id, arguments, text, {group})"
        store.insert(columns, 4 + len(own), (row + own for row in self.identities()))
        more = ", value, number, text" if shape.are_values else ", first_object_id"
        columns = f"{identity}_version (kb_id, {identity}_id, since, until, {group}, fork{more})"
        width = 5 + len(own) + (3 if shape.are_values else 1)
        store.insert(columns, width, self.versions(own))
        moved = (last, self.next + 2 * self.parts, time_text(START + last * STEP))
        store.execute("UPDATE head SET revision = ?, next_id = ?, committed_at = ?", moved)
        store.execute("COMMIT")
        store.settle()
        store.close()
        return last

    def revisions(self, last: int) -> Iterator[Row]:
        for number in range(1, last + 1):
            at = time_text(START + number * STEP)
            yield self.kb, number, at, f"actor{number % 5}", "seen again", 2, "0" * 64

    def identities(self) -> Iterator[Row]:
        for part in range(self.parts):
            text = f"({'level' if self.shape.are_values else 'seen'} item{part})"
            yield self.kb, self.next + part, f"{self.object} {part}", text

    def versions(self, own: Row) -> Iterator[Row]:
        for n in range(self.intervals):
            part = n % self.parts
            since = self.head + 1 + (2 * n if self.parts == 1 else n)
            until = since + max(1, self.parts // 2)
            row = (self.kb, self.next + part, since, until, *own, fork(since, until))
            number = float(n * 37 % 101)
            yield (*row, str(int(number)), number, "") if self.shape.are_values else (*row, part)


Call = Callable[[], Any]


def by_hand(store: Bare, shape: Shape) -> Call:
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
    last = Filling(url, shape, intervals).run()
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
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--intervals", type=int, default=1_000_000)
    parser.add_argument("--backend", choices=["sqlite", "postgresql"], action="append")
    parser.add_argument("--shape", choices=[shape.name for shape in SHAPES], action="append")
    options = parser.parse_args(argv)
    with stores(options.backend or ["sqlite", "postgresql"]) as places:
        for backend, new in places.items():
            rows = []
            for shape in SHAPES:
                if options.shape is None or shape.name in options.shape:
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
