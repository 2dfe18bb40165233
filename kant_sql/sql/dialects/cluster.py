"""Plugins for extensions of PostgreSQL that put tables on several servers (nodes)."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager
from typing import Any, Protocol

from sqlalchemy import Connection

from ...plugins import Plugins

# The extensions of this database but that which each has.
EXTENSIONS = "SELECT extname FROM pg_extension WHERE extname <> 'plpgsql'"


class Nodes(Protocol):
    """What a connection to one node does for the others."""

    def settings(self, *, is_durable: bool = False) -> dict[str, str]:
        """Return what a transaction that writes sets."""

    def replanning(self, is_other: bool) -> str:
        """Write the statement after which a node makes its plans again."""

    def committing(self, synchronous_commit: str) -> Nodes:
        """Return these with another setting of what a commit waits for."""

    def of_one_shard(self, query: str, schema: str, kb_id: int) -> str:
        """Restrict each table of a view's query to one knowledge base."""

    def whole_index(self, name: str) -> str:
        """Return the name of the index that an index of a part of a table belongs to."""


class ClusterExtension(Protocol):
    """A plugin of the group `kant_sql.postgresql_extensions`, by the name of the extension.

    It is asked only in databases that have the extension. Each statement of the library names one
    knowledge base by `kb_id`, so one node can answer it.
    """

    def nodes(self, connection: Any) -> Nodes:
        """Examine a new connection of the driver."""

    def is_distributed(self, connection: Connection, schema: str) -> bool:
        """Return whether the tables of a schema are on several nodes."""

    def fault(self, connection: Connection, label: str) -> str | None:
        """Say which tables are not where the others are; None for none."""

    def use_one_connection(self, connection: Connection) -> None:
        """Let a transaction of schema changes use one connection to each node."""

    def migrating(self, connection: Connection, label: str) -> AbstractContextManager[None]:
        """Let migrations create tables where those of the store are."""

    def of_one_shard(self, query: str, schema: str, kb_id: int) -> str:
        """Restrict each table of a view's query to one knowledge base."""

    def has_lost_a_node(self, state: str, message: str) -> bool:
        """Return whether an error is that of a connection between nodes."""


CLUSTERS: Plugins[ClusterExtension] = Plugins("kant_sql.postgresql_extensions")


def cluster_among(extensions: Iterable[str]) -> ClusterExtension | None:
    """Find the plugin of an extension."""
    found = map(CLUSTERS.get, extensions)
    return next((cluster for cluster in found if cluster is not None), None)


def cluster_of(connection: Connection) -> ClusterExtension | None:
    """Find the plugin of an extension of a database."""
    return cluster_among(connection.exec_driver_sql(EXTENSIONS).scalars().all())
