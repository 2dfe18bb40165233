"""What becomes of problems, by kind of requirements and engine: the table of docs/planners.md.

    python -m tests.benchmarks.engines LIST [--engines ENGINE ...] [--seconds 20] [--megabytes 8192]

LIST is a text file: a line `# KIND`, then, for each problem of that kind, a line with the paths of
its domain and its problem, relative to the list, separated by a tab. Each pair is given to one
engine after the other; what each said goes to the standard error. Solved is what `kb.validate`
accepts.
"""

from __future__ import annotations

import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import kant_sql
from kant_sql import NoPlanError
from kant_sql.errors import PlannerMissingError, UnsupportedConstructError
from tests.benchmarks.support import read_options

AUTOMATIC = "automatic"
ENGINES = [
    *(AUTOMATIC, "fast-downward", "pyperplan", "enhsp", "aries"),
    "gbf: pyperplan -s gbf -H hff {domain} {problem}",
]
SOLVED, UNJUDGED, REFUSED, NO_PLAN, TIMEOUT, FAILED = (
    *("solved", "not judged", "refused", "no plan", "timed out", "failed"),
)
COLUMNS = {
    "unsupported_problem": REFUSED,
    "timeout": TIMEOUT,
    "unsolvable_proven": NO_PLAN,
    "unsolvable_incompletely": NO_PLAN,
}


class Outcome(NamedTuple):
    """What became of one run: a column of the table, and why, as a class and in full."""

    column: str
    reason: str = ""
    said: str = ""


def pairs(path: Path) -> Iterator[tuple[str, Path, Path]]:
    """Give the kind, the domain and the problem of each line of a list."""
    kind = ""
    for line in filter(None, map(str.strip, path.read_text("utf-8").splitlines())):
        if line.startswith("#"):
            kind = line.removeprefix("#").strip()
            continue
        domain, problem = line.split("\t")
        yield kind, path.parent / domain, path.parent / problem


def outcome(kb: kant_sql.KnowledgeBase, engine: str, seconds: float, megabytes: int) -> Outcome:
    """Ask an engine for a plan, and judge it."""
    name = None if engine == AUTOMATIC else engine
    try:
        plan = kb.plan(name, timeout=seconds, memory=megabytes)
    except (UnsupportedConstructError, PlannerMissingError) as error:
        return Outcome(REFUSED, reason(str(error)), str(error))
    except NoPlanError as error:
        column = COLUMNS.get(error.status, FAILED)
        why = reason(str(error)) if column == REFUSED else error.status
        return Outcome(column, why, str(error))
    said = f"{plan.engine}: {len(plan.steps)} steps, ignored {plan.ignored}"
    try:
        judged = kb.validate(plan)
    except UnsupportedConstructError as error:
        return Outcome(UNJUDGED, "", f"{said}, {error}")
    return Outcome(SOLVED if judged.valid else FAILED, "", f"{said}, {judged}")


def reason(said: str) -> str:
    """Give the class of a refusal: the features that are missing, or the sentence without names."""
    if found := re.findall(r"does not know ([^;]*)", said):
        return ", ".join(dict.fromkeys(", ".join(found).split(", ")))
    return said.rsplit(": ", maxsplit=1)[-1].split(";", maxsplit=1)[0]


def main(argv: Sequence[str] | None = None) -> int:
    words = [*(sys.argv[1:] if argv is None else argv)]
    listed = Path(words.pop(0))
    options = read_options(__doc__, words, engines=ENGINES, seconds=20.0, megabytes=8192)
    found: defaultdict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
    reasons: Counter[tuple[str, str, str]] = Counter()
    names = {engine: engine.partition(": ")[0] for engine in options.engines}
    for kind, domain, problem in pairs(listed):
        with kant_sql.connect("sqlite://") as kb:
            kb.load_domain(domain)
            kb.load_problem(problem)
            for engine, name in names.items():
                one = outcome(kb, engine, options.seconds, options.megabytes)
                found[kind][name, one.column] += 1
                reasons[name, one.column, one.reason] += bool(one.reason)
                print(kind, problem, name, *one, sep="\t", file=sys.stderr, flush=True)
    found["all"] = sum(found.values(), Counter())
    print(f"| problems | {' | '.join(names.values())} |\n|{' --- |' * (len(names) + 1)}")
    for kind, counts in found.items():
        print(f"| {kind} | {' | '.join(cell(counts, name) for name in names.values())} |")
    print("\n| engine | what | why | problems |\n| --- | --- | --- | --- |")
    for (name, column, why), count in sorted((+reasons).items()):
        print(f"| {name} | {column} | {why} | {count} |")
    return 0


def cell(counts: Counter[tuple[str, str]], name: str) -> str:
    """Give a cell: how many were solved, then how many of the others were what."""
    columns = (SOLVED, UNJUDGED, REFUSED, NO_PLAN, TIMEOUT, FAILED)
    return ", ".join(f"{counts[name, one]} {one}" for one in columns if counts[name, one])


if __name__ == "__main__":
    raise SystemExit(main())
