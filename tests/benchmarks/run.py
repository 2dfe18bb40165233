"""Runs the benchmarks, or those of them that are named: one after the other, in this process.

python tests/benchmarks/run.py [NAME ...]
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

BENCHMARKS = (
    *("coffee_shop", "asof", "past", "verifying", "documents", "answering"),
    *("two_clocks", "timeline", "sizing", "pushing", "knowledge_bases", "adding", "causing", "ros"),
    "successors",
)


def main(argv: list[str]) -> int:
    """Run them."""
    unknown = [name for name in argv if name not in BENCHMARKS]
    if unknown:
        print(f"run.py: no benchmark {unknown[0]!r}; there are {', '.join(BENCHMARKS)}")
        return 2
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    results = []
    for name in argv or BENCHMARKS:
        module = f"tests.benchmarks.{name}"
        if importlib.util.find_spec(module) is not None:
            print(f"== {name}", flush=True)
            results.append(int(importlib.import_module(module).main([])))
    return max(results, default=0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
