"""Executing steps: at once, or a durative one in two halves, as robots do.

A durative step begins with its conditions and effects `at start`, and ends with those `at end`;
what is `over all` holds from right after the start until right before the end (Fox and Long, PDDL
2.1, 2003, section 5). A running step is a step of a recorded plan with the status `started`, so all
processes know it; a step of no plan is recorded as a plan of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from ..arguments import flag
from ..dto import formulas as f
from ..dto.formulas import AT_END, AT_START, OVER_ALL
from ..dto.lexical import fold
from ..errors import PlanError
from ..history.revisions import Revision
from ..knowledge.conditions import AllOf
from ..planning import PlanStep
from ..plans.dao import place_of, record_step, running_steps, set_status
from ..plans.interfaces import RecordedStep
from ..sql.changes import Change
from ..store.snapshot import View
from ..store.store import Store
from ..store.transaction import Transaction
from .act import Stepper, begin, in_revision, state_of
from .effects import Earlier, not_applicable
from .explain import Explainer
from .failures import FailedCondition
from .promise import closed_nodes, duration_of, until_end
from .steps import CONTINUOUS, GroundStep, ground
from .undo import Aborted, standing, start_effects, undo
from .when import when


@dataclass(frozen=True)
class BrokenInvariant:
    """A condition `over all` of a running step that does not hold.

    Attributes:
        step: the running step.
        unsatisfied: the condition.
        since: the revision since which it does not hold, with its time, actor and reason; None
            within a transaction that broke it.
    """

    step: RecordedStep
    unsatisfied: FailedCondition
    since: Revision | None

    def __str__(self) -> str:
        said = "" if self.since is None else f", since revision {self.since.number}"
        who = "" if self.since is None or self.since.actor is None else f" by {self.since.actor}"
        return f"{self.step}: {self.unsatisfied}{said}{who}"


def apply(
    store: Store, step: object, reason: str | None, plan_step: RecordedStep | None
) -> int | None:
    """Execute a step, in one revision."""

    def work(transaction: Transaction, found: GroundStep) -> None:
        before = begin(state_of(transaction), found)
        earlier = before.earlier() if found.action.is_durative else None
        before.execute(transaction, AT_START)
        if found.action.is_durative:
            _finish(transaction, found, before.numbers, earlier)
        if found.recorded is not None:
            if found.recorded.status is None:
                set_status(transaction, found.recorded, "started")
            set_status(transaction, found.recorded, "succeeded")

    return in_revision(store, step, reason, plan_step, "applied", work)


def _finish(
    transaction: Transaction,
    step: GroundStep,
    numbers: Mapping[str, Decimal],
    earlier: Earlier | None,
) -> None:
    """Execute what is continuous, and the second half of a durative step."""
    state = state_of(transaction)
    lost = until_end(state, step, numbers)
    if lost:
        raise not_applicable(step, lost)
    if step.action.items(CONTINUOUS):
        Stepper(state, step, numbers).execute(transaction, CONTINUOUS)
        state = state_of(transaction)
    found, wrong = duration_of(state, step, AT_END, numbers.get(f.DURATION))
    if wrong:
        raise not_applicable(step, wrong)
    after = Stepper(state, step, found)
    after.check(AT_END)
    after.execute(transaction, AT_END, earlier)


def start(
    store: Store, step: object, reason: str | None, plan_step: RecordedStep | None
) -> RecordedStep:
    """Execute the first half of a durative step."""
    started: list[RecordedStep] = []

    def work(transaction: Transaction, found: GroundStep) -> None:
        _check_durative(found)
        running = _find(running_steps(store), found)
        if running is not None:
            reason_ = f"it is running: step {running.position} of plan {running.plan_id}"
            raise not_applicable(found, [FailedCondition(str(found), reason_)])
        stepper = begin(state_of(transaction), found)
        stepper.execute(transaction, AT_START)
        recorded = found.recorded
        if recorded is None:
            duration = stepper.numbers.get(f.DURATION)
            whole = PlanStep(None, found.action.name, found.names, duration)
            recorded = record_step(store, transaction, whole)
            _link(transaction, recorded)
        set_status(transaction, recorded, "started")
        started.append(recorded)

    in_revision(store, step, reason, plan_step, "started", work)
    place = place_of(started[0])
    return next((each for each in running_steps(store) if place_of(each) == place), started[0])


def _link(transaction: Transaction, step: RecordedStep) -> None:
    """Link the revision to a step that it records."""
    if transaction.metadata.plan_step is None:
        # The link refers to the step's row.
        transaction.flush()
        transaction.metadata = transaction.metadata._replace(plan_step=place_of(step))


def end(
    store: Store, step: object, reason: str | None, plan_step: RecordedStep | None
) -> int | None:
    """Execute the second half of a durative step."""
    running, earlier = _running(store, step)

    def work(transaction: Transaction, found: GroundStep) -> None:
        given = {} if running.duration is None else {f.DURATION: running.duration}
        _finish(transaction, found, given, earlier)
        set_status(transaction, running, "succeeded")

    return in_revision(store, running, reason, plan_step, "ended", work)


def abort(store: Store, step: object, reason: str | None, undoes: bool) -> Aborted:
    """Abort a running step; what its start changed stays, unless it is taken back."""
    flag(undoes, "undo", PlanError)
    running, _ = _running(store, step)
    effects = start_effects(store, running)
    left: list[Change] = []

    def work(transaction: Transaction, found: GroundStep) -> None:
        del found
        if undoes:
            undo(transaction, running, effects)
        stands = standing(transaction, effects or [])
        for effect, is_so in zip(effects or [], stands, strict=True):
            left.extend(effect.changes if is_so else ())
        set_status(transaction, running, "aborted")

    done = "aborted and undid" if undoes else "aborted"
    made = in_revision(store, running, reason, None, done, work)
    undone = tuple(each for effect in effects or [] for each in effect.changes) if undoes else ()
    return Aborted(running, made, None if effects is None else tuple(left), undone)


def _check_durative(step: GroundStep) -> None:
    if not step.action.is_durative:
        raise PlanError(
            f"{step} is of an action without duration, which happens at once: use kb.apply(step)"
        )


def _find(running: list[RecordedStep], step: GroundStep) -> RecordedStep | None:
    names = [fold(name) for name in (step.action.name, *step.names)]
    for each in running:
        if step.recorded is not None and place_of(each) == place_of(step.recorded):
            return each
        if [fold(name) for name in (each.action, *each.arguments)] == names:
            return each
    return None


def _running(store: Store, step: object) -> tuple[RecordedStep, Earlier]:
    """Find a running step, and what its effects at the end need of the state before its start."""
    found = store.read_definitions(lambda definitions: ground(definitions, step))
    _check_durative(found)
    running = running_steps(store)
    recorded = _find(running, found)
    if recorded is None:
        others = ", ".join(str(each) for each in running) or "none"
        raise PlanError(f"{found} is not running: start it first; running are: {others}")
    if found.duration not in (None, recorded.duration):
        said = "without a duration" if recorded.duration is None else f"[{recorded.duration:f}]"
        raise PlanError(f"{found} was started {said}, not [{found.duration:f}]; leave it out")
    items = found.action.items(AT_END)
    if not recorded.outcomes or all(each.earlier == AllOf(()) for each in items):
        return recorded, {}

    def work(view: View) -> Earlier:
        then = ground(view.definitions, recorded)
        held = Stepper(view, then).earlier()
        # The same effects, as the present state has them.
        places = {id(item): n for n, item in enumerate(then.action.items(AT_END))}
        return {id(items[places[key]]): rows for key, rows in held.items()}

    before = recorded.outcomes[-1].since.number - 1
    return recorded, store.read_in_snapshot(work, before)


def broken_invariants(store: Store, at: int | None) -> list[BrokenInvariant]:
    """Return the conditions over all of running steps that do not hold."""
    if at is not None:
        raise PlanError("running steps are of the present: ask the knowledge base, not kb.at(...)")
    running = running_steps(store)

    def work(view: View) -> list[tuple[RecordedStep, FailedCondition]]:
        found = []
        for step in running:
            of_step = ground(view.definitions, step)
            nodes = closed_nodes(of_step, OVER_ALL)
            numbers = {} if step.duration is None else {f.DURATION: step.duration}
            found += [(step, failed) for failed in Explainer(view, numbers).failed(nodes)]
        return found

    broken = store.read_in_snapshot(work)
    return [BrokenInvariant(step, failed, broken_since(store, failed)) for step, failed in broken]


def broken_since(store: Store, failed: FailedCondition) -> Revision | None:
    """Return the revision since which a condition does not hold."""
    if failed.retracted is not None:
        return failed.retracted
    periods = when(store, f"(not {failed.condition})", None, None, None, {}, None)
    return periods[-1].since if periods and periods[-1].until is None else None
