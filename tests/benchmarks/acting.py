"""Steps: executing one, and finding all that can be executed.

    python -m tests.benchmarks.acting [--repeat 15] [--pairs 200] [--limit 20] [--backend sqlite]

`apply` is compared with a transaction that makes the same changes by DAO calls and checks nothing:
a step of facts alone, and one with numbers. Both sides do and undo the step in turn. Aim: at most
1.3 times the transaction.

`applicable_actions` is asked of the initial states of the competitions' pairs, on an SQLite file,
and compared with unified-planning's SequentialSimulator on the same problem, in a process that is
stopped after a limit; making the simulator, which grounds, is not counted. Aim: at least 1,000
times as fast as the simulator, where that ends. Beside it stands pymimir's compiled generator,
which holds the state in memory, where `--mimir` names an interpreter that has it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import queue
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import kant_sql
from tests.benchmarks.support import alternate, print_table, seconds, stores
from tests.support.corpus import PAIRS, Pair

DOMAIN = """
(define (domain errands) (:requirements :strips :typing :numeric-fluents)
  (:types robot place)
  (:predicates (robot_at ?r - robot ?p - place) (next_to ?p ?q - place) (visited ?p - place))
  (:functions (fuel ?r - robot) (distance ?p ?q - place) (driven))
  (:action move :parameters (?r - robot ?p ?q - place)
    :precondition (and (robot_at ?r ?p) (next_to ?p ?q))
    :effect (and (not (robot_at ?r ?p)) (robot_at ?r ?q) (visited ?q)))
  (:action drive :parameters (?r - robot ?p ?q - place)
    :precondition (and (robot_at ?r ?p) (next_to ?p ?q) (>= (fuel ?r) (distance ?p ?q)))
    :effect (and (not (robot_at ?r ?p)) (robot_at ?r ?q)
      (decrease (fuel ?r) (distance ?p ?q)) (increase (driven) (distance ?p ?q)))))
"""
PLACES = 200
MIMIR = """
import sys, time
import pymimir
problem = pymimir.Problem(pymimir.Domain(sys.argv[1]), sys.argv[2])
state = problem.get_initial_state()
times = []
for _ in range(5):
    start = time.perf_counter()
    found = state.generate_applicable_actions()
    times.append(time.perf_counter() - start)
print(min(times), len(found))
"""


def problem() -> str:
    """Write a ring of places."""
    places = [f"p{n}" for n in range(PLACES)]
    ring = [*zip(places, [*places[1:], places[0]], strict=True)]
    ways = [way for one, other in ring for way in ((one, other), (other, one))]
    facts = " ".join(
        f"(next_to {one} {other}) (= (distance {one} {other}) 1.5)" for one, other in ways
    )
    return (
        f"(define (problem p) (:domain errands) (:objects rb - robot {' '.join(places)} - place)"
        f" (:init (robot_at rb p0) (= (fuel rb) 1000000) (= (driven) 0) {facts}) (:goal (and)))"
    )


def dao_step(kb: kant_sql.KnowledgeBase, is_numeric: bool) -> Callable[[str, str], None]:
    """Return what makes the changes of a step by DAO calls."""
    robot, place = kant_sql.PddlTypeDto("robot"), kant_sql.PddlTypeDto("place")
    robot_at = kant_sql.PddlPredicateDto("robot_at", [robot, place])
    visited = kant_sql.PddlPredicateDto("visited", [place])
    rb = kant_sql.PddlObjectDto(robot, "rb")

    def work(one: str, other: str) -> None:
        here, there = (kant_sql.PddlObjectDto(place, name) for name in (one, other))
        with kb.transaction(reason=f"applied (move rb {one} {other})"):
            kb.propositions.delete(kant_sql.PddlPropositionDto(robot_at, [rb, here]))
            kb.propositions.save(kant_sql.PddlPropositionDto(robot_at, [rb, there]))
            if is_numeric:
                kb.function_values.decrease("fuel", objects=["rb"], by=1.5)
                kb.function_values.increase("driven", objects=[], by=1.5)
            else:
                kb.propositions.save(kant_sql.PddlPropositionDto(visited, [there]))

    return work


def steps(url: str, repeat: int) -> list[list[str]]:
    """Compare `apply` with a transaction."""
    rows = []
    with kant_sql.connect(url, knowledge_base="bench", actor="bench") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(problem())
        at = [0]
        for action, said in (("move", "facts"), ("drive", "facts and numbers")):
            by_dao = dao_step(kb, action == "drive")

            def run(work: Callable[[str, str], Any]) -> Callable[[], None]:
                def calls() -> None:
                    for _ in range(10):
                        here, there = at[0], (at[0] + 1) % PLACES
                        work(f"p{here}", f"p{there}")
                        at[0] = there

                return calls

            def apply(one: str, other: str, action: str = action) -> None:
                kb.apply(f"({action} rb {one} {other})")

            run(apply)(), run(by_dao)()
            library, dao = (
                median(each) / 10
                for each in alternate(
                    repeat,
                    lambda _, apply=apply: run(apply),  # type: ignore[misc]
                    lambda _, by_dao=by_dao: run(by_dao),  # type: ignore[misc]
                )
            )
            ratio = library / dao
            is_met = "yes" if ratio <= 1.3 else "no"
            numbers = [f"{1e3 * library:.3f}", f"{1e3 * dao:.3f}", f"{ratio:.2f}x", "1.3x", is_met]
            rows.append([f"a step of {said}", *numbers])
    return rows


def _simulate(url: str, answers: Any) -> None:
    import unified_planning.shortcuts as up

    up.get_environment().credits_stream = None
    try:
        with kant_sql.connect(url, knowledge_base="bench") as kb:
            read = kb.to_unified_planning()
        with up.SequentialSimulator(read) as simulator:
            state = simulator.get_initial_state()
            start = time.perf_counter()
            number = len(list(simulator.get_applicable_actions(state)))
            answers.put((time.perf_counter() - start, number))
    except Exception as error:
        answers.put(type(error).__name__)


def simulated(url: str, limit: float) -> tuple[float, int] | str:
    """Ask unified-planning's simulator; gives seconds and number, or why there is none."""
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    process = context.Process(target=_simulate, args=(url, answers), daemon=True)
    process.start()
    try:
        found: tuple[float, int] | str = answers.get(timeout=limit)
    except queue.Empty:
        found = f"over {limit:g} s"
    process.kill()
    process.join()
    return found


def mimir(python: str, pair: Pair, limit: float) -> float | None:
    """Ask pymimir's generator; None where it does not read the pair."""
    command = [python, "-c", MIMIR, str(pair.domain), str(pair.problem)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=True)
    except subprocess.SubprocessError:
        return None
    return float(done.stdout.split()[-2])


def applicable(pair: Pair, url: str) -> tuple[float, float, int]:
    """Ask the library: seconds of the first time, of later ones, and the number of steps."""
    with kant_sql.connect(url, knowledge_base="bench", actor="bench") as kb:
        kb.load_domain(pair.domain)
        kb.load_problem(pair.problem)
        first = seconds(lambda: list(kb.applicable_actions()))
        later = median(seconds(lambda: list(kb.applicable_actions())) for _ in range(5))
        return first, later, len(list(kb.applicable_actions()))


def pairs(number: int, limit: float, python: str | None) -> None:
    """Compare the initial states of pairs."""
    rows: list[list[str]] = []
    ratios: list[float] = []
    of_mimir: list[float] = []
    ended: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        # From each competition some.
        for pair in PAIRS[:: max(len(PAIRS) // max(number, 1), 1)][:number]:
            url = f"sqlite:///{Path(folder) / f'pair{len(rows)}.db'}"
            first, later, count = applicable(pair, url)
            found = simulated(url, limit)
            compiled = None if python is None else mimir(python, pair, limit)
            if compiled is not None:
                of_mimir.append(later / compiled)
            by_mimir = "" if compiled is None else f"{1e3 * compiled:.3f}"
            shown = found if isinstance(found, str) else f"{1e3 * found[0]:.1f}"
            ratio = ""
            if isinstance(found, str):
                ended[found] = ended.get(found, 0) + 1
                if found.startswith("over"):
                    ratio = f"> {limit / later:.0f}x"
            else:
                ratios.append(found[0] / later)
                ratio = f"{ratios[-1]:.0f}x"
                if found[1] != count:
                    ratio += f" ({found[1]} steps)"
            row = [pair.name, str(count), f"{1e3 * first:.2f}", f"{1e3 * later:.2f}"]
            rows.append([*row, shown, ratio, by_mimir])
    header = ["sqlite, ms", "steps", "first", "later", "simulator", "faster", "pymimir"]
    print_table("Steps that can be executed in initial states", header, rows)
    if ratios:
        print(
            f"  of {len(ratios)} pairs: {min(ratios):.0f}x to {max(ratios):.0f}x, median"
            f" {median(ratios):.0f}x, at least 1,000x in {sum(each >= 1000 for each in ratios)};"
            f" without an answer: {ended}"
        )
    if of_mimir:
        print(f"  of pymimir's time: {median(of_mimir):.0f}x, {len(of_mimir)} pairs")


def main(argv: Sequence[str] | None = None) -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--pairs", type=int, default=len(PAIRS), help="how many of them")
    parser.add_argument("--limit", type=float, default=20, help="seconds for the simulator")
    parser.add_argument("--mimir", help="an interpreter that has pymimir")
    parser.add_argument("--backend", choices=["sqlite", "postgresql"], action="append")
    options = parser.parse_args(argv)
    with stores(options.backend or ["sqlite", "postgresql"]) as places:
        for backend, new in places.items():
            header = [f"{backend}, ms", "apply", "by DAO calls", "ratio", "aim", "met"]
            print_table("Executing a step, median", header, steps(new(), options.repeat))
    if not PAIRS:
        print("no competition files beside the checkout: applicable actions are not compared")
    pairs(options.pairs, options.limit, options.mimir)
    return 0


if __name__ == "__main__":
    sys.exit(main())
