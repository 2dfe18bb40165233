"""What a recorded plan is: its canonical text and its rows."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from json.encoder import encode_basestring
from typing import NamedTuple

from .dialects.base import Row
from .executions import (
    NEW_ARGUMENT,
    NEW_EXECUTION,
    ExecutionDefinition,
    argument_rows,
    execution_row,
)
from .query import Insert
from .rows import table_of
from .tables import PlanRow


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
    steps: tuple[ExecutionDefinition, ...]

    @property
    def text(self) -> str:
        """All of it in canonical form; no two plans have the same.

        A text that is kept stands there by its SHA-256; the ids of actions and objects by names.
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
