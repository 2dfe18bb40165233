"""The factories: a family of DAOs for each kind of database, chosen by the URL.

`DaoFactory` is the abstract factory, with one concrete factory for each family;
`create_dao_factory` is the factory method. Another package joins by an entry point in the group
`kant_sql.dao_families`, named like the URL's dialect, that gives a `DaoFactory` class.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import datetime
from importlib.metadata import entry_points

from .backends import create_backend, dialect_name
from .dao.action import SqlActionDao
from .dao.base import refuse_past
from .dao.interfaces import (
    PddlActionDao,
    PddlObjectDao,
    PddlPredicateDao,
    PddlPropositionDao,
    PddlTypeDao,
)
from .dao.object import SqlObjectDao
from .dao.predicate import SqlPredicateDao
from .dao.proposition import SqlPropositionDao
from .dao.type import SqlTypeDao
from .errors import InvalidUrlError
from .history import LogEntry, Revision, head_revision, read_log, read_revisions, revision_at
from .store import Store

ENTRY_POINTS = "kant_sql.dao_families"


class DaoFactory(ABC):
    """Creates the DAOs of one family, all on one knowledge base. Threads may share it."""

    @abstractmethod
    def __init__(self, url: str, knowledge_base: str = "default", actor: str | None = None) -> None:
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
    def transaction(
        self,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
    ) -> AbstractContextManager[None]:
        """Make many calls one revision.

        Within the `with` block, this thread's calls on the knowledge base are one transaction:
        other writers wait, readers see nothing of it, and when the block ends well it becomes one
        revision. When the block raises, nothing of it has happened. A block within another joins
        it: the outer block's actor, reason and source stand, and if only the inner one raises,
        only what it did is undone.

        Args:
            actor: who writes; the factory's actor when not given.
            reason: why.
            source: what the caller knows, as JSON values: the sensor, the plan's step.
            expected_revision: the revision that the caller has read; a block within another is
                held to the revision that the outer one began from.

        Returns:
            The context manager.

        Raises:
            StaleRevisionError: on entry, when the head is another than expected.
            StoreBusyError: on entry, when other writers held the store for too long.
            ConnectionLostError: the connection was lost; nothing of the block was written.
            InvalidMetadataError: actor, reason or source cannot be kept.
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
        """

    @property
    @abstractmethod
    def revision(self) -> int:
        """The number of the last revision, 0 before the first; in a transaction, the one before."""

    @abstractmethod
    def revisions(self, after: int = 0, limit: int | None = None) -> list[Revision]:
        """Read revisions, oldest first.

        Args:
            after: only those with a larger number.
            limit: at most so many; None for all.

        Returns:
            The revisions.
        """

    @abstractmethod
    def log(self, limit: int | None = None) -> Iterator[LogEntry]:
        """Read revisions with what they changed, newest first.

        Args:
            limit: at most so many; None for all.

        Returns:
            The entries, read in pages as they are asked for.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the connections. A store in memory is gone with them."""


class SqlDaoFactory(DaoFactory):
    """Creates DAOs on an SQL store, of the present or of the past."""

    def __init__(self, url: str, knowledge_base: str = "default", actor: str | None = None) -> None:
        """Open a knowledge base.

        Args:
            url: the database URL.
            knowledge_base: the knowledge base's name; it comes to be with its first write.
            actor: who writes, when a transaction does not say.
        """
        self._at: int | None = None
        backend = create_backend(url)
        try:
            self._store = Store(backend, knowledge_base, actor)
        except BaseException:
            backend.close()
            raise

    def create_pddl_type_dao(self) -> PddlTypeDao:
        """Create the DAO of types."""
        return SqlTypeDao(self._store, self._at)

    def create_pddl_object_dao(self) -> PddlObjectDao:
        """Create the DAO of objects."""
        return SqlObjectDao(self._store, self._at)

    def create_pddl_predicate_dao(self) -> PddlPredicateDao:
        """Create the DAO of predicates."""
        return SqlPredicateDao(self._store, self._at)

    def create_pddl_proposition_dao(self) -> PddlPropositionDao:
        """Create the DAO of propositions."""
        return SqlPropositionDao(self._store, self._at)

    def create_pddl_action_dao(self) -> PddlActionDao:
        """Create the DAO of actions."""
        return SqlActionDao(self._store, self._at)

    @contextmanager
    def transaction(
        self,
        actor: str | None = None,
        reason: str | None = None,
        source: object | None = None,
        expected_revision: int | None = None,
    ) -> Iterator[None]:
        """Make many calls one revision."""
        refuse_past(self._store, self._at)
        with self._store.transaction(actor, reason, source, expected_revision):
            yield

    def at(self, when: int | datetime) -> SqlDaoFactory:
        """Look at the past."""
        past = object.__new__(type(self))
        past._store = self._store
        past._at = revision_at(self._store, when)
        return past

    @property
    def revision(self) -> int:
        """The number of the last revision, or of the one that this looks at."""
        return head_revision(self._store) if self._at is None else self._at

    def revisions(self, after: int = 0, limit: int | None = None) -> list[Revision]:
        """Read revisions, oldest first."""
        return read_revisions(self._store, after, limit, self._at)

    def log(self, limit: int | None = None) -> Iterator[LogEntry]:
        """Read revisions with what they changed, newest first."""
        return read_log(self._store, limit, self._at)

    def close(self) -> None:
        """Close the connections; a view of the past leaves them to the factory that it is of."""
        if self._at is None:
            self._store.backend.close()


class SqliteDaoFactory(SqlDaoFactory):
    """The SQLite family: one robot, embedded, in a file or in memory."""


class PostgresqlDaoFactory(SqlDaoFactory):
    """The PostgreSQL family: a fleet, on a server."""


FAMILIES: dict[str, type[DaoFactory]] = {
    "sqlite": SqliteDaoFactory,
    "postgresql": PostgresqlDaoFactory,
}


def create_dao_factory(
    url: str, knowledge_base: str = "default", actor: str | None = None
) -> DaoFactory:
    """Create the factory of the family that a database URL names.

    Args:
        url: the database URL, for example `sqlite:///robot.db`.
        knowledge_base: the knowledge base's name; it comes to be with its first write.
        actor: who writes, when a transaction does not say.

    Returns:
        The factory. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL cannot be read, or no family answers to it.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    name = dialect_name(url)
    family = FAMILIES.get(name) or _joined_family(name)
    return family(url, knowledge_base, actor)


def _joined_family(name: str) -> type[DaoFactory]:
    found = entry_points(group=ENTRY_POINTS)
    for entry_point in found.select(name=name):
        family = entry_point.load()
        if not (isinstance(family, type) and issubclass(family, DaoFactory)):
            raise InvalidUrlError(
                f"{name}: entry point {entry_point.value!r} is not a DaoFactory class"
            )
        return family
    known = ", ".join(sorted({*FAMILIES, *found.names}))
    raise InvalidUrlError(f"{name}: no DAO family answers to this URL; there are {known}")
