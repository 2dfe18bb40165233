"""What many knowledge bases of a store take: to open, to list, and to verify them all.

    python -m tests.benchmarks.knowledge_bases [--robots N] [--revisions N] [--backend NAME]

Verifying in one thread is compared with two threads, two processes, and a run that continues where
nothing is new. CPU is that of this process alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import kant_sql
from kant_sql import KnowledgeStore
from kant_sql.cli.verifying import VerificationTask, run_tasks
from tests.benchmarks.support import print_table, read_options, seconds, stores
from tests.support.worlds.robots import RB1, robot_at, waypoint

ROBOTS, REVISIONS, JOBS = 200, 60, 2


def fill(url: str, robots: int, revisions: int) -> list[str]:
    """Give each robot some history; return their names."""
    names = [f"robot {number}" for number in range(robots)]
    with kant_sql.open_store(url) as store:
        for name in names:
            kb = store.knowledge_base(name, actor="robot")
            for number in range(revisions // 2):
                kb.propositions.save_all(robot_at(RB1, waypoint(each)) for each in range(10))
                with kb.transaction(reason=f"round {number}"):
                    kb.propositions.delete_all()
    return names


def _connect(url: str, names: Sequence[str]) -> None:
    for name in names:
        with kant_sql.connect(url, knowledge_base=name) as kb:
            assert kb.revision


def _open(url: str, names: Sequence[str]) -> None:
    with kant_sql.open_store(url) as store:
        for name in names:
            assert store.knowledge_base(name).revision


def _in_processes(url: str, names: Sequence[str]) -> None:
    tasks = [VerificationTask(name, None, False, False) for name in names]
    assert all(done.is_intact for done in run_tasks(url, tasks, JOBS))


def _each(store: KnowledgeStore, names: Sequence[str], **options: Any) -> Callable[[str], None]:
    def verify(name: str) -> None:
        assert (
            store.knowledge_base(name).store.verify(structure=False, keep=True, **options).is_intact
        )

    return verify


def measure(backend: str, url: str, robots: int, revisions: int) -> list[tuple[str, ...]]:
    """Measure on one store; each line has the time of a knowledge base, and a ratio."""
    names = fill(url, robots, revisions)
    connected = seconds(lambda: _connect(url, names))
    opened = seconds(lambda: _open(url, names))
    listed = seconds(lambda: kant_sql.operations.knowledge_bases(url))
    with kant_sql.open_store(url) as store:
        began, used = time.perf_counter(), time.process_time()
        for name in names:
            _each(store, names)(name)
        alone, cpu = time.perf_counter() - began, time.process_time() - used
        with ThreadPoolExecutor(JOBS) as pool:
            threads = seconds(lambda: list(pool.map(_each(store, names), names)))
        processes = seconds(lambda: _in_processes(url, names))
        used = time.process_time()
        continued = seconds(lambda: [*map(_each(store, names, resume=True), names)])
        cpu_continued = time.process_time() - used
    lines = [
        ("connect to each", connected, 1.0, None),
        ("open each in a store", opened, opened / connected, None),
        ("list all", listed, listed / connected, None),
        ("verify each", alone, 1.0, cpu),
        (f"in {JOBS} threads", threads, threads / alone, None),
        (f"in {JOBS} processes", processes, processes / alone, None),
        ("continued, nothing new", continued, continued / alone, cpu_continued),
    ]
    return [
        (
            f"{backend}: {what}",
            f"{took * 1e3 / robots:.2f} ms",
            f"{ratio:.3f}",
            "" if own is None else f"{own * 1e3 / robots:.2f} ms",
        )
        for what, took, ratio, own in lines
    ]


def main(argv: Sequence[str] | None = None) -> int:
    given = read_options(__doc__, argv, robots=ROBOTS, revisions=REVISIONS)
    rows: list[Sequence[str]] = []
    with stores(given.backend) as made:
        for backend, new in made.items():
            rows += measure(backend, new(), given.robots, given.revisions)
    header = ("of one knowledge base", "time", "ratio", "CPU")
    print_table(f"{given.robots} knowledge bases of {given.revisions} revisions", header, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
