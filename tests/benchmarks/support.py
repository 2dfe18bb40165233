"""What the benchmarks share: stores to measure on, the bare drivers, and how to compare."""

from __future__ import annotations

import argparse
import gc
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import kant_sql
from tests.support.servers import Server

ROOT = Path(__file__).resolve().parents[2]
BACKENDS = ("sqlite", "postgresql")
NewStore = Callable[[], str]
_numbers = count(1)


@contextmanager
def stores(names: Sequence[str] | None) -> Iterator[dict[str, NewStore]]:
    """Give, for each backend, what makes an empty store with its tables and gives its URL."""
    names = names or BACKENDS
    folder = Path(tempfile.mkdtemp(prefix="kantbench"))
    server = Server(folder / "pg") if "postgresql" in names else None

    def sqlite() -> str:
        url = f"sqlite:///{folder / f'store{next(_numbers)}.db'}"
        kant_sql.connect(url).close()
        return url

    def postgresql() -> str:
        assert server is not None
        url = server.new_database()
        kant_sql.upgrade(url)
        return url

    try:
        yield {name: {"sqlite": sqlite, "postgresql": postgresql}[name] for name in names}
    finally:
        if server is not None:
            server._server.cleanup()
        shutil.rmtree(folder, ignore_errors=True)


def read_options(doc: str | None, argv: Sequence[str] | None, **known: Any) -> argparse.Namespace:
    """Read the options of a benchmark, each with its default: a flag, a list or a value."""
    parser = argparse.ArgumentParser(description=(doc or "").split("\n")[0])
    for name, default in known.items():
        if default is False:
            parser.add_argument(f"--{name}", action="store_true")
        elif isinstance(default, list):
            parser.add_argument(f"--{name}", type=type(default[0]), nargs="+", default=default)
        else:
            parser.add_argument(f"--{name}", type=type(default), default=default)
    parser.add_argument("--backend", choices=BACKENDS, action="append")
    return parser.parse_args(argv)


def figures_of(module: str, *words: str) -> list[float]:
    """Give the figures that a benchmark prints in a process of its own, such as its memory."""
    command = [sys.executable, "-m", module, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    return [*map(float, done.stdout.split())]


def status(field: str) -> float:
    """Read a field of this process's memory, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{field}:"))


def seconds(call: Callable[[], Any]) -> float:
    """Tell how long a call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def alternate(
    repeat: int, *makes: Callable[[int], Callable[[], Any]], clean: bool = False
) -> list[list[float]]:
    """Time calls in turn, each round another one first, and give the times of each, sorted.

    What disturbs one disturbs all: other programs, and the garbage that they leave to each other.

    Args:
        repeat: how often each is called.
        *makes: gives the call of a round, set up and ready.
        clean: whether to collect garbage before each call.
    """
    times: list[list[float]] = [[] for _ in makes]
    for number in range(repeat):
        for turn in range(len(makes)):
            side = (number + turn) % len(makes)
            call = makes[side](number)
            if clean:
                gc.collect()
            times[side].append(seconds(call))
    return [sorted(taken) for taken in times]


def print_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table in aligned columns, the first to the left; short rows end early."""
    lines = [list(header), *([*row] + [""] * (len(header) - len(row)) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    print(f"\n{title}")
    for line in lines:
        cells = [
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]
        print("  " + "  ".join(cells).rstrip())
