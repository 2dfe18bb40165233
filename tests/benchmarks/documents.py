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

import kant_sql
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


def rows_of(url: str) -> Tables:
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


def defined(new: NewStore) -> str:
    """Make a store with the definitions; give its URL."""
    url = new()
    with kant_sql.connect(url) as kb:
        kb.load_domain(generated.DOMAIN)
    return url


def rows_to_insert(new: NewStore, problem: str) -> tuple[Tables, Row]:
    """Give what loading a problem inserts, and what the head's row is then."""
    url = defined(new)
    before = rows_of(url)
    with kant_sql.connect(url) as kb:
        kb.load_problem(problem)
    after = rows_of(url)
    (head,) = after.pop("head")
    inserted = {}
    for name, rows in after.items():
        known = set(before[name])
        inserted[name] = [row for row in rows if row not in known]
    return inserted, head


def by_library(url: str, problem: str) -> Callable[[], None]:
    kb = kant_sql.connect(url)
    kb.propositions.get_all()

    def load() -> None:
        kb.load_problem(problem)
        kb.close()

    return load


def by_driver(url: str, rows: Tables, head: Row) -> Callable[[], None]:
    store = bare(url)

    def insert() -> None:
        store.execute("BEGIN")
        insert_all(store, rows)
        store.execute(HEAD, head[1:])
        store.execute("COMMIT")
        store.close()

    return insert


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


def compare_loading(new: NewStore, problem: str, repeat: int) -> list[str]:
    domain = read_domain(generated.DOMAIN)
    rows, head = rows_to_insert(new, problem)
    urls: dict[str, str] = {}

    def library(_: int) -> Callable[[], None]:
        urls["library"] = defined(new)
        return by_library(urls["library"], problem)

    def driver(_: int) -> Callable[[], None]:
        urls["driver"] = defined(new)
        return by_driver(urls["driver"], rows, head)

    def reader(_: int) -> Callable[[], object]:
        return lambda: read_problem(problem, domain=domain)

    taken = alternate(repeat, library, driver, reader, clean=True)
    compare_tables(*urls.values())
    loading, inserting, reading = map(median, taken)
    seconds = [f"{each:.2f} s" for each in (loading, reading, inserting)]
    return [f"{sum(map(len, rows.values())):,}", *seconds, f"{loading / inserting:.2f}x"]


def compare_writing(new: NewStore, problem: str, repeat: int) -> list[str]:
    url = defined(new)
    with kant_sql.connect(url) as kb:
        kb.load_problem(problem)
        store = bare(url)
        store.settle()
        text = kb.problem_pddl()

        def fetch() -> int:
            return len(store.execute(FACTS)) + len(store.execute(VALUES))

        assert text.count("\n    (", text.index("(:init"), text.index("(:goal")) == fetch()
        writing, fetching = map(
            median, alternate(repeat, lambda _: kb.problem_pddl, lambda _: fetch, clean=True)
        )
        store.close()
    seconds = [f"{each:.2f} s" for each in (writing, fetching)]
    return [f"{len(text) / 1e6:.1f} MB", *seconds, f"{writing / fetching:.2f}x"]


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, facts=200_000, repeat=3)
    facts, half = options.facts, options.facts // 2
    problems = {
        f"{facts:,} facts": generated.problem(facts),
        f"{half:,} facts, {half:,} values": generated.problem(half, half),
    }
    with stores(options.backend) as places:
        lines = [
            (f"{name}, {title}", new, problem)
            for title, problem in problems.items()
            for name, new in places.items()
        ]
        print_table(
            "Loading a problem: load_problem() of its text, beside the bare driver with its rows",
            ["", "rows", "load_problem", "of it reading", "bare driver", "ratio"],
            [[title, *compare_loading(new, each, options.repeat)] for title, new, each in lines],
        )
        print_table(
            "Writing a problem: problem_pddl(), beside the bare driver that fetches its texts",
            ["", "text", "problem_pddl", "bare driver", "ratio"],
            [[title, *compare_writing(new, each, options.repeat)] for title, new, each in lines],
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
