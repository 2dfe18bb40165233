"""What a recorded plan is: its canonical text, its rows, and the statements for its steps."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from json.encoder import encode_basestring
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Integer,
    bindparam,
    select,
)

from .dialects.base import Row
from .query import Insert, Query
from .rows import KB, VersionTable, looked_up, table_of
from .tables import PlanRow, PlanStepArgumentRow, PlanStepRow, PlanStepVersionRow

# The id of a plan, and the position of a step in it.
Step = tuple[int, int]

STEP_VERSIONS = table_of(PlanStepVersionRow)
NEW_STATUS = Insert(
    STEP_VERSIONS, "kb_id", "plan_id", "position", "since", "until", "status", "text"
)
_STATUS = looked_up(
    STEP_VERSIONS.c.status,
    STEP_VERSIONS.c.position,
    PlanStepRow.position,
    STEP_VERSIONS.c.plan_id == PlanStepRow.plan_id,
    STEP_VERSIONS.c.until.is_(None),
)
FIND_STEP = Query(
    select(PlanStepRow.text, _STATUS).where(
        PlanStepRow.kb_id == KB,
        PlanStepRow.plan_id == bindparam("plan", type_=BigInteger),
        PlanStepRow.position == bindparam("step", type_=Integer),
    )
)


_PLAN: ColumnElement[int] = bindparam("plan", type_=BigInteger)
# With the parameter `plan`; `id` is the position.
STEP_STATEMENTS = VersionTable(
    "position", STEP_VERSIONS, within=lambda version: (version.c.plan_id == _PLAN,)
)


class StepDefinition(NamedTuple):
    """A step of a plan; times are exact decimal text, and the text is `(move rb1 wp1 wp2)`."""

    start: str | None
    duration: str | None
    action_id: int
    object_ids: tuple[int, ...]
    text: str


class PlanDefinition(NamedTuple):
    """A plan as it is recorded: `RecordedPlan` says what the fields mean."""

    id: int
    revision: int
    problem_hash: str
    planner: str | None
    planner_version: str | None
    objective: str | None
    value: str | None
    status: str | None
    domain_pddl: str | None
    problem_pddl: str | None
    steps: tuple[StepDefinition, ...]

    @property
    def text(self) -> str:
        """All of it in canonical form; no two plans have the same.

        A text that is kept stands there by its SHA-256; the ids of actions and objects by names.
        """
        members = (
            ("revision", str(self.revision)),
            ("problem-hash", _quoted(self.problem_hash)),
            ("planner", _quoted(self.planner)),
            ("planner-version", _quoted(self.planner_version)),
            ("objective", _quoted(self.objective)),
            ("value", self.value or "null"),
            ("status", _quoted(self.status)),
            ("domain-pddl", _hash_of(self.domain_pddl)),
            ("problem-pddl", _hash_of(self.problem_pddl)),
            ("steps", f"({' '.join([_step_text(step) for step in self.steps])})"),
        )
        return f"(:plan {self.id} {' '.join([f':{name} {value}' for name, value in members])})"


def _step_text(step: StepDefinition) -> str:
    return f"({step.start or 'null'} {step.text} {step.duration or 'null'})"


def _quoted(text: str | None) -> str:
    return "null" if text is None else encode_basestring(text)


def _hash_of(text: str | None) -> str:
    return "null" if text is None else f'"{sha256(text.encode()).hexdigest()}"'


def status_text(step: Step, status: str) -> str:
    """Write what became of a step."""
    return f"(:plan {step[0]} :step {step[1]} {status})"


_NEW_PLAN = Insert(table_of(PlanRow), "kb_id", "id", "since", *PlanDefinition._fields[1:-1], "text")
_STEP_KEY = ("kb_id", "plan_id", "position")
_NEW_STEP = Insert(table_of(PlanStepRow), *_STEP_KEY, "start", "duration", "action_id", "text")
_NEW_ARGUMENT = Insert(table_of(PlanStepArgumentRow), *_STEP_KEY, "argument", "object_id")


def plan_rows(kb: int, since: int, plan: PlanDefinition) -> Iterator[tuple[Insert, Row]]:
    """Yield the rows of a plan."""
    yield _NEW_PLAN, (kb, plan.id, since, *plan[1:-1], plan.text)
    for position, step in enumerate(plan.steps):
        place: tuple[Any, ...] = (kb, plan.id, position)
        yield _NEW_STEP, (*place, step.start, step.duration, step.action_id, step.text)
        for argument, object_id in enumerate(step.object_ids):
            yield _NEW_ARGUMENT, (*place, argument, object_id)
