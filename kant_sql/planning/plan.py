"""Plans, and `solve`, which runs a planner in a separate process."""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from decimal import Decimal
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from .. import html
from ..arguments import expect, expect_tuple, flag, optional_text, seconds, whole_number
from ..dto.lexical import check_number
from ..errors import (
    InvalidArgumentError,
    InvalidKnowledgeError,
    KantSqlError,
    NoPlanError,
    PlannerMissingError,
    UnsupportedConstructError,
    printable,
)
from ..pddl.document import Domain, Problem
from .advice import WAYS_OUT
from .names import require_unified_planning
from .plan_text import read_plan

logger = logging.getLogger("kant_sql.planning")

_ERRORS: dict[str, type[KantSqlError]] = {
    error.__name__: error for error in (PlannerMissingError, UnsupportedConstructError)
}


@dataclass(frozen=True, slots=True)
class PlanStep:
    """A step of a plan.

    Attributes:
        start: its start time; None in a plan without times.
        action: the action's name in the domain.
        arguments: the objects' names, in the order of the action's parameters.
        duration: its duration; None for an instantaneous step.
    """

    start: Decimal | None
    action: str
    arguments: tuple[str, ...] = ()
    duration: Decimal | None = None

    def __post_init__(self) -> None:
        expect(self.action, str, "the action of a PlanStep")
        arguments = expect_tuple(self.arguments, str, "the arguments of a PlanStep")
        if arguments is not self.arguments:
            object.__setattr__(self, "arguments", arguments)
        for number, role in ((self.start, "start"), (self.duration, "duration")):
            if number is not None:
                check_number(number, f"the {role} of a PlanStep")

    def _html_row_(self) -> html.Row:
        text = f"({' '.join((self.action, *self.arguments))})"
        return {"start": self.start, "step": text, "duration": self.duration}

    def __str__(self) -> str:
        text = f"({' '.join((self.action, *self.arguments))})"
        if self.start is not None:
            text = f"{self.start:f}: {text}"
        return text if self.duration is None else f"{text} [{self.duration:f}]"


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan; its text is in the format of the validator VAL.

    Attributes:
        steps: its steps, in order.
        engine: the engine of unified-planning that found it.
        status: the engine's verdict: `solved_satisficing` or `solved_optimally`.
        revision: the revision of the knowledge base that was planned from.
        problem_hash: the `problem_hash` of the planner's input; None when unknown.
        ignored: what of the metric and the preferences the planner was not given, as readable text.
        domain_pddl: the domain that the planner was given, if it is not the state's.
        problem_pddl: the problem that the planner was given, if it is not the state's.
        value: the value of the metric, if the planner stated it in a text that was read.
    """

    steps: tuple[PlanStep, ...]
    engine: str
    status: str
    revision: int | None = None
    problem_hash: str | None = field(default=None, compare=False)
    ignored: tuple[str, ...] = ()
    domain_pddl: str | None = field(default=None, compare=False, repr=False)
    problem_pddl: str | None = field(default=None, compare=False, repr=False)
    value: Decimal | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        steps = expect_tuple(self.steps, PlanStep, "the steps of a Plan")
        if steps is not self.steps:
            object.__setattr__(self, "steps", steps)
        expect(self.engine, str, "the engine of a Plan")
        expect(self.status, str, "the status of a Plan")
        for name in ("problem_hash", "domain_pddl", "problem_pddl"):
            optional_text(getattr(self, name), f"the {name} of a Plan", InvalidKnowledgeError)
        ignored = expect_tuple(self.ignored, str, "the ignored of a Plan")
        if ignored is not self.ignored:
            object.__setattr__(self, "ignored", ignored)
        if self.revision is not None:
            whole_number(self.revision, "the revision of a Plan", error=InvalidKnowledgeError)
        if self.value is not None:
            check_number(self.value, "the value of a Plan")

    @classmethod
    def read(cls, source: str | os.PathLike[str]) -> Plan:
        """Read a plan that another program wrote.

        These formats are known, in any case, with comments (`;`) and line ends of any system: of
        VAL; the plan files and the log of Fast Downward; the logs of POPF, OPTIC, Temporal Fast
        Downward and ENHSP; what unified-planning's `PDDLWriter` writes, and the `str` of its plans;
        `str` of a `Plan`, and what `kant-sql plan` prints. Of several plans in a log, the last is
        read: it is the best.

        Args:
            source: a path, or the text: a string with a line break, or one that begins with `(`,
                `;`, or a time and a colon.

        Returns:
            The plan. `engine` is the planner, if the text names it (`kant-sql plan`) or only one
            writes such a text (Fast Downward); else it is empty. `status` is `solved_satisficing`,
            unless the text says `solved_optimally`. `value` is the metric or cost that is stated.
            `revision` is None: a plan is recorded as one of the head.

        Raises:
            PddlError: a line is not a step; the error has the line, what was found and expected.
            SourceMissingError: the file does not exist; this is a `FileNotFoundError`, too.
            SourceError: the file cannot be read.

        Examples:
            >>> from kant_sql import Plan
            >>> plan = Plan.read("(move rb1 wp1 wp2)")
            >>> plan.steps
            (PlanStep(start=None, action='move', arguments=('rb1', 'wp1', 'wp2'), duration=None),)
            >>> print(Plan.read("0.5: (move rb1 wp1 wp2)  [2.500]"), end="")
            0.5: (move rb1 wp1 wp2) [2.500]
        """
        text = read_plan(source)
        steps = tuple(PlanStep(*step) for step in text.steps)
        return cls(steps, text.engine, text.status, value=text.value)

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)

    def _repr_html_(self) -> str:
        return html.listing(self.steps, "step")


def problem_hash(domain: str, *, problem: str) -> str:
    """Hash the input of a planner.

    Args:
        domain: the domain's PDDL text.
        problem: the problem's PDDL text.

    Returns:
        The SHA-256 of both texts in UTF-8, the domain first, as 64 hexadecimal digits.
    """
    for text, role in ((domain, "domain"), (problem, "problem")):
        expect(text, str, role, InvalidArgumentError)
    # A lone surrogate has no UTF-8; such a text is not PDDL.
    return sha256((domain + problem).encode(errors="surrogatepass")).hexdigest()


class Task(NamedTuple):
    """What a planner's process is asked for; `solve` explains the fields."""

    domain: Domain
    problem: Problem
    engine: str | None
    timeout: float | None
    strict: bool


def solve(
    domain: Domain,
    *,
    problem: Problem,
    engine: str | None = None,
    timeout: float | None = None,
    strict: bool = False,
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
        task.write_bytes(pickle.dumps(Task(domain, problem, engine, timeout, strict)))
        log = _run(directory, longest)
        if not result.exists():
            reason = log.strip().splitlines()[-1:] or ["no reason was given"]
            raise NoPlanError(f"the planner's process ended early: {reason[0]}", "internal_error")
        outcome, fallbacks = pickle.loads(result.read_bytes())
    for fallback in fallbacks:
        logger.warning("%s", printable(fallback))
    if isinstance(outcome, Plan):
        if outcome.ignored:
            ignored = printable("; ".join(outcome.ignored))
            logger.warning("%s was not given a part of the problem: %s", outcome.engine, ignored)
        return outcome
    kind, message, status = outcome
    if kind in _ERRORS:
        raise _ERRORS[kind](message)
    raise NoPlanError(message, status)


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
