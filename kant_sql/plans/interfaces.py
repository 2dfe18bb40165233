"""What the DAO of plans does."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Literal, NamedTuple, Protocol

from ..history import Version
from ..planning import Plan

StepStatus = Literal["started", "succeeded", "failed", "aborted"]


class Given(NamedTuple):
    """What a planner was given.

    Attributes:
        domain: the domain's PDDL text.
        problem: the problem's PDDL text.
    """

    domain: str
    problem: str


class GivenReader(Protocol):
    """Gives again what the planner of a recorded plan was given."""

    def read(self, plan: RecordedPlan) -> Given:
        """Read it from the store, and compare it with the plan's hash."""


@dataclass(frozen=True)
class RecordedStep:
    """A step of a plan that was recorded, and what became of it.

    Attributes:
        plan_id: the id of its plan.
        position: its place in the plan, from 0.
        start: seconds from the plan's beginning; None in a plan without times.
        action: the action's name.
        arguments: the objects' names.
        duration: seconds; None for what happens in an instant.
        status: `started`, `succeeded`, `failed` or `aborted`; None when it was not started.
        outcomes: each status that it had, with the revisions that set it and ended it.
        revisions: the numbers of the revisions that were made while it ran (`plan_step=`).
        knowledge_base: the knowledge base that its plan was recorded in.

    The step is as it was when it was read. Within a transaction, `status` is what the transaction
    has made it; `outcomes` are of committed revisions alone.
    """

    plan_id: int
    position: int
    start: Decimal | None
    action: str
    arguments: tuple[str, ...]
    duration: Decimal | None
    status: StepStatus | None
    outcomes: tuple[Version, ...]
    revisions: tuple[int, ...]
    knowledge_base: str

    def __str__(self) -> str:
        return f"({' '.join((self.action, *self.arguments))})"


@dataclass(frozen=True)
class RecordedPlan:
    """A plan that was recorded.

    Attributes:
        id: its id.
        recorded_in: the revision that recorded it.
        revision: the revision of the state that it was planned from.
        problem_hash: SHA-256, in hexadecimal, of what the planner was given: the UTF-8 of the
            domain's PDDL text and then of the problem's.
        planner: who found it.
        planner_version: which version of that.
        objective: what it was to make small or large, as PDDL text.
        value: what the objective comes to.
        status: what the planner said of it.
        steps: its steps, in order.
    """

    id: int
    recorded_in: int
    revision: int
    problem_hash: str
    planner: str | None
    planner_version: str | None
    objective: str | None
    value: Decimal | None
    status: str | None
    steps: tuple[RecordedStep, ...]
    _given: GivenReader = field(compare=False, repr=False)

    def domain_pddl(self) -> str:
        """Give the domain that the planner was given, byte for byte.

        Returns:
            The PDDL text.

        Raises:
            ArchivedError: the state was moved to an archive.
            PlanError: what the store writes today is not what it was, by its hash.
        """
        return self._given.read(self).domain

    def problem_pddl(self) -> str:
        """Give the problem that the planner was given, byte for byte.

        Returns:
            The PDDL text.

        Raises:
            ArchivedError: the state was moved to an archive.
            PlanError: what the store writes today is not what it was, by its hash.
        """
        return self._given.read(self).problem


class PlanDao(ABC):
    """Records plans, and what became of their steps. Nothing recorded is changed or deleted."""

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
            plan: the plan; its `revision` is the state that it was planned from, the head when
                it has none. Names are in any spelling.
            planner: who found it; the plan's engine when not given.
            planner_version: which version of that.
            objective: what it was to make small or large; the state's metric when not given.
            value: what the objective comes to.
            domain_pddl: the domain that the planner was given, if it is not what the store
                writes of the state.
            problem_pddl: the problem that the planner was given, likewise.

        Returns:
            The plan as recorded.

        Raises:
            PlanError: a step names no action of that state (a process or an event is none), gives
                it other arguments than it has parameters, or objects that are not known or do not
                fit; something cannot be kept as given; or the plan was found in a transaction, from
                what no revision says, and the texts were not given.
            ArchivedError: a part of that state was moved to an archive.
            UnknownRevisionError: there is no such revision.
            ReadOnlyError: this is a view of the past.
        """

    @abstractmethod
    def get(self, id_: int) -> RecordedPlan | None:
        """Read a plan, with what became of its steps.

        Args:
            id_: its id.

        Returns:
            The plan; None when there is none of this id.
        """

    @abstractmethod
    def get_all(self) -> list[RecordedPlan]:
        """Read all plans, oldest first.

        Returns:
            The plans.
        """

    @abstractmethod
    def set_status(self, step: RecordedStep, *, status: StepStatus) -> bool:
        """Say what becomes of a step.

        A step is started once, and then succeeds, fails or is aborted; one that was not started
        may be aborted too.

        Args:
            step: the step.
            status: `started`, `succeeded`, `failed` or `aborted`.

        Returns:
            False when it has this status already.

        Raises:
            PlanError: the step is not known, or cannot come to this status from the one it has.
            ReadOnlyError: this is a view of the past.
        """
