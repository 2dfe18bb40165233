"""The abstract factory, its families, and `create_dao_factory`, which picks one by the URL.

Another package adds a family by an entry point in the group `kant_sql.dao_families` that has the
name of the URL's dialect and refers to a `DaoFactory` class.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import datetime
from typing import Any, Self, TypeVar

from typing_extensions import override

from . import dao
from .acts import Execution
from .arguments import flag
from .dao import interfaces as daos
from .dao.base import refuse_past
from .errors import InvalidArgumentError, InvalidUrlError
from .history.moments import head_revision, past_state, state_at
from .knowledge.sayings import COMMITTED
from .limits import PATIENCE
from .moment_text import When, read_when
from .plans import PlanDao
from .plugins import Plugins
from .sql.dialects import BACKENDS, create_backend, dialect_name
from .sql.dialects.base import Backend
from .store.state import State
from .store.store import Store

__all__ = [
    "FAMILIES",
    "DaoFactory",
    "PostgresqlDaoFactory",
    "SqliteDaoFactory",
    "create_dao_factory",
]


def daos_only(factory: DaoFactory, lacked: str) -> InvalidUrlError:
    """Make the error for a part that a family without an SQL store lacks."""
    return InvalidUrlError(
        f"{type(factory).__name__}: this DAO family lacks {lacked}; use an SQL store, such as "
        "sqlite:// or postgresql://"
    )


class DaoFactory(ABC):
    """Creates the DAOs of one family, all on one knowledge base. Threads may share it.

    Attributes:
        has_one_connection: whether threads take turns on one connection, so a read waits for an
            open transaction of another thread.
        queue: the queue of its writers: equal values are one queue; None if unknown.
        patience: seconds that a call waits for another writer.
        name: the name of the knowledge base.
        address: the URL of the store for messages, without a password.
        label: the name, the address and the state, for messages.
    """

    has_one_connection: bool = False
    queue: Hashable = None
    patience: float = PATIENCE
    name: str = ""
    address: str = ""
    label: str = ""

    @abstractmethod
    def __init__(
        self,
        url: str,
        *,
        knowledge_base: str = "default",
        actor: str | None = None,
        read_only: bool = False,
    ) -> None:
        """Open a knowledge base, as `create_dao_factory` describes."""

    def transaction(
        self,
        *,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | str | None = None,
        valid_from: datetime | str | None = None,
        valid_until: datetime | str | None = None,
        execution: Execution | None = None,
        confirm: bool = False,
    ) -> AbstractContextManager[None]:
        """Make many calls one revision.

        Within the `with` block, the calls of this task (or of this thread, outside of asyncio) are
        one transaction. Other writers wait, readers do not see it, and the end of the block commits
        it as one revision. An exception rolls it back. Other tasks, callbacks and copies of the
        context never join the block: their writes in its thread are refused.

        A nested block joins the outer one and keeps its metadata. An exception that leaves only the
        nested block rolls back only that.

        Args:
            actor: who writes; by default the actor of `connect`.
            reason: why.
            source: where the knowledge comes from, as JSON values: a sensor, a plan's step.
            expected_revision: the revision that you have read, for optimistic locking; a nested
                block compares it with the revision from which the outer one began.
            observed_at: when the knowledge was sensed, an aware time or a text such as `2 minutes
                ago`; stored beside the time of the commit.
            valid_from: the beginning of the valid period, a time as for `observed_at`: saving a
                fact or setting a value records that it held from then on, deleting that it did not.
                By default now.
            valid_until: the end of a valid period in the past: the present does not change.
                Definitions, goals and plans have no valid period.
            execution: the running execution, a step of a recorded plan or not; the revision links
                to it.
            confirm: whether saving a fact that already holds confirms it.

        Returns:
            The context manager.

        Raises:
            StaleRevisionError: on entry, if the head is not the expected revision.
            StoreBusyError: on entry, if other writers held the store for too long.
            TransactionOpenError: on entry, if another task or context has a transaction open in
                this thread.
            ConnectionLostError: the connection was lost; nothing of the block was written.
            InvalidMetadataError: actor, reason or source cannot be stored, or observed_at has no
                zone.
            InvalidArgumentError: a text is not a time; a period is empty, in the future, or differs
                from that of the outer block.
            PlanError: the execution belongs to another knowledge base.

        Examples:
            >>> with kb.transaction(actor="executive", reason="navigation finished"):
            ...     _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
            ...     _ = kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
            >>> kb.revision
            2
        """
        raise daos_only(self, "transactions")

    def at(
        self, when: When | None = None, *, known: When | None = None, valid: When | None = None
    ) -> Self:
        """Return the factory of a past state, like `KnowledgeBase.at`."""
        raise daos_only(self, "past states")

    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> DaoFactory:
        """Create a knowledge base from a state of this one, like `KnowledgeBase.branch`."""
        raise daos_only(self, "branches")

    @property
    def revision(self) -> int:
        """The number of the last revision, like `KnowledgeBase.revision`."""
        raise daos_only(self, "revisions")

    def close(self) -> None:  # noqa: B027  # a family may have nothing to close
        """Close the connections, like `KnowledgeBase.close`."""

    @abstractmethod
    def create_pddl_type_dao(self) -> daos.PddlTypeDao:
        """Create the DAO of types."""

    @abstractmethod
    def create_pddl_object_dao(self) -> daos.PddlObjectDao:
        """Create the DAO of objects."""

    @abstractmethod
    def create_pddl_predicate_dao(self) -> daos.PddlPredicateDao:
        """Create the DAO of predicates."""

    @abstractmethod
    def create_pddl_function_dao(self) -> daos.PddlFunctionDao:
        """Create the DAO of functions."""

    @abstractmethod
    def create_pddl_function_value_dao(self) -> daos.PddlFunctionValueDao:
        """Create the DAO of function values."""

    @abstractmethod
    def create_pddl_proposition_dao(self) -> daos.PddlPropositionDao:
        """Create the DAO of facts."""

    @abstractmethod
    def create_pddl_action_dao(self) -> daos.PddlActionDao:
        """Create the DAO of actions."""

    @abstractmethod
    def create_pddl_process_dao(self) -> daos.PddlProcessDao:
        """Create the DAO of processes."""

    @abstractmethod
    def create_pddl_event_dao(self) -> daos.PddlEventDao:
        """Create the DAO of events."""

    @abstractmethod
    def create_derived_predicate_dao(self) -> daos.DerivedPredicateDao:
        """Create the DAO of the rules of derived predicates."""

    @abstractmethod
    def create_timed_initial_literal_dao(self) -> daos.TimedInitialLiteralDao:
        """Create the DAO of timed initial literals and values."""

    @abstractmethod
    def create_initial_literal_dao(self) -> daos.InitialLiteralDao:
        """Create the DAO of negative literals and equalities of the initial state."""

    @abstractmethod
    def create_goal_dao(self) -> daos.GoalDao:
        """Create the DAO of goals of any form."""

    @abstractmethod
    def create_constraint_dao(self) -> daos.ConstraintDao:
        """Create the DAO of the problem's constraints."""

    @abstractmethod
    def create_domain_constraint_dao(self) -> daos.ConstraintDao:
        """Create the DAO of the domain's constraints."""

    @abstractmethod
    def create_metric_dao(self) -> daos.MetricDao:
        """Create the DAO of the metric."""

    @abstractmethod
    def create_plan_dao(self) -> PlanDao:
        """Create the DAO of recorded plans."""


T = TypeVar("T")


def _creates(find: Callable[[], Callable[[Store, int | None], T]]) -> Callable[[SqlDaoFactory], T]:
    """Create the class that `find` names, whose module it imports."""
    return lambda factory: find()(factory._open_store, factory._at)


class SqlDaoFactory(DaoFactory):
    """Creates DAOs on an SQL store, of the present or of the past."""

    @override
    def __init__(
        self,
        url: str,
        *,
        knowledge_base: str = "default",
        actor: str | None = None,
        read_only: bool = False,
        clock: str = COMMITTED,
    ) -> None:
        self._at: int | None = None
        backend = create_backend(url, read_only=read_only)
        try:
            self._take(Store(backend, knowledge_base, actor, clock))
        except BaseException:
            backend.close()
            raise

    @classmethod
    def one_of_many(
        cls, backend: Backend, knowledge_base: str, actor: str | None, clock: str = COMMITTED
    ) -> Self:
        """Open a knowledge base on shared connections, without a statement."""
        made = object.__new__(cls)
        made._at = None
        made._take(Store(backend, knowledge_base, actor, clock, is_one_of_many=True))
        return made

    def _take(self, store: Store) -> None:
        self._store, self.queue = store, store.queue
        self.patience = store.backend.patience
        self.has_one_connection = store.backend.has_one_connection

    @property
    @override
    def name(self) -> str:  # type: ignore[override]
        return self._store.name

    @property
    @override
    def address(self) -> str:  # type: ignore[override]
        return self._store.backend.label

    @property
    @override
    def label(self) -> str:  # type: ignore[override]
        past = "" if self._at is None else f" at {self._store.described(self._at)}"
        closed = ", closed" if self._store.is_closed else ""
        return f"{self.name!r} of {self.address}{past}{closed}"

    @property
    def _open_store(self) -> Store:
        """The store; refuses a closed one."""
        self._store.refuse_closed()
        return self._store

    @property
    def state(self) -> State:
        """The state that questions read."""
        return State(self._open_store, self._at)

    create_pddl_type_dao = _creates(lambda: dao.type.SqlTypeDao)
    create_pddl_object_dao = _creates(lambda: dao.type.SqlObjectDao)
    create_pddl_predicate_dao = _creates(lambda: dao.signatures.SqlPredicateDao)
    create_pddl_function_dao = _creates(lambda: dao.signatures.SqlFunctionDao)
    create_pddl_function_value_dao = _creates(lambda: dao.function_value.SqlFunctionValueDao)
    create_pddl_proposition_dao = _creates(lambda: dao.proposition.SqlPropositionDao)
    create_pddl_action_dao = _creates(lambda: dao.action.SqlActionDao)
    create_pddl_process_dao = _creates(lambda: dao.action.SqlProcessDao)
    create_pddl_event_dao = _creates(lambda: dao.action.SqlEventDao)
    create_derived_predicate_dao = _creates(lambda: dao.formula.SqlDerivedPredicateDao)
    create_timed_initial_literal_dao = _creates(lambda: dao.formula.SqlTimedInitialLiteralDao)
    create_initial_literal_dao = _creates(lambda: dao.formula.SqlInitialLiteralDao)
    create_goal_dao = _creates(lambda: dao.formula.SqlGoalDao)
    create_constraint_dao = _creates(lambda: dao.formula.SqlConstraintDao)
    create_domain_constraint_dao = _creates(lambda: dao.formula.SqlDomainConstraintDao)
    create_metric_dao = _creates(lambda: dao.formula.SqlMetricDao)

    @override
    def create_plan_dao(self) -> PlanDao:
        from .plans.dao import SqlPlanDao

        return SqlPlanDao(self._open_store, self._at)

    @override
    @contextmanager
    def transaction(
        self,
        *,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
        observed_at: datetime | str | None = None,
        valid_from: datetime | str | None = None,
        valid_until: datetime | str | None = None,
        execution: Execution | None = None,
        confirm: bool = False,
    ) -> Iterator[None]:
        refuse_past(self._open_store, self._at)
        flag(confirm, "confirm", InvalidArgumentError)
        step = None
        if execution is not None:
            from .acts.recording import check_execution, key_of

            step = key_of(execution)
        # That call refuses the number of a revision.
        seen, *given = (read_when(one) for one in (observed_at, valid_from, valid_until))
        own: Any = (actor, reason, source, expected_revision, seen, step, False, tuple(given))
        with self._open_store.transaction(*own) as transaction:
            if confirm:
                transaction.refuse_period("confirm=True", "confirm facts in another transaction")
            if execution is not None:
                check_execution(transaction, execution)
            before = transaction.confirms
            transaction.confirms = before or confirm
            try:
                yield
            finally:
                transaction.confirms = before

    @override
    def at(
        self, when: When | None = None, *, known: When | None = None, valid: When | None = None
    ) -> Self:
        past = object.__new__(type(self))
        past._store, past._at = past_state(self.state, when, known, valid)
        return past

    @override
    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> DaoFactory:
        from .history.restore import read_origin, write_branch

        store = self._open_store
        origin = read_origin(store, self._at if at is None else state_at(self.state, at))
        if url is None and name is not None:
            store.refuse_read_only()
        made = self._beside(store, store.name if name is None else name, url, name is not None)
        try:
            if not isinstance(made, SqlDaoFactory):
                raise InvalidUrlError(f"{type(made).__name__}: this DAO family takes no branches")
            write_branch(made._open_store, origin)
        except BaseException:
            made.close()
            raise
        return made

    def _beside(self, store: Store, name: str, url: str | None, is_here: bool) -> DaoFactory:
        """Open the store of a branch."""
        if url is None and is_here and store.is_one_of_many:
            return type(self).one_of_many(store.backend, name, store.actor, store.write_clock)
        if url is None:
            url = store.backend.address if is_here else "sqlite://"
        return create_dao_factory(
            url, knowledge_base=name, actor=store.actor, clock=store.write_clock
        )

    @property
    @override
    def revision(self) -> int:
        return head_revision(self.state)

    @override
    def close(self) -> None:
        if self._at is None:
            self._store.close()


class SqliteDaoFactory(SqlDaoFactory):
    """The SQLite family: one robot, embedded, in a file or in memory."""


class PostgresqlDaoFactory(SqlDaoFactory):
    """The PostgreSQL family: a fleet, on a server."""


JOINED: Plugins[object] = Plugins("kant_sql.dao_families")

FAMILIES: dict[str, type[DaoFactory]] = {
    "sqlite": SqliteDaoFactory,
    "postgresql": PostgresqlDaoFactory,
}


def create_dao_factory(
    url: str,
    *,
    knowledge_base: str = "default",
    actor: str | None = None,
    read_only: bool = False,
    clock: str = COMMITTED,
) -> DaoFactory:
    """Create the factory of the DAO family that supports a database URL.

    Arguments and errors are those of `kant_sql.connect`.

    Returns:
        The factory. A new SQLite file, or a store in memory, is created.

    Examples:
        >>> factory = create_dao_factory("sqlite://")
        >>> factory.create_pddl_type_dao().get_all()
        []
        >>> factory.close()
    """
    flag(read_only, "read_only", InvalidArgumentError)
    family = family_of(url)
    # Other families check their own arguments.
    rest: dict[str, Any] = {"read_only": True} if read_only else {}
    if clock != COMMITTED:
        rest["clock"] = clock
    return family(url, knowledge_base=knowledge_base, actor=actor, **rest)


def family_of(url: str) -> type[DaoFactory]:
    """Find the DAO family that supports a database URL."""
    name = dialect_name(url)
    return FAMILIES.get(name) or (SqlDaoFactory if name in BACKENDS else _joined_family(name))


def _joined_family(name: str) -> type[DaoFactory]:
    family = JOINED.get(name)
    if isinstance(family, type) and issubclass(family, DaoFactory):
        return family
    if family is not None:
        place = f"{family.__module__}:{getattr(family, '__qualname__', family)}"
        raise InvalidUrlError(f"{name}: entry point {place!r} is not a DaoFactory class")
    known = ", ".join(sorted({*FAMILIES, *JOINED.names()}))
    raise InvalidUrlError(f"{name}: no DAO family supports this URL; choose one of: {known}")
