"""The factories of the SQL families."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime

from .abstract_factory import DaoFactory
from .arguments import whole_number
from .backends import create_backend
from .dao.action import SqlActionDao, SqlEventDao, SqlProcessDao
from .dao.base import refuse_past
from .dao.fluent_interfaces import PddlFunctionDao, PddlFunctionValueDao
from .dao.formula import (
    SqlConstraintDao,
    SqlDerivedPredicateDao,
    SqlDomainConstraintDao,
    SqlInitialLiteralDao,
    SqlTimedInitialLiteralDao,
)
from .dao.formula_interfaces import (
    ConstraintDao,
    DerivedPredicateDao,
    GoalDao,
    InitialLiteralDao,
    MetricDao,
    TimedInitialLiteralDao,
)
from .dao.function import SqlFunctionDao
from .dao.function_value import SqlFunctionValueDao
from .dao.goal import SqlGoalDao
from .dao.interfaces import (
    PddlActionDao,
    PddlEventDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlProcessDao,
    PddlPropositionDao,
    PddlTypeDao,
)
from .dao.metric import SqlMetricDao
from .dao.object import SqlObjectDao
from .dao.predicate import SqlPredicateDao
from .dao.proposition import SqlPropositionDao
from .dao.type import SqlTypeDao
from .documents import Exchange, SqlExchange
from .history import History, SqlHistory, head_revision, state_at
from .plans import PlanDao, RecordedStep, SqlPlanDao, check_step, place_of
from .store import Store


class SqlDaoFactory(DaoFactory):
    """Creates DAOs on an SQL store, of the present or of the past."""

    def __init__(
        self, url: str, *, knowledge_base: str = "default", actor: str | None = None
    ) -> None:
        """Open a knowledge base.

        Args:
            url: the database URL.
            knowledge_base: the knowledge base's name; it comes to be with its first write.
            actor: who writes, when a transaction does not say.
        """
        self._at: int | None = None
        backend = create_backend(url)
        try:
            self._open_store = Store(backend, knowledge_base, actor)
            self.has_one_connection = backend.has_one_connection
        except BaseException:
            backend.close()
            raise

    @property
    def _store(self) -> Store:
        """The store, if it was not closed."""
        self._open_store.backend.refuse_closed()
        return self._open_store

    def create_pddl_type_dao(self) -> PddlTypeDao:
        """Create the DAO of types."""
        return SqlTypeDao(self._store, self._at)

    def create_pddl_object_dao(self) -> PddlObjectDao:
        """Create the DAO of objects."""
        return SqlObjectDao(self._store, self._at)

    def create_pddl_predicate_dao(self) -> PddlPredicateDao:
        """Create the DAO of predicates."""
        return SqlPredicateDao(self._store, self._at)

    def create_pddl_function_dao(self) -> PddlFunctionDao:
        """Create the DAO of functions."""
        return SqlFunctionDao(self._store, self._at)

    def create_pddl_function_value_dao(self) -> PddlFunctionValueDao:
        """Create the DAO of the values of functions."""
        return SqlFunctionValueDao(self._store, self._at)

    def create_pddl_proposition_dao(self) -> PddlPropositionDao:
        """Create the DAO of propositions."""
        return SqlPropositionDao(self._store, self._at)

    def create_pddl_action_dao(self) -> PddlActionDao:
        """Create the DAO of actions."""
        return SqlActionDao(self._store, self._at)

    def create_pddl_process_dao(self) -> PddlProcessDao:
        """Create the DAO of processes."""
        return SqlProcessDao(self._store, self._at)

    def create_pddl_event_dao(self) -> PddlEventDao:
        """Create the DAO of events."""
        return SqlEventDao(self._store, self._at)

    def create_derived_predicate_dao(self) -> DerivedPredicateDao:
        """Create the DAO of rules for derived predicates."""
        return SqlDerivedPredicateDao(self._store, self._at)

    def create_timed_initial_literal_dao(self) -> TimedInitialLiteralDao:
        """Create the DAO of timed initial literals."""
        return SqlTimedInitialLiteralDao(self._store, self._at)

    def create_initial_literal_dao(self) -> InitialLiteralDao:
        """Create the DAO of negative literals and equalities of the initial state."""
        return SqlInitialLiteralDao(self._store, self._at)

    def create_goal_dao(self) -> GoalDao:
        """Create the DAO of goals of any form."""
        return SqlGoalDao(self._store, self._at)

    def create_constraint_dao(self) -> ConstraintDao:
        """Create the DAO of the problem's constraints."""
        return SqlConstraintDao(self._store, self._at)

    def create_domain_constraint_dao(self) -> ConstraintDao:
        """Create the DAO of the domain's constraints."""
        return SqlDomainConstraintDao(self._store, self._at)

    def create_metric_dao(self) -> MetricDao:
        """Create the DAO of the metric."""
        return SqlMetricDao(self._store, self._at)

    def create_exchange(self) -> Exchange:
        """Create what loads whole documents, and gives them back."""
        return SqlExchange(self._store, self._at)

    def create_history(self) -> History:
        """Create what knows the past."""
        return SqlHistory(self._store, self._at)

    def create_plan_dao(self) -> PlanDao:
        """Create the DAO of recorded plans."""
        return SqlPlanDao(self._store, self._at)

    @contextmanager
    def transaction(
        self,
        *,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | None = None,
        plan_step: RecordedStep | None = None,
    ) -> Iterator[None]:
        """Make many calls one revision."""
        refuse_past(self._store, self._at)
        if expected_revision is not None:
            whole_number(expected_revision, "expected_revision")
        step = None if plan_step is None else place_of(plan_step)
        own = (actor, reason, source, expected_revision, observed_at, step)
        with self._store.transaction(*own) as transaction:
            if plan_step is not None:
                check_step(transaction, plan_step)
            yield

    def at(self, when: int | datetime) -> SqlDaoFactory:
        """Look at the past."""
        past = object.__new__(type(self))
        past._open_store = self._store
        past._at = state_at(self._store, when, self._at)
        return past

    @property
    def revision(self) -> int:
        """The number of the last revision, or of the one that this looks at."""
        store = self._store
        return head_revision(store) if self._at is None else self._at

    def close(self) -> None:
        """Close the connections; a view of the past leaves them to the factory that it is of."""
        if self._at is None:
            self._open_store.close()


class SqliteDaoFactory(SqlDaoFactory):
    """The SQLite family: one robot, embedded, in a file or in memory."""


class PostgresqlDaoFactory(SqlDaoFactory):
    """The PostgreSQL family: a fleet, on a server."""
