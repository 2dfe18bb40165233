"""How fast problems are loaded into a store and written from it, beside the bare driver.

    python -m tests.benchmarks.documents [--facts 200000] [--repeat 3] [--backend sqlite]

Loading: the library reads the text, checks it and stores it in one revision; the bare driver
inserts the same rows (executemany on SQLite, COPY on PostgreSQL), which lie ready, into the same
tables in one transaction. Afterwards both stores hold the same, row for row. Aim: at most 2 times
the bare driver. How much of it is reading the text is shown beside it.

Writing: `problem_pddl()`, beside the bare driver that fetches the texts of the same facts and
values in the same order. Aim: at most 3 times the bare driver.

Each round has new stores, the two take turns, and the tables have medians.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.pddl import read_domain, read_problem
from kant_sql.sql.tables import Base, HeadRow
from tests.benchmarks import generated
from tests.benchmarks.comparing import compare_tables
from tests.benchmarks.drivers import Driver, Row, bare
from tests.benchmarks.support import NewStore, alternate, print_table, read_options, stores

# One COPY of all rows takes PostgreSQL twice as long: it checks foreign keys at the end of each.
BATCH = 10_000
# What there is many of: the identities, then what refers to them, each in the order of the ids.
FAMILIES = tuple(
    (name, f"{name}_argument", f"{name}_version") for name in ("proposition", "function_value")
)
_SETTINGS = ", ".join(f"{column.name} = ?" for column in [*HeadRow.__table__.columns][1:])
HEAD = f"UPDATE head SET {_SETTINGS}"
FACTS = (
    "SELECT p.id, p.text FROM proposition_version v"
    " JOIN proposition p ON p.kb_id = v.kb_id AND p.id = v.proposition_id"
    " WHERE v.kb_id = 1 AND v.until IS NULL AND p.is_goal = false ORDER BY p.id"
)
VALUES = (
    "SELECT function_value_id, text FROM function_value_version"
    " WHERE kb_id = 1 AND until IS NULL ORDER BY function_value_id"
)

Tables = dict[str, list[Row]]
Change = Callable[[KnowledgeBase], object]
Make = Callable[[int], Callable[[], object]]


class Case(NamedTuple):
    """A problem to measure with."""

    title: str  # what it is called in the tables
    text: str  # the problem


def rows_of(url: str) -> Tables:
    """Read all rows of a store."""
    store = bare(url)
    rows = {
        table.name: store.execute(
            f"SELECT * FROM {table.name}"
            f" ORDER BY {', '.join(column.name for column in table.primary_key)}"
        )
        for table in Base.metadata.sorted_tables
    }
    store.close()
    return rows


def rows_to_insert(new: NewStore, define: Change, load: Change) -> tuple[Tables, Row]:
    """Tell what a call inserts into a store with definitions, and what the head's row is then."""
    url = new()
    with kant_sql.connect(url) as kb:
        define(kb)
        before = rows_of(url)
        load(kb)
    after = rows_of(url)
    (head,) = after.pop("head")
    inserted = {}
    for name, rows in after.items():
        known = set(before[name])
        inserted[name] = [row for row in rows if row not in known]
    return inserted, head


def by_library(url: str, define: Change, load: Change) -> Callable[[], None]:
    """Prepare the library's side: a store with the definitions."""
    with kant_sql.connect(url) as kb:
        define(kb)
    kb = kant_sql.connect(url)
    kb.propositions.get_all()

    def save() -> None:
        load(kb)
        kb.close()

    return save


def by_driver(url: str, define: Change, rows: Tables, head: Row) -> Callable[[], None]:
    """Prepare the bare driver's side: a store with the definitions."""
    with kant_sql.connect(url) as kb:
        define(kb)
    store = bare(url)

    def insert() -> None:
        store.execute("BEGIN")
        insert_all(store, rows)
        store.execute(HEAD, head[1:])
        store.execute("COMMIT")
        store.close()

    return insert


def compare(
    new: NewStore, define: Change, load: Callable[[], Change], repeat: int, *others: Make
) -> tuple[int, list[float]]:
    """Give how many rows are inserted, and the medians: the library, the driver, and others."""
    rows, head = rows_to_insert(new, define, load())
    urls: dict[Any, str] = {}

    def library(_: int) -> Callable[[], None]:
        urls[library] = new()
        return by_library(urls[library], define, load())

    def driver(_: int) -> Callable[[], None]:
        urls[driver] = new()
        return by_driver(urls[driver], define, rows, head)

    taken = [*map(median, alternate(repeat, library, driver, *others, clean=True))]
    compare_tables(urls[library], urls[driver])
    return sum(map(len, rows.values())), taken


def insert_all(store: Driver, tables: Tables) -> None:
    """Insert rows of all tables, each behind what it refers to."""

    def insert(name: str, rows: list[Row]) -> None:
        if rows:
            store.insert(name, len(rows[0]), rows)

    many = {name for family in FAMILIES for name in family}
    insert("revision", tables["revision"])
    for name, rows in tables.items():
        if name != "revision" and name not in many:
            insert(name, rows)
    for family in FAMILIES:
        done = dict.fromkeys(family, 0)
        identities = tables[family[0]]
        for start in range(0, len(identities), BATCH):
            last: int = identities[start : start + BATCH][-1][1]
            for name in family:
                rows = tables[name]
                end = bisect_left(rows, last + 1, key=lambda row: row[1])
                insert(name, rows[done[name] : end])
                done[name] = end


def compare_loading(new: NewStore, case: Case, repeat: int) -> list[str]:
    """Give a line of the table of loading."""
    domain = read_domain(generated.DOMAIN)
    number, (loading, inserting, reading) = compare(
        new,
        lambda kb: kb.load_domain(generated.DOMAIN),
        lambda: lambda kb: kb.load_problem(case.text),
        repeat,
        lambda _: lambda: read_problem(case.text, domain=domain),
    )
    return [
        f"{number:,}",
        f"{loading:.2f} s",
        f"{reading:.2f} s",
        f"{inserting:.2f} s",
        f"{loading / inserting:.2f}x",
    ]


def compare_writing(new: NewStore, case: Case, repeat: int) -> list[str]:
    """Give a line of the table of writing."""
    url = new()
    with kant_sql.connect(url) as kb:
        kb.load_domain(generated.DOMAIN)
        kb.load_problem(case.text)
        store = bare(url)
        store.settle()
        text = kb.problem_pddl()

        def fetch() -> int:
            return len(store.execute(FACTS)) + len(store.execute(VALUES))

        assert text.count("\n    (", text.index("(:init"), text.index("(:goal")) == fetch()
        writing, fetching = map(
            median,
            alternate(repeat, lambda _: kb.problem_pddl, lambda _: fetch, clean=True),
        )
        store.close()
    return [
        f"{len(text) / 1e6:.1f} MB",
        f"{writing:.2f} s",
        f"{fetching:.2f} s",
        f"{writing / fetching:.2f}x",
    ]


def cases(facts: int) -> list[Case]:
    """Give the problems."""
    half = facts // 2
    return [
        Case(f"{facts:,} facts", generated.problem(facts)),
        Case(f"{half:,} facts, {half:,} values", generated.problem(half, half)),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    options = read_options(__doc__, argv, facts=200_000, repeat=3)
    problems = cases(options.facts)
    with stores(options.backend) as places:
        lines = [
            (f"{name}, {case.title}", new, case)
            for case in problems
            for name, new in places.items()
        ]
        print_table(
            "Loading a problem: load_problem() of its text, beside the bare driver with its rows",
            ["", "rows", "load_problem", "of it reading", "bare driver", "ratio"],
            [[title, *compare_loading(new, case, options.repeat)] for title, new, case in lines],
        )
        print_table(
            "Writing a problem: problem_pddl(), beside the bare driver that fetches its texts",
            ["", "text", "problem_pddl", "bare driver", "ratio"],
            [[title, *compare_writing(new, case, options.repeat)] for title, new, case in lines],
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
