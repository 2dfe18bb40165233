"""How long `import kant_sql` takes, beside importing SQLAlchemy with its ORM.

    python -m tests.benchmarks.importing [--repeat 15]

Each import is made by a new process, which takes its own time, and they take turns; the table has
medians. What needs SQLAlchemy is imported when it is first asked for, so the last two lines tell
what a program pays in the end. Aim: `import kant_sql` at most 1.5 times SQLAlchemy.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from statistics import median

from tests.benchmarks.support import print_table

REPEAT = 15
FLOOR = "import sqlalchemy, sqlalchemy.orm"
PROGRAMS = (
    FLOOR,
    "import kant_sql",
    "import kant_sql.cli.main",
    "from kant_sql import connect",
    "import kant_sql; kant_sql.connect('sqlite://').close()",
)
TIMED = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"


def seconds(program: str) -> float:
    """Time a program in a process of its own, without the start of Python."""
    command = [sys.executable, "-c", TIMED.format(program)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--repeat", type=int, default=REPEAT)
    options = parser.parse_args(argv)
    taken: dict[str, list[float]] = {program: [] for program in PROGRAMS}
    for _ in range(options.repeat):
        for program, times in taken.items():
            times.append(seconds(program))
    floor = median(taken[FLOOR])
    rows = [
        [program, f"{1e3 * median(times):.0f} ms", f"{median(times) / floor:.2f}"]
        for program, times in taken.items()
    ]
    print_table("Imports, each in a new process", ["", "time", "ratio"], rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
