"""Executes whole plans: each step at its time, several in parallel, until one fails."""

from __future__ import annotations

import asyncio
import contextvars
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent import futures
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from inspect import isawaitable, iscoroutine, iscoroutinefunction
from queue import Empty, SimpleQueue
from typing import NamedTuple

from .. import html
from ..acts import Execution, Outcome
from ..acts.executions import report
from ..acts.recording import key_of, read_execution, running_executions
from ..arguments import UNSTORABLE, expect, optional_call, optional_text, refusal, seconds
from ..documents.carry import STATED
from ..errors import (
    ArchivedError,
    InvalidArgumentError,
    InvalidKnowledgeError,
    KantSqlError,
    NotApplicableError,
    PlanError,
    RuleViolatedError,
)
from ..history.follow import refuse_unwatchable, watch_until
from ..history.moments import head_revision
from ..limits import Limit, limited
from ..plans import RecordedPlan
from ..plans.dao import SqlPlanDao
from ..sql.changes import stream_changes
from ..sql.dialects.base import Session
from ..sql.executions import RUNNING, SUCCEEDED, Key
from ..store.state import State
from .durative import (
    BrokenInvariant,
    apply,
    begin_running,
    broken_since,
    end_running,
    find_broken,
    refuse,
)
from .effects import not_applicable
from .failures import FailedCondition
from .replan import PlanOptions, Remaining, check_options, take_over
from .steps import ground
from .validate import GivenPlan, has_same_steps, read_any_plan

Dispatch = Callable[[Execution], object]
# With more revisions, find those that changed the state first: a camera may confirm much.
FEW = 8
_REFUSED = (NotApplicableError, RuleViolatedError, InvalidKnowledgeError, ArchivedError)
_CANCELLED = (asyncio.CancelledError, futures.CancelledError)


@dataclass(frozen=True)
class ExecutedPlan:
    """The outcome of executing a plan.

    Attributes:
        outcome: `succeeded`, or the outcome of the step that ended it: `failed`, `aborted`, or
            `refused` if its condition did not hold within the timeout.
        step: the execution that ended it; None if it succeeded, or was cancelled between steps.
        unsatisfied: the conditions of that step that did not hold, each with the revision that
            broke it; none if the step failed by itself.
        plan: the recorded plan, with the outcomes of its steps; with `replan`, the last one.
        broken: with `replan`, why each earlier plan broke.
    """

    outcome: Outcome
    step: Execution | None
    unsatisfied: tuple[BrokenInvariant, ...]
    plan: RecordedPlan
    broken: tuple[str, ...] = ()

    def __str__(self) -> str:
        done = sum(step.outcome == SUCCEEDED for step in self.plan.steps)
        said = f"plan {self.plan.id} {self.outcome}, {done} of {len(self.plan.steps)} steps done"
        lines = [*self.broken, said]
        if self.step is not None:
            why = " ".join(each for each in (self.step.code, self.step.text) if each)
            broken = self.unsatisfied or [f"{self.step}: {why}".strip(": ")]
            lines += [f"  {each}" for each in broken]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html.lines(str(self))


def execute(
    state: State,
    plan: GivenPlan,
    dispatch: Dispatch,
    *,
    cancel: Dispatch | None = None,
    timeout: float | None = 0,
    speed: float = 1,
    reason: str | None = None,
    replan: PlanOptions | None = None,
) -> ExecutedPlan:
    """Execute a plan: call `dispatch(step)` for each step, and record the outcomes.

    A step begins when its start time has come, all steps that end before it in the plan have ended,
    and its condition holds; without start times, steps follow each other. It is recorded as
    `running`, with its effects `at start`; then `dispatch` executes it in its own thread; then its
    other effects are written, and it has succeeded. So durations are those of the robot, in the
    order of the plan.

    A step fails if `dispatch` raises an error or returns False, any process breaks one of its
    invariants, its condition at the end does not hold, or a kept rule refuses its effects; the code
    is `error.code`, or the class of the error. It is aborted if `dispatch` raises `CancelledError`,
    or any process calls `kb.abort(step)`. The first step that does not succeed ends the plan: the
    other running steps are aborted, in the same revision.

    Args:
        plan: as for `validate`. A new plan is recorded first. Steps of a recorded plan that have
            succeeded are not repeated.
        dispatch: executes a step, given its execution, and returns when it is done.
        cancel: stops a step; called for each step whose `dispatch` has not returned when the plan
            ends early. `execute` returns after all calls of `dispatch`.
        timeout: seconds that a step waits for its condition; None to wait without limit.
        speed: the time units of the plan per second.
        reason: the reason of all revisions; by default it names the step.
        replan: the arguments of `plan` for another plan: `{}`, or `{"engine": "lama"}`. Then the
            rest of the plan is validated after each relevant change, as by `KnowledgeBase.replan`.
            If it breaks, no further step begins; once none is running, the execution continues with
            another plan. A failed step still ends it.

    Returns:
        The outcome, with the step that ended the plan, and who broke which condition. Errors of
        `dispatch` are not raised.

    Raises:
        NoPlanError: with `replan`, the plan broke and there is no other; ended steps stay recorded.
        PlanError: there is no such plan; a step is not one of the domain, or cannot begin because
            it is running or has failed.
        PddlError: the text is not a plan.
        InvalidArgumentError: `speed` is not a positive number, or `dispatch` is not callable, or is
            a coroutine function, which needs `kant_sql.aio`.
        ReadOnlyError: this is a view of the past, or a transaction is open.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open))
        ...   (:action unlock :parameters ()
        ...     :precondition (not (open)) :effect (open)))''').revision
        2
        >>> print(kb.execute("(unlock)", print))
        (unlock)
        plan 1 succeeded, 1 of 1 steps done
        >>> print(kb.execute("(unlock)", print))
        plan 2 refused, 0 of 1 steps done
          (unlock): (not (open)): does not hold, since revision 5 by perception
    """
    return Executive(state, plan, dispatch, cancel, timeout, speed, reason, replan).run()


class _Said(NamedTuple):
    """The outcome of a step that did not succeed."""

    outcome: Outcome
    code: str | None = None
    text: str | None = None


def _failure(error: BaseException) -> _Said:
    code, text = type(error).__name__, ""
    with suppress(Exception):  # The error's own text may raise.
        text = str(error)
        code = str(getattr(error, "code", None) or code)
    code, text = (UNSTORABLE.sub("\ufffd", each) for each in (code, text))
    return _Said("failed", code, text or None)


def check_call(call: object, name: str) -> None:
    """Refuse a call that is no plain function, as threads await nothing."""
    optional_call(call, name)
    if iscoroutinefunction(call):
        # Otherwise, a step would count as done that has not begun.
        raise InvalidArgumentError(
            f"{name} is a coroutine function; give a function, which runs in a thread"
        )


@dataclass
class Executive:
    """Executes one plan, given as for `execute`."""

    state: State
    plan: GivenPlan
    dispatch: Dispatch
    cancel: Dispatch | None = None
    timeout: float | None = 0
    speed: float = 1
    reason: str | None = None
    replan: PlanOptions | None = None

    def __post_init__(self) -> None:
        expect(self.dispatch, Callable, "dispatch", InvalidArgumentError)  # type: ignore[arg-type]
        check_call(self.dispatch, "dispatch")
        check_call(self.cancel, "cancel")
        optional_text(self.reason, "the reason")
        if self.replan is not None:
            check_options(self.replan)
        if not 0 < expect(self.speed, (int, float), "speed", InvalidArgumentError) < math.inf:
            raise refusal("speed", "a number above 0", self.speed, InvalidArgumentError)
        self._patience, self._store = seconds(self.timeout), self.state.store
        refuse_unwatchable(self.state)
        self._take(self._recorded())
        self._replaced: list[str] = []
        self._why: str | None = None
        self._planning: Limit | None = None
        self._is_given_up = False
        self._running: dict[Key, Execution] = {}
        self._dispatched: dict[Key, Execution] = {}
        self._threads: list[threading.Thread] = []
        # The calls that other threads send to this one; it waits for them as long as the pause.
        self._asked: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self._pause: float | None = 0
        self._is_over = threading.Event()
        self._waits_since: float | None = None
        self._end: tuple[Outcome, Execution | None, tuple[BrokenInvariant, ...]] | None = None
        self._error: Exception | None = None

    def _recorded(self) -> RecordedPlan:
        """Return the plan as it is now; record it if it is not."""
        given, plans = read_any_plan(self.state, self.plan), SqlPlanDao(self._store)
        if not isinstance(given, RecordedPlan):
            return plans.record(given)
        if given is not self.plan:
            return given  # It was just read, by its id.
        # Its steps may have other outcomes than when it was read.
        now = plans.get(given.id)
        if now is None or not has_same_steps(now, given):
            raise PlanError(
                f"plan {given.id} is of another store, or a name was erased; read it again, or "
                "record it in this one"
            )
        return now

    def _take(self, plan: RecordedPlan) -> None:
        """Execute the rest of a plan from now on."""
        self._plan_id = plan.id
        self._left = deque(_steps_left(plan))
        self.size = len(self._left)
        # A plan that continues does so at once.
        is_whole = self.size == len(plan.steps)
        self._first = 0.0 if is_whole or not self._left else float(self._left[0].start or 0)
        self._remaining = Remaining(plan.id)

    def run(self) -> ExecutedPlan:
        """Execute the plan, in this thread and one more for each running step."""
        self._begun = time.monotonic()
        self._seen = head_revision(self.state)
        self._thread(self._watch, self._seen)
        try:
            self._do_what_is_asked()
            while not self._look():
                self._do_what_is_asked()
        except BaseException:
            # The store may be gone; then the running steps stay recorded as running.
            with suppress(KantSqlError):
                self._stop(None)
            raise
        finally:
            self._is_over.set()
            self._call_off()
        for thread in self._threads:
            thread.join()
        if self._error is not None:
            raise self._error
        return ExecutedPlan(
            *(self._end or ("succeeded", None, ())), self._plan(), (*self._replaced,)
        )

    def _plan(self) -> RecordedPlan:
        plan = SqlPlanDao(self._store).get(self._plan_id)
        assert plan is not None
        return plan

    def give_up(self) -> None:
        """End the plan, and abort its running steps."""
        self._is_given_up = True
        self._asked.put(partial(self._stop, None))
        planning = self._planning
        if planning is not None:
            planning.cancel()

    def _do_what_is_asked(self) -> None:
        with suppress(Empty):
            self._asked.get(timeout=self._pause)()
            while True:
                self._asked.get_nowait()()

    def _thread(self, work: Callable[..., None], *given: object) -> threading.Thread:
        run = partial(contextvars.copy_context().run, work, *given)
        thread = threading.Thread(target=run, name="kant_sql execute", daemon=True)
        thread.start()
        return thread

    def _watch(self, after: int) -> None:
        """Wake up for each revision of any writer; this ends half a second after the plan."""
        try:
            while not self._is_over.is_set():
                found = watch_until(self.state, after, None, self._is_over.is_set)
                after = after if found is None else found
                self._asked.put(bool)  # Any call wakes it up.
        except Exception as error:
            failed: futures.Future[None] = futures.Future()
            failed.set_exception(error)
            self._asked.put(failed.result)

    def _look(self) -> bool:
        """Look at running steps, begin new ones; return whether the plan is over."""
        if self._running and self._end is None:
            self._look_at_running()
        if self._end is None and self.replan is not None:
            self._look_ahead(self.replan)
        while self._end is None and self._begins():
            pass
        return self._end is not None or not (self._left or self._running)

    def _look_ahead(self, options: PlanOptions) -> None:
        """Check that the rest still works; if not, continue with another plan once none runs."""
        old = self._plan()
        self._why = self._why or self._remaining.look(self.state, old)[0]
        if self._why is None or self._running:
            return
        with limited() as self._planning:
            if self._is_given_up:
                # `give_up` came just before it could cancel this.
                self._planning.cancel()
            made = take_over(self.state, old, self._why, options)
        self._replaced.append(f"plan {old.id} broke: {self._why}")
        self._planning = self._why = None
        self._take(made)
        self._begun = time.monotonic()

    def _look_at_running(self) -> bool:
        """Check the running steps; return whether that ends the plan."""
        # With their present names: a name may have been erased meanwhile.
        running = {key_of(step): step for step in running_executions(self._store)}
        for key in self._running.keys() - running.keys():
            now = read_execution(self._store, key)
            if now.outcome != SUCCEEDED:
                self._stop(now)
                return True
        steps = [running[key] for key in self._running if key in running]
        # At each revision: a broken condition may hold again by now.
        for at in self._unseen():
            self._seen = at
            broken = self._broken_at(at, steps)
            if broken:
                step = broken[0].step
                self._fail(step, tuple(each for each in broken if each.step == step))
                return True
        return False

    def _broken_at(self, at: int, steps: Iterable[Execution]) -> list[BrokenInvariant]:
        """Find the conditions of steps that did not hold at a revision; none of an archived one."""
        begun = [one for one in steps if one.revision is None or one.revision <= at]
        try:
            return find_broken(self._store, begun, at) if begun else []
        except ArchivedError:
            return []  # The next revision decides.

    def _refuse_broken(self, step: Execution) -> None:
        """Refuse to end a step if a revision since the last look broke one of its conditions."""
        for at in self._unseen():
            broken = self._broken_at(at, [step])
            if broken:
                raise not_applicable(step, [each.unsatisfied for each in broken])

    def _unseen(self) -> Sequence[int]:
        """Return the revisions since the last look; of many, those that changed the state."""
        low, high = self._seen + 1, head_revision(self.state)
        if high - low < FEW:
            return range(low, high + 1)

        def read(session: Session, kb_id: int | None) -> list[int]:
            assert kb_id is not None
            changes = stream_changes(session, kb_id, low, high)
            return sorted({high, *(at for at, change in changes if change.kind in STATED)})

        return self._store.query_in_snapshot(read)

    def _begins(self) -> bool:
        """Begin the next step if it can begin; otherwise set how long to wait."""
        self._pause = None
        if self._why is not None or not self._left:
            return False
        step, now = self._left[0], time.monotonic()
        if any(_is_before(one, step) for one in self._running.values()):
            return False
        if step.start is not None:
            due = self._begun + (float(step.start) - self._first) / self.speed
            if due > now:
                self._pause = min(due - now, threading.TIMEOUT_MAX)
                return False
        try:
            return self._begin(step, now)
        except PlanError:
            self._left[0] = read_execution(self._store, key_of(step))
            if str(self._left[0]) == str(step):
                raise
            return self._begins()  # A name in it was erased meanwhile.

    def _begin(self, step: Execution, now: float) -> bool:
        """Begin a step; if it is refused, wait as long as it may wait, then end the plan."""
        try:
            begun = begin_running(self._store, step, self.reason)
        except _REFUSED as error:
            if self.replan is not None and self._remaining.look(self.state, self._plan())[0]:
                # Somebody changed it since we looked.
                self._pause = 0
                return False
            self._waits_since = now if self._waits_since is None else self._waits_since
            left = self._waits_since + self._patience - now
            if left > 0:
                self._pause = min(left, threading.TIMEOUT_MAX)
            else:
                broken = self._broken(step, error)
                why = "; ".join(str(each.unsatisfied) for each in broken)
                self._stop(refuse(self._store, step, why, self.reason), broken)
            return False
        self._waits_since = None
        key = key_of(self._left.popleft())
        self._running[key] = self._dispatched[key] = begun
        self._threads.append(self._thread(self._perform, begun))
        return True

    def _broken(self, step: Execution, error: KantSqlError) -> tuple[BrokenInvariant, ...]:
        """Find out why a step is refused, and who broke its conditions."""
        if not isinstance(error, NotApplicableError):
            failed = FailedCondition("the step", str(error))
            if isinstance(error, RuleViolatedError):
                why = f"rule {error.rule!r} refuses the effects"
                failed = FailedCondition(error.instance, why)
            return (BrokenInvariant(step, failed, None),)
        # A step that is already running is not a broken condition.
        since = (
            None if each.condition == str(step) else broken_since(self._store, step, each)
            for each in error.unsatisfied
        )
        return tuple(map(partial(BrokenInvariant, step), error.unsatisfied, since))

    def _perform(self, step: Execution) -> None:
        """Dispatch a step, and send its outcome to the main thread."""
        try:
            said = _Said("failed", text="dispatch returned False")
            made = self.dispatch(step)
            if isawaitable(made):
                if iscoroutine(made):
                    made.close()
                said = _Said("failed", text="dispatch returned an awaitable, which nobody awaits")
            elif made is not False:
                said = _Said("succeeded")
        except _CANCELLED:
            said = _Said("aborted")
        except BaseException as error:  # Nobody else waits for this thread.
            said = _failure(error)
        del self._dispatched[key_of(step)]
        self._asked.put(partial(self._conclude, step, said))

    def _conclude(self, step: Execution, said: _Said) -> None:
        key = key_of(step)
        if self._end is not None:
            return  # It was aborted meanwhile.
        now = read_execution(self._store, key)
        if now.outcome == RUNNING and said.outcome == SUCCEEDED:
            if self._look_at_running():
                return
            try:
                self._finish(now)
            except (*_REFUSED, PlanError) as error:
                if isinstance(error, NotApplicableError) and self._look_at_running():
                    return
                after = read_execution(self._store, key)
                if str(after) != str(now):  # A name in it was erased meanwhile.
                    self._conclude(step, said)
                    return
                if not isinstance(error, PlanError):
                    self._fail(step, self._broken(step, error))
                    return
                if after.outcome != SUCCEEDED:  # Somebody else has just ended it.
                    self._stop(step, said=_failure(error))
                    return
        elif now.outcome != SUCCEEDED:
            self._stop(now, said=said)
            return
        del self._running[key]

    def _finish(self, step: Execution) -> None:
        """Write the remaining effects of a step."""
        found = self._store.read_definitions(lambda known: ground(known, step))
        if found.action.is_durative:
            check = partial(self._refuse_broken, step)
            end_running(self._store, step, self.reason, check=check)
        else:
            apply(self.state, step, reason=self.reason)

    def _fail(self, step: Execution, broken: tuple[BrokenInvariant, ...]) -> None:
        why = "; ".join(str(each).removeprefix(f"{step}: ") for each in broken)
        self._stop(step, broken, _Said("failed", text=why))

    def _stop(
        self,
        by: Execution | None,
        broken: tuple[BrokenInvariant, ...] = (),
        said: _Said | None = None,
    ) -> None:
        """End the plan with a step, and abort the other running ones, in one revision."""
        if self._end is not None:
            return
        why = "the plan was cancelled" if by is None else f"{by} did not succeed"
        others = [step for key, step in self._running.items() if by is None or key != key_of(by)]
        with self._store.transaction(reason=self.reason or why):
            if by is not None:
                by = self._close(by, said) if said else by
            for step in others:
                self._close(step, _Said("aborted", text=why))
        if by is not None:
            by = read_execution(self._store, key_of(by))
        self._end = ("aborted" if by is None else by.outcome or "aborted"), by, broken
        self._running.clear()

    def _close(self, step: Execution, said: _Said) -> Execution:
        """Record how a step ended, unless somebody else has."""
        now = read_execution(self._store, key_of(step))
        if now.outcome != RUNNING:
            return now
        outcome, code, text = said
        return report(self.state, now, outcome=outcome, code=code, text=text)

    def _call_off(self) -> None:
        """Call `cancel` for the calls of `dispatch` that still run."""
        for step in [*self._dispatched.values()]:
            if self.cancel is not None:
                try:
                    self.cancel(step)
                except Exception as error:
                    self._error = self._error or error


def _steps_left(plan: RecordedPlan) -> list[Execution]:
    """Return the steps to execute, in the order of their times."""
    left = [step for step in plan.steps if step.outcome != SUCCEEDED]
    for step in left:
        if step.outcome is not None:
            raise PlanError(
                f"{step.place}, {step}, is {step.outcome}; only steps that were not begun can be "
                "executed: end the running ones, or make a new plan for the rest"
            )
    return sorted(left, key=lambda step: step.start or 0)


def _is_before(one: Execution, other: Execution) -> bool:
    """Return whether a step ends before another begins, by the plan."""
    if one.start is None or other.start is None:
        return True
    return one.start + (one.duration or 0) <= other.start
