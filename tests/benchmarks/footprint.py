"""How much memory reading, loading and writing a problem take: it grows with the facts, linearly.

    python -m tests.benchmarks.footprint [--backend sqlite]

Each number is of a process of its own: how far the peak of its memory is above what it had with the
text in hand (for writing: with the store open). Per fact is what each further fact adds, between
the smallest and the largest problem.
"""

from __future__ import annotations

import argparse
import gc
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import kant_sql
from kant_sql.pddl import read_domain, read_problem
from tests.benchmarks import generated
from tests.benchmarks.bulk import status
from tests.benchmarks.support import NewStore, print_table, stores

ROOT = Path(__file__).resolve().parents[2]
NUMBERS = (50_000, 100_000, 200_000)


def prepare_reading(_: str, path: Path) -> Callable[[], object]:
    """Prepare to read a problem, which is kept."""
    domain, text = read_domain(generated.DOMAIN), path.read_text()
    return lambda: read_problem(text, domain=domain)


def prepare_loading(url: str, path: Path) -> Callable[[], object]:
    """Prepare to load a problem into a store."""
    kb = kant_sql.connect(url)
    kb.load_domain(generated.DOMAIN)
    text = path.read_text()
    return lambda: kb.load_problem(text)


def prepare_writing(url: str, _: Path) -> Callable[[], object]:
    """Prepare to write the problem of a store."""
    kb = kant_sql.connect(url)
    kb.domain_pddl()
    return kb.problem_pddl


STEPS = {"reading": prepare_reading, "loading": prepare_loading, "writing": prepare_writing}


def measure_here(step: str, url: str, path: Path) -> None:
    """Take a step in this process, and print by how many kB its memory grew."""
    call = STEPS[step](url, path)
    gc.collect()
    before = status("VmRSS")
    result = call()
    print(json.dumps(status("VmHWM") - before))
    del result


def measure(step: str, url: str, path: Path) -> int:
    """Take a step in a process of its own, and give its kB."""
    command = [sys.executable, "-m", "tests.benchmarks.footprint", "--step", step]
    run = subprocess.run(
        [*command, "--url", url, "--path", str(path)],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    return int(json.loads(run.stdout))


def line(step: str, name: str, urls: Sequence[str], paths: Sequence[Path]) -> list[str]:
    """Give a line of the table."""
    found = [measure(step, url, path) for url, path in zip(urls, paths, strict=True)]
    each = 1024 * (found[-1] - found[0]) / (NUMBERS[-1] - NUMBERS[0])
    return [f"{step}{name}", *(f"{kb / 1024:.0f} MB" for kb in found), f"{each:.0f} B"]


def lines(name: str, new: NewStore, paths: Sequence[Path]) -> list[list[str]]:
    """Give the lines of a backend."""
    urls = [new() for _ in NUMBERS]
    return [line(step, f", {name}", urls, paths) for step in ("loading", "writing")]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--backend", choices=["sqlite", "postgresql"], action="append")
    parser.add_argument("--step", choices=STEPS, help=argparse.SUPPRESS)
    parser.add_argument("--url", help=argparse.SUPPRESS)
    parser.add_argument("--path", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.step:
        measure_here(options.step, options.url, options.path)
        return 0
    with (
        tempfile.TemporaryDirectory(prefix="kantbench") as folder,
        stores(options.backend or ["sqlite", "postgresql"]) as places,
    ):
        paths = [Path(folder) / f"{facts}.pddl" for facts in NUMBERS]
        for path, facts in zip(paths, NUMBERS, strict=True):
            path.write_text(generated.problem(facts))
        rows = [line("reading", "", [""] * len(NUMBERS), paths)]
        for name, new in places.items():
            rows += lines(name, new, paths)
        print_table(
            "Memory that a step adds to a process",
            ["", *(f"{facts:,} facts" for facts in NUMBERS), "per fact"],
            rows,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
