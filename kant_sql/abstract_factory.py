"""The abstract factory: a family of DAOs, all on one knowledge base."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from datetime import datetime

from .dao.fluent_interfaces import PddlFunctionDao, PddlFunctionValueDao
from .dao.formula_interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    GoalDao,
    InitialLiteralDao,
    MetricDao,
    TimedInitialLiteralDao,
)
from .dao.interfaces import (
    PddlActionDao,
    PddlEventDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlProcessDao,
    PddlPropositionDao,
    PddlTypeDao,
)
from .documents import Exchange
from .history import History
from .plans import PlanDao, RecordedStep


class DaoFactory(ABC):
    """Creates the DAOs of one family, all on one knowledge base. Threads may share it.

    Attributes:
        has_one_connection: whether threads take turns on one connection, so that a read waits for
            a transaction that another thread has open.
    """

    has_one_connection: bool = False

    @abstractmethod
    def __init__(
        self, url: str, *, knowledge_base: str = "default", actor: str | None = None
    ) -> None:
        """Open a knowledge base; `create_dao_factory` says what is given and raised."""

    @abstractmethod
    def create_pddl_type_dao(self) -> PddlTypeDao:
        """Create the DAO of types.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_object_dao(self) -> PddlObjectDao:
        """Create the DAO of objects.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_predicate_dao(self) -> PddlPredicateDao:
        """Create the DAO of predicates.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_function_dao(self) -> PddlFunctionDao:
        """Create the DAO of functions.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_function_value_dao(self) -> PddlFunctionValueDao:
        """Create the DAO of the values of functions.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_proposition_dao(self) -> PddlPropositionDao:
        """Create the DAO of propositions.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_action_dao(self) -> PddlActionDao:
        """Create the DAO of actions.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_process_dao(self) -> PddlProcessDao:
        """Create the DAO of processes.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_pddl_event_dao(self) -> PddlEventDao:
        """Create the DAO of events.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_derived_predicate_dao(self) -> DerivedPredicateDao:
        """Create the DAO of rules for derived predicates.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_timed_initial_literal_dao(self) -> TimedInitialLiteralDao:
        """Create the DAO of timed initial literals.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_initial_literal_dao(self) -> InitialLiteralDao:
        """Create the DAO of negative literals and equalities of the initial state.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_goal_dao(self) -> GoalDao:
        """Create the DAO of goals of any form.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_constraint_dao(self) -> ConstraintDao:
        """Create the DAO of the problem's constraints.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_domain_constraint_dao(self) -> ConstraintDao:
        """Create the DAO of the domain's constraints.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_metric_dao(self) -> MetricDao:
        """Create the DAO of the metric.

        Returns:
            The DAO.
        """

    @abstractmethod
    def create_exchange(self) -> Exchange:
        """Create what loads whole documents, and gives them back.

        Returns:
            It.
        """

    @abstractmethod
    def create_history(self) -> History:
        """Create what knows the past.

        Returns:
            It.
        """

    @abstractmethod
    def create_plan_dao(self) -> PlanDao:
        """Create the DAO of recorded plans.

        Returns:
            The DAO.
        """

    @abstractmethod
    def transaction(
        self,
        *,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | None = None,
        plan_step: RecordedStep | None = None,
    ) -> AbstractContextManager[None]:
        """Make many calls one revision.

        Within the `with` block, the calls of this task (or of this thread, where no task runs) on
        the knowledge base are one transaction: other threads that write wait, readers see nothing
        of it, and when the block ends well it becomes one revision. Other tasks, callbacks and
        copies of the context never join it: in its thread, their writes are refused. When the block
        raises, nothing of it has happened. A block within another joins it: what the outer block
        says of itself stands, its actor, reason and source and the step that is running, and if
        only the inner one raises, only what it did is undone.

        Args:
            actor: who writes; the factory's actor when not given.
            reason: why.
            source: what the caller knows, as JSON values: the sensor, the plan's step.
            expected_revision: the revision that the caller has read; a block within another is
                held to the revision that the outer one began from.
            observed_at: when what is written was sensed, an aware time: it is kept beside the time
                of the commit, so that late data is visible as late.
            plan_step: the step of a recorded plan that is running, which the revision links to.

        Returns:
            The context manager.

        Raises:
            StaleRevisionError: on entry, when the head is another than expected.
            StoreBusyError: on entry, when other writers held the store for too long.
            TransactionOpenError: on entry, when another task or context has a transaction open in
                this thread.
            ConnectionLostError: the connection was lost; nothing of the block was written.
            InvalidMetadataError: actor, reason or source cannot be kept, or observed_at has no
                zone.
            PlanError: the step is not of a plan of this knowledge base.
        """

    @abstractmethod
    def at(self, when: int | datetime) -> DaoFactory:
        """Look at the past.

        Args:
            when: a revision's number (0 is before the first), or an aware time up to now.

        Returns:
            A factory whose DAOs read that state, and raise `ReadOnlyError` on a write.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: a part of that state was moved to an archive.
        """

    @property
    @abstractmethod
    def revision(self) -> int:
        """The number of the last revision, 0 before the first; in a transaction, the one before."""

    @abstractmethod
    def close(self) -> None:
        """Close the connections. A store in memory is gone with them.

        Every later call raises `ClosedError`. A transaction that is open is rolled back.
        """
