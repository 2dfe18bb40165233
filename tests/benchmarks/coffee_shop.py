"""The coffee shop's workload on the library and on the bare driver, call for call.

One iteration of `examples/coffee_shop.py` is recorded, and then replayed by turns through the
library and through `bare.py`, each on a store of its own. After that both stores must hold the
very same history, else the comparison would be worth nothing.
"""

from __future__ import annotations

import argparse
import gc
import sqlite3
import sys
import tempfile
import time
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from sqlalchemy import make_url

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import kant_sql
from kant_sql import KnowledgeBase
from tests.benchmarks.bare import Bare
from tests.benchmarks.comparing import compare_histories, compare_results, compare_tables
from tests.benchmarks.drivers import Driver, PsycopgDriver, SqliteDriver
from tests.benchmarks.recording import KNOWLEDGE_BASE, Call, Step, record
from tests.benchmarks.support import print_table
from tests.support.parts import dao_of
from tests.support.servers import Server

# The last does not wait for the disk at each commit, which hides all else.
BACKENDS = ("sqlite-file", "sqlite-memory", "postgresql", "postgresql-async")
ROUNDS = 15
ALL = "all"
KINDS = {"types": "type", "objects": "object", "predicates": "predicate", "actions": "action"}

Ready = list[tuple[str, Callable[[], Any]]]


class Stores(NamedTuple):
    """Two empty stores of one kind."""

    connect: Callable[..., KnowledgeBase]  # opens the library's store for a component
    drive: Callable[[], Driver]  # opens the bare driver's store
    shared: bool  # whether all components have to share one connection
    urls: tuple[str, ...]  # the URLs of both stores; none when they are in memory


class Round(NamedTuple):
    """What one replay took, in seconds, and what its calls gave."""

    total: float
    by_kind: dict[str, float]
    results: list[Any]


class Measured(NamedTuple):
    """Medians over all rounds, in seconds: in all, and of each kind of call."""

    steps: dict[str, int]  # how many steps of each kind there are in an iteration
    calls: int  # how many calls there are in all steps; a transaction is one step of some calls
    bare: dict[str, float]  # the bare driver's times
    library: dict[str, float]  # the library's times


# Making the steps ready to run, so that looking methods up is not measured.


def library_steps(steps: list[Step], kbs: dict[str, KnowledgeBase]) -> Ready:
    """Bind recorded steps to the library's DAOs."""

    def bind(kb: KnowledgeBase, call: Call) -> Callable[[], Any]:
        return partial(getattr(dao_of(kb, call.dao), call.method), *call.arguments)

    def transaction(kb: KnowledgeBase, step: Step) -> Callable[[], Any]:
        calls = [bind(kb, call) for call in step.calls]

        def run() -> None:
            with kb.transaction(reason=step.reason):
                for call in calls:
                    call()

        return run

    return [
        (step.kind, (transaction(kb, step) if step.in_transaction else bind(kb, step.calls[0])))
        for step in steps
        for kb in (kbs[step.actor],)
    ]


def bare_steps(steps: list[Step], bares: dict[str, Bare]) -> Ready:
    """Bind recorded steps to the bare driver's functions."""

    def change(bare: Bare, call: Call) -> tuple[Callable[..., None], tuple[Any, ...]]:
        is_atom = call.dao in ("propositions", "goals")
        if call.method != "delete_all":
            kind = "proposition" if is_atom else call.dao.removesuffix("s")
            return getattr(bare, f"{call.method}_{kind}"), call.arguments
        if is_atom:
            return bare.delete_all_atoms, (call.dao == "goals",)
        return bare.delete_all, (KINDS[call.dao],)

    def bind(bare: Bare, step: Step) -> Callable[[], Any]:
        call = step.calls[0]
        if call.method.startswith("get"):
            kind = (KINDS[call.dao],) if call.dao in KINDS else ()
            return partial(getattr(bare, call.method), *kind, *call.arguments)
        return partial(bare.write, step.reason, [change(bare, call) for call in step.calls])

    return [(step.kind, bind(bares[step.actor], step)) for step in steps]


def play(ready: Ready) -> Round:
    """Run steps one after the other."""
    by_kind: defaultdict[str, float] = defaultdict(float)
    results = []
    gc.collect()  # or one side would sweep up behind the other
    begin = time.perf_counter()
    for kind, step in ready:
        start = time.perf_counter()
        results.append(step())
        by_kind[kind] += time.perf_counter() - start
    return Round(time.perf_counter() - begin, by_kind, results)


# The stores.


@contextmanager
def open_stores(backend: str, folder: Path) -> Iterator[Stores]:
    if not backend.startswith("postgresql"):
        yield sqlite_stores(backend, folder)
        return
    server = Server(folder / "pg")
    try:
        yield postgresql_stores(server, wait=backend == "postgresql")
    finally:
        server._server.cleanup()


def postgresql_stores(server: Server, wait: bool) -> Stores:
    options = {} if wait else {"options": "-csynchronous_commit=off"}
    urls = []
    for _ in ("library", "bare"):
        new = make_url(server.new_database()).update_query_dict(options)
        urls.append(new.render_as_string(hide_password=False))
        kant_sql.upgrade(urls[-1])
    connect = partial(kant_sql.connect, urls[0], knowledge_base=KNOWLEDGE_BASE)
    return Stores(connect, partial(PsycopgDriver, urls[1]), False, tuple(urls))


def sqlite_stores(backend: str, folder: Path) -> Stores:
    """Make two files, or two stores in memory."""
    files = [folder / f"{backend}-{side}.db" for side in ("library", "bare")]
    urls = tuple(f"sqlite:///{file}" for file in files)
    for url in urls:
        kant_sql.upgrade(url)
    if backend == "sqlite-file":
        connect = partial(kant_sql.connect, urls[0], knowledge_base=KNOWLEDGE_BASE)
        return Stores(connect, partial(SqliteDriver.open, files[1]), False, urls)
    memory = sqlite3.connect(":memory:")
    with closing(sqlite3.connect(files[1])) as tables:
        tables.backup(memory)
    connect = partial(kant_sql.connect, "sqlite://", knowledge_base=KNOWLEDGE_BASE)
    return Stores(connect, lambda: SqliteDriver(memory), True, ())


# Measuring.


def measure(stores: Stores, rounds: int, folder: Path) -> Measured:
    """Replay one iteration on both stores, several times, and compare what was stored."""
    filling, iteration = record(folder)
    if stores.shared:
        filling, iteration = (
            [step._replace(actor="robot") for step in steps] for steps in (filling, iteration)
        )
    actors = {step.actor for step in filling + iteration}
    kbs = {actor: stores.connect(actor=actor) for actor in actors}
    bares = {actor: Bare(stores.drive(), KNOWLEDGE_BASE, actor) for actor in actors}
    next(iter(bares.values())).create()
    ready = library_steps(iteration, kbs), bare_steps(iteration, bares)
    # The first iteration meets new names and cold caches on both sides.
    for first in (library_steps(filling, kbs), ready[0], bare_steps(filling, bares), ready[1]):
        play(first)
    played: tuple[list[Round], list[Round]] = ([], [])
    for number in range(rounds):
        for side in (0, 1) if number % 2 else (1, 0):
            played[side].append(play(ready[side]))
        compare_results(played[0][-1].results, played[1][-1].results)
    compare_stores(stores, next(iter(kbs.values())), folder)
    for kb in kbs.values():
        kb.close()
    for bare in bares.values():
        bare.close()
    return summary(iteration, *played)


def summary(steps: list[Step], library: list[Round], bare: list[Round]) -> Measured:
    def medians(rounds: list[Round]) -> dict[str, float]:
        times = {kind: median(one.by_kind[kind] for one in rounds) for kind in rounds[0].by_kind}
        return {**times, ALL: median(one.total for one in rounds)}

    counts = Counter([*(step.kind for step in steps), *(ALL for _ in steps)])
    return Measured(counts, sum(len(step.calls) for step in steps), medians(bare), medians(library))


def compare_stores(stores: Stores, kb: KnowledgeBase, folder: Path) -> None:
    if stores.urls:
        compare_tables(*stores.urls)
        copy = stores.urls[1]
    else:
        file = folder / "copy.db"
        driver = stores.drive()
        assert isinstance(driver, SqliteDriver)
        with closing(sqlite3.connect(file)) as connection:
            driver.connection.backup(connection)
        copy = f"sqlite:///{file}"
    with closing(kant_sql.connect(copy, knowledge_base=KNOWLEDGE_BASE)) as bare:
        compare_histories(kb, bare)


# Reporting.


def report(measured: dict[str, Measured]) -> None:
    """Show what an iteration takes on each backend, and what each kind of step does."""
    rows = []
    for backend, one in measured.items():
        bare, library = one.bare[ALL], one.library[ALL]
        times = (f"{1e3 * bare:.1f}", f"{1e3 * library:.1f}", f"{library / bare:.2f}")
        rows.append([backend, str(one.steps[ALL]), str(one.calls), *times])
    header = ["", "steps", "calls", "bare ms", "kant_sql ms", "ratio"]
    print_table("One iteration of the coffee shop, median", header, rows)
    first = next(iter(measured.values()))
    lines = []
    for kind, number in sorted(first.steps.items()):
        lines.append([kind, str(number)])
        for one in measured.values():
            bare, library = (1e6 * side[kind] / number for side in (one.bare, one.library))
            lines[-1].append(f"{bare:.0f} {library:6.0f} {library / bare:6.2f}")
    title = "A step of each kind: bare us, kant_sql us, ratio"
    print_table(title, ["", "steps", *measured], lines)
    print("\nBoth sides hold the same rows, and every hash recomputes.")


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(description="The coffee shop against the bare driver.")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--backends", nargs="+", choices=BACKENDS, default=BACKENDS)
    options = parser.parse_args(argv)
    warnings.filterwarnings("ignore", message="XDG_RUNTIME_DIR is not set")
    measured = {}
    for backend in options.backends:
        with (
            tempfile.TemporaryDirectory(prefix="kantbench", ignore_cleanup_errors=True) as folder,
            open_stores(backend, Path(folder)) as stores,
        ):
            measured[backend] = measure(stores, options.rounds, Path(folder))
    report(measured)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
