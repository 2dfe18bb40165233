"""Finds a plan in a separate process, and says what to do where no engine finds one."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..arguments import expect, flag, optional_text, seconds
from ..errors import (
    InvalidArgumentError,
    NoPlanError,
    printable,
)
from ..pddl.document import Domain, Problem
from .names import require_unified_planning
from .plan import Plan

if TYPE_CHECKING:
    from unified_planning.environment import Environment

logger = logging.getLogger("kant_sql.planning")

WAYS_OUT = (
    "Plan.read(text) takes the plan of a program outside, and in a branch, kb.branch(), you can "
    "relax the goal or the conditions and plan again"
)
_TEMPORAL, _NUMERIC = ("aries", "tamer", "lpg"), ("enhsp", "tamer", "aries")
_LOGICAL = ("fast-downward", "enhsp")
# Engines that unified-planning lists for features; an engine that is installed is asked itself.
_KNOWN_FOR: Mapping[str, tuple[str, ...]] = {
    "CONTINUOUS_TIME": _TEMPORAL,
    "DURATION_INEQUALITIES": ("aries", "tamer"),
    "INTERMEDIATE_CONDITIONS_AND_EFFECTS": ("aries", "tamer"),
    "TIMED_EFFECTS": ("aries", "tamer"),
    "TIMED_GOALS": ("aries", "tamer"),
    "NUMERIC_FLUENTS": _NUMERIC,
    "REAL_FLUENTS": _NUMERIC,
    "INT_FLUENTS": _NUMERIC,
    "SIMPLE_NUMERIC_PLANNING": _NUMERIC,
    "GENERAL_NUMERIC_PLANNING": ("enhsp", "tamer"),
    "INCREASE_EFFECTS": _NUMERIC,
    "DECREASE_EFFECTS": _NUMERIC,
    "PROCESSES": ("enhsp",),
    "EVENTS": ("enhsp",),
    "INCREASE_CONTINUOUS_EFFECTS": ("enhsp",),
    "DECREASE_CONTINUOUS_EFFECTS": ("enhsp",),
    "OBJECT_FLUENTS": ("aries", "tamer"),
    "ACTIONS_COST": ("fast-downward-opt", "enhsp"),
    "CONDITIONAL_EFFECTS": _LOGICAL,
    "DISJUNCTIVE_CONDITIONS": _LOGICAL,
    "EXISTENTIAL_CONDITIONS": _LOGICAL,
    "UNIVERSAL_CONDITIONS": _LOGICAL,
    "NEGATIVE_CONDITIONS": _LOGICAL,
}


def packages() -> Mapping[str, str]:
    """Return the package of PyPI of each engine that unified-planning knows."""
    from unified_planning.engines.factory import DEFAULT_ENGINES

    modules = {name: module.split(".")[0] for name, (module, _) in DEFAULT_ENGINES.items()}
    return {
        name: module.replace("_", "-")
        for name, module in modules.items()
        if module.startswith("up_")
    }


def import_fault(engine: str) -> str | None:
    """Return why an engine whose package is installed cannot be imported; None without one."""
    from unified_planning.engines.factory import DEFAULT_ENGINES

    module, name = DEFAULT_ENGINES.get(engine, ("", ""))
    if not module or importlib.util.find_spec(module.split(".")[0]) is None:
        return None
    try:
        getattr(importlib.import_module(module), name)
    except Exception as error:  # a package may fail in any way
        return f"{type(error).__name__}: {error}"
    return None


def absent(engine: str, planners: Iterable[str]) -> str:
    """Say why an engine that was asked for is not there."""
    fault = import_fault(engine)
    others = f"or choose one of {', '.join(planners)}"
    package = packages().get(engine)
    if fault is not None:
        return (
            f"engine {engine} is installed, but cannot be imported ({fault}); repair its package "
            f"{package}, {others}"
        )
    how = "install it" if package is None else f"run pip install {package}"
    return f"engine {engine} is not installed; {how}, {others}"


def unsupported(
    missing: Mapping[str, Collection[str]], suitable: Collection[str], environment: Environment
) -> str:
    """Say what the engines that were asked do not know, and which others would know it.

    Args:
        missing: the features that each engine lacks.
        suitable: engines that are installed and support the problem.
        environment: has the engines that are installed.
    """
    said = [
        f"{name} does not know {', '.join(sorted(features)).lower()}"
        for name, features in missing.items()
    ]
    features = {feature for found in missing.values() for feature in found}
    known = dict.fromkeys(
        engine for feature in sorted(features) for engine in _KNOWN_FOR.get(feature, ())
    )
    if suitable:
        said.append(f"{', '.join(suitable)} would do; choose it, or no engine")
    for engine in known:
        if engine in environment.factory.engines or engine in missing:
            continue
        fault = import_fault(engine)
        how = f"pip install {packages().get(engine)}"
        if fault is None:
            own = [one for one in sorted(features) if engine in _KNOWN_FOR.get(one, ())]
            said.append(f"{engine} knows {', '.join(own).lower()}: {how}")
        else:
            said.append(f"{engine} is installed, but cannot be imported ({fault})")
    return "; ".join(said) or "install one"


class Task(NamedTuple):
    """What a planner's process is asked for; `solve` explains the fields."""

    domain: Domain
    problem: Problem
    engine: str | None
    timeout: float | None
    strict: bool
    is_costed: bool = False


def solve(
    domain: Domain,
    *,
    problem: Problem,
    engine: str | None = None,
    timeout: float | None = None,
    strict: bool = False,
    is_costed: bool = False,
) -> Plan:
    """Find a plan.

    Without an engine's name, the installed engines that support the problem are tried in turn:
    aries first for durations, ENHSP for numbers, otherwise Fast Downward and pyperplan.
    unified-planning may compile away constructs that an engine does not support: quantifiers,
    conditional effects, trajectory constraints, object fluents.

    Plugins compile preferences and metrics that unified-planning does not know; a planner improves
    what they cost for at most 10 seconds, or half of the timeout. What of them an engine still
    cannot be given is named in the plan's `ignored`, and logged as a
    warning. Nothing else is ever left out.

    Args:
        engine: the name that unified-planning has for an engine, for example `fast-downward-opt`.
        timeout: the longest time to wait, in seconds; None is infinite.
        strict: refuse to ignore a part of the metric or a preference.
        is_costed: ask for a cheap plan, which engines improve for as long as those of soft goals.

    Returns:
        The plan, in the names of the documents.

    Raises:
        PlannerMissingError: unified-planning or the engine is not installed.
        UnsupportedConstructError: a construct has no exact counterpart in unified-planning; or,
            with `strict`, a soft goal cannot be given to a planner.
        NoPlanError: there is no plan, or none was found in time; `status` is the reason.
    """
    check_documents(domain, problem)
    optional_text(engine, "engine")
    longest = seconds(timeout)
    flag(strict, "strict", InvalidArgumentError)
    require_unified_planning()
    with tempfile.TemporaryDirectory(prefix="kant-sql-plan-") as directory:
        task, result = Path(directory, "task"), Path(directory, "result")
        task.write_bytes(pickle.dumps(Task(domain, problem, engine, timeout, strict, is_costed)))
        log = _run(directory, longest)
        if not result.exists():
            reason = log.strip().splitlines()[-1:] or ["no reason was given"]
            raise NoPlanError(f"the planner's process ended early: {reason[0]}", "internal_error")
        outcome, fallbacks = pickle.loads(result.read_bytes())
    for fallback in fallbacks:
        logger.warning("%s", printable(fallback))
    if isinstance(outcome, Exception):
        raise outcome
    found: Plan = outcome
    if found.ignored:
        ignored = printable("; ".join(found.ignored))
        logger.warning("%s was not given a part of the problem: %s", found.engine, ignored)
    return found


def check_documents(domain: Domain, problem: Problem) -> None:
    """Check that the arguments are documents.

    Raises:
        InvalidArgumentError: one of them is not.
    """
    expect(domain, Domain, "the domain", InvalidArgumentError)
    expect(problem, Problem, "the problem", InvalidArgumentError)


def _run(directory: str, timeout: float) -> str:
    # The worker ends with its standard input, so it does not outlive a killed parent.
    with Path(directory, "log").open("w+", errors="replace") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.worker", directory],
            cwd=directory,
            env={**os.environ, "PYTHONPATH": _import_path(), "TMPDIR": directory},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=log,
            start_new_session=True,
        )
        try:
            # Longer waits overflow the system's clock; they mean no timeout.
            process.wait(timeout if timeout <= threading.TIMEOUT_MAX else None)
        except subprocess.TimeoutExpired:
            message = f"no plan was found within {timeout:g} seconds; {WAYS_OUT}"
            raise NoPlanError(message, "timeout") from None
        finally:
            _end(process)
        log.seek(0)
        return log.read()


def _import_path() -> str:
    return os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)


def _end(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.communicate()
