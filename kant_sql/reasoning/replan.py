"""Keeps a plan valid while the world changes.

The rest of a plan is validated from the present state when a change touches something that it still
needs: a fact or a fluent that a condition, an effect or the goal reads, or a definition. A new plan
is made only if it broke.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypedDict, Unpack

from .. import html
from ..acts import Execution
from ..acts.executions import report
from ..arguments import refusal
from ..documents.carry import STATED, name_in
from ..documents.exchange import PlanningTask, read_task
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import ArchivedError, InvalidArgumentError, PlanError
from ..history.moments import head_revision
from ..history.revisions import LARGEST
from ..knowledge.grounding import bound, substitute
from ..pddl.document import DURATIVE_ACTION, Action
from ..planning import Plan
from ..plans import RecordedPlan
from ..plans.dao import SqlPlanDao, last_plan
from ..sql.changes import ARCHIVE, Change, stream_changes
from ..sql.dialects.base import Session
from ..sql.executions import RUNNING, SUCCEEDED
from ..sql.rows import FACT, VALUE
from ..store.snapshot import read_position
from ..store.state import State
from ..store.store import Store
from . import search
from .validate import Validation, check_validated, read_any_plan, validate_plan

# `take_over` writes this text for steps that another plan replaces.
_TOOK_PLACE = re.compile(r"plan (\d+) took its place", re.ASCII)
# A fact or a value, its predicate or function, and each argument; None for any object.
_Need = tuple[str, str, tuple[str | None, ...]]
_Needs = frozenset[_Need]
_Actions = dict[str, Action]


class PlanOptions(TypedDict, total=False):
    """How to plan: the arguments of `KnowledgeBase.plan`, by name."""

    engine: str | None
    engines: Iterable[str] | None
    keep: Literal["first", "best"]
    costs: Literal["history"] | None
    timeout: float | None
    memory: int | None
    strict: bool


@dataclass(frozen=True)
class Replanned:
    """A plan to continue with.

    Attributes:
        plan: the recorded plan: the given one, its replacement, or a new one.
        broken: why the given plan broke; None if it is kept.
        is_validated: whether the rest was validated; False if no change since the last call
            touches what it needs.
    """

    plan: RecordedPlan
    broken: str | None
    is_validated: bool

    def __str__(self) -> str:
        if self.broken is not None:
            return f"plan {self.plan.id}, as the one before broke: {self.broken}"
        how = "is valid" if self.is_validated else "needs nothing that changed"
        return f"plan {self.plan.id}, the rest {how}"

    def _repr_html_(self) -> str:
        return html.lines(str(self))


def replan(
    state: State, plan: RecordedPlan | int | None = None, **options: Unpack[PlanOptions]
) -> Replanned:
    """Keep a plan that still works, or find another one.

    The steps of a recorded plan that have not succeeded are validated from the present state, as
    `validate` does. If they still reach the goals, the plan is kept. If not, or if a step failed,
    was aborted or was refused, another plan is found and recorded; the steps of the old one that
    have not begun are aborted, in the same revision.

    Call it after each change (`watch`): this process remembers what the plan needs, and validates
    only if a change touches it: a fact or a value that a condition, an effect or the goal reads, a
    goal, a constraint or a definition. `execute(..., replan={})` does all this for you.

    Args:
        plan: a recorded plan or its id; None for the last recorded one. If another plan has
            replaced it, that one counts.
        options: how to plan, as for `plan`.

    Returns:
        The plan to continue with, and why the old one broke.

    Raises:
        PlanError: there is no such plan, or it broke while one of its steps is running: end or
            abort that step first; or this transaction has changed the state: commit it first.
        InvalidArgumentError: an option is not one of `plan`.
        NoPlanError, PlannerMissingError, UnsupportedConstructError: as for `plan`; nothing was
            written.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open))
        ...   (:action unlock :parameters () :effect (open)))''').revision
        2
        >>> kb.load_problem('''(define (problem enter) (:domain doors)
        ...   (:init) (:goal (open)))''').revision
        3
        >>> plan = kb.plans.record(kb.plan("pyperplan"))
        >>> print(kb.replan())
        plan 1, the rest is valid
        >>> kb.propositions.save("(open)")
        True
        >>> print(kb.replan(plan))
        plan 1, the rest is valid
    """
    check_options(options)
    given, remembered = _recorded(state, plan), state.store.remembered
    # Removed, so no two threads have it.
    remaining = remembered.pop(Remaining, None)
    if remaining is None or remaining.plan_id != given.id:
        # Earlier plans are over.
        remaining = Remaining(given.id)
    broken, is_validated = remaining.look(state, given)
    remembered[Remaining] = remaining
    if broken is None:
        return Replanned(given, None, is_validated)
    given = _as_now(state, given)
    _refuse_running(given, broken)
    return Replanned(take_over(state, given, broken, options), broken, True)


def _refuse_running(plan: RecordedPlan, why: str) -> None:
    """Refuse to replace a plan with a running step."""
    runs = next((step for step in plan.steps if step.outcome == RUNNING), None)
    if runs is not None:
        raise PlanError(
            f"plan {plan.id} broke while {runs.place}, {runs}, runs: {why}; end or abort that "
            "step, and plan again"
        )


def check_options(options: object) -> None:
    """Refuse options that `plan` does not take, before they are needed."""
    known = PlanOptions.__annotations__
    expected = f"a dict of arguments of kb.plan ({', '.join(known)})"
    if not isinstance(options, dict) or not options.keys() <= known.keys():
        raise refusal("replan", expected, options, InvalidArgumentError)


def _recorded(state: State, plan: RecordedPlan | int | None) -> RecordedPlan:
    """Read the present version of a recorded plan."""
    number = last_plan(state.store) if plan is None else plan
    if number is None:
        raise PlanError(
            f"knowledge base {state.store.name!r} has no plan; record one with kb.plans.record"
        )
    given = read_any_plan(state, number.id if isinstance(number, RecordedPlan) else number)
    if not isinstance(given, RecordedPlan):
        raise PlanError("only what is left of a recorded plan is known; see kb.plans.record")
    return _successor(state, given)


def _successor(state: State, plan: RecordedPlan) -> RecordedPlan:
    """Return the plan that replaced this one, or the last of its successors, or this one."""
    found: RecordedPlan | None = plan
    while found is not None:
        plan = found
        said = (_TOOK_PLACE.fullmatch(step.text or "") for step in plan.steps if _has_ended(step))
        number = next((int(match[1]) for match in said if match), 0)
        found = SqlPlanDao(state.store).get(number) if number > plan.id else None
    return plan


def take_over(state: State, old: RecordedPlan, why: str, options: PlanOptions) -> RecordedPlan:
    """Find and record a replacement for a broken plan."""
    is_within = state.store.current() is not None
    found = search.plan(state, **options)
    try:
        return _record(state, old, why, found, is_within=is_within)
    except (PlanError, ArchivedError):
        known = state.store.query(read_position)
        if is_within or max(known.erased or 0, known.archived) <= (found.revision or 0):
            raise
    # The state that the planner was given was archived, or a name in it erased: look again.
    now = _as_now(state, old)
    broken, _ = Remaining(old.id).look(state, now)
    return now if broken is None else take_over(state, now, broken, options)


def _record(
    state: State, old: RecordedPlan, why: str, found: Plan, *, is_within: bool
) -> RecordedPlan:
    """Record a replacement; the steps of the old plan that have not begun are aborted."""
    dao = SqlPlanDao(state.store)
    with state.store.transaction(reason=f"plan {old.id} broke: {why}"):
        # Others may have begun a step, or replaced the plan, while the planner worked.
        old = _as_now(state, old)
        other = _successor(state, old)
        if other.id != old.id:
            return other
        _refuse_running(old, why)
        try:
            made = dao.record(found)
        except PlanError as error:
            if not is_within:
                raise
            # A recorded plan can only be made from a committed state.
            raise PlanError(
                f"plan {old.id} broke: {why}; commit this transaction, and then plan again"
            ) from error
        text = f"plan {made.id} took its place"
        for step in old.steps:
            if step.outcome is None:
                # `_TOOK_PLACE` reads it.
                report(state, step, outcome="aborted", text=text)
    return made


def _as_now(state: State, plan: RecordedPlan) -> RecordedPlan:
    return SqlPlanDao(state.store).get(plan.id) or plan


def _as_read(plan: RecordedPlan) -> list[tuple[str, str | None]]:
    """Return what other writers may change in a plan: names, by erasures, and outcomes."""
    return [(str(step), step.outcome) for step in plan.steps]


class Remaining:
    """The rest of a recorded plan, and the last revision for which it is known to work."""

    def __init__(self, plan_id: int) -> None:
        self.plan_id = plan_id
        self._known: int | None = None
        self._broken: str | None = None
        self._goal: _Needs = frozenset()
        self._steps: dict[int | None, _Needs] = {}
        self._read: list[tuple[str, str | None]] = []

    def look(self, state: State, plan: RecordedPlan) -> tuple[str | None, bool]:
        """Return why the plan, at present, is broken, if it is, and whether it was validated."""
        # Uncommitted changes have no revision, and may never have one.
        is_committed, head = state.store.current() is None, head_revision(state)
        known = self._known if is_committed else None
        # A succeeded step may not have had its effects.
        before, self._read = self._read, _as_read(plan)
        if (
            known is not None
            and known <= head
            and before == self._read
            and not self._is_touched(state.store, plan, known + 1, head)
        ):
            self._known = head
            return self._broken, False
        task = read_task(state)
        actions = {fold(one.name): one for one in task.domain.actions}
        self._note_needs(task, plan, actions)
        self._broken, is_judged = _why_broken(task, plan, actions)
        if self._broken is not None:
            now = _as_now(state, plan)
            if _as_read(now) != self._read:
                # A step has begun or ended, or a name was erased, since the plan was read.
                return self.look(state, now)
        self._known = task.revision if is_committed and is_judged else None
        return self._broken, is_judged

    def _is_touched(self, store: Store, plan: RecordedPlan, low: int, high: int) -> bool:
        """Return whether a change of some revisions touches what the plan needs."""
        left = (self._steps[step.position] for step in plan.steps if step.outcome != SUCCEEDED)
        needed = defaultdict[tuple[str, str], list[tuple[str | None, ...]]](list)
        for kind, name, arguments in self._goal.union(*left):
            needed[kind, name].append(arguments)

        def read(session: Session, kb_id: int | None) -> bool:
            assert kb_id is not None
            # An archive after them may have removed changes.
            changes = stream_changes(session, kb_id, low, LARGEST)
            return any(_touches(change, needed) for _, change in changes)

        return low <= high and store.query_in_snapshot(read)

    def _note_needs(self, task: PlanningTask, plan: RecordedPlan, actions: _Actions) -> None:
        """Find what the goal and each remaining step read."""
        rules = defaultdict[str, list[f.Node]](list)
        for rule in task.domain.derived:
            rules[fold(rule.predicate)].append(rule.formula)
        problem = task.problem
        conditions = (*problem.goal, *problem.constraints, *task.domain.constraints)
        self._goal = _needs(conditions, rules)
        self._steps = {}
        for step in plan.steps:
            action = actions.get(fold(step.action))
            needs: _Needs = frozenset()
            if action is not None and len(action.parameters) == len(step.arguments):
                names = bound(action.parameters, step.arguments)
                read = (*action.duration, *action.condition, *_read_by(action.effect))
                needs = _needs((substitute(one, names) for one in read), rules)
            self._steps[step.position] = needs


def _read_by(effects: Iterable[f.Node]) -> Iterator[f.Node]:
    """Yield what effects read: their conditions, and the fluents that give their values."""
    stack = [*effects]
    while stack:
        part = stack.pop()
        if isinstance(part, f.When):
            yield part.condition
            stack.append(part.effect)
        elif isinstance(part, f.Assign):
            yield part.value
            yield from part.fluent.terms if part.operator == "assign" else (part.fluent,)
        elif isinstance(part, f.Atom):
            yield from part.terms
        else:
            stack += f.children(part)


def _needs(read: Iterable[f.Node], rules: dict[str, list[f.Node]]) -> _Needs:
    """Return the facts and fluents that nodes read, also through derived predicates."""
    found, followed, stack = set[_Need](), set[str](), [*read]
    while stack:
        for part in f.walk(stack.pop()):
            if isinstance(part, f.Atom):
                name = fold(part.predicate)
                found.add((FACT, name, _arguments(part.terms)))
                if name in rules and name not in followed:
                    followed.add(name)
                    stack += rules[name]
            elif isinstance(part, f.Fluent):
                found.add((VALUE, fold(part.function), _arguments(part.terms)))
    return frozenset(found)


def _arguments(terms: Iterable[f.Term]) -> tuple[str | None, ...]:
    return tuple(fold(one.name) if isinstance(one, f.Constant) else None for one in terms)


def _touches(change: Change, needed: dict[tuple[str, str], list[tuple[str | None, ...]]]) -> bool:
    """Return whether a change touches something needed."""
    kind = change.kind
    if kind not in (FACT, VALUE):
        # An archive has removed the changes of ended versions.
        return kind in STATED or kind == ARCHIVE
    name, *objects = fold(name_in(kind, change.text)).strip("()").split()
    return any(
        len(arguments) == len(objects)
        and all(one in (None, object_) for one, object_ in zip(arguments, objects, strict=True))
        for arguments in needed.get((kind, name), ())
    )


def _has_ended(step: Execution) -> bool:
    """Return whether a step ended without success."""
    return step.outcome not in (None, RUNNING, SUCCEEDED)


def _why_broken(
    task: PlanningTask, plan: RecordedPlan, actions: _Actions
) -> tuple[str | None, bool]:
    """Return why the rest of a plan does not reach the goals, or None, and if that is known."""
    for step in plan.steps:
        if _has_ended(step):
            return f"{step.place}, {step}, is {step.outcome}", True
    check_validated(task.domain)
    left = [step for step in plan.steps if step.outcome != SUCCEEDED]
    rests, steps = dict[str, Action](), list[Execution]()
    for step in left:
        action = actions.get(fold(step.action))
        if step.outcome == RUNNING and action is not None and action.kind == DURATIVE_ACTION:
            rest = _without_start(action)
            if rest is None:
                # Its start decided the effects of its end: wait for the end.
                return None, False
            rests[rest.name] = rest
            step = replace(step, action=rest.name)  # noqa: PLW2901
        steps.append(step)
    domain = replace(task.domain, actions=(*task.domain.actions, *rests.values()))
    found = validate_plan(domain, task.problem, replace(plan, steps=tuple(steps)))
    return _said(found, left), True


def _without_start(action: Action) -> Action | None:
    """Return the rest of a running durative action; None if its start decides its end."""

    def is_left(part: f.Formula) -> bool | None:
        times = {one.time for one in f.walk(part) if isinstance(one, f.Timed)}
        return None if f.AT_START in times and len(times) > 1 else times != {f.AT_START}

    parts = [(part, is_left(part)) for part in (*action.condition, *action.effect)]
    if any(found is None for _, found in parts):
        return None
    left = {id(part) for part, found in parts if found}
    condition, effect = (
        tuple(part for part in given if id(part) in left)
        for given in (action.condition, action.effect)
    )
    # A domain has no action with a space in its name.
    name = f"{action.name} running"
    return replace(action, name=name, duration=(), condition=condition, effect=effect)


def _said(found: Validation, steps: Sequence[Execution]) -> str | None:
    """Return why a plan is not valid."""
    if found.valid:
        return None
    failed = found.failed_step
    if failed is None:
        parts = (
            *(f"the goal {one}" for one in found.unsatisfied_goals),
            *found.violated_constraints,
        )
        return "; ".join(map(str, parts))
    step = steps[failed.position]
    phase = "" if failed.phase is None else f" {failed.phase}"
    return f"{step.place}, {step},{phase} needs " + "; ".join(map(str, failed.unsatisfied))
