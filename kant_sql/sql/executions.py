"""Executions and plans: canonical texts, rows, and statements for outcomes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from hashlib import sha256
from json.encoder import encode_basestring
from typing import Any, NamedTuple

from sqlalchemy import BigInteger, ColumnElement, Integer, bindparam, select

from ..knowledge.canonical import time_text
from .dialects.base import Row
from .query import Insert, Query
from .rows import KB, VersionTable, looked_up, table_of
from .tables import ExecutionArgumentRow, ExecutionRow, ExecutionVersionRow, PlanRow

# The key of an execution: the id of its plan and its position there, or `NO_PLAN` and its own id.
Key = tuple[int, int]
NO_PLAN = 0

RUNNING, SUCCEEDED, FAILED = "running", "succeeded", "failed"
ABORTED, REFUSED = "aborted", "refused"
OUTCOMES = (RUNNING, SUCCEEDED, FAILED, ABORTED, REFUSED)
# The kinds of change lines; the second was written before version 0008 of the tables.
EXECUTION, PLAN_STEP = "execution", "plan step"
_STARTED = "started"


class ExecutionDefinition(NamedTuple):
    """An act or a step to execute; times are exact decimal text.

    An argument is the id of an object, or a text instead. The text is `(move rb1 wp1 wp2)`; words
    that are not actions or objects of the knowledge base are quoted.
    """

    start: str | None
    duration: str | None
    action_id: int | None
    name: str | None
    arguments: tuple[int | str, ...]
    text: str


class OutcomeDefinition(NamedTuple):
    """A recorded outcome of an execution; see `ExecutionVersionRow`."""

    kind: str
    outcome: str
    text: str
    code: str | None = None
    message: str | None = None
    started_at: datetime | None = None
    ended_at: datetime | None = None


def quoted(text: str) -> str:
    """Write a word that is not a name of the knowledge base."""
    return encode_basestring(text)


def id_text(key: Key) -> str:
    """Write the id of an execution: `17`, or `12.3` for step 3 of plan 12."""
    plan_id, position = key
    return f"{position}" if plan_id == NO_PLAN else f"{plan_id}.{position}"


def outcome_text(
    key: Key,
    execution: ExecutionDefinition,
    recorded: int,
    since: int,
    outcome: str,
    code: str | None = None,
    message: str | None = None,
    started_at: datetime | None = None,
    ended_at: datetime | None = None,
) -> str:
    """Write an outcome since a revision in canonical form, which is unique.

    The text of a plan has the durations of its steps, and its revision.
    """
    text = f"(:execution {id_text(key)} {execution.text} {outcome}"
    if key[0] == NO_PLAN:
        if execution.duration is not None:
            text += f" :duration {execution.duration}"
        if recorded != since:
            text += f" :recorded-in {recorded}"
    times = (None if at is None else time_text(at) for at in (started_at, ended_at))
    parts = zip(("code", "message", "started-at", "ended-at"), (code, message, *times), strict=True)
    for name, said in parts:
        if said is not None:
            text += f" :{name} {encode_basestring(said)}"
    return f"{text})"


def status_text(key: Key, outcome: str) -> str:
    """Write an outcome of the kind `plan step`."""
    plan_id, position = key
    return f"(:plan {plan_id} :step {position} {_STARTED if outcome == RUNNING else outcome})"


_TOLD = re.compile(r'\(:execution (\S+) (\((?:"(?:[^"\\]|\\.)*"|[^()"])*\)) (\w+)')
_TOLD_STEP = re.compile(r"\(:plan (\d+) :step (\d+) (\w+)\)")


_BEGUN = re.compile(r' :started-at "([-\dT:.Z]+)"(?: :ended-at "[-\dT:.Z]+")?\)$')


def begun_at(text: str) -> datetime | None:
    """Return when an execution began, if the text of its outcome has that."""
    found = _BEGUN.search(text)
    return None if found is None else datetime.fromisoformat(found[1])


class Told(NamedTuple):
    """The content of the text of an outcome: the execution and the outcome.

    Texts of the kind `plan step` do not name the action.
    """

    id: str
    act: str | None
    outcome: str


def read_outcome(text: str) -> Told:
    """Read the text of an outcome.

    Raises:
        ValueError: it is not the text of an outcome.
    """
    found = _TOLD.match(text)
    if found is not None:
        return Told(*found.groups())
    found = _TOLD_STEP.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is not the text of an outcome")
    plan_id, position, status = found.groups()
    outcome = RUNNING if status == _STARTED else status
    return Told(id_text((int(plan_id), int(position))), None, outcome)


VERSIONS = table_of(ExecutionVersionRow)
NEW_OUTCOME = Insert(
    VERSIONS,
    *("kb_id", "plan_id", "position", "since", "until"),
    *("kind", "outcome", "text", "code", "message", "started_at", "ended_at"),
)
_IDENTITY = table_of(ExecutionRow)
_KEY = ("kb_id", "plan_id", "position")
NEW_EXECUTION = Insert(_IDENTITY, *_KEY, "since", "start", "duration", "action_id", "name", "text")
NEW_ARGUMENT = Insert(table_of(ExecutionArgumentRow), *_KEY, "argument", "object_id", "value")
_PLAN: ColumnElement[int] = bindparam("plan", type_=BigInteger)
_POSITION: ColumnElement[int] = bindparam("position", type_=Integer)


def of_execution(column: Any, beside: Any, *conditions: ColumnElement[bool]) -> Any:
    """Look up a column of the row of an execution, for each row beside it that has its key."""
    own = column.table.c
    return looked_up(
        column, own.position, beside.position, own.plan_id == beside.plan_id, *conditions
    )


def _open(column: Any) -> Any:
    return of_execution(column, _IDENTITY.c, VERSIONS.c.until.is_(None))


# An execution without its arguments, and its open version.
FIND = Query(
    select(
        *(_IDENTITY.c[name] for name in ("since", "duration", "text")),
        *(_open(VERSIONS.c[name]) for name in ("kind", "outcome", "text")),
    ).where(
        _IDENTITY.c.kb_id == KB, _IDENTITY.c.plan_id == _PLAN, _IDENTITY.c.position == _POSITION
    )
)
# With the parameter `plan`; `id` is the position.
STATEMENTS = VersionTable(
    "position", VERSIONS, within=lambda version: (version.c.plan_id == _PLAN,)
)


def execution_row(kb: int, since: int, key: Key, execution: ExecutionDefinition) -> Row:
    """Return the row of an execution that a revision records."""
    start, duration, action_id, name, _, text = execution
    return kb, *key, since, start, duration, action_id, name, text


def argument_rows(kb: int, key: Key, execution: ExecutionDefinition) -> list[Row]:
    """Return the rows of the arguments of an execution."""
    return [
        (kb, *key, argument, *((None, given) if isinstance(given, str) else (given, None)))
        for argument, given in enumerate(execution.arguments)
    ]


class PlanDefinition(NamedTuple):
    """A plan to record; see `RecordedPlan`."""

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
    steps: tuple[ExecutionDefinition, ...]

    @property
    def text(self) -> str:
        """All of it in canonical form, which is unique.

        A stored text is represented by its SHA-256, and ids of actions and objects by names.
        """
        steps = [f"({s.start or 'null'} {s.text} {s.duration or 'null'})" for s in self.steps]
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
            ("steps", f"({' '.join(steps)})"),
        )
        return f"(:plan {self.id} {' '.join([f':{name} {value}' for name, value in members])})"


def _quoted(text: str | None) -> str:
    return "null" if text is None else encode_basestring(text)


def _hash_of(text: str | None) -> str:
    return "null" if text is None else f'"{sha256(text.encode()).hexdigest()}"'


_NEW_PLAN = Insert(table_of(PlanRow), "kb_id", "id", "since", *PlanDefinition._fields[1:-1], "text")


def plan_rows(kb: int, since: int, plan: PlanDefinition) -> Iterator[tuple[Insert, Row]]:
    """Yield the rows of a plan."""
    yield _NEW_PLAN, (kb, plan.id, since, *plan[1:-1], plan.text)
    for position, step in enumerate(plan.steps):
        key = (plan.id, position)
        yield NEW_EXECUTION, execution_row(kb, since, key, step)
        for row in argument_rows(kb, key, step):
            yield NEW_ARGUMENT, row
