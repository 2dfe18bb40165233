"""Questions about executions, and the reports of components that act without PDDL."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from datetime import datetime
from functools import cache, partial
from typing import Any, NamedTuple

from sqlalchemy import Select, bindparam, func, or_, select, tuple_

from .. import html
from ..arguments import one_of, optional_text, shown, storable_text
from ..dao.text import refuse_unknown_actor
from ..dto import PddlObjectDto
from ..errors import InvalidArgumentError, PlanError, UnknownNameError
from ..history.moments import find_bounds
from ..history.revisions import LARGEST, at_most
from ..knowledge.canonical import in_utc
from ..moment_text import When, read_when
from ..sql import tables as t
from ..sql.definition_rows import find_id
from ..sql.executions import FAILED, NO_PLAN, OUTCOMES, RUNNING, Key
from ..sql.query import Query, constant, first_rows, integer
from ..sql.rows import KB, table_of
from ..store.snapshot import View
from ..store.state import State
from ..store.store import Store
from . import Execution, Outcome
from .checking import check_words, reported
from .recording import (
    ExecutionReader,
    Said,
    check_order,
    key_of,
    parse_id,
    read_execution,
    set_outcome,
)

# How many executions are read at a time.
PAGE = 200


def get(state: State, execution: str | int) -> Execution | None:
    """Read an execution.

    Args:
        execution: its id: `17`, or `"12.3"` for step 3 of plan 12.

    Returns:
        The execution, or None.

    Raises:
        InvalidArgumentError: `execution` is not an id.

    Examples:
        >>> made = kb.executions.report("dock", outcome="failed", code="E4", text="no charger")
        >>> kb.executions.get(made.id).code
        'E4'
    """
    key = parse_id(execution)
    if key is None:
        raise InvalidArgumentError(
            f"{shown(execution)} is not the id of an execution; give one such as 17, or '12.3' for "
            "step 3 of plan 12"
        )

    def read(view: View) -> Execution | None:
        is_position = key[1] <= _LARGEST_POSITION
        return ExecutionReader(state.store, view).one(key) if is_position else None

    return state.store.read_in_snapshot(read, state.at)


_LARGEST_POSITION = 2**31 - 1


class ExecutionFilter(NamedTuple):
    """A filter of executions; all conditions apply."""

    action: str | None = None  # the action's name, or what a component called the act
    object: str | None = None  # the name of an object among the arguments
    outcome: str | None = None  # the present outcome
    actor: str | None = None  # who began it


def get_all(
    state: State,
    *,
    action: str | None = None,
    object: str | PddlObjectDto | None = None,
    outcome: Outcome | None = None,
    actor: str | None = None,
    since: When | None = None,
    until: When | None = None,
    limit: int | None = None,
) -> Iterator[Execution]:
    """Read executions, those with the latest outcome first, in constant memory.

    It omits steps of plans that were not started.

    Args:
        action: the action's name, or the name of an act without PDDL.
        object: an object among the arguments.
        outcome: `running`, `succeeded`, `failed`, `aborted` or `refused`.
        actor: who began it.
        since: the first revision that set an outcome, or the earliest time; both inclusive.
        until: the last revision that set an outcome, or the latest time; both inclusive. Acts that
            were running then and ended later are omitted: `kb.at(until).executions` has them.
        limit: the maximum number of executions; None for all.

    Returns:
        The executions, read in pages on demand.

    Raises:
        UnknownNameError: there never was such an action, object or actor.
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        InvalidArgumentError: `outcome` is not an outcome.

    Examples:
        >>> _ = kb.executions.report("dock", outcome="failed", code="E4", text="no charger")
        >>> for execution in kb.executions.get_all(outcome="failed"):
        ...     print(execution, execution.code, execution.actor)
        (dock) E4 perception
    """
    if outcome is not None:
        one_of(outcome, OUTCOMES, "the outcome")
    name = object.name if isinstance(object, PddlObjectDto) else object
    for value, role in ((action, "action"), (name, "object"), (actor, "actor")):
        storable_text(value, role)
    asked = ExecutionFilter(action, name, outcome, actor)
    read = partial(_read_all, state, asked, since, until)
    return html.Feed(read, at_most(limit), noun="execution")


_NOW, _IDENTITY = table_of(t.ExecutionVersionRow).c, table_of(t.ExecutionRow).c
_ARGUMENT, _REVISION = table_of(t.ExecutionArgumentRow).c, table_of(t.RevisionRow).c
# With more executions of an action or an object, they are found among the newest.
FEW = 5_000
_PLACE = (_NOW.since, _NOW.plan_id, _NOW.position)
_BEFORE = ("since", "plan", "position")


def _of_action() -> Select[Any]:
    rows = select(_IDENTITY.plan_id, _IDENTITY.position).where(_IDENTITY.kb_id == KB)
    name: Any = bindparam("name")
    return rows.where(or_(_IDENTITY.action_id == integer("action"), _IDENTITY.name == name))


def _of_object() -> Select[Any]:
    rows = select(_ARGUMENT.plan_id, _ARGUMENT.position).where(_ARGUMENT.kb_id == KB)
    return rows.where(_ARGUMENT.object_id == integer("object"))


_NAMED = {"action": _of_action, "object": _of_object}


@cache
def _count(what: str) -> Query:
    """Count the executions of an action or an object, up to a bound."""
    some = first_rows(_NAMED[what](), FEW + 1).subquery()
    return Query(select(func.count()).select_from(some))


@cache
def _page(rare: str | None, wanted: frozenset[str], is_past: bool) -> Query:
    """Select the keys of executions, those with the latest outcome first."""
    rows = select(*_PLACE).where(_NOW.kb_id == KB, _NOW.since <= integer("since"))
    rows = rows.where(tuple_(*_PLACE) < tuple_(*map(integer, _BEFORE)))
    rows = rows.where(*had_outcome(wanted, is_past))
    for what in _NAMED.keys() & wanted:
        named = _NAMED[what]()
        if what == rare:
            rows = rows.where(tuple_(_NOW.plan_id, _NOW.position).in_(named))
            continue
        own = named.selected_columns
        same = own.plan_id == _NOW.plan_id, own.position == _NOW.position
        rows = rows.where(named.where(*same).correlate(_NOW.kb_id.table).exists())
    if RUNNING in wanted:
        # As a constant: few are running, and these have their own index.
        rows = rows.where(_NOW.outcome == constant(RUNNING))
    if "outcome" in wanted:
        rows = rows.where(_NOW.outcome == bindparam("outcome"))
    return Query(first_rows(rows.order_by(*(each.desc() for each in _PLACE)), integer("size")))


def had_outcome(wanted: Collection[str], is_past: bool) -> list[Any]:
    """Write the conditions that an outcome is current, or was at a revision, and fits a filter."""
    open_: Any = _NOW.until.is_(None)
    held = or_(open_, _NOW.until > integer("at")) if is_past else open_
    return [_NOW.since >= integer("low"), held, *([_began_by()] if "actor" in wanted else [])]


def began() -> Any:
    """Write the revision of the first outcome of an execution, or that recorded an act."""
    first = table_of(t.ExecutionVersionRow).alias("first").c
    own = first.plan_id == _NOW.plan_id, first.position == _NOW.position
    begun = select(func.min(first.since)).where(first.kb_id == KB, *own)
    recorded = select(_IDENTITY.since).where(
        _IDENTITY.kb_id == KB,
        _IDENTITY.plan_id == constant(NO_PLAN),
        _IDENTITY.plan_id == _NOW.plan_id,
    )
    recorded = recorded.where(_IDENTITY.position == _NOW.position)
    table = _NOW.kb_id.table
    return func.coalesce(*(one.correlate(table).scalar_subquery() for one in (recorded, begun)))


def _began_by() -> Any:
    """Return whether an actor made the revision that an execution began in."""
    revision = select(constant(1)).where(
        _REVISION.kb_id == KB, _REVISION.number == began(), _REVISION.actor == bindparam("actor")
    )
    return revision.correlate(_NOW.kb_id.table).exists()


def find_outcomes(state: State, since: When | None, until: When | None) -> tuple[int, int]:
    """Find the first and last revision of outcomes, including pending ones."""
    bounds = find_bounds(state, since, until)
    return bounds.low, LARGEST if until is None and state.at is None else bounds.high


def _read_all(
    state: State, asked: ExecutionFilter, since: When | None, until: When | None, limit: int | None
) -> Iterator[Execution]:
    """Read executions in pages."""
    low, high = find_outcomes(state, since, until)
    before: Before | None = (high, LARGEST, LARGEST)
    left = at_most(limit)
    while before is not None and left > 0:
        page, before = read_page(state, asked, low, before, min(left, PAGE))
        yield from page
        left -= len(page)


Before = tuple[int, int, int]


def read_page(
    state: State, asked: ExecutionFilter, low: int, before: Before, size: int
) -> tuple[list[Execution], Before | None]:
    """Read executions before a position, and the position where the next page begins, if any."""

    def work(view: View) -> tuple[list[Execution], Before | None]:
        own = _find_names(view, asked)
        if view.kb_id is None or own is None:
            return [], None
        wanted = {key for key, value in asked._asdict().items() if value is not None}
        if asked.outcome == RUNNING:
            wanted = wanted - {"outcome"} | {RUNNING}
        of = (what for what in ("object", "action") if what in own)
        rare = next((what for what in of if _counted(view, what, own) <= FEW), None)
        own |= {key: getattr(asked, key) for key in ("outcome", "actor") if key in wanted}
        if state.at is not None:
            own["at"] = state.at
        query = _page(rare, frozenset(wanted), state.at is not None)
        place = dict(zip(_BEFORE, before, strict=True))
        rows = view.session.rows(query, kb=view.kb_id, low=low, size=size + 1, **place, **own)
        keys: list[Key] = [(plan_id, position) for _, plan_id, position in rows[:size]]
        found = ExecutionReader(state.store, view).listed(keys)
        following = (rows[size - 1][0], *keys[-1]) if len(rows) > size else None
        return [found[key] for key in keys if key in found], following

    page, following = state.store.read_in_snapshot(work, state.at)
    if not page and before[1:] == (LARGEST, LARGEST):
        _refuse_unknown(state.store, asked)
    return page, following


def _find_names(view: View, asked: ExecutionFilter) -> dict[str, Any] | None:
    """Find the ids of the names in a filter, as parameters; None if the object never existed."""
    found: dict[str, Any] = {}
    for kind, name in (("action", asked.action), ("object", asked.object)):
        if name is None or view.kb_id is None:
            continue
        found[kind] = find_id(view.session, view.kb_id, kind, name)
        if kind == "action":
            found["name"] = name
        elif found[kind] is None:
            return None
    return found


def _counted(view: View, what: str, own: dict[str, Any]) -> int:
    """Count the executions of the action or the object that a filter names, up to a bound."""
    names = ("action", "name") if what == "action" else ("object",)
    row = view.session.first(_count(what), kb=view.kb_id, **{name: own[name] for name in names})
    return 0 if row is None else int(row[0])


def _refuse_unknown(store: Store, asked: ExecutionFilter) -> None:
    """Refuse names that never existed."""

    def work(view: View) -> str | None:
        own = _find_names(view, asked)
        if own is None:
            return f"object {shown(asked.object)}"
        is_known = own.get("action", 0) is not None or _counted(view, "action", own)
        return None if is_known else f"action {shown(asked.action)}"

    missing = store.read_in_snapshot(work)
    if missing is not None:
        raise UnknownNameError(
            f"knowledge base {store.name!r} never had the {missing}, and has no execution of it"
        )
    if asked.actor is not None:
        refuse_unknown_actor(store, asked.actor)


def report(
    state: State,
    act: str | Execution,
    *,
    outcome: Outcome,
    arguments: Iterable[str | PddlObjectDto] = (),
    code: str | None = None,
    text: str | None = None,
    started_at: datetime | str | None = None,
    ended_at: datetime | str | None = None,
    reason: str | None = None,
) -> Execution:
    """Record a component's act in one revision, without checking conditions or writing effects.

    A component without PDDL, such as a behaviour tree or a state machine, reports its acts by a
    name or, once they are running, by the execution. An executive that writes effects itself
    reports the steps of a recorded plan in the same way: each is started once, and then succeeds,
    fails or is aborted; a step that was not started can be aborted, too.

    Args:
        act: the name of the act; or a running execution, or a step of a recorded plan, to set its
            next outcome.
        outcome: `running`, `succeeded`, `failed`, `aborted` or `refused`.
        arguments: objects of the knowledge base, or any other texts.
        code: the code of a failure.
        text: a message.
        started_at: when it began; by default now: an aware time or a text such as `2 minutes ago`.
        ended_at: when it ended, likewise; without `started_at`, the act also began then.
        reason: the revision's reason.

    Returns:
        The execution. If it already has this outcome, nothing is written.

    Raises:
        PlanError: the execution is unknown, or its present outcome does not allow this one; the
            name or an argument is not a text; or it ends before it begins.
        InvalidArgumentError: `outcome` is not an outcome, or a text is not a time.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> running = kb.executions.report("dock", arguments=["rb1"], outcome="running")
        >>> kb.executions.report(running, outcome="failed", code="E4").outcome
        'failed'
    """
    one_of(outcome, OUTCOMES, "the outcome")
    optional_text(reason, "the reason")
    said = _said(outcome, code, text, started_at, ended_at)
    named = check_words(str(act) if isinstance(act, Execution) else act, arguments)
    if not isinstance(act, Execution):
        # It did not begin after its end.
        said = said._replace(started_at=said.started_at or said.ended_at)
    elif named[1]:
        raise PlanError(f"{act} has its arguments already; leave them out")
    with state.store.transaction(reason=reason) as transaction:
        remedy = "give its times here: started_at=..., ended_at=..."
        transaction.refuse_period("an execution", remedy)
        if isinstance(act, Execution):
            set_outcome(transaction, act, outcome, said)
            key = key_of(act)
        else:
            made = reported(transaction.definitions.current(), *named)
            key = transaction.executions.record(made, outcome, *said)
    return read_execution(state.store, key)


def fail(
    state: State,
    execution: Execution,
    *,
    code: str | None = None,
    text: str | None = None,
    reason: str | None = None,
) -> Execution:
    """Record that a running execution has failed. The changes of its start stay.

    Args:
        execution: a running one, from `start` or `executions.report`.
        code: the code of the failure.
        text: a message.
        reason: the revision's reason.

    Returns:
        The execution, with the outcome `failed`. If it already failed, nothing is written.

    Raises:
        PlanError: it has another outcome, or is unknown.
        ReadOnlyError: this is a view of the past.

    Examples:
        >>> running = kb.executions.report("dock", outcome="running")
        >>> kb.fail(running, code="E4", text="no charger").code
        'E4'
    """
    key_of(execution)
    return report(state, execution, outcome="failed", code=code, text=text, reason=reason)


def _said(
    outcome: str,
    code: str | None,
    text: str | None,
    started_at: datetime | str | None,
    ended_at: datetime | str | None,
) -> Said:
    """Check the details of an outcome."""
    if code is not None and outcome != FAILED:
        raise PlanError(f"{shown(code)} is the code of a failure, but the outcome is {outcome!r}")
    given: Any = {"started_at": read_when(started_at), "ended_at": read_when(ended_at)}
    begun, ended = (in_utc(role, moment) for role, moment in given.items())
    if ended is not None and outcome == RUNNING:
        raise PlanError("ended_at is given for a running execution; leave it out")
    texts = storable_text(code, "code", PlanError), storable_text(text, "text", PlanError)
    return check_order(Said(*texts, begun, ended))
