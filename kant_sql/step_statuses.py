"""What becomes of the steps of plans, in a transaction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .backends import Query, Row
from .knowledge.changes import ASSERTED, PLAN_STEP, RETRACTED, Change
from .knowledge.plan import (
    CLOSE_STEP,
    FIND_STEP,
    STEP_VERSIONS,
    UNMAKE_STEP,
    Step,
    status_text,
)

if TYPE_CHECKING:
    from .transaction import Transaction


class PendingStepStatuses:
    """The steps of plans that a transaction has touched.

    Attributes:
        pending: the status that each is to have, of what is not written yet.
    """

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        # What each had before this revision, and what this revision has written.
        self._before: dict[Step, str | None] = {}
        self._written: dict[Step, str] = {}
        self.pending: dict[Step, str] = {}

    def find(self, step: Step) -> str | None:
        """Find a step, and read its status.

        Args:
            step: the step.

        Returns:
            The text of its action and arguments; None when there is no such step.
        """
        plan_id, position = step
        transaction = self._transaction
        if transaction.records.pending:
            transaction.flush()
        row = transaction.session.first(
            FIND_STEP, kb=transaction.kb_id, plan=plan_id, step=position
        )
        if row is None:
            return None
        if step not in self._before:
            transaction.assign(self._before, step, row[1])
        return str(row[0])

    def get(self, step: Step) -> str | None:
        """Give the status of a step that was found, as changed so far.

        Args:
            step: the step.

        Returns:
            The status; None when it was not started.
        """
        return self.pending.get(step) or self._written.get(step) or self._before[step]

    def set(self, step: Step, status: str) -> None:
        """Let a step that was found have a status.

        Args:
            step: the step.
            status: the status, another than it has.
        """
        self._transaction.assign(self.pending, step, status)

    def changes(self) -> Iterator[Change]:
        """Give what the transaction has changed so far.

        Yields:
            The changes, in no order.
        """
        for step, status in {**self._written, **self.pending}.items():
            before = self._before[step]
            if before is not None:
                yield Change(RETRACTED, PLAN_STEP, status_text(step, before))
            yield Change(ASSERTED, PLAN_STEP, status_text(step, status))

    def write(self) -> None:
        """Write what is pending."""
        session, kb = self._transaction.session, self._transaction.kb_id
        number = self._transaction.number
        closed: list[dict[str, Any]] = []
        unmade: list[dict[str, Any]] = []
        opened: list[Row] = []
        for step, status in self.pending.items():
            place = {"kb": kb, "plan": step[0], "step": step[1]}
            if step in self._written:
                unmade.append(place)
            elif self._before[step] is not None:
                closed.append({**place, "at": number})
            opened.append((kb, *step, number, None, status, status_text(step, status)))
        self._run(UNMAKE_STEP, unmade)
        self._run(CLOSE_STEP, closed)
        session.insert(STEP_VERSIONS, opened)
        self._written.update(self.pending)
        self.pending.clear()

    def _run(self, query: Query, rows: list[dict[str, Any]]) -> None:
        self._transaction.session.run_many(query, rows)

    def state(self) -> list[dict[Any, Any]]:
        """Give the parts of the state, for the transaction to undo."""
        return [self._before, self._written, self.pending]
