"""Planners, each in a process of its own, that read a pair's files and find a plan.

Each function returns the plan's text as VAL reads it. Fast Downward, pyperplan and ENHSP read the
files with parsers of their own; Aries gets them by way of unified-planning's.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.meaning.material import HERE, Pair
from tests.meaning.others import need, run
from tests.support.processes.warm import PLANNING, python

SECONDS = 60
Planner = Callable[[Pair, Path], str]


class NoPlanError(Exception):
    """A planner has found no plan."""


def fast_downward(pair: Pair, folder: Path) -> str:
    """Plan with Fast Downward: classical planning, derived predicates, action costs."""
    need("up_fast_downward", "fast_downward")
    driver = _package("up_fast_downward") / "downward" / "fast-downward.py"
    plan = folder / "plan"
    options = ["--plan-file", str(plan), "--alias", "lama-first"]
    return _plan([sys.executable, str(driver), *options, *_files(pair)], plan, folder)


def pyperplan(pair: Pair, folder: Path) -> str:
    """Plan with pyperplan: STRIPS with types. It writes the plan beside the problem."""
    need("pyperplan")
    problem = folder / "problem.pddl"
    shutil.copyfile(pair.problem, problem)
    command = [sys.executable, "-m", "pyperplan", "-H", "hff", "-s", "gbf"]
    plan = problem.with_name("problem.pddl.soln")
    return _plan([*command, str(pair.domain), str(problem)], plan, folder)


def enhsp(pair: Pair, folder: Path) -> str:
    """Plan with ENHSP: numeric planning. Preferences it does not read, and leaves out."""
    need("up_enhsp")
    if shutil.which("java") is None:
        pytest.skip("no java, which ENHSP runs on")
    plan = folder / "plan"
    # The second compiler of Java takes longer than the plan.
    command = [
        "java",
        "-XX:+UseSerialGC",
        "-XX:TieredStopAtLevel=1",
        "-jar",
        str(_package("up_enhsp") / "ENHSP" / "enhsp.jar"),
    ]
    domain, problem = _files(pair)
    options = ["-o", domain, "-f", problem, "-sp", str(plan), "-npm", "-h", "hadd", "-s", "gbfs"]
    return _plan([*command, *options], plan, folder)


def aries(pair: Pair, folder: Path) -> str:
    """Plan with Aries: temporal planning."""
    need("unified_planning", "up_aries")
    program = python(*PLANNING)
    command = [str(program), str(HERE / "child_aries.py"), *_files(pair), str(SECONDS)]
    done = run(command, folder=folder, seconds=2 * SECONDS)
    if done.returncode != 0:
        raise NoPlanError(f"{command} exit {done.returncode}: {done.stderr[-1000:]}")
    return done.stdout


PLANNERS: dict[str, Planner] = {
    planner.__name__: planner for planner in (fast_downward, pyperplan, enhsp, aries)
}


def _files(pair: Pair) -> list[str]:
    return [str(pair.domain), str(pair.problem)]


def _package(name: str) -> Path:
    spec = find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def _plan(command: list[str], plan: Path, folder: Path) -> str:
    plan.unlink(missing_ok=True)
    done = run(command, folder=folder, seconds=SECONDS)
    if not plan.exists():
        said = (done.stdout + done.stderr)[-1000:]
        raise NoPlanError(f"{command} exit {done.returncode}: {said}")
    return plan.read_text()
