"""Pages of recorded plans, and steps that name an action or objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from itertools import islice
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, func, select, union_all

from ..dto.lexical import fold, is_word
from ..sql.definition_rows import find_identities
from ..sql.dialects.base import Session
from ..sql.executions import of_execution
from ..sql.query import Query, constant, first_rows, in_list, integer
from ..sql.rows import KB, table_of
from ..sql.tables import ExecutionArgumentRow, ExecutionRow, ExecutionVersionRow, PlanRow
from ..store.snapshot import read_position
from ..store.state import State
from .revisions import LARGEST, Revision, read_numbered

# Steps to search if more of them name an object.
SEARCHED_STEPS = 5_000


class StepLine(NamedTuple):
    """An execution: a step of a recorded plan, or an act without a plan.

    Attributes:
        plan: the id of the plan; None without a plan.
        position: its place in the plan; without a plan, its id.
        text: the action with its arguments, as PDDL.
        status: its outcome; None before it is started.
    """

    plan: int | None
    position: int
    text: str
    status: str | None


_STEPS_SHOWN = 20
# Objects by which steps are found, at most.
MOST_OBJECTS = 5
_STEP, _ARGUMENT = table_of(ExecutionRow), table_of(ExecutionArgumentRow)


def _named(step: Any, place: int) -> ColumnElement[bool]:
    """Return whether a step names an object."""
    argument = _ARGUMENT.alias(f"argument{place}").c
    own = argument.plan_id == step.plan_id, argument.position == step.position
    # An expression uses no index: an object may be in many steps, but a step has few arguments.
    is_named = argument.object_id + constant(0) == integer(f"object{place}")
    found: Select[Any] = select(constant(1)).where(argument.kb_id == KB, *own, is_named)
    return found.exists()


def _shown(places: Any) -> Query:
    """Read the newest of some steps, with their outcomes."""
    newest = places.order_by(
        places.selected_columns.plan_id.desc(), places.selected_columns.position.desc()
    )
    page = first_rows(newest, integer("size")).subquery("page").c
    version = table_of(ExecutionVersionRow).c
    text = of_execution(_STEP.c.text, page)
    status = of_execution(version.outcome, page, version.until.is_(None))
    lines = select(page.plan_id, page.position, text, status)
    return Query(lines.order_by(page.plan_id.desc(), page.position.desc()))


@cache
def _steps_of_action() -> Query:
    steps = select(_STEP.c.plan_id, _STEP.c.position).where(_STEP.c.kb_id == KB)
    return _shown(steps.where(_STEP.c.action_id == integer("action")))


@cache
def _steps_naming(number: int, is_recent: bool) -> Query:
    """Select the steps that name all of some objects, by the first one or among the newest."""
    if is_recent:
        newest = select(_STEP.c.plan_id, _STEP.c.position).where(_STEP.c.kb_id == KB)
        newest = newest.order_by(_STEP.c.plan_id.desc(), _STEP.c.position.desc())
        steps: Any = first_rows(newest, SEARCHED_STEPS).subquery("newest").c
        places = select(steps.plan_id, steps.position)
        return _shown(places.where(*(_named(steps, place) for place in range(number))))
    first = _ARGUMENT.alias("first").c
    own = first.kb_id == KB, first.object_id == integer("object0")
    places = select(first.plan_id, first.position).where(*own).distinct()
    return _shown(places.where(*(_named(first, place) for place in range(1, number))))


@cache
def _uses(number: int) -> Query:
    """Count the steps that name each of some objects, up to a bound."""
    counts = []
    for place in range(number):
        named: Select[Any] = select(constant(1)).where(
            _ARGUMENT.c.kb_id == KB, _ARGUMENT.c.object_id == integer(f"object{place}")
        )
        some = first_rows(named, SEARCHED_STEPS + 1).subquery()
        counts.append(select(func.count()).select_from(some).scalar_subquery())
    return Query(select(*counts))


def _ids(session: Session, kb_id: int, kind: str, names: Iterable[str]) -> list[int]:
    """Find the ids of names; none if one never existed."""
    keys = [fold(name) for name in islice(dict.fromkeys(names), MOST_OBJECTS)]
    if not all(map(is_word, keys)):
        return []
    found = find_identities(session, kb_id, kind, set(keys))
    ids = [one[0] for key in keys if (one := found[key]) is not None]
    return ids if len(ids) == len(keys) else []


def read_steps(session: Session, kb_id: int, kind: str, names: Iterable[str]) -> list[StepLine]:
    """Read the newest steps that name all of some objects, or of an action."""
    # It takes three statements at most.
    ids = _ids(session, kb_id, kind, names)
    if not ids:
        return []
    own = {"kb": kb_id, "size": _STEPS_SHOWN}
    if kind == "action":
        rows = session.rows(_steps_of_action(), **own, action=ids[0])
    else:
        objects = {f"object{place}": id_ for place, id_ in enumerate(ids)}
        counts = session.first(_uses(len(ids)), kb=kb_id, **objects) or (0,)
        rarest = sorted(range(len(ids)), key=lambda place: counts[place])
        objects = {f"object{place}": ids[which] for place, which in enumerate(rarest)}
        query = _steps_naming(len(ids), min(counts) > SEARCHED_STEPS)
        rows = session.rows(query, **own, **objects)
    return [StepLine(plan_id or None, *line) for plan_id, *line in rows]


class PlanLine(NamedTuple):
    """A plan in a list.

    Attributes:
        plan: its id.
        recorded: the revision that recorded it.
        revision: the revision of the state that it was planned from.
        planner: the planner's name.
        objective: the metric.
        value: the objective's value, as text.
        status: the status reported by the planner.
        steps: the number of its steps.
        outcomes: the number of steps with each status; the others were not started.
    """

    plan: int
    recorded: Revision
    revision: int
    planner: str | None
    objective: str | None
    value: str | None
    status: str | None
    steps: int
    outcomes: dict[str, int]


def _plans() -> Query:
    plan = table_of(PlanRow).c
    columns: tuple[Any, ...] = plan.id, plan.since, plan.revision, plan.planner, plan.objective
    rows = select(*columns, plan.value, plan.status)
    rows = rows.where(plan.kb_id == KB, plan.id < integer("before")).order_by(plan.id.desc())
    return Query(first_rows(rows, integer("size")))


def _outcomes() -> Query:
    version = table_of(ExecutionVersionRow).c
    among, having = in_list(_STEP.c.plan_id, "plans"), in_list(version.plan_id, "plans")
    steps = select(_STEP.c.plan_id, constant(""), func.count()).where(_STEP.c.kb_id == KB, among)
    now = select(version.plan_id, version.outcome, func.count()).where(
        version.kb_id == KB, having, version.until.is_(None)
    )
    by_status = now.group_by(version.plan_id, version.outcome)
    return Query(union_all(steps.group_by(_STEP.c.plan_id), by_status))


_PLANS, _OUTCOMES = _plans(), _outcomes()


class PlansPage(NamedTuple):
    """A page of the recorded plans, the newest first.

    Attributes:
        plans: the plans.
        before: the id before which the next page continues; None after the last.
    """

    plans: list[PlanLine]
    before: int | None


def read_plans_page(state: State, before: int | None = None, limit: int = 50) -> PlansPage:
    """Read a page of the recorded plans."""

    def work(session: Session, kb_id: int) -> PlansPage:
        rows = session.rows(_PLANS, kb=kb_id, before=before or LARGEST, size=limit + 1)
        page = rows[:limit]
        plans = session.list_value([row[0] for row in page])
        counts: dict[int, dict[str, int]] = {}
        for id_, status, number in session.rows(_OUTCOMES, kb=kb_id, plans=plans):
            counts.setdefault(id_, {})[status] = number
        revisions = read_numbered(session, kb_id, {row[1] for row in page})
        lines = []
        for row in page:
            outcomes = counts.get(row[0], {})
            steps = outcomes.pop("", 0)
            lines.append(PlanLine._make((row[0], revisions[row[1]], *row[2:7], steps, outcomes)))
        return PlansPage(lines, page[-1][0] if len(rows) > limit else None)

    return state.store.query_known(work, PlansPage([], None))


class Stretch(NamedTuple):
    """The revisions from one to another."""

    newest: list[Revision]  # the last of them, in order
    total: int


def read_stretches(
    state: State, bounds: Sequence[tuple[int, int | None]], limit: int
) -> list[Stretch]:
    """Read the last revisions of each stretch, in two statements; a stretch may have no end."""

    def work(session: Session, kb_id: int) -> list[Stretch]:
        if not bounds:
            return []
        head = read_position(session, kb_id).head
        ends = [(first, head if last is None else last) for first, last in bounds]
        numbers = [range(max(first, last - limit + 1), last + 1) for first, last in ends]
        found = read_numbered(session, kb_id, set().union(*numbers))
        return [
            Stretch([found[number] for number in some if number in found], last - first + 1)
            for some, (first, last) in zip(numbers, ends, strict=True)
        ]

    return state.store.query_known(work, [])
