"""Recorded plans: their initial states, steps and outcomes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal
from typing import NamedTuple

from .. import html
from ..acts import Execution, Outcome
from ..planning import Plan

__all__ = ["PlanDao", "RecordedPlan"]


class Given(NamedTuple):
    """The PDDL texts of a planner's input."""

    domain: str
    problem: str


@dataclass(frozen=True)
class RecordedPlan:
    """A recorded plan.

    Attributes:
        id: its number in the knowledge base.
        recorded_in: the revision that recorded it.
        revision: the revision of its initial state.
        problem_hash: SHA-256, in hexadecimal, of the planner's input: the UTF-8 of the domain's
            PDDL text, followed by the problem's.
        planner: the planner's name.
        planner_version: the planner's version.
        objective: the metric, as PDDL text.
        value: the value of the objective.
        status: the planner's status, for example `solved_optimally`; with several engines, followed
            by the result of each.
        steps: its steps, in order.
    """

    _json_ = (
        *("plan=id", "recorded_in", "revision", "problem_hash", "planner", "planner_version"),
        *("objective", "value", "status", "steps"),
    )

    id: int
    recorded_in: int
    revision: int
    problem_hash: str
    planner: str | None
    planner_version: str | None
    objective: str | None
    value: Decimal | None
    status: str | None
    steps: tuple[Execution, ...]
    _given: Callable[[RecordedPlan], Given] = field(compare=False, repr=False)

    def _html_row_(self) -> html.Row:
        statuses = Counter(step.outcome or "not started" for step in self.steps)
        return {
            "plan": self.id,
            "recorded in": self.recorded_in,
            "made from": self.revision,
            "planner": self.planner,
            "version": self.planner_version,
            "objective": self.objective,
            "value": self.value,
            "status": self.status,
            "steps": tuple(f"{count:,} {status}" for status, count in statuses.items()),
        }

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_()) + html.listing(self.steps, "step")

    def domain_pddl(self) -> str:
        """Return the planner's domain, byte for byte.

        Returns:
            The PDDL text.

        Raises:
            ArchivedError: the state was moved to an archive.
            PlanError: the text that the store writes today has another hash.
        """
        return self._given(self).domain

    def problem_pddl(self) -> str:
        """Return the planner's problem, byte for byte.

        Returns:
            The PDDL text.

        Raises:
            ArchivedError: the state was moved to an archive.
            PlanError: the text that the store writes today has another hash.
        """
        return self._given(self).problem


class PlanDao(ABC):
    """Records plans, whose steps are executions. Recorded plans are never changed or deleted."""

    @abstractmethod
    def record(
        self,
        plan: Plan,
        *,
        planner: str | None = None,
        planner_version: str | None = None,
        objective: str | None = None,
        value: Decimal | int | None = None,
        domain_pddl: str | None = None,
        problem_pddl: str | None = None,
    ) -> RecordedPlan:
        """Record a plan, in one revision.

        Args:
            plan: the plan, from `kb.plan()`, from `Plan.read` or made by hand. Its `revision` is
                its initial state, by default the head. Names ignore case.
            planner: the planner's name; by default the plan's engine.
            planner_version: the planner's version.
            objective: the metric as PDDL text; by default the state's metric or, if the plan
                ignores a part of it, the planner's metric, if any.
            value: the value of the objective; by default the plan's, if there is an objective.
            domain_pddl: the planner's domain, by default the plan's own, if it differs from the
                text that the store writes for the state.
            problem_pddl: the planner's problem, likewise.

        Returns:
            The recorded plan.

        Raises:
            PlanError: a step is not an action of that state (processes and events are not), or its
                arguments do not fit the parameters; a value cannot be stored exactly; or the plan
                was made from a branch, another knowledge base or the uncommitted state of a
                transaction, and the texts are missing.
            ArchivedError: a part of that state was moved to an archive.
            UnknownRevisionError: there is no such revision.
            ReadOnlyError: this is a view of the past.

        Examples:
            >>> from kant_sql import Plan, PlanStep
            >>> kb.load_domain('''(define (domain doors) (:predicates (open))
            ...   (:action unlock :parameters () :effect (open)))''').revision
            2
            >>> found = Plan((PlanStep(None, "unlock"),), "by hand", "solved_satisficing")
            >>> plan = kb.plans.record(found)
            >>> kb.plans.set_status(plan.steps[0], status="running")
            True
            >>> kb.plans.get(plan.id).steps[0].outcome
            'running'
        """

    @abstractmethod
    def get(self, id_: int) -> RecordedPlan | None:
        """Read a plan with the outcomes of its steps.

        Args:
            id_: its id.

        Returns:
            The plan, or None.
        """

    @abstractmethod
    def get_all(self) -> list[RecordedPlan]:
        """Read all plans, oldest first.

        Returns:
            The plans.
        """

    @abstractmethod
    def set_status(self, step: Execution, *, status: Outcome) -> bool:
        """Set the outcome of a step, like `kb.executions.report`, without reading it back.

        A step is started once, and then succeeds, fails or is aborted. You can also abort a step
        that was not started.

        Returns:
            False if the step already has this outcome.

        Raises:
            PlanError: the step is unknown, or its present outcome does not allow this one.
            InvalidArgumentError: this transaction is about a period.
            ReadOnlyError: this is a view of the past.
        """
