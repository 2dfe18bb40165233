"""Finds plans in separate processes, and hints if no engine finds one."""

from __future__ import annotations

import contextvars
import logging
import pickle
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from queue import SimpleQueue
from typing import Literal, NamedTuple

from ..arguments import expect, flag, iterate, one_of, optional_text, seconds, whole_number
from ..errors import InvalidArgumentError, KantSqlError, NoPlanError, PlannerMissingError, printable
from ..limits import LIMIT, Limit, StatementGuard
from ..pddl.document import Domain, Problem
from .commands import INVALID, MISREAD, WAYS_OUT, ask, ask_directly, engines_file, find_command
from .guard import FOLDER
from .names import require_unified_planning
from .plan import EngineRun, Plan
from .processes import PlannerProcess

logger = logging.getLogger("kant_sql.planning")


class Task(NamedTuple):
    """The task of a planner's process; `solve` explains the fields."""

    domain: Domain
    problem: Problem
    engine: str | None
    timeout: float  # infinite to wait without limit
    strict: bool
    engines: Path  # the file of engines: the process has another folder
    is_costed: bool = False
    failures: Mapping[str, str] = {}  # the statuses of engines that were already asked


class Judged(NamedTuple):
    """The verdict of a judge on a plan.

    Attributes:
        text: the verdict in words.
        cost: the lower, the better; None if unknown.
    """

    is_valid: bool
    text: str
    cost: Decimal | None = None


Keep = Literal["first", "best"]
Judge = Callable[[Plan], Judged]


def accept(plan: Plan) -> Judged:
    """Accept any plan; one with fewer steps is better."""
    return Judged(True, f"{len(plan.steps)} steps", Decimal(len(plan.steps)))


def solve(
    domain: Domain,
    *,
    problem: Problem,
    engine: str | None = None,
    engines: Iterable[str] | None = None,
    keep: Keep = "first",
    timeout: float | None = None,
    memory: int | None = None,
    strict: bool = False,
    is_costed: bool = False,
    judge: Judge = accept,
) -> Plan:
    """Find a plan.

    Without an engine's name, the installed engines that support the problem are tried in turn:
    aries first for durations, ENHSP for numbers, otherwise Fast Downward and pyperplan. Fast
    Downward gets the documents themselves if it can read all of them. unified-planning may compile
    away constructs that an engine does not support: quantifiers, conditional effects, trajectory
    constraints, object fluents.

    Plugins compile preferences and metrics that unified-planning does not know; a planner improves
    the costs for at most 10 seconds, or half of the timeout. Those that an engine still cannot get
    are named in the plan's `ignored`, and logged as a warning. Nothing else is left out but
    functions that only the initial state mentions: they affect no plan.

    Args:
        engine: the engine's name in unified-planning, for example `fast-downward-opt`,
            a name in the file of engines, or a command line: `lama: PROGRAM {domain} {problem}`.
        engines: several engines, which run side by side.
        keep: the plan to return: the `first` one, or the `best` until the time is up.
        timeout: seconds to wait; None for no limit.
        memory: the maximum megabytes of addresses for each process; None for no limit.
        strict: refuse to ignore a part of the metric or a preference.
        is_costed: find a cheap plan, which engines improve for as long as one with soft goals.
        judge: judges each plan; invalid ones are not returned.

    Returns:
        The plan, with the names of the documents.

    Raises:
        PlannerMissingError: unified-planning or the engine is not installed.
        UnsupportedConstructError: a construct has no exact counterpart in unified-planning; or,
            with `strict`, a planner cannot get a soft goal.
        NoPlanError: there is no plan, or none was found in time; `status` is the reason.
    """
    check_documents(domain, problem)
    optional_text(engine, "engine")
    longest = seconds(timeout)
    flag(strict, "strict", InvalidArgumentError)
    one_of(keep, ("first", "best"), "keep")
    if memory is not None:
        whole_number(memory, "memory", least=1, error=InvalidArgumentError)
    asked: list[str | None] = [engine]
    if engines is not None:
        if engine is not None:
            raise InvalidArgumentError("give engine or engines, not both")
        given = iterate(engines, "engines", "a list of names", InvalidArgumentError)
        asked = [expect(one, str, "an engine", InvalidArgumentError) for one in given]
        if not asked:
            raise InvalidArgumentError("engines is empty; name at least one, or leave it out")
    is_best, file = keep == "best", engines_file().absolute()
    attempts = [
        Attempt(
            Task(domain, problem, one, longest, strict, file, is_costed or is_best),
            *(judge, (memory or 0) << 20, is_best),
        )
        for one in asked
    ]
    found = _race(attempts, is_best)
    if found.ignored:
        ignored = printable("; ".join(found.ignored))
        logger.warning("%s was not given a part of the problem: %s", found.engine, ignored)
    return found


def check_documents(domain: Domain, problem: Problem) -> None:
    """Check that the arguments are documents."""
    expect(domain, Domain, "the domain", InvalidArgumentError)
    expect(problem, Problem, "the problem", InvalidArgumentError)


class Attempt:
    """A request to an engine, in its own processes and thread."""

    def __init__(self, task: Task, judge: Judge, memory: int, is_best: bool) -> None:
        self._task, self._judge, self._is_best = task, judge, is_best
        self._started = time.monotonic()
        self.process = PlannerProcess(memory=memory)
        self.plan: Plan | None = None
        self.error: Exception | None = None
        self.cost: Decimal | None = None
        self._failures: dict[str, str] = {}
        self._ran, self._said, self._is_stopped = 0.0, "", False

    def run(self) -> None:
        """Ask the engine, and keep its plan or its failure."""
        try:
            with tempfile.TemporaryDirectory(
                prefix=FOLDER, ignore_cleanup_errors=True
            ) as self.process.folder:
                self._keep_first_valid(self._answers())
        except Exception as error:  # The waiting thread raises it.
            self._is_stopped = self.process.is_ended
            self._said = str(error).removesuffix(f"; {WAYS_OUT}")
            if isinstance(error, NoPlanError) and error.status == "timeout":
                name = "" if self._task.engine is None else f"{self._name}: "
                longest = f"within {self._task.timeout:g} seconds"
                message = f"{name}no plan was found {longest}; {WAYS_OUT}"
                error = NoPlanError(message, "timeout")
            self.error = error
        self._ran = time.monotonic() - self._started

    def report(self) -> EngineRun:
        """Return the result in words."""
        status = "missing" if isinstance(self.error, PlannerMissingError) else "unsupported_problem"
        if self.plan is not None:
            status = self.plan.status
        elif self._is_stopped:
            status, self._said = "stopped", "another one had a plan"
        elif isinstance(self.error, NoPlanError):
            status = self.error.status
        name = self._name if self.plan is None else self.plan.engine.partition(": ")[0]
        return EngineRun(name, self._ran, status, printable(self._said))

    @property
    def _name(self) -> str:
        engine = self._task.engine
        return "installed engines" if engine is None else engine.partition(": ")[0]

    def _keep_first_valid(self, plans: Iterator[Plan]) -> None:
        refused = None
        try:
            for plan in plans:
                judged = self._judge(plan)
                if judged.is_valid:
                    self.plan, self.cost, self._said = plan, judged.cost, judged.text
                    return
                self._failures[plan.engine] = INVALID
                refused = refused or f"{plan.engine} answered with an invalid plan: {judged.text}"
        except KantSqlError:
            if refused is None:
                raise
        raise NoPlanError(f"{refused}; {WAYS_OUT}", INVALID)

    def _answers(self) -> Iterator[Plan]:
        """Yield the plans of the engine, the best first."""
        task, engine, until = self._task, self._task.engine, self._started + self._task.timeout
        command = None if engine is None else find_command(engine)
        if command is not None:
            yield from ask(command, task.domain, task.problem, self.process, until)
            return
        improving = min(IMPROVING_SECONDS, task.timeout / 2) if task.is_costed else 0
        if self._is_best:
            improving = task.timeout
        try:
            found = ask_directly(
                task.domain, task.problem, engine, improving, self._failures, self.process, until
            )
            first = next(found, None)
        except NoPlanError as error:
            if error.status in FINAL or (engine and error.status not in MISREAD):
                raise
            first = None
        if first is not None:
            yield first
            yield from found
        while first is None or engine is None:
            first = self._by_unified_planning()
            if self._failures.get(first.engine) == INVALID:
                return
            yield first

    def _by_unified_planning(self) -> Plan:
        require_unified_planning()
        folder = self.process.folder
        task, result = Path(folder, "task"), Path(folder, "result")
        left = max(self._started + self._task.timeout - time.monotonic(), 0.0)
        asked = self._task._replace(timeout=left, failures=self._failures)
        task.write_bytes(pickle.dumps(asked))
        result.unlink(missing_ok=True)
        words = [sys.executable, "-m", f"{__package__}.worker", folder]
        ended = self.process.run(words, time.monotonic() + left)
        if not result.exists():
            status = ended.status or "internal_error"
            raise NoPlanError(f"the planner's process ended early: {ended.reason}", status)
        outcome, fallbacks = pickle.loads(result.read_bytes())
        for fallback in fallbacks:
            logger.warning("%s", printable(fallback))
        if isinstance(outcome, Exception):
            raise outcome
        found: Plan = outcome
        return found


def _race(attempts: Sequence[Attempt], is_best: bool) -> Plan:
    """Run attempts side by side; end all of them with the first plan, or with this call."""
    done: SimpleQueue[Attempt] = SimpleQueue()

    def run(attempt: Attempt) -> None:
        attempt.run()
        done.put(attempt)

    def end() -> None:
        for attempt in attempts:
            attempt.process.end()

    threads = [
        threading.Thread(target=contextvars.copy_context().run, args=(run, one), daemon=True)
        for one in attempts
    ]
    limit = LIMIT.get() or Limit()
    guard = StatementGuard(limit, None, end)
    guard.join()
    try:
        with guard:
            for thread in threads:
                thread.start()
            for _ in threads:
                if done.get().plan is not None and not is_best:
                    break
    finally:
        guard.leave()
        end()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
    limit.check()
    return _chosen(attempts)


def _chosen(attempts: Sequence[Attempt]) -> Plan:
    """Return the best plan, with the runs of all engines; raise if there is none."""
    runs = tuple(attempt.report() for attempt in attempts)
    solved = [attempt for attempt in attempts if attempt.plan is not None]
    if solved:
        best = min(solved, key=lambda one: (one.cost is None, one.cost or 0))
        assert best.plan is not None
        return replace(best.plan, runs=runs)
    errors = [attempt.error for attempt in attempts if attempt.error is not None]
    own = [error for error in errors if not isinstance(error, KantSqlError)]
    if own or len(errors) == 1:
        error = (own or errors)[0]
        if isinstance(error, NoPlanError):
            error.runs = runs
        raise error
    statuses = [run.status for run in runs]
    status = next((one for one in _TELLING if one in statuses), statuses[0])
    said = "; ".join(map(str, runs))
    failed = NoPlanError(f"no engine found a plan ({said}); {WAYS_OUT}", status)
    failed.runs = runs
    raise failed


FINAL = "unsolvable_proven", "timeout"
# Of several failures, the first one in this order says most.
_TELLING = ("unsolvable_proven", "timeout", "memout", "unsolvable_incompletely", "internal_error")
# Seconds to improve a plan. A plan without any soft goal is found at once.
IMPROVING_SECONDS = 10.0
