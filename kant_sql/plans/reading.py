"""Reading recorded plans: one statement for each table, however many plans there are."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from decimal import Decimal
from typing import Any, NamedTuple

from sqlalchemy import BigInteger, bindparam, select

from ..backends import Query, Row, Session
from ..errors import reading_rows
from ..history import Revision, Version
from ..history.revisions import LARGEST, read_numbered
from ..knowledge.changes import PLAN_STEP
from ..knowledge.loading import KB
from ..knowledge.plan import Step
from ..tables import PlanRow, PlanStepRow, PlanStepVersionRow, RevisionPlanStepRow
from ..view import View
from .interfaces import GivenReader, RecordedPlan, RecordedStep
from .steps import names_in


def _number(name: str) -> Any:
    return bindparam(name, type_=BigInteger)


def _between(plan_id: Any) -> Any:
    return plan_id.between(_number("low"), _number("high"))


_PLANS = Query(
    select(
        PlanRow.id,
        PlanRow.since,
        PlanRow.revision,
        PlanRow.problem_hash,
        PlanRow.planner,
        PlanRow.planner_version,
        PlanRow.objective,
        PlanRow.value,
        PlanRow.status,
    )
    .where(PlanRow.kb_id == KB, _between(PlanRow.id), PlanRow.since <= _number("at"))
    .order_by(PlanRow.id)
)
_STEPS = Query(
    select(
        PlanStepRow.plan_id,
        PlanStepRow.position,
        PlanStepRow.start,
        PlanStepRow.duration,
        # The names are in it, exactly: to look each of them up takes longer than all the rest.
        PlanStepRow.text,
    )
    .where(PlanStepRow.kb_id == KB, _between(PlanStepRow.plan_id))
    .order_by(PlanStepRow.plan_id, PlanStepRow.position)
)
_STATUSES = Query(
    select(
        PlanStepVersionRow.plan_id,
        PlanStepVersionRow.position,
        PlanStepVersionRow.status,
        PlanStepVersionRow.text,
        PlanStepVersionRow.since,
        PlanStepVersionRow.until,
    )
    .where(PlanStepVersionRow.kb_id == KB, _between(PlanStepVersionRow.plan_id))
    .where(PlanStepVersionRow.since <= _number("at"))
    .order_by(PlanStepVersionRow.plan_id, PlanStepVersionRow.position, PlanStepVersionRow.since)
)
_REVISIONS = Query(
    select(RevisionPlanStepRow.plan_id, RevisionPlanStepRow.position, RevisionPlanStepRow.number)
    .where(RevisionPlanStepRow.kb_id == KB, _between(RevisionPlanStepRow.plan_id))
    .where(RevisionPlanStepRow.number <= _number("at"))
    .order_by(RevisionPlanStepRow.plan_id, RevisionPlanStepRow.position, RevisionPlanStepRow.number)
)


class _Status(NamedTuple):
    status: Any
    text: str
    since: int
    until: int | None


class _Parts(NamedTuple):
    """What became of the steps of some plans."""

    statuses: dict[Step, list[_Status]]
    revisions: dict[Step, list[int]]
    known: dict[int, Revision]


def read_plans(
    view: View, name: str, given: GivenReader, plan_id: int | None = None
) -> list[RecordedPlan]:
    """Read plans, with what became of them.

    Args:
        view: the state to read from; of the past, with what had become of them by then.
        name: the knowledge base's name.
        given: gives again what planners were given.
        plan_id: one plan; None for all.

    Returns:
        The plans, oldest first.
    """
    if view.kb_id is None:
        return []
    session = view.session
    at = LARGEST if view.at is None else view.at
    low, high = (0, LARGEST) if plan_id is None else (plan_id, plan_id)
    rows = session.rows(_PLANS, kb=view.kb_id, low=low, high=high, at=at)
    if not rows:
        return []
    own = {"kb": view.kb_id, "low": rows[0][0], "high": rows[-1][0]}
    statuses = _statuses(session.rows(_STATUSES, **own, at=at), at)
    revisions = _by_step(session.rows(_REVISIONS, **own, at=at))
    parts = _Parts(statuses, revisions, _known(session, view.kb_id, statuses))
    steps: dict[int, list[RecordedStep]] = defaultdict(list)
    for row in session.rows(_STEPS, **own):
        with reading_rows("plan_step", f"step {row[1]!r} of plan {row[0]!r}"):
            steps[row[0]].append(_step(row, parts, name))
    return [_plan(row, tuple(steps[row[0]]), given) for row in rows]


def _by_step(rows: Iterable[Row]) -> dict[Step, list[Any]]:
    found: dict[Step, list[Any]] = defaultdict(list)
    for plan_id, position, value in rows:
        found[plan_id, position].append(value)
    return found


def _statuses(rows: Iterable[Row], at: int) -> dict[Step, list[_Status]]:
    found: dict[Step, list[_Status]] = defaultdict(list)
    for plan_id, position, status, text, since, until in rows:
        ended = None if until is None or until > at else until
        found[plan_id, position].append(_Status(status, text, since, ended))
    return found


def _known(
    session: Session, kb_id: int, statuses: dict[Step, list[_Status]]
) -> dict[int, Revision]:
    numbers = {
        number
        for of_step in statuses.values()
        for status in of_step
        for number in (status.since, status.until)
        if number is not None
    }
    return read_numbered(session, kb_id, numbers)


def _step(row: Row, parts: _Parts, name: str) -> RecordedStep:
    plan_id, position, start, duration, text = row
    place = (plan_id, position)
    statuses = parts.statuses.get(place, [])
    outcomes = [
        Version(PLAN_STEP, each.text, parts.known[each.since], parts.known.get(each.until or 0))
        for each in statuses
        # A revision that is being made is none yet.
        if each.since in parts.known
    ]
    return RecordedStep(
        plan_id,
        position,
        to_decimal(start),
        *names_in(text),
        to_decimal(duration),
        next((each.status for each in statuses if each.until is None), None),
        tuple(outcomes),
        tuple(parts.revisions.get(place, ())),
        name,
    )


def _plan(row: Row, steps: tuple[RecordedStep, ...], given: GivenReader) -> RecordedPlan:
    id_, since, revision, digest, planner, version, objective, value, status = row
    with reading_rows("plan", f"plan {id_!r}"):
        said = (planner, version, objective, to_decimal(value), status)
    return RecordedPlan(id_, since, revision, digest, *said, steps, given)


def to_decimal(text: str | None) -> Decimal | None:
    """Read an exact number.

    Args:
        text: its decimal text, or None.

    Returns:
        The number.
    """
    return None if text is None else Decimal(text)
