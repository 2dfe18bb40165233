"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

from contextlib import AbstractContextManager
from datetime import datetime
from types import TracebackType

from .arguments import expect
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
from .documents import DocumentMethods
from .errors import InvalidArgumentError
from .factory import DaoFactory, create_dao_factory
from .history import HistoryMethods
from .plans import PlanDao, RecordedStep


class KnowledgeBase(DocumentMethods, HistoryMethods):
    """A robot's knowledge: what it is now, and what it was. Threads may share it.

    Use it as a context manager, or call `close`.

    Attributes:
        types: the DAO of types.
        objects: the DAO of objects.
        predicates: the DAO of predicates.
        functions: the DAO of functions.
        function_values: the DAO of their values.
        propositions: the DAO of facts and goals.
        actions: the DAO of actions.
        processes: the DAO of processes.
        events: the DAO of events.
        derived_predicates: the DAO of the rules for derived predicates.
        timed_initial_literals: the DAO of timed initial literals and values.
        initial_literals: the DAO of negative literals and equalities of the initial state.
        goals: the DAO of goals of any form.
        constraints: the DAO of the problem's constraints.
        domain_constraints: the DAO of the domain's constraints.
        metric: the DAO of the metric.
        plans: the DAO of recorded plans.
    """

    types: PddlTypeDao
    objects: PddlObjectDao
    predicates: PddlPredicateDao
    functions: PddlFunctionDao
    function_values: PddlFunctionValueDao
    propositions: PddlPropositionDao
    actions: PddlActionDao
    processes: PddlProcessDao
    events: PddlEventDao
    derived_predicates: DerivedPredicateDao
    timed_initial_literals: TimedInitialLiteralDao
    initial_literals: InitialLiteralDao
    goals: GoalDao
    constraints: ConstraintDao
    domain_constraints: ConstraintDao
    metric: MetricDao
    plans: PlanDao

    def __init__(self, factory: DaoFactory) -> None:
        """Make a knowledge base of a factory's DAOs.

        Args:
            factory: the factory; the knowledge base owns it.
        """
        self.factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self.types = factory.create_pddl_type_dao()
        self.objects = factory.create_pddl_object_dao()
        self.predicates = factory.create_pddl_predicate_dao()
        self.functions = factory.create_pddl_function_dao()
        self.function_values = factory.create_pddl_function_value_dao()
        self.propositions = factory.create_pddl_proposition_dao()
        self.actions = factory.create_pddl_action_dao()
        self.processes = factory.create_pddl_process_dao()
        self.events = factory.create_pddl_event_dao()
        self.derived_predicates = factory.create_derived_predicate_dao()
        self.timed_initial_literals = factory.create_timed_initial_literal_dao()
        self.initial_literals = factory.create_initial_literal_dao()
        self.goals = factory.create_goal_dao()
        self.constraints = factory.create_constraint_dao()
        self.domain_constraints = factory.create_domain_constraint_dao()
        self.metric = factory.create_metric_dao()
        self.plans = factory.create_plan_dao()
        DocumentMethods.__init__(self, factory.create_exchange())
        HistoryMethods.__init__(self, factory.create_history())

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
        """Make many calls one revision; `DaoFactory.transaction` says all of it.

        Args:
            actor: who writes; the knowledge base's actor when not given.
            reason: why.
            source: what the caller knows, as JSON values.
            expected_revision: the revision that the caller has read.
            observed_at: when what is written was sensed, an aware time.
            plan_step: the step of a recorded plan that is running.

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
        return self.factory.transaction(
            actor=actor,
            reason=reason,
            source=source,
            expected_revision=expected_revision,
            observed_at=observed_at,
            plan_step=plan_step,
        )

    def at(self, when: int | datetime) -> KnowledgeBase:
        """Look at the past through the same DAOs, which raise `ReadOnlyError` on a write.

        Args:
            when: a revision's number (0 is before the first), or an aware time up to now.

        Returns:
            The knowledge base as it was.

        Raises:
            UnknownRevisionError: there is no such revision yet, or the time lies in the future or
                has no zone.
            ArchivedError: a part of that state was moved to an archive.
        """
        return KnowledgeBase(self.factory.at(when))

    @property
    def revision(self) -> int:
        """The number of the last revision, 0 before the first.

        Within a transaction it is the one that it began from; on a view of the past, the one that
        the view looks at.
        """
        return self.factory.revision

    def close(self) -> None:
        """Close the connections. A store in memory is gone with them.

        Every later call raises `ClosedError`, on views of the past, too. A transaction that is open
        is rolled back: at once if it is this thread's, else when its block ends.
        """
        self.factory.close()

    def __enter__(self) -> KnowledgeBase:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def connect(
    url: str, *, knowledge_base: str = "default", actor: str | None = None
) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        url: the database URL: `sqlite:///robot.db` for a file, `sqlite://` for a store in memory,
            `postgresql://user@host/database` for a server.
        knowledge_base: the knowledge base's name; it comes to be with its first write.
        actor: who writes, when a transaction does not say.

    Returns:
        The knowledge base. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL cannot be read, or no DAO family answers to it.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    return KnowledgeBase(create_dao_factory(url, knowledge_base=knowledge_base, actor=actor))
