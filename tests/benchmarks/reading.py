"""How fast PDDL is read: beside the least that a parser in Python can do, and beside others.

    python -m tests.benchmarks.reading [--facts 200000] [--repeat 5] [--python PATH] [--limit 60]

The floor is a regular expression that splits the text, whose comments are gone already, and builds
nested lists: no names, no types, no positions, no checks. Aim: at most 3 times the floor, on the
corpus beside the checkout and on a generated problem. All take turns in one process. The library
pauses the cyclic garbage collector while it reads, so the floor is there twice: as Python runs it,
and with the collector paused as well.

The other parsers are optional: those that the interpreter `--python` has are asked, each in a
process of its own, pair by pair, for `--limit` seconds; what they refuse, crash on or do not finish
does not count. The library reads the same pairs in the same minute.
"""

from __future__ import annotations

import argparse
import gc
import random
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from kant_sql.pddl import read_domain, read_problem
from tests.benchmarks import generated
from tests.benchmarks.asking import Asked
from tests.benchmarks.other_parsers import PARSERS
from tests.benchmarks.support import alternate, print_table, seconds
from tests.support.corpus import CORPUS, PAIRS

COMMENT = re.compile(r";[^\n]*")
TOKEN = re.compile(r"[()]|[^\s()]+")
# The slowest of the others takes a minute for a megabyte.
FACTS_FOR_OTHERS = 10_000


class Pair(NamedTuple):
    """A domain and a problem: where they are, and their texts."""

    paths: tuple[str, str]
    texts: tuple[str, str]

    @property
    def size(self) -> float:
        """How large both are, in MB."""
        return sum(len(text.encode("utf-8", "surrogateescape")) for text in self.texts) / 1e6


def load(paths: Iterable[Path]) -> Pair:
    """Take the texts of a domain and a problem."""
    domain, problem = paths
    texts = (path.read_text("utf-8", "surrogateescape") for path in (domain, problem))
    return Pair((str(domain), str(problem)), (next(texts), next(texts)))


def corpus() -> list[Pair]:
    """Take the corpus; there is none in a checkout that stands alone."""
    return [load((pair.domain, pair.problem)) for pair in PAIRS]


def generate(folder: Path, facts: int) -> Pair:
    """Write a generated problem to files."""
    paths = folder / f"domain-{facts}.pddl", folder / f"problem-{facts}.pddl"
    for path, text in zip(paths, (generated.STRIPS_DOMAIN, generated.problem(facts)), strict=True):
        path.write_text(text)
    return load(paths)


def read(pair: Pair) -> None:
    """Read a pair with the library."""
    domain = read_domain(pair.texts[0])
    read_problem(pair.texts[1], domain=domain)


def nest(text: str) -> list[object]:
    """Split text and build nested lists: the floor."""
    stack: list[list[object]] = [[]]
    for token in TOKEN.findall(text):
        if token == "(":
            inner: list[object] = []
            stack[-1].append(inner)
            stack.append(inner)
        elif token == ")":
            stack.pop()
        else:
            stack[-1].append(token)
    return stack[0]


def beside_floor(title: str, pairs: Sequence[Pair], repeat: int) -> list[str]:
    """Give a line of the table of reading."""
    texts = [COMMENT.sub("", text) for pair in pairs for text in pair.texts]

    def library() -> None:
        for pair in pairs:
            read(pair)

    def floor() -> None:
        for text in texts:
            nest(text)

    def paused_floor() -> None:
        gc.disable()
        floor()
        gc.enable()

    sides: list[Callable[[], None]] = [library, floor, paused_floor]
    taken = alternate(repeat, *(lambda _, side=side: side for side in sides), clean=True)
    reading, least, paused = map(median, taken)
    size = sum(pair.size for pair in pairs)
    return [
        title,
        f"{size:.2f} MB",
        f"{reading:.3f} s",
        f"{size / reading:.1f} MB/s",
        *(cell for each in (least, paused) for cell in (f"{each:.3f} s", f"{reading / each:.2f}x")),
    ]


def beside_other(name: str, python: str, pairs: Sequence[Pair], limit: float) -> list[str]:
    """Give a line of the table of other parsers."""
    theirs = ours = size = 0.0
    tried = done = 0
    with Asked(python, name) as other:
        if not other.installed:
            return [name, "not installed"]
        left = limit
        for pair in pairs:
            if left <= 0:
                break
            answer = other.ask(pair.paths, left)
            left -= answer.waited
            # What the time was up for is no pair that it refused.
            tried += answer.seconds is not None or left > 0
            if answer.seconds is not None:
                done += 1
                theirs += answer.seconds
                ours += least_of_three(lambda pair=pair: read(pair))  # type: ignore[misc]
                size += pair.size
    if not done:
        return [name, f"0 of {tried}" if tried else f"not one in {limit:g} s"]
    return [
        name,
        f"{done} of {tried}",
        f"{size:.2f} MB",
        f"{theirs / size:.3f}",
        f"{ours / size:.3f}",
        f"{theirs / ours:.1f}x",
    ]


def least_of_three(call: Callable[[], object]) -> float:
    """Time a call: others have a file to themselves, too."""
    return min(seconds(call) for _ in range(3))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--facts", type=int, default=200_000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--python", default=sys.executable, help="what has the other parsers")
    parser.add_argument("--limit", type=float, default=60, help="seconds for each of them")
    options = parser.parse_args(argv)
    pairs = corpus()
    if not pairs:
        print(f"The corpus is skipped: there is none beside the checkout, at {CORPUS}")
    with tempfile.TemporaryDirectory(prefix="kantbench") as folder:
        large = generate(Path(folder), options.facts)
        cases = [(f"{options.facts:,} generated facts", [large])]
        if pairs:
            cases.insert(0, (f"corpus, {len(pairs)} pairs", pairs))
        print_table(
            "Reading PDDL, beside the floor: splitting it into nested lists",
            ["", "size", "kant_sql", "speed", "floor", "ratio", "floor, paused", "ratio"],
            [beside_floor(title, some, options.repeat) for title, some in cases],
        )
        # In an order of their own, so that what there is time for is of all sorts.
        random.Random(1).shuffle(pairs)
        small = generate(Path(folder), FACTS_FOR_OTHERS)
        for title, some in (("corpus", pairs), (f"{FACTS_FOR_OTHERS:,} generated facts", [small])):
            print_table(
                f"Other parsers, {title}: seconds per MB of what they can read",
                ["", "pairs read", "size", "theirs", "kant_sql", "ratio"],
                [beside_other(name, options.python, some, options.limit) for name in PARSERS],
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
