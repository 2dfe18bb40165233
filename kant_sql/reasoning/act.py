"""Steps: which can be executed, and the execution of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

from ..acts import Execution
from ..acts.recording import check_execution, key_of
from ..arguments import count_limit, expect, optional_text, shown
from ..errors import InvalidArgumentError
from ..html import Feed, Listing
from ..knowledge.definitions import Definitions, ObjectDefinition
from ..knowledge.resolved import FALSE, fits
from ..pddl.cursor import hint
from ..planning import PlanStep
from ..store.snapshot import View
from ..store.state import State
from ..store.store import Store
from ..store.transaction import Transaction
from .ask import (
    OF_ANSWERS,
    Binding,
    asked,
    check_fit,
    find_object,
    question,
    statement_key,
    variable_of,
)
from .effects import EffectReader, not_applicable
from .failures import FAILED, FailedCondition
from .promise import is_executable, judge, promise_of
from .steps import GroundStep, PreparedAction, Step, executable, find_action, ground, prepared


def begin(view: View, step: GroundStep) -> EffectReader:
    """Refuse a step that cannot begin."""
    numbers, failed = judge(view, step)
    if failed:
        raise not_applicable(step, failed)
    return EffectReader(view, step, numbers)


def view_of(transaction: Transaction) -> View:
    """Return the state of a transaction, including its pending changes."""
    transaction.flush()
    definitions = transaction.definitions.current()
    return View(transaction.session, transaction.kb_id, definitions)


def applicable_actions(
    state: State, /, name: str | None = None, *, limit: int | None = None, **fixed: Binding
) -> Iterator[PlanStep]:
    """Find the steps that can be executed in this state.

    All are read at once, each action with one statement until `limit` is reached. Durative steps
    are those that `start` can start: see `why_not`. It omits steps whose duration you must choose,
    and actions with nonlinear continuous change. Preferences do not count.

    Args:
        name: an action's name; by default all actions in their order.
        limit: the maximum number of steps.
        **fixed: objects for parameters; actions without these are omitted.

    Returns:
        The steps, in the order of the actions and of the declarations of their objects.

    Raises:
        InvalidKnowledgeError: an action or an object is unknown.
        InvalidArgumentError: there is no such parameter.
        UnsupportedConstructError: the name is that of a process or an event.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:types door)
        ...   (:constants front back - door) (:predicates (open ?d - door))
        ...   (:action unlock :parameters (?d - door)
        ...     :precondition (not (open ?d)) :effect (open ?d)))''').revision
        2
        >>> print(*kb.applicable_actions())
        (unlock front) (unlock back)
    """
    search = _Search(name, fixed)
    return Feed(lambda most: search.begin(state, most), limit, noun="step")


class _Search(NamedTuple):
    """A search for steps: of one action or of all, with some fixed parameters."""

    name: str | None
    fixed: Mapping[str, Binding]

    def begin(self, state: State, limit: int | None) -> Iterator[PlanStep]:
        """Check it, and return the steps."""
        if limit is not None:
            limit = count_limit(limit)
        if self.name is not None:
            expect(self.name, str, "the name of an action", InvalidArgumentError)
        return iter(state.store.read_in_snapshot(partial(self._steps, limit=limit), state.at))

    def _actions(
        self, definitions: Definitions
    ) -> list[tuple[PreparedAction, dict[int, ObjectDefinition]]]:
        """Find the actions that have all fixed parameters, with their objects by position."""
        name, found = self.name, []
        actions = executable(definitions) if name is None else [find_action(definitions, name)]
        for action in (prepared(definitions, each) for each in actions):
            fixed = self._objects(definitions, action)
            if fixed is None:
                continue
            for position, object_ in fixed.items() if name is not None else ():
                check_fit(definitions, object_, action.columns[position])
            found.append((action, fixed))
        if self.fixed and not found:
            raise InvalidArgumentError(
                f"no action has parameters named {', '.join(f'?{each}' for each in self.fixed)}"
            )
        return found

    def _objects(
        self, definitions: Definitions, action: PreparedAction
    ) -> dict[int, ObjectDefinition] | None:
        """Return the objects of fixed parameters, by position; None if one is not a parameter."""
        names, found = [variable.name for variable in action.variables], {}
        for keyword, value in self.fixed.items():
            name = variable_of(keyword, names)
            if name is not None:
                found[names.index(name)] = find_object(definitions, value)
            elif self.name is None:
                return None
            else:
                raise InvalidArgumentError(
                    f"the action {self.name!r} has no parameter ?{keyword}{hint(keyword, names)}"
                )
        return found

    def _steps(self, view: View, limit: int | None) -> list[PlanStep]:
        found: list[PlanStep] = []
        for action, fixed in self._actions(view.definitions):
            if len(found) == limit:
                break
            ids = {position: object_.id for position, object_ in fixed.items()}
            found += _instances(view, action, ids, None if limit is None else limit - len(found))
        return found


def _instances(
    view: View, action: PreparedAction, ids: dict[int, int], most: int | None
) -> list[PlanStep]:
    """Return the executable instances of an action, given the ids of some of its objects."""
    definitions, promise = view.definitions, promise_of(action)
    if promise.listed == FALSE or not is_executable(action):
        return []
    for position, id_ in ids.items():
        if not all(fits(definitions, id_, one) for one in action.parameters[position].types):
            return []
    order = [n for n in range(len(action.parameters)) if n not in ids]
    free = [action.columns[n] for n in order]
    is_limited = most is not None and promise.is_whole
    key = ("instances", *sorted(ids), is_limited, *statement_key(view, ()))
    slots = {action.parameters[n].slot: f":b{n}" for n in ids}
    statement = action.kept(
        key, lambda: question(view).answers(promise.listed, free, slots, is_limited)
    )
    given = {f"b{n}": id_ for n, id_ in ids.items()} | ({} if most is None else {"most": most})
    live = definitions.objects.live
    found = []
    for row in asked(view, statement, given, OF_ANSWERS)[1:]:
        ids |= zip(order, row[1:], strict=False)
        arguments = [live(ids[n]).name for n in range(len(ids))]
        step = PlanStep(None, action.name, tuple(arguments))
        if promise.is_whole or not judge(view, ground(definitions, step))[1]:
            found.append(step)
        if len(found) == most:
            break
    return found


def why_not(state: State, step: Step) -> list[FailedCondition]:
    """Return why a step cannot begin now.

    It can begin if its objects fit its parameters, its duration is allowed (given or fixed, if it
    matters), its conditions `at start` hold, its effects `at start` have results, and its
    conditions `over all` hold right after these effects. `applicable_actions`, `start` and `apply`
    agree on this; `apply` also executes the end, which may fail then.

    Args:
        step: as for `apply`; its arguments may be of any type.

    Returns:
        The arguments that do not fit their parameters; or else the fault of the duration; or the
        failing conditions `at start`, as from `unsatisfied`; or the effects at the start without a
        result; or the conditions `over all` that do not hold right after these effects. Empty for a
        step that can begin.

    Raises:
        PddlError, InvalidKnowledgeError: it names an unknown element.
        UnsupportedConstructError: the action has nonlinear continuous change.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open) (key))
        ...   (:action unlock :parameters () :precondition (key) :effect (open)))''').revision
        2
        >>> print(*kb.why_not("(unlock)"))
        (key): does not hold
    """
    store, at = state
    failed = store.read(lambda view: judge(view, ground(view.definitions, step))[1], at)
    return Listing(failed, FAILED)


def in_revision(
    store: Store,
    step: object,
    reason: str | None,
    execution: Execution | None,
    done: str,
    work: Callable[[Transaction, GroundStep], None],
) -> int | None:
    """Do something with a step in one revision; return its number, or None in a transaction."""
    optional_text(reason, "the reason")
    recorded = step if execution is None and isinstance(step, Execution) else execution
    place = None if recorded is None else key_of(recorded)
    said = reason if reason is not None else f"{done} {step_text(step)}"
    with store.transaction(reason=said, plan_step=place) as transaction:
        transaction.refuse_period("an act", "save the facts that it brought about then")
        if recorded is not None:
            check_execution(transaction, recorded)
        work(transaction, ground(transaction.definitions.current(), step))
    return transaction.made


def step_text(step: object) -> str:
    """Write a step as the caller gave it, for the reason of its revision."""
    if not isinstance(step, str):
        try:
            return str(step)
        except Exception:
            # Not a step: the error names its class.
            return shown(step)
    text = " ".join(step.split())
    return text if "(" in text else f"({text})"
