"""Conditions asked of the past beside the present, and when they held, with much history behind.

    python -m tests.benchmarks.past [--boxes 2000] [--facts 1000000] [--revisions 100000]
        [--backend sqlite]

Each revision moves 44 boxes between shelves, weighs one and puts 5 articles elsewhere: 100 changes,
10 million in all, beside a million facts of what is in stock. Each box has thousands of changes and
has been on nearly each shelf. The rows are generated and written by the bare driver; the library
would take hours. A condition is asked of the present and of revisions of each age, `when` of the
whole past; before the database has statistics, and after ANALYZE.

Calls alternate; the tables have medians. Aims: a past answer in at most three times the time of the
present one; the facts of one predicate in less than 10 ms; `when` of a ground condition in less
than 50 ms.
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
# Of 50 changes of a revision; one more is a weight.
MOVES, RESTOCKED, REPEAT = 44, 5, 9
# How many of a thousand revisions ago.
AGES = {"last": 0, "1 %": 10, "10 %": 100, "50 %": 500, "90 %": 900, "99 %": 990}
PLACES = 2_000
DOMAIN = """
(define (domain boxes)
  (:requirements :strips :typing :equality :negative-preconditions :numeric-fluents
                 :derived-predicates)
  (:types box shelf room article place)
  (:predicates (at ?b - box ?s - shelf) (sealed ?b - box) (in_room ?s - shelf ?r - room)
               (stock ?a - article ?p - place) (beside ?b ?c - box) (sells ?p - place))
  (:functions (level ?b - box))
  (:derived (beside ?b ?c - box) (exists (?s - shelf) (and (at ?b ?s) (at ?c ?s)))))
"""
CONDITIONS = {
    "all boxes": "(at ?b ?s)",
    "all pairs on a shelf": "(and (at ?b ?s) (at ?c ?s) (not (= ?b ?c)))",
    "pairs in a room": "(and (in_room ?s room3) (at ?b ?s) (at ?c ?s) (not (= ?b ?c)))",
    "not beside a sealed box": "(and (at ?b ?s) (not (exists (?c) (and (at ?c ?s) (sealed ?c)))))",
    "beside a sealed box": "(and (sealed ?b) (at ?b ?s) (at ?c ?s) (not (sealed ?c)))",
    "on a shelf or in a room": "(or (at ?b s3) (exists (?s) (and (at ?b ?s) (in_room ?s room3))))",
    "sealed boxes in a room": "(and (in_room ?s room3) (at ?b ?s) (sealed ?b))",
    "empty shelves": "(not (exists (?b) (at ?b ?s)))",
    "each box on shelf 3 is sealed": "(forall (?b - box) (imply (at ?b s3) (sealed ?b)))",
    "pairs of one shelf": "(and (at ?b s3) (at ?c s3) (not (= ?b ?c)))",
    "beside one box": "(and (at b7 ?s) (at ?c ?s))",
    "beside one box, derived": "(beside b7 ?c)",
    "boxes of one shelf": "(at ?b s3)",
    "heavy boxes of one shelf": "(and (at ?b s3) (> (level ?b) 50))",
    "shelf of one box": "(at b7 ?s)",
    "one box on one shelf": "(at b7 s3)",
    "not on one shelf": "(not (at b7 s3))",
    "weight of one box": "(> (level b7) 50)",
    "articles of one place": "(stock ?a p7)",
    "places of one article": "(stock a7 ?p)",
    "one article at one place": "(stock a7 p7)",
    "places of two articles": "(and (stock a7 ?p) (stock a8 ?p))",
    "places of one, not of another": "(and (stock a7 ?p) (not (stock a8 ?p)))",
    "places that sell one article": "(and (stock a7 ?p) (sells ?p))",
    "articles with one at p7": "(and (stock a7 ?p) (stock ?a ?p) (stock ?a p7))",
}
PERIODS = {
    "of one box": "(at b7 ?s)",
    "of two boxes": "(and (at b7 ?s) (at b8 ?s))",
    "of one fact": "(at b7 s3)",
    "of its opposite": "(not (at b7 s3))",
    "of a disjunction": "(or (at b7 s3) (at b8 s3))",
    "of a comparison": "(> (level b7) 50)",
    "of one shelf": "(at ?b s3)",
    "of an article": "(stock a7 ?p)",
}
# What names a type by the first letters of its objects.
LETTERS = {"box": "b", "shelf": "s", "room": "room", "article": "a", "place": "p"}
KINDS = {
    "at": ("box", "shelf"),
    "sealed": ("box",),
    "in_room": ("shelf", "room"),
    "stock": ("article", "place"),
    "sells": ("place",),
}


class Boxes(Writer):
    """Writes boxes that move, and articles in stock."""

    level_of = "b"

    @staticmethod
    def parts(key: Key) -> tuple[str, list[str]]:
        kinds = KINDS[key[0]]
        return key[0], [f"{LETTERS[kind]}{n}" for kind, n in zip(kinds, key[1:], strict=False)]


def moves(boxes: int, facts: int, first: int, last: int) -> Iterator[Version]:
    """Give the versions of boxes that move in each revision, and of stock, in no order."""
    random = Random(boxes)
    held: dict[Key, tuple[int, int]] = {}
    shelves, articles = counts_of(boxes, facts)["shelf"], counts_of(boxes, facts)["article"]
    for box in range(boxes):
        held["at", box] = random.randrange(shelves), first
        held["level", box] = random.randrange(100), first
    # The n-th of an article's places is one of a few.
    shares = facts // articles
    for number in range(facts):
        held["stock", number] = random.randrange(PLACES // shares), first

    def version(key: Key, until: int | None) -> Version:
        target, since = held[key]
        if key[0] == "stock":
            article, share = divmod(key[1], shares)
            return Version(("stock", article, share + target * shares), since, until)
        return Version((*key, target), since, until)

    for number in range(first + 1, last + 1):
        keys: list[Key] = [("at", box) for box in random.sample(range(boxes), min(MOVES, boxes))]
        keys += [("stock", random.randrange(facts)) for _ in range(RESTOCKED)]
        keys.append(("level", random.randrange(boxes)))
        many = {"at": shelves, "stock": PLACES // shares, "level": 100}
        for key in dict.fromkeys(keys):
            yield version(key, number)
            many_of = many[key[0]]
            held[key] = (held[key][0] + random.randrange(1, many_of)) % many_of, number
    yield from (version(key, None) for key in held)
    yield from (Version(("sealed", box, 0), first, None) for box in range(0, boxes, 20))
    yield from (Version(("sells", place, 0), first, None) for place in range(0, PLACES, 3))
    yield from (Version(("in_room", shelf, shelf % 10), first, None) for shelf in range(shelves))


def counts_of(boxes: int, facts: int) -> dict[str, int]:
    """Give how many objects there are of each type."""
    articles = max(facts // 100, 10)
    return {
        "box": boxes,
        "shelf": max(boxes // 20, 10),
        "room": 10,
        "article": articles,
        "place": PLACES,
    }


def fill(url: str, boxes: int, facts: int, revisions: int) -> int:
    """Fill an empty store with its tables; gives the last revision."""
    objects = " ".join(
        f"{' '.join(f'{LETTERS[kind]}{n}' for n in range(count))} - {kind}"
        for kind, count in counts_of(boxes, facts).items()
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
    writer.write(moves(boxes, facts, first, last), last)
    store.execute("COMMIT")
    store.close()
    return last


Call = Callable[[], Any]


def asked(view: Any, text: str) -> Callable[[int], Call]:
    """Give the call for the answers to a condition."""
    if "?" in text and "forall" not in text:
        return lambda _: lambda: list(view.query(text))
    return lambda _: lambda: view.holds(text)


def read(view: Any, predicate: str) -> Callable[[int], Call]:
    """Give the call for the DTOs of the facts of a predicate."""
    return lambda _: lambda: view.propositions.get_by_predicate(predicate)


def measure(url: str) -> Iterator[tuple[str, int, list[float]]]:
    """Give each condition, its number of answers, and the seconds of now and of each age."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        # Before that, there were no boxes.
        first, last = 5, kb.revision
        views = [kb, *(kb.at(last - (last - first) * part // 1_000) for part in AGES.values())]
        for name, text in CONDITIONS.items():
            calls = [asked(view, text) for view in views]
            answers = [call(0)() for call in calls]
            count = len(answers[0]) if isinstance(answers[0], list) else int(answers[0])
            assert answers[0] == answers[1]
            yield name, count, [median(taken) for taken in alternate(REPEAT, *calls)]
        for name in ("at", "sealed"):
            reads = [read(view, name) for view in views]
            count = len(reads[0](0)())
            yield f"DTOs of {name}", count, [median(taken) for taken in alternate(REPEAT, *reads)]


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
            # As autovacuum does: else PostgreSQL expects to read rows that its indexes have.
            store.settle()
            store.execute("ANALYZE")
            store.close()
        rows: list[list[str]] = []
        for name, count, (now, *then) in measure(url):
            ratios = [taken / now for taken in then]
            met = "yes" if max(ratios) <= 3 else "no"
            times = [f"{1e3 * taken:.2f}" for taken in (now, *then)]
            rows.append([name, f"{count:,}", *times, f"{max(ratios):.1f}x", met])
        header = [f"{backend}, ms", "answers", "now", *AGES, "ratio", "met"]
        print_table(f"Conditions of the past, {said}, median", header, rows)
        found = [[name, str(count), f"{1e3 * taken:.2f}"] for name, count, taken in periods(url)]
        print_table(f"When, {said}, median", [f"{backend}, ms", "periods", "when"], found)


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, boxes=2_000, facts=1_000_000, revisions=100_000)
    with stores(options.backend) as places:
        for backend, new in places.items():
            url = new()
            fill(url, options.boxes, options.facts, options.revisions)
            run(backend, url)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
