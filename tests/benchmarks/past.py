"""Conditions asked of the past beside the present, and when they held, with much history behind.

    python -m tests.benchmarks.past [--boxes 2000] [--revisions 10000] [--backend sqlite]

Each revision moves 50 boxes between shelves: a million changes, of which each box has hundreds, and
nearly each box has been on each shelf. A condition is asked of the present and of revisions of each
age, `when` of the whole past; before the database has statistics, and after ANALYZE.

Calls alternate; the tables have medians. Aims: a past answer in at most three times the time of the
present one, or, where that is found by an index that the past has not, in the time of all facts of
that revision; `when` of one box in less than 20 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from random import Random
from statistics import median
from typing import Any

import kant_sql
from tests.benchmarks.drivers import bare
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.benchmarks.years import Key, Version, Writer

NAME = "boxes"
MOVES, REPEAT = 50, 7
# Of ten revisions, which one.
AGES = {"long ago": 0, "halfway": 5, "lately": 10}
DOMAIN = """
(define (domain boxes) (:requirements :strips :typing :equality :negative-preconditions)
  (:types box shelf room)
  (:predicates (at ?b - box ?s - shelf) (sealed ?b - box) (in_room ?s - shelf ?r - room)))
"""
ALL = "(at ?b ?s)"
CONDITIONS = {
    "all facts": ALL,
    "all pairs on a shelf": "(and (at ?b ?s) (at ?c ?s) (not (= ?b ?c)))",
    "pairs in a room": "(and (in_room ?s room3) (at ?b ?s) (at ?c ?s) (not (= ?b ?c)))",
    "not beside a sealed box": "(and (at ?b ?s) (not (exists (?c) (and (at ?c ?s) (sealed ?c)))))",
    "beside a sealed box": "(and (sealed ?b) (at ?b ?s) (at ?c ?s) (not (sealed ?c)))",
    "on a shelf or in a room": "(or (at ?b s3) (exists (?s) (and (at ?b ?s) (in_room ?s room3))))",
    "sealed boxes in a room": "(and (in_room ?s room3) (at ?b ?s) (sealed ?b))",
    "empty shelves": "(not (exists (?b) (at ?b ?s)))",
    "pairs of one shelf": "(and (at ?b s3) (at ?c s3) (not (= ?b ?c)))",
    "beside one box": "(and (at b7 ?s) (at ?c ?s))",
    "boxes of one shelf": "(at ?b s3)",
    "shelf of one box": "(at b7 ?s)",
}
PERIODS = {
    "of one box": "(at b7 ?s)",
    "of two boxes": "(and (at b7 ?s) (at b8 ?s))",
    "of one fact": "(at b7 s3)",
    "of one shelf": "(at ?b s3)",
}


class Boxes(Writer):
    """Writes boxes that move."""

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        predicate, first, second = key
        if predicate == "sealed":
            return predicate, [f"b{first}"]
        one, other = ("b", "s") if predicate == "at" else ("s", "room")
        return predicate, [f"{one}{first}", f"{other}{second}"]


def moves(boxes: int, shelves: int, first: int, last: int) -> Iterator[Version]:
    """Give the versions of boxes that move in each revision, in no order."""
    random = Random(boxes)
    held = {box: (random.randrange(shelves), first) for box in range(boxes)}
    for number in range(first + 1, last + 1):
        for box in random.sample(range(boxes), min(MOVES, boxes)):
            shelf, since = held[box]
            yield Version(("at", box, shelf), since, number)
            held[box] = ((shelf + random.randrange(1, shelves)) % shelves, number)
    yield from (Version(("at", box, shelf), since, None) for box, (shelf, since) in held.items())
    yield from (Version(("sealed", box, 0), first, None) for box in range(0, boxes, 20))
    yield from (Version(("in_room", shelf, shelf % 10), first, None) for shelf in range(shelves))


def fill(url: str, boxes: int, revisions: int) -> int:
    """Fill an empty store with its tables; gives the last revision."""
    counts = {"b": ("box", boxes), "s": ("shelf", max(boxes // 20, 10)), "room": ("room", 10)}
    objects = " ".join(
        f"{' '.join(f'{letter}{n}' for n in range(count))} - {kind}"
        for letter, (kind, count) in counts.items()
    )
    problem = f"(define (problem p) (:domain boxes) (:objects {objects}) (:init) (:goal (and)))"
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(problem)
    store = bare(url)
    store.without_checks()
    writer = Boxes(store, NAME)
    first = writer.revision + 1
    last = first + revisions
    store.execute("BEGIN")
    writer.write(moves(boxes, counts["s"][1], first, last), last)
    store.execute("COMMIT")
    store.close()
    return last


Call = Callable[[], Any]


def asked(view: Any, text: str) -> Callable[[int], Call]:
    """Give the call for the answers to a condition."""
    return lambda _: lambda: list(view.query(text))


def measure(url: str) -> Iterator[tuple[str, list[float]]]:
    """Give each condition with the seconds of the present, and of each age."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        # Before that, there were no boxes.
        ages = [4 + (kb.revision - 5) * part // 10 for part in AGES.values()]
        views: list[Any] = [kb, *map(kb.at, ages)]
        for name, text in CONDITIONS.items():
            calls = [asked(view, text) for view in views]
            for call in calls:
                call(0)()
            yield name, [median(taken) for taken in alternate(REPEAT, *calls)]


def periods(url: str) -> Iterator[tuple[str, int, float]]:
    """Give each condition with its number of periods, and the seconds of `when`."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        for name, text in PERIODS.items():

            def call(_: int, text: str = text) -> Call:
                return lambda: kb.when(text)

            count = len(kb.when(text))
            [taken] = alternate(REPEAT, call)
            yield name, count, median(taken)


def run(backend: str, url: str) -> None:
    """Measure one store, without statistics and with them."""
    for said in ("without statistics", "after ANALYZE"):
        if said == "after ANALYZE":
            store = bare(url)
            store.execute("ANALYZE")
            store.close()
        rows: list[list[str]] = []
        read: list[float] = []
        for name, (now, *then) in measure(url):
            read = read or then
            row = [name, f"{1e3 * now:.2f}"]
            for taken, whole in zip(then, read, strict=True):
                is_met = taken <= max(3 * now, whole)
                met = "yes" if is_met else "no"
                row += [f"{1e3 * taken:.2f}", f"{taken / now:.1f}x", met]
            rows.append(row)
        header = [f"{backend}, ms", "now"]
        for age in AGES:
            header += [age, "ratio", "met"]
        print_table(f"Conditions of the past, {said}, median", header, rows)
        found = [[name, str(count), f"{1e3 * taken:.2f}"] for name, count, taken in periods(url)]
        print_table(f"When, {said}, median", [f"{backend}, ms", "periods", "when"], found)


def main(argv: Sequence[str] | None = None) -> int:
    """Run it."""
    options = read_options(__doc__, argv, boxes=2_000, revisions=10_000)
    with stores(options.backend) as places:
        for backend, new in places.items():
            url = new()
            fill(url, options.boxes, options.revisions)
            run(backend, url)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
