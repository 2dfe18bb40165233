"""The executions of a timeline: steps of plans, and acts without a plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from sqlalchemy import Select, select, union, union_all

from ..dto.lexical import fold
from ..pddl.lexer import tokenize
from ..sql import tables as t
from ..sql.dialects.base import Row, Session
from ..sql.dialects.containing import is_in
from ..sql.executions import NO_PLAN, RUNNING, VERSIONS, Key
from ..sql.query import Query, constant, first_rows, in_list, integer
from ..sql.rows import KB, table_of
from .revisions import Revision, why_of
from .window import PLAN, PlanBar, StepBar, TimelineQuestion, Window

# The plans and steps of one timeline. Plans are found by this many changes of steps.
MOST_PLANS, MOST_STEPS, MOST_CHANGES = 100, 2_000, 5_000


LOW, HIGH = integer("low"), integer("high")
_NO_PLAN = constant(NO_PLAN)


def _some(ids: Select[Any], order: Any) -> Select[Any]:
    """Select a limited number of rows in the order of an index."""
    return first_rows(ids.order_by(order), MOST_CHANGES)


def _ids() -> Query:
    """Select the plans that were recorded in a window, or whose steps changed or ran there."""
    # Executions without a plan have their own rows.
    version = VERSIONS.c
    columns = version.plan_id, version.position, version.since, version.outcome
    of_step: Any = select(*columns).where(version.kb_id == KB)
    recorded = _some(
        select(t.PlanRow.id).where(t.PlanRow.kb_id == KB, t.PlanRow.since.between(LOW, HIGH)),
        t.PlanRow.since.desc(),
    ).subquery()
    changed = _some(of_step.where(version.since.between(LOW, HIGH)), version.since.desc())
    started = constant(RUNNING)
    now = of_step.where(version.until.is_(None), version.outcome == started).subquery()
    later = _some(of_step.where(version.until > HIGH), version.until).subquery()
    steps = [
        select(each.c.plan_id, each.c.position).where(*where)
        for each, where in (
            (changed.subquery(), ()),
            (now, (now.c.since <= LOW,)),
            (later, (later.c.since <= LOW, later.c.outcome == started)),
        )
    ]
    found = union(*steps).cte("found")
    ids = union(
        select(recorded.c.id), select(found.c.plan_id).where(found.c.plan_id > _NO_PLAN)
    ).subquery()
    plans: Any = select(ids.c.id, _NO_PLAN.label("position")).order_by(ids.c.id.desc())
    acts = select(found).where(found.c.plan_id == _NO_PLAN).order_by(found.c.position.desc())
    newest = (
        first_rows(rows, most + 1).subquery()
        for rows, most in ((plans, MOST_PLANS), (acts, MOST_STEPS))
    )
    return Query(union_all(*map(select, newest)))


def _of_these(mapped: type[t.Base], *names: str) -> Any:
    """Select the rows of some plans' steps, and of executions without a plan."""
    columns = table_of(mapped).c
    rows = select(*(columns[name] for name in ("plan_id", "position", *names)))
    rows = rows.where(columns.kb_id == KB)
    own = columns.plan_id == _NO_PLAN, in_list(columns.position, "acts")
    return union_all(rows.where(in_list(columns.plan_id, "ids")), rows.where(*own)).subquery()


_IDS = _ids()
_PLANS = Query(
    select(t.PlanRow.id, t.PlanRow.since, t.PlanRow.planner)
    .where(t.PlanRow.kb_id == KB, in_list(t.PlanRow.id, "ids"))
    .order_by(t.PlanRow.id)
)
_EXECUTION = _of_these(t.ExecutionRow, "text")
_STEPS = Query(
    first_rows(
        select(_EXECUTION).order_by(_EXECUTION.c.plan_id.desc(), _EXECUTION.c.position),
        MOST_STEPS + 1,
    )
)
_STATUS = _of_these(t.ExecutionVersionRow, "since", "until", "outcome")
_STATUSES = Query(
    select(_STATUS).where(_STATUS.c.since <= integer("head")).order_by(_STATUS.c.since)
)


class _Ran(NamedTuple):
    """The course of a step."""

    status: str  # its last status
    since: int | None  # the revision that started it
    until: int | None  # the revision that ended it


class PlanBars:
    """The plans of a window, in four statements at most."""

    def __init__(
        self, session: Session, kb_id: int, window: Window, question: TimelineQuestion
    ) -> None:
        """Read the plans with a step that has the object and the text, but no revisions."""
        self.has_more = False  # whether it omits earlier plans or steps
        self._wanted = question.wanted
        self._plans: list[Row] = []
        self._steps: dict[int, list[tuple[int, str]]] = {}
        self._ran: dict[Key, _Ran] = {}
        if PLAN in question.kinds and question.after is None:
            self._read(session, kb_id, window)

    def _read(self, session: Session, kb_id: int, window: Window) -> None:
        rows = session.rows(_IDS, kb=kb_id, low=max(window.low, 1), high=window.high)
        plans = [id_ for id_, _ in rows if id_ != NO_PLAN]
        acts = [position for id_, position in rows if id_ == NO_PLAN]
        self.has_more = len(plans) > MOST_PLANS or len(acts) > MOST_STEPS
        if not rows:
            return
        ids = session.list_value(plans[:MOST_PLANS])
        own = session.list_value(acts[:MOST_STEPS])
        self._plans = session.rows(_PLANS, kb=kb_id, ids=ids) if plans else []
        steps = session.rows(_STEPS, kb=kb_id, ids=ids, acts=own)
        if len(steps) > MOST_STEPS:
            self.has_more = True
            del steps[MOST_STEPS:]
        if self._wanted.object is None and self._wanted.text is None:
            # A plan may have no steps.
            self._steps = {row[0]: [] for row in self._plans}
        for plan_id, position, text in steps:
            if self._is_wanted(text):
                self._steps.setdefault(plan_id, []).append((position, text))
        for plan_id, position, since, until, status in session.rows(
            _STATUSES, kb=kb_id, ids=ids, acts=own, head=window.head
        ):
            place, ended = (plan_id, position), None if status == RUNNING else since
            if ended is None and until is not None and until <= window.head:
                ended = until
            began = since if status == RUNNING else None
            before = self._ran.get(place)
            self._ran[place] = _Ran(status, began if before is None else before.since, ended)

    def _is_wanted(self, text: str) -> bool:
        _, object_, part = self._wanted
        if object_ is not None and object_ not in tokenize(fold(text))[2:]:
            return False
        return is_in(part, text)

    def numbers(self) -> set[int]:
        """Return the revisions that `bars` needs."""
        found = {row[1] for row in self._plans if row[0] in self._steps}
        for (plan_id, _), ran in self._ran.items():
            if plan_id in self._steps:
                found.update(number for number in ran[1:] if number is not None)
        return found

    def bars(self, told: Mapping[int, Revision]) -> tuple[PlanBar, ...]:
        """Make the plans from the revisions that they name."""
        made = []
        for plan_id, recorded_in, planner in self._plans:
            if plan_id in self._steps:
                steps = (self._step(plan_id, *step, told) for step in self._steps[plan_id])
                own = told[recorded_in]
                who = own.committed_at, own.actor, own.reason
                made.append(PlanBar(plan_id, recorded_in, *who, planner, tuple(steps), own.source))
        if NO_PLAN in self._steps:
            acts = tuple(self._step(NO_PLAN, *act, told) for act in self._steps[NO_PLAN])
            made.append(PlanBar(None, None, None, None, None, None, acts))
        return tuple(made)

    def _step(
        self, plan_id: int, position: int, text: str, told: Mapping[int, Revision]
    ) -> StepBar:
        ran = self._ran.get((plan_id, position))
        if ran is None:
            return StepBar(position, text, None)
        began = None if ran.since is None else told[ran.since]
        ended = None if ran.until is None else told[ran.until]
        since_at, until_at = (
            None if each is None else each.committed_at for each in (began, ended)
        )
        actor, reason, source = why_of(began or ended)
        ended_by, ended_reason, ended_source = why_of(ended)
        said = actor, reason, ended_by, ended_reason, source, ended_source
        return StepBar(position, text, ran.status, ran.since, ran.until, since_at, until_at, *said)
