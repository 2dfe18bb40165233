"""How fast a long history becomes files, beside the bare driver that reads the same rows.

    python -m tests.benchmarks.exporting [--revisions 200000] [--repeat 3] [--backend sqlite]

The floor fetches the rows of the view, in the same order, in batches that it throws away: it has no
types, writes nothing, and is what any export has to wait for.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import psycopg

from kant_sql.export import FORMATS, export_store, open_reader
from kant_sql.sql.audit_views import AUDIT_VIEWS
from kant_sql_plugins.mcap import export_transitions
from tests.benchmarks.support import alternate, print_table, read_options, stores
from tests.support.worlds.long_history import NAME, write_long_history

BATCH = 5_000
VIEW = "audit_fact"

Read = Callable[[], int]


def floor(url: str) -> int:
    """Fetch all rows by the bare driver."""
    order = ", ".join(AUDIT_VIEWS[VIEW].order)
    sql = f"SELECT * FROM {VIEW} WHERE knowledge_base = '{NAME}' ORDER BY {order}"
    if url.startswith("sqlite"):
        with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as file:
            return drain(file.execute(sql))
    with psycopg.connect(url) as server, server.cursor(name="floor") as cursor:
        cursor.execute(sql.encode())
        return drain(cursor)


def drain(cursor: Any) -> int:
    """Fetch rows, and count them."""
    count = 0
    while rows := cursor.fetchmany(BATCH):
        count += len(rows)
    return count


def export(url: str, folder: Path, format: str) -> int:
    """Write files, and count their rows."""
    shutil.rmtree(folder, ignore_errors=True)
    if format == "mcap":
        done = export_transitions(url, to=folder)
    else:
        done = export_store(url, to=folder, format=format, views=[VIEW])
    return sum(file.rows for file in done.files)


def read_batches(url: str) -> int:
    """Read Arrow batches, and count their rows."""
    with open_reader(url, view=VIEW) as reader:
        return sum(batch.num_rows for batch in reader)


def compare(url: str, repeat: int, revisions: int) -> list[list[str]]:
    """Give a line for each way to read a store."""
    with tempfile.TemporaryDirectory(prefix="kantbench") as scratch:
        folder = Path(scratch) / "out"
        ways: dict[str, Read] = {
            "bare driver": partial(floor, url),
            "open_reader": partial(read_batches, url),
            **{name: partial(export, url, folder, name) for name in (*FORMATS, "mcap")},
        }
        for way, read in ways.items():
            expected = revisions if way == "mcap" else revisions - 1
            assert read() == expected, way
        times = alternate(repeat, *(partial(_same, read) for read in ways.values()))
    least = median(times[0])
    return [
        [
            way,
            f"{median(taken):.2f} s",
            f"{revisions / median(taken):,.0f}",
            f"{median(taken) / least:.1f}",
        ]
        for way, taken in zip(ways, times, strict=True)
    ]


def _same(read: Read, _: int) -> Read:
    return read


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    options = read_options(__doc__, argv, revisions=200_000, repeat=3)
    with stores(options.backend) as places:
        for name, new in places.items():
            url = new()
            write_long_history(url, options.revisions)
            print_table(
                f"{options.revisions:,} facts, {name}",
                ["", "time", "rows per second", "times the floor"],
                compare(url, options.repeat, options.revisions),
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
