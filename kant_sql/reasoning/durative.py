"""Execution of steps: at once, or a durative one in two halves, as robots do.

A durative step begins with its conditions and effects `at start`, and ends with those `at end`;
conditions `over all` hold from right after the start until right before the end (Fox and Long, PDDL
2.1, 2003, section 5). Each step is recorded as an execution, in the revision of its effects, so all
processes know which steps are running.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import partial
from typing import Any

from ..acts import Execution
from ..acts.executions import report
from ..acts.recording import (
    ExecutionReader,
    key_of,
    read_execution,
    read_running,
    running_executions,
    set_outcome,
)
from ..arguments import flag
from ..dto import formulas as f
from ..dto.elements import value_text
from ..dto.formulas import AT_END, AT_START, OVER_ALL
from ..dto.lexical import fold, number_text
from ..errors import (
    ArchivedError,
    InvalidKnowledgeError,
    NotApplicableError,
    PddlError,
    PlanError,
    UnknownRevisionError,
    UnsupportedConstructError,
)
from ..history.diff import diff
from ..history.revisions import Revision
from ..html import Listing
from ..knowledge.atoms import AtomKey, FluentKey, FluentValue
from ..knowledge.definitions import Definitions
from ..knowledge.resolved import AllOf
from ..sql.changes import ASSERTED, RETRACTED, Change
from ..sql.definition_rows import find_id
from ..sql.executions import ABORTED, REFUSED, RUNNING, SUCCEEDED, ExecutionDefinition, Key
from ..store.snapshot import View, read_position
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .act import begin, in_revision, step_text, view_of
from .effects import (
    Earlier,
    EffectReader,
    NewValues,
    StepChanges,
    new_values,
    not_applicable,
    objects_of,
)
from .explain import Explainer
from .failures import FailedCondition
from .promise import closed_nodes, duration_of, is_true, until_end
from .steps import CONTINUOUS, GroundStep, Step, ground
from .when import when

APPLIED = "applied"
_DURATION = re.compile(rf"\?{f.DURATION}(?![\w-])")


@dataclass(frozen=True)
class BrokenInvariant:
    """A condition of a step that does not hold, such as one `over all` of a running step.

    Attributes:
        step: the step.
        unsatisfied: the condition.
        since: the revision since which it does not hold, with its time, actor and reason; None
            within the transaction that broke it, or if the revision is in an archive.
    """

    step: Execution
    unsatisfied: FailedCondition
    since: Revision | None

    def __str__(self) -> str:
        said = "" if self.since is None else f", since revision {self.since.number}"
        who = "" if self.since is None or self.since.actor is None else f" by {self.since.actor}"
        return f"{self.step}: {self.unsatisfied}{said}{who}"


def apply(
    state: State,
    step: Step,
    *,
    reason: str | None = None,
    execution: Execution | None = None,
    record_refusal: bool = False,
) -> int | None:
    """Execute a step: check its conditions and write its effects, in one revision.

    Conditions and right-hand sides are evaluated in the state before, deletes come before adds,
    numbers are exact (PDDL 2.1). A durative action is executed at once: its start, its continuous
    effects for its duration, then its end, each with its conditions. The head is locked, so nothing
    changes between the check and the effects. The revision records the execution in
    `kb.executions`, even if the step changes nothing. A step of a recorded plan gets the outcome
    `succeeded`.

    Args:
        step: text such as `"(move rb1 hall kitchen)"`, with `[5]` for a duration, a
            `PlanStep`, a step of a recorded plan, or an `ActionInstance` of unified-planning.
        reason: the revision's reason; by default it names the step.
        execution: the running execution that the revision links to.
        record_refusal: whether to record a step that cannot be executed, with the outcome `refused`
            and the failing conditions; its revision has nothing else. Within an open transaction,
            the record is part of the transaction.

    Returns:
        The revision; None within an open transaction.

    Raises:
        NotApplicableError: a condition does not hold, a duration is not allowed, or a
            right-hand side has no value; nothing is written, unless the refusal is recorded.
        PlanError: the text gives a duration to an action without one, or the recorded step was
            already executed.
        PddlError, InvalidKnowledgeError: the step names an unknown element.
        UnsupportedConstructError: it is a process or an event, or has nonlinear continuous change.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open))
        ...   (:action unlock :parameters ()
        ...     :precondition (not (open)) :effect (open)))''').revision
        2
        >>> kb.apply("(unlock)", reason="the bell rang")
        3
        >>> print(*kb.why_not("(unlock)"))
        (not (open)): does not hold
    """
    store = state.store

    flag(record_refusal, "record_refusal", PlanError)
    refused: list[NotApplicableError] = []

    def attempt(transaction: Transaction, found: GroundStep) -> None:
        try:
            with transaction.scope():
                _apply(transaction, found)
        except NotApplicableError as error:
            given = step_text(step)
            if reason is None and transaction.metadata.reason == f"{APPLIED} {given}":
                said = f"refused {given}"
                transaction.metadata = transaction.metadata._replace(reason=said)
            _record(transaction, found, REFUSED, message=_why(error))
            refused.append(error)

    work = attempt if record_refusal else _apply
    made = in_revision(store, step, reason, execution, APPLIED, work)
    if refused:
        raise refused[0]
    return made


def _apply(transaction: Transaction, step: GroundStep) -> None:
    before = begin(view_of(transaction), step)
    earlier = before.earlier(step.action.items(AT_END)) if step.action.is_durative else {}
    before.write(transaction, AT_START)
    if step.action.is_durative:
        _finish(transaction, step, before.numbers, earlier)
    if step.recorded is None:
        _record(transaction, step, SUCCEEDED, before.numbers)
        return
    if step.action.is_durative:
        _set(transaction, step.recorded, RUNNING)
    elif step.recorded.outcome is None:
        set_outcome(transaction, step.recorded, RUNNING)
    _set(transaction, step.recorded, SUCCEEDED)


def _set(transaction: Transaction, execution: Execution, outcome: str) -> None:
    """Set an outcome; refuse if another writer has set one, because its effects are written."""
    if not set_outcome(transaction, execution, outcome):
        raise PlanError(f"{execution.place}, {execution}, is {outcome!r} already; read it again")


def _why(error: NotApplicableError) -> str:
    return "; ".join(map(str, error.unsatisfied))


def refuse(store: Store, step: Execution, why: str, reason: str | None) -> Execution:
    """Record that a step of a recorded plan was refused, in one revision; it stays open."""
    refused: list[Key] = []

    def work(transaction: Transaction, found: GroundStep) -> None:
        refused.append(_record(transaction, found, REFUSED, message=why))

    try:
        in_revision(store, step, reason, None, "refused", work)
    except InvalidKnowledgeError:  # Its action or an object is gone.
        with store.transaction(reason=reason or f"refused {step}", plan_step=key_of(step)):
            said: Any = {"arguments": step.arguments, "text": why}
            return report(State(store, None), step.action, outcome="refused", **said)
    return read_execution(store, refused[0])


def _record(
    transaction: Transaction,
    step: GroundStep,
    outcome: str,
    numbers: Mapping[str, Decimal] | None = None,
    message: str | None = None,
) -> Key:
    """Record a step without a plan."""
    given = (numbers or {}).get(f.DURATION, step.duration)
    duration = given if step.action.is_durative else None
    lasts = None if duration is None else number_text(duration)
    made = ExecutionDefinition(None, lasts, step.action.id, None, step.ids, str(step))
    said = () if message is None else (None, message)
    return transaction.executions.record(made, outcome, *said)


def _finish(
    transaction: Transaction,
    step: GroundStep,
    numbers: Mapping[str, Decimal],
    earlier: Earlier,
) -> None:
    """Execute the continuous effects and the second half of a durative step."""
    state = view_of(transaction)
    lost = until_end(state, step, numbers)
    if lost:
        raise not_applicable(step, lost)
    if step.action.items(CONTINUOUS):
        EffectReader(state, step, numbers).write(transaction, CONTINUOUS)
        state = view_of(transaction)
    found, wrong = duration_of(state, step, AT_END, numbers.get(f.DURATION))
    if wrong:
        raise not_applicable(step, wrong)
    if not is_true(state, step, AT_END, found):
        raise not_applicable(step, Explainer(state, found).failed(closed_nodes(step, AT_END)))
    EffectReader(state, step, found, earlier).write(transaction, AT_END)


def start(
    state: State, step: Step, *, reason: str | None = None, execution: Execution | None = None
) -> Execution:
    """Start a durative step: its conditions and effects `at start`, in one revision.

    Args:
        step: as for `apply`. Without a duration, it gets the one that a constraint fixes.
        reason: as for `apply`.
        execution: as for `apply`.

    Returns:
        The execution, with the outcome `running`.

    Raises:
        NotApplicableError: the step cannot begin (see `why_not`), its duration violates a
            constraint by more than 0.01, or the same step is already running.
        PlanError: the action has no duration.
        UnsupportedConstructError: as `apply`.
        PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open) (busy))
        ...   (:durative-action unlock :parameters () :duration (= ?duration 3)
        ...     :condition (over all (busy))
        ...     :effect (and (at start (busy)) (at end (open)))))''').revision
        2
        >>> step = kb.start("(unlock)")
        >>> step.outcome, step.duration, kb.holds("(busy)"), kb.holds("(open)")
        ('running', Decimal('3'), True, False)
        >>> step = kb.end(step)
        >>> step.outcome, step.revision
        ('succeeded', 4)
        >>> kb.holds("(open)")
        True
    """
    return begin_running(state.store, step, reason, execution, check=_check_durative)


def begin_running(
    store: Store,
    step: Step,
    reason: str | None,
    execution: Execution | None = None,
    *,
    check: Callable[[GroundStep], None] | None = None,
) -> Execution:
    """Start a step; one without duration has all effects at its end, which `apply` executes."""
    started: list[Key] = []

    def work(transaction: Transaction, found: GroundStep) -> None:
        if check is not None:
            check(found)
        running = _find(running_executions(store), found)
        if running is not None:
            reason_ = f"it is running: {running.place}"
            raise not_applicable(found, [FailedCondition(str(found), reason_)])
        effects = begin(view_of(transaction), found)
        if found.action.is_durative:
            effects.write(transaction, AT_START)
        if found.recorded is None:
            started.append(_record(transaction, found, RUNNING, effects.numbers))
        else:
            set_outcome(transaction, found.recorded, RUNNING)
            started.append(key_of(found.recorded))

    in_revision(store, step, reason, execution, "started", work)
    return read_execution(store, started[0])


def end(
    state: State, step: Step, *, reason: str | None = None, execution: Execution | None = None
) -> Execution:
    """End a running step: its conditions and effects `at end`, in one revision.

    Continuous effects come first: their rates in this state, times the duration that was recorded
    at the start, not the time on the clock. Until then, readers see numbers as last written.
    Conditions `over all` must hold throughout that change, until right before the end; conditions
    and effects `at end` see the changed numbers.

    Args:
        step: the result of `start`, or as for `apply`; its duration is that of the start.
        reason: as for `apply`.
        execution: as for `apply`.

    Returns:
        The execution, with the outcome `succeeded`.

    Raises:
        NotApplicableError: a condition `over all` or `at end` does not hold.
        PlanError: the step is not running.
        PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.
    """
    return end_running(state.store, step, reason, execution)


def end_running(
    store: Store,
    step: Step,
    reason: str | None,
    execution: Execution | None = None,
    *,
    check: Callable[[], None] | None = None,
) -> Execution:
    """End a step, unless a check under the lock of the head refuses it."""
    running, of_start = _running(store, step)
    _check_durative(of_start)

    def work(transaction: Transaction, found: GroundStep) -> None:
        if check is not None:
            check()
        given = {} if running.duration is None else {f.DURATION: running.duration}
        earlier = _earlier(transaction, store, running, found)
        _finish(transaction, found, given, earlier)
        _set(transaction, running, SUCCEEDED)

    in_revision(store, running, reason, execution, "ended", work)
    return read_execution(store, key_of(running))


def abort(state: State, step: Step, *, reason: str | None = None, undo: bool = False) -> Aborted:
    """Abort a running step: it gets the outcome `aborted`.

    The changes of its start stay, and the result lists those that remain. With `undo`, it reverts
    them in the same revision, if nothing else changed them since.

    Args:
        step: as for `end`.
        reason: the revision's reason.
        undo: whether to revert the changes of the start.

    Returns:
        The execution, with the outcome `aborted`, and its remaining and reverted changes.

    Raises:
        PlanError: the step is not running; or with `undo`, something else has changed the same
            elements, which the error names, or deleted elements that they name, or the state before
            is unknown. Nothing is written.
        PddlError, InvalidKnowledgeError, ReadOnlyError: as `apply`.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open) (busy))
        ...   (:durative-action unlock :parameters () :duration (= ?duration 3)
        ...     :effect (and (at start (busy)) (at end (open)))))''').revision
        2
        >>> print(kb.abort(kb.start("(unlock)")))
        (unlock) was aborted; it leaves +(busy)
        >>> _ = kb.propositions.delete_all()
        >>> print(kb.abort(kb.start("(unlock)"), undo=True))
        (unlock) was aborted, and +(busy) taken back
    """
    store = state.store
    flag(undo, "undo", PlanError)
    running, _ = _running(store, step)
    effects: list[_Effect] | None = []
    left: list[Change] = []

    def work(transaction: Transaction, found: GroundStep) -> None:
        nonlocal effects
        # A step without duration has all its effects at its end.
        effects = start_effects(store, running) if found.action.is_durative else []
        if undo:
            take_back(transaction, running, effects)
        stands = standing(transaction, effects or [])
        for effect, is_so in zip(effects or [], stands, strict=True):
            left.extend(effect.changes if is_so else ())
        set_outcome(transaction, running, ABORTED)

    done = "aborted and undid" if undo else "aborted"
    in_revision(store, running, reason, None, done, work)
    undone = tuple(each for effect in effects or [] for each in effect.changes) if undo else ()
    now = vars(read_execution(store, key_of(running)))
    return Aborted(**now, left=None if effects is None else tuple(left), undone=undone)


def _check_durative(step: GroundStep) -> None:
    if not step.action.is_durative:
        raise PlanError(
            f"{step} is of an action without duration, which happens at once: use kb.apply(step)"
        )


def _find(running: list[Execution], step: GroundStep) -> Execution | None:
    names = [fold(name) for name in (step.action.name, *step.names)]
    for each in running:
        if step.recorded is not None and key_of(each) == key_of(step.recorded):
            return each
        if [fold(name) for name in (each.action, *each.arguments)] == names:
            return each
    return None


def _running(store: Store, step: object) -> tuple[Execution, GroundStep]:
    """Find a running step."""

    def read(view: View) -> tuple[GroundStep, list[Execution]]:
        return ground(view.definitions, step), read_running(store, view)

    try:
        found, running = store.read_in_snapshot(read)
    except InvalidKnowledgeError as error:
        if not isinstance(step, Execution):
            raise
        # Its action or an object is gone.
        remedy = "kb.executions.report(step, outcome='aborted') or kb.fail(step) ends it"
        raise InvalidKnowledgeError(f"{error}; {remedy}") from error
    recorded = _find(running, found)
    if recorded is None:
        _check_durative(found)
        others = ", ".join(str(each) for each in running) or "none"
        raise PlanError(f"{found} is not running: start it first; running are: {others}")
    if found.duration not in (None, recorded.duration):
        said = "without a duration" if recorded.duration is None else f"[{recorded.duration:f}]"
        raise PlanError(f"{found} was started {said}, not [{found.duration:f}]; leave it out")
    return recorded, found


def _earlier(transaction: Transaction, store: Store, step: Execution, found: GroundStep) -> Earlier:
    """Find the objects from the state before the start that the effects at the end need."""
    items = found.action.items(AT_END)
    if all(each.earlier == AllOf(()) for each in items):
        return {}
    # Without a committed outcome, this transaction has started it.
    of_start = step.outcomes[-1].since.number if step.outcomes else transaction.number
    # By the present definitions: that of the action may have changed, and need others, since.
    known = found.action.definitions

    def read(view: View) -> Earlier:
        return EffectReader(view._replace(definitions=known), found, {}).earlier(items)

    return store.read_in_snapshot(read, of_start - 1)


def broken_invariants(state: State) -> list[BrokenInvariant]:
    """Return the conditions `over all` of running steps that do not hold.

    Returns:
        The conditions, each with its step, and the revision since which it does not hold.

    Raises:
        PlanError: this is a view of the past.
    """
    store, at = state
    if at is not None:
        raise PlanError("running steps are of the present: ask the knowledge base, not kb.at(...)")
    return Listing(find_broken(store, running_executions(store)), "broken invariant")


def find_broken(
    store: Store, running: Iterable[Execution], at: int | None = None
) -> list[BrokenInvariant]:
    """Return the conditions `over all` of steps that do not hold now, or at a revision."""

    def work(view: View) -> list[tuple[Execution, FailedCondition]]:
        found: list[tuple[Execution, FailedCondition]] = []
        asked: list[tuple[Execution, list[f.Formula], bool]] = []
        for step in running:
            try:
                of_step = _present(store, view, step)
            except InvalidKnowledgeError as error:  # Its action or an object is gone.
                found.append((step, FailedCondition("the step", str(error))))
                continue
            nodes = closed_nodes(of_step, OVER_ALL) if of_step.action.is_durative else []
            asked.append((step, nodes, f.Variable(f.DURATION) in f.walk(*nodes)))
        # Usually all hold: together they take few statements.
        alike = [node for _, nodes, is_own in asked if not is_own for node in nodes]
        do_hold = not Explainer(view).failed_nodes(alike)
        for step, nodes, is_own in asked:
            if is_own or not do_hold:
                numbers = {} if step.duration is None else {f.DURATION: step.duration}
                found += [(step, failed) for failed in Explainer(view, numbers).failed(nodes)]
        return found

    broken = store.read_in_snapshot(work, at)
    return [BrokenInvariant(step, one, broken_since(store, step, one, at)) for step, one in broken]


def _present(store: Store, view: View, step: Execution) -> GroundStep:
    """Find the objects of a step, also if a name was erased after the step was read."""
    try:
        return ground(view.definitions, step)
    except InvalidKnowledgeError:
        now = ExecutionReader(store, view).one(key_of(step))
        if now is None or str(now) == str(step):
            raise
        return ground(view.definitions, now)


def broken_since(
    store: Store, step: Execution, failed: FailedCondition, at: int | None = None
) -> Revision | None:
    """Return the revision since which a condition of a step does not hold."""
    if failed.retracted is not None:
        return failed.retracted
    condition = failed.condition
    if step.duration is not None:
        condition = _DURATION.sub(f"{step.duration:f}", condition)
    if not any(map(str.isalpha, condition)):
        return None  # It compares the duration with a number: nobody broke it.
    position = store.query_known(read_position, None)
    archived = position and position.archived
    try:
        periods = when(State(store, at), f"(not {condition})", since=archived or None)
    except (InvalidKnowledgeError, UnsupportedConstructError):
        return None  # It is an unknown name, a rule, or a missing value, not a condition.
    except UnknownRevisionError:
        return None  # An archive has just taken it.
    return periods[-1].since if periods and periods[-1].until is None else None


@dataclass(frozen=True)
class Aborted(Execution):
    """An aborted step, and its remaining changes.

    Attributes:
        left: the remaining changes of its start, as in a log; None if they are unknown, because the
            state before the start is in an archive, or was not committed.
        undone: the reverted changes of its start.
    """

    left: tuple[Change, ...] | None
    undone: tuple[Change, ...] = ()

    def __str__(self) -> str:
        step = super().__str__()
        if self.undone:
            return f"{step} was aborted, and {_listed(self.undone)} taken back"
        if self.left is None:
            return f"{step} was aborted; what it leaves is not known"
        return f"{step} was aborted; it leaves {_listed(self.left) or 'nothing'}"


def _listed(changes: tuple[Change, ...]) -> str:
    return ", ".join(f"{change.sign}{change.text}" for change in changes)


@dataclass(frozen=True)
class _Effect:
    """The change of one element by the start of a step."""

    key: AtomKey | FluentKey  # the fact or the fluent
    before: bool | FluentValue | None  # whether the fact held, or the value, before
    after: bool | FluentValue | None  # the same since
    changes: tuple[Change, ...]  # the changes as in a log
    is_alone: bool = True  # whether it is the only change of the element in that revision


def start_effects(store: Store, step: Execution) -> list[_Effect] | None:
    """Find the changes of the start of a running step; None if the state before is unknown."""
    if not step.outcomes:
        return None
    number = step.outcomes[-1].since.number

    def work(view: View) -> tuple[StepChanges, dict[AtomKey, str], NewValues]:
        found = ground(view.definitions, step)
        numbers = {} if step.duration is None else {f.DURATION: step.duration}
        read = EffectReader(view, found, numbers).read(found.action.items(AT_START))
        deleted = {key: key.text(view.definitions) for key in read.deletes if key not in read.adds}
        return read, {**read.adds, **deleted}, new_values(view, read)

    try:
        read, texts, values = store.read_in_snapshot(work, number - 1)
        changes = diff(State(store, None), number - 1, number)
        lines = {(each.sign, each.text): each for each in changes}
    except (ArchivedError, InvalidKnowledgeError, NotApplicableError, PddlError):
        # Archived, or the revision of the start declares what it needs.
        return None
    return [*_facts(read, texts, lines), *_values(store, read, lines, values)]


_Lines = dict[tuple[str, str], Change]


def _facts(read: StepChanges, texts: dict[AtomKey, str], lines: _Lines) -> Iterator[_Effect]:
    for key, text in texts.items():
        is_added = key in read.adds
        line = lines.get((ASSERTED if is_added else RETRACTED, text))
        if line is not None:
            yield _Effect(key, not is_added, is_added, (line,))


def _values(store: Store, read: StepChanges, lines: _Lines, values: NewValues) -> Iterator[_Effect]:
    for key, (text, made) in read.assignments.items():
        (number, expected), begin = values[key], value_text(text, "")[:-1]
        found = {
            sign: (
                line,
                FluentValue.of(text, line.text, _object(store, line.text[len(begin) : -1])),
            )
            for (sign, _), line in lines.items()
            if line.text.startswith(begin)
        }
        if not found and (number == expected or any(isinstance(by, int) for _, by in made)):
            continue
        (before, after) = (
            found[sign][1] if sign in found else None for sign in (RETRACTED, ASSERTED)
        )
        is_alone = after is not None and _is(after, expected)
        yield _Effect(key, before, after, tuple(line for line, _ in found.values()), is_alone)


def _is(value: FluentValue, expected: Decimal | int | FailedCondition) -> bool:
    if isinstance(expected, int):
        return value.object_id == expected
    return isinstance(expected, Decimal) and value.is_same(FluentValue(str(expected)))


def _object(store: Store, text: str) -> int | None:
    """Return the object that is or was a value, even a deleted one; None for a number."""
    read = partial(find_id, kind="object", name=text)
    return store.query_known(read, None, in_snapshot=False)


def _can_be_again(definitions: Definitions, effect: _Effect) -> bool:
    """Return whether the fact or value before a start is still possible: by its names."""
    key, before = effect.key, effect.before
    if not before:
        return True
    ids = [*objects_of(key)]
    if isinstance(before, FluentValue) and before.object_id is not None:
        ids.append(before.object_id)
    owners: Any = definitions.predicates if isinstance(key, AtomKey) else definitions.functions
    owner = owners.get(key.predicate_id if isinstance(key, AtomKey) else key.function_id)
    if owner is None or None in map(definitions.objects.get, ids):
        return False
    return definitions.admits(owner, ids)


def standing(transaction: Transaction, effects: list[_Effect]) -> list[bool]:
    """Return which effects remain."""
    atoms = transaction.propositions.find([e.key for e in effects if isinstance(e.key, AtomKey)])
    fluents = transaction.values.find([e.key for e in effects if isinstance(e.key, FluentKey)])
    found = []
    for effect in effects:
        if isinstance(effect.key, AtomKey):
            atom = atoms.get(effect.key)
            holds = atom is not None and transaction.propositions.holds(atom)
            found.append(holds == effect.after)
            continue
        fluent = fluents.get(effect.key)
        value = None if fluent is None else transaction.values.value(fluent)
        after = effect.after
        is_same = value.is_same(after) if value and isinstance(after, FluentValue) else False
        found.append(is_same or value is after)
    return found


def take_back(transaction: Transaction, step: Execution, effects: list[_Effect] | None) -> None:
    """Revert the changes of the start of a step, unless something else has changed them."""
    if effects is None:
        raise PlanError(
            f"{step} cannot be undone: the state before its start is archived or not committed; "
            "abort it without undo, and correct its changes"
        )
    stands = standing(transaction, effects)
    others = [e for e, is_so in zip(effects, stands, strict=True) if not (is_so and e.is_alone)]
    if others:
        texts = ", ".join(f"{line.sign}{line.text}" for each in others for line in each.changes)
        raise PlanError(
            f"{step} cannot be undone: the changes of its start were overwritten ({texts}); "
            "nothing was written: abort it without undo, and correct its changes"
        )
    known = transaction.definitions.current()
    if gone := [each for each in effects if not _can_be_again(known, each)]:
        texts = ", ".join(f"{line.sign}{line.text}" for each in gone for line in each.changes)
        raise PlanError(
            f"{step} cannot be undone: what its start changed names what was deleted or redefined "
            f"since ({texts}); nothing was written: abort it without undo, and correct its changes"
        )
    atoms = transaction.propositions.find([e.key for e in effects if isinstance(e.key, AtomKey)])
    fluents = transaction.values.find([e.key for e in effects if isinstance(e.key, FluentKey)])
    for effect in effects:
        if isinstance(effect.key, AtomKey):
            transaction.propositions.set(atoms[effect.key], bool(effect.before))
        else:
            assert not isinstance(effect.before, bool)
            transaction.values.spell(fluents[effect.key], effect.before)
