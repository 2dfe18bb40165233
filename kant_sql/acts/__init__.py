"""Executions: acts with their actors and outcomes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from decimal import Decimal
from typing import TYPE_CHECKING, Literal

from .. import html
from ..history.revisions import Version
from ..later import asked_for

if TYPE_CHECKING:
    from . import executions as executions
    from . import statistics as statistics
    from .statistics import Statistics
else:
    __getattr__ = asked_for(__name__, {".statistics": ["Statistics"]})

__all__ = ["Execution", "Outcome", "Statistics"]

Outcome = Literal["running", "succeeded", "failed", "aborted", "refused"]


@dataclass(frozen=True, kw_only=True)
class Execution(html.OneRow):
    """An act, or a step of a recorded plan, and its outcome.

    Attributes:
        id: its name in the knowledge base: `17`, or `12.3` for step 3 of plan 12.
        plan_id: the id of its plan; None for an act without a plan.
        position: its index in the plan, from 0; None without a plan.
        start: the planned start, in seconds from the start of the plan; None in a plan without
            times.
        action: the action's name, or the name of an act without PDDL.
        arguments: the names of objects, or the texts that such a component reported.
        duration: seconds; None for an instantaneous action, or if it is unknown.
        outcome: `running`, `succeeded`, `failed`, `aborted` or `refused`; None for a step that was
            not started.
        code: the code of a failure, as the component reported it.
        text: the message of a failure; for a refused act, the conditions that did not hold.
        started_at: when it began, in UTC: the reported time, or that of the commit.
        ended_at: when it ended, in UTC; None before.
        actor: who began it.
        reason: why.
        source: where the order came from, as JSON values.
        outcomes: each of its outcomes, with the revisions that set and ended it.
        revisions: the numbers of the revisions that set its outcomes, or that name it
            (`execution=`).
        knowledge_base: the name of the knowledge base that recorded it.
        references: for the action, then each argument: whether it is a name of the knowledge base.

    An execution does not change after you read it. Within a transaction, `outcome`, `code` and
    `text` include the transaction's own change; fields about revisions cover committed ones only.
    """

    _json_ = (
        *("execution=id", "plan=plan_id", "position", "start", "action", "arguments", "duration"),
        *("outcome", "code", "text", "started_at", "ended_at", "actor", "reason", "source"),
        *("revisions", "references", "due_at"),
    )

    id: str
    plan_id: int | None
    position: int | None
    start: Decimal | None
    action: str
    arguments: tuple[str, ...]
    duration: Decimal | None
    outcome: Outcome | None = None
    code: str | None = None
    text: str | None = None
    started_at: datetime | None = None
    ended_at: datetime | None = None
    actor: str | None = None
    reason: str | None = None
    source: object = None
    outcomes: tuple[Version, ...] = ()
    revisions: tuple[int, ...] = ()
    knowledge_base: str
    references: tuple[bool, ...]

    @property
    def due_at(self) -> datetime | None:
        """When it should end by its duration; None unless it is running and has a duration."""
        if self.outcome != "running" or self.started_at is None or self.duration is None:
            return None
        with suppress(OverflowError):
            return self.started_at + timedelta(seconds=float(self.duration))
        return None

    @property
    def revision(self) -> int | None:
        """The revision that set its outcome; None before any, and until that is committed."""
        last = self.outcomes[-1] if self.outcomes else None
        return last.since.number if last is not None and last.until is None else None

    @property
    def place(self) -> str:
        """How messages name it: `execution 17`, or `step 3 of plan 12`."""
        if self.plan_id is None:
            return f"execution {self.id}"
        return f"step {self.position} of plan {self.plan_id}"

    def __str__(self) -> str:
        return f"({' '.join((self.action, *self.arguments))})"

    def _html_row_(self) -> html.Row:
        outcomes = self.outcomes[-html.LINES :]
        return {
            "execution": self.id,
            "start": self.start,
            "act": str(self),
            "duration": self.duration,
            "outcome": self.outcome,
            "code": self.code,
            "text": self.text,
            "outcomes": tuple(
                f"revision {each.since.number}: {each.text}"
                + ("" if each.since.actor is None else f" by {each.since.actor}")
                for each in outcomes
            ),
        }
