"""What was true at a time, as known at a revision, beside what was known at that revision.

    python -m tests.benchmarks.two_clocks [--boxes 2000] [--revisions 10000] [--backend sqlite]

The history is that of `past.py`: a million changes. One of a hundred came late: at a later revision
it was said of a box that it had been, or had not been, on a shelf for a while. Reads of each view
alternate; the tables have medians, before the database has statistics and after ANALYZE. Aim: what
was true of one predicate takes at most twice the time of what was known of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from random import Random
from statistics import median
from typing import Any

import kant_sql
from kant_sql.sql.intervals import fork_of_period
from tests.benchmarks.drivers import Driver, Row, bare
from tests.benchmarks.past import CONDITIONS, NAME, REPEAT, asked, fill
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.benchmarks.years import START, STEP, ids_of

LATE, LONGEST = 100, 200
# Of ten revisions, which one.
AGES = {"long ago": 0, "halfway": 5, "lately": 10}


def late(store: Driver, kb: int, changes: int, last: int) -> Iterator[Row]:
    """Give what was said late: one row for so many changes."""
    random = Random(changes)
    predicate = ids_of(store, kb)["predicate", "at"]
    query = "SELECT id, arguments FROM proposition WHERE kb_id = ? AND predicate_id = ?"
    atoms = store.execute(query, (kb, predicate))
    said = set()
    for _ in range(changes // LATE):
        (id_, arguments), number = random.choice(atoms), random.randrange(LONGEST, last)
        if (id_, number) in said:
            continue
        said.add((id_, number))
        begin = number - random.randrange(2, LONGEST)
        end = random.randrange(begin + 1, number)
        period = [START + each * STEP for each in (begin, end)]
        moments = [store.moment(f"{each:%Y-%m-%dT%H:%M:%S}.000000Z") for each in period]
        objects = map(int, arguments.split())
        held = random.random() < 0.5
        yield (
            *(kb, id_, number, *moments, predicate, held, *objects),
            *(fork_of_period(*period), '(:held (at b s) :from "" :until "")'),
        )


def say_late(url: str, changes: int, last: int) -> int:
    """Add what was said late to a filled store; gives how often."""
    store = bare(url)
    ((kb,),) = store.execute("SELECT id FROM knowledge_base WHERE name = ?", (NAME,))
    rows = [*late(store, kb, changes, last)]
    store.without_checks()
    store.execute("BEGIN")
    store.insert("proposition_saying", len(rows[0]), rows)
    store.execute("COMMIT")
    store.close()
    return len(rows)


def predicate(view: Any) -> Any:
    """Give the call for all facts of a predicate, as DTOs."""
    return lambda _: lambda: view.propositions.get_by_predicate("at")


def measure(url: str) -> Iterator[tuple[str, list[float]]]:
    """Give each read with its seconds: known and true, for each age."""
    with kant_sql.connect(url, knowledge_base=NAME) as kb:
        reads = {"one predicate, as DTOs": predicate}
        reads |= {name: partial(asked, text=text) for name, text in CONDITIONS.items()}
        views: list[Any] = []
        for part in AGES.values():
            known = 4 + (kb.revision - 5) * part // 10
            moment = START + (known - LONGEST // 2 if part else known + LONGEST) * STEP
            views += [kb.at(known), kb.at(known=kb.revision, valid=moment)]
        for name, read in reads.items():
            calls = [read(view) for view in views]
            for call in calls:
                call(0)()
            yield name, [median(taken) for taken in alternate(REPEAT, *calls)]


def report(backend: str, url: str, title: str) -> None:
    header = ["ms", *(f"{age}: {clock}" for age in AGES for clock in ("known", "true", "ratio"))]
    rows = []
    for name, taken in measure(url):
        cells = []
        for known, true in zip(taken[::2], taken[1::2], strict=True):
            cells += [f"{known * 1e3:.2f}", f"{true * 1e3:.2f}", f"{true / known:.2f}"]
        rows.append([name, *cells])
    print_table(f"{backend}, {title}", header, rows)


def main(argv: list[str] | None = None) -> int:
    options = read_options(__doc__, argv, boxes=2000, revisions=10_000)
    with stores(options.backend) as makes:
        for backend, make in makes.items():
            url = make()
            last = fill(url, options.boxes, options.boxes, options.revisions)
            count = say_late(url, 2 * 50 * options.revisions, last)
            print(f"{backend}: {count:,} sayings among {100 * options.revisions:,} changes")
            report(backend, url, "without statistics")
            store = bare(url)
            store.settle()
            store.close()
            report(backend, url, "with statistics")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
