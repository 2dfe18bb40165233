"""A store whose knowledge bases share a few connections."""

from __future__ import annotations

from typing import Self

from .arguments import flag, whole_number
from .errors import InvalidArgumentError, InvalidUrlError
from .factory import SqlDaoFactory, family_of
from .knowledge_base import KnowledgeBase
from .sql.dialects import create_backend, dialect_name
from .sql.inventory import Catalog, Inventory
from .sql.schema import ensure_schema
from .store.store import close_backend

# Of these, writers take all but one.
CONNECTIONS, FEWEST_CONNECTIONS = 8, 2


class KnowledgeStore:
    """A store with all its knowledge bases, over a few connections that they share.

    Threads may share it. Use it as a context manager, or call `close`.

    Attributes:
        connections: how many connections to a server there may be.
        catalog: pages of its knowledge bases, and searches by name.
    """

    def __init__(
        self, url: str, *, connections: int = CONNECTIONS, read_only: bool = False
    ) -> None:
        """Open the store, as `open_store` describes."""
        family = family_of(url)
        if not issubclass(family, SqlDaoFactory):
            raise InvalidUrlError(
                f"{dialect_name(url)}: this DAO family shares no connections; use kant_sql.connect"
            )
        self._family = family
        self.connections = connections
        self._backend = create_backend(url, read_only=read_only, connections=connections)
        self.catalog = Catalog(self._backend)
        try:
            ensure_schema(self._backend)
        except BaseException:
            self._backend.close()
            raise

    @property
    def address(self) -> str:
        """The URL of the store for people to read, without a password."""
        return self._backend.label

    @property
    def has_one_connection(self) -> bool:
        """Whether all threads take turns on one connection, as in memory."""
        return self._backend.has_one_connection

    @property
    def writers(self) -> int:
        """How many transactions can be open at once."""
        # One queue for all knowledge bases: there is one writer.
        is_one = self._backend.queue("a") == self._backend.queue("b")
        return 1 if is_one else self.connections - 1

    def knowledge_base(self, name: str = "default", *, actor: str | None = None) -> KnowledgeBase:
        """Open a knowledge base on the connections of the store, without a statement.

        Keep it for as long as it is of use: what it has read of definitions, and of up to 2,000
        facts, saves statements. Closing it closes no connection.

        Args:
            name: the knowledge base's name; the first write creates it.
            actor: who writes, by default.

        Returns:
            The knowledge base.

        Raises:
            InvalidMetadataError: this cannot name a knowledge base.
            ClosedError: the store was closed.

        Examples:
            >>> import kant_sql
            >>> from kant_sql import PddlTypeDto
            >>> with kant_sql.open_store("sqlite://") as store:
            ...     for name in ("tiago", "pepper"):
            ...         _ = store.knowledge_base(name).types.save(PddlTypeDto("robot"))
            ...     print([(one.name, one.revision) for one in store.knowledge_bases()])
            [('tiago', 1), ('pepper', 1)]
        """
        self._backend.refuse_closed()
        return KnowledgeBase(self._family.one_of_many(self._backend, name, actor))

    def knowledge_bases(self) -> list[Inventory]:
        """List the knowledge bases that have a revision, the oldest first.

        Returns:
            What is in each of them, the oldest knowledge base first.
        """
        return self.catalog.every()

    def close(self) -> None:
        """Close all knowledge bases and all connections. This deletes a store in memory.

        Open transactions are rolled back: those of this thread at once, others at the end of their
        blocks.
        """
        close_backend(self._backend)

    def __repr__(self) -> str:
        closed = ", closed" if self._backend.is_closed else ""
        return f"<{type(self).__name__} {self.address}{closed}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def open_store(url: str, *, connections: int = 8, read_only: bool = False) -> KnowledgeStore:
    """Open a store to work with many of its knowledge bases over a few connections.

    A transaction holds a connection until its block ends. One connection is kept for those who
    only read, so one fewer than `connections` can write at once; further writers wait without a
    connection, for up to 20 s, as those do who read. All who watch share one further connection.

    Args:
        url: the database URL, as for `kant_sql.connect`.
        connections: how many connections to a server there may be, besides that of the watchers;
            at least 2. A file, or a store in memory, needs no limit.
        read_only: whether the database is to refuse all writes of these connections.

    Returns:
        The store. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL is not valid, or of a DAO family that shares no connections.
        InvalidArgumentError: there would be fewer than 2 connections.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    flag(read_only, "read_only", InvalidArgumentError)
    whole_number(
        connections, "connections", least=FEWEST_CONNECTIONS, expected="a whole number from 2 on"
    )
    return KnowledgeStore(url, connections=connections, read_only=read_only)
