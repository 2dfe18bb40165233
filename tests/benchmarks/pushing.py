"""What a push costs: next to the bare driver that copies the same rows, and for a server.

    python -m tests.benchmarks.pushing [--changes 1000000] [--seconds 60] [--backend sqlite]

The bare driver reads every row of the knowledge base and inserts it into the other store in one
transaction, in the fastest way that it has, then reads the changes back and hashes them. The peak
of memory is that of a process which does nothing but push: it must not grow with the history, nor
with a single revision of 100,000 changes. The last table is of a robot that makes ten changes in a
second and is followed by `kant-sql push --follow`: what all processes of the server need meanwhile.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from functools import partial
from itertools import cycle
from pathlib import Path

import psutil
from sqlalchemy import make_url

import kant_sql
from kant_sql.sql.tables import Base
from tests.benchmarks import support
from tests.benchmarks.drivers import bare
from tests.benchmarks.verifying import NAME, read, seal
from tests.benchmarks.years import fill
from tests.support.processes.commands import PROGRAM, start
from tests.support.worlds.robots import RB1, robot_at, waypoint

CHANGES, ONE_REVISION, SECONDS = 1_000_000, 100_000, 60
PACE = 0.1
# In the order in which rows may be inserted.
TABLES = [table for table in Base.metadata.sorted_tables if table.name != "verification"]


def copy(source: str, target: str) -> None:
    """Copy all rows with the bare drivers, and hash what arrived."""
    with closing(bare(source)) as here, closing(bare(target)) as there:
        there.execute("BEGIN")
        for table in TABLES:
            columns = ", ".join(_column(column.name, source) for column in table.columns)
            rows = here.execute(f"SELECT {columns} FROM {table.name}")
            there.insert(table.name, len(table.columns), rows)
        there.execute("COMMIT")
    read(target)


def _column(name: str, url: str) -> str:
    # As text: the driver would parse the document.
    return f"CAST({name} AS text)" if name == "source" and "postgresql" in url else f'"{name}"'


def push(source: str, target: str, name: str = NAME) -> None:
    with kant_sql.connect(source, knowledge_base=name, read_only=True) as kb:
        sent = kb.store.push(target)
    assert sent.revision == sent.source_revision > 0


def peak(source: str, target: str, name: str = NAME) -> str:
    """Give the memory that a process has needed at most to push."""
    [peak] = support.figures_of("tests.benchmarks.pushing", "--push", source, target, name)
    return f"{peak:.0f} MB"


def measure(name: str, new: support.NewStore, count: int, repeat: int) -> tuple[str, ...]:
    """Fill a store, and measure one line of the table."""
    source = new()
    fill(source, count, knowledge_bases=1)
    seal(source)
    copied, pushed = [], []
    for _ in range(repeat):
        copied.append(support.seconds(partial(copy, source, new())))
        pushed.append(support.seconds(partial(push, source, new())))
    return (
        f"{name}, {count:,} changes",
        f"{min(copied):.1f} s",
        f"{min(pushed):.1f} s",
        f"{count / min(pushed):,.0f}",
        f"{min(pushed) / min(copied):.2f}",
        peak(source, new()),
    )


def measure_one(name: str, new: support.NewStore, count: int) -> tuple[str, ...]:
    """Measure the push of one revision."""
    source, target = new(), new()
    with kant_sql.connect(source, knowledge_base="large") as kb:
        kb.propositions.save_all(robot_at(RB1, waypoint(number)) for number in range(count))
    took = support.seconds(lambda: push(source, target, "large"))
    memory = peak(source, new(), "large")
    what = f"{name}, {count:,} changes in one revision"
    return what, "", f"{took:.1f} s", f"{count / took:,.0f}", "", memory


def measure_robot(source: str, target: str, duration: float) -> tuple[str, ...]:
    """Let a robot make ten changes in a second, and measure the server's processes."""
    fact, made = robot_at(), 0
    with kant_sql.connect(source, knowledge_base="robot", actor="robot") as kb:
        kb.propositions.save(fact)
        kb.store.push(target)
        words = "push", source, target, "--follow"
        following = start(*words, program=PROGRAM, stdout=subprocess.DEVNULL)
        try:
            time.sleep(5)
            before, began = _used(target), time.monotonic()
            due = began
            for change in cycle((kb.propositions.delete, kb.propositions.save)):
                change(fact)
                made, due = made + 1, due + PACE
                if due > began + duration:
                    break
                time.sleep(max(0.0, due - time.monotonic()))
            time.sleep(2)
            used, took = _used(target) - before, time.monotonic() - began
            own = psutil.Process(following.pid).cpu_times()
        finally:
            following.terminate()
            following.wait(30)
        with kant_sql.connect(target, knowledge_base="robot") as replica:
            assert replica.revision == kb.revision
    return (
        f"{made / duration:.1f} changes/s, each a revision",
        f"{100 * used / took:.2f} %",
        f"{1e3 * used / made:.2f} ms",
        f"{own.user + own.system:.1f} s",
    )


def _used(url: str) -> float:
    """Give the seconds of CPU that all processes of a server have used."""
    folder = Path(str(make_url(url).query["host"]))
    postmaster = psutil.Process(int((folder / "postmaster.pid").read_text().split()[0]))
    times = [each.cpu_times() for each in (postmaster, *postmaster.children(recursive=True))]
    return float(sum(one.user + one.system for one in times))


def main(argv: Sequence[str] | None = None) -> int:
    words = sys.argv[1:] if argv is None else argv
    if [*words[:1]] == ["--push"]:
        push(*words[1:])
        print(support.status("VmHWM"))
        return 0
    given = support.read_options(
        __doc__, words, changes=CHANGES, one=ONE_REVISION, repeat=1, seconds=SECONDS
    )
    names = given.backend
    with support.stores(names) as made:
        rows = [
            row
            for name, new in made.items()
            for row in (
                *(
                    measure(name, new, count, given.repeat)
                    for count in (given.changes // 10, given.changes)
                ),
                measure_one(name, new, given.one),
            )
        ]
        header = ("pushed", "bare driver", "push", "changes/s", "ratio", "peak memory")
        support.print_table("A push into a store of the same dialect", header, rows)
        if "postgresql" in made:
            with support.stores(["sqlite"]) as own:
                robot = measure_robot(own["sqlite"](), made["postgresql"](), given.seconds)
            titles = ("a robot", "of a core, server", "a change", "the pusher's CPU")
            support.print_table("A followed robot", titles, [robot])
    return 0


if __name__ == "__main__":
    sys.exit(main())
