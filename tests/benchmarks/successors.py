"""Successors of states in memory, beside unified-planning's simulator and pymimir's generator.

    python -m tests.benchmarks.successors [--pairs ipc2000 ...] [--successors 10000] [--seconds 5]

Each takes the competitions' pairs of up to 1,000 facts and values as `tests.meaning` writes them
for other tools (a durative action as its start), and goes through the states breadth first: it asks
each for its applicable steps, applies all of them, and remembers the states, repeated ones, too;
where no state is left, it begins again with the first one. A pair ends after so many successors, or
seconds: the simulator, which tries all groundings, gets no further. Loading, grounding before the
first state and the start of the process do not count. Times are of the processor. Each pair is
taken by one tool after the other, each in a process of its own; where a tool does not read a pair,
its columns are empty.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from math import exp, log
from pathlib import Path
from statistics import median
from typing import Any

import kant_sql
from kant_sql import NotApplicableError
from kant_sql.pddl import read_domain, read_problem
from tests.benchmarks.support import figures_of, print_table, read_options
from tests.meaning.child_successors import Mimir, UnifiedPlanning
from tests.meaning.successors import MIMIR, UNIFIED_PLANNING, plain
from tests.support.corpus import PAIRS, WITHOUT_CORPUS, Pair

OURS = "kant_sql"
TOOLS = (OURS, UNIFIED_PLANNING, MIMIR)
MOST_FACTS, QUEUED = 1000, 20_000


def ours(domain: str, problem: str) -> tuple[Any, Callable[[Any], Iterable[Any]]]:
    """Give the first state, and its successors, in memory."""
    with kant_sql.connect("sqlite://") as kb:
        with kb.transaction():
            kb.load_domain(domain)
            kb.load_problem(problem)
        first = kb.state()

    def successors(state: Any) -> Iterable[Any]:
        apply = state.apply
        for step in state.applicable_actions():
            try:
                yield apply(step)
            except NotApplicableError:
                continue

    return first, successors


def simulated(domain: str, problem: str) -> tuple[Any, Callable[[Any], Iterable[Any]]]:
    """Give the first state, and its successors, of unified-planning."""
    judge = UnifiedPlanning(domain, problem)
    simulator = judge._simulator

    def successors(state: Any) -> Iterable[Any]:
        for action, arguments in simulator.get_applicable_actions(state):
            yield simulator.apply(state, action, arguments)

    return judge.first, successors


def generated(domain: str, problem: str) -> tuple[Any, Callable[[Any], Iterable[Any]]]:
    """Give the first state, and its successors, of pymimir."""

    def successors(state: Any) -> Iterable[Any]:
        for action in state.generate_applicable_actions():
            yield action.apply(state)

    return Mimir(domain, problem).first, successors


MAKES = dict(zip(TOOLS, (ours, simulated, generated), strict=True))


def walk(tool: str, domain: str, problem: str, most: int, limit: float) -> tuple[int, float]:
    """Generate successors, breadth first; give how many, and the seconds."""
    first, successors = MAKES[tool](domain, problem)
    # What is grounded or compiled once is not measured.
    next(iter(successors(first)), None)
    queue, found, at = [first], 0, 0
    start, end = time.process_time(), time.perf_counter() + limit
    while found < most and time.perf_counter() < end:
        for after in successors(queue[at]):
            found += 1
            if len(queue) < QUEUED:
                queue.append(after)
            if found >= most or (found % 100 == 0 and time.perf_counter() >= end):
                break
        at += 1
        if at == len(queue):
            # No state is left whose successors were not generated: again from the first one.
            queue, at = [first], 0
    # The clock of the processor takes longer to read than a successor takes.
    return found, time.process_time() - start


def measured(pair: Pair, most: int, limit: float) -> list[float | None] | None:
    """Give the microseconds of a successor, by each tool; None for a pair that is too large."""
    problem = read_problem(pair.problem, domain=read_domain(pair.domain))
    if len(problem.facts) + len(problem.values) > MOST_FACTS:
        return None
    found: list[float | None] = []
    with tempfile.TemporaryDirectory() as folder:
        files = plain(pair, Path(folder)).files
        for tool in TOOLS:
            words = [tool, *files, str(most), str(limit)]
            try:
                number, took = figures_of("tests.benchmarks.successors", "child", *words)
                found.append(1e6 * took / number if number else None)
            except subprocess.CalledProcessError:
                found.append(None)
    return found


def summary(name: str, ratios: Sequence[float]) -> list[str]:
    """Write how many times as fast as another tool the states are."""
    mean = exp(sum(map(log, ratios)) / len(ratios))
    numbers = (min(ratios), median(ratios), mean, max(ratios))
    return [f"{name}, {len(ratios)} pairs", *(f"{number:.2f}x" for number in numbers)]


def main(argv: Sequence[str] | None = None) -> int:
    if argv is None and sys.argv[1:2] == ["child"]:
        tool, domain, problem, most, limit = sys.argv[2:]
        print(*walk(tool, domain, problem, int(most), float(limit)))
        return 0
    options = read_options(__doc__, argv, pairs=[""], successors=10_000, seconds=5.0)
    title = "successors of states from sqlite://, microseconds each"
    chosen = [pair for pair in PAIRS if pair.name.startswith(tuple(options.pairs))]
    if not chosen:
        print(f"{title}: {WITHOUT_CORPUS}")
        return 0
    rows, ratios = [], {tool: list[float]() for tool in TOOLS[1:]}
    for pair in chosen:
        found = measured(pair, options.successors, options.seconds)
        if found is None or found[0] is None:
            continue
        own = found[0]
        row = [pair.name, f"{own:.2f}"]
        for tool, theirs in zip(TOOLS[1:], found[1:], strict=True):
            row += ["", ""] if theirs is None else [f"{theirs:.2f}", f"{theirs / own:.2f}x"]
            if theirs is not None:
                ratios[tool].append(theirs / own)
        rows.append(row)
        print(*row, flush=True)
    header = ["pair", *(f"{tool}{more}" for tool in TOOLS for more in ("", " ratio"))]
    print_table(title, [name for name in header if name != f"{OURS} ratio"], rows)
    lines = [summary(tool, found) for tool, found in ratios.items() if found]
    print_table("how many times as fast", ["", "least", "median", "mean", "most"], lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
