"""A process in which another parser reads PDDL: it may crash there, or never come back.

    python tests/benchmarks/other_parsers.py NAME

It answers `ready` or `not installed`, and then each line of JSON with the paths of a domain and a
problem by a line of JSON: the seconds it took, or null when the parser refuses the pair. It imports
nothing of the project, so that the parsers may be installed somewhere else.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
import warnings
from collections.abc import Callable
from importlib import import_module

Read = Callable[[str, str], object]


def unified_planning() -> Read:
    """Take the parser of unified-planning."""
    reader = import_module("unified_planning.io").PDDLReader
    return lambda domain, problem: reader().parse_problem(domain, problem)


def ai_planning_pddl() -> Read:
    """Take the package pddl of AI-Planning."""
    pddl = import_module("pddl")
    return lambda domain, problem: (pddl.parse_domain(domain), pddl.parse_problem(problem))


def fast_downward() -> Read:
    """Take the parser of Fast Downward's translator."""
    translator = import_module("fast_downward.translate.pddl_parser.pddl_file")
    read: Read = translator.open
    return read


def loki() -> Read:
    """Take loki, a parser in C++, as the planner mimir has it, which goes on to translate."""
    formalism = import_module("pymimir.advanced.formalism")

    def read(domain: str, problem: str) -> object:
        options = formalism.ParserOptions()
        return formalism.Parser(domain, options).parse_problem(problem, options)

    return read


def tarski() -> Read:
    """Take tarski."""
    tarski_io = import_module("tarski.io")

    def read(domain: str, problem: str) -> object:
        reader = tarski_io.PDDLReader(raise_on_error=True)
        reader.parse_domain(domain)
        return reader.parse_instance(problem)

    return read


PARSERS: dict[str, Callable[[], Read]] = {
    "unified-planning": unified_planning,
    "AI-Planning/pddl": ai_planning_pddl,
    "tarski": tarski,
    "Fast Downward": fast_downward,
    "loki, in mimir": loki,
}


def main() -> None:
    """Read what is asked for."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    # Whatever the parser prints is not an answer.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    warnings.simplefilter("ignore")
    sys.setrecursionlimit(10_000)
    try:
        read = PARSERS[sys.argv[1]]()
    except ImportError:
        print("not installed", file=answers)
        return
    print("ready", file=answers)
    for line in sys.stdin:
        gc.collect()
        start = time.perf_counter()
        taken: float | None = None
        try:
            read(*json.loads(line))
            taken = time.perf_counter() - start
        except (Exception, SystemExit):
            taken = None
        print(json.dumps(taken), file=answers)


if __name__ == "__main__":
    main()
