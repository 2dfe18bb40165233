"""Measures the project: how much there is to read, to follow and to wait for, as one table.

python tests/measure.py [--root FOLDER] [--suite]

`--root` measures another checkout by this script and with this interpreter, so that before and
after can be compared. It reads sizes from the source, and runs programs for the rest.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "kant_sql"
LONG_FUNCTION = 40
# A process is measured so many times, and the least counts: all else is the machine's.
RUNS = 7

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Source(NamedTuple):
    """One file of the source tree."""

    path: Path  # where it lies, below the root
    text: str

    @property
    def lines(self) -> int:
        return len(self.text.splitlines())


def read_sources(root: Path, folder: str) -> list[Source]:
    """Read all modules below a folder of the root."""
    paths = sorted((root / folder).rglob("*.py"))
    return [Source(path.relative_to(root), path.read_text(encoding="utf-8")) for path in paths]


# Lines


def span(node: ast.stmt | ast.expr) -> int:
    """Return how many lines a node has."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def long_functions(source: Source) -> Iterator[str]:
    """Yield length and place of each long function; its docstring does not count."""
    for node in ast.walk(ast.parse(source.text)):
        if isinstance(node, Function):
            text = node.body[0] if ast.get_docstring(node, clean=False) is not None else None
            length = span(node) - (0 if text is None else span(text))
            if length > LONG_FUNCTION:
                yield f"{length} lines: {source.path}:{node.lineno} {node.name}"


# Calls


class Way(NamedTuple):
    """What one call does within the package."""

    calls: int
    files: int
    switches: int

    def __str__(self) -> str:
        return ", ".join(map(str, self))


def follow(call: Callable[[], object], package: str) -> Way:
    """Count the calls within a package, the files that they cross and how often they change."""
    files: list[str] = []

    def seen(frame: Any, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(package):
            files.append(frame.f_code.co_filename)

    sys.setprofile(seen)
    try:
        call()
    finally:
        sys.setprofile(None)
    switches = sum(one != other for one, other in pairwise(files))
    return Way(len(files), len(set(files)), switches)


def probe(folder: str) -> None:
    """Print some lines of the table, of the package that this process imports."""
    import kant_sql as k

    package = os.path.dirname(os.path.abspath(str(k.__file__))) + os.sep
    robot, wp = k.PddlTypeDto("robot"), k.PddlTypeDto("wp")
    robot_at, rb1 = k.PddlPredicateDto("robot_at", [robot, wp]), k.PddlObjectDto(robot, "rb1")
    places = [k.PddlObjectDto(wp, f"wp{i}") for i in range(5)]
    facts = [k.PddlPropositionDto(robot_at, [rb1, place]) for place in places]
    with k.connect(f"sqlite:///{folder}/store.db", actor="perception") as kb:
        for fact in facts:
            kb.propositions.save(fact)
        kb.propositions.delete("(robot_at rb1 wp1)")
        save = follow(lambda: kb.propositions.save(facts[1]), package)
        list(kb.query("(robot_at ?r ?w)"))
        query = follow(lambda: list(kb.query("(robot_at ?r ?w)")), package)
        names, members = ([name for name in dir(of) if not name.startswith("_")] for of in (k, kb))
    print(f"warm save: calls, files, switches|{save}")
    print(f"query of known text: the same|{query}")
    print(f"public names, members of kb|{len(names)}, {len(members)}")


# Processes


def environment(root: Path) -> dict[str, str]:
    """Return the environment of programs that import a checkout, with compiled modules."""
    mine = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return mine | {"PYTHONPATH": str(root), "PYTHONWARNINGS": "ignore"}


def run(root: Path, *arguments: str) -> str:
    """Run Python in a checkout; return its output."""
    command = [sys.executable, *arguments]
    done = subprocess.run(
        command, cwd=root, env=environment(root), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"measure.py: {' '.join(command)} failed:\n{done.stderr}")
    return done.stdout


def processor_seconds(root: Path, *arguments: str) -> float:
    """Measure the processor time of a program; the first run compiles its modules."""
    taken = []
    for _ in range(RUNS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run(root, *arguments)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        taken.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(taken)


CONNECT = f"import {PACKAGE}; {PACKAGE}.connect('sqlite://')"
LOADED = f"{CONNECT}; import sys; print(sum(m.split('.')[0] == '{PACKAGE}' for m in sys.modules))"
LOG = f"from {PACKAGE}.cli.main import run; run()"


def run_rows(root: Path) -> Iterator[tuple[str, object]]:
    """Yield what programs in the checkout show."""
    with tempfile.TemporaryDirectory() as folder:
        for line in run(root, str(Path(__file__)), "--probe", folder).splitlines():
            name, _, value = line.partition("|")
            yield name, value
        yield "modules loaded by `connect`", run(root, "-c", LOADED).strip()
        floor = processor_seconds(root, "-c", "import sqlalchemy")
        yield "`import sqlalchemy`, CPU seconds", f"{floor:.2f}"
        connected = processor_seconds(root, "-c", CONNECT)
        yield '`connect("sqlite://")` in a new process, CPU seconds', f"{connected:.2f}"
        logged = processor_seconds(root, "-c", LOG, "log", f"sqlite:///{folder}/store.db")
        yield "`kant-sql log` of a small store, CPU seconds", f"{logged:.2f}"
    shop = run(root, "-m", "tests.benchmarks.coffee_shop", "--backends", "sqlite-file")
    ratio = re.search(r"^\|? *sqlite-file.*?([\d.]+) *\|?$", shop, re.MULTILINE)
    yield "coffee shop on a file, ratio to the bare driver", ratio[1] if ratio else "unknown"


def suite_rows(root: Path) -> Iterator[tuple[str, object]]:
    for target in ("test", "test-all"):
        began = time.monotonic()
        code = subprocess.run(["make", target], cwd=root, check=False).returncode
        minutes = f"{(time.monotonic() - began) / 60:.1f} min"
        yield f"`make {target}`", f"{minutes}, exit code {code}" if code else minutes


# The report


class Size(NamedTuple):
    """How much source there is."""

    lines: int
    files: int
    long_functions: list[str]
    test_lines: int


def measure(root: Path) -> Size:
    sources = read_sources(root, PACKAGE)
    if not sources:
        raise SystemExit(f"measure.py: no Python files in {root / PACKAGE}")
    return Size(
        lines=sum(source.lines for source in sources),
        files=len(sources),
        long_functions=[found for source in sources for found in long_functions(source)],
        test_lines=sum(source.lines for source in read_sources(root, "tests")),
    )


def source_rows(size: Size) -> Iterator[tuple[str, object]]:
    yield f"lines in {PACKAGE}/", f"{size.lines:,}"
    yield "files", size.files
    yield f"functions over {LONG_FUNCTION} lines", len(size.long_functions)
    yield "lines of tests", f"{size.test_lines:,}"


def main(argv: list[str]) -> int:
    """Print the measures of this or another checkout."""
    parser = argparse.ArgumentParser(prog="measure.py", description="Measure the project.")
    parser.add_argument(
        "--root", type=Path, default=ROOT, metavar="FOLDER", help="the checkout (this one)"
    )
    parser.add_argument("--suite", action="store_true", help="also time make test and test-all")
    parser.add_argument("--source", action="store_true", help="read the source only")
    parser.add_argument("--probe", metavar="FOLDER", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.probe is not None:
        probe(options.probe)
        return 0
    root = options.root.resolve()
    size = measure(root)
    parts = [source_rows(size)]
    if not options.source:
        parts.append(run_rows(root))
    if options.suite:
        parts.append(suite_rows(root))
    print("| measure | value |\n| --- | --- |")
    for name, value in (row for part in parts for row in part):
        print(f"| {name} | {value} |", flush=True)
    for line in size.long_functions:
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
